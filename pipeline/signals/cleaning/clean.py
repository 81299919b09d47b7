"""Incremental cleaning of a machine's records: only the days whose inputs have changed."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.parallel import mapped
from pipeline.schema import store
from pipeline.schema.days import day_end, day_of, day_start
from pipeline.schema.si import NS
from pipeline.signals import columns
from pipeline.signals.cleaning.activity import (
    CONTROLLER,
    USED,
    Intervals,
    cycles,
    intervals,
    seconds_in_states,
    segments,
)
from pipeline.signals.cleaning.day import Carry, Day, clean_day
from pipeline.signals.cleaning.gaps import N_BINS, Gap, ReportingInterval, reporting_interval
from pipeline.signals.cleaning.recorded import (
    AT,
    LEVELS,
    LOGGER,
    WHOLE,
    Index,
    Said,
    alarms,
    conversions,
    files_of,
    index,
    is_trace,
    logged_items,
    near,
    rows_of,
)
from pipeline.signals.cleaning.series import Audit, Series
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.signals.contracts import SCHEMAS
from pipeline.signals.store import sha256_of

Summary = dict[str, Any]


def clean(
    signals: Path, out: Path, *, machine: CleanMachine, settings: CleanSettings | None = None
) -> Summary:
    """Clean one machine's ``data/signals`` into its ``data/clean``, changed days only.

    Returns the content of ``summary.json`` and ``written``, the days.  A data item whose unit
    cannot become its signal's is a ValueError.
    """
    return _Build(signals, out, machine, settings or CleanSettings()).run()


def _digest(what: Any) -> str:
    return sha256(json.dumps(what, sort_keys=True, default=str).encode()).hexdigest()


def _index(
    path: Path, signals: Path, known: Mapping[str, Any], machine: CleanMachine, s: CleanSettings
) -> Index:
    old = known.get(path.relative_to(signals).as_posix())
    if old is not None and old["sha256"] == sha256_of(path):
        return Index(**old)
    return index(path, signals, machine, s)


def _reporting(indices: list[Index], machine: CleanMachine) -> dict[str, ReportingInterval]:
    found = {}
    for item in (WHOLE, *machine.items):
        counts = np.zeros(N_BINS, dtype=np.int64)
        voice = LOGGER if item == WHOLE and not _has_agent(indices) else item
        for one in indices:
            for place, n in one.intervals.get(voice, {}).items():
                counts[int(place)] += n
        found[item] = reporting_interval(counts)
    return found


def _has_agent(indices: list[Index]) -> bool:
    """Whether an agent reports when the machine is on; else its recordings show it."""
    return any(one.days and not is_trace(one.file) for one in indices)


def _open_gaps(carry: Carry) -> list[Gap]:
    said = {item: left["said"] for item, left in carry.get("items", {}).items()}
    return [
        Gap(start=last[0], end=None, data_item=item, cause="unavailable")
        for item, last in said.items() if last is not None and last[1] is None
    ]  # fmt: skip


class _Build:
    """One run over all days."""

    def __init__(
        self, signals: Path, out: Path, machine: CleanMachine, settings: CleanSettings
    ) -> None:
        self.signals, self.out, self.machine, self.settings = signals, out, machine, settings
        self.zone = machine.time_zone
        self.converted = conversions(signals, machine)
        out.mkdir(parents=True, exist_ok=True)
        self.before = read_summary(out)
        rules = [code_version(), asdict(machine), asdict(settings), self.converted]
        self.rules = _digest(rules)
        known = self.before.get("files", {}) if self.before.get("rules") == self.rules else {}
        self.indices = mapped(
            partial(_index, signals=signals, known=known, machine=machine, s=settings),
            files_of(signals), compute="threads",
        )  # fmt: skip
        self.reporting = _reporting(self.indices, machine)

    def run(self) -> Summary:
        """Clean the days in their order, then what spans them."""
        days = sorted({d for one in self.indices for d in one.days})
        done: dict[str, Summary] = {}
        fresh: dict[str, Day] = {}
        carry: Carry = {}
        for day in days:
            key = self._key(day, carry)
            old = self.before.get("days", {}).get(day, {})
            there = old and (not old["seconds"] or state_path(self.out, day).is_file())
            if there and old["key"] == key:
                done[day] = old
            else:
                fresh[day] = self._day(day, carry)
                done[day] = self._note(day, key, fresh[day])
            carry = done[day]["carry"]
        for path in sorted((self.out / "state").glob("*.parquet")):
            if path.stem not in done or not done[path.stem]["seconds"]:
                path.unlink()
        kept = [d for d in days if d not in fresh]
        audit = [a for d in fresh.values() for a in d.audit]
        rewritten(self.out / "audit.parquet", audit, kept, self.zone)
        gaps = [*(gap for d in fresh.values() for gap in d.gaps), *_open_gaps(carry)]
        table = rewritten(self.out / "gaps.parquet", gaps, kept, self.zone)
        return self._whole(days, done, list(fresh), table)

    def _span(self, day: str) -> tuple[int, int]:
        """First moment of a day and of the next one [ns]."""
        return day_start(day, self.zone), day_end(day, self.zone)

    def _files(self, day: str) -> list[Index]:
        start, midnight = self._span(day)
        end = midnight + round(self.settings.lookahead_s * NS)
        return [i for i in self.indices if i.days and i.live_start < end and i.last >= start]

    def _key(self, day: str, carry: Carry) -> str:
        files = [(i.file, i.sha256) for i in self._files(day)]
        reporting = {k: v.effect(self.settings) for k, v in self.reporting.items()}
        return _digest([self.rules, day, files, carry, reporting, _has_agent(self.indices)])

    def _day(self, day: str, carry: Carry) -> Day:
        start, midnight = self._span(day)
        end = midnight + round(self.settings.lookahead_s * NS)
        parts = []
        for one in self._files(day):
            rows = rows_of(self.signals / one.file, self.machine, self.settings)
            time = rows["time"]
            parts.append(rows[(time >= start) & (time < end)])
        rows = stacked(parts)
        rows["apart"] = rows["trace"].to_numpy(dtype=bool) & _has_agent(self.indices)
        for item, (factor, offset) in self.converted.items():
            chosen = (rows["data_item"] == item).to_numpy()
            rows.loc[chosen, "number"] = rows.loc[chosen, "number"] * factor + offset
        done = clean_day(
            rows, start, midnight, carry, self.reporting, machine=self.machine,
            settings=self.settings,
        )  # fmt: skip
        write_state(self.out, day, done.state, self.machine)
        return done

    def _note(self, day: str, key: str, done: Day) -> Summary:
        removed = pd.Series([a.rule for a in done.audit], dtype=object).value_counts()
        series = {n: done.series[i] for n, i in self.machine.signals.items() if n in CONTROLLER}
        start, midnight = self._span(day)
        found = intervals(series, midnight)
        inside = clipped(found, start, midnight)
        return {
            "key": key, "carry": done.carry, "seconds": len(done.state) * self.settings.period_s,
            "removed": {str(k): int(v) for k, v in sorted(removed.items())}, **done.counts,
            "execution_s": seconds_in_states(inside) if done.state.size else {},
            "controller": changes(series, start, midnight),
        }  # fmt: skip

    def _whole(
        self, days: list[str], done: dict[str, Summary], written: list[str], gaps: pd.DataFrame
    ) -> Summary:
        end = max((done[d]["carry"]["spoken"] or 0 for d in days), default=0)
        spans = intervals(series_of_changes(done[d]["controller"] for d in days), end)
        made = cycles(spans, self.settings)
        write_table(self.out / "cycles.parquet", made)
        state = read_state(self.out, days, [n for n in self.machine.names if n in USED])
        parts = segments(state, self.settings, self.machine.warm_up_programs)
        write_table(self.out / "segments.parquet", parts)
        write_table(self.out / "alarms.parquet", self._alarms(days))
        there = {item for one in self.indices for item in one.intervals}
        absent = [item for item in self.machine.items if item not in there]
        found = summary(done, made, parts, gaps, self.indices) | {
            "rules": self.rules, "absent": absent,
            "near": near(absent, logged_items(self.signals)),
        }  # fmt: skip
        text = json.dumps(found, sort_keys=True, indent=1)
        store.write_text(text + "\n", self.out / "summary.json")
        return found | {"written": sorted(written)}

    def _alarms(self, days: list[str]) -> pd.DataFrame:
        said = [Said(*row) for one in self.indices for row in one.conditions]
        wanted = {day_of(one.time, self.zone) for one in said if one.level in LEVELS}
        state = read_state(
            self.out, [d for d in days if d in wanted], [n for n in self.machine.names if n in AT]
        )
        return alarms(said, state)


_WHOLE = ("audit", "gaps", "cycles", "segments", "alarms")


def code_version() -> str:
    """Hash of the code that cleaning consists of."""
    here = Path(__file__).parent
    files = [*sorted(here.glob("*.py")), Path(columns.__file__)]
    return sha256(b"\0".join(f.read_bytes() for f in files)).hexdigest()


def write_table(path: Path, frame: pd.DataFrame | pa.Table) -> None:
    """Write one table; its schema goes by the file's name."""
    if not isinstance(frame, pa.Table):
        schema = SCHEMAS[path.stem]
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


_ORDER = {
    "audit": ("time", ["time", "data_item", "rule"]),
    "gaps": ("end", ["start", "end", "data_item", "cause"]),
}
"""Tables of single days: column that names the day of a row, and columns that order the rows."""


def rewritten(path: Path, rows: Sequence[Audit | Gap], kept: list[str], zone: str) -> pa.Table:
    """Write audit or gaps: rows of the days that are ``kept``, and those made now."""
    schema, (by, order) = SCHEMAS[path.stem], _ORDER[path.stem]
    table = pa.Table.from_pylist(list(map(vars, rows)), schema)
    if kept and path.is_file():
        old = pq.read_table(path).cast(schema)
        times = old[by].cast(pa.int64()).to_pylist()
        stays = [t is not None and day_of(t, zone) in set(kept) for t in times]
        table = pa.concat_tables([old.filter(pa.array(stays, pa.bool_())), table])
    table = table.sort_by([(column, "ascending") for column in order])
    write_table(path, table)
    return table


def read_summary(out: Path) -> dict[str, Any]:
    """Summary of the last build; nothing when one of its tables is gone."""
    names = ["summary.json", *(f"{name}.parquet" for name in _WHOLE)]
    if not all((out / name).is_file() for name in names):
        return {}
    return dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))


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
