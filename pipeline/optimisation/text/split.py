"""Long straight blocks split where their engagement changes, by points put in on their path."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from pipeline.cutting.engagement.engagement import Engagement
from pipeline.gcode.moves import METRE, FeedMode, Kind, Moves
from pipeline.gcode.program import Line, Program, Word
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.modal_words import LineRuns, cuts_at_feed
from pipeline.optimisation.text.words import FeedText, ProgramWords, digits
from pipeline.schema.arrays import Floats, Rows
from pipeline.twin.cut import Cut

SECONDS = 60.0
"""In a minute."""
STANDING = frozenset("NFSTM")
"""Words that move no axis and leave the meaning of coordinates alone."""
PLAIN_G = (1.0, 90.0)
"""G codes that a line may have that is split."""


def split_blocks(program: Program, moves: Moves, cut: Cut, grouping: Grouping) -> bytes:
    """The program with its long straight blocks split where their engagement changes.

    A part is split off where the area that it cuts is less than the block's greatest by
    ``grouping.split_gain``, as its feed may then rise by as much, and where it takes at least
    ``grouping.least_block_s`` at the feed programmed.  Only lines that hold G1, G90, absolute X Y Z
    and F are split.

    Parameters
    ----------
    program : Program
        Text.
    moves : Moves
        The program as interpreted, M rows.
    cut : Cut
        Of these rows.
    grouping : Grouping
        Gain that splits a block.
    """
    length = moves.length
    per_turn = moves.feed_mode == FeedMode.PER_REVOLUTION
    least = grouping.least_block_s / SECONDS * moves.feed * np.where(per_turn, moves.speed, 1.0)
    rows = splittable(program, moves)
    where = {
        row: changes_along(cut.engagement, row, length[row], least[row], grouping.split_gain)
        for row in rows[length[rows] >= 2 * least[rows]].tolist()
    }
    return split_at(program, moves, where)


def splittable(program: Program, moves: Moves) -> Rows:
    """Rows of straight cuts whose line could be split, ascending.

    None where lines that move begin with ``/``: where such a line is left out at the machine, the
    next motion begins elsewhere, and a point on it would lie beside it.
    """
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
    engagement: Engagement, row: int, length: float, least: float, gain: float
) -> list[float]:
    """Where on a straight row its engagement changes enough, as shares of its length.

    Parameters
    ----------
    engagement : Engagement
        Stations of all rows.
    row : int
        A straight row: one piece of the path.
    length, least : float
        Of the row, and of a part at least [mm].
    gain : float
        By how much the area of a light part has to be less [1].
    """
    here = np.flatnonzero((engagement.block == row) & engagement.feed)
    if not len(here) or len(np.unique(engagement.piece[here])) > 1:
        return []
    here = here[np.argsort(engagement.along[here], kind="stable")]
    area = engagement.volume[here] / np.maximum(engagement.length[here], 1e-12)
    heavy = here[area * (1 + gain) > area.max()]
    begin = engagement.along[heavy] / METRE
    ends = begin + engagement.length[heavy] / METRE
    bounds: list[list[float]] = []
    for low, high in zip(begin.tolist(), ends.tolist(), strict=True):
        if bounds and low - bounds[-1][1] < least:
            bounds[-1][1] = max(high, bounds[-1][1])
        else:
            bounds.append([low, high])
    cuts = [at for pair in bounds for at in pair]
    return _kept_apart(cuts, length, least)


def _kept_apart(cuts: list[float], length: float, least: float) -> list[float]:
    """Those of some places that leave parts of at least ``least``, as shares of the length."""
    kept, last = [], 0.0
    for at in cuts:
        if at - last >= least and length - at >= least:
            kept.append(at / length)
            last = at
    return kept


def split_at(program: Program, moves: Moves, where: Mapping[int, list[float]]) -> bytes:
    """A program with points put in before the lines of some rows.

    Parameters
    ----------
    program : Program
        Text.
    moves : Moves
        The program as interpreted.
    where : mapping of int to list of float
        One of :func:`splittable` -> shares of its length, ascending between 0 and 1.
    """
    words = ProgramWords(program)
    unit, decimals = FeedText.of(words, moves).unit, _decimals(program)
    put: dict[int, bytes] = {}
    for row, shares in where.items():
        number = int(moves.line[row])
        line = program.line(number)
        lines = _points(program, moves, row, shares, float(unit[row]), decimals)
        feed = next((b"F" + digits(word.text) for word in line.words if word.letter == "F"), None)
        _, blank, small = words.place(number)
        texts = [[b"G1", *axes, *([feed] if feed else [])] for axes in lines]
        ending = line.end or b"\n"
        joined = b"".join(blank.join(text) + ending for text in texts)
        put[number] = joined.lower() if small else joined
    pieces = []
    for line in program.lines:
        pieces += [put.get(line.number, b""), line.text, line.end]
    return b"".join(pieces)


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
    """That the program's coordinates have at most; 3 at least."""
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
