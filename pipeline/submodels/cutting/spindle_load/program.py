"""Cut of each line of a program: stretches of its path with constant engagement.

A tooth with the height b(phi) in the material takes, of the area b sin(phi) R dphi that it sweeps
across the feed, the volume per metre of feed; and it shows the width b R dphi of cutting edge
to the material, which times speed and teeth is the edge rate of
:mod:`pipeline.submodels.cutting.spindle_load.power`.
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
from pipeline.schema.arrays import Floats, Ints
from pipeline.submodels.cutting.spindle_load.records import LoadCut
from pipeline.twin.control import program_moves
from pipeline.twin.cut.path import cutting_path

CHORD = 0.1
"""Greatest distance of a chord from its arc, over the resolution [1]."""
ALIKE = 0.05
"""Share by which engagements of one stretch differ at most [1]."""
LEVEL = 0.01
"""Slope up to which a feed counts as horizontal [1]."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Part of a line's path with constant engagement."""

    begin: float
    end: float
    """Begin and end along the path of the line [m]."""
    area: float
    """Volume removed per path length [m^2]."""
    edge: float
    """Edge rate over the spindle's speed, all teeth in cut [m^2]."""


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Path length, rapids and cuts of a program's lines."""

    length: Floats = field(repr=False)
    """Path length of each line, rapids included [m]; index 0 is no line; shape (L,)."""
    rapid: NDArray[np.bool_] = field(repr=False)
    """Whether a line has a rapid, whose speed not every control shows; shape (L,)."""
    cuts: NDArray[np.bool_] = field(repr=False)
    """Whether anything is in the material in a line; shape (L,)."""
    stretches: Mapping[int, tuple[Stretch, ...]] = field(repr=False)
    """Stretches of each line no shorter than the tool's radius; others are entries and exits."""


def program_lines(raw: Path, cut: LoadCut, setup: Setup) -> Lines:
    """Lines of the program of ``cut``.

    ValueError when the program is not there or cannot be followed, executes lines more than once,
    or its cut cannot be computed.
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
    engagement, _ = engage(pieces, tools, height_map(_stock(raw, cut.stock), resolution))
    lines = int(moves.line.max(initial=0)) + 1
    rapid, cuts = np.zeros(lines, dtype=bool), np.zeros(lines, dtype=bool)
    rapid[moves.line[(moves.kind == Kind.RAPID) & (moves.length > 0)]] = True
    cuts[moves.line[engagement.block]] = True
    return Lines(
        length=METRE * np.bincount(moves.line, moves.length, lines).astype(np.float64),
        rapid=rapid,
        cuts=cuts,
        stretches=_stretches(moves, pieces, engagement, tools),
    )


def _stock(raw: Path, text: str) -> Stock:
    stock = stock_of(text)
    return replace(stock, path=raw / stock.path) if isinstance(stock, Mesh) else stock


def _stretches(
    moves: Moves, path: ToolPath, engagement: Engagement, tools: list[Tool]
) -> dict[int, tuple[Stretch, ...]]:
    line: Ints = np.asarray(moves.line[engagement.block], np.int64)
    begin = _length_before(moves, path)[engagement.piece] + engagement.along
    end = begin + engagement.length
    edge = _edges(engagement, tools)
    group = _groups(engagement, line, begin, edge)
    label = np.maximum(group, 0)
    lengths = np.where(group >= 0, engagement.length, 0.0)
    length = np.bincount(label, lengths)
    area = np.bincount(label, lengths * engagement.volume / engagement.length) / length
    edges = np.bincount(label, lengths * edge) / length
    stretches: dict[int, list[Stretch]] = {}
    for number in range(int(group.max(initial=-1)) + 1):
        members = np.flatnonzero(group == number)
        one = Stretch(
            begin=float(begin[members[0]]), end=float(end[members[-1]]),
            area=float(area[number]), edge=float(edges[number]),
        )  # fmt: skip
        if one.end - one.begin >= tools[engagement.tool[members[0]]].radius:
            stretches.setdefault(int(line[members[0]]), []).append(one)
    return {one: tuple(rows) for one, rows in stretches.items()}


def _groups(engagement: Engagement, line: Ints, begin: Floats, edge: Floats) -> Ints:
    """Number of the stretch that each station is in, -1 where a line does not cut in the plane."""
    area, end = engagement.volume / engagement.length, begin + engagement.length
    group = np.full(len(engagement), -1, dtype=np.int64)
    first = last = -1
    for k in np.flatnonzero(
        engagement.feed & (np.abs(engagement.slope) <= LEVEL) & (edge > 0) & (area > 0)
    ).tolist():
        continued = (
            first >= 0
            and line[k] == line[first]
            and begin[k] - end[last] <= engagement.resolution
            and abs(area[k] - area[first]) <= ALIKE * area[first]
            and abs(edge[k] - edge[first]) <= ALIKE * edge[first]
        )
        group[k] = group[last] if continued else group[last] + 1 if last >= 0 else 0
        first, last = (first if continued else k), k
    return group


def _length_before(moves: Moves, path: ToolPath) -> Floats:
    """Path length from the start of its line to the start of each piece [m]; shape (Q,)."""
    travelled = np.concatenate([[0.0], np.cumsum(moves.length)]) * METRE
    starts = np.searchsorted(moves.line, moves.line)  # first row of each row's line
    row = travelled[:-1] - travelled[starts]
    pieces = np.concatenate([[0.0], np.cumsum(path.length)])
    first = np.searchsorted(path.block, path.block)  # first piece of each piece's row
    length: Floats = row[path.block] + pieces[:-1] - pieces[first]
    return length


def _edges(engagement: Engagement, tools: list[Tool]) -> Floats:
    """Edge rate over the spindle's speed [m^2]; shape (N,)."""
    height = np.maximum(engagement.upper - engagement.lower, 0.0).sum(axis=1, dtype=np.float64)
    step = 2 * np.pi / engagement.upper.shape[1]
    teeth = np.array([tool.flutes * tool.radius for tool in tools])[engagement.tool]
    edges: Floats = teeth * height * step
    return edges
