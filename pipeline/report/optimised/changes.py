"""Tables of an optimised program for the operator: increases, by tool, its lines."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import log

from markupsafe import Markup

from pipeline.charts.numbers import NARROW, TOGETHER, as_stated, counted, number
from pipeline.charts.sections import Listing, ListingLine, Section, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Column, Table, lettered, marks_note, tabulated
from pipeline.report.cut.tables import NONE, between, figure, share, spans_of
from pipeline.report.optimised.tables import force, limit_name, tool_name
from pipeline.schema.part import OptimisedPart
from pipeline.schema.part_sheet import FeedChange, ProgramLine, ToolUse

LEAST = 5e-3
"""Share below which a change, or what a value is out of its range, is rounding [1]."""
MOST_SPANS = 6
"""Stretches of lines that a row names."""
MOST_INCREASES = 12
STEPS = (1.25, 2.0)
"""Factors from which a change is large, and very large [1]."""
MOST_LINES = 1500
"""Lines of a listing; the whole program is in the file."""
UNFOLDED = 60
"""Lines up to which a listing is open."""
SHORT = 24
"""Letters of a source that stands in its row."""
INCH = 25.4
"""Inch [mm]."""
_WORDS = re.compile(r"([FS]\s*[-+]?[0-9.]+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")


@dataclass(frozen=True, kw_only=True)
class Increase:
    """Changes that are alike, and what of F, S and feed per tooth rose most, by which factor."""

    lines: str
    change: FeedChange
    what: str
    factor: float


def increases(changes: Sequence[FeedChange]) -> list[Increase]:
    """Increases, the largest factor first, equal ones together; of a move in air F alone counts."""
    alike: dict[tuple[object, ...], list[FeedChange]] = {}
    for change in changes:
        key = (
            change.tool, change.operation, change.feed_before, change.feed_after,
            change.speed_before, change.speed_after, change.binds,
        )  # fmt: skip
        alike.setdefault(key, []).append(change)
    rows = []
    for same in alike.values():
        most = max(same, key=lambda change: max(_factors(change).values()))
        what, factor = max(_factors(most).items(), key=lambda pair: pair[1])
        if factor > 1 + LEAST:
            lines = (n for change in same for n in range(change.first_line, change.last_line + 1))
            spans = spans_of(lines)
            more = f" and {len(spans) - MOST_SPANS} more" if len(spans) > MOST_SPANS else ""
            words = ", ".join(spans[:MOST_SPANS]) + more
            rows.append(Increase(lines=words, change=most, what=what, factor=factor))
    return sorted(rows, key=lambda row: (-row.factor, row.change.first_line))


def _factors(change: FeedChange) -> dict[str, float]:
    """Factor of each quantity of a change, those that a chip is made by first."""
    feed = _ratio(change.feed_before, change.feed_after)
    if change.feed_per_tooth_after_mm is None:
        return {"F": feed}
    thicker = _ratio(change.feed_per_tooth_before_mm, change.feed_per_tooth_after_mm)
    return {"fz": thicker, "F": feed, "S": _ratio(change.speed_before, change.speed_after)}


def _ratio(before: float | None, after: float | None) -> float:
    return after / before if before and after else 1.0


def changes_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    """Largest increases, then each tool before and after beside its range, then the program."""
    blocks = present(
        increases_table(part, sources), feeds_table(part, sources), loads_table(part, sources),
        ranges_table(part, sources), listing(part, sources),
    )  # fmt: skip
    if not blocks:
        return None
    kept = [
        (
            ", ".join(filter(None, (f"T{use.tool} {use.name}".strip(), use.operation))),
            f"F and S stay as programmed: {use.kept}.",
        )
        for use in part.tools
        if use.kept
    ]
    return Section(key="changes", title="What changes at the machine", pairs=kept, blocks=blocks)


def increases_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """The largest increases of F, S or feed per tooth."""
    rows = increases(part.changes)
    units = {row.change.feed_unit for row in rows}
    unit = units.pop() if len(units) == 1 else ""
    columns: list[Column[Increase]] = [
        Column("Line", lambda row: row.lines),
        Column("tool", lambda row: f"T{row.change.tool}"),
        Column("operation", lambda row: row.change.operation or NONE),
        Column("most", lambda row: f"{row.what} ×{NARROW}{row.factor:.2f}", ""),
        Column("F", lambda row: _feeds(row.change, unit), unit),
        Column(
            "S", lambda row: _change(_word, row.change.speed_before, row.change.speed_after), ""
        ),
        Column("feed per tooth fz", lambda row: _feeds_per_tooth(row, INCH), "in"),
        Column("feed per tooth fz", _feeds_per_tooth, "mm"),
        Column(
            "what binds", lambda row: limit_name(row.change.binds) if row.change.binds else NONE
        ),
    ]
    if part.unit != "inch":
        del columns[6]
    if not any(row.change.operation for row in rows):
        del columns[2]
    return tabulated(
        "Largest increases: look at these first",
        rows,
        columns,
        sources,
        most=MOST_INCREASES,
        note="Most is what of fz, F and S rose most; of a move in air, which has no fz, F alone "
        "counts. fz is F / (N S) as commanded, with N teeth. F is as the program writes it.",
    )


def _feeds(change: FeedChange, common: str) -> str:
    unit = "" if change.feed_unit == common else f"{NARROW}{change.feed_unit}"
    return _change(_word, change.feed_before, change.feed_after) + unit


def _feeds_per_tooth(row: Increase, unit: float = 1.0) -> str:
    before, after = (
        None if value is None else value / unit
        for value in (row.change.feed_per_tooth_before_mm, row.change.feed_per_tooth_after_mm)
    )
    return _change(figure, before, after)


def _change(shown: Callable[[float | None], str], before: float | None, after: float | None) -> str:
    then, now = shown(before), shown(after)
    return now if then == now else f"{then} → {now}"


def _word(value: float | None) -> str:
    return NONE if value is None else as_stated(round(value, 4))


def feeds_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Feed per tooth and cutting speed of each tool before and after, beside its ranges."""
    faster = any(use.no_faster for use in part.tools)
    marks = lettered(
        reason or "" for use in part.tools
        for reason in (use.no_more_feed, _no_faster(use) if faster else None)
    )  # fmt: skip
    why: list[Column[ToolUse]] = []
    if any(use.no_more_feed for use in part.tools):
        why.append(Column("F not raised", lambda use: _mark(marks, use.no_more_feed)))
    if faster:
        why.append(Column("S not raised", lambda use: _mark(marks, _no_faster(use))))
    return tabulated("Feed and speed by tool, before → after", part.tools, (
        Column("Tool", lambda use: tool_name(use.tool, use.name)),
        *_operations(part),
        Column("feed per tooth fz", _within("feed_per_tooth_mm", "feed_per_tooth_range_mm"), "mm"),
        Column("its largest rise", _rise, "mm"),
        Column("its range", lambda use: _span(use.feed_per_tooth_range_mm), "mm"),
        Column("cutting speed vc",
               _within("cutting_speed_m_min", "cutting_speed_range_m_min"), "m/min"),
        Column("its range", lambda use: _span(use.cutting_speed_range_m_min), "m/min"),
        Column("bending", _both("deflection_um", force), "µm"),
        *why,
        Column("ranges from", lambda use: _source_number(part, use)),
        Column("what binds", lambda use: "kept as programmed" if use.kept else
               limit_name(use.binds) if use.binds else NONE),
    ), sources, note="fz is the greatest of the tool’s blocks at the feed that the control "
        "reaches; its largest rise is that of F / (N S) as commanded, with the line. vc = π D S is "
        "at the greatest diameter that cuts, bending that of the tip at the peak load. What ends "
        "outside of its range is marked: × above, ▲ below. "
        + marks_note(marks),
    )  # fmt: skip


def _no_faster(use: ToolUse) -> str | None:
    return use.kept or use.no_faster


def _mark(marks: Mapping[str, str], reason: str | None) -> str:
    return marks.get(reason, reason) if reason else NONE


def _rise(use: ToolUse) -> str:
    rise = use.rise
    if rise is None:
        return "none"
    return f"{_change(figure, rise.before_mm, rise.after_mm)} in line {rise.line}"


def _named_sources(part: OptimisedPart) -> list[str]:
    """Sources of ranges that are too long for a row, in the order of the tools."""
    return [source for source in dict.fromkeys(use.range_source for use in part.tools)
            if len(source) > SHORT]  # fmt: skip


def _source_number(part: OptimisedPart, use: ToolUse) -> str:
    named = _named_sources(part)
    if use.range_source in named:
        return f"[{named.index(use.range_source) + 1}]"
    return use.range_source or NONE


def ranges_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Sources of the ranges by the number that stands in the rows of the tools."""
    rows = list(enumerate(_named_sources(part), 1))
    return tabulated("Where the ranges are from", rows, (
        Column("Number", lambda row: f"[{row[0]}]"),
        Column("source", lambda row: row[1]),
    ), sources)  # fmt: skip


def loads_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Depths, chip, load, torque, power and life of each tool before and after."""
    return tabulated("Cut by tool, before → after: the worst of its blocks", part.tools, (
        Column("Tool", lambda use: tool_name(use.tool, use.name)),
        *_operations(part),
        Column("depth ap", _both("axial_depth_mm", figure), "mm"),
        Column("width ae", _both("radial_depth_mm", figure), "mm"),
        Column("chip thickness", _both("chip_thickness_mm", figure), "mm"),
        Column("load", _both("peak_load_N", force), "N"),
        Column("torque", _both("torque_Nm", figure), f"N{TOGETHER}m"),
        Column("power", _both("power_kW", figure), "kW"),
        Column("life of one part", lambda use: _both("tool_life_share", share)(use)
               + between(use.after, "tool_life_share", share), ""),
    ), sources, note="Load is the peak across the tool’s axis, torque the mean over a turn; life "
        "is the share of the tool’s life that one part uses.",
    )  # fmt: skip


def _operations(part: OptimisedPart) -> list[Column[ToolUse]]:
    if not any(use.operation for use in part.tools):
        return []
    return [Column("operation", lambda use: use.operation or NONE)]


def _both(key: str, shown: Callable[[float | None], str]) -> Callable[[ToolUse], str]:
    return lambda use: _change(shown, getattr(use.before, key), getattr(use.after, key))


def _within(key: str, span: str) -> Callable[[ToolUse], str | Cell]:
    """The value before and after, marked where it ends outside of its range."""
    both = _both(key, figure)

    def cell(use: ToolUse) -> str | Cell:
        value, known = getattr(use.after, key), getattr(use, span)
        if value is None or known is None:
            return both(use)
        low, high = known
        if low * (1 - LEAST) <= value <= high * (1 + LEAST):
            return both(use)
        return Cell(text=both(use), status="failed" if value > high else "attention")

    return cell


def _span(known: tuple[float, float] | None) -> str:
    if known is None:
        return NONE
    low, high = (as_stated(float(f"{end:.3g}")) for end in known)
    return f"{low}–{high}"


def listing(part: OptimisedPart, sources: list[Source]) -> Listing | None:
    """Lines whose words changed beside what they were, with their neighbours."""
    lines = part.lines[:MOST_LINES]
    if not lines:
        return None
    changed = sum(line.after is not None for line in part.lines)
    caption = f"The program, line by line: {counted(changed, 'line')} changed"
    if len(lines) < len(part.lines):
        caption += f" (the first {number(len(lines))} of {number(len(part.lines))} shown)"
    numbers = [line.line for line in lines]
    gaps = [False, *(b > a + 1 for a, b in pairwise(numbers))]
    return Listing(
        caption=caption, unfolded=len(lines) <= UNFOLDED, sources=sources,
        lines=[_listed(line, gap=gap) for line, gap in zip(lines, gaps, strict=True)],
        note="▲ is more and ▼ less: one up to a quarter, two up to a factor of 2, three beyond. "
        "The bar at the left of a line without a change of its own is what is in force in it; "
        "lines left out have no change of their own.",
    )  # fmt: skip


def _listed(line: ProgramLine, *, gap: bool) -> ListingLine:
    pairs = (
        ("F", line.feed_before, line.feed_after), ("S", line.speed_before, line.speed_after),
    )  # fmt: skip
    sizes = [log(_ratio(before, after)) for _, before, after in pairs]
    greatest, changed = max(sizes, key=abs), line.after is not None
    notes = [
        f"{letter}{NARROW}{_word(before)} → {_word(after)} {_arrows(size)}"
        for (letter, before, after), size in zip(pairs, sizes, strict=True)
        if changed and _steps(size)
    ]
    if changed and not notes:
        notes = ["as before: a line above has other words now"]
    return ListingLine(
        number=line.line, gap=gap, tone=_tone(greatest) + " changed" * changed,
        before=_marked(line.before or "", bold=changed),
        after=_marked(line.after or "", bold=changed), notes=tuple(notes),
    )  # fmt: skip


def _steps(size: float) -> int:
    """Step of a change by the logarithm of its factor: 0 none, to 3 very large."""
    if abs(size) < log(1 + LEAST):
        return 0
    return 1 + sum(abs(size) >= log(step) for step in STEPS)


def _tone(size: float) -> str:
    steps = _steps(size)
    return f"{'more' if size > 0 else 'less'}{steps}" if steps else ""


def _arrows(size: float) -> str:
    return ("▲" if size > 0 else "▼") * _steps(size)


def _marked(text: str, *, bold: bool) -> Markup:
    """The text with its F and S words in bold, but those of comments."""
    if not bold:
        return Markup("{}").format(text)
    parts, at = [], 0
    for comment in [*_COMMENT.finditer(text), None]:
        end = comment.start() if comment else len(text)
        for k, piece in enumerate(_WORDS.split(text[at:end])):
            parts.append(Markup("<b>{}</b>" if k % 2 else "{}").format(piece))
        if comment:
            parts.append(Markup("{}").format(comment.group()))
            at = comment.end()
    return Markup("").join(parts)
