"""Dynamics of tool tips: modes, or a measured frequency response.

A mode moves the tip in one direction of the machine's frame, and adds to the receptance there
1 / (k - m w^2 + i c w) = 1 / (k (1 - r^2 + 2 i zeta r)), r = w / w_n (Altintas 2012, eq. 3.20);
time goes as e^(i w t), so that the imaginary part is negative.

Files of measured responses are CSV or universal files (UFF, UNV).  A CSV file has a header line,
then one line for each frequency, columns separated by comma, semicolon or tab.  The header names
the columns in any order, units in brackets:

- ``frequency [Hz]``;
- ``real [um/N], imaginary [um/N]``, or ``magnitude [um/N], phase [deg]`` (or ``[rad]``).

Units of the response are m/N, mm/N, um/N, of a mobility m/s/N, mm/s/N, of an accelerance m/s^2/N,
mm/s^2/N, g/N.  Other columns are not read, nor lines that begin with ``#``, nor a line at 0 Hz.
Of a universal file data set 58 is read, text or binary.  Its unit is that of the ordinate's label,
else that of data set 164, else SI.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.ranges import Positive, Range, Ranged

DIRECTIONS = ("x", "y")


@dataclass(frozen=True, kw_only=True)
class Mode(Ranged, section="mode"):
    """Mode of the machine as seen at the tool's tip, with either stiffness or mass.

    Examples
    --------
    >>> mode = Mode(direction="x", natural_frequency_Hz=922.0, damping=0.011, mass_kg=0.03993)
    >>> round(mode.stiffness / 1e6, 3)  # [N/um]
    1.34
    """

    direction: Literal["x", "y"]
    """Axis of the machine along which the tip moves."""
    natural_frequency_Hz: Positive
    """Undamped [Hz]."""
    damping: Annotated[float, Range(above=0.0, below=1.0)]
    """Ratio zeta [1]."""
    stiffness_N_m: Positive | None = None
    mass_kg: Positive | None = None
    """Modal stiffness [N/m] or modal mass [kg]; the other follows from it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction not in DIRECTIONS:
            raise ValueError(f"mode.direction = {self.direction!r} is none: write x or y")
        if (self.stiffness_N_m is None) == (self.mass_kg is None):
            raise ValueError(
                f"mode.stiffness_N_m = {self.stiffness_N_m}, mode.mass_kg = {self.mass_kg}: give "
                "exactly one of them, the natural frequency says the other"
            )

    @property
    def omega(self) -> float:
        """Natural angular frequency w_n [rad/s]."""
        return 2 * pi * self.natural_frequency_Hz

    @property
    def stiffness(self) -> float:
        """Modal stiffness k = m w_n^2 [N/m]."""
        if self.stiffness_N_m is None:
            return (self.mass_kg or 0.0) * self.omega**2
        return self.stiffness_N_m

    @property
    def mass(self) -> float:
        """Modal mass m [kg]."""
        return self.stiffness / self.omega**2

    @property
    def axis(self) -> int:
        """0 for x, 1 for y."""
        return DIRECTIONS.index(self.direction)


def modal_receptance(modes: Sequence[Mode], frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """Receptance of the tip, displacement over force, sum of its modes [m/N]; shape (F, 2, 2).

    Diagonal at each frequency; rows: direction of the displacement, columns: of the force, x, y of
    the machine.
    """
    frequency = np.asarray(frequency_Hz, dtype=np.float64)
    receptance = np.zeros((*frequency.shape, 2, 2), dtype=np.complex128)
    for mode in modes:
        r = frequency / mode.natural_frequency_Hz
        flexible = 1.0 / (mode.stiffness * (1.0 - r * r + 2j * mode.damping * r))
        receptance[..., mode.axis, mode.axis] += flexible
    return receptance


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse:
    """Receptance of the tip at F frequencies, ascending; real and imaginary part linear between.

    ValueError when a direct receptance's imaginary part is positive at its peak: energy would come
    out of the structure.
    """

    frequency_Hz: Floats
    """Growing, above 0 [Hz]; shape (F,)."""
    receptance: Complexes
    """Displacement over force [m/N], time as e^(i w t); rows: direction of the displacement,
    columns: of the force; x, y of the machine.  Entries that were not measured are 0;
    shape (F, 2, 2)."""

    def __post_init__(self) -> None:
        if len(self.frequency_Hz) < 2 or self.receptance.shape != (len(self.frequency_Hz), 2, 2):
            raise ValueError(
                f"frequency response: {len(self.frequency_Hz)} frequencies with a receptance of "
                f"shape {self.receptance.shape}; it needs two or more, each with a 2 x 2 matrix"
            )
        bad = ~np.isfinite(self.frequency_Hz) | ~np.isfinite(self.receptance).all(axis=(1, 2))
        if bad.any():
            raise ValueError(f"frequency response: value {int(bad.argmax()) + 1} is not finite")
        falls = np.flatnonzero(np.diff(self.frequency_Hz, prepend=0.0) <= 0.0)
        if len(falls):
            raise ValueError(
                f"frequency response: frequency {int(falls[0]) + 1}, "
                f"{self.frequency_Hz[falls[0]]:g} Hz, is not above the one before (or 0)"
            )
        for axis, name in enumerate(DIRECTIONS):
            direct = self.receptance[:, axis, axis]
            peak = int(np.abs(direct.imag).argmax())
            if direct[peak].imag > 0.0:
                raise ValueError(
                    f"frequency response: the imaginary part along {name} is positive at its peak, "
                    f"{self.frequency_Hz[peak]:g} Hz; change the sign of the imaginary part (or of "
                    "the displacement, where the hammer hits against the sensor)"
                )

    def at(self, frequency_Hz: Floats) -> Complexes:
        """Receptance at frequencies within the measured ones [m/N]; shape (..., 2, 2)."""
        place = np.interp(frequency_Hz, self.frequency_Hz, np.arange(len(self.frequency_Hz)))
        low = np.minimum(place.astype(np.int64), len(self.frequency_Hz) - 2)
        share = (place - low)[..., None, None]
        return self.receptance[low] * (1 - share) + self.receptance[low + 1] * share


def joined_responses(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Responses of several measurements as one, at the frequencies that all of them cover.

    ValueError when there is none, two of them hold the same direction, or they share no
    frequencies.
    """
    if not parts:
        raise ValueError("frequency response: there is none to join")
    measured = np.array([np.any(part.receptance != 0, axis=0) for part in parts])
    twice = np.argwhere(measured.sum(axis=0) > 1)
    if len(twice):
        row, column = twice[0]
        raise ValueError(
            f"frequency response: {DIRECTIONS[row]} over {DIRECTIONS[column]} is measured more "
            "than once; leave one out, or say another direction for one of them"
        )
    low = max(part.frequency_Hz[0] for part in parts)
    high = min(part.frequency_Hz[-1] for part in parts)
    frequency = np.unique(np.concatenate([part.frequency_Hz for part in parts]))
    frequency = frequency[(frequency >= low) & (frequency <= high)]
    if len(frequency) < 2:
        raise ValueError(
            f"frequency response: the measurements share no frequencies, one begins at {low:g} Hz "
            f"and one ends at {high:g} Hz"
        )
    total = np.sum([part.at(frequency) for part in parts], axis=0)
    return FrequencyResponse(frequency_Hz=frequency, receptance=total)


@dataclass(frozen=True, kw_only=True)
class TipModes:
    """The section ``dynamics`` of a machine."""

    source: str
    """Source of the modes."""
    measured: bool = False
    """Whether that is a modal test of this machine."""
    modes: tuple[Mode, ...] = ()
    """Modes at the tip of every tool that is not listed."""
    tools: dict[int, tuple[Mode, ...]] = field(default_factory=dict)
    """Modes by tool number."""


@dataclass(frozen=True, kw_only=True)
class TipDynamics:
    """Modes of each tool's tip by its number; ``every`` for those that are not listed.

    ``caution`` says what a measurement does not show of them; empty where nothing is missing.
    """

    source: str
    measured: bool = True
    every: Sequence[Mode] | None = None
    tools: Mapping[int, Sequence[Mode]] = field(default_factory=dict)
    caution: str = ""

    @classmethod
    def of_modes(cls, tip: TipModes) -> "TipDynamics":
        """Tip dynamics from modes as in a machine's file."""
        return cls(
            source=tip.source, measured=tip.measured, every=tip.modes or None,
            tools=dict(tip.tools),
        )  # fmt: skip

    def of(self, numbers: Sequence[int]) -> list[Sequence[Mode] | None]:
        """Dynamics of each of the tools with these numbers; None where there are none."""
        return [self.tools.get(number, self.every) for number in numbers]


def rigid_directions(tip: Sequence[Mode]) -> list[str]:
    """Directions of the machine in which a tip counts as rigid."""
    return [name for name in DIRECTIONS if all(mode.direction != name for mode in tip)]


PLACES: dict[str, tuple[int, int]] = {"x": (0, 0), "y": (1, 1), "xy": (0, 1), "yx": (1, 0)}
"""Direction of the displacement and of the force -> row and column of the receptance."""
UNITS: dict[str, tuple[float, int]] = {
    "m/N": (1.0, 0), "mm/N": (1e-3, 0), "um/N": (1e-6, 0),
    "m/s/N": (1.0, 1), "mm/s/N": (1e-3, 1),
    "m/s2/N": (1.0, 2), "mm/s2/N": (1e-3, 2), "g/N": (9.80665, 2),
}  # fmt: skip
"""Unit of a response -> factor to SI, and how often it is a displacement's derivative in time."""


def unit_of(text: str) -> tuple[float, int]:
    """Factor to SI of a unit, and how often it is a displacement's derivative in time."""
    plain = text.replace("µ", "u").replace("μ", "u").replace("²", "2")
    plain = re.sub(r"[\s^()*]", "", plain)
    if plain not in UNITS:
        raise ValueError(f"the response's unit is {text!r}: give one of {', '.join(UNITS)}")
    return UNITS[plain]


def one_direction(
    frequency: Floats, values: Complexes, derivative: int, direction: str, sign: int = 1
) -> FrequencyResponse:
    """Receptance along one direction; a mobility or an accelerance is integrated."""
    kept = frequency != 0.0  # the static deflection is no part of an accelerance
    frequency, values = frequency[kept], values[kept]
    receptance = np.zeros((len(frequency), 2, 2), dtype=np.complex128)
    place = (slice(None), *PLACES[direction])
    receptance[place] = sign * values / (2j * np.pi * frequency) ** derivative
    return FrequencyResponse(frequency_Hz=frequency, receptance=receptance)


_NAMES = {
    "frequency": ("frequency", "freq", "f"),
    "real": ("real", "re"),
    "imaginary": ("imaginary", "imag", "im"),
    "magnitude": ("magnitude", "mag", "amplitude"),
    "phase": ("phase",),
}
_ANGLES = {"": np.pi / 180, "deg": np.pi / 180, "°": np.pi / 180, "rad": 1.0}
_HEADER = re.compile(r"^\s*(?P<name>[^\[(]*?)\s*(?:[\[(](?P<unit>.*)[\])])?\s*$")


def read_csv(path: Path, direction: str) -> FrequencyResponse:
    """Receptance along one direction by a CSV file; OSError, ValueError when it cannot be read."""
    lines = [
        (number, line)
        for number, line in enumerate(_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ValueError("the file is empty, where a header and lines of numbers belong")
    separator = max(";\t,", key=lines[0][1].count)
    columns = _columns(lines[0][1].split(separator))
    table = np.array([_numbers(*line, separator, columns) for line in lines[1:]])
    if not len(table):
        raise ValueError("there is no line of numbers below the header")
    unit = {name: column[1] for name, column in columns.items()}
    if unit["frequency"].lower() not in ("", "hz"):
        raise ValueError(f"frequency is in {unit['frequency']!r}: give Hz")
    quantity = dict(zip(columns, table.T, strict=True))
    values, derivative = _values(quantity, unit)
    return one_direction(quantity["frequency"], values, derivative, direction)


def _text(path: Path) -> str:
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:  # every byte is a letter of this one: the micro sign of older files
        return raw.decode("latin-1")


def _values(quantity: dict[str, Floats], unit: dict[str, str]) -> tuple[Complexes, int]:
    """Response in SI, and how often it is a displacement's derivative."""
    if "magnitude" in quantity:
        if unit["phase"] not in _ANGLES:
            raise ValueError(f"phase is in {unit['phase']!r}: give deg or rad")
        factor, derivative = unit_of(unit["magnitude"])
        turned = np.exp(1j * _ANGLES[unit["phase"]] * quantity["phase"])
        return (factor * quantity["magnitude"] * turned).astype(np.complex128), derivative
    factor, derivative = unit_of(unit["real"])
    if unit_of(unit["imaginary"]) != (factor, derivative):
        raise ValueError(
            f"real is in {unit['real']}, imaginary in {unit['imaginary']}: give both in one unit"
        )
    values = np.asarray(quantity["real"] + 1j * quantity["imaginary"], dtype=np.complex128)
    return factor * values, derivative


def _columns(headers: list[str]) -> dict[str, tuple[int, str]]:
    """Quantity -> its column and unit."""
    columns: dict[str, tuple[int, str]] = {}
    for place, header in enumerate(headers):
        match = _HEADER.match(header.strip().strip('"'))
        for name, others in _NAMES.items():
            if match and match["name"].lower() in others:
                if name in columns:
                    raise ValueError(f"the header names {name} twice: keep one column of it")
                columns[name] = place, (match["unit"] or "").strip()
    pairs = ({"real", "imaginary"}, {"magnitude", "phase"})
    if "frequency" not in columns or sum(pair <= set(columns) for pair in pairs) != 1:
        raise ValueError(
            f"the header {', '.join(headers)[:120]!r} must name frequency and either real and "
            "imaginary, or magnitude and phase, with units in brackets"
        )
    kept = next(pair for pair in pairs if pair <= set(columns)) | {"frequency"}
    return {name: columns[name] for name in columns if name in kept}


def _numbers(
    number: int, line: str, separator: str, columns: dict[str, tuple[int, str]]
) -> list[float]:
    cells = line.split(separator)
    values = []
    for name, (place, _) in columns.items():
        cell = cells[place].strip().strip('"') if place < len(cells) else ""
        try:
            values.append(float(cell if separator == "," else cell.replace(",", ".")))
        except ValueError:
            raise ValueError(
                f"line {number}: {name} is {cell[:40]!r}, where a number belongs"
            ) from None
        if not np.isfinite(values[-1]):
            raise ValueError(f"line {number}: {name} is {cell[:40]!r}, which is not finite")
    return values


_DERIVATIVES = {8: 0, 11: 1, 12: 2}
"""Specific data type of data set 58: displacement, velocity, acceleration."""
_RESPONSE, _TRANSLATIONS = 4, {1: "x", 2: "y"}


def read_universal(path: Path, direction: str | None) -> FrequencyResponse:
    """All frequency responses of a universal file; OSError, ValueError when it cannot be read."""
    try:
        import pyuff
    except ImportError as error:
        raise ValueError("universal files need pyuff: pip install -e '.[uff]'") from error
    path.read_bytes()  # the system names what hinders reading, pyuff does not
    try:
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        sets = [file.read_sets(k) for k, kind in enumerate(types) if kind == 58]
        units = [file.read_sets(k) for k, kind in enumerate(types) if kind == 164]
    except Exception as error:  # pyuff raises Exception itself for whatever is wrong in a file
        raise ValueError(f"is no whole universal file: {str(error)[:200]}") from error
    responses = [item for item in sets if item.get("func_type") == _RESPONSE]
    if not responses:
        raise ValueError(
            f"holds {len(sets)} data sets 58, and none is a frequency response (function type 4)"
        )
    return joined_responses([_one(item, units, direction) for item in responses])


def _one(
    item: dict[str, Any], units: list[dict[str, Any]], direction: str | None
) -> FrequencyResponse:
    there, where = int(item.get("rsp_dir", 0)), int(item.get("ref_dir", 0))
    sign = 1
    if direction is None:
        if abs(there) not in _TRANSLATIONS or abs(where) not in _TRANSLATIONS:
            raise ValueError(
                f"data set 58 has response direction {there}, reference direction {where}: only "
                "1, 2 and -1, -2 (x and y) count; leave the others out, or say the direction"
            )
        sign = 1 if there * where > 0 else -1
        named = _TRANSLATIONS[abs(there)] + _TRANSLATIONS[abs(where)]
        name = named[0] if named[0] == named[1] else named
    else:
        name = direction
    values: NDArray[Any] = np.asarray(item["data"])
    frequency = np.asarray(item["x"], dtype=np.float64)
    announced = int(item.get("num_pts", len(values)))
    if not np.any(values[announced:]) and not np.any(frequency[announced:]):
        values, frequency = values[:announced], frequency[:announced]  # zeros fill the last line
    if len(values) != len(frequency) or len(values) != int(item.get("num_pts", len(values))):
        raise ValueError(
            f"data set 58 announces {item.get('num_pts')} values and has {len(values)}: it is cut"
        )
    factor, derivative = _unit(item, units)
    return one_direction(frequency, values.astype(np.complex128) * factor, derivative, name, sign)


def _unit(item: dict[str, Any], units: list[dict[str, Any]]) -> tuple[float, int]:
    """Factor to SI and derivative: a label counts, then data set 164, else SI."""
    kind = int(item.get("ordinate_spec_data_type", 0))
    if kind not in _DERIVATIVES:
        raise ValueError(
            f"data set 58 is of ordinate data type {kind}: only 8 (displacement), 11 (velocity) "
            "and 12 (acceleration) over a force count"
        )
    label = str(item.get("ordinate_axis_units_lab", "")).strip()
    if label and label.upper() != "NONE":
        factor, derivative = unit_of(label if label.endswith("/N") else f"{label}/N")
        if derivative != _DERIVATIVES[kind]:
            raise ValueError(
                f"data set 58 is of ordinate data type {kind}, and its unit is {label!r}: one of "
                "them is wrong"
            )
        return factor, derivative
    if units:
        length, force = float(units[0]["length"]), float(units[0]["force"])
        if not (length > 0.0 and force > 0.0):
            raise ValueError(f"data set 164 has factors {length:g}, {force:g}, not above 0")
        return force / length, _DERIVATIVES[kind]
    return 1.0, _DERIVATIVES[kind]


Direction = Literal["x", "y", "xy", "yx"]


def read_frf(path: Path, *, direction: Direction | None = None) -> FrequencyResponse:
    """Frequency response of the tool's tip from a file: CSV, text or universal (uff, unv, uf).

    ``direction`` is that of displacement and force in the machine's frame ("xy": displacement along
    x, force along y): needed for a CSV file, stated in a universal file. ValueError in one sentence
    when the file cannot be read. Several files are joined by :func:`joined_responses`.
    """
    if direction is not None and direction not in PLACES:
        raise ValueError(f"direction = {direction!r} is none: write x, y, xy or yx")
    ending = path.suffix.lower()
    try:
        if ending in (".csv", ".txt"):
            if direction is None:
                raise ValueError("a CSV file does not say its direction: say x, y, xy or yx")
            return read_csv(path, direction)
        if ending in (".uff", ".unv", ".uf"):
            return read_universal(path, direction)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    raise ValueError(
        f"{path}: its ending {ending!r} says no known form: give .csv, .txt, .uff, .unv or .uf"
    )
