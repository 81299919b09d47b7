"""The newest calendar week on one axis of time, twelve weeks as small curves, use of the time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta

import numpy as np
import pandas as pd
from markupsafe import Markup

from pipeline.charts.bands import Axis, Block, Strip, strips_figure
from pipeline.charts.sections import Figure, Figures, Section, drawing, present
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.alarms import Alarm, no_alarms
from pipeline.report.components import KEYS, component_of, weeks_worked
from pipeline.report.condition import MOST_WEEKS, week_sources
from pipeline.report.facts import MachineFacts
from pipeline.report.texts import Texts
from pipeline.report.twin_state import HEAT, SHOWN, days_since, parts_by, state_rows, strip_of
from pipeline.report.work import BIN, NO_RECORD, Day
from pipeline.report.work_section import state_class
from pipeline.schema.arrays import Floats
from pipeline.schema.condition import Condition, week_of
from pipeline.schema.days import clock, day_of, instant
from pipeline.schema.si import DAY, NS

STEP = "5min"
"""Step of the curves of a week."""
BURST_S = 1800.0
"""Time between alarms of one text within which they are one mark [s]."""
LEAST_SHARE = 0.1
"""Share of a step that must be known."""
STOPS = 3
"""Stops, and alarms, that are named."""
SHOWN_CONDITIONS = 6
"""Quantities over twelve weeks, those beyond a line first."""
STOPPED = ("FEED_HOLD", "INTERRUPTED", "STOPPED", "PROGRAM_STOPPED", "OPTIONAL_STOP")


def first_of(week: str) -> date:
    """Monday of a calendar week.

    >>> first_of("2026-W04").isoformat()
    '2026-01-19'
    """
    return date.fromisocalendar(int(week[:4]), int(week[6:]), 1)


def week_section(facts: MachineFacts, say: Texts) -> Section | None:
    """States, spindle temperature, load and alarms of the newest week; None without a log."""
    weeks = weeks_worked(facts)
    if not weeks:
        return None
    first = first_of(weeks[-1])
    days = [(first + timedelta(days=k)).isoformat() for k in range(7)]
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
    legend = [("s-active", say("week.active"), "box"), ("s-ready", say("week.ready"), "box"),
              ("s-hold", say("week.hold"), "box"), ("s-off", say("week.off"), "box"),
              ("s-none", say("week.lost"), "hatch"), ("l-measured", say("week.measured"), "line"),
              ("l-window", say("week.estimated"), "line"),
              ("s-band", say("week.band"), "box")]  # fmt: skip
    made = sources(facts.shelf, *facts.work.state_files, *files)
    caption = say("week.caption")
    figure = drawing(strips_figure(strips, axis, caption, kind="week"), caption, made, legend)
    return Section(key="week", title=say("week.title"), blocks=present(figure))


def _states(facts: MachineFacts, days: Sequence[str], say: Texts) -> Strip:
    """Execution states; off where nothing is expected, hatched where records should be."""
    by, missing = {one.day: one for one in facts.work.days}, set(facts.work.surprising_days)
    blocks = []
    for k, day in enumerate(days):
        runs = by[day].runs if day in by else [(NO_RECORD, 0, DAY // BIN)]
        for state, start, end in runs:
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
    return say(key) if say.has(key) else state


def _curves(facts: MachineFacts, rows: pd.DataFrame, first: date, say: Texts) -> Iterator[Strip]:
    """Spindle temperature in its band with the line of its rule, and the spindle's load."""
    period = float(np.median(np.diff(days_since(rows.index, first)))) * DAY
    least = LEAST_SHARE * pd.Timedelta(STEP).total_seconds() / max(period, 1e-9)
    rules = {} if facts.monitored is None else facts.monitored.rules
    heat = parts_by(rows, HEAT, STEP, least)
    strip = strip_of(say("week.temperature"), HEAT, heat, first, 88.0)
    rule = rules.get("temperature_outside")
    if strip.areas and rule is not None and rule.limit is not None:
        line = heat["estimated"] + rule.limit * (heat["high"] - heat["estimated"])
        strip = _with(strip, ("alarm-line", days_since(heat.index, first), line.to_numpy(float)))
    if strip.curves:
        yield _hovered(strip, heat["measured"].fillna(heat["estimated"]), first, "°C", say)
    load = rows["spindle_load"].resample(STEP).max()
    if load.notna().any():
        limit = rules.get("load_over_limit")
        strip = Strip(
            head=say("week.load"), height=52.0, zero=True,
            curves=[("measured", days_since(load.index, first), load.to_numpy(float))],
            levels=[] if limit is None or limit.limit is None else [limit.limit],
        )  # fmt: skip
        yield _hovered(strip, load, first, "%", say)


def _with(strip: Strip, curve: tuple[str, Floats, Floats]) -> Strip:
    return replace(strip, curves=[*strip.curves, curve])


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
    """Alarms that begin in a calendar week."""
    zone = facts.work.time_zone
    return [one for one in facts.alarms.alarms if week_of(day_of(one.start, zone)) == week]


def _alarms(facts: MachineFacts, days: Sequence[str], say: Texts) -> list[Strip]:
    """Alarms by component, repeats joined; nothing in a week without alarms."""
    kinds: dict[tuple[str, str], list[Alarm]] = {}
    for one in alarms_in(facts, week_of(days[0])):
        kinds.setdefault((component_of(one.where, one.message), one.text), []).append(one)
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
        last = found[-1][-1] if found else None
        if last is not None and one.start - (last.end or last.start) <= BURST_S * NS:
            found[-1].append(one)
        else:
            found.append([one])
    return found


def _burst(burst: list[Alarm], text: str, lane: int, first: str, zone: str, say: Texts) -> Block:
    times = np.array([burst[0].start, burst[-1].end or burst[-1].start])
    start, end = (clock(times, zone) - np.datetime64(first, "ns").astype(np.int64)) / (DAY * NS)
    words = say("week.burst", len(burst), alarm=text or burst[0].item,
                moment=say.moment(burst[0].start))  # fmt: skip
    kind = "s-over" if any(one.level == "fault" for one in burst) else "s-hold"
    return Block(kind=kind, start=float(start), end=float(end), words=words, lane=lane)


def weeks_section(facts: MachineFacts, say: Texts) -> Section | None:
    """Quantities of the condition over twelve weeks, those beyond a line first."""
    if not facts.weeks:
        return None
    order = {"act": 0, "watch": 1, "fine": 2, "not assessed": 3}
    lined = [one for one in facts.weeks[-1].conditions if one.state in order and one.value]
    chosen = sorted(lined, key=lambda one: (order[one.state], one.kind == "cycle_time"))
    chosen = chosen[:SHOWN_CONDITIONS]
    made = week_sources(facts.folders, facts.shelf, facts.weeks)
    figures = [
        Figure(svg=_small(facts, one), caption=_small_words(facts, one, say), sources=made,
               status=LOOKS[one.state],
               status_words=say(f"component.{one.state.replace(' ', '_')}"))
        for one in chosen
    ]  # fmt: skip
    if not figures:
        return None
    title = say("weeks.title", count=len(facts.weeks), all=MOST_WEEKS)
    return Section(key="weeks", title=title, blocks=[Figures(figures=figures, kind="small")])


LOOKS = {"act": "failed", "watch": "attention", "fine": "passed", "not assessed": "unknown"}


def _course(facts: MachineFacts, one: Condition) -> Floats:
    """Values of a quantity in the twelve weeks up to the newest, shape (12,)."""
    newest = first_of(facts.weeks[-1].week)
    values = np.full(MOST_WEEKS, np.nan)
    for report in facts.weeks:
        place = MOST_WEEKS - 1 - (newest - first_of(report.week)).days // 7
        same = [other.value for other in report.conditions if other.key == one.key]
        if place >= 0 and same and same[0] is not None:
            values[place] = same[0]
    return values


def _small(facts: MachineFacts, one: Condition) -> Markup:
    values = _course(facts, one)
    weeks = Axis(words="", span=(0.0, MOST_WEEKS - 1.0), marks=[])
    lines = [line for line in (one.alert, one.alarm) if line is not None]
    x = np.arange(MOST_WEEKS, dtype=float)
    strip = Strip(
        head="", height=28.0, curves=[("measured", x, values)], levels=lines,
        dots=[("p-passed", x[-1:], values[-1:])], zero=True,
    )  # fmt: skip
    return strips_figure([strip], weeks, f"{one.component}, {one.what}", kind="week-small")


def _small_words(facts: MachineFacts, one: Condition, say: Texts) -> str:
    known = _course(facts, one)[:-1]
    known = known[np.isfinite(known)]
    value = one.value or 0.0
    arrow = ""
    if len(known):
        arrow = " →" if value == known[-1] else " ↑" if value > known[-1] else " ↓"
    return say("weeks.one", component=one.component, what=say.given(one.what),
               value=say.number(value), unit=one.unit.removesuffix("1"), arrow=arrow)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Use:
    """Time of a kind in the newest week and in the one before it [s]."""

    name: str
    now: float
    before: float | None


def time_section(facts: MachineFacts, say: Texts) -> Section:
    """Use of the time this week and the week before, and the longest stops."""
    weeks = weeks_worked(facts)
    if not weeks:
        return Section(key="time", title=say("time.title"), text=[say("time.none")])
    days = [[day for day in facts.work.worked_days if week_of(day.day) == week] for week in weeks]
    before = days[-2] if len(days) > 1 else None
    rows = [
        Use(name=say(f"time.{key}"), now=_seconds(days[-1], states),
            before=None if before is None else _seconds(before, states))
        for key, states in STATES.items()
    ]  # fmt: skip
    for kind in KINDS:
        now, then = (None if one is None else sum(day.kinds.get(kind, 0.0) for day in one)
                     for one in (days[-1], before))  # fmt: skip
        if now or then:
            rows.append(Use(name=say(f"time.{kind}"), now=now or 0.0, before=then))
    made = sources(facts.shelf, *facts.work.state_files)
    uses = tabulated(say("time.table", count=len(days[-1])), rows, _use_columns(say), made)
    stops = sorted(_stops(days[-1]), key=lambda one: (-one[2], one[0].day, one[1]))[:STOPS]
    named = tabulated(say("time.stops"), stops, _stop_columns(facts, say), made,
                      folded=True)  # fmt: skip
    return Section(key="time", title=say("time.title"), blocks=present(uses, named))


KINDS = ("cut", "air", "warm_up")
"""Kinds of segment of the active time, by their key in the texts."""
STATES = {"active": ("ACTIVE",), "stopped": STOPPED, "ready": (), "none_known": (NO_RECORD,)}
"""Execution states by the key of their row; the empty one is of all others."""


def _seconds(days: Sequence[Day], states: Sequence[str]) -> float:
    named = {state for one in STATES.values() for state in one}
    return sum(
        seconds for day in days for state, seconds in day.seconds.items()
        if (state in states if states else state not in named)
    )  # fmt: skip


def _use_columns(say: Texts) -> tuple[Column[Use], ...]:
    def change(one: Use) -> str:
        if one.before is None:
            return "–"
        sign = "+" if one.now >= one.before else "−"
        return f"{sign}{say.hours(abs(one.now - one.before))}"

    return (
        Column(say("time.use"), lambda one: one.name),
        Column(say("time.now"), lambda one: say.hours(one.now), "h"),
        Column(say("time.before"), lambda one: (
            "–" if one.before is None else say.hours(one.before)
        ), "h"),
        Column(say("time.change"), change, "h"),
    )  # fmt: skip


Stop = tuple[Day, int, int, str]
"""Day, first bin, number of bins and state of a stop."""


def _stops(days: Sequence[Day]) -> Iterator[Stop]:
    for day in days:
        for state, start, end in day.runs:
            if state in STOPPED:
                yield day, start, end - start, state


def _stop_columns(facts: MachineFacts, say: Texts) -> tuple[Column[Stop], ...]:
    zone = facts.work.time_zone

    def at(one: Stop) -> int:
        return instant(one[0].day, BIN * one[1], zone)

    def program(one: Stop) -> str:
        inside = [c.program for c in facts.work.cycles or [] if c.start <= at(one) <= c.end]
        return next(iter(inside), "–")

    def alarm(one: Stop) -> str:
        end = at(one) + one[2] * BIN * NS
        seen = [a.text for a in facts.alarms.alarms
                if a.start <= end and (a.end or end) >= at(one) - BIN * NS and a.text]  # fmt: skip
        return say.some(list(dict.fromkeys(seen)), 1) or "–"

    return (
        Column(say("time.since"), lambda one: say.moment(at(one))),
        Column(say("time.length"), lambda one: say.duration(one[2] * BIN), ""),
        Column(say("time.state"), lambda one: _state(one[3], say)),
        Column(say("time.program"), program),
        Column(say("time.alarm"), alarm),
    )


def alarms_of_week(facts: MachineFacts, say: Texts) -> Section | None:
    """Alarms with most minutes and most often in the week, beside the week before."""
    weeks = weeks_worked(facts)
    if not facts.alarms.alarms:
        return no_alarms(facts.alarms, say)
    now, before = (alarms_in(facts, week) if week else [] for week in ["", "", *weeks][-1:-3:-1])
    kinds: dict[tuple[str, str], list[Alarm]] = {}
    for one in now:
        kinds.setdefault((one.level, one.text or one.item), []).append(one)
    most = sorted(kinds, key=lambda kind: -sum(a.seconds or 0.0 for a in kinds[kind]))[:STOPS]
    often = sorted(kinds, key=lambda kind: -len(kinds[kind]))[:STOPS]
    rows = [(kind, kinds[kind], [a for a in before if (a.level, a.text or a.item) == kind])
            for kind in dict.fromkeys([*most, *often])]  # fmt: skip
    made = sources(facts.shelf, facts.folders.clean / "alarms.parquet")
    still = [say("alarms.still", count=sum(a.ended == "open" for a in facts.alarms.alarms))]
    if not any(one.ended == "open" for one in facts.alarms.alarms):
        still = []
    table = tabulated(say("alarms.of_week", count=len(now)), rows, _alarm_columns(say), made)
    return Section(key="alarms", title=say("alarms.title"), blocks=present(table),
                   text=[*([] if rows else [say("alarms.no_week")]), *still])  # fmt: skip


AlarmRow = tuple[tuple[str, str], list[Alarm], list[Alarm]]
"""Level and text of a kind of alarm, its alarms of the week, and of the week before."""


def _alarm_columns(say: Texts) -> tuple[Column[AlarmRow], ...]:
    def minutes(alarms: Sequence[Alarm]) -> str:
        return say.number(sum(one.seconds or 0.0 for one in alarms) / 60)

    return (
        Column(say("alarms.alarm"), lambda row: Cell(
            text=row[0][1], status="failed" if row[0][0] == "fault" else "attention")),
        Column(say("alarms.minutes"), lambda row: minutes(row[1]), "min"),
        Column(say("alarms.before"), lambda row: minutes(row[2]), "min"),
        Column(say("alarms.times"), lambda row: say.number(len(row[1])), ""),
        Column(say("alarms.times_before"), lambda row: say.number(len(row[2])), ""),
    )  # fmt: skip
