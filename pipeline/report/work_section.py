"""Section on the work of a machine: states by day, time of day, programs and cycles."""

from collections.abc import Mapping
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
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.report.work import BIN, DAY, NO_RECORD, Cycle, Day, Work

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
    """States by day, when it ran, its days and cycles in tables.

    ``uses`` says for which models a day served: "to learn", "to judge" or both.
    """
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
    blocks = present(
        _figures(done), _days_table(done, uses), _programs_table(done), _cycles_table(done)
    )
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
    known = sum(s for d in days for k, s in d.seconds.items() if k != NO_RECORD)
    active = sum(d.seconds.get("ACTIVE", 0.0) for d in days)
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
                   caption=f"When: execution state over the day, UTC, in steps of 5 min{which}."),
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


def _days_table(done: Work, uses: Mapping[str, str]) -> Table:
    """Hours of each day: known, ACTIVE, stopped in a program, spindle, cutting."""
    days = done.days
    kinds = [k for k in ("cut", "air", "warm_up") if any(k in d.kinds for d in days)]
    heads = [Head(name="Day"), *numbers(
        ("recorded", "h"), ("ACTIVE", "h"), ("feed hold and interrupted", "h"),
        ("spindle runs", "h"), ("held in position", "h"),
        *((k.replace("_", "-"), "h") for k in kinds),
    ), Head(name="used")]  # fmt: skip
    return Table(
        caption=f"Hours on each of {counted(len(days), 'day')}",
        heads=heads,
        rows=[_day_row(day, kinds, uses) for day in days],
        sources=sources(done.shelf, *done.state_files, done.folders.clean / "segments.parquet"),
        folded=len(days) > 16,
    )


def _day_row(day: Day, kinds: list[str], uses: Mapping[str, str]) -> list[Cell]:
    known = sum(s for state, s in day.seconds.items() if state != NO_RECORD)
    stopped = day.seconds.get("FEED_HOLD", 0.0) + day.seconds.get("INTERRUPTED", 0.0)
    return cells(
        day_words(day.day, year=True),
        hours(known),
        hours(day.seconds.get("ACTIVE", 0.0)),
        hours(stopped),
        hours(day.running),
        hours(day.position_control),
        *(hours(day.kinds.get(k, 0.0)) for k in kinds),
        uses.get(day.day, "–"),
    )


def _programs_table(done: Work) -> Table | None:
    """Cycles by program: how many, how long, how much of it the spindle ran."""
    cycles = done.cycles
    if not cycles:
        return None
    by_program: dict[str, list[Cycle]] = {}
    for cycle in cycles:
        by_program.setdefault(cycle.program or "(no name)", []).append(cycle)
    order = sorted(by_program.items(), key=lambda kv: (-sum(c.seconds for c in kv[1]), kv[0]))
    return Table(
        caption=f"{counted(len(cycles), 'cycle')} of {counted(len(order), 'program')}, "
        f"the most time first{left_out(len(order), 25)}",
        heads=[Head(name="Program"), *numbers(
            ("cycles", ""), ("complete", ""), ("median", ""), ("shortest", ""), ("longest", ""),
            ("in all", "h"), ("ACTIVE", ""), ("spindle runs", ""),
        )],
        rows=[_program_row(name, group) for name, group in order[:25]],
        sources=sources(done.shelf, done.folders.clean / "cycles.parquet"),
    )  # fmt: skip


def _program_row(name: str, group: list[Cycle]) -> list[Cell]:
    seconds = [c.seconds for c in group]
    active = [c.active for c in group if c.active is not None]
    running = [(c.running * c.seconds, c.seconds) for c in group if c.running is not None]
    return cells(
        Cell(text=name, code=True),
        number(len(group)),
        number(sum(c.complete is True for c in group)),
        duration(median(seconds)),
        duration(min(seconds)),
        duration(max(seconds)),
        hours(sum(seconds)),
        percent(sum(active), sum(seconds)) if active else NOT_KNOWN,
        percent(sum(r for r, _ in running), sum(s for _, s in running)),
    )


def _cycles_table(done: Work) -> Table | None:
    """Each cycle, the newest first."""
    cycles = sorted(done.cycles or [], key=lambda c: (-c.start, c.program))
    if not cycles:
        return None
    rows = [
        cells(
            moment(c.start), Cell(text=c.program or "(no name)", code=True), c.part or "–",
            duration(c.seconds), duration(c.active), duration(c.stopped),
            NOT_KNOWN if c.running is None else percent(c.running, 1.0),
            {True: "yes", False: "no"}.get(c.complete, NOT_KNOWN),  # type: ignore[arg-type]
        )
        for c in cycles[:MOST_ROWS]
    ]  # fmt: skip
    return Table(
        caption=f"Every cycle, the newest first{left_out(len(cycles), MOST_ROWS)}",
        heads=[*names("Start", "program", "part"), *numbers(
            ("lasted", ""), ("ACTIVE", ""), ("held or interrupted", ""), ("spindle runs", ""),
        ), Head(name="complete")],
        rows=rows,
        sources=sources(done.shelf, done.folders.clean / "cycles.parquet"),
        folded=True,
    )  # fmt: skip
