"""Observations on disk: a Parquet file for each raw file, written as they come."""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.signals.columns import OBSERVATIONS, REJECTED
from pipeline.signals.records import Batch, Rejection

GROUP = 1 << 19
"""Rows that are gathered before a row group is written."""

_WORDS = ["data_item", "text", "kind", "key", "attributes"]

Moment = str | datetime | np.datetime64
"""A point in time; UTC where it names no zone."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """What was written from one raw file.  ``read == kept + rejected``, in records.

    ``first`` and ``last`` are the earliest and latest time (ISO 8601, UTC), None without rows.
    """

    read: int
    kept: int
    rejected: int
    rows: int
    first: str | None
    last: str | None
    rejections: list[Rejection] = field(default_factory=list)


def write_observations(batches: Iterable[Batch], path: Path) -> Written:
    """Write batches to one Parquet file, as they come.

    The file appears under its name when it is whole; what a reader raises leaves no file behind.

    Parameters
    ----------
    batches : iterable of Batch
        As a reader yields them.
    path : Path
        The file; its folder is made where it is missing.

    Returns
    -------
    Written
        Counts, times and rejections.

    Raises
    ------
    ValueError
        When a batch's counts do not add up, or its table is not of ``OBSERVATIONS``.
    """
    rows = 0
    counts = [0, 0]
    rejections: list[Rejection] = []
    times: list[int] = []
    with _appearing(path) as part, pq.ParquetWriter(part, OBSERVATIONS, **_layout()) as writer:
        for table in _groups(_counted(batches, rejections, counts)):
            writer.write_table(table, row_group_size=2 * GROUP)
            rows += len(table)
            ends = pc.min_max(table["time"].cast(pa.int64()))
            times += [ends["min"].as_py(), ends["max"].as_py()]
    read, kept = counts
    return Written(
        read=read,
        kept=kept,
        rejected=len(rejections),
        rows=rows,
        first=_iso(min(times)) if times else None,
        last=_iso(max(times)) if times else None,
        rejections=rejections,
    )


def _layout() -> dict[str, Any]:
    return {
        "compression": "zstd",
        "compression_level": 1,
        "use_dictionary": _WORDS,
        "write_statistics": ["time", "sequence", "instance"],
        "column_encoding": {
            "time": "DELTA_BINARY_PACKED",
            "sequence": "DELTA_BINARY_PACKED",
            "number": "PLAIN",
            "instance": "PLAIN",
        },
    }


@contextmanager
def _appearing(path: Path) -> Iterator[Path]:
    """A name to write to; the file is renamed to ``path`` when all went well, else removed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _counted(
    batches: Iterable[Batch], rejections: list[Rejection], counts: list[int]
) -> Iterator[pa.Table]:
    for number, batch in enumerate(batches):
        if batch.read != batch.kept + len(batch.rejected):
            raise ValueError(
                f"batch {number} read {batch.read} records but kept {batch.kept} and rejected "
                f"{len(batch.rejected)}: its reader loses records"
            )
        if not batch.observations.schema.equals(OBSERVATIONS):
            raise ValueError(f"batch {number} is no table of observations: its columns differ")
        counts[0] += batch.read
        counts[1] += batch.kept
        rejections += batch.rejected
        yield batch.observations


def _groups(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Tables joined until they have enough rows for a row group."""
    held: list[pa.Table] = []
    for table in tables:
        if len(table):
            held.append(table)
        if sum(map(len, held)) >= GROUP:
            yield _joined(held)
            held = []
    if held:
        yield _joined(held)


def _joined(tables: list[pa.Table]) -> pa.Table:
    return pa.concat_tables(tables).unify_dictionaries() if len(tables) > 1 else tables[0]


def _iso(ns: int) -> str:
    return f"{np.datetime64(ns, 'ns')}Z"


def write_rejected(rejected: Mapping[str, Iterable[Rejection]], path: Path) -> int:
    """Write what could not be read, file by file.

    Parameters
    ----------
    rejected : mapping of str to iterables of Rejection
        Path of the raw file below the machine's folder -> its rejections, in order.
    path : Path
        The Parquet file.

    Returns
    -------
    int
        Number of rows.
    """
    said = [
        {"file": file, "line": r.line, "reason": r.reason, "excerpt": r.excerpt}
        for file, some in rejected.items()
        for r in some
    ]
    with _appearing(path) as part:
        pq.write_table(pa.Table.from_pylist(said, schema=REJECTED), part, compression="zstd")
    return len(said)


def read_observations(
    folder: Path,
    items: Iterable[str] | None = None,
    start: Moment | None = None,
    end: Moment | None = None,
) -> pa.Table:
    """All observations of a machine, in the order of time.

    Rows of one time stand in the order of the files' names, then of ``sequence``, then as written.
    Where documents of one agent overlap, a row that has ``instance`` is kept once: rows equal in
    instance, sequence, data_item and key are the same observation.

    Parameters
    ----------
    folder : Path
        ``data/signals/<machine>/observations``.
    items : iterable of str or None
        Data items to keep; None keeps all.
    start, end : str, datetime, datetime64 or None
        ``start <= time < end``.

    Returns
    -------
    pyarrow.Table
        Of ``OBSERVATIONS``.
    """
    wanted = None if items is None else pa.array(list(items), pa.string())
    bounds = [None if m is None else _ns(m) for m in (start, end)]
    tables = [_selected(path, wanted, *bounds) for path in sorted(folder.glob("*.parquet"))]
    if not tables:
        return OBSERVATIONS.empty_table()
    table = pa.concat_tables(tables).unify_dictionaries().combine_chunks()
    of_file = np.repeat(np.arange(len(tables)), [len(t) for t in tables])
    time, sequence = _numpy(table, "time"), _numpy(table, "sequence")
    order = np.lexsort((sequence, of_file, time))
    return table.take(pa.array(order[_first_of_each(table, order)]))


def _numpy(table: pa.Table, name: str) -> Any:
    column = table[name]
    whole = column.cast(pa.int64()) if name == "time" else column
    return whole.to_numpy()


def _ns(moment: Moment) -> int:
    if isinstance(moment, np.datetime64):
        return int(moment.astype("datetime64[ns]").astype(np.int64))
    at = datetime.fromisoformat(moment) if isinstance(moment, str) else moment
    at = at.replace(tzinfo=UTC) if at.tzinfo is None else at
    past = at - datetime(1970, 1, 1, tzinfo=UTC)
    return (past.days * 86400 + past.seconds) * 10**9 + past.microseconds * 1000


def _selected(path: Path, items: pa.Array | None, start: int | None, end: int | None) -> pa.Table:
    """Rows of one file; row groups outside the times are not read."""
    time = pc.field("time")
    conditions = []
    if start is not None:
        conditions.append(time >= pa.scalar(start, pa.timestamp("ns", tz="UTC")))
    if end is not None:
        conditions.append(time < pa.scalar(end, pa.timestamp("ns", tz="UTC")))
    if items is not None:
        conditions.append(pc.field("data_item").isin(items))
    where = None
    for condition in conditions:
        where = condition if where is None else where & condition
    return pq.read_table(path, filters=where).cast(OBSERVATIONS)


def _first_of_each(table: pa.Table, order: Any) -> Any:
    """Which places of ``order`` hold the first row of an observation that may stand in several."""
    keep = np.ones(len(order), bool)
    known = table["instance"].is_valid().to_numpy()[order]
    if not known.any():
        return keep
    at = np.flatnonzero(known)
    chosen = table.take(pa.array(order[at]))
    codes = [chosen[name].combine_chunks().indices.fill_null(-1) for name in ("data_item", "key")]
    columns = [chosen["instance"], chosen["sequence"], *codes]
    by = [np.asarray(column) for column in columns]
    ranked = np.lexsort(by)  # stable: the first of equal rows comes first
    same = np.ones(max(len(ranked) - 1, 0), bool)
    for column in by:
        same &= column[ranked][1:] == column[ranked][:-1]
    keep[at[ranked[1:][same]]] = False
    return keep
