"""Use of a machine's time: totals over all days, each with its share and how it is counted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.charts.numbers import counted, day_words, hours, percent
from pipeline.charts.tables import Column, Table, sources, tabulated
from pipeline.report.work import Day, Work

KINDS = {
    "cut": "Cutting", "air": "In a program, not cutting", "warm_up": "Warming up",
}  # fmt: skip
"""Kinds of segment as people call them."""


@dataclass(frozen=True, kw_only=True)
class Use:
    """One use of the time: its name, its seconds, the whole that it is a share of."""

    name: str
    seconds: float | None
    whole: float | None
    formula: str


USES: tuple[Column[Use], ...] = (
    Column("Time", lambda use: use.name),
    Column("total", lambda use: hours(use.seconds), "h"),
    Column("share", lambda use: percent(use.seconds, use.whole), ""),
    Column("counted as", lambda use: use.formula),
)


def time_use_table(done: Work) -> Table | None:
    """Totals over all days with records; None without any."""
    days = done.worked_days
    if not days:
        return None
    first, last = days[0].day, days[-1].day
    return tabulated(
        f"Use of the time on {counted(len(days), 'day')}, "
        f"{day_words(first, year=first[:4] != last[:4])} to {day_words(last, year=True)}",
        uses(days), USES, sources(done.shelf, *done.state_files),
    )  # fmt: skip


def uses(days: Sequence[Day]) -> list[Use]:
    """Recorded time, its execution states, and what the segments of programs say of it."""
    known, active = sum(d.known for d in days), sum(d.active for d in days)
    found = [
        Use(name="Recorded", seconds=known, whole=sum(sum(d.seconds.values()) for d in days),
            formula="seconds with a known execution state, of 24 h a day"),
        Use(name="ACTIVE (utilisation)", seconds=active, whole=known, formula="ACTIVE ÷ recorded"),
        Use(name="Feed hold, interrupted", seconds=sum(d.stopped for d in days), whole=known,
            formula="(FEED_HOLD + INTERRUPTED) ÷ recorded"),
        Use(name="Spindle running", seconds=_sum(days, lambda d: d.running),
            whole=_sum(days, lambda d: d.speed_known), formula="above 1 rev/min, of known speed"),
    ]  # fmt: skip
    if not any(d.kinds for d in days):
        return [use for use in found if use.seconds is not None]
    of_kinds = {kind: sum(d.kinds.get(kind, 0.0) for d in days) for kind in KINDS}
    whole = sum(of_kinds.values())
    segments = [
        Use(name=KINDS[kind], seconds=seconds, whole=whole, formula="÷ time in segments")
        for kind, seconds in of_kinds.items() if seconds
    ]  # fmt: skip
    names = " + ".join(use.name.lower() for use in segments)
    total = Use(name="Time in segments", seconds=whole, whole=known, formula=f"{names} ÷ recorded")
    return [use for use in [*found, total, *segments] if use.seconds is not None]


def _sum(days: Sequence[Day], of: Callable[[Day], float | None]) -> float | None:
    known = [value for day in days if (value := of(day)) is not None]
    return sum(known) if known else None
