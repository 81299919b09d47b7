"""Condition over weeks: the newest kept report beside the one before; twelve as small curves."""

from collections.abc import Callable, Mapping, Sequence
from datetime import date

import numpy as np
from markupsafe import Markup

from pipeline.charts.bands import Axis, Strip, strips_figure
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, fixed, joined, number, signed
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.sources import Source, SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.report.texts import Texts
from pipeline.schema.arrays import Floats
from pipeline.schema.condition import Condition, WeekReport

MADE_FROM = "data/twin_state, data/clean and data/ledger, by the stage condition"
NONE = "–"
MOST_WEEKS = 12
"""Weeks that pages look back."""
SHOWN_CONDITIONS = 6
"""Quantities over twelve weeks, those beyond a line first."""
STATUS = {"act": "failed", "watch": "attention", "fine": "passed", "not assessed": "unknown"}
"""Shape and colour of a state, the gravest first."""


def condition_section(folders: MachineFolders, shelf: SourceRegistry) -> Section | None:
    """The newest week against its lines and the week before it; None where there is no report."""
    reports = week_reports(folders, shelf)
    if not reports:
        return None
    newest, before = reports[-1], reports[-2] if len(reports) > 1 else None
    earlier = {} if before is None else {one.key: one for one in before.conditions}
    text = [
        f"Week {newest.week}, {counted(len(newest.days), 'day')} with records"
        + (f", beside {before.week}." if before else ", the first report.")
    ]
    if newest.missing:
        each = (f"{kind.replace('_', ' ')} ({why})" for kind, why in newest.missing.items())
        text.append(f"Not assessed: {'; '.join(each)}.")
    made = week_sources(folders, shelf, reports[-2:])
    lined = [one for one in newest.conditions if one.state != "no line"]
    hours = [one for one in newest.conditions if one.state == "no line"]
    table = tabulated("Condition by week", lined, _columns(earlier), made,
                      note="A line is crossed where the value is beyond it and its 90 % interval "
                      "above the reference, the mean of the first weeks.")  # fmt: skip
    times = tabulated("Hours of the week", hours, _columns(earlier)[:4], made, folded=True)
    return Section(key="condition", title="Condition over weeks", text=text,
                   blocks=present(table, times))  # fmt: skip


def week_reports(folders: MachineFolders, shelf: SourceRegistry) -> tuple[WeekReport, ...]:
    """Kept reports, the newest last, :data:`MOST_WEEKS` of them."""
    paths = [] if folders.condition is None else sorted(folders.condition.glob("*.json"))
    found = [shelf.read(path, WeekReport, MADE_FROM) for path in paths[-MOST_WEEKS:]]
    return tuple(one for one in found if one is not None)


def week_sources(
    folders: MachineFolders, shelf: SourceRegistry, reports: Sequence[WeekReport]
) -> list[Source]:
    """Files of some kept reports."""
    if folders.condition is None:
        return []
    return sources(shelf, *(folders.condition / f"{one.week}.json" for one in reports))


def first_of(week: str) -> date:
    """Monday of a calendar week.

    >>> first_of("2026-W04").isoformat()
    '2026-01-19'
    """
    return date.fromisocalendar(int(week[:4]), int(week[6:]), 1)


def weeks_section(
    folders: MachineFolders, shelf: SourceRegistry, reports: Sequence[WeekReport], say: Texts
) -> Section | None:
    """Quantities of the newest report over twelve weeks, those beyond a line first."""
    known = [one for one in reports[-1].conditions if one.value is not None] if reports else []
    if not known:
        return None
    order = [*STATUS, "no line"]
    chosen = sorted(known, key=lambda one: (order.index(one.state), one.kind == "cycle_time"))[
        :SHOWN_CONDITIONS
    ]
    made = week_sources(folders, shelf, reports)
    figures = [
        Figure(svg=_small(reports, one), caption=_small_words(reports, one, say), sources=made,
               status=STATUS.get(one.state, ""), status_words=(
                   say(f"component.{one.state.replace(' ', '_')}") if one.state in STATUS else ""))
        for one in chosen
    ]  # fmt: skip
    kept = sum(_place(reports, report) >= 0 for report in reports)
    return Section(
        key="weeks", title=say("weeks.title", count=kept, all=MOST_WEEKS),
        blocks=[Figures(figures=figures, kind="small")],
    )  # fmt: skip


def _place(reports: Sequence[WeekReport], report: WeekReport) -> int:
    """Place of a report among the twelve weeks up to the newest; negative where it is older."""
    since = first_of(reports[-1].week) - first_of(report.week)
    return MOST_WEEKS - 1 - since.days // 7


def _course(reports: Sequence[WeekReport], one: Condition) -> Floats:
    """Values of a quantity in the twelve weeks up to the newest, shape (12,)."""
    values = np.full(MOST_WEEKS, np.nan)
    for report in reports:
        place = _place(reports, report)
        same = [other.value for other in report.conditions if other.key == one.key]
        if place >= 0 and same and same[0] is not None:
            values[place] = same[0]
    return values


def _small(reports: Sequence[WeekReport], one: Condition) -> Markup:
    values = _course(reports, one)
    weeks = Axis(words="", span=(0.0, MOST_WEEKS - 1.0), marks=[])
    lines = [line for line in (one.alert, one.alarm) if line is not None]
    x = np.arange(MOST_WEEKS, dtype=float)
    strip = Strip(
        head="", height=28.0, curves=[("measured", x, values)], levels=lines,
        dots=[("p-passed", x[-1:], values[-1:])], zero=not lines,
    )  # fmt: skip
    return strips_figure([strip], weeks, f"{one.component}, {one.what}", kind="week-small")


def _small_words(reports: Sequence[WeekReport], one: Condition, say: Texts) -> str:
    known = _course(reports, one)[:-1]
    known = known[np.isfinite(known)]
    value, arrow = one.value or 0.0, ""
    if len(known):
        same = say.number(value) == say.number(float(known[-1]))
        arrow = " →" if same else " ↑" if value > known[-1] else " ↓"
    return say("weeks.one", component=one.component, what=say.given(one.what),
               value=say.number(value), unit=one.unit.removesuffix("1"), arrow=arrow)  # fmt: skip


def _columns(
    earlier: Mapping[tuple[str, str, str], Condition],
) -> tuple[Column[Condition], ...]:
    def change(one: Condition) -> str:
        last = earlier.get(one.key)
        if last is None or not last.value or one.value is None:
            return NONE
        return f"{signed(100 * (one.value / last.value - 1))}{NARROW}%"

    return (
        Column("Component", lambda one: one.component),
        Column("quantity", lambda one: f"{one.what}, {one.unit}".removesuffix(", 1")),
        Column("this week", _value, ""),
        Column("against the week before", change, ""),
        *(Column(name, _level(name), "") for name in ("reference", "alert", "alarm")),
        Column("state", lambda one: Cell(text=one.state, status=STATUS.get(one.state, ""))),
        Column("weeks to the alarm line, or what it lacks", _time),
    )


def _level(name: str) -> Callable[[Condition], str]:
    return lambda one: NONE if getattr(one, name) is None else number(getattr(one, name))


def _value(one: Condition) -> str:
    ends = "" if one.low is None else f" ({number(one.low)} to {number(one.high)})"
    return f"{number(one.value)}{ends}" if one.value is not None else NOT_KNOWN


def _time(one: Condition) -> str:
    """Weeks to the line with their interval, beyond the horizon, or what is lacking."""
    left = one.to_alarm
    if left is None:
        return one.reason or NONE
    horizon = fixed(left.horizon, 0)
    if left.median is None:
        return f"more than {horizon} ({fixed(100 * left.probability, 0)}{NARROW}% within them)"
    ends = joined([fixed(left.low, 0), fixed(left.high, 0) if left.high else f"over {horizon}"])
    return f"{fixed(left.median, 0)} (between {ends} at {fixed(100 * left.confidence, 0)}{NARROW}%)"
