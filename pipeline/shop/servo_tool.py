"""The files of a servo tuning tool: a head, names, units, rows, and what goes wrong with them.

Two makers' ways: ``plain`` (point, comma, seconds, ``X_PosAct``) and ``bracketed`` (milliseconds,
``APOS(X)``, decimal comma when the tool is set so).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.shop.s_curve import Floats
from pipeline.shop.servo_parameters import ServoTool

NAMES = {
    "plain": {"reference": "{}_PosSet", "position": "{}_PosAct", "current": "{}_Iq",
              "load": "{}_Force"},
    "bracketed": {"reference": "CPOS({})", "position": "APOS({})", "current": "TCMD({})",
                  "load": "FEXT({})"},
}  # fmt: skip
"""Column of an axis for each quantity."""
UNITS = {"reference": "mm", "position": "mm", "current": "A", "load": "N"}
DECIMALS = {"reference": 4, "position": 4, "current": 3, "load": 0}
TITLES = {"plain": "Drive trace DT-4 (simulated)", "bracketed": "SERVO TUNING GUIDE (simulated)"}
BLOCK = 5000
"""Rows that are written at once."""
WIDEST = 3
"""Rows of the longest gap."""
SLOT = 50
"""Rows from one place where something may go wrong to the next."""
LEFT = 0.6
"""Share that is left of a torn row."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: its name, unit, decimals and values (T,) as they are written."""

    name: str
    unit: str
    decimals: int
    values: Floats


def column(quantity: str, letter: str, values: Floats, tool: ServoTool) -> Column:
    """Column of an axis; values in mm, A or N."""
    return Column(
        name=NAMES[tool.style][quantity].format(letter), unit=UNITS[quantity],
        decimals=DECIMALS[quantity], values=values,
    )  # fmt: skip


def write_trace(
    path: Path, head: Mapping[str, str], columns: list[Column], rate: int, tool: ServoTool,
    random: np.random.Generator | None,
) -> dict[str, Any]:  # fmt: skip
    """Write one file of T rows at ``rate`` [Hz] of true time; with dirt when ``random`` is given.

    Returns
    -------
    dict
        What was done to it: rows written, gaps (before which row of the full table, rows lost),
        rows with the stamp of the one before, whether the last row is torn.
    """
    size = columns[0].values.size
    stamps = np.arange(size) / rate * (1 + tool.clock_error * 1e-6)
    kept: np.ndarray = np.arange(size)
    done: dict[str, Any] = {"gaps": [], "repeated": [], "torn": False}
    if random is not None:
        kept, done = _dirt(stamps, random, tool)
        done["torn"] = path.stem == tool.torn
    seconds = tool.style == "plain"
    time = Column(
        name="Time", unit="s" if seconds else "ms", decimals=6 if seconds else 3,
        values=stamps if seconds else stamps * 1e3,
    )  # fmt: skip
    text = _text(path.stem, head, [time, *columns], kept, tool)
    if done["torn"]:
        last = text.rstrip("\n").rfind("\n") + 1
        text = text[: last + int(LEFT * (len(text) - last))]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="ascii", newline="\n")
    return {"rows": int(kept.size), "seconds": size / rate, **done}


def _dirt(
    stamps: Floats, random: np.random.Generator, tool: ServoTool
) -> tuple[np.ndarray, dict[str, Any]]:
    """Rows that are kept, and what was done; one stamp is repeated in place."""
    keep = np.ones(stamps.size, bool)
    gaps = []
    slots = random.choice(np.arange(1, stamps.size // SLOT), tool.dropped, replace=False)
    for first in (np.sort(slots) * SLOT).tolist():
        lost = int(random.integers(1, WIDEST + 1))
        keep[first : first + lost] = False
        gaps.append({"row": first, "lost": lost})
    repeated = SLOT * int(random.integers(1, stamps.size // SLOT)) + SLOT // 2
    stamps[repeated] = stamps[repeated - 1]
    return np.flatnonzero(keep), {"gaps": gaps, "repeated": [repeated], "torn": False}


def _text(
    name: str, head: Mapping[str, str], columns: list[Column], rows: np.ndarray, tool: ServoTool
) -> str:
    comma = tool.decimal == ","
    separator = ";" if comma else ","
    first = [
        TITLES[tool.style],
        *(f"{k}{separator}{v}" for k, v in {"Trace": name, **head}.items()),
    ]
    if tool.style == "bracketed":
        first = [f"# {line}" for line in first]
    lines = [
        *first,
        separator.join(c.name for c in columns),
        separator.join(c.unit for c in columns),
    ]
    form = separator.join(f"%.{c.decimals}f" for c in columns) + "\n"
    table = np.stack([c.values[rows] for c in columns], axis=1) + 0.0
    blocks = (table[k : k + BLOCK] for k in range(0, len(table), BLOCK))
    body = "".join(form * len(block) % tuple(block.ravel().tolist()) for block in blocks)
    return "\n".join(lines) + "\n" + (body.replace(".", ",") if comma else body)
