"""Facts about what was read: files, rejected records, cleaning by rule, gaps."""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.numbers import instant
from pipeline.charts.sources import Shelf, dig
from pipeline.report.folders import MachineFolders

NS = 1_000_000_000
WHOLE = "whole record"
ANNOUNCED = "unavailable"  # cause of a gap of which the machine itself said so
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")


RULES = {
    "zero": "0 between good values",
    "jump": "a change faster than physics",
    "out_of_range": "outside of what is physical",
    "counter": "a counter that does not fit its neighbours",
    "not_a_number": "a word where a number belongs",
}
"""What the rules of cleaning mean, for people."""


def rule_words(rule: str) -> str:
    """A rule of cleaning in words; its own name when it is not known here."""
    return RULES.get(rule, rule)


@dataclass(frozen=True, kw_only=True)
class FileRead:
    """One raw file as the manifest has it; counts are records, None when not said."""

    file: str
    sha256: str
    format: str
    read: int | None
    kept: int | None
    rejected: int | None
    first: Any
    last: Any
    reason: str


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Why records were rejected, how often, and the first of them as an example.

    Reasons that differ only in what they quote are one reason.
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
class Reading:
    """What was read of a machine; None where the file that would say it is absent."""

    files: list[FileRead] | None
    reasons: list[Reason] | None
    changes: list[tuple[str, str, int]] | None
    gap_causes: list[tuple[str, int, float]] | None
    longest_gaps: list[Gap]
    losses: list[Gap]

    @property
    def records(self) -> int:
        """Records read."""
        return sum(f.read or 0 for f in self.files or [])

    @property
    def rejected(self) -> int:
        """Records rejected."""
        return sum(f.rejected or 0 for f in self.files or [])

    @property
    def unreadable(self) -> list[FileRead]:
        """Files of which nothing could be read."""
        return [f for f in self.files or [] if f.reason and not f.kept]

    @property
    def unbalanced(self) -> list[FileRead]:
        """Files whose counts do not add up: read is not kept + rejected."""
        return [
            f for f in self.files or []
            if None not in (f.read, f.kept, f.rejected) and f.read != f.kept + f.rejected  # type: ignore[operator]
        ]  # fmt: skip

    @property
    def last(self) -> Any:
        """Time of the newest record, None when no file has a clock."""
        times = [t for t in (instant(f.last) for f in self.files or []) if t is not None]
        return max(times) if times else None


def reading(folders: MachineFolders, shelf: Shelf) -> Reading:
    """What the manifest, the rejected records, the audit and the gaps say."""
    causes, longest, losses = _gaps(folders, shelf)
    return Reading(
        files=_files(folders, shelf),
        reasons=_reasons(folders, shelf),
        changes=_changes(folders, shelf),
        gap_causes=causes,
        longest_gaps=longest,
        losses=losses,
    )


def _files(folders: MachineFolders, shelf: Shelf) -> list[FileRead] | None:
    manifest = shelf.document(folders.signals / "manifest.json", "the machine’s raw files")
    files = dig(manifest, "files")
    if not isinstance(files, dict):
        return None
    return [_file(name, entry) for name, entry in sorted(files.items()) if isinstance(entry, dict)]


def _file(name: str, entry: dict[str, Any]) -> FileRead:
    def count(key: str) -> int | None:
        value = entry.get(key)
        return value if isinstance(value, int) and not isinstance(value, bool) else None

    return FileRead(
        file=name,
        sha256=str(entry.get("sha256") or ""),
        format=str(entry.get("format") or ""),
        read=count("read"),
        kept=count("kept"),
        rejected=count("rejected"),
        first=entry.get("first"),
        last=entry.get("last"),
        reason=str(entry.get("reason") or ""),
    )


def _reasons(folders: MachineFolders, shelf: Shelf) -> list[Reason] | None:
    columns = ("file", "line", "reason", "excerpt")
    table = shelf.table(folders.signals / "rejected.parquet", columns, "the machine’s raw files")
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


def _changes(folders: MachineFolders, shelf: Shelf) -> list[tuple[str, str, int]] | None:
    """(rule, data item, changes), the most frequent first."""
    path = folders.clean / "audit.parquet"
    table = shelf.table(path, ("data_item", "rule"), "data/signals observations, by cleaning")
    if table is None:
        return None
    plain = pa.table({c: table.column(c).cast(pa.string()) for c in ("rule", "data_item")})
    counts = plain.group_by(["rule", "data_item"]).aggregate([([], "count_all")]).to_pylist()
    rows = [(str(r["rule"]), str(r["data_item"]), int(r["count_all"])) for r in counts]
    return sorted(rows, key=lambda r: (-r[2], r[0], r[1]))


def _gaps(
    folders: MachineFolders, shelf: Shelf
) -> tuple[list[tuple[str, int, float]] | None, list[Gap], list[Gap]]:
    """(cause, number of gaps, longest [s]), the longest gaps, the longest unannounced ones."""
    path = folders.clean / "gaps.parquet"
    columns = ("data_item", "start", "end", "cause")
    table = shelf.table(path, columns, "data/signals observations, by cleaning")
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
