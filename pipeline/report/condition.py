"""Condition over weeks on the page of records: the newest kept report beside the one before."""

from collections.abc import Callable, Mapping, Sequence

from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, fixed, joined, number, signed
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import Source, SourceRegistry
from pipeline.charts.tables import Cell, Column, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.schema.condition import Condition, WeekReport

MADE_FROM = "data/twin_state, data/clean and data/ledger, by the stage condition"
NONE = "–"
MOST_WEEKS = 12
"""Weeks that pages look back."""
STATUS = {"fine": "passed", "watch": "attention", "act": "failed", "not assessed": "unknown"}
"""Shape and colour of a state."""


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
