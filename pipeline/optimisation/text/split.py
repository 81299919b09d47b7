"""Long straight blocks split where their engagement changes, by points put in on their path."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pipeline.cutting.engagement.engagement import Engagement
from pipeline.gcode.moves import METRE, FeedMode, Kind, Moves
from pipeline.gcode.program import Line, Program, Word
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import LineRuns, cuts_at_feed
from pipeline.optimisation.text.words import FeedText, ProgramWords, digits
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut.loads import Cut

SECONDS = 60.0
"""Seconds in a minute."""
STANDING = frozenset("NFSTM")
"""Words that move no axis and leave the meaning of coordinates alone."""
PLAIN_G = (1.0, 90.0)
"""G codes that a line may have that is split."""
STEP = 1.2
"""Ratio of the areas cut in two parts of a block from which on their engagement differs [1]."""
AIR = 1e3
"""Level of a part in air; of one in the cut the steps by which it is lighter than the heaviest."""
TINY = 1e-9
"""Rounding error of lengths [mm], and of areas as a share."""


@dataclass(frozen=True, kw_only=True)
class SplitProgram:
    """A program with points put in on its path, each a line of its own before the block's."""

    program: Program = field(repr=False)
    """Program with the points."""
    added: tuple[int, ...]
    """Lines of the points, ascending; the first line is 1."""

    def without(self, lines: Iterable[int]) -> "SplitProgram":
        """The program without some of its points."""
        out = set(lines)
        texts = [one.text + one.end for one in self.program.lines if one.number not in out]
        left = np.array([line for line in self.added if line not in out], dtype=np.intp)
        left -= np.searchsorted(sorted(out), left)
        program = Program(b"".join(texts), self.program.name)
        return SplitProgram(program=program, added=tuple(left.tolist()))

    def whole_rows(self, parts: Moves) -> Rows:
        """Row of the program before that each row of this one is a part of; shape (M,)."""
        points = self.points(parts)
        return np.cumsum(~points) - ~points

    def points(self, parts: Moves) -> Bools:
        """Rows of this program that end at a point that was put in; shape (M,)."""
        return (parts.file == 0) & np.isin(parts.line, self.added)

    def alike(self, parts: Moves, feeds: Floats, gain: float) -> list[int]:
        """Lines of the points on whose two sides F (M,) differs by less than a share ``gain``."""
        points, alike = self.points(parts), []
        least, most = np.inf, 0.0
        for row in np.flatnonzero(points).tolist():
            if row == 0 or not points[row - 1]:
                least, most = np.inf, 0.0
            least, most = min(least, feeds[row]), max(most, feeds[row])
            after = feeds[row + 1]
            if max(most, after) < (1 + gain) * min(least, after):
                alike.append(int(parts.line[row]))
            else:
                least, most = np.inf, 0.0
        return alike


def split_blocks(
    program: Program, moves: Moves, cut: Cut, grouping: Grouping, rows: Bools, in_air: Bools
) -> SplitProgram:
    """Program with its long straight blocks split where their engagement changes.

    A part takes at least ``grouping.least_block_s`` at the feed programmed, and is at least as long
    as the tool is wide.  Only lines that hold G1, G90, absolute X Y Z and F are split.  ``rows``
    (M,): rows that may be split; ``in_air`` (M,): rows whose stretches in air are parts of their
    own.
    """
    length = moves.length
    per_turn = moves.feed_mode == FeedMode.PER_REVOLUTION
    least = grouping.least_block_s / SECONDS * moves.feed * np.where(per_turn, moves.speed, 1.0)
    diameter = np.array([tool.diameter for tool in cut.tools])[cut.tool] / METRE
    least = np.maximum(least, diameter)
    chosen = splittable(program, moves)
    chosen = chosen[rows[chosen] & (length[chosen] >= 2 * least[chosen])]
    where = {
        row: changes_along(cut.engagement, row, length[row], least[row], in_air=in_air[row])
        for row in chosen.tolist()
    }
    return split_at(program, moves, where)


def splittable(program: Program, moves: Moves) -> Rows:
    """Rows of splittable straight cuts, ascending; none where lines that move begin with ``/``."""
    if any(_may_be_left_out(line) for line in program.lines):
        return np.zeros(0, dtype=np.intp)
    words, line_runs = ProgramWords(program), LineRuns.among(moves)
    unit = FeedText.of(words, moves).unit
    alone = np.bincount(line_runs.of, minlength=len(line_runs.line)) == 1
    fits = cuts_at_feed(moves) & (moves.kind == Kind.FEED) & (moves.file == 0)
    fits &= (alone & ~line_runs.again)[line_runs.of]
    return np.array(
        [
            row
            for row in np.flatnonzero(fits).tolist()
            if not words.closed[moves.line[row]] and _is_plain(program, moves, row, unit[row])
        ],
        dtype=np.intp,
    )


def _may_be_left_out(line: Line) -> bool:
    return line.skip is not None and any(word.letter not in STANDING for word in line.words)


def changes_along(
    engagement: Engagement, row: int, length: float, least: float, *, in_air: bool
) -> list[float]:
    """Places on a straight row where its engagement changes enough, as shares of its length.

    ``length`` of the row and ``least`` of a part [mm]; ``in_air``: air as parts of its own.
    """
    here = np.flatnonzero((engagement.block == row) & engagement.feed)
    if not len(here) or len(np.unique(engagement.piece[here])) > 1:
        return []
    here = here[np.argsort(engagement.along[here], kind="stable")]
    area = engagement.volume[here] / np.maximum(engagement.length[here], 1e-12)
    lighter = np.log(area.max() / np.maximum(area, TINY * area.max())) / np.log(STEP)
    begin = engagement.along[here] / METRE
    stretches = zip(begin, begin + engagement.length[here] / METRE, np.floor(lighter), strict=True)
    parts = [[0.0, AIR]]
    for low, high, level in stretches:
        parts += [[low, AIR], [high, float(level)]]
    parts.append([length, AIR])
    return [end / length for end, _ in _joined(parts, least, in_air=in_air)[:-1]]


def _joined(parts: list[list[float]], least: float, *, in_air: bool) -> list[list[float]]:
    """End and level of parts along a row, too short ones joined with a heavier neighbour."""
    parts = [part for last, part in pairwise([[0.0, AIR], *parts]) if part[0] - last[0] > TINY]
    while len(parts) > 1:
        lengths = np.diff([0.0, *(end for end, _ in parts)])
        levels = np.array([level for _, level in parts])
        lighter = np.diff(levels)  # than the next
        before = np.concatenate([[np.inf], np.where(lighter >= 0, lighter, AIR - lighter)])
        after = np.concatenate([np.where(lighter <= 0, -lighter, AIR + lighter), [np.inf]])
        lengths[np.minimum(before, after) == 0] = 0.0
        if not in_air:
            lengths[levels == AIR] = np.nextafter(least, 0.0)  # once an entry is joined to its cut
        k = int(lengths.argmin())
        if lengths[k] >= least:
            break
        first = k - 1 if before[k] <= after[k] else k
        parts[first : first + 2] = [[parts[first + 1][0], float(levels[first : first + 2].min())]]
    return parts


def split_at(program: Program, moves: Moves, where: Mapping[int, list[float]]) -> SplitProgram:
    """Program with points put in; ``where``: row -> ascending shares of its length, 0 to 1."""
    words = ProgramWords(program)
    unit, decimals = FeedText.of(words, moves).unit, _decimals(program)
    put: dict[int, list[bytes]] = {}
    for row, shares in where.items():
        number = int(moves.line[row])
        line = program.line(number)
        lines = _points(program, moves, row, shares, float(unit[row]), decimals)
        feed = next((b"F" + digits(word.text) for word in line.words if word.letter == "F"), None)
        _, blank, small = words.place(number)
        texts = [[b"G1", *axes, *([feed] if feed else [])] for axes in lines]
        ending = line.end or b"\n"
        written = [blank.join(text) + ending for text in texts]
        put[number] = [one.lower() for one in written] if small else written
    pieces: list[bytes] = []
    added: list[int] = []
    for line in program.lines:
        points = put.get(line.number, [])
        first = line.number + len(added)
        added += range(first, first + len(points))
        pieces += [*points, line.text, line.end]
    return SplitProgram(program=Program(b"".join(pieces), program.name), added=tuple(added))


def _points(
    program: Program, moves: Moves, row: int, shares: list[float], unit: float, decimals: int
) -> list[list[bytes]]:
    """Axis words of the points on a row's path; none that rounds to one of its neighbours."""
    start, end = moves.start[row], moves.end[row]
    shift = np.array(moves.frames[moves.frame[row]].translation)
    axes = [axis for axis in range(3) if start[axis] != end[axis]]
    points: list[list[bytes]] = []
    for share in shares:
        point = (start + share * (end - start) - shift) / unit
        points.append([_axis_word("XYZ"[axis], float(point[axis]), decimals) for axis in axes])
    ends = [
        [_axis_word("XYZ"[axis], float(at[axis]), decimals) for axis in axes]
        for at in ((start - shift) / unit, (end - shift) / unit)
    ]
    chain = [ends[0], *points, ends[1]]
    return [one for last, one in pairwise(chain[:-1]) if one not in (last, ends[1])]


def _axis_word(letter: str, value: float, decimals: int) -> bytes:
    written = f"{value:.{decimals}f}".rstrip("0")
    if not written.strip("-.0"):
        written = "0."
    return (letter + written).encode("ascii")


def _decimals(program: Program) -> int:
    """Greatest number of decimals of the program's coordinates; 3 at least."""
    counts = [
        len(digits(word.text).partition(b".")[2])
        for line in program.lines
        for word in line.words
        if word.letter in "XYZ" and word.value is not None
    ]
    return max([3, *counts])


def _is_plain(program: Program, moves: Moves, row: int, unit: float) -> bool:
    """Whether a row's line is G1 with absolute coordinates and nothing beside F."""
    end, shift = moves.end[row], moves.frames[moves.frame[row]].translation
    if (moves.start[row] != end)[3:].any():
        return False
    words: tuple[Word, ...] = program.line(int(moves.line[row])).words
    axes = [word for word in words if word.letter in "XYZ"]
    return bool(axes) and all(
        word.value is not None
        and (
            word.letter in "NF"
            or (word.letter == "G" and word.value in PLAIN_G)
            or (word in axes and _reaches(word, end, shift, unit))
        )
        for word in words
    )


def _reaches(word: Word, end: Floats, shift: tuple[float, ...], unit: float) -> bool:
    axis = "XYZ".index(word.letter)
    return word.value is not None and word.value * unit + shift[axis] == end[axis]
