"""Small made-up records in the form that ingest leaves on disk."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.signals.cleaning.series import Series
from pipeline.signals.columns import OBSERVATIONS

NS = 1_000_000_000

Row = tuple[float, str, object]
"""(seconds since the origin, data item, number, word or None for UNAVAILABLE)."""


def nanoseconds(moment: str) -> int:
    return int(np.datetime64(moment, "ns").astype(np.int64))


def table(
    rows: Iterable[Row], origin: str, instance: int | None = None, sequence: list[int] | None = None
) -> pa.Table:
    """Observations ``rows`` in the order given."""
    rows = list(rows)
    start = nanoseconds(origin)
    time = [start + round(t * NS) for t, _, _ in rows]
    number = [float(v) if isinstance(v, int | float) else None for _, _, v in rows]
    text = [v if isinstance(v, str) else None for _, _, v in rows]
    n = len(rows)
    arrays = [
        pa.array(time, pa.int64()).cast(pa.timestamp("ns", tz="UTC")),
        pa.array([i for _, i, _ in rows], pa.string()),
        pa.array(number, pa.float64()),
        pa.array(text, pa.string()),
        pa.array(sequence or range(1, n + 1), pa.uint64()),
        pa.array(["SAMPLE"] * n, pa.string()),
        pa.nulls(n, pa.string()),
        pa.nulls(n, pa.string()),
        pa.array([instance] * n, pa.uint64()),
    ]
    plain = pa.Table.from_arrays(arrays, names=OBSERVATIONS.names)
    return plain.cast(OBSERVATIONS)


def record(folder: Path, name: str, rows: Iterable[Row], origin: str, **agent: object) -> Path:
    """Write one file of observations under a machine's folder of signals."""
    path = folder / "observations" / f"{name}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table(rows, origin, **agent), path)
    return path


def series(points: Iterable[tuple[float, object]]) -> Series:
    """A series of numbers or words at times [s]; None: not known."""
    points = list(points)
    words = any(isinstance(v, str) for _, v in points)
    value = [v if words or v is not None else np.nan for _, v in points]
    return Series(
        time=np.array([round(t * NS) for t, _ in points], dtype=np.int64),
        value=np.array(value, dtype=object if words else float),
        fresh=np.ones(len(points), dtype=bool),
    )


def day_rows(seconds: range, *, temperature: float = 25.0) -> list[Row]:
    """A machine that ticks each second, with a spindle at one temperature."""
    rows: list[Row] = [
        (seconds[0], "exec", "READY"),
        (seconds[0], "mode", "AUTOMATIC"),
        (seconds[0], "prog", "O1"),
    ]
    for t in seconds:
        rows.append((t, "clock", float(1000 + t)))
        rows.append((t + 0.25, "temp", temperature))
    return rows


def read(path: Path) -> pd.DataFrame:
    return pq.read_table(path).to_pandas()
