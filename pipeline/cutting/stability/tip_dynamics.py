"""Dynamics of tool tips: modes, or a measured frequency response.

A mode moves the tip in one direction of the machine's frame, and adds to the receptance there
1 / (k - m w^2 + i c w) = 1 / (k (1 - r^2 + 2 i zeta r)), r = w / w_n (Altintas 2012, eq. 3.20);
time goes as e^(i w t), so that the imaginary part is negative.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from typing import Annotated, Literal

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
        between: Complexes = self.receptance[low] * (1 - share) + self.receptance[low + 1] * share
        return between


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
