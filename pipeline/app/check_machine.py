"""Two programs by hand: F and S that changed by very much."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.app.check import NEAR, moves_of, place
from pipeline.app.programs import machine_setup, setup_beside
from pipeline.gcode.moves import Moves
from pipeline.optimisation.text.feed_words import FeedWords
from pipeline.optimisation.text.modal_words import at_speed, cuts_at_feed
from pipeline.schema.arrays import Bools, Rows
from pipeline.schema.limits import MachiningPractice


def machine_lines(
    before: Path, after: Path, machine: str | None, dialect: str | None
) -> Iterator[str]:
    """Warnings of F and S of AFTER that are far from those of BEFORE: one for each pair of values.

    Far is a factor of change beyond the default of ``kerf optimise``; what the machine cannot do
    is said by :mod:`pipeline.twin.preflight`.

    Raises
    ------
    ValueError
        When there is no such machine, or a program cannot be followed.
    """
    setup = setup_beside(machine_setup(machine, dialect), before)
    (_, old), (program, new) = (moves_of(path, setup) for path in (before, after))
    fed = cuts_at_feed(new)
    turns = at_speed(new) & ~new.constant_surface_speed & (new.length > 0)
    if len(old) == len(new):  # with points put in, rows are not each other’s
        yield from _far(old, new, (fed, turns), FeedWords(program, new))


def _far(old: Moves, new: Moves, rows: tuple[Bools, Bools], words: FeedWords) -> Iterator[str]:
    """F and S that changed by more than the default change."""
    low, high = MachiningPractice().change
    then, now = words.written(old.feed), words.written(new.feed)
    for letter, own, value, mine in (
        ("F", then, now, rows[0]), ("S", old.speed, new.speed, rows[1]),
    ):  # fmt: skip
        ratio = np.divide(value, own, out=np.ones(len(own)), where=mine & (own > 0))
        far = (ratio > high * (1 + NEAR)) | (ratio < low * (1 - NEAR))
        for found in _alike(np.flatnonzero(far), own, value):
            first = found[0]
            yield (
                f"warning: {_where(new, found)}: {letter}{own[first]:g} became "
                f"{letter}{value[first]:g}, ×{ratio[first]:.3g}, outside of ×{low:g} to "
                f"×{high:g}: look whether it is meant"
            )


def _alike(rows: Rows, *values: np.ndarray) -> Iterator[Rows]:
    """Rows of equal values, in the order of the first of each."""
    found: dict[tuple[float, ...], list[int]] = {}
    for row in rows.tolist():
        found.setdefault(tuple(float(one[row]) for one in values), []).append(row)
    for alike in found.values():
        yield np.array(alike, dtype=np.intp)


def _where(moves: Moves, rows: Rows) -> str:
    """Line and tool of the first row, and how many other lines."""
    more = len(set(moves.line[rows].tolist())) - 1
    others = f" and {more} more line{'s' * (more > 1)}" if more else ""
    return f"{place(moves, int(rows[0]))}{others}"
