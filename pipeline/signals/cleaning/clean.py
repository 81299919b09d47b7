"""Incremental cleaning of a machine's records: only the days whose inputs have changed."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.parallel import mapped
from pipeline.schema.days import day_end, day_of, day_start
from pipeline.schema.si import NS
from pipeline.signals.cleaning import tables
from pipeline.signals.cleaning.activity import (
    CONTROLLER,
    USED,
    cycles,
    intervals,
    seconds_in_states,
    segments,
)
from pipeline.signals.cleaning.alarms import AT, LEVELS, Said, alarms
from pipeline.signals.cleaning.day import Carry, Day, clean_day
from pipeline.signals.cleaning.gaps import N_BINS, Gap, ReportingInterval, reporting_interval
from pipeline.signals.cleaning.recorded import (
    LOGGER,
    WHOLE,
    Index,
    conversions,
    files_of,
    index,
    is_trace,
    logged_items,
    near,
    rows_of,
)
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
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


class _Build:
    """One run over all days."""

    def __init__(
        self, signals: Path, out: Path, machine: CleanMachine, settings: CleanSettings
    ) -> None:
        self.signals, self.out, self.machine, self.settings = signals, out, machine, settings
        self.zone = machine.time_zone
        self.converted = conversions(signals, machine)
        out.mkdir(parents=True, exist_ok=True)
        self.before = tables.read_summary(out)
        rules = [tables.code_version(), asdict(machine), asdict(settings), self.converted]
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
            if old.get("key") == key and tables.has_day(self.out, day, old):
                done[day] = old
            else:
                fresh[day] = self._day(day, carry)
                done[day] = self._note(day, key, fresh[day])
            carry = done[day]["carry"]
        tables.drop_days(self.out, keep=[d for d in days if done[d]["seconds"]])
        kept = [d for d in days if d not in fresh]
        tables.write_audit(self.out, [a for d in fresh.values() for a in d.audit], kept, self.zone)
        ended = [gap for d in fresh.values() for gap in d.gaps]
        gaps = tables.write_gaps(self.out, [*ended, *self._open_gaps(carry)], kept, self.zone)
        return self._whole(days, done, list(fresh), gaps)

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
        rows = tables.stacked(parts)
        rows["apart"] = rows["trace"].to_numpy(dtype=bool) & _has_agent(self.indices)
        for item, (factor, offset) in self.converted.items():
            chosen = (rows["data_item"] == item).to_numpy()
            rows.loc[chosen, "number"] = rows.loc[chosen, "number"] * factor + offset
        done = clean_day(
            rows, start, midnight, carry, self.reporting, machine=self.machine,
            settings=self.settings,
        )  # fmt: skip
        tables.write_state(self.out, day, done.state, self.machine)
        return done

    def _note(self, day: str, key: str, done: Day) -> Summary:
        removed = pd.Series([a.rule for a in done.audit], dtype=object).value_counts()
        series = {n: done.series[i] for n, i in self.machine.signals.items() if n in CONTROLLER}
        start, midnight = self._span(day)
        found = intervals(series, midnight)
        inside = tables.clipped(found, start, midnight)
        return {
            "key": key, "carry": done.carry, "seconds": len(done.state) * self.settings.period_s,
            "removed": {str(k): int(v) for k, v in sorted(removed.items())}, **done.counts,
            "execution_s": seconds_in_states(inside) if done.state.size else {},
            "controller": tables.changes(series, start, midnight),
        }  # fmt: skip

    def _open_gaps(self, carry: Carry) -> list[Gap]:
        said = {item: left["said"] for item, left in carry.get("items", {}).items()}
        return [
            Gap(start=last[0], end=None, data_item=item, cause="unavailable")
            for item, last in said.items()
            if last is not None and last[1] is None
        ]

    def _whole(
        self, days: list[str], done: dict[str, Summary], written: list[str], gaps: pd.DataFrame
    ) -> Summary:
        changes = [done[d]["controller"] for d in days]
        end = max((done[d]["carry"]["spoken"] or 0 for d in days), default=0)
        found = intervals(tables.series_of_changes(changes), end)
        made = cycles(found, self.settings)
        tables.write_table(self.out / "cycles.parquet", made)
        state = tables.read_state(self.out, days, [n for n in self.machine.names if n in USED])
        parts = segments(state, self.settings, self.machine.warm_up_programs)
        tables.write_table(self.out / "segments.parquet", parts)
        tables.write_table(self.out / "alarms.parquet", self._alarms(days))
        summary = tables.summary(done, made, parts, gaps, self.indices)
        summary["rules"] = self.rules
        summary["absent"] = self._absent()
        summary["near"] = near(summary["absent"], logged_items(self.signals))
        tables.write_summary(self.out, summary)
        return summary | {"written": sorted(written)}

    def _alarms(self, days: list[str]) -> pd.DataFrame:
        said = [Said(*row) for one in self.indices for row in one.conditions]
        wanted = {day_of(one.time, self.zone) for one in said if one.level in LEVELS}
        state = tables.read_state(
            self.out, [d for d in days if d in wanted], [n for n in self.machine.names if n in AT]
        )
        return alarms(said, state)

    def _absent(self) -> list[str]:
        """Items that the machine's file names and no record has."""
        there = {item for one in self.indices for item in one.intervals}
        return [item for item in self.machine.items if item not in there]
