"""Straight blocks that were split: lines put before them whose points lie on the way.

A line that is put in holds G1, coordinates with a decimal point, and F or S; nothing else.  Its
point may miss the straight line between its neighbours by half of its last decimal, and no more.
"""

import re
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import INCH, FeedMode, Kind, Moves
from pipeline.optimisation.proof.moves import compared_rows
from pipeline.optimisation.proof.text import same_but_words

Rows = NDArray[np.intp]
Floats = NDArray[np.float64]

_NUMBER = rb"-?(?:[0-9]+\.[0-9]*|\.[0-9]+)"
_FEED = rb"(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_POINT = re.compile(
    rb"(?i)G0?1(?: ?X(?P<X>%b))?(?: ?Y(?P<Y>%b))?(?: ?Z(?P<Z>%b))?(?: ?F%b)?(?: ?S%b)?"
    % (_NUMBER, _NUMBER, _NUMBER, _FEED, _FEED)
)
EXACT = 1e-9
"""Of coordinates, what arithmetic may leave [mm]."""
SAME = ("kind", "plane", "feed_mode", "direction", "constant_surface_speed", "tool", "frame",
        "path_mode", "tolerance", "code", "value", "file")  # fmt: skip
"""Columns that a part of a block has like the rest of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Splits:
    """Lines of a text that were put into another.

    Parameters
    ----------
    kept : list of bytes
        The other lines.
    points : mapping of int to bytes
        Line that was put in, counting from 1 -> its text.
    line : ndarray of intp, shape (L + 1,)
        Of each line its number among those kept; of those put in that of the line that follows.
    """

    kept: list[bytes] = field(repr=False)
    points: dict[int, bytes] = field(repr=False)
    line: Rows = field(repr=False)


def splits_of(before: list[bytes], after: list[bytes]) -> Splits:
    """Which lines of ``after`` were put in: those that are points and do not match."""
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
        wrong = _off_the_way(moves, row, end, start, before, splits.points[line])
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


def _off_the_way(
    moves: Moves, row: int, end: int, start: Floats, before: Floats, text: bytes
) -> str:
    """Why a point is not one of the straight line from ``start`` to row ``end``; empty if it is."""
    if end < 0 or any(getattr(moves, name)[row] != getattr(moves, name)[end] for name in SAME):
        return "a point that was put in is not of the block that follows"
    if moves.feed_mode[row] == FeedMode.INVERSE_TIME or not moves.feed[row] > 0:
        return "a point that was put in has no feed"
    point, way = moves.end[row], moves.end[end] - start
    length = float(way[:3] @ way[:3])
    if way[3:].any() or (point - start)[3:].any() or length == 0.0:
        return "a point was put into a block that turns or stands"
    share = float((point - start)[:3] @ way[:3]) / length
    done = float((before - start)[:3] @ way[:3]) / length
    if not done < share < 1.0:
        return "a point that was put in lies behind"
    room = _rooms(moves, row, text)
    if room is None:
        return "a point that was put in is not in absolute coordinates"
    return (
        ""
        if _on_the_way((point - start)[:3], way[:3], room)
        else ("a point that was put in lies beside the way")
    )


def _on_the_way(step: Floats, way: Floats, room: Floats) -> bool:
    """Whether there is one place on the way that each coordinate misses by its room at most."""
    goes = way != 0.0
    middle, half = step[goes] / way[goes], room[goes] / np.abs(way[goes])
    meets = (middle - half).max() <= (middle + half).min()
    return bool(meets and (np.abs(step[~goes]) <= room[~goes]).all())


def _rooms(moves: Moves, row: int, text: bytes) -> Floats | None:
    """What each of X, Y and Z may miss the way by [mm]; None where they are not absolute."""
    found = _POINT.fullmatch(text)
    shift = moves.frames[moves.frame[row]].translation
    for unit in (1.0, INCH):
        room = np.full(3, EXACT)
        absolute = True
        for axis, letter in enumerate("XYZ"):
            number = None if found is None else found[letter]
            if number is not None:
                decimals = len(number.partition(b".")[2])
                room[axis] += unit / 2 / 10**decimals
                miss = abs(float(number) * unit + shift[axis] - moves.end[row, axis])
                absolute = absolute and miss < EXACT
        if absolute:
            return room
    return None
