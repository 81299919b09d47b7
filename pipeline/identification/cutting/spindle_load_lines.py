"""What each line of a program cuts: stretches of its way over which the engagement stays the same.

A tooth with the height b(phi) in the material takes, of the area b sin(phi) R dphi that it sweeps
across the feed, the volume with each metre of feed; and it shows the width b R dphi of cutting edge
to the material, which times speed and teeth is the edge rate of
:mod:`pipeline.identification.cutting.spindle_power`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engage
from pipeline.cutting.engagement.height_map import height_map
from pipeline.cutting.engagement.stock import Mesh, Stock, stock_of
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import METRE, Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.identification.cutting.spindle_load_records import LoadCut
from pipeline.twin.cutting_path import cutting_path
from pipeline.twin.program import program_moves

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]

CHORD = 0.1
"""Part of the resolution that a chord may leave its arc by."""
ALIKE = 0.05
"""Share by which engagements of one stretch differ at most."""
LEVEL = 0.01
"""Slope up to which a feed counts as one in the plane [1]."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Part of a line's way with one engagement.

    Parameters
    ----------
    begin, end : float
        Along the way of the line [m].
    area : float
        Volume removed over the way [m^2].
    edge : float
        Edge rate over the spindle's speed, all teeth in cut [m^2].
    """

    begin: float
    end: float
    area: float
    edge: float


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Lines of a program.

    Parameters
    ----------
    length : ndarray, shape (L,)
        Way of each line, rapids included [m]; index 0 is no line.
    rapid : ndarray of bool, shape (L,)
        Lines with a rapid, whose speed not every control shows.
    cuts : ndarray of bool, shape (L,)
        Whether anything is in the material in a line.
    stretches : mapping of int to tuple of Stretch
        Of the lines that have any as long as the tool's radius; shorter are entries and exits.
    """

    length: Floats = field(repr=False)
    rapid: NDArray[np.bool_] = field(repr=False)
    cuts: NDArray[np.bool_] = field(repr=False)
    stretches: Mapping[int, tuple[Stretch, ...]] = field(repr=False)


def program_lines(raw: Path, cut: LoadCut, setup: Setup) -> Lines:
    """What the program of ``cut`` does line by line.

    Raises
    ------
    ValueError
        When the program is not there or cannot be followed, executes lines more than once, or its
        cut cannot be computed.
    """
    path = raw / cut.program
    if not path.is_file():
        raise ValueError(
            f"{path} does not exist: put the program that ran there, or correct its "
            "name in cutting_records.spindle.cuts"
        )
    moves = program_moves(path, setup)
    if (np.diff(moves.line) < 0).any() or len(moves.files) > 1:
        raise ValueError(
            f"{cut.program} jumps (subprograms or loops): the number of a line does not tell where "
            "in it the machine is; cut with a program without them"
        )
    numbers = sorted(cut.tools)
    resolution = cut.resolution_mm * METRE
    pieces = cutting_path(
        moves, numbers, chord=CHORD * resolution, offsets=setup.work_offsets
    ).pieces
    tools = [cut.tools[number] for number in numbers]
    found, _ = engage(pieces, tools, height_map(_stock(raw, cut.stock), resolution))
    lines = int(moves.line.max(initial=0)) + 1
    rapid, cuts = np.zeros(lines, dtype=bool), np.zeros(lines, dtype=bool)
    rapid[moves.line[(moves.kind == Kind.RAPID) & (moves.length > 0)]] = True
    cuts[moves.line[found.block]] = True
    return Lines(
        length=METRE * np.bincount(moves.line, moves.length, lines).astype(np.float64),
        rapid=rapid,
        cuts=cuts,
        stretches=_stretches(moves, pieces, found, tools),
    )


def _stock(raw: Path, text: str) -> Stock:
    stock = stock_of(text)
    return replace(stock, path=raw / stock.path) if isinstance(stock, Mesh) else stock


def _stretches(
    moves: Moves, path: ToolPath, found: Engagement, tools: list[Tool]
) -> dict[int, tuple[Stretch, ...]]:
    line = moves.line[found.block]
    begin = _way_before(moves, path)[found.piece] + found.along
    end = begin + found.length
    edge = _edges(found, tools)
    group = _groups(found, line, begin, edge)
    whose = np.maximum(group, 0)
    kept = np.where(group >= 0, found.length, 0.0)
    way = np.bincount(whose, kept)
    area = np.bincount(whose, kept * found.volume / found.length) / way
    rim = np.bincount(whose, kept * edge) / way
    stretches: dict[int, list[Stretch]] = {}
    for number in range(int(group.max(initial=-1)) + 1):
        members = np.flatnonzero(group == number)
        one = Stretch(
            begin=float(begin[members[0]]), end=float(end[members[-1]]),
            area=float(area[number]), edge=float(rim[number]),
        )  # fmt: skip
        if one.end - one.begin >= tools[found.tool[members[0]]].radius:
            stretches.setdefault(int(line[members[0]]), []).append(one)
    return {one: tuple(rows) for one, rows in stretches.items()}


def _groups(found: Engagement, line: Ints, begin: Floats, edge: Floats) -> Ints:
    """Number of the stretch that each station is in, -1 where a line is no cut in the plane."""
    area, end = found.volume / found.length, begin + found.length
    group = np.full(len(found), -1, dtype=np.int64)
    first = last = -1
    for k in np.flatnonzero(
        found.feed & (np.abs(found.slope) <= LEVEL) & (edge > 0) & (area > 0)
    ).tolist():
        same = (
            first >= 0
            and line[k] == line[first]
            and begin[k] - end[last] <= found.resolution
            and abs(area[k] - area[first]) <= ALIKE * area[first]
            and abs(edge[k] - edge[first]) <= ALIKE * edge[first]
        )
        group[k] = group[last] if same else group[last] + 1 if last >= 0 else 0
        first, last = (first if same else k), k
    return group


def _way_before(moves: Moves, path: ToolPath) -> Floats:
    """Way from the beginning of its line to the beginning of each piece [m]; shape (Q,)."""
    gone = np.concatenate([[0.0], np.cumsum(moves.length)]) * METRE
    starts = np.searchsorted(moves.line, moves.line)  # first row of each row's line
    row = gone[:-1] - gone[starts]
    pieces = np.concatenate([[0.0], np.cumsum(path.length)])
    first = np.searchsorted(path.block, path.block)  # first piece of each piece's row
    way: Floats = row[path.block] + pieces[:-1] - pieces[first]
    return way


def _edges(found: Engagement, tools: list[Tool]) -> Floats:
    """Edge rate over the spindle's speed [m^2]; shape (N,)."""
    height = np.maximum(found.upper - found.lower, 0.0).sum(axis=1, dtype=np.float64)
    step = 2 * np.pi / found.upper.shape[1]
    teeth = np.array([tool.flutes * tool.radius for tool in tools])[found.tool]
    edges: Floats = teeth * height * step
    return edges
