"""Tables of what the machine did: days, programs, cycles."""

from statistics import median

from pipeline.charts.numbers import (
    NOT_KNOWN,
    counted,
    day_words,
    duration,
    hours,
    moment,
    number,
    percent,
)
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
from pipeline.report.facts import Facts
from pipeline.report.working import Cycle, Day


def days_table(found: Facts) -> Table:
    """Hours of each day: known, ACTIVE, stopped in a program, spindle, cutting."""
    days = found.working.days
    kinds = [k for k in ("cut", "air", "warm_up") if any(k in d.kinds for d in days)]
    heads = [Head(name="Day"), *numbers(
        ("recorded", "h"), ("ACTIVE", "h"), ("feed hold and interrupted", "h"),
        ("spindle runs", "h"), ("held in position", "h"),
        *((k.replace("_", "-"), "h") for k in kinds),
    ), Head(name="used")]  # fmt: skip
    return Table(
        caption=f"Hours on each of {counted(len(days), 'day')}",
        heads=heads,
        rows=[_day_row(found, day, kinds) for day in days],
        sources=sources(
            found.shelf, *found.working.state_files, found.folders.clean / "segments.parquet"
        ),
        folded=len(days) > 16,
    )


def _day_row(found: Facts, day: Day, kinds: list[str]) -> list[Cell]:
    known = sum(s for state, s in day.seconds.items() if state != "no record")
    stopped = day.seconds.get("FEED_HOLD", 0.0) + day.seconds.get("INTERRUPTED", 0.0)
    uses = [
        word for word, days in (("to learn", found.model.training_days),
                                ("to judge", found.model.golden_days)) if day.day in days
    ]  # fmt: skip
    return cells(
        day_words(day.day, year=True),
        hours(known),
        hours(day.seconds.get("ACTIVE", 0.0)),
        hours(stopped),
        hours(day.running),
        hours(day.position_control),
        *(hours(day.kinds.get(k, 0.0)) for k in kinds),
        " and ".join(uses) or "–",
    )


def programs_table(found: Facts) -> Table | None:
    """Cycles by program: how many, how long, how much of it the spindle ran."""
    cycles = found.working.cycles
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
        sources=sources(found.shelf, found.folders.clean / "cycles.parquet"),
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


def cycles_table(found: Facts) -> Table | None:
    """Each cycle, the newest first."""
    cycles = sorted(found.working.cycles or [], key=lambda c: (-c.start, c.program))
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
        sources=sources(found.shelf, found.folders.clean / "cycles.parquet"),
        folded=True,
    )  # fmt: skip
