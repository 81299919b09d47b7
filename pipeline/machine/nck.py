"""The motion planner of the virtual control: how long each row of a program takes, and how fast.

A program and a control make a :class:`pipeline.machine.path.Path` once; :func:`plan` then gives the
times for any feeds, spindle speeds and overrides, :func:`totals` those of a population.

    path = limited_path(moves, control)
    plan(path).total
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.machine.auxiliary import auxiliary_time
from pipeline.machine.control import Floats
from pipeline.machine.feeds import commanded_feeds, spindle_turns
from pipeline.machine.motion import Motion
from pipeline.machine.path import Path, limited_path
from pipeline.machine.row_motion import RowMotion, motion_times, motion_totals, row_motion
from pipeline.machine.spindle import spindle_waits

__all__ = ["Path", "Plan", "limited_path", "plan", "row_times", "totals", "waits"]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Times and speeds of the M rows of a program.

    Parameters
    ----------
    path : Path
        What was planned.
    feed : (M,) array
        F with the override, in the units of ``Moves``; in rapids the override [1].
    turns : (M,) array
        Speed of the spindle [rev/min].
    motion : RowMotion
        Speeds and times of what moves.
    wait : (M,) array
        Standstill after it: filters, check of position, dwell, tool, spindle, M code [s].
    """

    path: Path
    feed: Floats = field(repr=False)
    turns: Floats = field(repr=False)
    motion: RowMotion = field(repr=False)
    wait: Floats = field(repr=False)

    @cached_property
    def time(self) -> Floats:
        """Time of each row [s]; shape (M,)."""
        return self.motion.time + self.wait

    @property
    def total(self) -> float:
        """Time of the program [s]."""
        return float(self.time.sum())

    @property
    def v_out(self) -> Floats:
        """Speed along the path at the end of each row [m/s]; shape (M,)."""
        return self.motion.v_out

    @property
    def v_peak(self) -> Floats:
        """Greatest speed along the path in each row [m/s]; shape (M,)."""
        return self.motion.v_peak

    @property
    def v_in(self) -> Floats:
        """Speed along the path at the start of each row [m/s]; shape (M,)."""
        return np.concatenate([[0.0], self.v_out[:-1]])[: len(self.v_out)]

    @cached_property
    def limit(self) -> npt.NDArray[np.uint8]:
        """What keeps each row from being faster, :class:`pipeline.machine.motion.Binding`."""
        from pipeline.machine.look_ahead import binding

        path = self.path
        out = np.zeros(len(path), np.uint8)
        binding(
            path.motion, path.factor, path.cap, path.reason, path.corner, path.end_reason,
            self.feed[np.newaxis], self.turns[np.newaxis], self.v_out, self.v_peak, out,
        )  # fmt: skip
        return out


def plan(
    path: Path,
    *,
    feeds: ArrayLike | None = None,
    speeds: ArrayLike | None = None,
    feed_override: ArrayLike = 100.0,
    rapid_override: ArrayLike = 100.0,
) -> Plan:
    """Times and speeds of a program.

    Parameters
    ----------
    path : Path
        From :func:`limited_path`.
    feeds, speeds : (M,) array, optional
        F and S in force in each row, in the units of ``Moves``; the program's own by default.
    feed_override, rapid_override : float or (M,) array
        [percent]; threads take no override.

    Raises
    ------
    ValueError
        When a row that cuts has no positive F (or the spindle stands under G95), a speed is
        negative, or an override is not positive.
    """
    feed, turns = _commands(path, feeds, speeds, feed_override, rapid_override)
    if len(feed) != 1:
        raise ValueError(
            f"plan takes the feeds and speeds of one individual, got {len(feed)}: "
            "row_times and totals take many"
        )
    motion = row_motion(path, feed, turns)
    wait = path.pause.copy()
    _add_waits(path, turns, motion.time[np.newaxis], wait[np.newaxis])
    return Plan(path=path, feed=feed[0], turns=turns[0], motion=motion, wait=wait)


def row_times(
    path: Path,
    *,
    feeds: ArrayLike | None = None,
    speeds: ArrayLike | None = None,
    feed_override: ArrayLike = 100.0,
    rapid_override: ArrayLike = 100.0,
) -> Floats:
    """Time of each row for a population of feeds and speeds [s]; shape (P, M).

    Parameters
    ----------
    path : Path
        From :func:`limited_path`.
    feeds, speeds : (M,) or (P, M) array, optional
        As :func:`plan` takes them; what has one row is the same for all.
    feed_override, rapid_override : float or (M,) array
        [percent].

    Raises
    ------
    ValueError
        As :func:`plan`; also when feeds and speeds are of different many.
    """
    feed, turns = _commands(path, feeds, speeds, feed_override, rapid_override)
    time = motion_times(path, feed, turns)
    time += waits(path, turns, time)
    return time


def waits(path: Path, turns: Floats, motion_time: Floats) -> Floats:
    """Standstill after each row for a population [s]; shape (P, M).

    Parameters
    ----------
    path : Path
        From :func:`limited_path`.
    turns : (1 or P, M) array
        Speed of the spindle, at least 0 [rev/min].
    motion_time : (P, M) array
        How long each row moves [s].
    """
    wait = np.zeros(motion_time.shape)
    wait += path.pause
    _add_waits(path, turns, motion_time, wait)
    return wait


def totals(
    path: Path,
    *,
    feeds: ArrayLike | None = None,
    speeds: ArrayLike | None = None,
    feed_override: ArrayLike = 100.0,
    rapid_override: ArrayLike = 100.0,
) -> Floats:
    """Time of the program for a population of feeds and speeds [s]; shape (P,).

    Faster than the sum of :func:`row_times`, which takes the same and raises the same.
    """
    feed, turns = _commands(path, feeds, speeds, feed_override, rapid_override)
    rows, waiting, run_up = spindle_waits(path.moves, path.control.auxiliary, turns)
    if path.control.profile == "s_curve" or (rows != waiting).any():
        return row_times(
            path, feeds=feeds, speeds=speeds, feed_override=feed_override,
            rapid_override=rapid_override,
        ).sum(axis=1)  # fmt: skip
    _, other = auxiliary_time(path.moves, path.control.auxiliary, turns)
    waits: Floats = path.pause.sum() + other.sum(axis=1) + run_up.sum(axis=1)
    return motion_totals(path, feed, turns) + waits


def _commands(
    path: Path,
    feeds: ArrayLike | None,
    speeds: ArrayLike | None,
    feed_override: ArrayLike,
    rapid_override: ArrayLike,
) -> tuple[Floats, Floats]:
    feed = commanded_feeds(path, feeds, feed_override, rapid_override)
    turns = spindle_turns(path, speeds)
    many = max(len(feed), len(turns))
    if not {len(feed), len(turns)} <= {1, many}:
        raise ValueError(
            f"feeds are of {len(feed)} individuals, speeds of {len(turns)}: give as many of both"
        )
    if len(feed) < many:
        feed = np.tile(feed, (many, 1))
    return feed, turns


def _add_waits(path: Path, turns: Floats, motion_time: Floats, wait: Floats) -> None:
    """Add what the rows wait for to ``wait``, shape (P, M)."""
    moves, parameters = path.moves, path.control.auxiliary
    rows, seconds = auxiliary_time(moves, parameters, turns)
    wait[:, rows] += seconds
    rows, waiting, seconds = spindle_waits(moves, parameters, turns)
    for row, until, needed in zip(rows.tolist(), waiting.tolist(), seconds.T, strict=True):
        if until == row:
            wait[:, row] += needed
            continue
        between = slice(row + 1, until)
        meanwhile = (motion_time[:, between] + wait[:, between]).sum(axis=1)
        standing = until if path.motion[until] == Motion.STILL else until - 1
        wait[:, standing] += np.maximum(0.0, needed - meanwhile)
