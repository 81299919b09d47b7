"""F, S and overrides as the look-ahead takes them, checked."""

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.gcode.moves import METRE
from pipeline.machine.auxiliary import where
from pipeline.machine.control import Floats
from pipeline.machine.motion import Motion
from pipeline.machine.path import Path


def commanded_feeds(
    path: Path, feeds: ArrayLike | None, feed_override: ArrayLike, rapid_override: ArrayLike
) -> Floats:
    """F with its override in the rows that cut, the override in rapids [1]; shape (P, M).

    Parameters
    ----------
    path : Path
        Its rows and what they are.
    feeds : (M,) or (P, M) array, optional
        In the units of ``Moves``; the program's own by default.
    feed_override, rapid_override : float or (M,) array
        [percent].

    Raises
    ------
    ValueError
        When a row that cuts has no positive F, or an override is not positive.
    """
    from pipeline.machine.look_ahead import scale_feeds

    asked = np.atleast_2d(_rows(path, "feeds", path.moves.feed if feeds is None else feeds))
    feed_share = _override(path, "feed_override", feed_override)
    rapid_share = _override(path, "rapid_override", rapid_override)
    commanded = np.empty(asked.shape)
    bad = scale_feeds(
        path.motion, path.moves.kind, asked, feed_share, rapid_share, commanded
    )  # fmt: skip
    if bad >= 0:
        found = asked[:, bad][~(np.isfinite(asked[:, bad]) & (asked[:, bad] > 0))][0]
        raise ValueError(
            f"{where(path.moves, bad)}: F {found} of a row that cuts must be finite and positive: "
            "program an F before it"
        )
    return commanded


def spindle_turns(path: Path, speeds: ArrayLike | None) -> Floats:
    """Speed of the spindle in each row, 0 where it stands [rev/min]; shape (P, M).

    Under constant surface speed S is [m/min] at the greater of the diameters at the row's ends,
    X counted from the origin of the work coordinates.

    Raises
    ------
    ValueError
        When a speed is negative or not finite, or the spindle stands in a row whose feed is bound
        to it.
    """
    moves = path.moves
    turns = np.atleast_2d(_rows(path, "speeds", moves.speed if speeds is None else speeds)).copy()
    wrong = ~(np.isfinite(turns) & (turns >= 0)).all(axis=0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ValueError(
            f"{where(moves, row)}: S {turns[:, row].min()} must be finite and at least 0"
        )
    turns[:, moves.direction == 0] = 0.0
    surface = np.flatnonzero(moves.constant_surface_speed)
    if len(surface):
        turns[:, surface] = _surface_turns(path, surface, turns[:, surface])
    standing = (path.motion == Motion.PER_TURN) & ~(turns > 0).all(axis=0)
    if standing.any():
        raise ValueError(
            f"{where(moves, int(np.argmax(standing)))}: the feed is bound to the spindle, which "
            "stands: program S and M3 before it, or a feed per minute"
        )
    return turns


def _surface_turns(path: Path, rows: npt.NDArray[np.intp], speed: Floats) -> Floats:
    moves = path.moves
    zero = np.array([frame.translation[0] for frame in moves.frames])[moves.frame[rows]]
    start = np.where(rows > 0, moves.end[rows - 1, 0], moves.origin[0])
    radius = np.maximum(np.abs(moves.end[rows, 0] - zero), np.abs(start - zero))
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.where(speed > 0, speed / (2 * np.pi * radius * METRE), 0.0)
    limited: Floats = np.minimum(turns, path.control.auxiliary.maximum_speed)
    if not np.isfinite(limited).all():
        raise ValueError(
            f"{where(moves, rows[np.argmin(np.isfinite(limited).all(axis=0))])}: constant surface "
            "speed at the centre has no limit: give auxiliary.maximum_speed"
        )
    return limited


def _rows(path: Path, name: str, values: ArrayLike) -> Floats:
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
