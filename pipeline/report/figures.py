"""Figures of what the machine did: hours in each state by day, and when."""

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import day_words, hours
from pipeline.charts.svg import anchor
from pipeline.report.working import BIN, DAY, NO_RECORD, Day

ROW = 20  # px of one day
STATE_CLASS = {
    "ACTIVE": "active", "READY": "ready", "FEED_HOLD": "hold", "INTERRUPTED": "interrupted",
    "STOPPED": "stopped", "PROGRAM_STOPPED": "stopped", "PROGRAM_COMPLETED": "ready",
    "OPTIONAL_STOP": "stopped", "WAIT": "ready", NO_RECORD: "none",
}  # fmt: skip
"""Fill of each execution state; a state that MTConnect does not name gets ``other``."""


def state_class(state: str) -> str:
    """CSS class of an execution state."""
    return f"s-{STATE_CLASS.get(state, 'other')}"


def states_of(days: list[Day]) -> list[str]:
    """Every state that occurs, ACTIVE first and "no record" last."""
    found = {s for d in days for s, seconds in d.seconds.items() if seconds > 0}
    order = {name: i for i, name in enumerate(STATE_CLASS)}
    return sorted(found, key=lambda s: (s == NO_RECORD, order.get(s, len(order)), s))


def bars_figure(days: list[Day]) -> Markup:
    """Hours in each execution state, one bar a day, each bar 24 h long."""
    states, years = states_of(days), _years(days)
    parts = _hour_grid(len(days), [f"{h} h" if h == 24 else str(h) for h in range(0, 25, 6)])
    for row, day in enumerate(days):
        parts.append(_day_label(row, day.day, years))
        x = 0.0
        for state in states:
            width = 100 * day.seconds.get(state, 0.0) / DAY
            if width > 0:
                parts.append(svg.bar(x, width, row * ROW + 3, ROW - 6, state_class(state)))
            x += width
    total = sum(d.seconds.get("ACTIVE", 0.0) for d in days)
    label = f"Hours in each execution state on {len(days)} days; ACTIVE {hours(total)} h in all"
    return svg.figure(parts, height=len(days) * ROW + 22, label=label, kind="days")


def strips_figure(days: list[Day]) -> Markup:
    """When the machine was in which state: one strip a day, midnight to midnight UTC."""
    years = _years(days)
    parts = _hour_grid(len(days), [f"{h:02d}:00" for h in range(0, 25, 6)])
    for row, day in enumerate(days):
        parts.append(_day_label(row, day.day, years))
        parts.append(svg.band(row * ROW + 3, ROW - 6, DAY // BIN, _strip(day.runs)))
    label = f"Time of day in each execution state on {len(days)} days, in steps of {BIN // 60} min"
    return svg.figure(parts, height=len(days) * ROW + 22, label=label, kind="days")


def _strip(runs: list[tuple[str, int, int]]) -> list[Markup]:
    by_class: dict[str, list[str]] = {}
    for state, start, end in runs:
        data = f"M{start} 0h{end - start}v{svg.FULL}h{start - end}z"
        by_class.setdefault(state_class(state), []).append(data)
    return [svg.tag("path", d="".join(d), class_=kind) for kind, d in sorted(by_class.items())]


def _hour_grid(rows: int, labels: list[str]) -> list[Markup]:
    parts = []
    for i, words in enumerate(labels):
        x = 25.0 * i
        parts.append(svg.down(x, 0, rows * ROW))
        parts.append(svg.text(x, rows * ROW + 15, words, anchor(x)))
    return parts


def _years(days: list[Day]) -> bool:
    """Whether the days lie in several years, so that the year must be said."""
    return len({d.day[:4] for d in days}) > 1


def _day_label(row: int, day: str, years: bool) -> Markup:
    words = day_words(day, year=years)
    if years:
        words = words.partition("\u00a0")[2]  # the year is worth more than the weekday
    return svg.text(0, row * ROW + ROW / 2 + 4, words, "name end", dx=-8)
