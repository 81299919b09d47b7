"""Comparison of moves, feed and speed apart: the same to the last bit, split blocks merged again.

A line put into a straight block holds G1, coordinates with a decimal point, and F or S only; its
point misses the straight line by half of its last decimal at most.
"""

import hashlib
import re
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import INCH, FeedMode, Kind, Moves
from pipeline.optimisation.proof.text import same_but_words
from pipeline.schema.arrays import Bools, Floats, Rows

BOUND = "F or S is bound to the motion there (thread, tapping, probing, G93, G96) and differs"


_NUMBER = rb"-?(?:[0-9]+\.[0-9]*|\.[0-9]+)"
_FEED = rb"(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_POINT = re.compile(
    rb"(?i)G0?1(?: ?X(?P<X>%b))?(?: ?Y(?P<Y>%b))?(?: ?Z(?P<Z>%b))?(?: ?F%b)?(?: ?S%b)?"
    % (_NUMBER, _NUMBER, _NUMBER, _FEED, _FEED)
)
EXACT = 1e-9
"""Rounding of coordinates [mm]."""
SAME = ("kind", "plane", "feed_mode", "direction", "constant_surface_speed", "tool", "frame",
        "path_mode", "tolerance", "code", "value", "file")  # fmt: skip
"""Columns that a part of a block has like the rest of it."""


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


def _same_bits(one: NDArray[np.generic], other: NDArray[np.generic]) -> Bools:
    """Rows whose bytes are the same: NaN is NaN, -0 is not 0."""
    if not len(one):
        return np.ones(0, dtype=np.bool_)
    width = one.dtype.itemsize * (one.shape[1] if one.ndim > 1 else 1)
    views = [np.ascontiguousarray(a).view(np.uint8).reshape(len(a), width) for a in (one, other)]
    return (views[0] == views[1]).all(axis=1)


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


def _stops(value: NDArray[np.float64], other: NDArray[np.float64]) -> Bools:
    return ((value > 0) != (other > 0)) | ~np.isfinite(other)


def _turns_back(moves: Moves) -> Bools:
    """Rows of lines in which the spindle turns in both directions: tapping."""
    place = np.stack([moves.file, moves.line])
    new = np.ones(len(moves), dtype=np.bool_)
    new[1:] = (place[:, 1:] != place[:, :-1]).any(axis=0)
    run = np.cumsum(new) - 1
    both = [np.bincount(run, weights=moves.direction == sense) > 0 for sense in (1, -1)]
    return (both[0] & both[1])[run]


def _same_frames(before: Moves, after: Moves) -> bool:
    return (
        before.frames == after.frames
        and before.files[1:] == after.files[1:]
        and before.origin.tobytes() == after.origin.tobytes()
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Splits:
    """Lines of a text that were put into another."""

    kept: list[bytes] = field(repr=False)
    """Lines that were not put in."""
    points: dict[int, bytes] = field(repr=False)
    """Line that was put in, counting from 1 -> its text."""
    line: Rows = field(repr=False)
    """Index of each line among those kept, for an inserted line that of the line that follows;
    shape (L + 1,)."""


def splits_of(before: list[bytes], after: list[bytes]) -> Splits:
    """Lines of ``after`` that were put in: points, with a decimal point, that do not match."""
    kept: list[bytes] = []
    points: dict[int, bytes] = {}
    line = np.zeros(len(after) + 1, dtype=np.intp)
    for number, text in enumerate(after, 1):
        line[number] = len(kept) + 1
        old = before[len(kept)] if len(kept) < len(before) else b""
        if not same_but_words(old, text) and _POINT.fullmatch(text.rstrip(b"\r\n")):
            points[number] = text.rstrip(b"\r\n")
        else:
            kept.append(text)
    return Splits(kept=kept, points=points, line=line)


def merged(moves: Moves, splits: Splits) -> Moves | tuple[int, str]:
    """Moves without the points that were put in; or the line of one that is none, and why."""
    own = moves.file == 0
    put_in = own & np.isin(moves.line, list(splits.points))
    straight = np.flatnonzero(put_in & (moves.kind == Kind.FEED))
    odd = np.flatnonzero(put_in & ~np.isin(moves.kind, (Kind.FEED, Kind.SPINDLE)))
    if len(odd):
        return int(splits.line[moves.line[odd[0]]]), "a line that was put in is no straight cut"
    whole = np.setdiff1d(compared_rows(moves), np.flatnonzero(put_in))
    at = np.searchsorted(whole, straight)
    for row, place in zip(straight.tolist(), at.tolist(), strict=True):
        line = int(moves.line[row])
        end = int(whole[place]) if place < len(whole) else -1
        start = moves.end[whole[place - 1]] if place else moves.origin
        before = moves.end[row - 1] if row else moves.origin
        wrong = _off_the_path(moves, row, end, start, before, splits.points[line])
        follows = end >= 0 and splits.line[moves.line[end]] == splits.line[line]
        if wrong or not follows:
            return int(splits.line[line]), wrong or "a line that was put in leads nowhere"
    columns = {name: column[~put_in] for name, column in moves.columns()}
    columns["line"] = np.where(
        columns["file"] == 0,
        splits.line[np.where(columns["file"] == 0, columns["line"], 0)],
        columns["line"],
    ).astype(np.int32)
    return replace(moves, **columns)


def _off_the_path(
    moves: Moves, row: int, end: int, start: Floats, before: Floats, text: bytes
) -> str:
    """Reason why a point is off the straight line from ``start`` to row ``end``, else empty."""
    if end < 0 or any(getattr(moves, name)[row] != getattr(moves, name)[end] for name in SAME):
        return "a point that was put in is not of the block that follows"
    if moves.feed_mode[row] == FeedMode.INVERSE_TIME or not moves.feed[row] > 0:
        return "a point that was put in has no feed"
    point, path = moves.end[row], moves.end[end] - start
    length = float(path[:3] @ path[:3])
    if path[3:].any() or (point - start)[3:].any() or length == 0.0:
        return "a point was put into a block that turns or stands"
    share = float((point - start)[:3] @ path[:3]) / length
    done = float((before - start)[:3] @ path[:3]) / length
    if not done < share < 1.0:
        return "a point that was put in lies behind"
    tolerance = _tolerances(moves, row, text)
    if tolerance is None:
        return "a point that was put in is not in absolute coordinates"
    return (
        ""
        if _on_the_path((point - start)[:3], path[:3], tolerance)
        else ("a point that was put in lies beside the path")
    )


def _on_the_path(step: Floats, path: Floats, tolerance: Floats) -> bool:
    goes = path != 0.0
    middle, half = step[goes] / path[goes], tolerance[goes] / np.abs(path[goes])
    meets = (middle - half).max() <= (middle + half).min()
    return bool(meets and (np.abs(step[~goes]) <= tolerance[~goes]).all())


def _tolerances(moves: Moves, row: int, text: bytes) -> Floats | None:
    """Distance that X, Y and Z may each miss the path by [mm]; None where they are not absolute."""
    point = _POINT.fullmatch(text)
    shift = moves.frames[moves.frame[row]].translation
    for unit in (1.0, INCH):
        tolerance = np.full(3, EXACT)
        absolute = True
        for axis, letter in enumerate("XYZ"):
            number = None if point is None else point[letter]
            if number is not None:
                decimals = len(number.partition(b".")[2])
                tolerance[axis] += unit / 2 / 10**decimals
                miss = abs(float(number) * unit + shift[axis] - moves.end[row, axis])
                absolute = absolute and miss < EXACT
        if absolute:
            return tolerance
    return None
