"""Set-up sheet of an optimised program: tools, changes, lines, path, before and after."""

import re
from collections.abc import Iterator
from dataclasses import replace
from difflib import SequenceMatcher
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS, CuttingRange, tool_range
from pipeline.cutting.engagement.stock import Box, Cylinder, HeightMap, Stock
from pipeline.machine.spindle import CUTTING
from pipeline.optimisation.comparison import (
    BINDS,
    COLUMNS,
    MM,
    RowReasons,
    Side,
    alike_runs,
    path_length,
)
from pipeline.optimisation.problem.arrays import feeds_per_minute
from pipeline.optimisation.text.words import FeedWords
from pipeline.schema import part_sheet as stored
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import BY_TOOL
from pipeline.schema.program_cut import CutWarning, ToolTotals
from pipeline.twin.cut.document import AssessedCut
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.path import offset_of, work_frame
from pipeline.twin.cut.tables import by_tool, figure, tool_totals

if TYPE_CHECKING:
    from pipeline.optimisation.full_twin import Result

CONTEXT = 2
"""Lines that are kept on either side of a line that changed."""
MOST_POINTS = 3000
"""Points of the path that are kept, about; further ones would lie within a line's width."""
FINE = 2e-3
"""Distance of two points, as a share of the path's extent, within which they are drawn as one."""


LEAST_RISE = 5e-3
"""Rise of a feed per tooth that is more than the rounding of words [1]."""
_WORD = re.compile(r"\s*[FS]\s*[-+0-9.]+")


def tool_ranges(result: "Result") -> Iterator[tuple[int, CuttingRange, str, Bools]]:
    """Number of each tool, ranges of its feed and speed, why these stay, and its rows (M,)."""
    problem, moves = result.problem, result.moves
    practice = problem.practice
    if practice is not None:
        for one in practice.ranges:
            yield one.tool, one.range, one.kept, one.rows
        return
    for number in dict.fromkeys(moves.tool[problem.cuts].tolist()):
        known = tool_range(result.job.cut.tools[number])
        yield number, known, "", problem.cuts & (moves.tool == number)


def longest_binding(binds: Rows, seconds: Floats, rows: Rows) -> str | None:
    """Name in ``BINDS`` that binds for the longest; None where nothing does for longer.

    ``binds`` (M,): of ``RowReasons``; ``seconds`` (M,): time of each row [s].
    """
    if not len(rows):
        return None
    times = np.bincount(binds[rows] + 1, seconds[rows], minlength=len(BINDS) + 1)
    worst = int(np.argmax(times)) - 1
    return BINDS[worst] if worst >= 0 else None


def tool_uses(
    result: "Result", before: Side, after: Side, reasons: RowReasons
) -> tuple[stored.ToolUse, ...]:
    """Each tool that cuts in each of its operations, in the order of the program."""
    f_z, uses = _commanded(result, before, after), []
    found = [one for one in tool_ranges(result) if one[3].any()]
    for tool, known, why, mine in sorted(found, key=lambda one: int(np.argmax(one[3]))):
        rows = np.flatnonzero(mine)
        kept, shown = reasons.why_both(rows), mine & _raised(*f_z, mine)
        uses.append(stored.ToolUse(
            tool=tool, name=result.job.cut.tools[tool].name,
            operation=_operation(result, int(rows[0])),
            before=_totals(before, tool, mine, shown),
            after=_totals(after, tool, *(_written(result, one) for one in (mine, shown))),
            feed_per_tooth_range_mm=_range_there(result, known, rows, f_z[1]),
            cutting_speed_range_m_min=known.cutting_speed_m_min,
            range_source=known.source, kept=kept and (why or kept),
            binds=longest_binding(reasons.binds, after.time, rows[~reasons.kept[rows]]),
            no_faster=None if kept else reasons.why_no_faster(rows),
            no_more_feed=None if kept else reasons.why_no_more_feed(rows),
            rise=_rise(result.moves.line, *f_z, rows),
            limits={
                name: value for name in BY_TOOL
                if (value := getattr(result.job.cut.tools[tool], f"limit_{name}")) is not None
            },
        ))  # fmt: skip
    return tuple(uses)


def _raised(before: Floats, after: Floats, rows: Bools) -> Bools:
    """Rows whose feed per tooth rose, else those where it changed, else all."""
    change = after / before - 1
    for some in (change > LEAST_RISE, np.abs(change) > LEAST_RISE):
        if (some & rows).any():
            return some
    return np.ones(len(rows), dtype=np.bool_)


def _written(result: "Result", rows: Bools) -> Bools:
    """Rows of the program after that rows (M,) of the one before have become."""
    now = np.zeros(len(result.answer.cut.tool), dtype=np.bool_)
    now[result.answer.rows[rows]] = True
    return now


def _totals(side: Side, tool: int, rows: Bools, shown: Bools) -> ToolTotals:
    """Totals of the rows of a tool, the feed per tooth the greatest of some of them."""
    found = side.of.results
    feed = tool_totals(found, tool, shown).feed_per_tooth_mm
    return replace(tool_totals(found, tool, rows), feed_per_tooth_mm=feed)


def _range_there(
    result: "Result", known: CuttingRange, rows: Rows, f_z: Floats
) -> tuple[float, float] | None:
    """Range of the feed for each tooth where it is greatest: more for a thinner chip [mm]."""
    practice, span = result.problem.practice, known.feed_per_tooth_mm
    if practice is None or span is None:
        return span
    thicker = float(practice.thicker[rows[np.argmax(np.nan_to_num(f_z[rows]))]])
    return span[0], figure(span[1] * thicker) or span[1]


def _rise(
    lines: NDArray[np.int32], before: Floats, after: Floats, rows: Rows
) -> stored.FeedRise | None:
    """Place where the feed per tooth rose most, the highest end first; None below rounding."""
    ratio = np.divide(after[rows], before[rows], out=np.ones(len(rows)), where=before[rows] > 0)
    worst = rows[np.lexsort((after[rows], np.round(ratio, 3)))[-1]]
    if not after[worst] > (1 + LEAST_RISE) * before[worst]:
        return None
    return stored.FeedRise(
        line=int(lines[worst]), before_mm=figure(float(before[worst])) or 0.0,
        after_mm=figure(float(after[worst])) or 0.0,
    )  # fmt: skip


def _operation(result: "Result", row: int) -> str:
    practice = result.problem.practice
    code = -1 if practice is None else int(practice.operation[row])
    return OPERATIONS[code].replace("_", " ") if code >= 0 else ""


def feed_changes(
    result: "Result", before: Side, after: Side, reasons: RowReasons, words: FeedWords
) -> tuple[stored.FeedChange, ...]:
    """Runs of moves at feed whose F or S changed, in the order of the program."""
    moves, f_z = result.moves, _commanded(result, before, after)
    feeds = words.written(before.feed), words.written(after.feed)
    practice = result.problem.practice
    operation = np.zeros(len(moves)) if practice is None else practice.operation
    rows = np.flatnonzero(np.isin(moves.kind, CUTTING) & (moves.length > 0))
    words_of_row = before.feed, after.feed, before.speed, after.speed
    runs = alike_runs(rows, *words_of_row, moves.tool, moves.file, words.code, operation)
    changes = []
    for run in runs:
        row = run[0]
        if before.feed[row] == after.feed[row] and before.speed[row] == after.speed[row]:
            continue
        cutting = run[result.problem.cuts[run]]
        changes.append(stored.FeedChange(
            first_line=int(moves.line[run].min()), last_line=int(moves.line[run].max()),
            tool=int(moves.tool[row]), operation=_operation(result, int(row)),
            feed_unit=words.unit(row),
            feed_before=float(feeds[0][row]), feed_after=float(feeds[1][row]),
            speed_before=float(before.speed[row]), speed_after=float(after.speed[row]),
            feed_per_tooth_before_mm=figure(float(f_z[0][cutting[0]])) if len(cutting) else None,
            feed_per_tooth_after_mm=figure(float(f_z[1][cutting[0]])) if len(cutting) else None,
            binds=longest_binding(reasons.binds, after.time, cutting),
        ))  # fmt: skip
    return tuple(changes)


def _commanded(result: "Result", before: Side, after: Side) -> tuple[Floats, Floats]:
    """F / (N S) of each row before and after [mm], NaN in air; shape (M,) each."""
    problem = result.problem
    speeds = (
        result.before.plan.spindle_speed,
        result.answer.cut.plan.spindle_speed[result.answer.rows],
    )
    found = []
    for side, speed in zip((before, after), speeds, strict=True):
        teeth = problem.flutes * speed
        feed = feeds_per_minute(problem.cut, side.feed, speed)
        found.append(np.divide(feed, teeth, out=np.full(len(teeth), np.nan), where=teeth > 0))
    return found[0], found[1]


def program_lines(
    result: "Result", before: Side, after: Side, words: FeedWords
) -> tuple[stored.ProgramLine, ...]:
    """Lines whose words changed, with ``CONTEXT`` lines on either side, in order."""
    pairs = list(_matched(_lines(result.job.program.data), _lines(result.answer.text)))
    differ = np.array([then != now for then, now in pairs], dtype=np.bool_)
    around = np.convolve(differ, np.ones(2 * CONTEXT + 1), mode="same")[: len(pairs)] > 0
    feeds, speeds = _by_line(result, before, after, words)
    lines = []
    for index in np.flatnonzero(around).tolist():
        then, now = pairs[index]
        feed, speed = feeds.get(index + 1, (None, None)), speeds.get(index + 1, (None, None))
        lines.append(stored.ProgramLine(
            line=index + 1, before=then, after=now if then != now else None,
            feed_before=feed[0], feed_after=feed[1], speed_before=speed[0], speed_after=speed[1],
        ))  # fmt: skip
    return tuple(lines)


def _lines(data: bytes) -> list[str]:
    return [line.rstrip(b"\r").decode("utf-8", "replace") for line in data.split(b"\n")]


def _matched(before: list[str], after: list[str]) -> Iterator[tuple[str | None, str]]:
    """Each line as written with what it was; None where blocks were split and it was added."""
    if len(before) == len(after):
        yield from zip(before, after, strict=True)
        return
    then, now = ([_WORD.sub("", line) for line in lines] for lines in (before, after))
    for kind, a, b, c, d in SequenceMatcher(None, then, now, autojunk=False).get_opcodes():
        same = before[a:b] if kind == "equal" else [None] * (d - c)
        yield from zip(same, after[c:d], strict=True)


Pairs = dict[int, tuple[float | None, float | None]]
"""Value before and after, by line."""


def _by_line(result: "Result", before: Side, after: Side, words: FeedWords) -> tuple[Pairs, Pairs]:
    """F of the moves at feed of each line, and S of all, of the row that changed the most."""
    moves, own = result.moves, result.moves.file == 0
    fed = own & np.isin(moves.kind, CUTTING) & (moves.length > 0)
    return (
        _greatest(moves.line, words.written(before.feed), words.written(after.feed), fed),
        _greatest(moves.line, before.speed, after.speed, own & (after.speed > 0)),
    )


def _greatest(lines: NDArray[np.int32], before: Floats, after: Floats, rows: Bools) -> Pairs:
    chosen = np.flatnonzero(rows)
    ratio = np.abs(np.log(np.maximum(after[chosen], 1e-9) / np.maximum(before[chosen], 1e-9)))
    order = chosen[np.argsort(ratio, kind="stable")]  # the last of a line is kept
    return {
        int(lines[row]): (figure(float(before[row])), figure(float(after[row])))
        for row in order.tolist()
    }


def path_trace(cut: Cut, stock: Stock) -> stored.PathTrace | None:
    """The path at feed in the blank's coordinates; None where nothing moves at feed."""
    pieces = cut.path.pieces
    fed = np.flatnonzero(pieces.feed & (pieces.length > 0))
    if not len(fed):
        return None
    begin, total = path_length(cut)
    scale = COLUMNS / total
    # the ends of pieces and the edges of columns, along the path
    edges = np.arange(1, COLUMNS) / scale
    inside = fed[np.searchsorted(begin[fed], edges, side="right") - 1]
    share = np.clip((edges - begin[inside]) / pieces.length[inside], 0.0, 1.0)
    between = pieces.start[inside] + share[:, None] * (pieces.end[inside] - pieces.start[inside])
    joined = (np.abs(pieces.start[fed[1:]] - pieces.end[fed[:-1]]) < 1e-9).all(axis=1)
    first = fed[np.concatenate([[True], ~joined])]
    piece = np.concatenate([first, inside, fed])
    point = np.concatenate([pieces.start[first], between, pieces.end[fed]]) * MM
    way = np.concatenate([begin[first], edges, begin[fed] + pieces.length[fed]])
    rank = np.repeat([0, 1, 2], [len(first), len(inside), len(fed)])
    order = np.lexsort((rank, way, piece))
    piece, point, way, starts = piece[order], point[order], way[order], rank[order] == 0
    kept = _apart(point, starts, total * MM)
    column = np.clip(np.ceil(way * scale - 1e-6).astype(int) - 1, 0, COLUMNS - 1)
    low, high = _blank(stock, cut.blank)
    x, y, z = (tuple(np.round(point[kept, axis], 3).tolist()) for axis in range(3))
    return stored.PathTrace(
        frame=cut.path.frame.name, x_mm=x, y_mm=y, z_mm=z,
        starts=tuple(np.flatnonzero(starts[kept]).tolist()),
        column=tuple(column[kept].tolist()),
        line=tuple(cut.plan.path.moves.line[pieces.block[piece[kept]]].tolist()),
        blank_low_mm=low, blank_high_mm=high, round_blank=isinstance(stock, Cylinder),
    )  # fmt: skip


def _apart(point: Floats, starts: Bools, total: float) -> Rows:
    """Points that lie apart from the one kept before them; ends of strokes are always kept."""
    least = max(FINE * float(np.ptp(point, axis=0).max()), total / MOST_POINTS)
    last = np.append(starts[1:], True)
    kept = [0]
    for index in range(1, len(point)):
        far = float(np.abs(point[index] - point[kept[-1]]).max()) >= least
        if far or starts[index] or last[index]:
            kept.append(index)
    return np.array(kept, dtype=np.intp)


Corner = tuple[float, float, float]


def _blank(stock: Stock, found: HeightMap) -> tuple[Corner, Corner]:
    """Least and greatest corner of the blank [mm]."""
    if isinstance(stock, Box):
        spans = (stock.x_mm, stock.y_mm, stock.z_mm)
    elif isinstance(stock, Cylinder):
        half = 0.5 * stock.diameter_mm
        spans = ((stock.x_mm - half, stock.x_mm + half), (stock.y_mm - half, stock.y_mm + half),
                 stock.z_mm)  # fmt: skip
    else:
        rows, columns = found.heights.shape
        x, y = found.x0 * MM, found.y0 * MM
        cell = found.cell * MM
        top = float(found.heights.max()) * MM
        spans = ((x, x + columns * cell), (y, y + rows * cell), (found.floor * MM, top))
    low, high = ([round(span[end], 3) for span in spans] for end in (0, 1))
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def setup_sheet(
    result: "Result", after: AssessedCut, warnings: tuple[CutWarning, ...]
) -> stored.SetupSheet:
    """Tools and offsets of the optimised program, with its warnings."""
    cut, job = result.answer.cut, result.job
    moves, totals = cut.plan.path.moves, {one.tool: one for one in by_tool(after.results)}
    tools = []
    for number in dict.fromkeys(moves.tool[moves.tool >= 0].tolist()):
        tool, used = job.cut.tools.get(number), totals.get(number)
        register = job.setup.tools.get(number)
        tools.append(stored.SetupTool(
            tool=number, name=tool.name if tool else "", kind=tool.kind if tool else "",
            diameter_mm=tool.diameter_mm if tool else None,
            stickout_mm=tool.stickout_mm if tool else None, flutes=tool.flutes if tool else None,
            length_mm=register.length if register else None,
            time_s=figure(float(cut.plan.time[moves.tool == number].sum())) or 0.0,
            in_material_s=(used.in_material_s or 0.0) if used else 0.0,
            life_share=used.tool_life_share if used else None,
            life_share_low=used.tool_life_share_low if used else None,
            life_share_high=used.tool_life_share_high if used else None,
        ))  # fmt: skip
    return stored.SetupSheet(
        tools=tuple(tools), offsets=tuple(_offsets(result)), blank_offset=cut.path.frame.name,
        warnings=warnings,
    )  # fmt: skip


def _offsets(result: "Result") -> Iterator[stored.WorkOffset]:
    """Work offsets in force in moves at feed, in the order of the program."""
    moves, known = result.moves, result.job.setup.work_offsets
    fed = np.flatnonzero(np.isin(moves.kind, CUTTING))
    named: dict[str, int] = {}
    for row in fed.tolist():
        named.setdefault(offset_of(moves.frames[moves.frame[row]]), row)
    for name, row in named.items():
        x, y, z = work_frame(moves, row, known, name).base.tolist()
        given = name in known or any((x, y, z))
        yield stored.WorkOffset(name=name, position_mm=(x, y, z) if given else None)
