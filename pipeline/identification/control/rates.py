"""Rapid rates from the speeds that a log tells: on a long rapid the control settles at them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import AXES, Kind
from pipeline.identification.control.overrides import plateau
from pipeline.identification.control.segments import Observed

Floats = NDArray[np.float64]

STEADY = 0.005
"""Two readings, one after the other, that differ by less than this share are steady."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """A rapid rate with its 95 % interval [mm/min], and how many readings it rests on."""

    value: float
    low: float
    high: float
    readings: int


def rapid_rates(observed: Sequence[Observed]) -> dict[str, Rate]:
    """Rapid rate of each axis that rapids of one machine show, by its letter.

    A rapid of several axes is as fast as the axis with the longest way allows, so that a steady
    reading tells the rate of that axis: speed along the path x its share of the path / override.
    """
    readings = [_readings(one) for one in observed]
    axis = np.concatenate([a for a, _ in readings]) if readings else np.empty(0, int)
    speed = np.concatenate([s for _, s in readings]) if readings else np.empty(0)
    found = {}
    for index in np.unique(axis):
        rate = _rate(speed[axis == index])
        if rate is not None:
            found[AXES[index]] = rate
    return found


def _readings(one: Observed) -> tuple[NDArray[np.int64], Floats]:
    """Leading axis and its speed at an override of 100 % [mm/min] at each steady reading."""
    moves, run = one.moves, one.run
    step = moves.end - moves.start
    rapid = np.flatnonzero((moves.kind == Kind.RAPID) & (moves.length > 0))
    row_of = np.full(int(moves.line.max(initial=0)) + 1, -1)
    several = np.bincount(moves.line[rapid], minlength=len(row_of)) > 1
    row_of[moves.line[rapid]] = rapid
    row_of[several] = -1
    feed = run.feed.polled()
    line = run.line.at(feed.time, before=0.0).astype(np.int64)
    row = row_of[np.where(line < len(row_of), line, 0)]
    override = run.rapid_override.at(feed.time, before=100.0) / 100
    scaled = np.where(override > 0, feed.value / np.where(override > 0, override, 1), np.nan)
    before = np.concatenate([[np.nan], scaled])[:-1]
    same = np.concatenate([[-1], row])[:-1] == row
    steady = (row >= 0) & same & (np.abs(scaled - before) < STEADY * before)
    share = np.abs(step[row[steady]]) / moves.length[row[steady], None]
    return share[:, :3].argmax(axis=1), scaled[steady] * share[:, :3].max(axis=1) * 60


def _rate(speed: Floats) -> Rate | None:
    """The level that the readings share: short rapids stay below it."""
    if not len(speed):
        return None
    top = float(np.max(speed))
    level = plateau(speed / top, 2 * STEADY)
    if level is None:
        return None
    value = level * top
    near = speed[np.abs(speed / value - 1) < 2 * STEADY]
    half = max(2 * float(np.std(near)), STEADY * value / 2)
    return Rate(value=value, low=value - half, high=value + half, readings=len(near))
