"""Use of a machine's time: totals over all days, each with its share and how it is counted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.charts.tables import Column, Table, sources, tabulated
from pipeline.report.texts import Texts
from pipeline.report.work import Day, Work

KINDS = ("cut", "air", "warm_up")
"""Kinds of segment, by their key in the texts."""


@dataclass(frozen=True, kw_only=True)
class Use:
    """One use of the time: its name, its seconds, the whole that it is a share of."""

    name: str
    seconds: float | None
    whole: float | None
    formula: str


def columns(say: Texts) -> tuple[Column[Use], ...]:
    """Columns of the table."""
    return (
        Column(say("time.use"), lambda use: use.name),
        Column(say("time.total"), lambda use: say.hours(use.seconds), "h"),
        Column(say("time.share"), lambda use: say.percent(use.seconds, use.whole), ""),
        Column(say("time.formula"), lambda use: use.formula),
    )


def time_use_table(done: Work, say: Texts) -> Table | None:
    """Totals over all days with records; None without any."""
    days = done.worked_days
    if not days:
        return None
    first, last = days[0].day, days[-1].day
    caption = say(
        "time.table", days=say("time.days", count=len(days)),
        first=say.day(first, year=first[:4] != last[:4]), last=say.day(last, year=True),
    )  # fmt: skip
    return tabulated(caption, uses(days, say), columns(say), sources(done.shelf, *done.state_files))


def uses(days: Sequence[Day], say: Texts) -> list[Use]:
    """Recorded time, its execution states, and what the segments of programs say of it."""
    known = sum(d.known for d in days)

    def use(key: str, seconds: float | None, whole: float | None, formula: str = "") -> Use:
        words = formula or say(f"time.{key}_as")
        return Use(name=say(f"time.{key}"), seconds=seconds, whole=whole, formula=words)

    found = [
        use("recorded", known, sum(sum(d.seconds.values()) for d in days)),
        use("active", sum(d.active for d in days), known),
        use("stopped", sum(d.stopped for d in days), known),
        use("running", _sum(days, lambda d: d.running), _sum(days, lambda d: d.speed_known)),
    ]
    if any(d.kinds for d in days):
        of_kinds = {kind: sum(d.kinds.get(kind, 0.0) for d in days) for kind in KINDS}
        whole, each = sum(of_kinds.values()), say("time.segment_as")
        segments = [use(k, seconds, whole, each) for k, seconds in of_kinds.items() if seconds]
        found += [use("segments", whole, known), *segments]
    return [one for one in found if one.seconds is not None]


def _sum(days: Sequence[Day], of: Callable[[Day], float | None]) -> float | None:
    known = [value for day in days if (value := of(day)) is not None]
    return sum(known) if known else None
