"""A log of a spindle's load at even times: line, speed, load, feed as they were last said.

Logs that write changes only are silent while a reading stays, so that each reading holds until the
next; one that was said to be unavailable holds too.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.gcode.moves import METRE
from pipeline.identification.cutting.spindle_load_records import LoadItems

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FASTEST, SLOWEST = 0.02, 2.0
"""Between them the period of a log is taken [s]."""
QUICK = 0.5
"""Part of an item's changes that come a period or less after the one before."""
MOST = 2_000_000
"""Samples of a log."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """T samples of a log, ``period`` apart.

    Parameters
    ----------
    period : float
        [s]; about that of the log's polls.
    times : ndarray, shape (T,)
        From the log's beginning [s].
    line : ndarray of int, shape (T,)
        Of the program, -1 where not known.
    speed : ndarray, shape (T,)
        Of the spindle [rev/s]; NaN where not known, as the others.
    load : ndarray, shape (T,)
        [%].
    feed : ndarray, shape (T,)
        Speed along the path [m/s].
    """

    period: float
    times: Floats
    line: Ints
    speed: Floats
    load: Floats
    feed: Floats


def read_log(path: Path, items: LoadItems, name: str, *, cuts: bool) -> Readings:
    """Readings of a log.

    Parameters
    ----------
    path : Path
        Its observations, as ``ingest`` wrote them.
    items : LoadItems
        What the log calls them.
    name : str
        Of the log, for people.
    cuts : bool
        Whether line and feed are needed.

    Raises
    ------
    ValueError
        When the log lacks an item that is needed, or holds too little.
    """
    table = pq.read_table(path, columns=["time", "data_item", "number"]).to_pandas()
    if not len(table):
        raise ValueError(f"{name} holds nothing that could be read: log the spindle while it turns")
    table = table.sort_values("time", kind="stable")
    needed = ("line", "speed", "load", "feed") if cuts else ("speed", "load")
    there = set(table["data_item"].unique())
    for part in needed:
        if getattr(items, part) not in there:
            said = ", ".join(sorted(map(str, there))) or "nothing"
            raise ValueError(
                f"{name} has no data item {getattr(items, part)!r}, which "
                f"cutting_records.spindle.items.{part} names (it has {said}): correct the name, or "
                "let the adapter log it"
            )
    seconds = (table["time"] - table["time"].iloc[0]).dt.total_seconds().to_numpy()
    period = _period(table, seconds, [getattr(items, part) for part in needed], name)
    times = np.arange(0.0, seconds[-1] + period / 2, period)
    line = _held(table, seconds, items.line, times)
    return Readings(
        period=period,
        times=times,
        line=np.where(np.isfinite(line), line, -1).astype(np.int64),
        speed=_held(table, seconds, items.speed, times) / 60,
        load=_held(table, seconds, items.load, times),
        feed=np.abs(_held(table, seconds, items.feed, times)) * METRE,
    )


def _period(table: pd.DataFrame, seconds: Floats, items: list[str], name: str) -> float:
    """Period of the polls [s]: the quick changes of the item that changes most often."""
    each = [np.diff(np.unique(seconds[(table["data_item"] == item).to_numpy()])) for item in items]
    quick = [float(np.quantile(steps, QUICK)) for steps in each if len(steps)]
    if not quick:
        raise ValueError(f"{name} holds one moment only: log the spindle while it turns")
    period = float(np.clip(min(quick), FASTEST, SLOWEST))
    if seconds[-1] / period > MOST:
        raise ValueError(
            f"{name} lasts {seconds[-1] / 3600:.0f} h, more than {MOST} samples of {period:g} s: "
            "cut the part out of it in which the test ran"
        )
    return period


def _held(table: pd.DataFrame, seconds: Floats, item: str, times: Floats) -> Floats:
    """Value of an item last said at ``times``, NaN before the first."""
    rows = (table["data_item"] == item).to_numpy()
    said = np.append(table["number"].to_numpy(dtype=np.float64)[rows], np.nan)
    last = np.searchsorted(seconds[rows], times, side="right") - 1
    held: Floats = said[last]
    return held
