"""The section on what the machine did."""

from pipeline.charts.numbers import counted, day_list, day_words, hours, percent
from pipeline.charts.sections import Figure, Figures, Section, absent, present
from pipeline.charts.tables import sources
from pipeline.report.facts import Facts
from pipeline.report.figures import bars_figure, state_class, states_of, strips_figure
from pipeline.report.work_tables import cycles_table, days_table, programs_table

MOST_DAYS = 35  # of a figure; older days stand in the table

TITLE = "What the machine did"


def work_section(found: Facts) -> Section:
    """States by day, when it ran, its days and cycles in tables."""
    if not found.worked_days:
        return Section(key="work", title=TITLE, text=[_nothing(found)])
    text = [_summary(found)]
    if found.working.cycles is None:
        text.append(
            absent(
                found.folders.clean / "cycles.parquet",
                "Cycles need the program’s name and the controller’s execution state.",
            )
        )
    elif not found.working.cycles:
        text.append("No cycle was found in these days.")
    blocks = present(_figures(found), days_table(found), programs_table(found), cycles_table(found))
    return Section(key="work", title=TITLE, text=text, blocks=blocks)


def _nothing(found: Facts) -> str:
    if found.working.state_files:
        return (
            "Not known: the state table has no known second of execution. Record the controller’s "
            "execution state, or name its data item in conf/machine/."
        )
    return absent(
        found.folders.clean / "state",
        "It is made from the machine’s log: execution state, program, spindle speed and load.",
    )


def _summary(found: Facts) -> str:
    days = found.worked_days
    known = sum(s for d in days for k, s in d.seconds.items() if k != "no record")
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
    if len(found.periods) > 1:
        spans = [f"{day_words(a)} to {day_words(b, year=True)}" for a, b in found.periods]
        text += f" The records lie in {len(spans)} separate periods: {'; '.join(spans[:4])}."
    if found.missing_days:
        text += f" In between there is no record on {day_list(found.missing_days)}."
    return text


def _figures(found: Facts) -> Figures:
    days = found.working.days[-MOST_DAYS:]
    states: dict[str, list[str]] = {}
    for state in states_of(days):
        states.setdefault(state_class(state), []).append(state)
    legend = [
        (kind, ", ".join(words), "hatch" if kind == "s-none" else "box")
        for kind, words in states.items()
    ]
    made = sources(found.shelf, *found.working.state_files)
    which = "" if len(days) == len(found.working.days) else f" (the last {len(days)} days)"
    return Figures(
        legend=legend,
        figures=[
            Figure(svg=bars_figure(days), sources=made,
                   caption=f"How long: hours in each execution state, each bar 24 h{which}."),
            Figure(svg=strips_figure(days), sources=made,
                   caption=f"When: execution state over the day, UTC, in steps of 5 min{which}."),
        ],
    )  # fmt: skip
