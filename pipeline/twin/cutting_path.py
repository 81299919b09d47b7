"""The way of a program's tools through its stock: moves as straight pieces in work coordinates.

Machine positions become positions of the tool's tip in the coordinates of one work offset
(:mod:`pipeline.twin.cut_frames`); arcs, helices and spirals become chords.  A chord over the angle
d of p(phi) leaves it by at most d^2 max|p''| / 8, and with a radius r that goes linearly with phi
|p''| <= sqrt(r^2 + 4 r'^2).  Where each axis goes as fast as it can, a rapid is a dog-leg: all axes
at their speeds until one after the other arrives; their acceleration is left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool_path import ToolPath
from pipeline.gcode.moves import METRE, Kind, Moves
from pipeline.gcode.setup import Vector
from pipeline.machine.control.path import where
from pipeline.twin.cut_frames import WorkFrame, work_frame

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

CUTS = (Kind.FEED, Kind.ARC)
MOVES = (Kind.RAPID, *CUTS, Kind.PROBE, Kind.THREAD)
WIDEST = np.pi / 12
"""Angle of a chord at most, so that the direction of feed stays that of the arc [rad]."""
TURNED = 1e-6
"""What the rotary axes may stand off and the tool still be upright in its stock [deg]."""
IN_PLANE = {17: (0, 1), 18: (2, 0), 19: (1, 2)}


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Moves that are not computed: why, how many, and the first of them as ``file:line``."""

    reason: str
    rows: int
    first: str


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingPath:
    """A program's tool path; its blocks are the rows of its moves.

    Parameters
    ----------
    pieces : ToolPath
        In the coordinates of ``frame`` [m].
    frame : WorkFrame
        Work offset that the stock is measured in.
    left_out : tuple of LeftOut
        What is not in it.
    """

    pieces: ToolPath = field(repr=False)
    frame: WorkFrame = field(repr=False)
    left_out: tuple[LeftOut, ...]


def cutting_path(
    moves: Moves,
    tools: Sequence[int],
    *,
    chord: float,
    offsets: Mapping[str, Vector],
    offset: str | None = None,
    rapid_speeds: Floats | None = None,
) -> CuttingPath:
    """Path of ``moves`` in the coordinates of the work offset of its first cut, or of ``offset``.

    Parameters
    ----------
    moves : Moves
        M rows.
    tools : sequence of int
        Numbers of the tools that are known; their places become ``ToolPath.tool``.
    chord : float
        How far a chord may leave its arc [m].
    offsets : mapping of str to Vector
        Work offsets before the program, as in :class:`pipeline.gcode.setup.Setup` [mm, deg].
    offset : str, optional
        Name of the work offset that the stock is measured in.
    rapid_speeds : ndarray, shape (3,), optional
        Of X, Y and Z where they do not interpolate a rapid, in any unit; without, it is straight.

    Raises
    ------
    ValueError
        When nothing in the program moves with a tool of ``tools``, or a cut has no tool or one
        that is not in ``tools``.
    """
    moving: Flags = np.isin(moves.kind, MOVES) & (moves.length > 0)
    cutting: Flags = np.isin(moves.kind, CUTS) & moving
    left_out, reasons = _not_computed(moves, moving, cutting)
    cutting &= ~left_out
    _check_tools(moves, cutting, tools)
    known = np.isin(moves.tool, list(tools))
    rows = np.flatnonzero(moving & ~left_out & known)
    if not len(rows):
        raise ValueError(nothing_cut(moves, reasons))
    first = int(np.argmax(cutting)) if cutting.any() else int(rows[0])
    frame = work_frame(moves, first, offsets, offset)
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


def nothing_cut(moves: Moves, left_out: Sequence[LeftOut]) -> str:
    """What is said of a program that has nothing in the material."""
    if not np.isin(moves.kind, MOVES).any():
        name = moves.files[0] if len(moves.files) else "the program"
        return f"{name} has no moves: name a program that cuts"
    said = f" ({left_out[0].reason})" if left_out else ""
    return f"{moves.files[0]}: no move cuts{said}: nothing is in the material"


def _not_computed(
    moves: Moves, moving: Flags, cutting: Flags
) -> tuple[Flags, list[LeftOut]]:  # fmt: skip
    """Which rows are left out, shape (M,), and what is said of them."""
    milling: Flags = cutting & ~moves.constant_surface_speed
    upright = moves.end[np.argmax(milling), 3:] if milling.any() else moves.origin[3:]
    stands: Flags = np.any(np.abs(moves.end[:, 3:] - upright) > TURNED, axis=1)
    off = stands | np.concatenate([[False], stands[:-1]])
    found = np.zeros(len(moves), dtype=bool)
    told = []
    for reason, rows in (
        ("threads are not computed", moves.kind == Kind.THREAD),
        ("probing is not computed", moves.kind == Kind.PROBE),
        ("turning (G96) is not computed", moves.constant_surface_speed & cutting),
        ("cuts with rotary axes turned are not computed", off),
    ):
        rows = np.asarray(rows) & moving & ~found
        if rows.any():
            found |= rows
            first = where(moves, int(np.argmax(rows)))
            told.append(LeftOut(reason=reason, rows=int(rows.sum()), first=first))
    return found, told


def _check_tools(moves: Moves, cutting: Flags, tools: Sequence[int]) -> None:
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
    for plane, axes in IN_PLANE.items():
        here = arc & (moves.plane[row] == plane)
        if here.any():
            _onto_arcs(moves, row[here], (place / many)[here], axes, a, here)
            _onto_arcs(moves, row[here], ((place + 1) / many)[here], axes, b, here)
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
    moves: Moves, row: Rows, share: Floats, axes: tuple[int, int], points: Floats, here: Flags
) -> None:
    """Put ``points[here]`` at a ``share`` of the arcs ``row``; the normal axis is there already."""
    u, v = axes
    near, far = moves.start[row, :3] - moves.centre[row], moves.end[row, :3] - moves.centre[row]
    r_0, r_1 = np.hypot(near[:, u], near[:, v]), np.hypot(far[:, u], far[:, v])
    radius = r_0 + share * (r_1 - r_0)
    angle = np.arctan2(near[:, v], near[:, u]) + share * moves.angle[row]
    points[here, u] = moves.centre[row, u] + radius * np.cos(angle)
    points[here, v] = moves.centre[row, v] + radius * np.sin(angle)
