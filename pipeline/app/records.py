"""Records of a machine item by item: interval, range, time span (UTC) and availability."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from pipeline.app.fleet import DATA, check_machine, machine_parameters, outside_fleet
from pipeline.app.output import aligned
from pipeline.charts.judged import gain_words
from pipeline.parameters import structure
from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.store import read_json
from pipeline.schema.verdict import NextRecording, Verdict
from pipeline.signals.cleaning.settings import CleanMachine

BARS = "▁▂▃▄▅▆▇█"
BINS = 24
"""Characters of a sparkline, equal parts of the time that the records span."""
HOLE = 24 * 3600 * 10**9
"""Time without a value of any item from which the machine's log was not kept [ns]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ItemSeries:
    """Reports of one data item or channel, in the order of time."""

    time: Ints
    """Time in UTC [ns], shape (T,)."""
    number: Floats
    """Values, NaN for words and where it was unavailable, shape (T,)."""
    known: np.ndarray
    """Whether it was available, shape (T,)."""
    words: int
    """Different words among its values."""


@dataclass(frozen=True, kw_only=True)
class ItemRecord:
    """One row of `kerf records`."""

    item: str
    signal: str
    """Data item or channel, and the signal that it stands for; ``""`` for none."""
    samples: int
    """Values that were reported; unavailable counts as none."""
    interval_s: float | None
    """Median time between two reports [s]."""
    low: float | None
    high: float | None
    """Range of its numbers, in the unit of the record."""
    words: int
    """Different words among its values."""
    unavailable: float
    """Share of the time from its first to its last report in which it was unavailable [1]; days
    without a value of any item do not count."""
    first: str | None
    last: str | None
    """UTC of its first and last value."""
    unit: str = ""
    """Unit by the Devices document or the table's layout."""
    described: bool = True
    """Whether a Devices document describes the item; True without one."""
    sparkline: str = ""
    """Sparkline of its mean in equal parts of the time that all records span, without those days;
    blank where nothing was reported."""


def item_series(signals: Path) -> dict[str, ItemSeries]:
    """Series of every data item and channel in ``data/signals/<machine>``, by name."""
    frames: dict[str, list[pd.DataFrame]] = {}
    for path in sorted(signals.glob("observations/*.parquet")):
        for item, part in _observed(path):
            frames.setdefault(item, []).append(part)
    for path in sorted(signals.glob("traces/*.parquet")):
        for item, part in _recorded(path):
            frames.setdefault(item, []).append(part)
    return {item: _series(parts) for item, parts in sorted(frames.items())}


def _observed(path: Path) -> Iterator[tuple[str, pd.DataFrame]]:
    table = pq.read_table(path, columns=["time", "data_item", "number", "text"])
    frame = table.to_pandas()
    text = frame["text"].astype(object)
    frame["word"] = text.where(text.astype(str).str.upper() != "UNAVAILABLE")
    for item, part in frame.groupby("data_item", observed=True, sort=False):
        yield str(item), part[["time", "number", "word"]]


def _recorded(path: Path) -> Iterator[tuple[str, pd.DataFrame]]:
    """Channels of a table with a clock; one that counts from its start has no place in time."""
    names = pq.read_schema(path).names
    if "time" not in names:
        return
    for name in names:
        if name != "time":
            frame = pq.read_table(path, columns=["time", name]).to_pandas()
            number = pd.to_numeric(frame[name], errors="coerce")
            word = frame[name].astype(object).where(number.isna() & frame[name].notna(), None)
            yield name, pd.DataFrame({"time": frame["time"], "number": number, "word": word})


def _series(parts: Sequence[pd.DataFrame]) -> ItemSeries:
    frame = pd.concat(parts, ignore_index=True).sort_values("time", kind="stable")
    number = frame["number"].to_numpy(dtype=float)
    word = frame["word"].notna().to_numpy()
    return ItemSeries(
        time=frame["time"].dt.as_unit("ns").astype("int64").to_numpy(),
        number=number,
        known=word | ~np.isnan(number),
        words=int(frame["word"].nunique()),
    )


def without_holes(every: Mapping[str, ItemSeries]) -> Callable[[Ints], Ints]:
    """Times [ns] without the stretches of over a day in which no item had a value."""
    known = [one.time[one.known] for one in every.values()]
    said: Ints = np.unique(np.concatenate([np.empty(0, np.int64), *known]))
    step = np.diff(said)
    after = said[1:][step > HOLE]
    taken = np.r_[0, np.cumsum(step[step > HOLE])]
    ends = np.r_[after - taken[1:], np.iinfo(np.int64).max]

    def shortened(time: Ints) -> Ints:
        place = np.searchsorted(after, time, side="right")
        return np.minimum(time - taken[place], ends[place])

    return shortened


def item_record(
    item: str,
    series: ItemSeries,
    span: tuple[int, int],
    shortened: Callable[[Ints], Ints],
    **about: Any,
) -> ItemRecord:
    """Row of one item.

    ``span`` [ns] is that of all records, without the holes that ``shortened`` takes out.
    """
    said = series.time[series.known]
    number = series.number[~np.isnan(series.number)]
    steps = np.diff(np.unique(said)) / 1e9
    close = replace(series, time=shortened(series.time))
    return ItemRecord(
        item=item,
        samples=len(said),
        interval_s=float(np.median(steps)) if len(steps) else None,
        low=float(number.min()) if len(number) else None,
        high=float(number.max()) if len(number) else None,
        words=series.words,
        unavailable=_unavailable(close),
        first=_utc(said[0]) if len(said) else None,
        last=_utc(said[-1]) if len(said) else None,
        sparkline=_sparkline(close, span),
        **about,
    )


def _utc(time: int) -> str:
    return str(np.datetime64(int(time) // 10**9, "s")) + "Z"


def _unavailable(series: ItemSeries) -> float:
    """Share of the time from the first to the last report that no value covers [1]."""
    lasting = np.diff(series.time)
    if not len(series.time):
        return 1.0
    if not lasting.sum():
        return float(1 - series.known.mean())
    return float(lasting[~series.known[:-1]].sum() / lasting.sum())


def _sparkline(series: ItemSeries, span: tuple[int, int]) -> str:
    """Means of a number, or how often words came, in equal parts of the span."""
    edges = np.linspace(span[0], span[1] + 1, BINS + 1)
    numeric = ~np.isnan(series.number)
    chosen = numeric if numeric.any() else series.known
    place = np.clip(np.searchsorted(edges, series.time[chosen], side="right") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    if numeric.any():
        total = np.bincount(place, weights=series.number[chosen], minlength=BINS)
        level = np.divide(total, count, out=np.full(BINS, np.nan), where=count > 0)
    else:
        level = np.where(count > 0, count, np.nan).astype(float)
    if np.isnan(level).all():
        return " " * BINS
    low, high = np.nanmin(level), np.nanmax(level)
    share = (level - low) / (high - low) if high > low else np.where(count > 0, 0.5, np.nan)
    return "".join(" " if np.isnan(s) else BARS[min(int(s * 8), 7)] for s in share)


def machine_records(
    signals: Path, signal_of: dict[str, str], units: dict[str, str]
) -> list[ItemRecord]:
    """Rows of every item in ``signals``, those of the machine's signals first, then by name.

    ``signal_of``: data item -> its signal, listed even without records; ``units``: data item ->
    unit.
    """
    every = item_series(signals)
    shortened = without_holes(every)
    said = np.concatenate([np.zeros(0, np.int64), *(s.time[s.known] for s in every.values())])
    ends = np.array([said.min(), said.max()] if len(said) else [0, 0])
    first, last = (int(t) for t in shortened(ends))
    traced = {
        one.name: (one.metadata or {}).get(b"unit", b"").decode()
        for path in sorted(signals.glob("traces/*.parquet")) for one in pq.read_schema(path)
    }  # fmt: skip
    empty = ItemSeries(
        time=np.array([], np.int64), number=np.array([]), known=np.array([], bool), words=0
    )
    rows = [
        item_record(
            item, every.get(item, empty), (first, last), shortened, signal=signal_of.get(item, ""),
            unit=units.get(item) or traced.get(item, ""),
            described=not units or item in units or item in traced,
        )
        for item in {**dict.fromkeys(signal_of), **every}
    ]  # fmt: skip
    return sorted(rows, key=lambda row: (not row.signal, row.item))


def described_units(signals: Path) -> dict[str, str]:
    """Unit of every data item that the machine's Devices document describes; ``""`` for none."""
    path = signals / "data_items.parquet"
    if not path.exists():
        return {}
    table = pq.read_table(path, columns=["data_item", "units"]).to_pylist()
    return {row["data_item"]: row["units"] or "" for row in table}


def records_of(machine: str) -> list[ItemRecord]:
    """Rows of every item in the machine's ingested records."""
    values = machine_parameters(machine)
    signals = DATA / "signals" / machine
    if not (signals / "manifest.json").exists():
        why = outside_fleet(machine) or f"run `dvc repro ingest@{machine}` first"
        raise ValueError(f"{signals} holds no records: {why}")
    mapping = structure(values, f"machine.{machine}.mapping", CleanMachine)
    return machine_records(signals, mapping.signal_of, described_units(signals))


def lines(rows: Sequence[ItemRecord]) -> Iterator[str]:
    """The rows as a table of words, with what is wrong with them below."""
    head = ("item", "signal", "samples", "every", "range", "unit", "unavail.", "first", "last", "")
    yield from aligned([head, *map(_cells, rows)], words=len(head))
    absent = [row for row in rows if row.signal and not row.samples]
    for row in absent:
        yield f"no record has a value of {row.item}, which the machine's file names as {row.signal}"
    strange = [row.item for row in rows if not row.described and row.samples]
    if strange:
        more = "" if len(strange) <= 5 else f" and {len(strange) - 5} more"
        yield (
            f"{len(strange)} items with values are not in the Devices document ("
            f"{', '.join(strange[:5])}{more}): is a log of another machine among them?"
        )


def _cells(row: ItemRecord) -> tuple[str, ...]:
    numbers = row.low is not None and row.high is not None
    words = f"{row.words} word{'s' * (row.words > 1)}" if row.words else ""
    return (
        row.item, row.signal, str(row.samples),
        "" if row.interval_s is None else f"{row.interval_s:.3g} s",
        f"{row.low:.5g} … {row.high:.5g}" if numbers else words,
        row.unit, f"{100 * row.unavailable:.0f} %",
        (row.first or "")[:16], (row.last or "")[:16], row.sparkline,
    )  # fmt: skip


def next_of(machine: str) -> dict[str, tuple[NextRecording, ...]]:
    """What would help each sub-model of a machine most, by its verdict: the best first."""
    check_machine(machine)
    paths = sorted((DATA / "models" / machine).glob("*/verdict.json"))
    if not paths:
        why = outside_fleet(machine) or "run `dvc repro` first"
        raise ValueError(f"{DATA / 'models' / machine} holds no verdict to go by: {why}")
    return {path.parent.name: read_json(path, Verdict).next_recordings for path in paths}


def next_lines(found: Mapping[str, Sequence[NextRecording]]) -> Iterator[str]:
    """For each sub-model the recording that helps most, the interval it narrows and the method."""
    for name, some in found.items():
        if not some:
            yield f"{name}: no record would tell more, or none was judged: run `dvc repro`"
            continue
        one = some[0]
        yield f"{name}: {one.proposal}"
        yield f"    {f'{one.minutes:g} min; ' if one.minutes else ''}{gain_words(one)}"
