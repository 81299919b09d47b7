"""What the tests of MTConnect documents share: a time, and all that a reader says of a file."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.signals.columns import OBSERVATIONS
from pipeline.signals.formats import Batch, RecordSource, Rejection

WHEN = "2024-03-04T10:00:00.5Z"
NS = 1_000_000_000
T0 = 1_709_546_400 * NS + NS // 2  # WHEN

Rows = list[dict[str, Any]]
Read = Callable[[Path, RecordSource, Path], Iterator[Batch]]


def outcome(read: Read, path: Path, source: RecordSource) -> tuple[Rows, int, list[Rejection]]:
    """Rows with their time in ns, records read and rejections."""
    rows: Rows = []
    rejected: list[Rejection] = []
    records = 0
    for batch in read(path, source, path.parent):
        assert batch.observations.schema.equals(OBSERVATIONS)
        batch.observations.validate(full=True)
        time = batch.observations.column("time").cast(pa.int64())
        rows += batch.observations.set_column(0, "time", time).to_pylist()
        rejected += batch.rejected
        records += batch.read
    return rows, records, rejected
