"""Set-up sheet of an optimised program, and its warnings; one page when printed."""

from collections.abc import Sequence

from pipeline.charts.numbers import NARROW, as_stated, duration
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Column, tabulated
from pipeline.report.cut.tables import NONE, between, sentence, share, spans_of
from pipeline.report.optimised_tables import tool_name
from pipeline.schema.part import OptimisedPart
from pipeline.schema.part_sheet import SetupTool, WorkOffset
from pipeline.schema.program_cut import CutWarning

MOST_WARNINGS = 8
MOST_SPANS = 6  # stretches of lines that a warning names


def warnings_section(warnings: Sequence[CutWarning]) -> Section | None:
    """What to look at before anything else; it stands before all other sections."""
    if not warnings:
        return None
    return Section(key="warnings", title="Look at this first", pairs=_warnings(warnings))


def setup_section(part: OptimisedPart, sources: list[Source]) -> Section:
    """Sheet for the machine: tools, offsets, blank, warnings; one page when printed."""
    sheet = part.setup
    time = NONE if part.after.time_s is None else duration(part.after.time_s)
    return Section(
        key="setup", title="Set-up sheet",
        text=[f"{part.program} optimised, on {part.machine}: {time}."],
        pairs=[
            ("Blank", f"{_blank(part)} {part.material}; zero is that of {sheet.blank_offset}."),
            *(_warnings(sheet.warnings) or [("Warnings", "None.")]),
        ],
        blocks=present(
            tabulated("Tools, in the order in which they are called", sheet.tools, TOOLS, sources),
            tabulated("Work offsets, as the program was followed", sheet.offsets, OFFSETS, sources),
        ),
    )  # fmt: skip


TOOLS: tuple[Column[SetupTool], ...] = (
    Column("Tool", lambda row: tool_name(row.tool, row.name)),
    Column("kind", lambda row: row.kind.replace("_", "-") or NONE),
    Column("diameter", lambda row: _length(row.diameter_mm), "mm"),
    Column("teeth", lambda row: NONE if row.flutes is None else str(row.flutes), ""),
    Column("stickout", lambda row: _length(row.stickout_mm), "mm"),
    Column("length H", lambda row: _length(row.length_mm), "mm"),
    Column("time", lambda row: duration(row.time_s), ""),
    Column("in the cut", lambda row: duration(row.in_material_s), ""),
    Column("life of one part",
           lambda row: share(row.life_share) + between(row, "life_share", share), ""),
)  # fmt: skip
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
    found = []
    for one in warnings[:MOST_WARNINGS]:
        spans = spans_of(one.lines)
        where = f" Line {', '.join(spans[:MOST_SPANS])}" if spans else ""
        more = f" and {len(spans) - MOST_SPANS} more stretches" * (len(spans) > MOST_SPANS)
        end = "." if spans else ""
        found.append((f"Warning: {sentence(one.what)}", f"{one.do}{where}{more}{end}"))
    left = len(warnings) - len(found)
    return found + ([("More warnings", f"{left}, in the JSON.")] if left > 0 else [])
