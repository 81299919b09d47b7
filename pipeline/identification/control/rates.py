"""Rapid rates from the speeds that a log tells: on a long rapid the control settles at them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import AXES, Kind, Moves
from pipeline.identification.control.readings import STEADY, lines_at, plateau, steady
from pipeline.identification.control.segments import Observed

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Rate:
    """A rapid rate with its 95 % interval [mm/min]."""

    value: float
    low: float
    high: float


def rapid_rates(observed: Sequence[Observed]) -> dict[str, Rate]:
    """Rapid rate of each axis that rapids of one machine show, by its letter.

    A rapid of several axes is as fast as the axis with the longest way allows, so that a steady
    reading tells the rate of that axis: speed along the path x its share of the path / override.
    """
    if not observed:
        return {}
    axes, speeds = zip(*(_readings(one) for one in observed), strict=True)
    axis, speed = np.concatenate(axes), np.concatenate(speeds)
    found = {AXES[i]: _rate(speed[axis == i]) for i in np.unique(axis)}
    return {letter: rate for letter, rate in found.items() if rate is not None}


def _readings(one: Observed) -> tuple[Ints, Floats]:
    """Leading axis and its speed at an override of 100 % [mm/min] at each steady reading."""
    moves, run = one.moves, one.run
    rapid_of = _rapid_of_lines(moves)
    feed = run.feed.polled()
    row = rapid_of[lines_at(run, feed.time, len(rapid_of))]
    override = run.rapid_override.at(feed.time, before=100.0) / 100
    scaled = np.divide(
        feed.value, override, out=np.full_like(feed.value, np.nan), where=override > 0
    )
    same = np.concatenate([[-1], row])[:-1] == row
    kept = (row >= 0) & same & steady(scaled)
    step = np.abs(moves.end - moves.start)[row[kept], :3]
    share = step / moves.length[row[kept], None]
    return share.argmax(axis=1), scaled[kept] * share.max(axis=1) * 60


def _rapid_of_lines(moves: Moves) -> Ints:
    """The row of the only rapid of each line, -1 where there is none or are several."""
    rapid = np.flatnonzero((moves.kind == Kind.RAPID) & (moves.length > 0))
    row_of = np.full(int(moves.line.max(initial=0)) + 1, -1)
    row_of[moves.line[rapid]] = rapid
    row_of[np.bincount(moves.line[rapid], minlength=len(row_of)) > 1] = -1
    return row_of


def _rate(speed: Floats) -> Rate | None:
    """The level that the readings share: short rapids stay below it."""
    top = float(np.max(speed))
    level = plateau(speed / top, 2 * STEADY) if top > 0 else None
    if level is None:
        return None
    value = level * top
    near = speed[np.abs(speed / value - 1) < 2 * STEADY]
    half = max(2 * float(np.std(near)), STEADY * value / 2)
    return Rate(value=value, low=value - half, high=value + half)
