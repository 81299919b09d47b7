"""The newest calendar week on one axis of time; its time and alarms beside the week before."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta

import numpy as np
import pandas as pd

from pipeline.charts.bands import Axis, Block, Strip, strips_figure
from pipeline.charts.numbers import signed, tenths
from pipeline.charts.sections import Section, drawing, present
from pipeline.charts.tables import Cell, Column, code, sources, tabulated
from pipeline.report.alarms import Alarm, no_alarms
from pipeline.report.components import KEYS, component_of, weeks_worked
from pipeline.report.condition import first_of
from pipeline.report.facts import MachineFacts
from pipeline.report.texts import Texts
from pipeline.report.twin_state import HEAT, SHOWN, days_since, parts_by, state_rows, strip_of
from pipeline.report.work import BIN, NO_RECORD, STOPPED, Day, days_between
from pipeline.report.work_section import state_class
from pipeline.schema.condition import week_of
from pipeline.schema.days import clock, day_of, day_start
from pipeline.schema.si import DAY, NS

STEP = "5min"
"""Step of the curves of a week."""
BURST_S = 1800.0
"""Time between alarms of one text within which they are one mark [s]."""
LEAST_SHARE = 0.1
"""Share of a step that must be known."""
STOPS = 3
MOST_FAULTS = 4
"""Stops, and alarms, that are named."""
LEGEND = (
    ("s-active", "active", "box"), ("s-ready", "ready", "box"), ("s-hold", "hold", "box"),
    ("s-interrupted", "interrupted", "box"), ("s-stopped", "stopped", "box"),
    ("s-other", "other", "box"), ("s-off", "off", "box"), ("s-none", "lost", "hatch"),
    ("measured", "measured", "line"), ("window", "estimated", "line"), ("s-band", "band", "box"),
    ("s-most", "most", "box"), ("s-over", "fault", "box"), ("s-warned", "warning", "box"),
)  # fmt: skip
"""Class of what is drawn, key of its words, shape; the legend holds those that occur."""


def week_days(week: str) -> list[str]:
    """The seven days of a calendar week."""
    return [(first_of(week) + timedelta(days=k)).isoformat() for k in range(7)]


def week_section(facts: MachineFacts, say: Texts) -> Section | None:
    """States, spindle temperature, load and alarms of the newest week; None without a log."""
    weeks = weeks_worked(facts)
    if not weeks:
        return None
    first = first_of(weeks[-1])
    days = week_days(weeks[-1])
    strips = [_states(facts, days, say)]
    columns = ("time", "spindle_load", *(f"{HEAT}_{part}" for part in SHOWN[HEAT]))
    rows, files = state_rows(facts.folders, facts.shelf, days[0], days[-1], columns)
    if not rows.empty:
        strips += _curves(facts, rows, first, say)
    strips += _alarms(facts, days, say)
    axis = Axis(
        words=say("week.axis", zone=facts.work.time_zone), span=(0.0, 7.0), shaded=[(5.0, 7.0)],
        marks=[(float(k), "\u00a0".join(say.day(day).split("\u00a0")[:2]))
               for k, day in enumerate(days)],
    )  # fmt: skip
    drawn = {one.kind for strip in strips for one in strip.blocks}
    drawn |= {curve[0] for strip in strips for curve in strip.curves}
    drawn |= {area[0] for strip in strips for area in strip.areas}
    legend = [("l-" * (form == "line") + kind, say(f"week.{key}"), form)
              for kind, key, form in LEGEND if kind in drawn]  # fmt: skip
    of_week = [path for path in facts.work.state_files if path.stem in days]
    others = (facts.folders.clean / "alarms.parquet", facts.folders.incidents)
    made = sources(facts.shelf, *of_week, *files, *(path for path in others if path))
    limits = "alarm-line" in drawn or any(strip.levels for strip in strips)
    caption = say("week.caption") + say("week.limits") * limits
    figure = drawing(strips_figure(strips, axis, caption, kind="week"), caption, made, legend)
    return Section(key="week", title=say("week.title"), blocks=present(figure))


def _states(facts: MachineFacts, days: Sequence[str], say: Texts) -> Strip:
    """Execution states; off where nothing is expected, hatched where records should be.

    Days after the newest record of any source are not known yet, and empty.
    """
    by, missing = {one.day: one for one in facts.work.days}, {*facts.work.surprising_days}
    live, ends = facts.records.last_live, [*by]
    if live is not None:
        ends.append(day_of(int(live.timestamp()) * NS, facts.work.time_zone))
    if facts.silence is not None:
        missing |= {*facts.work.surprising(days_between([max(by), ends[-1]]))}
    blocks = []
    for k, day in enumerate(days):
        runs = by[day].runs if day in by else [(NO_RECORD, 0, DAY // BIN)]
        for state, start, end in runs if day <= max(ends) else []:
            kind, words = state_class(state), _state(state, say)
            if state == NO_RECORD:
                kind, words = ("s-none", "week.lost") if day in missing else ("s-off", "week.off")
                words = say(words)
            at = [say.clock(x * BIN) for x in (start, end)]
            said = say("week.from_to", what=words, day=say.day(day), start=at[0], end=at[1])
            x = (k + place * BIN / DAY for place in (start, end))
            blocks.append(Block(kind=kind, start=next(x), end=next(x), words=said))
    return Strip(head=say("week.states"), height=16.0, blocks=blocks)


def _state(state: str, say: Texts) -> str:
    """An execution state in words; itself where it is none of MTConnect's."""
    key = f"week.{state_class(state).removeprefix('s-')}"
    return say(key) if say.has(key) and key != "week.other" else state


def _curves(facts: MachineFacts, rows: pd.DataFrame, first: date, say: Texts) -> Iterator[Strip]:
    """Spindle temperature in its band with the line of its rule, and the spindle's load."""
    apart = np.diff(days_since(rows.index, first)) * DAY
    period = float(np.median(apart[apart > 0])) if (apart > 0).any() else 1.0
    least = LEAST_SHARE * pd.Timedelta(STEP).total_seconds() / period
    rules = {} if facts.monitored is None else facts.monitored.rules
    heat = parts_by(rows, HEAT, STEP, least)
    strip = strip_of(say("week.temperature"), HEAT, heat, first, 88.0)
    rule = rules.get("temperature_outside")
    if strip.areas and rule is not None and rule.limit is not None:
        line = heat["estimated"] + rule.limit * (heat["high"] - heat["estimated"])
        curve = "alarm-line", days_since(heat.index, first), line.to_numpy(float)
        strip = replace(strip, curves=[*strip.curves, curve])
    if strip.curves:
        yield _hovered(strip, heat["measured"].fillna(heat["estimated"]), first, "°C", say)
    loads = rows["spindle_load"].resample(STEP)
    load, most = loads.median(), loads.max()
    if load.notna().any():
        limit, x = rules.get("load_over_limit"), days_since(load.index, first)
        middle, top = (one.to_numpy(float) for one in (load, most))
        strip = Strip(
            head=say("week.load"), height=52.0, zero=True, curves=[("measured", x, middle)],
            areas=[("s-most", x, middle, top)],
            levels=[] if limit is None or limit.limit is None else [limit.limit],
        )  # fmt: skip
        yield _hovered(strip, most, first, "%", say)


def _hovered(strip: Strip, values: pd.Series, first: date, unit: str, say: Texts) -> Strip:
    """The same with the value of each hour on hover."""
    hours = values.resample("1h").median().dropna()
    blocks = [
        Block(kind="hover", start=float(x), end=float(x) + 1 / 24, words=say(
            "week.value", day=say.day(at.date().isoformat()), time=f"{at:%H:%M}",
            value=say.number(value), unit=unit))
        for x, at, value in zip(days_since(hours.index, first), hours.index, hours, strict=True)
    ]  # fmt: skip
    return replace(strip, blocks=blocks)


def alarms_in(facts: MachineFacts, week: str) -> list[Alarm]:
    """Alarms of a calendar week, each the part within it; open ones last to the last record."""
    first, zone = first_of(week), facts.work.time_zone
    begin, close = (day_start((first + timedelta(days=k)).isoformat(), zone) for k in (0, 7))
    last = int((facts.work.last or 0.0) * NS)
    within = [
        replace(one, start=max(one.start, begin), end=min(one.end or max(last, one.start), close))
        for one in facts.alarms.alarms
    ]
    return [one for one in within if one.start < close and (one.end or 0) >= begin]


def _alarms(facts: MachineFacts, days: Sequence[str], say: Texts) -> list[Strip]:
    """Alarms by component, repeats joined; nothing in a week without alarms."""
    kinds: dict[tuple[str, str], list[Alarm]] = {}
    for one in alarms_in(facts, week_of(days[0])):
        kinds.setdefault((component_of(one.by, one.message), one.text or one.item), []).append(one)
    lanes = [key for key in KEYS if any(key == kind for kind, _ in kinds)]
    blocks = [
        _burst(burst, text, lanes.index(key), days[0], facts.work.time_zone, say)
        for (key, text), every in kinds.items() for burst in bursts(every)
    ]  # fmt: skip
    names = [say(f"component.{key}") for key in lanes]
    strip = Strip(head=say("week.alarms"), height=13.0 * len(lanes), blocks=blocks, lanes=names)
    return [strip] if lanes else []


def bursts(alarms: Sequence[Alarm]) -> list[list[Alarm]]:
    """Alarms of one text, those of a burst together."""
    found: list[list[Alarm]] = []
    for one in sorted(alarms, key=lambda one: one.start):
        if found and one.start - _end(found[-1]) <= BURST_S * NS:
            found[-1].append(one)
        else:
            found.append([one])
    return found


def _end(burst: Sequence[Alarm]) -> int:
    return max(one.end or one.start for one in burst)


def _burst(burst: list[Alarm], text: str, lane: int, first: str, zone: str, say: Texts) -> Block:
    shown = clock(np.array([burst[0].start, _end(burst)]), zone)
    start, end = (shown - np.datetime64(first, "ns").astype(np.int64)) / (DAY * NS)
    day, time = say.day(day_of(burst[0].start, zone)), say.clock(shown[0] // NS % DAY)
    words = say("week.burst", len(burst), alarm=text, day=day, time=time)
    kind = "s-over" if any(one.level == "fault" for one in burst) else "s-warned"
    return Block(kind=kind, start=float(start), end=float(end), words=words, lane=lane)


@dataclass(frozen=True, kw_only=True)
class Use:
    """Time of a kind in each of some weeks, the newest last [s]."""

    name: str
    each: Sequence[float]


def time_section(facts: MachineFacts, say: Texts) -> Section:
    """Use of the time this week and the week before, and the longest stops."""
    weeks = weeks_worked(facts)
    if not weeks:
        return Section(key="time", title=say("time.title"), text=[say("time.none")])
    days = [[one for one in facts.work.worked_days if one.day in week_days(w)] for w in weeks[-2:]]
    rows = [Use(name=say(f"time.{key}"), each=[_seconds(one, states) for one in days])
            for key, states in STATES.items()]  # fmt: skip
    for kind in KINDS:
        each = [sum(day.kinds.get(kind, 0.0) for day in one) for one in days]
        if any(each):
            rows.append(Use(name=say(f"time.{kind}"), each=each))
    made = sources(facts.shelf, *facts.work.state_files)
    uses = tabulated(say("time.table", count=len(days[-1])), rows, _use_columns(weeks, say), made)
    stops = sorted(_stops(days[-1]), key=lambda one: (one.start - one.end, one.start))
    named = tabulated(say("time.stops"), stops[:STOPS], _stop_columns(facts, say), made,
                      folded=True)  # fmt: skip
    return Section(key="time", title=say("time.title"), blocks=present(uses, named))


KINDS = ("cut", "air", "warm_up")
"""Kinds of segment of the active time, by their key in the texts."""
STATES = {"active": ("ACTIVE",), "stopped": STOPPED, "ready": (), "none_known": (NO_RECORD,)}
"""Execution states by the key of their row; the empty one is of all others."""


def _seconds(days: Sequence[Day], states: Sequence[str]) -> float:
    """Time in some states, in all but those of the other rows where there are none [s]."""
    named = {state for one in STATES.values() for state in one}
    return sum(
        seconds for day in days for state, seconds in day.seconds.items()
        if (state in states if states else state not in named)
    )  # fmt: skip


def _named(weeks: Sequence[str], say: Texts) -> list[str]:
    """The newest week and the one with records before it, with their years where these differ."""
    each = weeks[:-3:-1]
    years = len({one[:4] for one in each}) > 1
    return [say("week.short", week=int(one[6:])) + f" {one[:4]}" * years for one in each]


def _use_columns(weeks: Sequence[str], say: Texts) -> tuple[Column[Use], ...]:
    def hours(place: int) -> Callable[[Use], str]:
        return lambda one: say.hours(one.each[place])

    def change(one: Use) -> str:
        return say.local(signed((one.each[-1] - one.each[0]) / 3600))

    each = [Column(name, hours(-1 - k), "h") for k, name in enumerate(_named(weeks, say))]
    changes = [Column(say("time.change"), change, "h")] if len(each) > 1 else []
    return (Column(say("time.use"), lambda one: one.name), *each, *changes)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A stop: its state, its start and its end [ns] since 1970."""

    state: str
    start: int
    end: int


def _stops(days: Sequence[Day]) -> list[Stop]:
    """Runs of one stopped state, over midnight too."""
    found: list[Stop] = []
    for day in days:
        for state, start, end in day.stops:
            if found and (found[-1].state, found[-1].end) == (state, start * NS):
                found[-1] = replace(found[-1], end=end * NS)
            else:
                found.append(Stop(state=state, start=start * NS, end=end * NS))
    return found


def _stop_columns(facts: MachineFacts, say: Texts) -> tuple[Column[Stop], ...]:
    def program(one: Stop) -> Cell | str:
        """Program of the last cycle that began on the same day."""
        zone = facts.work.time_zone
        of_day = [c for c in facts.work.cycles or [] if c.program and c.start <= one.start
                  and day_of(c.start, zone) == day_of(one.start, zone)]  # fmt: skip
        return code(max(of_day, key=lambda c: c.start).program) if of_day else "–"

    def alarm(one: Stop) -> str:
        from_on = one.start - BIN * NS
        seen = [a.text for a in facts.alarms.alarms
                if a.text and a.start <= one.end and (a.end or one.end) >= from_on]  # fmt: skip
        return say.some(list(dict.fromkeys(seen)), 1) or "–"

    def since(one: Stop) -> str:
        """Day and time by the plant's clock, as in the strip of the states."""
        zone = facts.work.time_zone
        at = clock(np.array([one.start]), zone)[0] // NS % DAY
        return f"{say.day(day_of(one.start, zone))}, {say.clock(at)}"

    return (
        Column(say("time.since"), since),
        Column(say("time.length"), lambda one: say.duration((one.end - one.start) / NS), ""),
        Column(say("time.state"), lambda one: _state(one.state, say)),
        Column(say("time.program"), program),
        Column(say("time.alarm"), alarm),
    )


def alarms_of_week(facts: MachineFacts, say: Texts) -> Section | None:
    """Alarms with most minutes and most often in the week, beside the week before."""
    if not facts.alarms.alarms:
        return no_alarms(facts.alarms, say)
    zone = facts.work.time_zone
    weeks = weeks_worked(facts) or sorted(
        {week_of(day_of(one.start, zone)) for one in facts.alarms.alarms}
    )
    found = [alarms_in(facts, week) for week in weeks[:-3:-1]]
    kinds: dict[tuple[str, str], list[list[Alarm]]] = {}
    for k, alarms in enumerate(found):
        for one in alarms:
            each = kinds.setdefault((one.level, one.text or one.item), [[] for _ in found])
            each[k].append(one)
    now = [row for row in kinds.items() if row[1][0]]
    most = sorted(now, key=lambda row: -_seconds_of(row[1][0]))[:STOPS]
    often = sorted(now, key=lambda row: -len(row[1][0]))[:STOPS]
    faults = [row for row in now if row[0][0] == "fault"][:MOST_FAULTS]
    rows = list(dict([*most, *often, *faults]).items())
    made = sources(facts.shelf, facts.folders.clean / "alarms.parquet")
    caption = say("alarms.of_week", count=sum(len(row[1][0]) for row in now))
    still = sum(one.ended == "open" for one in facts.alarms.alarms)
    text = [*([] if rows else [say("alarms.no_week")]),
            *([say("alarms.still", count=still)] if still else [])]  # fmt: skip
    table = tabulated(caption, rows, _alarm_columns(weeks, say), made)
    return Section(key="alarms", title=say("alarms.title"), text=text, blocks=present(table))


AlarmRow = tuple[tuple[str, str], list[list[Alarm]]]
"""Level and text of a kind of alarm, its alarms in each of some weeks, the newest first."""


def _seconds_of(alarms: Sequence[Alarm]) -> float:
    return sum(one.seconds or 0.0 for one in alarms)


def _alarm_columns(weeks: Sequence[str], say: Texts) -> tuple[Column[AlarmRow], ...]:
    def minutes(place: int) -> Callable[[AlarmRow], str]:
        return lambda row: say.local(tenths(_seconds_of(row[1][place]) / 60))

    def times(place: int) -> Callable[[AlarmRow], str]:
        return lambda row: say.number(len(row[1][place]))

    names = _named(weeks, say)
    return (
        Column(say("alarms.alarm"), lambda row: Cell(
            text=row[0][1], status="failed" if row[0][0] == "fault" else "attention")),
        *(Column(one, minutes(k), "", say("alarms.minutes")) for k, one in enumerate(names)),
        *(Column(one, times(k), "", say("alarms.times")) for k, one in enumerate(names)),
    )  # fmt: skip
