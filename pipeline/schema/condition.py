"""Condition of a machine over weeks: a kept series of reports, one JSON a calendar week.

``data/condition/<machine>/<week>.json`` is :class:`WeekReport`; weeks are those of ISO 8601, as
``2026-W03``.  A report says what the records up to the end of its week said; it is written again
only where the records of its own week have changed, so that two reports compare two weeks.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import Literal

State = Literal["fine", "watch", "act", "no line", "not assessed"]
"""State against the lines: below the alert, above it, above the alarm; ``no line`` where a quantity
has none, as hours; ``not assessed`` where the records do not allow it."""


@dataclass(frozen=True, kw_only=True)
class TimeToLine:
    """Time from the end of the week to the alarm line [weeks]; None beyond the horizon."""

    median: float | None
    low: float | None
    high: float | None
    """Middle, and ends of the interval that holds the share ``confidence``."""
    probability: float
    """Probability that the line is crossed within the horizon [1]."""
    horizon: float
    confidence: float
    """Horizon [weeks], and confidence of the interval [1]."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One quantity of one component in a week."""

    component: str
    """Component, as ``axis X``, ``spindle``, ``tool 4``, ``program O2040``."""
    kind: str
    """Kind, which names its lines in the settings."""
    what: str
    """Quantity in words, with the conditions that it holds for."""
    unit: str
    value: float | None = None
    """Mean over the days of the week, or their sum; None where it was not known."""
    low: float | None = None
    high: float | None = None
    """90 % interval of the value; None where days are too few."""
    days: int = 0
    """Days of the week on which it was known."""
    reference: float | None = None
    alert: float | None = None
    alarm: float | None = None
    """Level of the first weeks, and the lines; None while these are not complete."""
    state: State = "not assessed"
    reason: str = ""
    """Why it is not assessed, or has no line or no time to it yet."""
    to_alarm: TimeToLine | None = None

    @property
    def key(self) -> tuple[str, str, str]:
        """Name by which weeks are compared."""
        return self.component, self.kind, self.what


@dataclass(frozen=True, kw_only=True)
class WeekReport:
    """Condition of a machine in a week."""

    week: str
    days: tuple[str, ...]
    """Days with records."""
    records: str
    """Hash of the records of the week."""
    bundle: str
    """Hash of the bundle that estimated; empty where nothing served."""
    conditions: tuple[Condition, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    """Quantities that the machine's records do not allow, and why."""


def week_of(day: str) -> str:
    """Calendar week of a day by ISO 8601.

    >>> week_of("2026-01-04"), week_of("2026-01-05")
    ('2026-W01', '2026-W02')
    """
    year, week, _ = date.fromisoformat(day).isocalendar()
    return f"{year}-W{week:02d}"
