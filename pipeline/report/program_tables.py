"""The table of all part programs."""

from pipeline.charts.numbers import NOT_KNOWN, duration, number, percent, real
from pipeline.charts.sources import rows_of
from pipeline.charts.tables import MOST_ROWS, Cell, Head, Table, cells, left_out, numbers, sources
from pipeline.report.controlled import Program
from pipeline.report.facts import Facts
from pipeline.report.program_bars import limit_seconds, limit_words

FREE = ("feed", "rapid", "spindle", "nothing")
"""What bounds a block as its programmer asked for."""


def programs_overview_table(found: Facts) -> Table | None:
    """Every program: predicted time, cutting, path, blocks, tools, what binds it beside feed."""
    programs = found.control.programs
    if not programs:
        return None
    refused = any(p.refused for p in programs)
    return Table(
        caption=f"Every part program, the longest first{left_out(len(programs), MOST_ROWS)}",
        heads=[
            Head(name="Program"),
            *numbers(("predicted", ""), ("cutting", ""), ("path", "m"), ("blocks", ""),
                     ("tools", ""), ("at the programmed feed", "")),
            Head(name="else bound most by"),
            *([Head(name="read")] if refused else []),
        ],
        rows=[_row(program)[: None if refused else -1] for program in programs[:MOST_ROWS]],
        sources=sources(found.shelf, *(p.files[0] for p in programs)),
    )  # fmt: skip


def _row(program: Program) -> list[Cell]:
    name = Cell(text=program.name, code=True)
    if program.refused:
        return cells(name, *["–"] * 7, Cell(text="refused", status="failed"))
    document = program.document
    path = real(document.get("path_length_mm"))
    blocks = document.get("blocks")
    limits = limit_seconds(document)
    whole = sum(limits.values())
    other = {k: v for k, v in limits.items() if k not in FREE}
    most = max(sorted(other), key=lambda k: other[k]) if other else ""
    tools = [r for r in rows_of(document, "by_tool") if real(r.get("tool")) not in (None, -1.0)]
    return cells(
        name,
        duration(program.seconds),
        percent(real(document.get("cutting_time_s")), program.seconds),
        NOT_KNOWN if path is None else number(path / 1000),
        number(blocks) if isinstance(blocks, int) else NOT_KNOWN,
        number(len(tools)) if tools else "–",
        percent(limits.get("feed", 0.0), whole) if limits else NOT_KNOWN,
        f"{limit_words(most)}, {percent(other[most], whole)}" if most else "–",
        Cell(text="read", status="passed"),
    )
