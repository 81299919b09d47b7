"""Ranges of F and S of each row: of the part's limits, the machine, the tools, the program."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.gcode.moves import METRE_PER_SECOND, FeedMode
from pipeline.machine.control.parameters import LINEAR
from pipeline.machine.control.path import Motion, where
from pipeline.machine.spindle import CUTTING
from pipeline.optimisation.settings import CutLimit
from pipeline.optimisation.text.editable import Editable
from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST_FEED = 0.1
"""Of the least F of a program, where no range is given, or one from 0 on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranges:
    """Ranges of M rows; every array has shape (M,).

    Rows that keep their F have the range of all there is, and so have those that cut nothing their
    range of S: a stretch of one S is bounded by its rows that cut.

    Parameters
    ----------
    feed_low, feed_high : ndarray
        F [mm/min].
    speed_low, speed_high : ndarray
        S [rev/min].
    surface_low, surface_high : ndarray
        S that the cutting speed allows; 0 and infinite where it does not limit [rev/min].
    counted : ndarray of bool
        Rows that must keep within the range of S: those that cut, or whose cut is not known.
    """

    feed_low: Floats = field(repr=False)
    feed_high: Floats = field(repr=False)
    speed_low: Floats = field(repr=False)
    speed_high: Floats = field(repr=False)
    surface_low: Floats = field(repr=False)
    surface_high: Floats = field(repr=False)
    counted: Flags = field(repr=False)


def ranges_of(
    cut: Cut, cuts: Flags, limits: CutLimit, editable: Editable, drive: SpindleDrive | None
) -> Ranges:
    """Ranges of each row.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    cuts : ndarray of bool, shape (M,)
        Rows that cut at feed.
    limits : CutLimit
        Of the part.
    editable : Editable
        What may be changed.
    drive : SpindleDrive or None
        Of the machine.

    Raises
    ------
    ValueError
        When a range is empty.
    """
    unknown = not_computed(cut)
    feed_low, feed_high = _feeds(cut, limits, editable, unknown)
    surface_low, surface_high = _surface(cut, limits)
    highest = _top_speed(cut, drive)
    low, high = _speeds(cut, cuts, limits, drive, highest)
    free = editable.speed & ~unknown
    speed_low = np.where(free, np.maximum(low, surface_low), surface_low)
    speed_high = np.minimum(np.where(free, min(high, highest), highest), surface_high)
    own = cut.plan.spindle_speed
    ranges = Ranges(
        feed_low=feed_low,
        feed_high=feed_high,
        speed_low=np.where(unknown, own, speed_low),
        speed_high=np.where(unknown, own, speed_high),
        surface_low=surface_low,
        surface_high=surface_high,
        counted=cuts | unknown,
    )
    _check(cut, cuts, ranges)
    return ranges


def not_computed(cut: Cut) -> Flags:
    """Rows that move at feed and whose engagement was left out: threads, turned axes; (M,)."""
    moves = cut.plan.path.moves
    fed: Flags = np.isin(moves.kind, CUTTING) & (moves.length > 0)
    fed[cut.path.pieces.block] = False
    return fed


def feeds_per_minute(cut: Cut, feeds: Floats, turns: Floats) -> Floats:
    """F in [mm/min] of feeds in the units of ``Moves``; shape of ``feeds``."""
    by_turn = np.where(cut.plan.path.motion == Motion.PER_TURN, turns, 1.0)
    found: Floats = feeds * by_turn * feed_units(cut)
    return found


def feed_units(cut: Cut) -> Floats:
    """[mm/min] in one unit of F, of a turn in one of 1 rev/min; shape (M,)."""
    path = cut.plan.path
    inverse = path.moves.feed_mode == FeedMode.INVERSE_TIME
    units: Floats = np.where(inverse, path.factor / METRE_PER_SECOND, 1.0)
    return units


def _feeds(
    cut: Cut, limits: CutLimit, editable: Editable, unknown: Flags
) -> tuple[Floats, Floats]:  # fmt: skip
    moves, free = cut.plan.path.moves, editable.block >= 0
    own = feeds_per_minute(cut, moves.feed, cut.plan.spindle_speed)
    low = LEAST_FEED * float(own[free].min(initial=np.inf)) if free.any() else 0.0
    if limits.feed_mm_min is not None:
        least, high = limits.feed_mm_min
        low = least or min(low, high)  # a feed of 0 is none
    else:
        axes = cut.plan.path.control.axes
        fastest = max(axis.cutting_speed for letter, axis in axes.items() if letter in LINEAR)
        high = max(fastest, float(own[free].max(initial=0.0)))
    return (
        np.where(free, np.where(unknown, own, low), 0.0),
        np.where(free, np.where(unknown, own, high), np.inf),
    )


def _surface(cut: Cut, limits: CutLimit) -> tuple[Floats, Floats]:
    """S that limits and makers of tools allow by the cutting speed [rev/min]."""
    margin = limits.margins.cutting_speed
    low, high = np.zeros(len(cut.tools) + 1), np.full(len(cut.tools) + 1, np.inf)
    for index, tool in enumerate(cut.tools):
        for span in (limits.cutting_speed_m_min, tool.cutting_speed_m_min):
            if span is not None:
                turns = np.array(span) / (np.pi * tool.diameter)
                low[index] = max(low[index], turns[0] * (1 + margin))
                high[index] = min(high[index], turns[1] * (1 - margin))
        high[index] = min(high[index], tool.top_speed_rpm or np.inf)
    return low[cut.tool], high[cut.tool]


def _top_speed(cut: Cut, drive: SpindleDrive | None) -> float:
    most = cut.plan.path.control.auxiliary.maximum_speed
    return float(most if drive is None else min(most, drive.top_speed_rpm))


def _speeds(
    cut: Cut, cuts: Flags, limits: CutLimit, drive: SpindleDrive | None, highest: float
) -> tuple[float, float]:
    if limits.speed_rpm is not None:
        low, high = limits.speed_rpm
        if low > highest:
            raise ValueError(
                f"limits.speed_rpm = [{low:g}, {high:g}] begins above the spindle's top speed "
                f"{highest:g} rev/min: lower it"
            )
        return low, high
    own = cut.plan.spindle_speed[cuts]
    least, most = float(own.min(initial=np.inf)), float(own.max(initial=0.0))
    if drive is None:
        return least, most
    return min(least, drive.minimum_speed_rpm), drive.top_speed_rpm


def _check(cut: Cut, cuts: Flags, ranges: Ranges) -> None:
    empty = cuts & (ranges.speed_low > ranges.speed_high)
    if empty.any():
        row = int(np.argmax(empty))
        tool = cut.tools[cut.tool[row]]
        raise ValueError(
            f"{where(cut.plan.path.moves, row)}: no speed of the spindle keeps the limits of "
            f"T{cut.numbers[cut.tool[row]]}, {tool.diameter_mm:g} mm: it needs at least "
            f"{ranges.speed_low[row]:.6g} and at most {ranges.speed_high[row]:.6g} rev/min: widen "
            "cutting_speed_m_min or speed_rpm"
        )
