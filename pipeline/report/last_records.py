"""Last record of each source of a machine, so that one that fell silent is seen."""

from dataclasses import dataclass

from pipeline.charts.numbers import instant
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.report.facts import MachineFacts
from pipeline.report.records import source_of
from pipeline.report.texts import Texts
from pipeline.schema.si import NS

MOST_SOURCES = 8


@dataclass(frozen=True, kw_only=True)
class Origin:
    """One source: its files, its last record [s] since 1970 (None without a clock)."""

    name: str
    files: int
    last: float | None
    silent: float | None = None
    off: bool = False


def origins(facts: MachineFacts, log_name: str) -> list[Origin]:
    """Sources by folder and format of their files, the machine's own log first."""
    found: dict[str, list[float | None]] = {}
    for name, read in (facts.records.files or {}).items():
        when = instant(read.last)
        stamp = None if when is None else when.timestamp()
        found.setdefault(source_of(name, read), []).append(stamp)
    each = [
        Origin(
            name=name, files=len(ends), last=max((e for e in ends if e is not None), default=None)
        )
        for name, ends in found.items()
    ]  # fmt: skip
    clocked = sorted(
        (one for one in each if one.last is not None), key=lambda one: -(one.last or 0)
    )
    end = facts.work.last
    log = [
        Origin(
            name=log_name, files=len(facts.work.state_files), last=end, silent=facts.silence,
            off=facts.off,
        )
    ]  # fmt: skip
    return [*(log if end is not None else []), *clocked]


def columns(say: Texts) -> tuple[Column[Origin], ...]:
    """Columns of the table."""
    return (
        Column(say("last.source"), lambda one: one.name),
        Column(say("last.files"), lambda one: say.number(one.files), ""),
        Column(say("last.record"), lambda one: (
            say.moment(None if one.last is None else int(one.last * NS))
        )),
        Column(say("last.state"), lambda one: (
            Cell(text=say("last.silent", duration=say.duration(one.silent)), status="failed")
            if one.silent is not None else say("last.off") if one.off else "–"
        )),
    )  # fmt: skip


def last_records_table(facts: MachineFacts, say: Texts) -> Table | None:
    """Last record of each source with a clock; the caption says how many have none."""
    log = say("last.log")
    shown = origins(facts, log)
    clocked = sum(one.files for one in shown if one.name != log)
    bare = len(facts.records.files or {}) - clocked
    caption = say("last.table_bare", count=bare) if bare > 0 else say("last.table")
    made = sources(facts.shelf, facts.folders.signals / "manifest.json")
    return tabulated(caption, shown[:MOST_SOURCES], columns(say), made)
