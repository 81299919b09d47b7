"""As-built records: the finished cycles of a log, from its clean tables and the twin's state."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.bundle import Champion
from pipeline.schema.days import day_of, zone_of
from pipeline.schema.part_record import (
    BlockTime,
    Estimated,
    Measured,
    PartAlarm,
    PartRecord,
    ProgramFile,
    ToolUse,
)
from pipeline.schema.program_cut import SimulatedProgram
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.twin_state import MANIFEST, QUANTITIES, TwinState, day_path, read_day
from pipeline.signals.store import sha256_of
from pipeline.signals.windows import read_state, state_days

HEAT, LOAD = "spindle_temperature", "spindle_load"
MEASURED = ("temperature", "load", "speed", "override")
"""Endings of the columns of the state table that a record sums up."""


@dataclass(frozen=True, kw_only=True)
class _Log:
    """The clean tables and the twin's state of a machine."""

    machine: str
    clean: Path
    state: Path
    programs: Path
    zone: str
    cycles: pd.DataFrame
    alarms: pd.DataFrame
    twin: TwinState | None
    read: dict[str, tuple[pd.DataFrame, list[Path]]] = field(default_factory=dict)
    """The day read last."""

    def day(self, day: str) -> tuple[pd.DataFrame, list[Path]]:
        """Rows of a day, columns of state table and twin, and the files that they stand in."""
        if day not in self.read:
            clean, files = read_state(self.clean, day), [self.clean / "state" / f"{day}.parquet"]
            try:
                twin = read_day(self.state, day).to_pandas().set_index("time")
            except StoreError:
                twin = pd.DataFrame(index=clean.index[:0])
            else:
                files.append(day_path(self.state, day))
            own = twin[[c for c in twin.columns if c not in clean.columns]]
            self.read.clear()
            self.read[day] = pd.concat([clean, own.reindex(clean.index)], axis=1), files
        return self.read[day]

    def rows(self, start: pd.Timestamp, end: pd.Timestamp) -> tuple[pd.DataFrame, list[Path]]:
        """Rows of a cycle and the files that they stand in."""
        days = [self.day(day) for day in state_days(
            self.clean, day_of(start.value, self.zone), day_of(end.value, self.zone))]  # fmt: skip
        parts = [rows[(rows.index >= start) & (rows.index < end)] for rows, _ in days]
        return (
            pd.concat(parts) if parts else pd.DataFrame(),
            [file for _, files in days for file in files],
        )


def part_records(
    machine: str, origin: str, data: Path, *, first: str = "", last: str = "",
    program: str = "", champion: Champion | None = None,
) -> Iterator[PartRecord]:  # fmt: skip
    """Records of the complete cycles from day ``first`` to day ``last`` of the plant.

    Raises ValueError where the machine has no log of programs, or no such part in it.
    """
    clean = data / "clean" / machine
    path = clean / "cycles.parquet"
    if not path.exists():
        raise ValueError(f"{machine} has no log of its programs ({path}): there is no part in it")
    state = data / "twin_state" / machine
    alarms = clean / "alarms.parquet"
    log = _Log(
        machine=machine, clean=clean, state=state, programs=data / "programs" / machine,
        zone=zone_of(clean), cycles=pd.read_parquet(path),
        alarms=pd.read_parquet(alarms) if alarms.exists() else pd.DataFrame(),
        twin=read_json(state / MANIFEST, TwinState) if (state / MANIFEST).exists() else None,
    )  # fmt: skip
    programs, cut, found = _programs(log.programs), _Cut(), 0
    whole = log.cycles[log.cycles["complete"]]
    cycles: Any = log.cycles.itertuples()
    for one in cycles:
        rows, files = log.rows(one.start, one.end)
        tools = cut.use(rows)
        day = day_of(one.start.value, log.zone)
        named = "" if pd.isna(one.program) else str(one.program)
        if not one.complete or (first and day < first) or (last and day > last):
            continue
        if program and named != program:
            continue
        found += 1
        yield _record(log, one, (rows, files), tools, whole, programs.get(named, ()), named=named,
                      origin=origin, champion=champion)  # fmt: skip
    if not found:
        of = f" of program {program}" if program else ""
        days = f" from {first or 'its begin'} to {last or 'its end'}" if first or last else ""
        raise ValueError(f"the log of {machine} has no complete cycle{of}{days}; it has "
                         f"{len(log.cycles)} cycles in all")  # fmt: skip


def _record(
    log: _Log, one: Any, table: tuple[pd.DataFrame, Sequence[Path]], tools: tuple[ToolUse, ...],
    whole: pd.DataFrame, programs: tuple[ProgramFile, ...], *, named: str, origin: str,
    champion: Champion | None,
) -> PartRecord:  # fmt: skip
    rows, files = table
    others = whole[(whole["program"] == named) & (whole["cycle"] != one.cycle)]["active_s"]
    blocks = _blocks(rows)
    twin = {name: found for name in QUANTITIES if (found := _estimated(rows, name)) is not None}
    bundle = "" if log.twin is None else log.twin.bundle
    no_band = "" if log.twin is None else log.twin.temperature_interval_unknown
    heat = twin.get(HEAT)
    lacking = {
        "programs": "" if programs else f"no program {named} among the machine's raw files"
        if named else "the log names no program",
        "blocks": "" if blocks else "the log states no line of the program",
        "wear": "wear is read from recordings of single tools; tools have the time that they cut",
        LOAD: "run-ups count too: whether the spindle holds its speed is not known"
        if LOAD in rows and not _holds(rows).any() else "",
        f"{HEAT}_interval": (no_band or "no interval at these times")
        if heat is not None and heat.low is None else "",
        **_not_estimated(log, twin, day_of(one.start.value, log.zone)),
    }  # fmt: skip
    local = [t.tz_convert(log.zone).isoformat() for t in (one.start, one.end)]
    return PartRecord(
        machine=log.machine, origin=origin, cycle=int(one.cycle), program=named,
        part="" if pd.isna(one.part) else str(one.part), start=local[0], end=local[1],
        active_s=float(one.active_s), feed_hold_s=float(one.feed_hold_s),
        interrupted_s=float(one.interrupted_s), idle_s=float(one.idle_s),
        usual_s=float(others.median()) if len(others) else None, usual_cycles=len(others),
        programs=programs, blocks=blocks, tools=tools, measured=_measured(log, rows, files),
        twin=twin, alarms=_alarms(log, one.start, one.end), bundle=bundle,
        version=champion.version if champion and bundle == champion.bundle else None,
        submodels={} if log.twin is None else dict(log.twin.submodels),
        sources={path.as_posix(): sha256_of(path)
                 for path in (log.clean / "cycles.parquet", *files)},
        not_known={name: why for name, why in lacking.items() if why},
    )  # fmt: skip


def _period(rows: pd.DataFrame) -> float:
    """Time between two rows [s]."""
    steps = np.diff(pd.DatetimeIndex(rows.index).as_unit("ns").asi8)
    return float(np.median(steps)) * 1e-9 if len(steps) else 0.0


def _holds(rows: pd.DataFrame) -> Any:
    """Whether the spindle holds its speed or stands; shape (T,), all False where not known."""
    if "spindle_steady" not in rows or not rows["spindle_steady"].notna().any():
        return np.zeros(len(rows), dtype=np.bool_)
    return (rows["spindle_steady"].eq(True) | rows["spindle_speed"].eq(0)).to_numpy()


def _measured(log: _Log, rows: pd.DataFrame, files: Sequence[Path]) -> dict[str, Measured]:
    import pyarrow.parquet as pq

    if not len(rows):
        return {}
    schema = pq.read_schema(files[0])
    found = {}
    for name in rows.columns:
        if not name.endswith(MEASURED) or name not in schema.names:
            continue
        values = rows[name].to_numpy(float)
        counts = _holds(rows) if name == LOAD else np.zeros(len(rows), dtype=np.bool_)
        known = values[np.isfinite(values) & (counts | ~counts.any())]
        unit = (schema.field(name).metadata or {}).get(b"unit", b"").decode()
        if len(known):
            found[name] = Measured(
                unit=unit, first=float(known[0]), last=float(known[-1]), least=float(known.min()),
                greatest=float(known.max()), mean=float(known.mean()),
                known_s=len(known) * _period(rows),
            )  # fmt: skip
    return found


def _estimated(rows: pd.DataFrame, name: str) -> Estimated | None:
    """The twin's estimate of a quantity over a cycle; None where it is known nowhere."""
    unit, parts = QUANTITIES[name]
    if f"{name}_estimated" not in rows:
        return None
    column = {p: rows[f"{name}_{p}"].to_numpy(float) for p in parts if f"{name}_{p}" in rows}
    known = np.isfinite(column["estimated"])
    if not known.any():
        return None
    banded = known & np.isfinite(column["low"]) & np.isfinite(column["high"])
    measured = column.get("measured", np.full(len(rows), np.nan))
    both, held = known & np.isfinite(measured), banded & np.isfinite(measured)
    beyond = (measured < column["low"]) | (measured > column["high"])

    def mean(values: Any, where: Any) -> float | None:
        return float(values[where].mean()) if where.any() else None

    return Estimated(
        unit=unit, known_s=float(known.sum()) * _period(rows),
        estimated=float(column["estimated"][known].mean()),
        low=mean(column["low"], banded), high=mean(column["high"], banded),
        greatest=float(column["estimated"][known].max()),
        measured=mean(measured, both), outside=mean(beyond.astype(float), held),
    )  # fmt: skip


def _not_estimated(log: _Log, twin: Mapping[str, Estimated], day: str) -> dict[str, str]:
    if log.twin is None:
        return dict.fromkeys(QUANTITIES, "no state of the twin: run `dvc repro`")
    of_day = log.twin.days.get(day)
    reasons = {} if of_day is None else dict(of_day.unknown)
    return {name: reasons.get(name, "known nowhere in this cycle")
            for name in QUANTITIES if name not in twin}  # fmt: skip


def _blocks(rows: pd.DataFrame) -> tuple[BlockTime, ...]:
    """Time on each line of the program, by the rows of the state table."""
    if "line" not in rows or not rows["line"].notna().any():
        return ()
    lines, counts = np.unique(rows["line"].dropna().astype(int), return_counts=True)
    seconds = (counts * _period(rows)).tolist()
    return tuple(BlockTime(line=n, seconds=s) for n, s in zip(lines.tolist(), seconds, strict=True))


class _Cut:
    """Time that each tool has cut, cycle after cycle."""

    def __init__(self) -> None:
        self.before: dict[str, float] = {}

    def use(self, rows: pd.DataFrame) -> tuple[ToolUse, ...]:
        """Tools of a cycle in the order of their first use."""
        if "tool_number" not in rows:
            return ()
        period, tools = _period(rows), rows["tool_number"].astype(object)
        mode = rows["mode"].astype(object) if "mode" in rows else pd.Series(None, rows.index)
        found = []
        for tool in tools.dropna().unique():
            here = tools == tool
            known = bool(mode[here].notna().to_numpy().any())
            cutting = float((here & (mode == "cut")).sum()) * period
            found.append(ToolUse(
                tool=str(tool), in_spindle_s=float(here.sum()) * period,
                cutting_s=cutting if known else None, cut_before_s=self.before.get(tool, 0.0),
            ))  # fmt: skip
            self.before[tool] = self.before.get(tool, 0.0) + cutting
        return tuple(found)


def _alarms(log: _Log, start: pd.Timestamp, end: pd.Timestamp) -> tuple[PartAlarm, ...]:
    """Alarms that stood at any time of a cycle, with their time in it."""
    if not len(log.alarms):
        return ()
    stood: Any = log.alarms[(log.alarms["start"] < end)
                       & (log.alarms["end"].isna() | (log.alarms["end"] > start))]  # fmt: skip
    return tuple(
        PartAlarm(
            level=str(a.level), code=str(a.code), message=str(a.message),
            start=a.start.tz_convert(log.zone).isoformat(),
            seconds=None if pd.isna(a.end)
            else (min(a.end, end) - max(a.start, start)).total_seconds(),
            line=None if pd.isna(a.line) else int(a.line),
        )
        for a in stood.itertuples()
    )  # fmt: skip


def _programs(folder: Path) -> dict[str, tuple[ProgramFile, ...]]:
    """Simulated programs of a machine by name."""
    found: dict[str, list[ProgramFile]] = {}
    for path in sorted(folder.glob("*.json")):
        one = read_json(path, SimulatedProgram)
        found.setdefault(one.program, []).append(ProgramFile(
            file=one.file, sha256=one.sha256, predicted_s=one.total_time_s,
            predicted_90_s=one.total_time_90_s,
        ))  # fmt: skip
    return {name: tuple(files) for name, files in found.items()}
