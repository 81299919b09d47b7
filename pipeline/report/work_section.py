"""Section on the work of a machine: states by day, time of day, programs and cycles."""

from collections.abc import Callable, Mapping
from statistics import median

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import (
    NOT_KNOWN,
    counted,
    day_list,
    day_words,
    duration,
    hours,
    moment,
    number,
    percent,
)
from pipeline.charts.sections import Figure, Figures, Section, absent, present
from pipeline.charts.svg import anchor
from pipeline.charts.tables import MOST_ROWS, Column, Table, code, sources, tabulated
from pipeline.report.work import BIN, NO_NAME, NO_RECORD, Cycle, Day, Work
from pipeline.schema.si import DAY

MOST_DAYS = 35  # of a figure; older days stand in the table
TITLE = "What the machine did"
ROW = 20  # px of one day
STATE_CLASS = {
    "ACTIVE": "active", "READY": "ready", "FEED_HOLD": "hold", "INTERRUPTED": "interrupted",
    "STOPPED": "stopped", "PROGRAM_STOPPED": "stopped", "PROGRAM_COMPLETED": "ready",
    "OPTIONAL_STOP": "stopped", "WAIT": "ready", NO_RECORD: "none",
}  # fmt: skip
"""Fill of each execution state; a state that MTConnect does not name gets ``other``."""


def work_section(done: Work, uses: Mapping[str, str]) -> Section:
    """States by day, days and cycles in tables; ``uses``: "to learn", "to judge" or both."""
    if not done.worked_days:
        return Section(key="work", title=TITLE, text=[_nothing(done)])
    text = [_summary(done)]
    if done.cycles is None:
        text.append(
            absent(
                done.folders.clean / "cycles.parquet",
                "Cycles need the program’s name and the controller’s execution state.",
            )
        )
    elif not done.cycles:
        text.append("No cycle was found in these days.")
    blocks = present(_figures(done), _days_table(done, uses), *_cycle_tables(done))
    return Section(key="work", title=TITLE, text=text, blocks=blocks)


def _nothing(done: Work) -> str:
    if done.state_files:
        return (
            "Not known: the state table has no known second of execution. Record the controller’s "
            "execution state, or name its data item in conf/machine/."
        )
    return absent(
        done.folders.clean / "state",
        "It is made from the machine’s log: execution state, program, spindle speed and load.",
    )


def _summary(done: Work) -> str:
    days = done.worked_days
    known, active = sum(day.known for day in days), sum(day.active for day in days)
    text = (
        f"{counted(len(days), 'day')} with records, {hours(known)} h known, of these "
        f"{hours(active)} h ACTIVE ({percent(active, known)})."
    )
    spindle = [(d.running, d.speed_known) for d in days if d.running is not None]
    if spindle:
        runs, seen = sum(r for r, _ in spindle), sum(k or 0.0 for _, k in spindle)
        text += f" The spindle ran {hours(runs)} h of the {hours(seen)} h that its speed is known."
    held = sum(d.position_control or 0.0 for d in days)
    if held:
        text += f" Its position loop held it for {hours(held)} h."
    if len(done.periods) > 1:
        spans = [f"{day_words(a)} to {day_words(b, year=True)}" for a, b in done.periods]
        text += f" The records lie in {len(spans)} separate periods: {'; '.join(spans[:4])}."
    if done.missing_days:
        text += f" In between there is no record on {day_list(done.missing_days)}."
    return text


def _figures(done: Work) -> Figures:
    days = done.days[-MOST_DAYS:]
    states: dict[str, list[str]] = {}
    for state in states_of(days):
        states.setdefault(state_class(state), []).append(state)
    legend = [
        (kind, ", ".join(words), "hatch" if kind == "s-none" else "box")
        for kind, words in states.items()
    ]
    made = sources(done.shelf, *done.state_files)
    which = "" if len(days) == len(done.days) else f" (the last {len(days)} days)"
    return Figures(
        legend=legend,
        figures=[
            Figure(svg=bars_figure(days), sources=made,
                   caption=f"How long: hours in each execution state, each bar 24 h{which}."),
            Figure(svg=strips_figure(days), sources=made,
                   caption=f"When: execution state over the day, {done.time_zone}, "
                   f"in steps of 5 min{which}."),
        ],
    )  # fmt: skip


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
            width = 100 * day.seconds.get(state, 0.0) / max(DAY, sum(day.seconds.values()))
            if width > 0:
                said = f"{day_words(day.day)}: {state} {hours(day.seconds[state])} h"
                bar = svg.bar(x, width, row * ROW + 3, ROW - 6, state_class(state))
                parts.append(svg.tag("g", svg.group([svg.tag("title", said), bar])))
            x += width
    active = hours(sum(day.active for day in days))
    label = f"Hours in each execution state on {len(days)} days; ACTIVE {active} h in all"
    return svg.figure(parts, height=len(days) * ROW + 22, label=label, kind="days")


def strips_figure(days: list[Day]) -> Markup:
    """States of the machine over time: one strip a day, midnight to midnight."""
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


def _days_table(done: Work, uses: Mapping[str, str]) -> Table | None:
    """Hours of each day: known, ACTIVE, stopped in a program, spindle, cutting."""
    days = done.days
    kinds = [k for k in ("cut", "air", "warm_up") if any(k in d.kinds for d in days)]
    columns: list[Column[Day]] = [
        Column("Day", lambda day: day_words(day.day, year=True)),
        Column("recorded", lambda day: hours(day.known), "h"),
        Column("ACTIVE", lambda day: hours(day.active), "h"),
        Column("feed hold and interrupted", lambda day: hours(day.stopped), "h"),
        Column("spindle runs", lambda day: hours(day.running), "h"),
        Column("held in position", lambda day: hours(day.position_control), "h"),
        *(Column(kind.replace("_", "-"), _hours_of(kind), "h") for kind in kinds),
        Column("used", lambda day: uses.get(day.day, "–")),
    ]
    made = sources(done.shelf, *done.state_files, done.folders.clean / "segments.parquet")
    caption = f"Hours on each of {counted(len(days), 'day')}"
    return tabulated(caption, days, columns, made, folded=len(days) > 16)


def _hours_of(kind: str) -> Callable[[Day], str]:
    return lambda day: hours(day.kinds.get(kind, 0.0))


def _seconds(cycles: list[Cycle]) -> list[float]:
    return [cycle.seconds for cycle in cycles]


def _active(cycles: list[Cycle]) -> str:
    known = [cycle.active for cycle in cycles if cycle.active is not None]
    return percent(sum(known), sum(_seconds(cycles))) if known else NOT_KNOWN


def _running(cycles: list[Cycle]) -> str:
    """Share of the cycles in which the spindle runs, of those with a recorded speed."""
    known = [(c.running * c.seconds, c.seconds) for c in cycles if c.running is not None]
    return percent(sum(runs for runs, _ in known), sum(seconds for _, seconds in known))


PROGRAMS: tuple[Column[list[Cycle]], ...] = (
    Column("Program", lambda cycles: code(cycles[0].program or NO_NAME)),
    Column("cycles", lambda cycles: number(len(cycles)), ""),
    Column("complete", lambda cycles: number(sum(c.complete is True for c in cycles)), ""),
    Column("median", lambda cycles: duration(median(_seconds(cycles))), ""),
    Column("shortest", lambda cycles: duration(min(_seconds(cycles))), ""),
    Column("longest", lambda cycles: duration(max(_seconds(cycles))), ""),
    Column("in all", lambda cycles: hours(sum(_seconds(cycles))), "h"),
    Column("ACTIVE", _active, ""),
    Column("spindle runs", _running, ""),
)
CYCLES: tuple[Column[Cycle], ...] = (
    Column("Start", lambda cycle: moment(cycle.start)),
    Column("program", lambda cycle: code(cycle.program or NO_NAME)),
    Column("part", lambda cycle: cycle.part or "–"),
    Column("lasted", lambda cycle: duration(cycle.seconds), ""),
    Column("ACTIVE", lambda cycle: duration(cycle.active), ""),
    Column("held or interrupted", lambda cycle: duration(cycle.stopped), ""),
    Column("spindle runs", lambda cycle: percent(cycle.running, 1.0), ""),
    Column("complete", lambda cycle: (
        NOT_KNOWN if cycle.complete is None else "yes" if cycle.complete else "no"
    )),
)  # fmt: skip


def _cycle_tables(done: Work) -> tuple[Table | None, Table | None]:
    """Cycles by program, the most time first; each cycle, the newest first."""
    cycles = sorted(done.cycles or [], key=lambda c: (-c.start, c.program))
    by_program: dict[str, list[Cycle]] = {}
    for cycle in done.cycles or []:
        by_program.setdefault(cycle.program or NO_NAME, []).append(cycle)
    order = sorted(by_program, key=lambda name: (-sum(_seconds(by_program[name])), name))
    made = sources(done.shelf, done.folders.clean / "cycles.parquet")
    summed = f"{counted(len(cycles), 'cycle')} of {counted(len(order), 'program')}"
    groups = [by_program[name] for name in order]
    return (
        tabulated(f"{summed}, the most time first", groups, PROGRAMS, made, most=25),
        tabulated(
            "Every cycle, the newest first", cycles, CYCLES, made, most=MOST_ROWS, folded=True
        ),
    )
