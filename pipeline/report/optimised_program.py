"""Tables of an optimised program for who runs it: by tool, increases, its lines, the set-up."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import log

from markupsafe import Markup

from pipeline.charts.numbers import NARROW, TOGETHER, as_stated, counted, duration, number
from pipeline.charts.sections import Listing, ListingLine, Section, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Column, Table, tabulated
from pipeline.report.cut.tables import NONE, sentence, share, spans_of
from pipeline.report.optimised_tables import figure, limit_name
from pipeline.schema.part import OptimisedPart
from pipeline.schema.part_sheet import FeedChange, ProgramLine, SetupTool, ToolUse, WorkOffset
from pipeline.schema.program_cut import CutWarning

OUTSIDE = 5e-3  # share by which rounding may leave a range
MOST_INCREASES = 12
MOST_SPANS = 6  # stretches of lines that a row names
LEAST = 5e-3  # share: a smaller change is rounding
STEPS = (1.25, 2.0)  # factors from which a change is large, and very large
MOST_LINES = 1500  # of a listing; the whole is in the file
UNFOLDED = 60  # lines up to which a listing is open
MOST_WARNINGS = 8  # on the set-up sheet
_WORDS = re.compile(r"([FS]\s*[-+]?[0-9.]+)")
_COMMENT = re.compile(r"\([^)]*\)|;.*")


def changes_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    """Largest increases, then each tool before and after beside its range, then the program."""
    blocks = present(
        increases_table(part, sources), feeds_table(part, sources), loads_table(part, sources),
        listing(part, sources),
    )  # fmt: skip
    if not blocks:
        return None
    kept = [
        (f"T{use.tool} {use.name}".strip(), f"F and S stay as programmed: {use.kept}.")
        for use in part.tools
        if use.kept
    ]
    return Section(key="changes", title="What changes at the machine", pairs=kept, blocks=blocks)


# increases


@dataclass(frozen=True, kw_only=True)
class Increase:
    """Changes that are alike, and the greatest factor of their F, S and feed per tooth [1]."""

    lines: str
    one: FeedChange
    factor: float


def increases(changes: Sequence[FeedChange]) -> list[Increase]:
    """What got faster or thicker, the largest factor first; changes that are alike are one."""
    alike: dict[tuple[object, ...], list[FeedChange]] = {}
    for one in changes:
        key = (
            one.tool, one.operation, one.feed_before, one.feed_after, one.speed_before,
            one.speed_after, one.binds,
        )  # fmt: skip
        alike.setdefault(key, []).append(one)
    found = []
    for same in alike.values():
        one = max(same, key=_factor)
        if _factor(one) > 1 + LEAST:
            found.append(Increase(lines=_spans(same), one=one, factor=_factor(one)))
    return sorted(found, key=lambda row: (-row.factor, row.one.first_line))


def _spans(changes: Sequence[FeedChange]) -> str:
    lines = (line for one in changes for line in range(one.first_line, one.last_line + 1))
    spans = spans_of(lines)
    more = f" and {len(spans) - MOST_SPANS} more" if len(spans) > MOST_SPANS else ""
    return ", ".join(spans[:MOST_SPANS]) + more


def _factor(one: FeedChange) -> float:
    pairs = (
        (one.feed_before, one.feed_after), (one.speed_before, one.speed_after),
        (one.feed_per_tooth_before_mm, one.feed_per_tooth_after_mm),
    )  # fmt: skip
    return max(_ratio(before, after) for before, after in pairs)


def _ratio(before: float | None, after: float | None) -> float:
    """1 where one of them is not known or nothing."""
    return after / before if before and after else 1.0


def increases_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """The largest increases of F, S or feed per tooth."""
    rows = increases(part.changes)
    operation = any(row.one.operation for row in rows)
    columns: list[Column[Increase]] = [
        Column("Line", lambda row: row.lines),
        Column("tool", lambda row: f"T{row.one.tool}"),
        *([Column("operation", _operation)] if operation else []),
        Column("by", lambda row: f"×{NARROW}{row.factor:.2f}", ""),
        Column("before", lambda row: _feed(row.one, row.one.feed_before), "", "F"),
        Column("after", lambda row: _feed(row.one, row.one.feed_after), "", "F"),
        Column("before", lambda row: _word(row.one.speed_before), "", "S"),
        Column("after", lambda row: _word(row.one.speed_after), "", "S"),
        Column("before", lambda row: figure(row.one.feed_per_tooth_before_mm), "", "fz, mm"),
        Column("after", lambda row: figure(row.one.feed_per_tooth_after_mm), "", "fz, mm"),
        Column("what binds", lambda row: limit_name(row.one.binds) if row.one.binds else NONE),
    ]
    return tabulated(
        "Largest increases: look at these first",
        rows,
        columns,
        sources,
        most=MOST_INCREASES,
        note="By is the greatest factor of F, S and fz. fz is F / (N S) as commanded, with N teeth;"
        " a dash is a move in air. F is in mm/min, or in mm/rev where that stands behind it.",
    )


def _operation(row: Increase) -> str:
    return row.one.operation or NONE


def _feed(one: FeedChange, feed: float) -> str:
    return _word(feed) + (f"{NARROW}mm/rev" if one.feed_unit == "mm/rev" else "")


def _word(value: float | None) -> str:
    return NONE if value is None else as_stated(round(value, 4))


# tools


def feeds_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Feed per tooth and cutting speed of each tool before and after, beside its ranges."""
    f_z, v_c = "feed_per_tooth_mm", "cutting_speed_m_min"
    feed, speed = "Feed per tooth fz, mm", "Cutting speed vc, m/min"
    return tabulated("Feed and speed by tool", part.tools, (
        Column("Tool", _name),
        Column("before", _of("before", f_z), "", feed),
        Column("after", _within(f_z, "feed_per_tooth_range_mm"), "", feed),
        Column("range", lambda use: _span(use.feed_per_tooth_range_mm), "", feed),
        Column("before", _of("before", v_c), "", speed),
        Column("after", _within(v_c, "cutting_speed_range_m_min"), "", speed),
        Column("range", lambda use: _span(use.cutting_speed_range_m_min), "", speed),
        Column("range from", lambda use: use.range_source or NONE),
        Column("what binds", lambda use: "kept as programmed" if use.kept else
               limit_name(use.binds) if use.binds else NONE),
    ), sources, note="fz is the greatest of the tool’s blocks at the feed that the control "
        "reaches, vc = π D S at the full diameter. What lies outside of its range is marked.",
    )  # fmt: skip


def loads_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Depths, chip, load, torque, power and life of each tool before and after."""

    def pair(key: str, head: str, shown: Callable[[float | None], str]) -> list[Column[ToolUse]]:
        return [
            Column("before", lambda use: shown(getattr(use.before, key)), "", head),
            Column("after", lambda use: shown(getattr(use.after, key)), "", head),
        ]

    return tabulated("Cut by tool: the worst of its blocks", part.tools, (
        Column("Tool", _name),
        Column("axial ap", lambda use: figure(use.after.axial_depth_mm), "", "Depth, mm"),
        Column("radial ae", lambda use: figure(use.after.radial_depth_mm), "", "Depth, mm"),
        *pair("chip_thickness_mm", "Chip, mm", figure),
        *pair("peak_load_N", "Load, N", figure),
        *pair("torque_Nm", f"Torque, N{TOGETHER}m", figure),
        *pair("power_kW", "Power, kW", figure),
        *pair("tool_life_share", "Life of one part", share),
    ), sources, note="Depths are those of the path and do not change. Load is the peak across the "
        "tool’s axis, torque the mean over a turn.",
    )  # fmt: skip


def _name(use: ToolUse) -> str:
    return f"T{use.tool} {use.name}".strip()


def _of(which: str, key: str) -> Callable[[ToolUse], str]:
    return lambda use: figure(getattr(getattr(use, which), key))


def _within(key: str, span: str) -> Callable[[ToolUse], str | Cell]:
    """The value after, marked where it is outside of the range."""

    def cell(use: ToolUse) -> str | Cell:
        value, known = getattr(use.after, key), getattr(use, span)
        text = figure(value)
        if value is None or known is None:
            return text
        low, high = known
        if low * (1 - OUTSIDE) <= value <= high * (1 + OUTSIDE):
            return text
        return Cell(text=text, status="failed" if value > high else "attention")

    return cell


def _span(known: tuple[float, float] | None) -> str:
    return NONE if known is None else f"{as_stated(known[0])}–{as_stated(known[1])}"


# lines


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
        note="▲ or ▼ up to a quarter, two up to a factor of 2, three beyond; a line without words "
        "of its own follows those before it. Lines left out are as they were.",
    )  # fmt: skip


def _listed(line: ProgramLine, *, gap: bool) -> ListingLine:
    pairs = (
        ("F", line.feed_before, line.feed_after), ("S", line.speed_before, line.speed_after),
    )  # fmt: skip
    sizes = [log(_ratio(before, after)) for _, before, after in pairs]
    greatest = max(sizes, key=abs)
    same = line.after is None
    return ListingLine(
        number=line.line, gap=gap, tone=_tone(greatest),
        before=_marked("" if line.before is None else line.before, bold=not same),
        after=Markup("") if line.after is None else _marked(line.after, bold=True),
        notes=tuple(
            f"{letter}{NARROW}{_word(before)} → {_word(after)} {_arrows(size)}"
            for (letter, before, after), size in zip(pairs, sizes, strict=True) if _steps(size)
        ),
    )  # fmt: skip


def _steps(size: float) -> int:
    """Of a change, by the logarithm of its factor: 0 none, to 3 very large."""
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


# set-up


def setup_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    """Sheet for the machine: tools, offsets, blank, warnings; one page when printed."""
    sheet = part.setup
    if sheet is None:
        return None
    time = NONE if part.after.time_s is None else duration(part.after.time_s)
    return Section(
        key="setup", title="Set-up sheet",
        text=[f"{part.program} optimised, on {part.machine}: {time}."],
        pairs=[
            ("Blank", f"{part.stock} in {part.material}, in the coordinates of "
             f"{sheet.blank_offset} [mm]."),
            *_warnings(sheet.warnings),
        ],
        blocks=present(
            tabulated("Tools, in the order in which they are called", sheet.tools, TOOLS, sources),
            tabulated("Work offsets, as the program was followed", sheet.offsets, OFFSETS, sources),
        ),
    )  # fmt: skip


TOOLS: tuple[Column[SetupTool], ...] = (
    Column("Tool", lambda row: f"T{row.tool} {row.name}".strip()),
    Column("kind", lambda row: row.kind.replace("_", "-") or NONE),
    Column("diameter", lambda row: _length(row.diameter_mm), "mm"),
    Column("teeth", lambda row: NONE if row.flutes is None else str(row.flutes), ""),
    Column("stickout", lambda row: _length(row.stickout_mm), "mm"),
    Column("length H", lambda row: _length(row.length_mm), "mm"),
    Column("time", lambda row: duration(row.time_s), ""),
    Column("in the cut", lambda row: duration(row.in_material_s), ""),
    Column("life of one part", lambda row: share(row.life_share), ""),
)
OFFSETS: tuple[Column[WorkOffset], ...] = (
    Column("Offset", lambda row: row.name),
    *(
        Column(axis, lambda row, k=k: NONE if row.position_mm is None else  # type: ignore[misc]
               _length(row.position_mm[k]), "mm")
        for k, axis in enumerate("XYZ")
    ),
)  # fmt: skip


def _length(value: float | None) -> str:
    return NONE if value is None else as_stated(round(value, 3)).replace("-", "−")


def _warnings(warnings: Sequence[CutWarning]) -> list[tuple[str, str]]:
    if not warnings:
        return [("Warnings", "None.")]
    found = []
    for one in warnings[:MOST_WARNINGS]:
        spans = spans_of(one.lines)
        where = f" Line {', '.join(spans[:MOST_SPANS])}." if spans else ""
        more = f" And {len(spans) - MOST_SPANS} more." if len(spans) > MOST_SPANS else ""
        found.append((f"Warning: {sentence(one.what)}", f"{one.do}{where}{more}"))
    left = len(warnings) - len(found)
    return found + ([("More warnings", f"{left}, in the JSON.")] if left > 0 else [])
