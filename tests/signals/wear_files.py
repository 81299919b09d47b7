"""Made lives of milling tools as raw files, read by the ingest: a Parquet a cut, a table beside.

The force grows with the wear and with the feed, the vibration with the wear squared; each tool has
a gain of its own, so that an amplitude alone does not give the wear away.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.schema.identity import MachineIdentity
from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout
from pipeline.signals.ingest import ingest
from pipeline.signals.recordings import Channel
from pipeline.signals.wear_windows import ConditionTable, WearRecords, WearSource

RATE = 1000.0
"""Of the made cuts [Hz]."""
TOOTH_HZ = 50.0
"""Frequency at which teeth enter [Hz]."""
FEEDS = (300.0, 600.0)
"""Of the cuts, in turn [mm/min]."""
IDENTITY = MachineIdentity(name="rig", description="made", origin="simulated", credit="made")
SOURCES = (
    RecordSource(
        format="parquet", files="wear/*.parquet",
        table=TableLayout(
            time="time", columns={
                "force": ColumnSource(column="force", unit="N"),
                "vibration": ColumnSource(column="vibration", unit="m/s^2"),
            },
        ),
    ),
    RecordSource(
        format="csv", files="wear/lives.csv",
        table=TableLayout(
            rate=1.0, text=("file", "tool", "cut_type"), columns={
                "file": ColumnSource(column="file"),
                "tool": ColumnSource(column="tool"),
                "cut_type": ColumnSource(column="cut type"),
                "feed": ColumnSource(column="feed", unit="mm/min"),
                "time_in_cut": ColumnSource(column="time in cut", unit="min"),
                "wear": ColumnSource(column="VB", unit="um"),
            },
        ),
    ),
)  # fmt: skip


def wear_records(**changes: Any) -> WearRecords:
    """Section ``wear_records`` of the made lives."""
    given: dict[str, Any] = {
        "recordings": ("wear/*.parquet",),
        "channels": {
            "force": Channel(column="force", quantity="force"),
            "vibration": Channel(column="vibration", quantity="acceleration"),
        },
        "wear": WearSource(name="wear"), "tool": "tool", "progress": "time_in_cut",
        "continuous": {"feed": "mm/min", "time_in_cut": "min"}, "discrete": ("cut_type",),
        "table": ConditionTable(file="wear/lives.csv", key="file"),
        "rate_Hz": RATE, "length": 100,
    }  # fmt: skip
    return WearRecords(**{**given, **changes})


def wear_at(cut: int, cuts: int, tool: int) -> float:
    """True wear of a cut [um]: each tool wears at a rate of its own."""
    return float((150.0 + 15.0 * (tool % 4)) * (cut / max(cuts - 1, 1)) ** 0.7)


def cut_table(wear: float, feed: float, seed: int, rows: int, rate: float) -> pd.DataFrame:
    """Signals of one cut."""
    random = np.random.default_rng(seed)
    t = np.arange(rows) / rate
    wave = np.sin(2 * np.pi * TOOTH_HZ * t + random.uniform(0, 6.28))
    force = (0.2 * feed + wear) * (1 + 0.5 * wave) + 4.0 * random.standard_normal(rows)
    vibration = (1 + 2e-4 * wear**2) * random.standard_normal(rows) + wave
    return pd.DataFrame({"time": t, "force": force, "vibration": vibration})


def raw_lives(
    folder: Path, *, tools: int = 6, cuts: int = 6, rows: int = 300, rate: float = RATE,
    blank: Sequence[tuple[int, int]] = (), wears: NDArray[np.float64] | None = None,
) -> Path:  # fmt: skip
    """Raw files of lives; ``blank`` are (tool, cut) whose wear was not measured.

    ``wears`` (tools, cuts) replaces what the table says of the wear, not what the signals show.
    """
    (folder / "wear").mkdir(parents=True)
    rows_of_table = []
    for tool in range(tools):
        for cut in range(cuts):
            wear, feed = wear_at(cut, cuts, tool), FEEDS[cut % len(FEEDS)]
            name = f"T{tool}_{cut:03d}.parquet"
            table = cut_table(wear, feed, 100 * tool + cut, rows, rate)
            pq.write_table(pa.Table.from_pandas(table), folder / "wear" / name)
            told = wear if wears is None else float(wears[tool, cut])
            rows_of_table.append({
                "file": name, "tool": f"T{tool}", "cut type": "slot" if tool % 2 else "side",
                "feed": feed, "time in cut": 2.0 * cut,
                "VB": "" if (tool, cut) in blank else f"{told:.2f}",
            })  # fmt: skip
    pd.DataFrame(rows_of_table).to_csv(folder / "wear/lives.csv", index=False)
    return folder


def signals_of(folder: Path, **changes: Any) -> Path:
    """Signals of made lives, as the ingest writes them."""
    raw = raw_lives(folder / "raw", **changes)
    ingest(raw, folder / "signals", SOURCES, IDENTITY)
    return folder / "signals"
