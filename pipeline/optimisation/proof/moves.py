"""Whether two programs make the same moves, feed and speed apart: to the last bit."""

import hashlib

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

BOUND = "F or S is bound to the motion there (thread, tapping, probing, G93, G96) and differs"


def compared_rows(moves: Moves) -> Rows:
    """All rows but those that only change the S of a turning spindle."""
    standing = np.concatenate([[0], moves.direction[:-1]])
    turns_on = (moves.direction == standing) & (moves.direction != 0)
    return np.flatnonzero(~((moves.kind == Kind.SPINDLE) & (moves.code == 0) & turns_on))


def moves_difference(before: Moves, after: Moves) -> tuple[int, int, str] | None:
    """Row of each, and what differs there first; None where nothing does."""
    rows, others = compared_rows(before), compared_rows(after)
    count = min(len(rows), len(others))
    first, what = count, ""
    for name, column in before.columns():
        if name in ("feed", "speed"):
            continue
        same = _same_bits(column[rows[:count]], getattr(after, name)[others[:count]])
        at = int(np.argmin(same)) if count else 0
        if count and not same[at] and at < first:
            first, what = at, name.replace("_", " ")
    if first == count:
        first, what = _bound_difference(before, after, rows[:count], others[:count])
    if first < count:
        return int(rows[first]), int(others[first]), what
    if len(rows) != len(others):
        ends = [int(r[min(count, len(r) - 1)]) if len(r) else -1 for r in (rows, others)]
        return ends[0], ends[1], f"one makes {len(rows)} moves and the other {len(others)}"
    if not _same_frames(before, after):
        return -1, -1, "origin, work coordinate systems or subprograms"
    return None


def moves_digest(moves: Moves) -> bytes:
    """Hash of the moves without feed and speed."""
    digest = hashlib.sha256()
    rows = compared_rows(moves)
    for name, column in moves.columns():
        if name not in ("feed", "speed"):
            kept = np.ascontiguousarray(column[rows])
            little = kept.astype(kept.dtype.newbyteorder("<"), copy=False)
            digest.update(f"{name} {kept.dtype.str[1:]} {kept.shape}\n".encode("ascii"))
            digest.update(little.tobytes())
    digest.update(repr(moves.origin.tolist()).encode("ascii"))
    digest.update(repr((moves.files[1:], moves.frames)).encode())
    return digest.digest()


def _same_bits(one: NDArray[np.generic], other: NDArray[np.generic]) -> Flags:
    """Rows whose bytes are the same: NaN is NaN, -0 is not 0."""
    if not len(one):
        return np.ones(0, dtype=np.bool_)
    width = one.dtype.itemsize * (one.shape[1] if one.ndim > 1 else 1)
    views = [np.ascontiguousarray(a).view(np.uint8).reshape(len(a), width) for a in (one, other)]
    same: Flags = (views[0] == views[1]).all(axis=1)
    return same


def _bound_difference(before: Moves, after: Moves, rows: Rows, others: Rows) -> tuple[int, str]:
    """The first row whose feed or speed may not differ, and does."""
    kind = before.kind[rows]
    tied = np.isin(kind, (Kind.THREAD, Kind.PROBE)) | _turns_back(before)[rows]
    reads = np.isin(kind, (Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD))
    feeds = before.feed[rows], after.feed[others]
    speeds = before.speed[rows], after.speed[others]
    timed = before.feed_mode[rows] == FeedMode.INVERSE_TIME
    wrong = reads & (tied | timed) & (feeds[0] != feeds[1])
    wrong |= (tied | before.constant_surface_speed[rows]) & (speeds[0] != speeds[1])
    wrong |= reads & _stops(*feeds)
    wrong |= _stops(*speeds)
    return (int(np.argmax(wrong)), BOUND) if wrong.any() else (len(rows), "")


def _stops(value: NDArray[np.float64], other: NDArray[np.float64]) -> Flags:
    """Where one is positive and the other is not, or no number."""
    stops: Flags = ((value > 0) != (other > 0)) | ~np.isfinite(other)
    return stops


def _turns_back(moves: Moves) -> Flags:
    """Rows of lines in which the spindle turns one way and the other: tapping."""
    place = np.stack([moves.file, moves.line])
    new = np.ones(len(moves), dtype=np.bool_)
    new[1:] = (place[:, 1:] != place[:, :-1]).any(axis=0)
    visit = np.cumsum(new) - 1
    ways = [np.bincount(visit, weights=moves.direction == way) > 0 for way in (1, -1)]
    back: Flags = (ways[0] & ways[1])[visit]
    return back


def _same_frames(before: Moves, after: Moves) -> bool:
    return (
        before.frames == after.frames
        and before.files[1:] == after.files[1:]
        and before.origin.tobytes() == after.origin.tobytes()
    )
