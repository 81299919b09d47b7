"""Tables of ``data/clean/<machine>``, written and read back."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema import store
from pipeline.schema.days import day_of
from pipeline.signals import columns
from pipeline.signals.cleaning.activity import Intervals
from pipeline.signals.cleaning.gaps import Gap
from pipeline.signals.cleaning.glitches import Audit
from pipeline.signals.cleaning.recorded import Index
from pipeline.signals.cleaning.series import Series
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.columns import ALARMS, AUDIT, CYCLES, GAPS, SEGMENTS

_WHOLE = {
    "audit": AUDIT, "gaps": GAPS, "cycles": CYCLES, "segments": SEGMENTS, "alarms": ALARMS,
}  # fmt: skip


def code_version() -> str:
    """Hash of the code that cleaning consists of."""
    here = Path(__file__).parent
    files = [*sorted(here.glob("*.py")), Path(columns.__file__)]
    return sha256(b"\0".join(f.read_bytes() for f in files)).hexdigest()


def write_table(path: Path, frame: pd.DataFrame | pa.Table) -> None:
    """Write one table; its schema goes by the file's name."""
    if not isinstance(frame, pa.Table):
        schema = _WHOLE[path.stem]
        frame = pa.Table.from_arrays([_array(frame[f.name], f.type) for f in schema], schema=schema)
    store.write_table(frame.replace_schema_metadata(None), path)


def _array(series: pd.Series, kind: pa.DataType) -> pa.Array:
    if pa.types.is_timestamp(kind):
        return pa.array(series.astype("datetime64[ns, UTC]").astype("int64").to_numpy()).cast(kind)
    return pa.array(series.astype(object).to_numpy(), kind, from_pandas=True)


def state_path(out: Path, day: str) -> Path:
    """Path of a day's state table."""
    return out / "state" / f"{day}.parquet"


def write_state(out: Path, day: str, state: pd.DataFrame, machine: CleanMachine) -> None:
    """Write a day's state table; a day without a row has none."""
    path = state_path(out, day)
    if state.empty:
        path.unlink(missing_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = pa.timestamp("ns", tz=machine.time_zone)  # the same instants, of UTC, on disk
    fields = [pa.field("time", shown, nullable=False), *(columns.field(n) for n in machine.names)]
    arrays = [pa.array(state["time"].to_numpy()).cast(shown)]
    for one in fields[1:]:
        value = state[one.name].astype(object) if one.type == pa.string() else state[one.name]
        arrays.append(pa.array(value.to_numpy(), one.type, from_pandas=True))
    write_table(path, pa.Table.from_arrays(arrays, schema=pa.schema(fields)))


def read_state(out: Path, days: Iterable[str], names: list[str]) -> pd.DataFrame:
    """Some columns of the state tables of some days."""
    paths = [p for d in days if (p := state_path(out, d)).is_file()]
    tables = [pq.read_table(p, columns=["time", *names]) for p in paths]
    if not tables:
        return pd.DataFrame(columns=["time", *names])
    return pa.concat_tables(tables).to_pandas()


def has_day(out: Path, day: str, note: Mapping[str, Any]) -> bool:
    """Whether a day's state table is there, where it has one."""
    return not note["seconds"] or state_path(out, day).is_file()


def drop_days(out: Path, keep: list[str]) -> None:
    """Remove the state tables of days that are no longer in the records."""
    for path in sorted((out / "state").glob("*.parquet")):
        if path.stem not in keep:
            path.unlink()


def _kept(path: Path, by: str, days: list[str], zone: str) -> pa.Table | None:
    if not days or not path.is_file():
        return None
    table = pq.read_table(path)
    row_day = [
        None if t is None else day_of(t, zone) for t in table[by].cast(pa.int64()).to_pylist()
    ]
    return table.filter(pa.array([d in set(days) for d in row_day], pa.bool_()))


def write_audit(out: Path, audit: list[Audit], kept_days: list[str], zone: str) -> pa.Table:
    """Write ``audit.parquet``: rows of the days that stay, and those made now."""
    return _rewrite(
        out, "audit", audit, kept_days, zone, by="time", then=["time", "data_item", "rule"]
    )


def write_gaps(out: Path, gaps: list[Gap], kept_days: list[str], zone: str) -> pa.Table:
    """Write ``gaps.parquet``; a gap belongs to the day it ends in."""
    return _rewrite(
        out, "gaps", gaps, kept_days, zone, by="end", then=["start", "end", "data_item", "cause"]
    )


def _rewrite(
    out: Path,
    name: str,
    rows: Sequence[Audit | Gap],
    kept: list[str],
    zone: str,
    *,
    by: str,
    then: list[str],
) -> pa.Table:  # fmt: skip
    path, made = out / f"{name}.parquet", pa.Table.from_pylist(list(map(vars, rows)), _WHOLE[name])
    stays = _kept(path, by, kept, zone)
    table = made if stays is None else pa.concat_tables([stays.cast(made.schema), made])
    table = table.sort_by([(column, "ascending") for column in then])
    write_table(path, table)
    return table


def read_summary(out: Path) -> dict[str, Any]:
    """Summary of the last build; nothing when one of its tables is gone."""
    path = out / "summary.json"
    there = all((out / f"{name}.parquet").is_file() for name in _WHOLE)
    if not path.is_file() or not there:
        return {}
    return dict(json.loads(path.read_text(encoding="utf-8")))


def write_summary(out: Path, summary: Mapping[str, Any]) -> None:
    """Write ``summary.json`` with sorted keys."""
    text = json.dumps(summary, sort_keys=True, indent=1)
    store.write_text(text + "\n", out / "summary.json")


def stacked(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Rows of several files under each other; words keep their categories."""
    parts = [p for p in parts if not p.empty] or parts[:1]
    for name in ("data_item", "text", "key"):
        kinds = [pd.Categorical(p[name]).categories for p in parts]
        union = sorted({str(w) for k in kinds for w in k})
        parts = [p.assign(**{name: pd.Categorical(p[name], categories=union)}) for p in parts]
    return pd.concat(parts, ignore_index=True)


def clipped(intervals: Intervals, start: int, end: int) -> Intervals:
    """The parts of intervals inside ``start`` to ``end`` [ns]."""
    low, high = np.maximum(intervals.start, start), np.minimum(intervals.end, end)
    inside = high > low
    state = {name: words[inside] for name, words in intervals.state.items()}
    return Intervals(start=low[inside], end=high[inside], state=state)


def changes(series: Mapping[str, Series], start: int, end: int) -> dict[str, list[list[Any]]]:
    """Controller's words of one day as JSON, ``[time [ns], word or null]`` at changes."""
    found: dict[str, list[list[Any]]] = {}
    for name, one in series.items():
        lost = ~one.known
        rows = np.flatnonzero((one.time < end) & ((one.time >= start) | lost))
        found[name] = [[int(one.time[i]), _word(one.value[i])] for i in rows]
    return found


def _word(value: Any) -> str | None:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return None
    return value if isinstance(value, str) else f"{value:.10g}"


def series_of_changes(days: Iterable[Mapping[str, list[list[Any]]]]) -> dict[str, Series]:
    """Series of words from what the days noted."""
    rows: dict[str, list[list[Any]]] = {}
    for day in days:
        for name, found in day.items():
            rows.setdefault(name, []).extend(found)
    made = {}
    for name, found in rows.items():
        time = np.array([t for t, _ in found], dtype=np.int64)
        order = np.argsort(time, kind="stable")
        value = np.array([w for _, w in found], dtype=object)[order]
        made[name] = Series(time=time[order], value=value, fresh=np.ones(len(order), dtype=bool))
    return made


def summary(
    days: Mapping[str, Mapping[str, Any]],
    cycles: pd.DataFrame,
    segments: pd.DataFrame,
    gaps: pa.Table,
    indices: list[Index],
) -> dict[str, Any]:
    """Summary of a build."""
    by_rule: dict[str, int] = {}
    states: dict[str, float] = {}
    for note in days.values():
        for rule, n in note["removed"].items():
            by_rule[rule] = by_rule.get(rule, 0) + n
        for word, seconds in note["execution_s"].items():
            states[word] = round(states.get(word, 0.0) + seconds, 3)
    kinds = (segments["end"] - segments["start"]).dt.total_seconds().groupby(segments["kind"]).sum()
    causes = gaps["cause"].to_pylist()
    counts = {n: sum(note[n] for note in days.values()) for n in ("rows", "duplicates", "restated")}
    return {
        "days": dict(days),
        "files": {i.file: asdict(i) for i in indices},
        "total": {
            **counts,
            "late": sum(i.late for i in indices),
            "removed": dict(sorted(by_rule.items())),
            "execution_s": dict(sorted(states.items())),
            "segments_s": {str(k): float(v) for k, v in kinds.items()},
            "seconds": sum(note["seconds"] for note in days.values()),
            "cycles": len(cycles),
            "complete_cycles": int(cycles["complete"].sum()),
            "gaps": {c: causes.count(c) for c in sorted(set(causes))},
        },
    }
