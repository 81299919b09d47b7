"""Path of a program's tools through its stock: straight pieces in work coordinates.

A frame of ``Moves`` adds up work offset, G52, G92 and tool length (gcode/modal.py); its tool
length follows from the offsets in force before the program, and holds until the next G43.

Arcs, helices and spirals become chords.  A chord over the angle d of p(phi) leaves it by at most
d^2 max|p''| / 8, and with a radius r that goes linearly with phi |p''| <= sqrt(r^2 + 4 r'^2). Where
each axis goes as fast as it can, a rapid is a dog-leg: all axes at their speeds until one after the
other arrives; their acceleration is left out.

The tool's envelope holds while it turns.  Where a boring cycle (G76, G86, G87) has stopped the
spindle, its rapids until the spindle turns again are not on the path.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import ToolPath
from pipeline.gcode.moves import IN_PLANE, METRE, RADIAN, Frame, Kind, Moves
from pipeline.gcode.setup import ZERO, Vector
from pipeline.machine.control.path import where
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.program_cut import LeftOutMoves

LENGTH = "G43"


@dataclass(frozen=True, kw_only=True)
class WorkFrame:
    """One work offset: where the stock lies, and the tool length in each frame of the program."""

    name: str
    """Name of the work offset, ``"G54"``, …"""
    base: Floats = field(repr=False)
    """Base of the work offset with the external one, in the machine [mm]; shape (3,)."""
    rotation: float = 0.0
    """Rotation of the work offset about Z [deg]."""
    lengths: Floats = field(repr=False)
    """Tool length in each frame of the program [mm]; shape (frames, 3)."""

    def tip(self, positions: Floats, frame: NDArray[np.int32]) -> Floats:
        """Tip in this offset's coordinates [mm], of machine positions (Q, 3) in frames (Q,)."""
        held = positions - self.lengths[frame] - self.base
        angle = self.rotation * RADIAN
        c, s = np.cos(angle), np.sin(angle)
        return held @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def work_frame(
    moves: Moves, row: int, offsets: Mapping[str, Vector], name: str | None = None
) -> WorkFrame:
    """Work offset ``name``, by default the one in force in ``row``, the first that cuts.

    ``offsets`` are those before the program.  Raises ValueError when the program does not use
    ``name``, or a tool length cannot be separated from a shift.
    """
    used = list(dict.fromkeys(offset_of(frame) for frame in moves.frames))
    held = int(moves.frame[row])
    chosen = offset_of(moves.frames[held]) if name is None else name
    if chosen not in used and chosen not in offsets:
        raise ValueError(
            f"work offset {chosen!r} is neither in the set-up nor in the program, which has "
            f"{', '.join(used)}: name one of them"
        )
    last = held if offset_of(moves.frames[held]) == chosen else len(moves.frames) - 1
    before = moves.frames[: last + 1]
    plain = [f.rotation for f in before if _is_plain(f) and offset_of(f) == chosen]
    return WorkFrame(
        name=chosen,
        base=_base(before, chosen, offsets),
        rotation=plain[-1] if plain else 0.0,
        lengths=_lengths(moves, offsets),
    )


def _marks(frame: Frame) -> list[str]:
    return frame.name.split("+")


def offset_of(frame: Frame) -> str:
    """Name of the work offset that a frame lies in, ``"G54"``."""
    return _marks(frame)[0]


def _is_plain(frame: Frame) -> bool:
    return set(_marks(frame)[1:]) <= {LENGTH}


def _base(frames: Sequence[Frame], name: str, offsets: Mapping[str, Vector]) -> Floats:
    """Work offset in the last of ``frames`` without a length (G10), else that of the set-up."""
    for frame in reversed(frames):
        if frame.name == name:
            return np.array(frame.translation[:3])
    work, external = offsets.get(name, ZERO), offsets.get("EXT", ZERO)
    return np.array([a + b for a, b in zip(work[:3], external[:3], strict=True)])


def _lengths(moves: Moves, offsets: Mapping[str, Vector]) -> Floats:
    """Tool length in each frame [mm]; shape (frames, 3), 0 in those that no row uses."""
    lengths = np.zeros((len(moves.frames), 3))
    known: set[int] = set()
    held, before, tool = np.zeros(3), -1, -1
    for row in np.flatnonzero(np.diff(moves.frame, prepend=-1)):
        index = int(moves.frame[row])
        frame = moves.frames[index]
        if LENGTH not in _marks(frame):
            held = np.zeros(3)
        elif _is_plain(frame):
            base = _base(moves.frames[:index], offset_of(frame), offsets)
            held = np.array(frame.translation[:3]) - base
        elif before < 0 or LENGTH not in _marks(moves.frames[before]):
            held = _earlier_length(moves, int(row), offsets)
        elif _marks(moves.frames[before]) == _marks(frame) and moves.tool[row] != tool:
            # what shifts the coordinates stayed in force while another length came
            held = held + np.subtract(frame.translation, moves.frames[before].translation)[:3]
        if index not in known:
            lengths[index] = held
            known.add(index)
        before, tool = index, int(moves.tool[row])
    return lengths


def _earlier_length(moves: Moves, row: int, offsets: Mapping[str, Vector]) -> Floats:
    """Length in the last frame before that of ``row`` that is work offset and length alone."""
    index = int(moves.frame[row])
    for earlier in range(index - 1, -1, -1):
        frame = moves.frames[earlier]
        if _is_plain(frame) and LENGTH in _marks(frame):
            base = _base(moves.frames[:earlier], offset_of(frame), offsets)
            return np.array(frame.translation[:3]) - base
    raise ValueError(
        f"{where(moves, row)}: the tool's length cannot be told from what else shifts the "
        f"coordinates ({moves.frames[index].name}): program G43 before it"
    )


CUTS = (Kind.FEED, Kind.ARC)
MOVES = (Kind.RAPID, *CUTS, Kind.PROBE, Kind.THREAD)
WIDEST = np.pi / 12
"""Greatest angle of a chord, so that the direction of feed stays that of the arc [rad]."""
TURNED = 1e-6
"""Tolerance of the rotary axes up to which the tool counts as upright in its stock [deg]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingPath:
    """A program's tool path; its blocks are the rows of its moves."""

    pieces: ToolPath = field(repr=False)
    """Pieces of the path in the coordinates of ``frame`` [m]."""
    frame: WorkFrame = field(repr=False)
    """Work offset that the stock is measured in."""
    left_out: tuple[LeftOutMoves, ...]
    """Moves that are not in it."""


def cutting_path(
    moves: Moves, tools: Sequence[int], *, chord: float, offsets: Mapping[str, Vector],
    offset: str | None = None, rapid_speeds: Floats | None = None,
) -> CuttingPath:  # fmt: skip
    """Path of ``moves`` in the coordinates of the work offset of its first cut, or of ``offset``.

    The places of the numbers ``tools`` become ``ToolPath.tool``; a chord leaves its arc by
    ``chord`` [m] at most; ``offsets`` are those before the program [mm, deg]; ``rapid_speeds`` (3,)
    of X, Y and Z, in any unit, say that they do not interpolate a rapid, else it is straight.
    Raises ValueError when nothing in the program moves with a tool of ``tools``, or a cut has no
    tool or one that is not in ``tools``.
    """
    # rows that move, and those of them that are left out
    moving: Bools = np.isin(moves.kind, MOVES) & (moves.length > 0)
    cutting: Bools = np.isin(moves.kind, CUTS) & moving
    left_out, reasons = _not_computed(moves, moving, cutting)
    cutting &= ~left_out
    _check_tools(moves, cutting, tools)
    known = np.isin(moves.tool, list(tools))
    rows = np.flatnonzero(moving & ~left_out & known & ~_oriented(moves))
    if not len(rows):
        raise ValueError(nothing_cut_message(moves, reasons))
    first = int(np.argmax(cutting)) if cutting.any() else int(rows[0])
    frame = work_frame(moves, first, offsets, offset)
    # straight pieces in the machine's frame, then in that of the work offset
    start, end, row = _chords(moves, rows, chord / METRE)
    if rapid_speeds is not None:
        start, end, row = _dog_legs(moves, start, end, row, rapid_speeds)
    order = np.argsort(tools)
    places = order[np.searchsorted(np.array(tools)[order], moves.tool[row])]
    pieces = ToolPath(
        start=frame.tip(start, moves.frame[row]) * METRE,
        end=frame.tip(end, moves.frame[row]) * METRE,
        block=row.astype(np.int32),
        tool=places.astype(np.int32),
        feed=np.isin(moves.kind[row], CUTS),
        direction=moves.direction[row],
    )
    return CuttingPath(pieces=pieces, frame=frame, left_out=tuple(reasons))


def nothing_cut_message(moves: Moves, left_out: Sequence[LeftOutMoves]) -> str:
    """Message for a program that has nothing in the material."""
    if not np.isin(moves.kind, MOVES).any():
        name = moves.files[0] if len(moves.files) else "the program"
        return f"{name} has no moves: name a program that cuts"
    reason = f" ({left_out[0].reason})" if left_out else ""
    return f"{moves.files[0]}: no move cuts{reason}: nothing is in the material"


def _not_computed(moves: Moves, moving: Bools, cutting: Bools) -> tuple[Bools, list[LeftOutMoves]]:
    """Rows that are left out, shape (M,), and the reasons."""
    milling: Bools = cutting & ~moves.constant_surface_speed
    upright = moves.end[np.argmax(milling), 3:] if milling.any() else moves.origin[3:]
    stands: Bools = np.any(np.abs(moves.end[:, 3:] - upright) > TURNED, axis=1)
    off = stands | np.concatenate([[False], stands[:-1]])
    left_out = np.zeros(len(moves), dtype=bool)
    reasons = []
    for reason, rows in (
        ("threads are not computed", moves.kind == Kind.THREAD),
        ("probing is not computed", moves.kind == Kind.PROBE),
        ("turning (G96) is not computed", moves.constant_surface_speed & cutting),
        ("cuts with rotary axes turned are not computed", off),
    ):
        rows = np.asarray(rows) & moving & ~left_out
        if rows.any():
            left_out |= rows
            first = where(moves, int(np.argmax(rows)))
            reasons.append(LeftOutMoves(reason=reason, rows=int(rows.sum()), first=first))
    return left_out, reasons


def _oriented(moves: Moves) -> Bools:
    """Rapids (M,) between stop and start of the spindle in one block: a boring cycle."""
    turns = np.flatnonzero(moves.kind == Kind.SPINDLE)
    oriented = np.zeros(len(moves), dtype=bool)
    for stop, start in zip(turns[:-1].tolist(), turns[1:].tolist(), strict=True):
        block = slice(stop, start + 1)
        one = np.ptp(moves.line[block]) == 0 and np.ptp(moves.file[block]) == 0
        oriented[block] = one and moves.direction[stop] == 0 and moves.direction[start] != 0
    return oriented & (moves.kind == Kind.RAPID)


def _check_tools(moves: Moves, cutting: Bools, tools: Sequence[int]) -> None:
    unknown = cutting & ~np.isin(moves.tool, list(tools))
    if not unknown.any():
        return
    row = int(np.argmax(unknown))
    if moves.tool[row] < 0:
        raise ValueError(
            f"{where(moves, row)}: no tool is in the spindle where the first cut begins: "
            "program T and M6 before it"
        )
    listed = ", ".join(f"T{number}" for number in sorted(tools)) or "no tool"
    raise ValueError(
        f"{where(moves, row)}: tool T{moves.tool[row]} cuts and is not in the tool table, which "
        f"has {listed}: add it"
    )


def _chords(moves: Moves, rows: Rows, chord: float) -> tuple[Floats, Floats, Rows]:
    """Start and end of the pieces of ``rows`` in the machine's frame [mm], and whose they are."""
    count = _counts(moves, rows, chord)
    row = np.repeat(rows, count)
    place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    many = np.repeat(count, count)
    start, end = moves.start[row, :3], moves.end[row, :3]
    step = end - start
    a, b = start + (place / many)[:, None] * step, start + ((place + 1) / many)[:, None] * step
    arc = (moves.kind[row] == Kind.ARC) & (moves.angle[row] != 0)
    for plane, (u, v, _) in IN_PLANE.items():
        here = arc & (moves.plane[row] == plane)
        if here.any():
            _onto_arcs(moves, row[here], (place / many)[here], (u, v), a, here)
            _onto_arcs(moves, row[here], ((place + 1) / many)[here], (u, v), b, here)
    last = place == many - 1
    b[last] = end[last]
    return a, b, row


def _dog_legs(
    moves: Moves, start: Floats, end: Floats, row: Rows, speeds: Floats
) -> tuple[Floats, Floats, Rows]:
    """The same pieces, but rapids in as many as axes arrive at different times."""
    rapid = moves.kind[row] == Kind.RAPID
    step = end - start
    needed = np.abs(step) / speeds
    times = np.concatenate([np.zeros((len(row), 1)), np.sort(needed, axis=1)], axis=1)
    times[~rapid, 1:] = needed.max(axis=1, initial=0.0)[~rapid, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        gone = np.where(needed[:, None] > 0, times[..., None] / needed[:, None], 1.0)
    gone[~rapid] = np.array([0.0, 1.0, 1.0, 1.0])[:, None]
    points = start[:, None] + np.minimum(gone, 1.0) * step[:, None]
    points[:, -1] = end
    a, b = points[:, :-1].reshape(-1, 3), points[:, 1:].reshape(-1, 3)
    moved = (np.diff(times, axis=1) > 0).ravel()
    return a[moved], b[moved], np.repeat(row, 3)[moved]


def _counts(moves: Moves, rows: Rows, chord: float) -> Rows:
    arcs = (moves.kind[rows] == Kind.ARC) & (moves.angle[rows] != 0)
    count = np.ones(len(rows), dtype=np.intp)
    r_0, r_1 = moves.radii(rows[arcs])
    angle = np.abs(moves.angle[rows[arcs]])
    bend = np.hypot(np.maximum(r_0, r_1), 2 * (r_1 - r_0) / angle)
    step = np.minimum(np.sqrt(8 * chord / np.maximum(bend, 1e-9)), WIDEST)
    count[arcs] = np.maximum(np.ceil(angle / step), 1)
    return count


def _onto_arcs(
    moves: Moves, row: Rows, share: Floats, axes: tuple[int, int], points: Floats, here: Bools
) -> None:
    """Put ``points[here]`` at a ``share`` of the arcs ``row``; the normal axis is there already."""
    u, v = axes
    near, far = moves.start[row, :3] - moves.centre[row], moves.end[row, :3] - moves.centre[row]
    r_0, r_1 = np.hypot(near[:, u], near[:, v]), np.hypot(far[:, u], far[:, v])
    radius = r_0 + share * (r_1 - r_0)
    angle = np.arctan2(near[:, v], near[:, u]) + share * moves.angle[row]
    points[here, u] = moves.centre[row, u] + radius * np.cos(angle)
    points[here, v] = moves.centre[row, v] + radius * np.sin(angle)
