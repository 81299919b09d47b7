"""Last record of each source of a machine, so that one that fell silent is seen."""

from dataclasses import dataclass

from pipeline.charts.numbers import counted, duration, instant, moment, number
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.report.facts import MachineFacts
from pipeline.report.records import NS, source_of

LOG = "Machine’s log (execution state)"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """One source: its files, its last record [s] since 1970 (None without a clock)."""

    name: str
    files: int
    last: float | None
    silent: float | None = None


def origins(facts: MachineFacts) -> list[Origin]:
    """Sources by folder and format of their files, the machine's own log at the head."""
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
    log = [Origin(name=LOG, files=len(facts.work.state_files), last=end, silent=facts.silence)]
    return [*(log if end is not None else []), *clocked]


COLUMNS: tuple[Column[Origin], ...] = (
    Column("Source", lambda one: one.name),
    Column("files", lambda one: number(one.files), ""),
    Column("last record", lambda one: moment(None if one.last is None else int(one.last * NS))),
    Column("state", lambda one: (
        Cell(text=f"silent: ends {duration(one.silent)} before live ones", status="failed")
        if one.silent is not None else "–"
    )),
)  # fmt: skip


def last_records_table(facts: MachineFacts) -> Table | None:
    """Last record of each source with a clock; the caption says how many have none."""
    shown = origins(facts)
    clocked = sum(one.files for one in shown if one.name != LOG)
    bare = len(facts.records.files or {}) - clocked
    rest = f"; {counted(bare, 'file')} without a clock" if bare > 0 else ""
    made = sources(facts.shelf, facts.folders.signals / "manifest.json")
    return tabulated(f"Last record of each source{rest}", shown, COLUMNS, made, most=8)
