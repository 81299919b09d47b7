"""Rows of a program beside those of the same program with other S words."""

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Kind, Moves

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]


def only_speed(moves: Moves) -> Flags:
    """Rows that are an S word of a turning spindle and nothing else (M,)."""
    turned = np.diff(moves.direction, prepend=np.int8(0)) != 0
    return (moves.kind == Kind.SPINDLE) & (moves.code == 0) & ~turned


def matching_rows(before: Moves, after: Moves) -> Rows:
    """Row of ``after`` for each row of ``before``.

    Parameters
    ----------
    before, after : Moves
        The same moves, but that ``after`` may have more rows where an S word was added.

    Returns
    -------
    ndarray of intp, shape (M,)
        Ascending.

    Raises
    ------
    ValueError
        When they are not the same moves.
    """
    spare_before, spare_after = only_speed(before), only_speed(after)
    rows, others = np.flatnonzero(~spare_before), np.flatnonzero(~spare_after)
    if len(rows) != len(others) or not _alike(before, after, rows, others):
        raise ValueError(
            f"{before.files[0]} has {len(rows)} moves and {after.files[0]} {len(others)} others: "
            "rows match only where nothing but F and S words differ"
        )
    found = np.empty(len(before), dtype=np.intp)
    found[rows] = others
    for row in np.flatnonzero(spare_before).tolist():
        # the S word of the same line: it stands right before what the line does
        start = found[row - 1] + 1 if row else 0
        if not (
            start < len(after) and spare_after[start] and _same_line(before, after, row, start)
        ):
            raise ValueError(
                f"{before.files[before.file[row]]}:{before.line[row]} has an S word that "
                f"{after.files[0]} has not: rows match only where no S word was taken away"
            )
        found[row] = start
    return found


def _same_line(before: Moves, after: Moves, row: int, other: int) -> bool:
    return bool(before.line[row] == after.line[other] and before.file[row] == after.file[other])


def _alike(before: Moves, after: Moves, rows: Rows, others: Rows) -> bool:
    names = ("kind", "line", "file", "end", "direction", "tool", "code", "value")
    return all(
        np.array_equal(getattr(before, name)[rows], getattr(after, name)[others]) for name in names
    )
