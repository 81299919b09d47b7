"""Ingested records on disk: observations in Parquet, manifest, rejections, table of recordings."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.schema.files import PART, replacing
from pipeline.schema.store import write_table, write_text
from pipeline.signals.columns import OBSERVATIONS, REJECTED, RUNS, TIME
from pipeline.signals.formats import (
    GZIP_ENDS,
    Batch,
    RecordSource,
    Rejection,
    Trace,
    UnreadableFile,
)

GROUP = 1 << 19
"""Rows that are gathered before a row group is written."""

ENDS_EARLY = "ends_early"
"""Note on a packed file that is cut or damaged."""

MOST_NAMED = 5
"""Data items that a sentence names."""

Entry = dict[str, Any]
"""Entry of one raw file in the manifest."""

_LAYOUT: dict[str, Any] = {
    "compression": "zstd", "compression_level": 1,
    "use_dictionary": ["data_item", "text", "kind", "key", "attributes"],
    "write_statistics": ["time", "sequence", "instance"],
    "column_encoding": {"time": "DELTA_BINARY_PACKED", "sequence": "DELTA_BINARY_PACKED",
                        "number": "PLAIN", "instance": "PLAIN"},
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of one raw file: its entry in the manifest, with the rejections themselves."""

    format: str | None = None
    kept: int = 0
    rows: int = 0
    first: str | None = None
    last: str | None = None
    """First and last time (ISO 8601, UTC); None where times only count from the start."""
    output: str | None = None
    reason: str | None = None
    notes: dict[str, Any] = field(default_factory=dict)
    rejected: list[Rejection] = field(default_factory=list)

    def entry(self, made_from: dict[str, str]) -> Entry:
        """Entry in the manifest of a file that was made from what has these hashes."""
        counts: Entry = {"read": self.kept + len(self.rejected), "rejected": len(self.rejected)}
        ends = [one for one in self.rejected if one.reason.startswith(GZIP_ENDS)]
        if ends and not self.reason:
            said = f"{ends[0].reason}, for all from line {ends[0].line} on is lost"
            counts["notes"] = self.notes | {ENDS_EARLY: said}
        return {**vars(self), **counts, "sha256": made_from["sha256"], "made_from": made_from}


def write_observations(batches: Iterable[Batch], path: Path) -> Outcome:
    """Write the batches of a reader to one Parquet file, which appears when it is whole."""
    rows = kept = 0
    rejected: list[Rejection] = []
    times: list[int] = []

    def tables() -> Iterator[pa.Table]:
        nonlocal kept
        for batch in batches:
            kept += batch.kept
            rejected.extend(batch.rejected)
            yield batch.observations

    with replacing(path) as part, pq.ParquetWriter(part, OBSERVATIONS, **_LAYOUT) as writer:
        for table in _groups(tables()):
            writer.write_table(table, row_group_size=2 * GROUP)
            rows += len(table)
            times += _ends(table)
    first, last = (_iso(min(times)), _iso(max(times))) if times else (None, None)
    return Outcome(kept=kept, rows=rows, first=first, last=last, rejected=rejected)


def write_trace(trace: Trace, path: Path) -> Outcome:
    """Write one trace, with its notes."""
    table = trace.table
    write_table(table, path)
    dated = "time" in table.column_names and table.num_rows > 0
    first, last = map(_iso, _ends(table)) if dated else (None, None)
    return Outcome(
        kept=trace.kept, rows=table.num_rows, first=first, last=last, rejected=trace.rejected,
        notes=json.loads((table.schema.metadata or {}).get(b"notes", b"{}")),
    )  # fmt: skip


def _ends(table: pa.Table) -> tuple[int, int]:
    """Earliest and latest time [ns since 1970] of a table that has rows."""
    ends = pc.min_max(table["time"].cast(pa.int64())).as_py()
    return ends["min"], ends["max"]


def _groups(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Tables joined until they have enough rows for a row group."""
    held: list[pa.Table] = []
    rows = 0
    for table in tables:
        if len(table):
            held.append(table)
            rows += len(table)
        if rows >= GROUP:
            yield _joined(held)
            held, rows = [], 0
    if held:
        yield _joined(held)


def _joined(tables: list[pa.Table]) -> pa.Table:
    return pa.concat_tables(tables).unify_dictionaries() if len(tables) > 1 else tables[0]


def _iso(ns: int) -> str:
    return f"{np.datetime64(ns, 'ns')}Z"


def write_rejected(rejected: Mapping[str, Iterable[Rejection]], path: Path) -> int:
    """Write what could not be read, by the path of the raw file; returns the number of rows."""
    said = [{"file": file, **vars(one)} for file, some in rejected.items() for one in some]
    write_table(pa.Table.from_pylist(said, schema=REJECTED), path)
    return len(said)


LONGEST = 160
"""Bytes of a raw file's name that go into the name of its Parquet; file systems allow 255."""


def read_manifest(out: Path) -> dict[str, Entry]:
    """Entries of the last ingest; none when there is no manifest that can be read."""
    try:
        files: dict[str, Entry] = json.loads((out / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # all is read anew
    return files


def write_manifest(out: Path, content: dict[str, Any]) -> None:
    """Write ``content`` as ``manifest.json``."""
    text = json.dumps(content, indent=1, sort_keys=True) + "\n"
    write_text(text, out / "manifest.json")


def read_rejections(out: Path) -> dict[str, list[Rejection]]:
    """Rejections of the last ingest by raw file; none when they cannot be read."""
    try:
        rows = pq.read_table(out / "rejected.parquet").to_pylist()
    except (OSError, pa.ArrowException):
        return {}  # files that had some are read anew
    found: dict[str, list[Rejection]] = {}
    for row in rows:
        rejection = Rejection(line=row["line"], reason=row["reason"], excerpt=row["excerpt"] or "")
        found.setdefault(row["file"], []).append(rejection)
    return found


def write_runs(out: Path, entries: dict[str, Entry]) -> None:
    """Write ``runs.parquet``: one row a recording that was read."""
    read = [(name, e) for name, e in sorted(entries.items()) if e["output"] is not None]
    keys = ("format", "first", "last", "rows")
    rows = [(Path(name).stem, name, *(e[key] for key in keys)) for name, e in read]
    columns = zip(*rows, strict=True) if rows else [()] * len(RUNS)
    arrays = [
        pa.array(values, pa.string()).cast(one.type)  # times in ISO 8601
        if one.type == TIME
        else pa.array(values, one.type)
        for one, values in zip(RUNS, columns, strict=True)
    ]
    table = pa.table(arrays, names=RUNS.names)
    write_table(table, out / "runs.parquet")


def write_data_items(
    raw: Path, sources: Sequence[RecordSource], out: Path
) -> dict[str, dict[str, Any]]:
    """Write the data items of every Devices document that a source names; report by document."""
    from pipeline.signals.mtconnect.devices import data_items_table, read_devices

    tables, found = [], {}
    for name, device in sorted({(s.devices, s.device) for s in sources if s.devices}, key=str):
        if not (raw / name).exists():
            continue
        said: dict[str, Any] = {"data_items": 0, "reason": None}
        try:
            tables.append(data_items_table(read_devices(raw / name, device)))
            said["data_items"] = tables[-1].num_rows
        except UnreadableFile as error:
            said["reason"] = str(error)
        found[name if device is None else f"{name} {device}"] = said
    target = out / "data_items.parquet"
    if tables:
        write_table(pa.concat_tables(tables), target)
    else:
        target.unlink(missing_ok=True)
    return found


def early_ends(out: Path) -> dict[str, str]:
    """Sentence on each raw file that ends early, by its name."""
    notes = {name: entry.get("notes", {}) for name, entry in read_manifest(out).items()}
    return {name: one[ENDS_EARLY] for name, one in notes.items() if ENDS_EARLY in one}


def strangers_said(out: Path) -> str | None:
    """Sentence on items with values that the Devices documents do not describe, or None."""
    described = out / "data_items.parquet"
    if not described.exists():
        return None
    known = set(pq.read_table(described, columns=["data_item"])["data_item"].to_pylist())
    values: Counter[str] = Counter()
    for path in out.glob("observations/*.parquet"):
        table = pq.read_table(path, columns=["data_item", "number", "text"])
        word = pc.utf8_upper(table["text"].cast(pa.string()))
        spoken = pc.or_kleene(table["number"].is_valid(), pc.not_equal(word, "UNAVAILABLE"))
        items = table["data_item"].filter(pc.fill_null(spoken, False))
        for one in pc.value_counts(items).to_pylist():
            values[str(one["values"])] += one["counts"]
    strange = sorted((item for item in values if item not in known), key=lambda i: -values[i])
    if not strange:
        return None
    some = ", ".join(strange[:MOST_NAMED]) + (" …" if len(strange) > MOST_NAMED else "")
    several = len(strange) > 1
    return (
        f"{len(strange)} item{'s' * several} with {sum(values[i] for i in strange)} values "
        f"{'are' if several else 'is'} not in the Devices document ({some}): is a log of another "
        "machine among these?"
    )


def remove_stale(out: Path, entries: dict[str, Entry]) -> None:
    """Remove the Parquet of raw files that are gone, and what an ingest cut short left behind."""
    wanted = {e["output"] for e in entries.values()}
    for folder in ("observations", "traces"):
        for path in [*(out / folder).glob("*.parquet"), *(out / folder).glob(f".*{PART}")]:
            if f"{folder}/{path.name}" not in wanted:
                path.unlink()


def parquet_name(name: str) -> str:
    """Name of the Parquet of the raw file ``name``: another one for every file.

    >>> parquet_name("agent/2026-01-05.txt")
    'agent__2026-01-05.txt.parquet'
    """
    flat = name.replace("/", "__")
    if flat.replace("__", "/") != name or len(flat.encode()) > LONGEST:
        kept = flat.encode()[:LONGEST].decode(errors="ignore")
        flat = f"{kept}.{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return f"{flat}.parquet"


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
