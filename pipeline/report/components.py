"""Components of a machine in the week of its last record: state, since when, and an outline."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.sections import NOW
from pipeline.report.condition import first_of
from pipeline.report.texts import Texts
from pipeline.schema.condition import WeekReport, week_of
from pipeline.schema.days import day_of, day_of_text
from pipeline.schema.incident import Incident

if TYPE_CHECKING:
    from pipeline.report.facts import MachineFacts, Status

WORDS = {
    "sensors": r"sensor", "tools": r"\btools?\b|\bcut\b|turret|magazine",
    "coolant": r"cool|\blub|hydraul|pneum", "spindle": r"spindle|bearing",
    "axes": r"\baxis\b|\baxes\b|linear|rotary",
}  # fmt: skip
"""Words of the records by which a component is known, those that decide first at the head."""
KEYS = ("spindle", "axes", "tools", "coolant", "sensors", "control")
"""Components by their key in the texts; what no word gives away is the control's."""
RULES = {
    "sensors": ("sensor_",), "spindle": ("temperature_", "no_load_", "load_over"),
    "tools": ("cut_load", "load_without"), "axes": ("x_", "y_", "z_"), "control": ("forest",),
}  # fmt: skip
"""Beginnings of the rules that assess a component."""
LEVELS: dict[str, Status] = {
    "act": "failed", "watch": "attention", "fine": "passed", "no_alarm": "passed",
}  # fmt: skip
RANK = {"watch": 1, "act": 2}
"""Gravity of a state, 0 of any other."""


def component_of(component: str, title: str = "") -> str:
    """Key of the component that some words of the records are about.

    >>> component_of("Path (motion_c)", "Alarm 1281 ERROR (X AXIS POS.MALF.) comes again")
    'axes'
    """
    for text in (component, title):
        for key, words in WORDS.items():
            if re.search(words, text, re.IGNORECASE):
                return key
    return "control"


@dataclass(frozen=True, kw_only=True)
class ComponentState:
    """State of a component: since when [day in words], why, and how it was the week before."""

    key: str
    status: Status
    word: str
    since: str = ""
    why: str = ""
    trend: Literal["", "better", "same", "worse"] = ""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A reason to look at a component: its rank, and the ISO day since when it is known."""

    key: str
    rank: int
    why: str
    since: str = ""


def weeks_worked(facts: MachineFacts) -> list[str]:
    """Calendar weeks with records of the machine, the newest last."""
    return sorted({week_of(one.day) for one in facts.work.worked_days})


def week_incidents(
    facts: MachineFacts, week: str = "", severities: Collection[str] = tuple(RANK)
) -> list[Incident]:
    """Incidents of some severities that lie in a calendar week, the newest one by default."""
    weeks = weeks_worked(facts)
    if facts.monitored is None or not weeks:
        return []
    week, zone = week or weeks[-1], facts.work.time_zone
    return [
        one for one in facts.monitored.incidents if one.severity in severities
        and week_of(day_of_text(one.start, zone)) <= week <= week_of(day_of_text(one.end, zone))
    ]  # fmt: skip


def alarm_of(one: Incident) -> str | None:
    """Code and message of the alarm that an incident is of; None of one of rules."""
    return next((event.words.get("alarm", "") for event in one.events if event.rule == "alarm"),
                None)  # fmt: skip


def days_of_incident(facts: MachineFacts, one: Incident) -> Counter[str]:
    """Days on which something of an incident happened, with how often: its alarms, or its events.

    Of a long incident some events are kept; what lay between counts as one time a day.
    """
    zone, name = facts.work.time_zone, alarm_of(one)
    if name is not None:
        return Counter(
            day_of(alarm.start, zone) for alarm in facts.alarms.alarms
            if alarm.by == one.component and (alarm.text or alarm.item) == name
        )  # fmt: skip
    spans = [(event.start, event.end) for event in one.events] or [(one.start, one.end)]
    ends = [tuple(day_of_text(at, zone) for at in span) for span in spans]
    return Counter(
        day.day for first, last in ends for day in facts.work.worked_days
        if first <= day.day <= last
    )  # fmt: skip


def component_states(facts: MachineFacts, say: Texts) -> list[ComponentState]:
    """State of each component in the newest week; the gravest finding decides."""
    weeks = weeks_worked(facts)
    found = [*(_findings(facts, weeks[-1], say) if weeks else ()), *_standing(facts, say)]
    if weeks:
        found += _faults(facts, weeks[-1], say)
    alarms = {component_of(where) for where in facts.alarms.watched}
    before = None
    if len(weeks) > 1:
        first = first_of(weeks[-1]).isoformat()
        before = [*_findings(facts, weeks[-2], say), *(f for f in found if "" < f.since < first)]
    assessed = _assessed(facts)
    fine = {key: "fine" if key in assessed else "no_alarm" for key in assessed | alarms}
    return [_state(key, found, before, fine.get(key, ""), say) for key in KEYS]


def _state(
    key: str, found: Sequence[Finding], before: Sequence[Finding] | None, fine: str, say: Texts
) -> ComponentState:
    own = sorted((f for f in found if f.key == key), key=lambda f: (-f.rank, f.since or "~"))
    if not own and not fine:
        return ComponentState(key=key, status="unknown", word=say("component.not_assessed"))
    level = {2: "act", 1: "watch", 0: fine}[own[0].rank if own else 0]
    trend: Literal["", "better", "same", "worse"] = ""
    if before is not None:
        now, then = (max((f.rank for f in fs if f.key == key and f.since), default=0)
                     for fs in (own, before))  # fmt: skip
        trend = "worse" if now > then else "better" if now < then else "same"
    more = say("component.more", count=len(own) - 1) if len(own) > 1 else ""
    return ComponentState(
        key=key, status=LEVELS[level], word=say(f"component.{level}"), trend=trend,
        since=say.day(own[0].since) if own and own[0].since else "",
        why=f"{own[0].why}{more}" if own else "",
    )  # fmt: skip


def _findings(facts: MachineFacts, week: str, say: Texts) -> Iterator[Finding]:
    """What incidents and the kept report say of a week."""
    for one in week_incidents(facts, week):
        since = day_of_text(one.start, facts.work.time_zone)
        yield Finding(key=_subject(one), since=since, rank=RANK[one.severity],
                      why=say.given(one.title))  # fmt: skip
    kept = [one for one in facts.weeks if one.week <= week]
    for condition in kept[-1].conditions if kept and kept[-1].week == week else ():
        if rank := RANK.get(condition.state):
            since = condition_since(kept, condition.key, condition.state)
            yield Finding(key=component_of(condition.component), rank=rank, since=since,
                          why=f"{say.given(condition.what)} ({condition.component})")  # fmt: skip


def _subject(one: Incident) -> str:
    """Key of the component that an incident is about, by its rules; of alarms by their words."""
    rules = [event.rule for event in one.events]
    found = (key for key, begins in RULES.items() if any(r.startswith(begins) for r in rules))
    return next(found, component_of(one.component, one.title))


def condition_since(kept: Sequence[WeekReport], key: tuple[str, str, str], state: str) -> str:
    """First day of the weeks up to the newest in which a quantity had one state."""
    since = ""
    for report in reversed(kept):
        if not any(one.key == key and one.state == state for one in report.conditions):
            break
        since = min(report.days, default=since)
    return since


def _faults(facts: MachineFacts, week: str, say: Texts) -> Iterator[Finding]:
    """Faults of a week that are no incident, since they came once or twice."""
    zone = facts.work.time_zone
    known = {alarm_of(one) for one in week_incidents(facts, week, ("act", "watch", "note"))}
    for same in facts.alarms.kinds:
        own = [one for one in same if one.level == "fault" and one.ended != "open"
               and week_of(day_of(one.start, zone)) == week]  # fmt: skip
        if own and own[0].text and own[0].text not in known:
            since = day_of(own[0].start, zone)
            why = say("component.fault", len(own), alarm=own[0].text, day=say.day(since))
            key = component_of(own[0].by, own[0].message)
            yield Finding(key=key, rank=1, since=since, why=why)


def _standing(facts: MachineFacts, say: Texts) -> Iterator[Finding]:
    """What stands at the end of the records: open alarms, sensors in doubt, tools that are due."""
    for same in facts.alarms.kinds:
        still = [one for one in same if one.ended == "open"]
        if still:
            yield Finding(
                key=component_of(still[0].by, still[0].message),
                rank=2 if still[0].level == "fault" else 1,
                since=day_of(still[0].start, facts.work.time_zone), why=still[0].text,
            )  # fmt: skip
    for item in facts.doubtful_items:
        why = say("component.doubtful", item=item.item, count=item.count)
        yield Finding(key="sensors", rank=1, why=why)
    for page in facts.pages:
        for action in page.actions:
            if action.who in ("maintenance", "tool room"):
                key = "tools" if action.who == "tool room" else "sensors"
                what, where = say.given(action.what), say.given(action.where)
                why = say("component.todo", what=what, where=where)
                yield Finding(key=key, rank=2 if action.until == NOW else 1, why=why)


def _assessed(facts: MachineFacts) -> set[str]:
    """Components that rules, lines of the condition or cleaning can say something of."""
    found: set[str] = set()
    if facts.records.changes is not None and facts.logged:
        found.add("sensors")
    if facts.monitored is not None:
        held = [name for name, one in facts.monitored.rules.items() if one.assessed_s > 0]
        found |= {key for key, begins in RULES.items() if any(n.startswith(begins) for n in held)}
    if facts.weeks:
        newest = facts.weeks[-1].conditions
        found |= {component_of(one.component) for one in newest if one.state in LEVELS}
    return found


SHAPES = {
    "control": "M300 48h42v60h-42zM306 54h30v22h-30z",
    "axes": "M96 150h160v14h-160zM22 178h252v20h-252z",
    "spindle": "M74 40h92v50h-92zM122 90h26v16h-26z",
    "tools": "M128 106h14l-7 26zM22 22h44v16h-44z",
    "coolant": "M182 204h92v16h-92zM176 88l4 3-28 34-4-3z",
    "sensors": "M92 58a8 8 0 1 1 .1 0z",
}
REST = "M22 38h44v140h-44zM66 46h8v36h-8zM110 164h132v14h-132zM274 100h26v4h-26z"
"""Outline of a machining centre from its side, by component; :data:`REST` is its frame."""
NAMED = {"spindle": (174, 62), "axes": (264, 162), "tools": (160, 122), "coolant": (282, 216),
         "sensors": (74, 32), "control": (300, 124)}  # fmt: skip
"""Place of the name of each."""
GLYPHS = {
    "failed": "M1 1 9 9M9 1 1 9", "attention": "M5 .6 9.8 9.4H.2z",
    "passed": "M5 .4a4.6 4.6 0 1 1-.01 0z", "unknown": "M5 1.1a3.9 3.9 0 1 1-.01 0z",
}  # fmt: skip
"""Shape of a status in a square of 10."""


def outline(states: Sequence[ComponentState], say: Texts) -> Markup:
    """Outline of the machine, each component with the shape of its state and its name."""
    parts = [svg.tag("path", d=REST, class_="rest")]
    said = []
    for one in states:
        name = say(f"component.{one.key}")
        words = say("component.is", name=name, state=one.word)
        x, y = NAMED[one.key]
        glyph = svg.tag(
            "svg", svg.tag("path", d=GLYPHS[one.status]), x=x, y=y - 9, width=10, height=10,
            class_=f"glyph is-{one.status}",
        )  # fmt: skip
        shape = svg.tag("path", d=SHAPES[one.key], class_=f"part is-{one.status}")
        label = svg.tag("text", name, x=x + 14, y=y)
        parts.append(svg.tag("g", svg.group([svg.tag("title", words), shape, glyph, label])))
        said.append(words)
    return svg.tag(
        "svg", svg.group(parts), class_="outline", role="img", viewBox="0 0 412 224",
        aria_label=f"{say('component.outline')}: {'; '.join(said)}",
        xmlns="http://www.w3.org/2000/svg",
    )  # fmt: skip
