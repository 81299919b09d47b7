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
from pipeline.report.optimised_tables import figure, limit_name, plain_words
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
        (
            ", ".join(filter(None, (f"T{use.tool} {use.name}".strip(), use.operation))),
            f"F and S stay as programmed: {use.kept}.",
        )
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
        Column("F", lambda row: _feeds(row.one), ""),
        Column("S", lambda row: _change(_word, row.one.speed_before, row.one.speed_after), ""),
        Column("feed per tooth fz", _feeds_per_tooth, "mm"),
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


def _feeds(one: FeedChange) -> str:
    unit = f"{NARROW}mm/rev" if one.feed_unit == "mm/rev" else ""
    return _change(_word, one.feed_before, one.feed_after) + unit


def _feeds_per_tooth(row: Increase) -> str:
    return _change(figure, row.one.feed_per_tooth_before_mm, row.one.feed_per_tooth_after_mm)


def _change(shown: Callable[[float | None], str], before: float | None, after: float | None) -> str:
    """Value before and after; one where they look the same."""
    then, now = shown(before), shown(after)
    return now if then == now else f"{then} → {now}"


def _word(value: float | None) -> str:
    return NONE if value is None else as_stated(round(value, 4))


# tools


def feeds_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Feed per tooth and cutting speed of each tool before and after, beside its ranges."""
    return tabulated("Feed and speed by tool, before → after", part.tools, (
        Column("Tool", _name),
        *_operations(part),
        Column("feed per tooth fz", _within("feed_per_tooth_mm", "feed_per_tooth_range_mm"), "mm"),
        Column("its range", lambda use: _span(use.feed_per_tooth_range_mm), "mm"),
        Column("cutting speed vc",
               _within("cutting_speed_m_min", "cutting_speed_range_m_min"), "m/min"),
        Column("its range", lambda use: _span(use.cutting_speed_range_m_min), "m/min"),
        Column("ranges from", lambda use: use.range_source or NONE),
        Column("what binds", lambda use: "kept as programmed" if use.kept else
               limit_name(use.binds) if use.binds else NONE),
    ), sources, note="fz is the greatest of the tool’s blocks at the feed that the control "
        "reaches, vc = π D S at the full diameter. What ends outside of its range is marked: × "
        "above, ▲ below.",
    )  # fmt: skip


def loads_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Depths, chip, load, torque, power and life of each tool before and after."""
    return tabulated("Cut by tool, before → after: the worst of its blocks", part.tools, (
        Column("Tool", _name),
        *_operations(part),
        Column("depth ap", _both("axial_depth_mm", figure), "mm"),
        Column("width ae", _both("radial_depth_mm", figure), "mm"),
        Column("chip thickness", _both("chip_thickness_mm", figure), "mm"),
        Column("load", _both("peak_load_N", figure), "N"),
        Column("torque", _both("torque_Nm", figure), f"N{TOGETHER}m"),
        Column("power", _both("power_kW", figure), "kW"),
        Column("life of one part", _both("tool_life_share", share), ""),
    ), sources, note="Load is the peak across the tool’s axis, torque the mean over a turn; life "
        "is the share of the tool’s life that one part uses.",
    )  # fmt: skip


def _operations(part: OptimisedPart) -> list[Column[ToolUse]]:
    """Column of the operations, where they were told apart."""
    told = any(use.operation for use in part.tools)
    return [Column("operation", lambda use: use.operation or NONE)] if told else []


def _name(use: ToolUse | SetupTool) -> Cell:
    return plain_words(f"T{use.tool} {use.name}".strip())


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
        if low * (1 - OUTSIDE) <= value <= high * (1 + OUTSIDE):
            return both(use)
        return Cell(text=both(use), status="failed" if value > high else "attention")

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
    return ListingLine(
        number=line.line, gap=gap, tone=_tone(greatest) + " changed" * changed,
        before=_marked(line.before or "", bold=changed),
        after=_marked(line.after or "", bold=changed), notes=tuple(notes),
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


def setup_section(part: OptimisedPart, sources: list[Source]) -> Section:
    """Sheet for the machine: tools, offsets, blank, warnings; one page when printed."""
    sheet = part.setup
    time = NONE if part.after.time_s is None else duration(part.after.time_s)
    return Section(
        key="setup", title="Set-up sheet",
        text=[f"{part.program} optimised, on {part.machine}: {time}."],
        pairs=[
            ("Blank", f"{_blank(part)} {part.material}; zero is that of {sheet.blank_offset}."),
            *_warnings(sheet.warnings),
        ],
        blocks=present(
            tabulated("Tools, in the order in which they are called", sheet.tools, TOOLS, sources),
            tabulated("Work offsets, as the program was followed", sheet.offsets, OFFSETS, sources),
        ),
    )  # fmt: skip


TOOLS: tuple[Column[SetupTool], ...] = (
    Column("Tool", _name),
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


def _blank(part: OptimisedPart) -> str:
    """Size and place of the blank, as one measures it; as it was named where no path is known."""
    path = part.path
    if path is None:
        return f"{part.stock} [mm] of"
    ends = list(zip(path.blank_low_mm, path.blank_high_mm, strict=True))
    sizes = [_length(high - low) for low, high in ends]
    size = f"Ø {sizes[0]} × {sizes[2]}" if path.round_blank else " × ".join(sizes)
    spans = [f"{axis} {_length(low)} to {_length(high)}"
             for axis, (low, high) in zip("XYZ", ends, strict=True)]  # fmt: skip
    return f"{size}{NARROW}mm ({', '.join(spans)}) of"


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
