"""Feeds, spindle speeds and waits of auxiliary functions of a program.

F and S are checked and scaled by their overrides as the look-ahead takes them; dwell, tool change,
M codes and the spindle give the standstill after each row.
"""

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.gcode.moves import METRE, Kind, Moves
from pipeline.machine.control.parameters import AuxiliaryParameters
from pipeline.machine.control.path import Motion, Path, where
from pipeline.machine.spindle import spindle_waits
from pipeline.schema.arrays import Floats


def commanded_feeds(
    path: Path, feeds: ArrayLike | None, feed_override: ArrayLike, rapid_override: ArrayLike
) -> Floats:
    """F with its override in cutting rows, the override in rapids [1]; shape (P, M).

    ValueError when a row that cuts has no positive F, or an override is not positive.

    Parameters
    ----------
    path : Path
        Path whose rows are commanded.
    feeds : (M,) or (P, M) array, optional
        Feeds in the units of ``Moves``; the program's own by default.
    feed_override, rapid_override : float or (M,) array
        [percent].
    """
    from pipeline.machine.control.look_ahead import scale_feeds

    feed = np.atleast_2d(_per_row(path, "feeds", path.moves.feed if feeds is None else feeds))
    feed_share = _override(path, "feed_override", feed_override)
    rapid_share = _override(path, "rapid_override", rapid_override)
    commanded = np.empty(feed.shape)
    bad = scale_feeds(path.motion, path.moves.kind, feed, feed_share, rapid_share, commanded)
    if bad >= 0:
        worst = feed[:, bad][~(np.isfinite(feed[:, bad]) & (feed[:, bad] > 0))][0]
        raise ValueError(
            f"{where(path.moves, bad)}: F {worst} of a row that cuts must be finite and positive: "
            "program an F before it"
        )
    return commanded


def spindle_speeds(path: Path, speeds: ArrayLike | None) -> Floats:
    """Speed of the spindle in each row, 0 at rest [rev/min]; shape (P, M).

    Under constant surface speed S is [m/min] at the greater of the diameters at the row's ends, X
    counted from the origin of the work coordinates. ValueError when a speed is negative or not
    finite, or the spindle is at rest in a row of feed per revolution.
    """
    moves = path.moves
    programmed = moves.speed if speeds is None else speeds
    commanded = np.atleast_2d(_per_row(path, "speeds", programmed)).copy()
    wrong = ~(np.isfinite(commanded) & (commanded >= 0)).all(axis=0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(
            f"{where(moves, row)}: S {commanded[:, row].min()} must be finite and at least 0"
        )
    commanded[:, moves.direction == 0] = 0.0
    surface = np.flatnonzero(moves.constant_surface_speed)
    if len(surface):
        commanded[:, surface] = _surface_speeds(path, surface, commanded[:, surface])
    standing = (path.motion == Motion.PER_TURN) & ~(commanded > 0).all(axis=0)
    if standing.any():
        raise ValueError(
            f"{where(moves, int(np.argmax(standing)))}: the feed is bound to the spindle, which "
            "stands: program S and M3 before it, or a feed per minute"
        )
    return commanded


def _surface_speeds(path: Path, rows: npt.NDArray[np.intp], speed: Floats) -> Floats:
    moves = path.moves
    zero = np.array([frame.translation[0] for frame in moves.frames])[moves.frame[rows]]
    start = np.where(rows > 0, moves.end[rows - 1, 0], moves.origin[0])
    radius = np.maximum(np.abs(moves.end[rows, 0] - zero), np.abs(start - zero))
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = np.where(speed > 0, speed / (2 * np.pi * radius * METRE), 0.0)
    limited: Floats = np.minimum(speeds, path.control.auxiliary.maximum_speed)
    if not np.isfinite(limited).all():
        raise ValueError(
            f"{where(moves, rows[np.argmin(np.isfinite(limited).all(axis=0))])}: constant surface "
            "speed at the centre has no limit: give auxiliary.maximum_speed"
        )
    return limited


def _per_row(path: Path, name: str, values: ArrayLike) -> Floats:
    array = np.ascontiguousarray(values, float)
    if array.ndim not in (1, 2) or array.shape[-1] != len(path):
        raise ValueError(
            f"{name} has shape {array.shape}, the program {len(path)} rows: "
            "give one value a row, or a row of them for each individual"
        )
    return array


def _override(path: Path, name: str, percent: ArrayLike) -> Floats:
    share = np.asarray(percent, float)
    if share.shape not in ((), (len(path),)):
        raise ValueError(f"{name} has shape {share.shape}: give one value, or {len(path)} of them")
    if not (np.isfinite(share) & (share > 0)).all():
        worst = share.ravel()[np.argmin(np.isfinite(share) & (share > 0))]
        raise ValueError(
            f"{name} = {worst} % must be finite and positive: at 0 % the machine never arrives"
        )
    return np.ascontiguousarray(np.broadcast_to(share, (len(path),))) / 100


def waits(path: Path, speeds: Floats, motion_time: Floats) -> Floats:
    """Standstill after each row for a population [s]; shape (P, M).

    Parameters
    ----------
    path : Path
        Path of :func:`pipeline.machine.control.planner.limited_path`.
    speeds : (1 or P, M) array
        Spindle speed, at least 0 [rev/min].
    motion_time : (P, M) array
        Duration of each row's motion [s].
    """
    wait = np.broadcast_to(path.pause, motion_time.shape).copy()
    moves, parameters = path.moves, path.control.auxiliary
    rows, seconds = auxiliary_time(moves, parameters, speeds)
    wait[:, rows] += seconds
    rows, waiting, seconds = spindle_waits(moves, parameters, speeds)
    for row, until, needed in zip(rows.tolist(), waiting.tolist(), seconds.T, strict=True):
        if until == row:
            wait[:, row] += needed
            continue
        between = slice(row + 1, until)
        meanwhile = (motion_time[:, between] + wait[:, between]).sum(axis=1)
        standing = until if path.motion[until] == Motion.STILL else until - 1
        wait[:, standing] += np.maximum(0.0, needed - meanwhile)
    return wait


def auxiliary_time(
    moves: Moves, parameters: AuxiliaryParameters, speeds: Floats
) -> tuple[npt.NDArray[np.intp], Floats]:
    """Rows that take time without motion, (N,), except spindle rows, and their time [s], (P, N).

    Spindle ``speeds``, shape (1 or P, M), are at least 0 [rev/min]. ValueError when a dwell counts
    revolutions of a spindle at rest.
    """
    dwell = np.flatnonzero(moves.kind == Kind.DWELL)
    change = np.flatnonzero(moves.kind == Kind.TOOL_CHANGE)
    stop = np.flatnonzero(moves.kind == Kind.STOP)
    code = np.flatnonzero(moves.kind == Kind.M_CODE)
    tools = moves.tool[change].tolist()
    m_codes = parameters.m_codes | dict.fromkeys(parameters.flying_m_codes, 0.0)
    fixed = [
        *(parameters.tool_change + parameters.tools.get(n, 0.0) for n in tools),
        *(parameters.stop for _ in stop),
        *(m_codes.get(n, parameters.m_code) for n in moves.code[code].tolist()),
    ]
    dwell_time = _dwell_time(moves, dwell, speeds[:, dwell])
    time = np.hstack([dwell_time, np.tile(np.array(fixed, float), (len(speeds), 1))])
    return np.concatenate([dwell, change, stop, code]), time


def _dwell_time(moves: Moves, rows: npt.NDArray[np.intp], speeds: Floats) -> Floats:
    value = moves.value[rows]
    in_revolutions = moves.code[rows] == 1
    wrong = ~(np.isfinite(value) & (value >= 0)) | (in_revolutions & (value > 0) & ~(speeds > 0))
    if wrong.any():
        row = rows[np.argmax(wrong.any(axis=0))]
        raise ValueError(
            f"{where(moves, row)}: dwell of {moves.value[row]} "
            f"{'rev with the spindle standing' if moves.code[row] == 1 else 's'}: "
            "it must be finite, at least 0, and in seconds where the spindle stands"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        seconds = np.where(in_revolutions, value * 60 / speeds, value)
    return np.where(value > 0, seconds, 0.0)
