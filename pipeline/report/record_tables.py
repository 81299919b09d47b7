"""Tables of what was read and what was not: files, reasons, cleaning, gaps."""

from pipeline.charts.numbers import NOT_KNOWN, duration, moment, number, percent
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.report.facts import Facts
from pipeline.report.reading import RULES


def files_table(found: Facts) -> Table | None:
    """Every raw file: what was read of it and what was not."""
    files = found.reading.files
    if not files:
        return None
    rows = [
        cells(
            Cell(text=f.file, code=True), f.format or "–",
            Cell(text=f.sha256[:12] or NOT_KNOWN, code=True), number(f.read), number(f.kept),
            number(f.rejected), percent(f.rejected, f.read), moment(f.first), moment(f.last),
            Cell(text=f.reason, status="failed") if f.reason else "–",
        )
        for f in files[:MOST_ROWS]
    ]  # fmt: skip
    return Table(
        caption=f"Every raw file{left_out(len(files), MOST_ROWS)}",
        heads=[*names("File", "format", "sha256"), *numbers(
            ("read", ""), ("kept", ""), ("rejected", ""), ("share", ""),
        ), *names("first record", "last record", "unreadable because")],
        rows=rows,
        sources=sources(found.shelf, found.folders.signals / "manifest.json"),
        folded=True,
    )  # fmt: skip


def reasons_table(found: Facts) -> Table | None:
    """Why records were rejected, the most frequent reasons first."""
    reasons = found.reading.reasons
    if not reasons:
        return None
    rows = [
        cells(
            r.reason or "(no reason given)", number(r.count),
            Cell(text=f"{r.file}, line {r.line}" if r.line is not None else r.file, code=True),
            Cell(text=r.excerpt[:120] or "–", code=True),
        )
        for r in reasons[:12]
    ]  # fmt: skip
    return Table(
        caption=f"Why records were rejected{left_out(len(reasons), 12)}",
        heads=[Head(name="Reason"), *numbers(("records", "")), *names("first seen in", "begins")],
        rows=rows,
        sources=sources(found.shelf, found.folders.signals / "rejected.parquet"),
    )


def cleaning_table(found: Facts) -> Table | None:
    """Values that cleaning removed or changed, by rule and data item."""
    changes = found.reading.changes
    if not changes:
        return None
    return Table(
        caption=f"Values removed or changed by cleaning{left_out(len(changes), 15)}",
        heads=[*names("Rule", "means", "data item"), *numbers(("values", ""))],
        rows=[
            cells(rule, RULES.get(rule, "–"), Cell(text=item, code=True), number(n))
            for rule, item, n in changes[:15]
        ],
        sources=sources(found.shelf, found.folders.clean / "audit.parquet"),
    )


CAUSES = {
    "unavailable": "the agent said UNAVAILABLE",
    "silence": "nothing was said for too long",
    "instance": "the agent was restarted",
    "sequence": "the agent’s buffer was overrun",
}


def gap_causes_table(found: Facts) -> Table | None:
    """Gaps by cause."""
    causes = found.reading.gap_causes
    if not causes:
        return None
    return Table(
        caption="Gaps by cause, all data items together",
        heads=[*names("Cause", "means"), *numbers(("gaps", ""), ("longest", ""))],
        rows=[
            cells(c, CAUSES.get(c, "–"), number(n), duration(longest)) for c, n, longest in causes
        ],
        sources=sources(found.shelf, found.folders.clean / "gaps.parquet"),
    )


def longest_gaps_table(found: Facts) -> Table | None:
    """The ten longest gaps."""
    gaps = found.reading.longest_gaps
    if not gaps:
        return None
    return Table(
        caption=f"The {len(gaps)} longest gaps",
        heads=[*names("Data item", "cause", "from", "to"), *numbers(("lasted", ""))],
        rows=[
            cells(
                Cell(text=g.data_item, code=True), g.cause, moment(g.start), moment(g.end),
                duration(g.seconds),
            )
            for g in gaps
        ],
        sources=sources(found.shelf, found.folders.clean / "gaps.parquet"),
        folded=True,
    )  # fmt: skip
