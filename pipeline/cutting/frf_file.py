"""Measured frequency responses from files: CSV, and universal files."""

from pathlib import Path
from typing import Literal

from pipeline.cutting.frf import FrequencyResponse
from pipeline.cutting.frf_csv import read_csv
from pipeline.cutting.frf_unit import PLACES
from pipeline.cutting.frf_universal import read_universal

Direction = Literal["x", "y", "xy", "yx"]


def read_frf(path: Path, *, direction: Direction | None = None) -> FrequencyResponse:
    """Frequency response of the tool's tip from a file.

    Parameters
    ----------
    path : Path
        ``.csv`` or ``.txt``; ``.uff``, ``.unv`` or ``.uf``.
    direction : {"x", "y", "xy", "yx"}, optional
        Of displacement and force in the machine's frame ("xy": displacement along x, force along
        y); a CSV file needs it, a universal file says it itself.

    Raises
    ------
    ValueError
        When the file cannot be read, in one sentence.

    See Also
    --------
    pipeline.cutting.frf.joined : Several files as one response.
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


def write_frf(path: Path, response: FrequencyResponse, *, direction: Direction) -> None:
    """Write one direction of a response as CSV, real and imaginary part [m/N].

    Raises
    ------
    ValueError
        When there is no such direction, or the file cannot be written, in one sentence.
    """
    if direction not in PLACES:
        raise ValueError(f"direction = {direction!r} is none: write x, y, xy or yx")
    values = response.receptance[(slice(None), *PLACES[direction])]
    rows = zip(response.frequency_Hz, values.real, values.imag, strict=True)
    lines = ["frequency [Hz],real [m/N],imaginary [m/N]"]
    lines += [",".join(repr(float(number)) for number in row) for row in rows]
    try:
        path.write_text("\n".join(lines) + "\n")
    except OSError as error:
        raise ValueError(f"{path}: cannot be written: {error.strerror or error}") from error
