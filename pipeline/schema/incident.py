"""Incidents of a machine: what monitoring learnt from its known-good days, and what it reports."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from pipeline.schema.days import UTC, day_of_text

MONITOR, KNOWN_GOOD = "monitor.json", "known_good.parquet"
Severity = Literal["act", "watch", "note"]
"""To act on, to watch, or to know of: what belongs to operation and says nothing of the machine."""
Who = Literal["maintenance", "tool room", "process engineer"]


@dataclass(frozen=True, kw_only=True)
class UsualLoad:
    """Spindle load of a program and tool on the known-good days."""

    speed_rpm: float
    """Median of the speed [rev/min]."""
    load_percent: float
    spread_percent: float
    """Median and half of the 5 to 95 % range of the load [%]."""
    windows: int


@dataclass(frozen=True, kw_only=True)
class Monitor:
    """The content of ``monitor.json``: what is usual for a machine."""

    days: tuple[str, ...]
    """Known-good days."""
    bundle: str
    """Hash of the bundle whose residuals they have."""
    most: Mapping[str, float]
    """Most that each rule's value held over its dwell on a known-good day that was left out."""
    limits: Mapping[str, float]
    """Limit of each rule that has one of its own here."""
    centre: float
    """Median score of the forest on those days."""
    loads: Mapping[str, UsualLoad]
    """Usual load by program and tool, as :func:`~pipeline.monitoring.rules.cut_of`."""
    features: tuple[str, ...]
    """Features of the isolation forest."""
    lacking: Mapping[str, str] = field(default_factory=dict)
    """Rules that nothing could be learnt for, and why."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """A rule that held for its dwell."""

    rule: str
    component: str
    severity: Severity
    start: str
    end: str
    """Times, ISO 8601 in UTC."""
    value: float
    limit: float
    unit: str
    """Greatest value, what is allowed, and their unit."""
    values: Mapping[str, float] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    """Evidence: quantities while it held, and words at its begin."""

    @property
    def evidence(self) -> str:
        """Evidence in one line."""
        values = {name: f"{one:.4g}" for name, one in self.values.items()}
        said = (f"{name.replace('_', ' ')} {one}" for name, one in {**self.words, **values}.items())
        return "; ".join(said) or "–"


@dataclass(frozen=True, kw_only=True)
class Incident:
    """Events of one component that belong together."""

    id: str
    """Key of the incident: the same when more records have come."""
    machine: str
    origin: str
    component: str
    severity: Severity
    title: str
    check: str
    """What to look at."""
    who: Who
    start: str
    end: str
    seconds: float
    """Time within which its rules held [s]."""
    count: int
    """Number of its events."""
    events: tuple[Event, ...]
    """The first ones, and those of the greatest share of their limit."""


@dataclass(frozen=True, kw_only=True)
class RuleState:
    """Over how much time a rule was assessed, and why not over the rest."""

    limit: float | None
    unit: str
    assessed_s: float
    events: int
    not_assessed: str = ""


@dataclass(frozen=True, kw_only=True)
class Monitored:
    """The content of ``incidents.json``."""

    machine: str
    origin: str
    days: tuple[str, ...]
    known_good: tuple[str, ...]
    worked_s: float
    """Time in which a program ran [s]."""
    rules: Mapping[str, RuleState]
    incidents: tuple[Incident, ...]
    time_zone: str = UTC
    """Zone of the plant, whose days ``days`` are."""

    def since(self, day: str) -> list[Incident]:
        """Incidents that last into a day of the plant or begin later."""
        return [one for one in self.incidents if day_of_text(one.end, self.time_zone) >= day]

    def recent(self, *severities: Severity) -> list[Incident]:
        """Incidents of some severities that lasted into the last day, the latest first."""
        last = self.since(max(self.days, default=""))
        found = [one for one in last if one.severity in severities]
        return sorted(found, key=lambda one: (one.end, one.start), reverse=True)
