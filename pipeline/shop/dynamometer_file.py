"""The files of the dynamometer's software: a head of twenty lines, names, units, rows."""

from pathlib import Path

import numpy as np

from pipeline.shop.dynamometer_parameters import RATE
from pipeline.shop.s_curve import Floats

FOLDER = "C:\\Measurements\\"
BLOCK = 5000
"""Rows that are written at once."""
LEFT = 0.6
"""Share that is left of a torn row."""


def write_recording(
    path: Path, start: float, forces: Floats, measured: float, decimal: str, torn: bool
) -> None:
    """Write Fx, Fy, Fz.

    Parameters
    ----------
    path : Path
        Of the file.
    start : float
        Time of the first row since the measurement began [s].
    forces : (T, 3) array
        [N].
    measured : float
        How long the whole measurement is, of which the rows are a part [s].
    decimal : {".", ","}
        With a comma the separator is a semicolon.
    torn : bool
        Whether the last row breaks off.
    """
    separator = ";" if decimal == "," else ","
    time = start + np.arange(len(forces)) / RATE
    form = separator.join(["%.7g", "%.6g", "%.6g", "%.6g"]) + "\n"
    table = np.column_stack([np.round(time, 4), forces]) + 0.0
    blocks = (table[k : k + BLOCK] for k in range(0, len(table), BLOCK))
    body = "".join(form * len(block) % tuple(block.ravel().tolist()) for block in blocks)
    if torn:
        last = body.rstrip("\n").rfind("\n") + 1
        body = body[: last + int(LEFT * (len(body) - last))]
    if decimal == ",":
        body = body.replace(".", ",")
    lines = [separator.join(line) for line in _head(path.stem, measured)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n" + body, encoding="ascii", newline="\n")


def _head(name: str, measured: float) -> list[tuple[str, ...]]:
    return [
        ("DynoWare", "Version 2.6.5 (simulated)"),
        ("Path:", FOLDER),
        ("Filename:", f"{name}.dwd"),
        ("Config ID:", f"{name}.cfg"),
        ("Setup ID:", "0"),
        ("Manipulated:", "0"),
        ("Filename 1:", " "),
        ("Filename 2:", " "),
        ("Date:", " "),
        ("Time:", " "),
        ("Sampling rate [Hz]:", str(RATE)),
        ("Measuring time [s]:", f"{measured:g}"),
        ("Delay time [s]:", "0"),
        ("Cycle time [s]:", "0"),
        ("Cycles:", "1"),
        ("Samples per channel:", str(round(measured * RATE) + 1)),
        ("Cycle interval:", "0"),
        ("Cycle No:", "1"),
        ("Time", "Fx", "Fy", "Fz"),
        ("s", "N", "N", "N"),
    ]
