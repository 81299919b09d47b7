"""Events of a machine's rules, forest and recurring alarms, grouped into incidents, each once."""

from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.rules import (
    RULES,
    TEMPERATURE,
    Rule,
    dwell_name,
    fixed_limits,
    rule_values,
)
from pipeline.monitoring.usual import FOREST, Usual
from pipeline.monitoring.windows import BREAK_S, Windows, dwell, windows_of
from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.days import clock, zone_of
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.incident import Event, Incident, Monitor, Monitored, RuleState, Severity, Who
from pipeline.schema.si import DAY, HOUR, MINUTE, NS
from pipeline.schema.twin_state import TwinState
from pipeline.signals.windows import state_days

KEPT = 12
"""Events that an incident keeps: the first, and those of the greatest share of their limit."""
CONTROL_TYPES = ("SYSTEM", "LOGIC_PROGRAM", "MOTION_PROGRAM", "COMMUNICATIONS")
"""Types of conditions (MTConnect part 2) of a control; others are of a part of the machine."""
PROGRAM_TYPES = ("MOTION_PROGRAM", "SYSTEM")
"""Those that programs and operation cause."""
BEFORE_S = 2.0
"""Time before an alarm in which a program that it stopped ran last [s]."""
CHECKS = {
    "LEVEL": "Level and leaks, then the switch.",
    "PRESSURE": "Pressure at the gauge; pump, filter, leaks, then the sensor.",
    "TEMPERATURE": "Cooling, fan and filter, then the sensor.",
    "LOAD": "What was cut then, and the load without a cut.",
    "ACTUATOR": "Display of the drive; brake, cables.",
    "LOGIC_PROGRAM": "Switch, clamp, door or axis that the control waits for.",
    **dict.fromkeys(PROGRAM_TYPES, "Program, offsets and operation before each of them."),
    **dict.fromkeys(("POSITION", "ANGLE"), "Where the axis stood: offsets, program, limit switch."),
    "operation": "Set-up and operation; the machine if it comes while a program runs, too.",
}
"""What to look at for an alarm, by its type of condition."""
OTHER_CHECK = "What was done before each of them; the control's manual."
EVIDENCE = ("load", "speed", "feed", "temperature", "temperature_estimated", "cutting_power")
"""Quantities beside an event: load [%], speed [rev/min], feed [mm/s], temperatures [°C], power
[W]."""


def monitored(
    state: TwinState, folder: Path, clean: Path, usual: Usual, *, identity: MachineIdentity,
    settings: IncidentSettings, conditions: Mapping[str, tuple[str, str]],
) -> Monitored:  # fmt: skip
    """Incidents of all days of a state, whole weeks at once.

    ``conditions``: part of the machine and MTConnect type by the control's data item.
    """
    windows = windows_of(folder, clean, sorted(state.days), settings)
    events, rules = scored(windows, state, usual, settings)
    alarms = recurring(clean / "alarms.parquet", identity, settings, conditions)
    incidents = [*grouped(events, windows, identity, settings), *alarms]
    rules["alarm"] = RuleState(
        limit=float(settings.alarm_times), unit=f"times in {settings.alarm_days} days",
        assessed_s=sum(day.seconds for day in state.days.values()) if conditions else 0.0,
        events=sum(one.count for one in alarms),
        not_assessed="" if conditions else "no condition of the control is in the records",
    )  # fmt: skip
    return Monitored(
        machine=identity.name, origin=identity.origin, days=tuple(sorted(state.days)),
        time_zone=zone_of(clean),
        known_good=usual.monitor.days, rules=rules,
        worked_s=round(float(windows.values["running"].sum()) * windows.length_s, 1),
        incidents=tuple(sorted(incidents, key=lambda one: (one.start, one.component))),
    )  # fmt: skip


def scored(
    windows: Windows, state: TwinState, usual: Usual, settings: IncidentSettings
) -> tuple[list[Event], dict[str, RuleState]]:
    """Events in which a rule held for its dwell, and what each rule was assessed on."""
    values = rule_values(windows, usual.monitor.loads, settings)
    if usual.known_good is not None:
        values[FOREST] = usual.known_good.windows(windows, values)
    given = {name: one for name, one in fixed_limits(settings).items() if not RULES[name].learnt}
    limits = {"temperature_slope": settings.slope_K_min} | given | dict(usual.monitor.limits)
    events, states = list[Event](), dict[str, RuleState]()
    for name, rule in RULES.items():
        limit, assessed, own = limits.get(name), 0.0, list[Ints]()
        if limit is not None and name in values:
            n = dwell(windows, settings.dwell_s[dwell_name(name)])
            own = list(_runs(values[name], limit, windows, n))
            assessed = float(np.isfinite(values[name]).sum()) * windows.length_s
            events += [_event(name, windows, values, run, limit, usual) for run in own]
        states[name] = RuleState(
            limit=limit, unit=rule.unit, assessed_s=assessed, events=len(own),
            not_assessed="" if assessed else _why(name, rule, state, usual.monitor),
        )  # fmt: skip
    return events, states


def _runs(values: Floats, limit: float, windows: Windows, n: int) -> Iterator[Ints]:
    """Places of assessed windows above the limit, ``n`` in a row at least."""
    known = np.flatnonzero(np.isfinite(values))
    over = values[known] > limit
    apart = np.diff(windows.start[known], prepend=windows.start[known[:1]]) > BREAK_S * NS
    edge = np.flatnonzero((np.diff(over.astype(int), prepend=0) != 0) | apart)
    for a, b in zip(edge, np.append(edge, len(known))[1:], strict=True):
        if over[a] and b - a >= n:
            yield known[a:b]


def _why(name: str, rule: Rule, state: TwinState, monitor: Monitor) -> str:
    """Reason for which a rule could not be assessed at all."""
    reasons = [day.unknown[rule.needs] for day in state.days.values() if rule.needs in day.unknown]
    if len(reasons) == len(state.days) > 0:
        return max(reasons, key=reasons.count)
    if rule.component == TEMPERATURE and state.temperature_interval_unknown:
        return state.temperature_interval_unknown
    return monitor.lacking.get(name, f"{rule.needs.replace('_', ' ')} is not in the records")


def _event(
    name: str, windows: Windows, values: Mapping[str, Floats], run: Ints, limit: float,
    usual: Usual,
) -> Event:  # fmt: skip
    rule, have, component = RULES[name], windows.values, RULES[name].component
    top = run[int(np.argmax(values[name][run]))]
    words = {key: str(one[run[0]]) for key, one in windows.words.items() if one[run[0]]}
    if name == FOREST and usual.known_good is not None:
        furthest = usual.known_good.furthest(windows, values, int(top))
        words["furthest from usual"] = ", ".join(one.replace("_", " ") for one in furthest)
        component = TEMPERATURE if "temperature" in furthest[0] else component
    return Event(
        rule=name, component=component, severity=rule.severity, unit=rule.unit, words=words,
        start=_text(int(windows.start[run[0]])),
        end=_text(int(windows.start[run[-1]] + windows.length_s * NS)),
        value=round(float(values[name][top]), 3), limit=round(limit, 3),
        values={key: round(float(np.nanmean(have[key][run])), 3) for key in EVIDENCE
                if np.isfinite(have[key][run]).any()},
    )  # fmt: skip


def grouped(
    events: Sequence[Event], windows: Windows, identity: MachineIdentity,
    settings: IncidentSettings,
) -> list[Incident]:  # fmt: skip
    """Incidents of one component each: events on one day, or within ``join_h`` of work.

    What the forest finds while a rule holds belongs to the rule's incident.
    """
    worked = np.append(0.0, np.cumsum(windows.values["running"])) * windows.length_s / HOUR

    def follows(group: list[Event], event: Event) -> bool:
        end = max(one.end for one in group)
        a, b = np.searchsorted(windows.start, [_time(end), _time(event.start)])
        same_day = windows.day[a - 1] >= windows.day[b]
        return bool(same_day) or worked[b] - worked[a] <= settings.join_h

    def kind(event: Event) -> tuple[bool, str]:
        return event.rule == FOREST, event.component

    groups: list[list[Event]] = []
    for event in sorted(events, key=lambda one: (*kind(one), one.start)):
        near = [group for group in groups if event.rule == FOREST and any(
            one.start <= event.end and event.start <= one.end for one in group)]  # fmt: skip
        last = groups[-1:]
        same = [one for one in last if kind(one[0]) == kind(event) and follows(one, event)]
        for group in (near or same)[:1]:
            group.append(event)
        if not near and not same:
            groups.append([event])
    return [_incident(group, identity) for group in groups]


def _incident(events: Sequence[Event], identity: MachineIdentity) -> Incident:
    by_rule = sorted(events, key=lambda one: (one.rule == FOREST, list(RULES).index(one.rule)))
    rule, first = RULES[by_rule[0].rule], min(events, key=lambda one: one.start)
    most = max((one for one in events if one.rule == by_rule[0].rule),
               key=lambda one: one.value / one.limit)  # fmt: skip
    named = {"tool_number": "tool {}", "program": "program {}"}
    where = [most.component, *(say.format(most.words[key]) for key, say in named.items()
                               if key in most.words)]  # fmt: skip
    says = f"{', '.join(where)}: {most.value:.3g} {most.unit}, limit {most.limit:.3g}"
    acts = any(one.severity == "act" for one in events)
    return incident_of(
        events, identity, component=by_rule[0].component, severity="act" if acts else "watch",
        title=rule.title, check=rule.check, found=says, who=rule.who, key=first.rule,
    )  # fmt: skip


def incident_of(
    events: Sequence[Event], identity: MachineIdentity, *, component: str, severity: Severity,
    title: str, check: str, found: str, who: Who, key: str,
) -> Incident:  # fmt: skip
    """An incident; its id is that of machine, component, first rule and first day."""
    ordered = sorted(events, key=lambda one: (one.start, one.rule))
    by_share = sorted(ordered, key=lambda one: -one.value / one.limit)[: KEPT - 1]
    kept = [one for one in ordered if one is ordered[0] or one in by_share]
    text = "|".join((identity.name, component, key, ordered[0].start[:10]))
    spans = pd.DataFrame([(_time(one.start), _time(one.end)) for one in ordered])
    return Incident(
        id=sha256(text.encode()).hexdigest()[:16], machine=identity.name, origin=identity.origin,
        component=component, severity=severity, title=title, check=check, found=found, who=who,
        start=ordered[0].start, end=max(one.end for one in ordered),
        seconds=_union(spans.to_numpy()) / NS, count=len(ordered), events=tuple(kept),
    )  # fmt: skip


def _union(spans: Ints) -> float:
    """Time within spans (K, 2) in the order of their begins, those that overlap once."""
    end = np.maximum.accumulate(np.concatenate([spans[:1, 0], spans[:-1, 1]]))
    return float(np.maximum(spans[:, 1] - np.maximum(spans[:, 0], end), 0).sum())


def recurring(
    path: Path, identity: MachineIdentity, settings: IncidentSettings,
    conditions: Mapping[str, tuple[str, str]],
) -> list[Incident]:  # fmt: skip
    """Alarms of the control that recur: one incident a code, as long as it does.

    That is ``alarm_times`` within ``alarm_days``, or more minutes in seven days than in the seven
    before.  An alarm that is open when the agent ends counts up to there.  One of the control that
    was never there while a program ran is of operation, a note.
    """
    table = pq.read_table(path) if path.exists() else None
    if table is None or not len(table):
        return []
    start, end = (table[name].cast(pa.int64()).to_numpy(zero_copy_only=False).astype(float)
                  for name in ("start", "end"))  # fmt: skip
    rows = table.select(["data_item", "level", "code", "message"]).to_pandas().fillna("")
    rows = rows.assign(start=start, end=np.where(np.isnan(end), start, end)).sort_values("start")
    rows["run"] = _in_program(rows, path.parent)
    rows["day"] = clock(rows["start"].to_numpy(np.int64), zone_of(path.parent)) // (DAY * NS)
    return [
        _alarm_incident(group, conditions.get(str(item), ("", "")), identity, settings,
                        runs=bool(some["run"].any()))
        for (item, _, _), some in rows.groupby(["data_item", "code", "message"], sort=False)
        for group in _chains(some, settings)
    ]  # fmt: skip


def _in_program(rows: pd.DataFrame, clean: Path) -> Any:
    """Whether a program ran in each alarm or just before, or that is not known; shape (N,)."""
    zone, spans = zone_of(clean), rows[["start", "end"]].to_numpy(np.int64)
    spans = spans - np.array([round(BEFORE_S * NS), 0])
    first, last = (clock(one, zone).astype("M8[ns]").astype("M8[D]").astype(str) for one in spans.T)
    days, names = np.array(state_days(clean), dtype=str), ["time", "execution", "controller_mode"]
    parts = [np.zeros((3, 0), dtype=np.int64)]
    for day in days[[bool(((first <= day) & (day <= last)).any()) for day in days]]:
        path = clean / "state" / f"{day}.parquet"
        there = [name for name in names if name in pq.read_schema(path).names]
        table = pq.read_table(path, columns=there).to_pandas().reindex(columns=names)
        mode, execution = table["controller_mode"], table["execution"]
        runs = (execution == "ACTIVE") & (mode.isna() | (mode == "AUTOMATIC"))
        time = pd.DatetimeIndex(table["time"]).as_unit("ns").asi8
        parts.append(np.stack([time, execution.notna(), runs]))
    time, known, runs = np.concatenate(parts, axis=1)
    a, b = np.searchsorted(time, spans[:, 0]), np.searchsorted(time, spans[:, 1], "right")
    ran, seen = (np.append(0, np.cumsum(one)) for one in (runs, known))
    return (ran[b] > ran[a]) | (seen[b] == seen[a])


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
    rows: pd.DataFrame, condition: tuple[str, str], identity: MachineIdentity,
    settings: IncidentSettings, *, runs: bool,
) -> Incident:  # fmt: skip
    """Alarms of one code; a fault on several days is to act on, else it is to be watched."""
    where, kind = condition
    item, code, message = rows[["data_item", "code", "message"]].iloc[0]
    words, grew = f"{code} {message}".strip() or item, _grew(rows, settings)
    days = rows["day"].nunique()
    operation = kind in CONTROL_TYPES and not runs
    acts: Severity = "act" if days > 1 and (rows["level"] == "fault").any() else "watch"
    acts = "note" if operation else acts
    component = f"{where} ({item})" if where else str(item)
    events = [
        Event(
            rule="alarm", component=component, severity=acts, start=_text(begin), end=_text(end),
            value=float(len(rows)), limit=float(settings.alarm_times), unit="times",
            words={"alarm": words, "level": level},
        )
        for begin, end, level in zip(rows["start"].astype(int).tolist(),
                                     rows["end"].astype(int).tolist(), rows["level"], strict=True)
    ]  # fmt: skip
    growth = "" if grew is None else (
        f"; {grew[0]:.0f} min in its last 7 days, {grew[1]:.0f} min in the 7 before")  # fmt: skip
    when = f"{days} days" if days > 1 else "one day"
    when += ", never while a program ran" * operation
    longest = float((rows["end"] - rows["start"]).max()) / NS
    stood = f"{longest:.0f} s" if longest < MINUTE else f"{longest / MINUTE:.0f} min"
    check = CHECKS.get("operation" if operation else kind, OTHER_CHECK)
    who: Who = "process engineer" if operation or kind in PROGRAM_TYPES else "maintenance"
    return incident_of(
        events, identity, component=component, severity=acts,
        title=f"Alarm {words} comes again: {len(rows)} times on {when}{growth}",
        check=check, found=f"{component}, {words}, up to {stood}", key=f"alarm {words}", who=who,
    )  # fmt: skip


def _text(time: int) -> str:
    return f"{np.datetime64(time // NS, 's')}Z"


def _time(text: str) -> int:
    return int(np.datetime64(text.removesuffix("Z"), "ns").astype(np.int64))
