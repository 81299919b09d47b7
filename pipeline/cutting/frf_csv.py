"""Frequency responses from CSV files.

A CSV file has a header line, then one line for each frequency, columns separated by comma,
semicolon or tab.  The header names the columns in any order, units in brackets:

- ``frequency [Hz]``;
- ``real [um/N], imaginary [um/N]``, or ``magnitude [um/N], phase [deg]`` (or ``[rad]``).

Units of the response are m/N, mm/N, um/N, of a mobility m/s/N, mm/s/N, of an accelerance m/s^2/N,
mm/s^2/N, g/N.  Other columns are not read, nor lines that begin with ``#``, nor a line at 0 Hz.
"""

import re
from pathlib import Path

import numpy as np

from pipeline.cutting.frf import Complex, Floats, FrequencyResponse
from pipeline.cutting.frf_unit import one_direction, unit_of

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
    """One direction of the receptance from a CSV file.

    Raises
    ------
    OSError, ValueError
        When the file cannot be read.
    """
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


def _values(quantity: dict[str, Floats], unit: dict[str, str]) -> tuple[Complex, int]:
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
    found: dict[str, tuple[int, str]] = {}
    for place, header in enumerate(headers):
        match = _HEADER.match(header.strip().strip('"'))
        for name, others in _NAMES.items():
            if match and match["name"].lower() in others:
                if name in found:
                    raise ValueError(f"the header names {name} twice: keep one column of it")
                found[name] = place, (match["unit"] or "").strip()
    pairs = ({"real", "imaginary"}, {"magnitude", "phase"})
    if "frequency" not in found or sum(pair <= set(found) for pair in pairs) != 1:
        raise ValueError(
            f"the header {', '.join(headers)[:120]!r} must name frequency and either real and "
            "imaginary, or magnitude and phase, with units in brackets"
        )
    kept = next(pair for pair in pairs if pair <= set(found)) | {"frequency"}
    return {name: found[name] for name in found if name in kept}


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
