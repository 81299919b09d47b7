"""Ingested files of a machine: an index of each, and the rows of one file.

Rows at the head of an agent's file that repeat earlier reports, each item once, count from the
first time that the file reports anew (its live start).

Of a data item of category CONDITION several may be active at once, distinguished by native codes.
NORMAL with a code ends that one, NORMAL without a code all of the item, UNAVAILABLE all of it; a
warning that becomes a fault ends, and the fault begins (MTConnect Part 2).
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Ints
from pipeline.schema.days import days_of
from pipeline.schema.si import NS
from pipeline.signals.cleaning.gaps import counted_intervals
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.signals.columns import ALARMS, COLUMNS, unit_of
from pipeline.signals.store import sha256_of
from pipeline.signals.units import conversion

WHOLE = "*"
"""Stands for the machine as a whole among the data items of an index."""
LOGGER = "*trace"
"""Stands for a recording as a whole; it may go on while the machine is off."""

_READ = ["time", "data_item", "number", "text", "sequence", "kind", "key", "instance"]
THIN = 10
"""Parts of each period of the state table from which a trace's samples are kept."""


LEVELS = ("WARNING", "FAULT")
AT = ("program", "line")
"""Columns of the state table that say where a program was."""
_CONDITION_COLUMNS = ["time", "sequence", "data_item", "text", "kind", "key", "attributes"]


class Said(NamedTuple):
    """Condition as reported at ``time`` [ns]; ``level`` is empty for UNAVAILABLE."""

    time: int
    data_item: str
    level: str
    code: str
    message: str


def conditions(path: Path) -> list[Said]:
    """Conditions in a file of observations, in their order, without what repeats the one before."""
    table = pq.read_table(path, columns=_CONDITION_COLUMNS)
    table = table.filter(pc.equal(table["kind"].cast(pa.string()), "CONDITION"))
    table = table.sort_by([("time", "ascending"), ("sequence", "ascending")])
    words = [table[name].cast(pa.string()).to_pylist() for name in _CONDITION_COLUMNS[2:]]
    found: list[Said] = []
    last: dict[str, Said] = {}
    for time, item, text, _, key, attributes in zip(
        table["time"].cast(pa.int64()).to_pylist(), *words, strict=True
    ):
        level = str(text or "").upper()
        said = Said(
            time, item, level if level != "UNAVAILABLE" else "", key or "", _words(attributes)
        )
        before = last.get(item)
        if before is None or level in LEVELS or before[2:] != said[2:]:
            found.append(said)
        last[item] = said
    return found


def _words(attributes: str | None) -> str:
    try:
        told = json.loads(attributes or "{}")
    except json.JSONDecodeError:
        return ""
    if not isinstance(told, dict):
        return ""
    return " ".join(str(told[name]) for name in ("message", "qualifier") if told.get(name))


def alarms(said: Iterable[Said], state: pd.DataFrame) -> pd.DataFrame:
    """Warnings and faults of all files in the order of ``start``; ``end`` missing if unknown."""
    found: list[dict[str, Any]] = []
    active: dict[tuple[str, str], dict[str, Any]] = {}
    for one in sorted(said, key=lambda s: s.time):
        place = (one.data_item, one.code)
        if one.level in LEVELS:
            if place in active and active[place]["level"] == one.level.lower():
                continue
            _end(active, [place], one.time, "changed")
            active[place] = {
                **one._asdict(), "level": one.level.lower(), "start": one.time, "end": None,
                "ended": "open",
            }  # fmt: skip
            found.append(active[place])
        else:
            whole = one.level == "" or not one.code
            ended = [p for p in active if p[0] == one.data_item] if whole else [place]
            _end(active, ended, one.time, "cleared" if one.level else "unavailable")
    frame = pd.DataFrame(found, columns=[f for f in ALARMS.names if f not in AT])
    for name in ("start", "end"):
        frame[name] = pd.to_datetime(frame[name], unit="ns", utc=True)
    return _placed(frame, state)


def _end(
    active: dict[tuple[str, str], dict[str, Any]], places: Sequence[tuple[str, str]], time: int,
    how: str,
) -> None:  # fmt: skip
    for place in places:
        row = active.pop(place, None)
        if row is not None:
            row["end"], row["ended"] = time, how


def _placed(frame: pd.DataFrame, state: pd.DataFrame) -> pd.DataFrame:
    """With the program and the line that were in the control when each alarm began."""
    known = state.sort_values("time", ignore_index=True)
    row = np.asarray(known["time"].searchsorted(frame["start"], side="right")) - 1
    for name in AT:
        if name not in known or not len(known):
            frame[name] = pd.Series([None] * len(frame), dtype=object)
            continue
        value = known[name].iloc[np.maximum(row, 0)].astype(object).to_numpy().copy()
        value[(row < 0) | pd.isna(value)] = None
        frame[name] = pd.Series(value, dtype=object)
    frame["line"] = pd.to_numeric(frame["line"]).astype(float)
    return frame.reindex(columns=ALARMS.names)


@dataclass(frozen=True, kw_only=True)
class Index:
    """Index of one file, read before its rows."""

    file: str
    sha256: str
    """Path under the machine's folder, and the hash of its bytes."""
    live_start: int = -1
    last: int = -1
    """First and last time [ns] that it reports anew; both -1 when there is none."""
    late: int = 0
    restated: int = 0
    """Rows out of order, rows that restate what was known before."""
    days: list[str] = field(default_factory=list)
    """Days with rows."""
    intervals: dict[str, dict[str, int]] = field(default_factory=dict)
    """Counted intervals of each item: bin -> count (see ``reporting``)."""
    conditions: list[Said] = field(default_factory=list)
    """Rows of :class:`~pipeline.signals.cleaning.recorded.Said`."""


def files_of(signals: Path) -> list[Path]:
    """The tables of observations and of traces of a machine, sorted."""
    return sorted(signals.glob("observations/*.parquet")) + sorted(signals.glob("traces/*.parquet"))


def is_trace(name: str) -> bool:
    """Whether a file of an index is a recording and not an agent's log."""
    return name.startswith("traces/")


def index(path: Path, signals: Path, machine: CleanMachine, settings: CleanSettings) -> Index:
    """Read one file through and note what later reading needs."""
    name, digest = path.relative_to(signals).as_posix(), sha256_of(path)
    rows = rows_of(path, machine, settings)
    if rows.empty:
        return Index(file=name, sha256=digest)
    time = rows["time"].to_numpy()
    spoken = rows["spoken"].to_numpy()
    late = int((np.diff(rows.sort_values("sequence", kind="stable")["time"].to_numpy()) < 0).sum())
    voice = LOGGER if is_trace(name) else WHOLE
    counts = {voice: _sparse(counted_intervals(np.unique(time[spoken]), settings.off_after_s))}
    wanted = rows[rows["wanted"]]
    for item, part in wanted.groupby("data_item", observed=True):
        times = np.unique(part["time"].to_numpy()[part["spoken"].to_numpy()])
        counts[str(item)] = _sparse(counted_intervals(times, settings.off_after_s))
    days = days_of(time, machine.time_zone)
    return Index(
        file=name, sha256=digest, live_start=int(time.min()), last=int(time.max()), late=late,
        restated=int(rows["restated"].sum()), days=days, intervals=counts,
        conditions=[] if is_trace(name) else conditions(path),
    )  # fmt: skip


def _sparse(counts: Ints) -> dict[str, int]:
    return {str(k): int(counts[k]) for k in np.flatnonzero(counts)}


def rows_of(path: Path, machine: CleanMachine, settings: CleanSettings) -> pd.DataFrame:
    """Rows of one file in the order of time [int64 ns].

    Also ``spoken`` (has a value), ``wanted`` (an item of the machine), ``restated``, ``trace``.
    """
    if path.parent.name == "traces":
        return _trace_rows(path, machine, settings)
    table = pq.read_table(path, columns=_READ)
    frame = pd.DataFrame(
        {
            "time": table["time"].cast(pa.int64()).to_numpy().copy(),
            "data_item": _categories(table["data_item"]),
            "number": table["number"].to_numpy().copy(),
            "text": _categories(table["text"]),
            "key": _categories(table["key"]),
            "sequence": table["sequence"].to_numpy().copy(),
            "instance": table["instance"].to_pandas(types_mapper=pd.ArrowDtype),
        }
    )
    text = frame["text"]
    lost = text.cat.categories[text.cat.categories.str.upper() == "UNAVAILABLE"]
    if len(lost):
        frame["text"] = text.cat.remove_categories(lost)
    frame["spoken"] = frame["number"].notna() | frame["text"].notna()
    plain = frame["key"].isna().to_numpy()
    frame["wanted"] = plain & frame["data_item"].isin(machine.items).to_numpy()
    frame["trace"] = False
    _restate(frame, settings)
    return frame.sort_values(["time", "sequence"], kind="stable", ignore_index=True)


def _categories(column: pa.ChunkedArray) -> pd.Categorical:
    values = column.combine_chunks()
    if not pa.types.is_dictionary(values.type):
        values = values.dictionary_encode()
    codes = values.indices.fill_null(-1).to_numpy(zero_copy_only=False)
    return pd.Categorical.from_codes(codes, pd.Index(values.dictionary.to_pylist(), dtype=object))


def _restate(frame: pd.DataFrame, settings: CleanSettings) -> None:
    """Take rows that restate old values as said at the file's live start; in place."""
    order = np.argsort(frame["sequence"].to_numpy(), kind="stable")
    time = frame["time"].to_numpy().copy()
    again = frame.iloc[order].duplicated(["data_item", "key"]).to_numpy()
    old = np.zeros(len(frame), dtype=bool)
    if again.any():
        n = int(np.argmax(again))
        live = time[order[n]]
        block: Ints = order[:n]
        old[block] = live - time[block] > settings.off_after_s * NS
        time[old] = live
    frame["time"] = time
    frame["restated"] = old


def _trace_rows(path: Path, machine: CleanMachine, settings: CleanSettings) -> pd.DataFrame:
    schema = pq.read_schema(path)
    channels = [name for name in schema.names if name in machine.items]
    if "time" not in schema.names or not channels:
        return pd.DataFrame()
    table = pq.read_table(path, columns=["time", *channels])
    time = table["time"].cast(pa.timestamp("ns", tz="UTC")).cast(pa.int64()).to_numpy()
    kept = _thinned(time, round(settings.period_s * NS) // THIN)
    parts = []
    for name in channels:
        column = table[name].to_pandas()
        number = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
        text = column.where(np.isnan(number)).astype(object)
        rows = {
            "time": time[kept], "data_item": name, "number": number[kept],
            "text": text.where(text.notna(), None).to_numpy()[kept], "key": None,
            "sequence": np.flatnonzero(kept).astype(np.uint64),
        }  # fmt: skip
        parts.append(pd.DataFrame(rows))
    frame = pd.concat(parts, ignore_index=True)
    frame["text"] = frame["text"].astype("category")
    frame["instance"] = pd.Series(pd.NA, index=frame.index, dtype=pd.ArrowDtype(pa.uint64()))
    frame["spoken"] = frame["number"].notna() | frame["text"].notna()
    frame["wanted"], frame["restated"], frame["trace"] = True, False, True
    return frame.sort_values(["time", "sequence"], kind="stable", ignore_index=True)


def _thinned(time: Ints, step: int) -> Bools:
    """First and last sample in each ``step`` [ns]: a coarser grid needs no more, shape (T,)."""
    if not len(time):
        return np.zeros(0, dtype=bool)
    turn = np.diff(time // max(step, 1)) != 0
    return np.r_[turn, True] | np.r_[True, turn]


def logged_items(signals: Path) -> list[str]:
    """Every data item and channel that the records of a machine hold, sorted."""
    found: set[str] = set()
    for path in sorted(signals.glob("observations/*.parquet")):
        column = pq.read_table(path, columns=["data_item"])["data_item"]
        found.update(column.unique().to_pylist())
    for path in sorted(signals.glob("traces/*.parquet")):
        found.update(name for name in pq.read_schema(path).names if name not in ("time", "t"))
    return sorted(found)


def near(absent: list[str], logged: list[str]) -> dict[str, list[str]]:
    """Items that the records hold and whose names are like an absent one's, the nearest first."""
    lowered = {name.lower(): name for name in logged}
    return {
        item: [lowered[one] for one in get_close_matches(item.lower(), lowered, n=3)]
        for item in absent
    }


def conversions(signals: Path, machine: CleanMachine) -> dict[str, tuple[float, float]]:
    """Factor and offset of the items whose unit is not their signal's, else ValueError."""
    units = _units(signals)
    found = {}
    for item, name in machine.signal_of.items():
        unit, wanted = units.get(item, ""), COLUMNS[name].unit
        if not wanted or not unit or unit == wanted:
            continue
        try:
            factor, offset = conversion(unit, wanted)
        except ValueError as error:
            raise ValueError(
                f"data item {item!r} is in {unit!r} and cannot be {name!r} in {wanted!r} "
                f"({error}); name another item for this signal"
            ) from error
        if (factor, offset) != (1.0, 0.0):
            found[item] = (factor, offset)
    return found


def _units(signals: Path) -> dict[str, str]:
    units: dict[str, str] = {}
    items = signals / "data_items.parquet"
    if items.is_file():
        frame = pd.read_parquet(items, columns=["data_item", "units"]).dropna()
        units.update({str(i): str(u) for i, u in frame.itertuples(index=False) if u})
    for path in sorted(signals.glob("traces/*.parquet")):
        for one in pq.read_schema(path):
            if unit := unit_of(one):
                units[one.name] = unit
    return units
