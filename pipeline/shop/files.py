"""Text files as controls and recorders write them: newlines, rows of numbers, a torn last row."""

from pathlib import Path

from pipeline.schema import store
from pipeline.schema.arrays import Floats

BLOCK = 5000
"""Rows that are formatted at once."""
LEFT = 0.6
"""Share of a torn row that is left [1]."""


def write_text(path: Path, text: str, encoding: str = "ascii") -> None:
    """Write a file with newlines alone at the ends of lines; its folder is made."""
    store.write_text(text, path, encoding)


def rows_text(table: Floats, form: str) -> str:
    """Rows of ``table`` (T, C) in the format ``form`` of a row; no negative zeros."""
    table = table + 0.0
    blocks = (table[k : k + BLOCK] for k in range(0, len(table), BLOCK))
    return "".join(form * len(block) % tuple(block.ravel().tolist()) for block in blocks)


def torn(text: str) -> str:
    """``text`` that breaks off inside its last row."""
    last = text.rstrip("\n").rfind("\n") + 1
    return text[: last + int(LEFT * (len(text) - last))]
