"""Records read and rejected, values that cleaning removed, and gaps: facts, tables, section."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.numbers import NOT_KNOWN, counted, duration, instant, moment, number, percent
from pipeline.charts.sections import Section, absent, present
from pipeline.charts.sources import SourceRegistry, picked, shown
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
from pipeline.report.folders import MachineFolders

NS = 1_000_000_000
WHOLE = "whole record"
ANNOUNCED = "unavailable"  # cause of a gap that the machine itself announced
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
CLEANED = "data/signals observations, by cleaning"
RAW = "the machine’s raw files"
RULES = {
    "zero": "0 between good values",
    "jump": "a change faster than physics",
    "out_of_range": "outside of what is physical",
    "counter": "a counter that does not fit its neighbours",
    "not_a_number": "a word where a number belongs",
}
"""Meaning of the rules of cleaning, for people."""
CAUSES = {
    "unavailable": "the agent said UNAVAILABLE",
    "silence": "nothing was said for too long",
    "instance": "the agent was restarted",
    "sequence": "the agent’s buffer was overrun",
}
"""Meaning of the causes of gaps, for people."""


def rule_words(rule: str) -> str:
    """A rule of cleaning in words; its own name when it is not listed here."""
    return RULES.get(rule, rule)


@dataclass(frozen=True, kw_only=True)
class FileRead:
    """One raw file by its entry in the manifest; counts are of records, None when not known."""

    sha256: str = ""
    format: str = ""
    read: int | None = None
    kept: int | None = None
    rejected: int | None = None
    first: str | None = None
    last: str | None = None
    reason: str | None = None

    @property
    def unbalanced(self) -> bool:
        """Whether the counts do not add up: read is not kept + rejected."""
        if self.read is None or self.kept is None or self.rejected is None:
            return False
        return self.read != self.kept + self.rejected


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Why records were rejected, how often, and the first of them as an example.

    Reasons that differ only in the text that they quote are one reason.
    """

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
class RecordsRead:
    """Records of a machine; a field is None where the file that it stands in is absent.

    Parameters
    ----------
    folders : MachineFolders
        Of the machine.
    shelf : SourceRegistry
        Through which its files are read.
    files : mapping of str to FileRead, or None
        Raw files by name.
    reasons : list of Reason, or None
        Of rejections, the most frequent first.
    changes : list of (str, str, int), or None
        Rule of cleaning, data item, values that it removed or changed; the most frequent first.
    gap_causes : list of (str, int, float), or None
        Cause, number of gaps, longest [s].
    longest_gaps, losses : list of Gap
        The ten longest, and the ten longest that the machine did not announce.
    """

    folders: MachineFolders
    shelf: SourceRegistry
    files: Mapping[str, FileRead] | None
    reasons: list[Reason] | None
    changes: list[tuple[str, str, int]] | None
    gap_causes: list[tuple[str, int, float]] | None
    longest_gaps: list[Gap]
    losses: list[Gap]

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


def records_read(folders: MachineFolders, shelf: SourceRegistry) -> RecordsRead:
    """Manifest, rejected records, audit of cleaning and gaps of a machine."""
    causes, longest, losses = _gaps(folders, shelf)
    return RecordsRead(
        folders=folders,
        shelf=shelf,
        files=_files(folders, shelf),
        reasons=_reasons(folders, shelf),
        changes=_changes(folders, shelf),
        gap_causes=causes,
        longest_gaps=longest,
        losses=losses,
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


def _changes(folders: MachineFolders, shelf: SourceRegistry) -> list[tuple[str, str, int]] | None:
    """(rule, data item, changes), the most frequent first."""
    path = folders.clean / "audit.parquet"
    table = shelf.table(path, ("data_item", "rule"), CLEANED)
    if table is None:
        return None
    plain = pa.table({c: table.column(c).cast(pa.string()) for c in ("rule", "data_item")})
    counts = plain.group_by(["rule", "data_item"]).aggregate([([], "count_all")]).to_pylist()
    rows = [(str(r["rule"]), str(r["data_item"]), int(r["count_all"])) for r in counts]
    return sorted(rows, key=lambda r: (-r[2], r[0], r[1]))


def _gaps(
    folders: MachineFolders, shelf: SourceRegistry
) -> tuple[list[tuple[str, int, float]] | None, list[Gap], list[Gap]]:
    """(cause, number of gaps, longest [s]), the longest gaps, the longest unannounced ones."""
    path = folders.clean / "gaps.parquet"
    columns = ("data_item", "start", "end", "cause")
    table = shelf.table(path, columns, CLEANED)
    if table is None:
        return None, [], []
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
    return summary, longest[:10], [g for g in longest if g.cause != ANNOUNCED][:10]


def nanoseconds(column: pa.ChunkedArray) -> np.ndarray:
    """A time column as int64 nanoseconds since 1970; null becomes the smallest int64."""
    kind = column.type
    zone = kind.tz if pa.types.is_timestamp(kind) else "UTC"
    whole = column.cast(pa.timestamp("ns", tz=zone)).cast(pa.int64())
    return pc.fill_null(whole, np.iinfo(np.int64).min).to_numpy()


def records_section(r: RecordsRead) -> Section:
    """Records read and rejected, with the reasons; values removed, gaps."""
    title = "What was read, and what was not"
    if r.files is None:
        return Section(key="records", title=title, text=[absent(
            r.folders.signals / "manifest.json",
            "Put the machine’s log, or its tables, under data/raw and name them in conf/machine/.",
        )])  # fmt: skip
    text = [
        f"{counted(len(r.files), 'file')} with {number(r.records)} records: "
        f"{number(r.records - r.rejected)} kept, {number(r.rejected)} rejected. "
        + ("Read equals kept plus rejected in every file." if not r.unbalanced else
           f"In {counted(len(r.unbalanced), 'file')} read is not kept plus rejected.")
    ]  # fmt: skip
    for content, path, words in (
        (r.reasons, r.folders.signals / "rejected.parquet", "why records were rejected"),
        (r.changes, r.folders.clean / "audit.parquet", "what cleaning changed"),
        (r.gap_causes, r.folders.clean / "gaps.parquet", "where the record has gaps"),
    ):
        if content is None:
            text.append(absent(path, f"Without it nobody knows {words}."))
    blocks = present(
        _reasons_table(r), _files_table(r), _cleaning_table(r), _gap_causes_table(r),
        _longest_gaps_table(r),
    )  # fmt: skip
    return Section(key="records", title=title, text=text, blocks=blocks)


def _files_table(read: RecordsRead) -> Table | None:
    """Every raw file: what was read of it and what was not."""
    files = read.files
    if not files:
        return None
    rows = [
        cells(
            Cell(text=name, code=True), f.format or "–",
            Cell(text=f.sha256[:12] or NOT_KNOWN, code=True), number(f.read), number(f.kept),
            number(f.rejected), percent(f.rejected, f.read), moment(f.first), moment(f.last),
            Cell(text=f.reason, status="failed") if f.reason else "–",
        )
        for name, f in list(files.items())[:MOST_ROWS]
    ]  # fmt: skip
    return Table(
        caption=f"Every raw file{left_out(len(files), MOST_ROWS)}",
        heads=[*names("File", "format", "sha256"), *numbers(
            ("read", ""), ("kept", ""), ("rejected", ""), ("share", ""),
        ), *names("first record", "last record", "unreadable because")],
        rows=rows,
        sources=sources(read.shelf, read.folders.signals / "manifest.json"),
        folded=True,
    )  # fmt: skip


def _reasons_table(read: RecordsRead) -> Table | None:
    """Why records were rejected, the most frequent reasons first."""
    reasons = read.reasons
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
        sources=sources(read.shelf, read.folders.signals / "rejected.parquet"),
    )


def _cleaning_table(read: RecordsRead) -> Table | None:
    """Values that cleaning removed or changed, by rule and data item."""
    changes = read.changes
    if not changes:
        return None
    return Table(
        caption=f"Values removed or changed by cleaning{left_out(len(changes), 15)}",
        heads=[*names("Rule", "means", "data item"), *numbers(("values", ""))],
        rows=[
            cells(rule, RULES.get(rule, "–"), Cell(text=item, code=True), number(n))
            for rule, item, n in changes[:15]
        ],
        sources=sources(read.shelf, read.folders.clean / "audit.parquet"),
    )


def _gap_causes_table(read: RecordsRead) -> Table | None:
    """Gaps by cause."""
    causes = read.gap_causes
    if not causes:
        return None
    return Table(
        caption="Gaps by cause, all data items together",
        heads=[*names("Cause", "means"), *numbers(("gaps", ""), ("longest", ""))],
        rows=[
            cells(c, CAUSES.get(c, "–"), number(n), duration(longest)) for c, n, longest in causes
        ],
        sources=sources(read.shelf, read.folders.clean / "gaps.parquet"),
    )


def _longest_gaps_table(read: RecordsRead) -> Table | None:
    """The ten longest gaps."""
    gaps = read.longest_gaps
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
        sources=sources(read.shelf, read.folders.clean / "gaps.parquet"),
        folded=True,
    )  # fmt: skip
