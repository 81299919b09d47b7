"""Records read and rejected, values that cleaning removed, and gaps: facts, tables, section."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.numbers import NOT_KNOWN, counted, duration, instant, moment, number, percent
from pipeline.charts.sections import Section, absent, present
from pipeline.charts.sources import SourceRegistry, picked, shown
from pipeline.charts.tables import MOST_ROWS, Cell, Column, code, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.schema.si import DAY, NS
from pipeline.signals.columns import component_words

MOST_BETWEEN_S = 1_800.0
"""Mean time between records [s] up to which a source reports by itself, not by hand."""
WHOLE = "whole record"
ANNOUNCED = "unavailable"  # cause of a gap that the machine itself announced
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
CLEANED = "data/signals observations, by cleaning"
RAW = "the machine’s raw files"
RULES = {
    "zero": "0 between good values",
    "jump": "a change faster than physics",
    "out_of_range": "outside of what is physical, or of what the machine reaches",
    "counter": "a counter that does not fit its neighbours",
    "not_a_number": "a word where a number belongs",
}
"""Meaning of the rules of cleaning, in words."""
CAUSES = {
    "unavailable": "the agent said UNAVAILABLE",
    "silence": "nothing was said for too long",
    "instance": "the agent was restarted",
    "sequence": "the agent’s buffer was overrun",
}
"""Meaning of the causes of gaps, in words."""


@dataclass(frozen=True, kw_only=True)
class FileRead:
    """Raw file by its entry in the manifest; counts are of records, None when missing."""

    sha256: str = ""
    format: str = ""
    read: int | None = None
    kept: int | None = None
    rejected: int | None = None
    first: str | None = None
    last: str | None = None
    reason: str | None = None
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def faults(self) -> list[str]:
        """Faults in its table itself: stamps, jumps, held values, early ends."""
        verbs = {"repeated_stamps": ("repeats the time stamp before it",
                                     "repeat the time stamp before them"),
                 "clock_backwards": ("lies before the row above",
                                     "lie before the row above")}  # fmt: skip
        counts = {k: int(self.notes[k]["count"]) for k in verbs if k in self.notes}
        said = [f"{counted(n, 'row')} {verbs[k][n != 1]}" for k, n in counts.items()]
        early = self.notes.get("ends_early")
        said += [str(early)] if early else []
        return said + [
            f"{one['channel']} {one['said']}" + (": not read there" if one["certain"] else "")
            for one in self.notes.get("faults", ())
        ]

    @property
    def unbalanced(self) -> bool:
        """Whether the counts do not add up: read is not kept + rejected."""
        if self.read is None or self.kept is None or self.rejected is None:
            return False
        return self.read != self.kept + self.rejected


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Reason of rejection, its count and first example; quoted text is left out of it."""

    reason: str
    count: int
    file: str
    line: int | None
    excerpt: str


@dataclass(frozen=True, kw_only=True)
class Gap:
    """A stretch without values of one data item; times in nanoseconds since 1970."""

    data_item: str
    start: int
    end: int
    cause: str

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return (self.end - self.start) / NS


@dataclass(frozen=True, kw_only=True)
class Changed:
    """Values changed by a cleaning rule, ``last`` at [ns, 1970], of the component ``where``."""

    rule: str
    item: str
    count: int
    where: str
    last: int


@dataclass(frozen=True, kw_only=True)
class RecordsRead:
    """Records of a machine; a field is None where the file that it stands in is absent."""

    folders: MachineFolders
    shelf: SourceRegistry
    files: Mapping[str, FileRead] | None
    reasons: list[Reason] | None
    """Reasons of rejections, the most frequent first."""
    changes: list[Changed] | None
    """Removals and changes by cleaning, the most frequent first."""
    gap_causes: list[tuple[str, int, float]] | None
    """Cause, number of gaps, longest [s]."""
    longest_gaps: list[Gap]
    """The ten longest gaps."""
    losses: list[Gap]
    unavailable_since: float | None = None

    @property
    def records(self) -> int:
        """Records read."""
        return sum(f.read or 0 for f in (self.files or {}).values())

    @property
    def rejected(self) -> int:
        """Records rejected."""
        return sum(f.rejected or 0 for f in (self.files or {}).values())

    @property
    def unreadable(self) -> list[str]:
        """Files that could not be read at all."""
        return [name for name, f in (self.files or {}).items() if f.reason and not f.kept]

    @property
    def unbalanced(self) -> list[str]:
        """Files whose counts do not add up."""
        return [name for name, f in (self.files or {}).items() if f.unbalanced]

    @property
    def last(self) -> datetime | None:
        """Time of the newest record, None when no file has a clock."""
        times = [instant(f.last) for f in (self.files or {}).values()]
        return max((t for t in times if t is not None), default=None)

    @property
    def newest(self) -> datetime | None:
        """Time of the newest record of the sources that report over time, else of any."""
        return self.last_live or self.last

    @property
    def last_live(self) -> datetime | None:
        """Time of the newest record of the sources that report over time; None without one."""
        spans: dict[str, list[tuple[datetime, datetime, int]]] = {}
        for name, read in (self.files or {}).items():
            first, last = instant(read.first), instant(read.last)
            if first is not None and last is not None:
                spans.setdefault(source_of(name, read), []).append((first, last, read.kept or 0))
        return max((max(s[1] for s in one) for one in spans.values() if _live(one)), default=None)


def source_of(name: str, read: FileRead) -> str:
    """The source that a file belongs to: its folder below that of the machine, and its format."""
    return f"{name.rpartition('/')[0] or './'} ({read.format or 'unreadable'})"


def _live(files: list[tuple[datetime, datetime, int]]) -> bool:
    """Whether files of (first, last, records) report over time, not once or now and then."""
    span = (max(f[1] for f in files) - min(f[0] for f in files)).total_seconds()
    return span > DAY and span <= MOST_BETWEEN_S * sum(f[2] for f in files)


def records_read(folders: MachineFolders, shelf: SourceRegistry) -> RecordsRead:
    """Manifest, rejected records, audit of cleaning and gaps of a machine."""
    causes, longest, losses, since = _gaps(folders, shelf)
    return RecordsRead(
        folders=folders,
        shelf=shelf,
        files=_files(folders, shelf),
        reasons=_reasons(folders, shelf),
        changes=_changes(folders, shelf),
        gap_causes=causes,
        longest_gaps=longest,
        losses=losses,
        unavailable_since=since,
    )


def _files(folders: MachineFolders, shelf: SourceRegistry) -> dict[str, FileRead] | None:
    """Entries of the manifest; of each only what the page shows."""
    path = folders.signals / "manifest.json"
    manifest = shelf.document(path, RAW)
    if manifest is None:
        return None
    entries = manifest.get("files")
    if not isinstance(entries, dict):
        return None
    try:
        return {name: picked(entries[name], FileRead, name) for name in sorted(entries)}
    except ValueError as error:
        shelf.broken[shown(path)] = f"not JSON of a manifest: {error}"
        return None


def _reasons(folders: MachineFolders, shelf: SourceRegistry) -> list[Reason] | None:
    columns = ("file", "line", "reason", "excerpt")
    table = shelf.table(folders.signals / "rejected.parquet", columns, RAW)
    if table is None:
        return None
    found: dict[str, Reason] = {}
    words = pc.fill_null(table.column("reason"), "").to_numpy(zero_copy_only=False).astype(str)
    exact, first, counts = np.unique(words, return_index=True, return_counts=True)
    for i in np.argsort(first):
        word = QUOTED.sub("‘…’", str(exact[i]))
        if word in found:
            found[word] = replace(found[word], count=found[word].count + int(counts[i]))
            continue
        example = {c: table.column(c)[int(first[i])].as_py() for c in columns}
        found[word] = Reason(
            reason=word,
            count=int(counts[i]),
            file=str(example["file"] or ""),
            line=example["line"],
            excerpt=str(example["excerpt"] or ""),
        )
    return sorted(found.values(), key=lambda r: (-r.count, r.reason))


def _changes(folders: MachineFolders, shelf: SourceRegistry) -> list[Changed] | None:
    """Removals and changes by cleaning, the most frequent first."""
    path = folders.clean / "audit.parquet"
    table = shelf.table(path, ("data_item", "rule", "time"), CLEANED)
    if table is None:
        return None
    plain = {c: table.column(c).cast(pa.string()) for c in ("rule", "data_item")}
    groups = pa.table(plain | {"time": nanoseconds(table.column("time"))})
    rows = groups.group_by(["rule", "data_item"]).aggregate([([], "count_all"), ("time", "max")])
    parts = components(folders, shelf)
    found = [
        Changed(rule=str(r["rule"]), item=str(r["data_item"]), count=int(r["count_all"]),
                where=parts.get(str(r["data_item"]), ("", ""))[1], last=int(r["time_max"]))
        for r in rows.to_pylist()
    ]  # fmt: skip
    return sorted(found, key=lambda one: (-one.count, one.rule, one.item))


def components(folders: MachineFolders, shelf: SourceRegistry) -> Mapping[str, tuple[str, str]]:
    """Category of each data item, and the part of the machine that it belongs to, by its name.

    Of a sample with what it is: "Rotary C, temperature".
    """
    names = ("data_item", "category", "component", "component_name", "type")
    table = shelf.table(folders.signals / "data_items.parquet", names, RAW)
    if table is None:
        return {}
    words = [pc.fill_null(one.cast(pa.string()), "").to_pylist() for one in table.columns]
    return {
        item: (category, component_words(part, name) + f", {_said(kind)}" * (category == "SAMPLE"))
        for item, category, part, name, kind in zip(*words, strict=True)
    }


def _said(kind: str) -> str:
    return kind.lower().replace("_", " ")


def _gaps(
    folders: MachineFolders, shelf: SourceRegistry
) -> tuple[list[tuple[str, int, float]] | None, list[Gap], list[Gap], float | None]:
    """(cause, number of gaps, longest [s]), the longest gaps, the longest unannounced ones.

    The last is since when [s] the agent has said that something is unavailable; None where it has
    not.
    """
    path = folders.clean / "gaps.parquet"
    columns = ("data_item", "start", "end", "cause")
    table = shelf.table(path, columns, CLEANED)
    if table is None:
        return None, [], [], None
    start, end = (nanoseconds(table.column(c)) for c in ("start", "end"))
    closed = (start != np.iinfo(np.int64).min) & (end != np.iinfo(np.int64).min)
    length = np.where(closed, end - start, 0)
    items, causes = (table.column(c).cast(pa.string()).to_pylist() for c in ("data_item", "cause"))
    order = np.argsort(-length, kind="stable")
    longest = [
        Gap(
            data_item=str(items[i] or WHOLE),
            start=int(start[i]),
            end=int(end[i]),
            cause=str(causes[i]),
        )
        for i in order
        if length[i] > 0
    ]
    named = np.array([str(c) for c in causes])
    summary = [
        (str(c), int((named == c).sum()), float(length[named == c].max()) / NS)
        for c in np.unique(named)
    ]
    lasting = start[(named == ANNOUNCED) & (end == np.iinfo(np.int64).min)]
    since = float(lasting.max()) / NS if len(lasting) else None
    return summary, longest[:10], [g for g in longest if g.cause != ANNOUNCED][:10], since


def nanoseconds(column: pa.ChunkedArray) -> np.ndarray:
    """A time column as int64 nanoseconds since 1970; null becomes the smallest int64."""
    kind = column.type
    zone = kind.tz if pa.types.is_timestamp(kind) else "UTC"
    whole = column.cast(pa.timestamp("ns", tz=zone)).cast(pa.int64())
    return pc.fill_null(whole, np.iinfo(np.int64).min).to_numpy()


FILES: tuple[Column[tuple[str, FileRead]], ...] = (
    Column("File", lambda one: code(one[0])),
    Column("format", lambda one: one[1].format or "–"),
    Column("sha256", lambda one: code(one[1].sha256[:12] or NOT_KNOWN)),
    Column("read", lambda one: number(one[1].read), ""),
    Column("kept", lambda one: number(one[1].kept), ""),
    Column("rejected", lambda one: number(one[1].rejected), ""),
    Column("share", lambda one: percent(one[1].rejected, one[1].read), ""),
    Column("first record", lambda one: moment(one[1].first)),
    Column("last record", lambda one: moment(one[1].last)),
    Column("unreadable because", lambda one: (
        Cell(text=one[1].reason, status="failed") if one[1].reason else "–"
    )),
)  # fmt: skip
FAULTS: tuple[Column[tuple[str, str]], ...] = (
    Column("File", lambda one: code(one[0])),
    Column("what it shows", lambda one: one[1]),
)
REASONS: tuple[Column[Reason], ...] = (
    Column("Reason", lambda r: r.reason or "(no reason given)"),
    Column("records", lambda r: number(r.count), ""),
    Column(
        "first seen in", lambda r: code(r.file if r.line is None else f"{r.file}, line {r.line}")
    ),
    Column("begins", lambda r: code(r.excerpt[:120] or "–")),
)
CHANGES: tuple[Column[Changed], ...] = (
    Column("Rule", lambda change: change.rule),
    Column("means", lambda change: RULES.get(change.rule, "–")),
    Column("data item", lambda change: code(change.item)),
    Column("where", lambda change: change.where or "–"),
    Column("values", lambda change: number(change.count), ""),
    Column("last", lambda change: moment(change.last)),
)
GAP_CAUSES: tuple[Column[tuple[str, int, float]], ...] = (
    Column("Cause", lambda cause: cause[0]),
    Column("means", lambda cause: CAUSES.get(cause[0], "–")),
    Column("gaps", lambda cause: number(cause[1]), ""),
    Column("longest", lambda cause: duration(cause[2]), ""),
)
LONGEST_GAPS: tuple[Column[Gap], ...] = (
    Column("Data item", lambda gap: code(gap.data_item)),
    Column("cause", lambda gap: gap.cause),
    Column("from", lambda gap: moment(gap.start)),
    Column("to", lambda gap: moment(gap.end)),
    Column("lasted", lambda gap: duration(gap.seconds), ""),
)


def records_section(r: RecordsRead) -> Section:
    """Records read and rejected, with the reasons; values removed, gaps."""
    title = "What was read, and what was not"
    paths = [
        r.folders.signals / "manifest.json", r.folders.signals / "rejected.parquet",
        r.folders.clean / "audit.parquet", r.folders.clean / "gaps.parquet",
    ]  # fmt: skip
    if r.files is None:
        return Section(key="records", title=title, text=[absent(
            paths[0],
            "Put the machine’s log, or its tables, under data/raw and name them in conf/machine/.",
        )])  # fmt: skip
    text = [
        f"{counted(len(r.files), 'file')} with {number(r.records)} records: "
        f"{number(r.records - r.rejected)} kept, {number(r.rejected)} rejected. "
        + ("Read equals kept plus rejected in every file." if not r.unbalanced else
           f"In {counted(len(r.unbalanced), 'file')} read is not kept plus rejected.")
    ]  # fmt: skip
    contents = (r.reasons, r.changes, r.gap_causes)
    unknown = "why records were rejected", "what cleaning changed", "where the record has gaps"
    for content, path, words in zip(contents, paths[1:], unknown, strict=True):
        if content is None:
            text.append(absent(path, f"Without it nobody knows {words}."))
    manifest, rejected, audit, gaps = (sources(r.shelf, path) for path in paths)
    files = list(r.files.items())
    faults = [(name, said) for name, one in files for said in one.faults]
    longest = f"The {len(r.longest_gaps)} longest gaps"
    blocks = present(
        tabulated("Why records were rejected", r.reasons, REASONS, rejected, most=12),
        tabulated("Faults of recorders", faults, FAULTS, manifest, most=MOST_ROWS),
        tabulated("Every raw file", files, FILES, manifest, most=MOST_ROWS, folded=True),
        tabulated("Values removed or changed by cleaning", r.changes, CHANGES, audit, most=15),
        tabulated("Gaps by cause, all data items together", r.gap_causes, GAP_CAUSES, gaps),
        tabulated(longest, r.longest_gaps, LONGEST_GAPS, gaps, folded=True),
    )
    return Section(key="records", title=title, text=text, blocks=blocks)
