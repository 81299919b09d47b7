"""Events of a machine's rules, forest and recurring alarms, grouped into incidents, each once."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.monitoring.forest import KnownGood, features
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.rules import RULES, Rule, dwell_name, fixed_limits, rule_values
from pipeline.monitoring.usual import FOREST
from pipeline.monitoring.windows import Windows, dwell, windows_of
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.incident import Event, Incident, Monitor, Monitored, RuleState, Severity
from pipeline.schema.si import DAY, HOUR, MINUTE, NS
from pipeline.schema.twin_state import TwinState

BREAK_S = 900.0
"""Time between two assessed windows that ends a run of them [s]."""
KEPT = 12
"""Events that an incident keeps: the first, and those of the greatest share of their limit."""
PROGRAM_TYPES = ("MOTION_PROGRAM", "SYSTEM")
"""Types of conditions (MTConnect part 2) that programs and operation cause."""
PROGRAM_CHECK = "Program, offsets and operation before each of them; the control's manual."
ALARM_CHECK = "What was done before each of them: axis, clamp, door, level; the control's manual."
UNITS = {"load": "%", "speed": "rev/min", "feed": "mm/s", "temperature": "°C",
         "temperature_estimated": "°C", "cutting_power": "W"}  # fmt: skip
"""Evidence of an event, and its units."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Windows of an event: rule, first and last one, the one of the greatest value."""

    rule: str
    places: Ints
    value: float
    limit: float
    furthest: tuple[str, ...] = ()


def monitored(
    state: TwinState, folder: Path, clean: Path, monitor: Monitor, known_good: KnownGood | None,
    settings: IncidentSettings, conditions: Mapping[str, tuple[str, str]],
) -> Monitored:  # fmt: skip
    """Incidents of all days of a state, whole weeks at once.

    ``conditions``: part of the machine and MTConnect type by the control's data item.
    """
    windows = windows_of(state, folder, clean, sorted(state.days), settings)
    runs, rules = scored(windows, state, monitor, known_good, settings)
    events = [_event(windows, run) for run in runs]
    worked = np.cumsum(windows.values["running"]) * windows.length_s if len(windows) else np.zeros(1)
    incidents = grouped(events, windows.start, worked, state, settings)
    incidents += recurring(clean / "alarms.parquet", state, settings, conditions)
    return Monitored(
        machine=state.machine, origin=state.origin, days=tuple(sorted(state.days)),
        known_good=monitor.days, worked_s=round(float(worked[-1]), 1), rules=rules,
        incidents=tuple(sorted(incidents, key=lambda one: (one.start, one.component))),
    )  # fmt: skip


def scored(
    windows: Windows, state: TwinState, monitor: Monitor, known_good: KnownGood | None,
    settings: IncidentSettings,
) -> tuple[list[Run], dict[str, RuleState]]:  # fmt: skip
    """Runs of windows in which a rule held for its dwell, and what each rule was assessed on."""
    values = rule_values(windows, monitor.loads, settings)
    given = {name: one for name, one in fixed_limits(settings).items()
             if not RULES[name].learnt or name == "temperature_slope"}  # fmt: skip
    limits = given | dict(monitor.limits)
    x, places = features(windows, monitor.features, values["cut_load_high"], settings)
    values[FOREST] = np.full(len(windows), np.nan)
    if known_good is not None:
        values[FOREST][places] = known_good.scores(x)
    found: list[Run] = []
    states: dict[str, RuleState] = {}
    for name, rule in RULES.items():
        limit = limits.get(name)
        known = np.isfinite(values[name]) if limit is not None else np.zeros(len(windows), bool)
        own = []
        if limit is not None:
            n = dwell(windows, settings.dwell_s[dwell_name(name)])
            own = list(_runs(name, values[name], limit, windows, n))
        found += own
        assessed = float(known.sum()) * windows.length_s
        states[name] = RuleState(
            limit=limit, unit=rule.unit, assessed_s=assessed, events=len(own),
            not_assessed="" if assessed else _why(name, rule, state, monitor),
        )  # fmt: skip
    where = {int(place): k for k, place in enumerate(places)}
    named = []
    for run in found:
        if run.rule == FOREST and known_good is not None:
            at = run.places[int(np.argmax(values[FOREST][run.places]))]
            furthest = known_good.furthest(x[where[int(at)]])
            run = replace(run, furthest=tuple(known_good.names[k] for k in furthest))
        named.append(run)
    return named, states


def _runs(name: str, values: Floats, limit: float, windows: Windows, n: int) -> Iterator[Run]:
    """Assessed windows above the limit, ``n`` in a row at least."""
    known = np.flatnonzero(np.isfinite(values))
    over = values[known] > limit
    apart = np.diff(windows.start[known], prepend=windows.start[known[:1]]) > BREAK_S * NS
    edge = np.flatnonzero((np.diff(over.astype(int), prepend=0) != 0) | apart)
    for a, b in zip(edge, [*edge[1:], len(known)], strict=True):
        if over[a] and b - a >= n:
            places = known[a:b]
            yield Run(rule=name, places=places, value=float(values[places].max()), limit=limit)


def _why(name: str, rule: Rule, state: TwinState, monitor: Monitor) -> str:
    """Reason for which a rule could not be assessed at all."""
    sums: dict[str, float] = {}
    for day in state.days.values():
        for reason, seconds in day.unknown_s.get(rule.needs, {}).items():
            sums[reason] = sums.get(reason, 0.0) + seconds
    if sums:
        return max(sums, key=lambda reason: sums[reason])
    if name in monitor.lacking:
        return monitor.lacking[name]
    return f"{rule.needs.replace('_', ' ')} is not in the records"


def _event(windows: Windows, run: Run) -> Event:
    rule, at = RULES[run.rule], run.places[0]
    have = windows.values
    shown = {name: round(float(np.nanmean(have[name][run.places])), 3) for name in UNITS
             if np.isfinite(have[name][run.places]).any()}  # fmt: skip
    words = {name: str(one[at]) for name, one in windows.words.items() if one[at]}
    if run.furthest:
        words["furthest from usual"] = ", ".join(one.replace("_", " ") for one in run.furthest)
    component = rule.component
    if run.rule == FOREST and any("temperature" in one for one in run.furthest[:1]):
        component = RULES["temperature_outside"].component
    return Event(
        rule=run.rule, component=component, severity=rule.severity,
        start=_text(int(windows.start[at])),
        end=_text(int(windows.start[run.places[-1]] + windows.length_s * NS)),
        value=round(run.value, 3), limit=round(run.limit, 3), unit=rule.unit, values=shown,
        words=words,
    )  # fmt: skip


def grouped(
    events: Sequence[Event], start: Ints, worked: Floats, state: TwinState,
    settings: IncidentSettings,
) -> list[Incident]:  # fmt: skip
    """Incidents of one component each: events on one day, or within ``join_h`` of work.

    What the forest finds while a rule holds belongs to the rule's incident.
    """
    def hours(text: str) -> float:
        place = np.searchsorted(start, _time(text), side="right") - 1
        return float(worked[max(place, 0)]) / HOUR

    groups: list[list[Event]] = []
    by_rule = [one for one in events if one.rule != FOREST]
    for event in sorted(by_rule, key=lambda one: (one.component, one.start)):
        before = groups[-1] if groups else None
        if before and before[0].component == event.component and (
            max(one.end for one in before)[:10] == event.start[:10]
            or hours(event.start) - max(hours(one.end) for one in before) <= settings.join_h
        ):  # fmt: skip
            before.append(event)
        else:
            groups.append([event])
    alone = []
    for event in sorted((one for one in events if one.rule == FOREST), key=lambda one: one.start):
        near = [group for group in groups
                if any(one.start <= event.end and event.start <= one.end for one in group)]  # fmt: skip
        if near:
            near[0].append(event)
        elif alone and (alone[-1][-1].end[:10] == event.start[:10]
                        or hours(event.start) - hours(alone[-1][-1].end) <= settings.join_h):  # fmt: skip
            alone[-1].append(event)
        else:
            alone.append([event])
    return [_incident(group, state) for group in (*groups, *alone)]


def _incident(events: Sequence[Event], state: TwinState) -> Incident:
    by_rule = sorted(events, key=lambda one: (one.rule == FOREST, list(RULES).index(one.rule)))
    rule, first = RULES[by_rule[0].rule], min(events, key=lambda one: one.start)
    acts = any(one.severity == "act" for one in events)
    return incident_of(
        events, state, component=by_rule[0].component, severity="act" if acts else "watch",
        title=rule.title, check=rule.check, who=rule.who, key=first.rule,
    )  # fmt: skip


def incident_of(
    events: Sequence[Event], state: TwinState, *, component: str, severity: Severity, title: str,
    check: str, who: str, key: str,
) -> Incident:  # fmt: skip
    """An incident; its id is that of machine, component, first rule and first day."""
    ordered = sorted(events, key=lambda one: (one.start, one.rule))
    by_share = sorted(ordered, key=lambda one: -one.value / one.limit)[: KEPT - 1]
    kept = [one for one in ordered if one is ordered[0] or one in by_share]
    text = "|".join((state.machine, component, key, ordered[0].start[:10]))
    spans = pd.DataFrame([(_time(one.start), _time(one.end)) for one in ordered])
    return Incident(
        id=sha256(text.encode()).hexdigest()[:16], machine=state.machine, origin=state.origin,
        component=component, severity=severity, title=title, check=check, who=who,  # type: ignore[arg-type]
        start=ordered[0].start, end=max(one.end for one in ordered),
        seconds=_union(spans.to_numpy()) / NS, count=len(ordered), events=tuple(kept),
    )  # fmt: skip


def _union(spans: Ints) -> float:
    """Time within spans (K, 2) in the order of their begins, those that overlap once."""
    end = np.maximum.accumulate(np.concatenate([spans[:1, 0], spans[:-1, 1]]))
    return float(np.maximum(spans[:, 1] - np.maximum(spans[:, 0], end), 0).sum())


def recurring(
    path: Path, state: TwinState, settings: IncidentSettings,
    conditions: Mapping[str, tuple[str, str]],
) -> list[Incident]:  # fmt: skip
    """Alarms of the control that recur: one incident a code, as long as it does.

    That is ``alarm_times`` within ``alarm_days``, or more minutes in seven days than in the seven
    before.  An alarm that is open when the agent ends counts up to there.
    """
    table = pq.read_table(path) if path.exists() else None
    if table is None or not len(table):
        return []
    start, end = (table[name].cast(pa.int64()).to_numpy(zero_copy_only=False).astype(float)
                  for name in ("start", "end"))  # fmt: skip
    rows = table.select(["data_item", "level", "code", "message"]).to_pandas().fillna("")
    rows = rows.assign(start=start, end=np.where(np.isnan(end), start, end)).sort_values("start")
    return [
        _alarm_incident(group, conditions.get(str(item), ("", "")), state, settings)
        for (item, _, _), some in rows.groupby(["data_item", "code", "message"], sort=False)
        for group in _chains(some, settings)
    ]


def _chains(rows: pd.DataFrame, settings: IncidentSettings) -> Iterator[pd.DataFrame]:
    """Alarms of one code that recur, apart by more than ``alarm_days``."""
    start = rows["start"].to_numpy()
    length = settings.alarm_days * DAY * NS
    chain = np.cumsum(np.diff(start, prepend=start[:1]) > length)
    for number in np.unique(chain):
        group = rows[chain == number]
        own = group["start"].to_numpy()
        often = np.searchsorted(own, own + length, side="right") - np.arange(len(own))
        if often.max() >= settings.alarm_times or _grew(group, settings) is not None:
            yield group


def _grew(rows: pd.DataFrame, settings: IncidentSettings) -> tuple[float, float] | None:
    """Minutes of the seven days up to the last alarm, and of those before, where they grew."""
    last = rows["end"].max()
    minutes = (rows["end"] - rows["start"]) / NS / MINUTE
    week = ((last - rows["start"]) // (7 * DAY * NS)).astype(int)
    now, before = (float(minutes[week == k].sum()) for k in (0, 1))
    grew = before > 0 and now - before >= settings.alarm_growth_min
    return (now, before) if grew else None


def _alarm_incident(
    rows: pd.DataFrame, condition: tuple[str, str], state: TwinState, settings: IncidentSettings
) -> Incident:
    """Alarms of one code; a fault on several days is to act on, else it is to be watched."""
    where, kind = condition
    item, code, message = rows[["data_item", "code", "message"]].iloc[0]
    words, grew = f"{code} {message}".strip() or item, _grew(rows, settings)
    days = (rows["start"] // (DAY * NS)).nunique()
    acts: Severity = "act" if days > 1 and (rows["level"] == "fault").any() else "watch"
    component = f"{where} ({item})" if where else str(item)
    events = [
        Event(
            rule="alarm", component=component, severity=acts, start=_text(int(one.start)),
            end=_text(int(one.end)), value=float(len(rows)), limit=float(settings.alarm_times),
            unit="times", words={"alarm": words, "level": str(one.level)},
        ) for one in rows.itertuples()
    ]  # fmt: skip
    growth = "" if grew is None else f"; {grew[0]:.0f} min in a week after {grew[1]:.0f}"
    when = f"{days} days" if days > 1 else "one day"
    by_program = kind in PROGRAM_TYPES
    return incident_of(
        events, state, component=component, severity=acts,
        title=f"Alarm {words} comes again: {len(rows)} times on {when}{growth}",
        check=PROGRAM_CHECK if by_program else ALARM_CHECK, key=f"alarm {words}",
        who="process engineer" if by_program else "maintenance",
    )  # fmt: skip


def _text(time: int) -> str:
    return f"{np.datetime64(time // NS, 's')}Z"


def _time(text: str) -> int:
    return int(np.datetime64(text.removesuffix("Z"), "ns").astype(np.int64))
