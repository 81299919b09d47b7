"""Condition of a machine by week: its quantities against their lines, and the time to the alarm.

The value of a week is the mean of its days with Student's interval between days; hours and alarms
are summed, and alarms divided by the time with records.  The reference is the mean of the first
weeks, by their days; a line is crossed where the value is beyond it and the interval is above the
reference, so that one odd day is no alarm.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from hashlib import sha256
from math import isfinite
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import pandas as pd
from scipy import stats

from pipeline.monitoring.day_quantities import ALARMS, RECORDED, DayValues, Key, Reading, day_values
from pipeline.monitoring.prognosis import crossing
from pipeline.schema.condition import Condition, State, TimeToLine, WeekReport, week_of
from pipeline.schema.days import UTC, day_end, day_start, is_day, zone_of
from pipeline.schema.ledger import Night, latest, read_ledger
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.schema.store import read_json, write_json
from pipeline.schema.twin_state import MANIFEST, TwinState, read_day
from pipeline.signals.windows import read_state

T = TypeVar("T")
BUDGET = "error_budget"
RISES = {"axis_load": (20.0, 40.0), "following_error": (25.0, 50.0), "no_load_power": (20.0, 40.0),
         "temperature_rise": (15.0, 30.0), "cycle_time": (5.0, 10.0), "alarms": (100.0, 200.0),
         BUDGET: (80.0, 100.0)}  # fmt: skip
"""Rise of the alert and of the alarm line above the reference by kind [%]."""
MISSING = {
    "axis_load": "no axis’ load and feed rate at a steady speed outside of cuts",
    "following_error": "commanded and actual position of no axis are logged",
    "no_load_power": "no load of the spindle turning steadily without a cut",
    "temperature_rise": "no spindle temperature that rises, with a model that serves",
    "cycle_time": "no program with complete cycles on a day",
    BUDGET: "no night was scored",
    "tool_life": "no record says when a tool was replaced: times in cut are those by tool number",
}  # fmt: skip
"""Why a kind is not assessed where the records of a machine do not have it."""
ALARM_HOURS = 10.0
"""Time with records that alarms are counted in [h]."""
MOST = {"cycle_time": 5, "hours": 16}
"""Components of a kind that are followed, those with the most days."""


@dataclass(frozen=True, kw_only=True)
class ConditionSettings(Ranged, section="condition"):
    """Lines of the condition over weeks, and its prognosis."""

    reference_weeks: Annotated[int, Range(least=1, most=26)] = 2
    """First weeks of a quantity, whose mean the lines stand above."""
    trend_weeks: Annotated[int, Range(least=4, most=104)] = 12
    least_weeks: Annotated[int, Range(least=4, most=104)] = 5
    """Weeks up to the newest that the trend is fitted to, and the least of them."""
    horizon_weeks: Annotated[float, Range(least=1.0, most=104.0, unit="weeks")] = 26.0
    """Time ahead in which a line is looked for."""
    confidence: Annotated[float, Range(above=0.0, below=1.0, unit="1")] = 0.9
    """Share that the interval of the time to the line holds."""
    alert: Mapping[str, Positive] = field(
        default_factory=lambda: {kind: both[0] for kind, both in RISES.items()})  # fmt: skip
    alarm: Mapping[str, Positive] = field(
        default_factory=lambda: {kind: both[1] for kind, both in RISES.items()})  # fmt: skip
    """Rise of the lines above the reference by kind [%]; of an error budget the share of it."""


def _place(week: str) -> float:
    """Monday of a week, counted in weeks."""
    return date.fromisocalendar(int(week[:4]), int(week[6:]), 1).toordinal() / 7


@dataclass(frozen=True, kw_only=True)
class _Weekly:
    """Value of a quantity in one week with its 90 % interval, and its number of days."""

    week: str
    value: float
    low: float | None = None
    high: float | None = None
    days: int = 1


def conditions_of(
    days: Sequence[DayValues], nights: Iterable[Night], settings: ConditionSettings
) -> tuple[tuple[Condition, ...], dict[str, str]]:
    """Conditions in the week of the last of ``days``, by all days up to it, and what is missing."""
    week = week_of(days[-1].day)
    weekly = {**_means(days, settings), **_sums(days), **_budgets(nights, week)}
    weekly = {key: one for key, one in weekly.items() if one}
    by_kind: dict[str, list[Key]] = {}
    for key in sorted(weekly, key=lambda key: (-sum(one.days for one in weekly[key]), key)):
        by_kind.setdefault(key[1], []).append(key)
    chosen = [key for kind, keys in by_kind.items() for key in keys[: MOST.get(kind)]
              if kind != "hours" or weekly[key][-1].week == week]  # fmt: skip
    found = tuple(_assessed(key, weekly[key], week, settings) for key in sorted(chosen))
    return found, {kind: why for kind, why in MISSING.items() if kind not in by_kind}


def _means(
    days: Sequence[DayValues], settings: ConditionSettings
) -> dict[Key, list[_Weekly]]:  # fmt: skip
    """Weekly means; of a quantity at a speed those at the one that is usual in its first weeks."""
    known: dict[Key, list[tuple[str, Reading]]] = {}
    at_speed: dict[Key, dict[float, list[tuple[str, Reading, float]]]] = {}
    for one in days:
        for key, value in one.values.items():
            known.setdefault(key, []).append((one.day, value))
        for (key, speed), (value, seconds) in one.at_speed.items():
            rows = at_speed.setdefault(key, {}).setdefault(speed, [])
            rows.append((one.day, value, seconds))
    over_model = {key[:2] for key in known}
    for (component, kind, words, unit), speeds in at_speed.items():
        weeks = sorted({week_of(day) for rows in speeds.values() for day, _, _ in rows})
        first = set(weeks[: settings.reference_weeks])
        times = {speed: sum(s for day, _, s in rows if week_of(day) in first)
                 for speed, rows in speeds.items()}  # fmt: skip
        usual = max(times, key=lambda speed: (times[speed], speed))
        if (component, kind) not in over_model:
            rows = speeds[usual]
            key = (component, kind, words.format(f"{usual:g}"), unit)
            known[key] = [(day, value) for day, value, _ in rows]
    return {key: [_mean(week, values) for week, values in _by_week(rows)]
            for key, rows in known.items()}  # fmt: skip


def _by_week(rows: Iterable[tuple[str, T]]) -> list[tuple[str, list[T]]]:
    weeks: dict[str, list[T]] = {}
    for day, value in rows:
        weeks.setdefault(week_of(day), []).append(value)
    return sorted(weeks.items())


def _mean(week: str, readings: list[Reading]) -> _Weekly:
    """Mean of the days of a week, Student's interval between them from two days on."""
    (values, halves), n = np.array(readings).T, len(readings)
    mean = float(values.mean())
    if n < 2:
        return _Weekly(week=week, value=mean)
    between = stats.t.ppf(0.95, n - 1) * values.std(ddof=1) / np.sqrt(n)
    half = float(np.hypot(between, halves.mean()))
    return _Weekly(week=week, value=mean, low=mean - half, high=mean + half, days=n)


def _sums(days: Sequence[DayValues]) -> dict[Key, list[_Weekly]]:
    """Weekly sums; alarms over the hours with records, with the interval of Poisson's counts."""
    known: dict[Key, list[tuple[str, float]]] = {}
    for one in days:
        for key, value in one.sums.items():
            known.setdefault(key, []).append((one.day, value))
    found = {key: [_Weekly(week=week, value=sum(values), days=len(values))
                   for week, values in _by_week(rows)] for key, rows in known.items()}  # fmt: skip
    hours = {one.week: one.value for one in found[RECORDED]}
    if ALARMS in found:
        found[ALARMS] = [_rate(one, ALARM_HOURS / hours[one.week])
                         for one in found[ALARMS] if hours[one.week]]  # fmt: skip
    return found


def _rate(one: _Weekly, factor: float) -> _Weekly:
    low = float(stats.chi2.ppf(0.05, 2 * one.value) / 2) if one.value else 0.0
    high = float(stats.chi2.ppf(0.95, 2 * one.value + 2) / 2)
    return replace(one, value=factor * one.value, low=factor * low, high=factor * high)


def _budgets(nights: Iterable[Night], week: str) -> dict[Key, list[_Weekly]]:
    """Greatest error of the nights of each week over its budget, by what is scored [%]."""
    shares: dict[Key, list[tuple[str, float]]] = {}
    for one in latest(nights):
        if one.share is not None and is_day(one.night) and week_of(one.night) <= week:
            words = " ".join(filter(None, (one.quantity.replace("_", " "), one.regime)))
            key = (f"model of {one.submodel}", BUDGET, f"error of {words} over its budget", "%")
            shares.setdefault(key, []).append((one.night, 100 * one.share))
    return {key: [_Weekly(week=w, value=max(values), days=len(values))
                  for w, values in _by_week(rows)] for key, rows in shares.items()}  # fmt: skip


def _assessed(
    key: Key, weekly: Sequence[_Weekly], week: str, settings: ConditionSettings
) -> Condition:
    """A quantity in a week against its lines."""
    component, kind, what, unit = key
    found = Condition(component=component, kind=kind, what=what, unit=unit)
    last = weekly[-1]
    if last.week != week:
        return replace(found, reason=f"not known this week, last in {last.week}")
    found = replace(found, value=last.value, low=last.low, high=last.high, days=last.days)
    if kind not in settings.alert or kind not in settings.alarm:
        return replace(found, state="no line")
    rises = settings.alert[kind], settings.alarm[kind]
    lines: tuple[float, ...] = rises
    reference = 0.0
    if kind != BUDGET:
        needed = settings.reference_weeks + 1
        if len(weekly) < needed:
            return replace(found, reason=f"{len(weekly)} of {needed} weeks needed")
        first = weekly[: settings.reference_weeks]
        reference = float(np.average([w.value for w in first], weights=[w.days for w in first]))
        if kind == "alarms":
            reference = max(reference, 1.0)  # none is no scale for the lines
        elif reference <= 0:
            return replace(found, reason="its reference is 0: nothing to compare with")
        lines = tuple(reference * (1 + rise / 100) for rise in rises)
    risen = last.low is None or last.low > reference
    states: tuple[State, ...] = ("fine", "watch", "act")
    state = states[risen * sum(last.value >= line for line in lines)]
    found = replace(found, reference=reference, alert=lines[0], alarm=lines[1], state=state)
    trend = weekly[-settings.trend_weeks :]
    if len(trend) < settings.least_weeks:
        why = f"time to the line: {len(trend)} of {settings.least_weeks} weeks needed"
        return replace(found, reason=why)
    return replace(found, to_alarm=_to_line(trend, lines[1], settings))


def _to_line(
    trend: Sequence[_Weekly], line: float, settings: ConditionSettings
) -> TimeToLine:  # fmt: skip
    weeks = np.array([_place(one.week) for one in trend])
    values = np.array([one.value for one in trend])
    one = crossing(weeks, values, line, horizon=settings.horizon_weeks,
                   confidence=settings.confidence)  # fmt: skip
    median, low, high = (
        round(end, 1) if isfinite(end) else None for end in (one.median, one.low, one.high)
    )
    return TimeToLine(
        median=median, low=low, high=high, probability=round(one.probability, 3),
        horizon=settings.horizon_weeks, confidence=settings.confidence,
    )  # fmt: skip


def write_reports(
    twin_state: Path, clean: Path, ledger: Path, out: Path, *, settings: ConditionSettings,
    turning_rpm: float,
) -> None:  # fmt: skip
    """Write the report of each week that is new or whose records have changed, and the newest."""
    state = read_json(twin_state / MANIFEST, TwinState)
    nights, zone = read_ledger(ledger), zone_of(clean)
    begun = {name: pd.read_parquet(clean / f"{name}.parquet") for name in ("cycles", "alarms")}
    out.mkdir(parents=True, exist_ok=True)
    days: list[DayValues] = []
    weeks: dict[str, list[str]] = {}
    for day in sorted(state.days):
        since, until = (pd.Timestamp(end(day, zone), tz=UTC) for end in (day_start, day_end))
        own = {name: table[(table["start"] >= since) & (table["start"] < until)]
               for name, table in begun.items()}  # fmt: skip
        rows = read_day(twin_state, day).to_pandas()
        days.append(day_values(
            day, rows, read_state(clean, day).reset_index(), **own, period_s=state.period_s,
            turning_rpm=turning_rpm,
        ))  # fmt: skip
        weeks.setdefault(week_of(day), []).append(day)
    for week, own_days in weeks.items():
        files = [(clean / "state" / f"{day}.parquet").read_bytes() for day in own_days]
        records = sha256(b"".join(files)).hexdigest()[:16]
        path = out / f"{week}.json"
        remedy = f"delete {path} and run `dvc repro`"
        kept = read_json(path, WeekReport, remedy) if path.exists() else None
        if kept is None or kept.records != records or week == max(weeks):
            found, missing = conditions_of(
                [one for one in days if week_of(one.day) <= week], nights, settings
            )
            report = WeekReport(week=week, days=tuple(own_days), records=records,
                                bundle=state.bundle, conditions=found, missing=missing)  # fmt: skip
            write_json(report, path)
