"""How the rows of a path move, by either profile: for one individual, or times for many."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.machine.control import Floats
from pipeline.machine.independent import independent_time
from pipeline.machine.motion import Motion
from pipeline.machine.path import Path


@dataclass(frozen=True, kw_only=True)
class RowMotion:
    """Speeds and times of M rows.

    Parameters
    ----------
    v_out, v_peak : (M,) array
        Speed along the path at the end of a row, and greatest in it [m/s].
    time : (M,) array
        How long the row moves [s].
    profile : (M,) array of int32
        Of an S-curve: the row in ``profiles`` that a row belongs to, -1 where it does not move;
        empty of a trapezoid, whose rows are each a profile.
    profiles : (N, 6) array
        Speeds at both ends and on top [m/s], length [m], acceleration [m/s^2], jerk [m/s^3].
    """

    v_out: Floats = field(repr=False)
    v_peak: Floats = field(repr=False)
    time: Floats = field(repr=False)
    profile: npt.NDArray[np.int32] = field(repr=False)
    profiles: Floats = field(repr=False)


def row_motion(path: Path, feed: Floats, turns: Floats) -> RowMotion:
    """Motion under one individual's commands, both of shape (1, M)."""
    if path.control.profile == "s_curve":
        found = _jerk_limited(path, feed, turns)
    else:
        found = _trapezoids(path, feed, turns)
    _add_independent(path, feed, found.time[np.newaxis])
    return found


def motion_times(path: Path, feed: Floats, turns: Floats) -> Floats:
    """How long the rows move [s]; shape (P, M), from commands of shape (P, M) and (1 or P, M)."""
    if path.control.profile == "s_curve":
        own = range(len(turns)) if len(turns) > 1 else [0] * len(feed)
        rows = [
            row_motion(path, feed[[p]], turns[[q]]).time
            for p, q in zip(range(len(feed)), own, strict=True)
        ]
        return np.array(rows).reshape(feed.shape)
    from pipeline.machine.look_ahead import plan_population

    time = np.zeros(feed.shape)
    room = np.zeros((2, len(path)))
    plan_population(
        path.motion, path.length, path.factor, path.cap, path.acceleration, path.corner,
        feed, turns, room[0], room[1], time,
    )  # fmt: skip
    _add_independent(path, feed, time)
    return time


def motion_totals(path: Path, feed: Floats, turns: Floats) -> Floats:
    """How long each individual moves, by trapezoids [s]; shape (P,)."""
    from pipeline.machine.population import CARRIED, LANES
    from pipeline.machine.population import motion_totals as totals

    out = np.zeros(len(feed))
    speed, square = np.zeros((2, len(path), LANES))
    totals(
        path.motion, path.length, path.factor, path.cap, path.acceleration, path.corner,
        feed, turns, speed, square, np.zeros((CARRIED, LANES)), out,
    )  # fmt: skip
    rows = np.flatnonzero(path.motion == Motion.INDEPENDENT)
    if len(rows):
        out += independent_time(path, rows, feed[:, rows]).sum(axis=1)
    return out


def _trapezoids(path: Path, feed: Floats, turns: Floats) -> RowMotion:
    from pipeline.machine.look_ahead import plan_rows

    v_out, v_peak, time = (np.zeros(len(path)) for _ in range(3))
    plan_rows(
        path.motion, path.length, path.factor, path.cap, path.acceleration, path.corner,
        feed, turns, 0, v_out, v_peak, time,
    )  # fmt: skip
    return RowMotion(
        v_out=v_out, v_peak=v_peak, time=time,
        profile=np.zeros(0, np.int32), profiles=np.zeros((0, 6)),
    )  # fmt: skip


def _jerk_limited(path: Path, feed: Floats, turns: Floats) -> RowMotion:
    from pipeline.machine.s_curve import COLUMNS, plan_profiles

    rows = np.flatnonzero(path.moving & (path.motion != Motion.INDEPENDENT))
    speed = feed[0, rows] * path.factor[rows]
    speed *= np.where(path.motion[rows] == Motion.PER_TURN, turns[0, rows], 1.0)
    v_out, v_peak, time = (np.zeros(len(rows)) for _ in range(3))
    profile = np.zeros(len(rows), np.int32)
    profiles = np.zeros((len(rows), COLUMNS))
    plan_profiles(
        path.length[rows], np.minimum(speed, path.cap[rows]), path.acceleration[rows],
        path.jerk[rows], path.corner[rows], np.zeros(len(rows), np.uint8),
        v_out, v_peak, time, profile, profiles,
    )  # fmt: skip
    first, of = np.unique(profile, return_inverse=True)
    return RowMotion(
        v_out=_carried(len(path), rows, v_out),
        v_peak=_placed(len(path), rows, v_peak, 0.0),
        time=_placed(len(path), rows, time, 0.0),
        profile=_placed(len(path), rows, of.astype(np.int32), -1),
        profiles=np.ascontiguousarray(profiles[first, :6]),
    )


def _placed(many: int, rows: npt.NDArray[np.intp], values: np.ndarray, other: float) -> np.ndarray:
    placed = np.full(many, other, values.dtype)
    placed[rows] = values
    return placed


def _carried(many: int, rows: npt.NDArray[np.intp], speed: Floats) -> Floats:
    """Speed at the end of each row; what does not move keeps that of the row before."""
    last = np.searchsorted(rows, np.arange(many), side="right") - 1
    padded: Floats = np.concatenate([[0.0], speed])[last + 1]
    return padded


def _add_independent(path: Path, feed: Floats, time: Floats) -> None:
    rows = np.flatnonzero(path.motion == Motion.INDEPENDENT)
    if len(rows):
        time[:, rows] = independent_time(path, rows, feed[:, rows])
