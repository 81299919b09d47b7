"""Page of a fleet: a line a machine, in groups by urgency, with its last 90 days."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from itertools import groupby

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.sections import NOW
from pipeline.report.components import RANK, component_states, days_of_incident
from pipeline.report.facts import (
    AT_MACHINE,
    ActionRow,
    MachineFacts,
    MachineVerdict,
    Status,
    first_action,
)
from pipeline.report.folders import MachineFolders
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.days import day_of
from pipeline.schema.si import NS

GROUPS = ("now", "maintenance", "twin", "other", "nothing", "unknown")
"""Groups by their key in the texts, in the order of the page."""
MOST_NAMES = 12
"""Machines that a credit names; the others are counted."""
DAYS = 90
"""Days of a machine's bar, up to its last record."""
HEIGHTS = {"worked": 6, "stood": 3, "off": 1, "lost": 10, "watch": 8, "act": 10}
"""Height of each kind of day in a bar of 10, so that its colour is not needed."""


@dataclass(frozen=True, kw_only=True)
class FleetRow:
    """Row of a machine: the state of its components and its twin, its days, its last record.

    ``shapes`` are name, status and words of each; ``last`` is that of its own log, ``off`` whether
    it was switched off or fell silent there.
    """

    folders: MachineFolders
    verdict: MachineVerdict
    group: str
    shapes: tuple[tuple[str, Status, str], ...] = ()
    bar: Markup | None = None
    last: str = ""
    off: str = ""

    @property
    def first(self) -> ActionRow | None:
        """The action that comes first; None without any."""
        return first_action(self.verdict.actions) if self.verdict.actions else None

    @property
    def urgency(self) -> tuple[int, bool, int, str]:
        """Order within a group: risk of the first action, whether it is due now, number, name."""
        risk, late = (self.first.risk, self.first.action.until == NOW) if self.first else (0, False)
        return -risk, not late, -len(self.verdict.actions), self.folders.name


@dataclass(frozen=True, kw_only=True)
class FleetGroup:
    """Machines that need the same kind of attention."""

    key: str
    title: str
    rows: list[FleetRow]


@dataclass(frozen=True, kw_only=True)
class FleetPage:
    """Groups that have a machine, the fleet in a sentence, and whose records they are.

    ``parts`` are the names of the shapes, ``legend`` kind and words of a day of the bars.
    """

    groups: list[FleetGroup]
    headline: str
    parts: tuple[str, ...]
    legend: list[tuple[Markup, str]]
    simulated: bool
    credits: list[tuple[str, str]]


def fleet_row(facts: MachineFacts, verdict: MachineVerdict, say: Texts) -> FleetRow:
    """Line of one machine."""
    end, silent = facts.work.last, facts.silence
    shapes = [
        (say(f"component.{one.key}"), one.status, ", ".join(filter(None, (one.word, one.why))))
        for one in component_states(facts, say)
    ]  # fmt: skip
    off = say("fleet.off") if facts.off else ""
    return FleetRow(
        folders=facts.folders, verdict=verdict, group=group_of(verdict),
        shapes=(*shapes, (say("fleet.twin"), verdict.twin.status, verdict.twin.word)),
        bar=day_bar(facts, say),
        last=say(f"fleet.no_{'clock' if facts.records.files else 'records'}")
        if end is None else say.moment(int(end * NS)),
        off=off if silent is None else say("fleet.silent", duration=say.duration(silent)),
    )  # fmt: skip


def kinds_of_days(facts: MachineFacts) -> dict[str, str]:
    """Kind of each of the 90 days up to the last record of the machine's log, by ISO day.

    A day before the first record is not among them. Incidents come before what was done; a day
    without records is ``lost`` where its weekday is usually worked, ``off`` elsewhere.
    """
    work, zone = facts.work, facts.work.time_zone
    done = {day.day: day for day in work.worked_days}
    if work.last is None or not done:
        return {}
    last = date.fromisoformat(day_of(int(work.last * NS), zone))
    first = max(min(done), (last - timedelta(days=DAYS - 1)).isoformat())
    days = [(last - timedelta(days=k)).isoformat() for k in reversed(range(DAYS))]
    lost = set(work.surprising_days)
    found = {
        day: "lost" if day in lost else "off" if day not in done
        else "worked" if done[day].active >= max(work.least_active, 1.0) else "stood"
        for day in days if day >= first
    }  # fmt: skip
    incidents = () if facts.monitored is None else facts.monitored.incidents
    for severity in RANK:  # act comes last
        for one in incidents:
            if one.severity == severity:
                happened = days_of_incident(facts, one)
                found |= dict.fromkeys((d for d in found if d in happened and d in done), severity)
    return found


def day_bar(facts: MachineFacts, say: Texts) -> Markup | None:
    """Bar of the last 90 days, with its counts in words; None without a log."""
    kinds = kinds_of_days(facts)
    if not kinds:
        return None
    counts = [say("fleet.of_kind", kind=say(f"fleet.day.{kind}"), count=many)
              for kind in HEIGHTS if (many := list(kinds.values()).count(kind))]  # fmt: skip
    words = say("fleet.bar", first=say.day(min(kinds), year=True),
                last=say.day(max(kinds), year=True), counts=", ".join(counts))  # fmt: skip
    return _bar(list(kinds.values()), words, DAYS)


def _bar(kinds: Sequence[str], words: str, wide: int) -> Markup:
    """Days side by side up to the right edge, those of a kind in one path."""
    data: dict[str, str] = {}
    at = wide - len(kinds)
    for kind, run in groupby(kinds):
        many, high = len(list(run)), HEIGHTS[kind]
        data[kind] = f"{data.get(kind, '')}M{at} {10 - high}h{many}v{high}h-{many}z"
        at += many
    paths = [svg.tag("path", d=path, class_=f"d-{kind}") for kind, path in data.items()]
    return svg.tag("svg", svg.group([svg.tag("title", words), *paths]), class_="days", role="img",
                   viewBox=f"0 0 {wide} 10", preserveAspectRatio="none",
                   aria_label=words)  # fmt: skip


def group_of(verdict: MachineVerdict) -> str:
    """Key of the group that a machine belongs to, by its most urgent action."""
    actions = [row.action for row in verdict.actions]
    if verdict.twin.status == "unknown" and all(one.who not in AT_MACHINE for one in actions):
        return "unknown"
    if any(one.until == NOW for one in actions):
        return "now"
    if any(one.who in AT_MACHINE for one in actions):
        return "maintenance"
    if verdict.twin.status in ("failed", "attention"):
        return "twin"
    return "other" if actions else "nothing"


def fleet_page(rows: Sequence[FleetRow], say: Texts = ENGLISH) -> FleetPage:
    """The fleet in groups; in each the most urgent machine first."""
    ordered = sorted(rows, key=lambda row: row.urgency)
    found = [
        FleetGroup(key=key, title=say(f"fleet.group.{key}"),
                   rows=[row for row in ordered if row.group == key])
        for key in GROUPS
    ]  # fmt: skip
    groups = [group for group in found if group.rows]
    parts = [say(f"fleet.in_group.{group.key}", count=len(group.rows)) for group in groups]
    machines = say("fleet.machines", count=len(rows))
    owners: dict[str, list[str]] = {}
    for row in sorted(rows, key=lambda row: row.folders.name):
        if row.folders.credit:
            owners.setdefault(row.folders.credit, []).append(row.folders.name)
    return FleetPage(
        groups=groups,
        headline=say("fleet.headline", machines=machines, groups=", ".join(parts))
        if rows else say("fleet.none"),
        parts=next((tuple(name for name, _, _ in row.shapes) for row in rows), ()),
        legend=[(_bar([kind], say(f"fleet.day.{kind}"), 1), say(f"fleet.day.{kind}"))
                for kind in HEIGHTS],
        simulated=bool(rows) and all(row.folders.origin == "simulated" for row in rows),
        credits=[(say.some(names, MOST_NAMES), credit) for credit, names in owners.items()],
    )  # fmt: skip
