"""Simulated part programs: predicted time of each, by cause, and what would save some."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa

from pipeline.charts import svg
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, duration, number, percent
from pipeline.charts.sections import Block, Figure, Figures, Section, present
from pipeline.charts.sources import Source, SourceRegistry, shown
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, sources, tabulated
from pipeline.report.cut.tables import sentence
from pipeline.report.programs import panels
from pipeline.report.programs.moves import (
    COLOURS,
    COLUMNS,
    UNKNOWN,
    Classes,
    ProgramMoves,
    map_figure,
    program_moves,
)
from pipeline.report.standalone_page import StandalonePage
from pipeline.schema.program_cut import ProgramCut, SimulatedProgram, ToolTime
from pipeline.schema.verdict import UsedModel

WORTH_SAYING = 0.05
"""Share of a program's time from which a cause is named [1]."""

TIME_LEGEND = [
    ("s-cut", "cutting, at the programmed feed", "box"),
    ("s-lost", "short of the programmed feed", "box"),
    ("s-rapid", "time in rapids", "box"),
    ("s-still", "standing", "box"),
]
REMEDIES = {
    "acceleration": "the axes’ acceleration slows it down: longer blocks, fewer rapids would help",
    "corner": "corners slow it down: rounded ones, or a wider path tolerance, would help",
    "arc": "tight arcs slow it down: larger radii would help",
    "curve": "curves made of chords slow it down: longer chords, or arcs, would help",
    "tolerance": "the path tolerance slows it down: where the part allows, widen it",
    "exact stop": "it stops between blocks: look at pecks, G61, G9 and M codes between cuts",
    "axis speed": "an axis goes as fast as it can: a higher feed gains nothing there",
    "jerk": "the limit of jerk slows it down: smoother paths would help",
}
"""Greatest cause of slowness of a cut, and its remedy for the programmer."""
RESTS_ON = {
    "acceleration": "cutting_acceleration", "corner": "corner_jump", "arc": "arc_acceleration",
    "curve": "arc_acceleration", "tolerance": "tolerance", "exact stop": "settle_time",
    "jerk": "jerk",
}  # fmt: skip
"""Parameter of the control that decides how much a bound costs."""
FREE = ("feed", "rapid", *panels.STANDING)
"""Causes of time that are programmed; the others slow the cut down."""
MADE_FROM = "the part program and the model of the control"


SERIES = ((1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,))
"""Round bounds within a decade, the finest first."""


@dataclass(frozen=True, kw_only=True)
class Program:
    """Simulated part program; ``moves`` is None where nothing can be drawn.

    ``files`` are its summary and its table of moves.
    """

    summary: SimulatedProgram
    moves: ProgramMoves | None
    files: tuple[Path, Path] = (Path(), Path())
    cut: ProgramCut | None = None
    """Cut of its blocks; None where nothing is said of blank, tools and material."""
    verdicts: tuple[UsedModel, ...] = ()
    """Verdicts on the sub-models that the cut rests on."""

    @property
    def name(self) -> str:
        """Name of the program."""
        return self.summary.program

    def sources(self, shelf: SourceRegistry) -> tuple[list[Source], list[Source]]:
        """Files of the summary, and of the moves."""
        summary, moves = self.files
        return sources(shelf, summary), sources(shelf, moves)

    @property
    def refused(self) -> str:
        """Why it could not be read; empty when it could."""
        return self.summary.refused or ""

    @property
    def seconds(self) -> float | None:
        """Predicted time [s]."""
        return self.summary.total_time_s

    @property
    def interval(self) -> str:
        """90 % interval of the predicted time in words; empty where it is not known."""
        if self.summary.total_time_90_s is None:
            return ""
        low, high = (duration(end) for end in self.summary.total_time_90_s)
        return f"90{NARROW}% interval {low} to {high}"

    @property
    def origin(self) -> Literal["simulated", "recorded"]:
        """Origin of the machine's records."""
        return "simulated" if self.summary.origin == "simulated" else "recorded"


def simulated_programs(folder: Path | None, shelf: SourceRegistry) -> list[Program]:
    """Simulated programs of a machine, the longest first."""
    paths = [] if folder is None else sorted(folder.glob("*.json"))
    programs = [
        program_of(summary, path, shelf)
        for path in paths
        if (summary := shelf.read(path, SimulatedProgram, MADE_FROM)) is not None
    ]
    return sorted(programs, key=lambda p: (-(p.seconds or 0.0), p.name))


def program_of(summary: SimulatedProgram, path: Path, shelf: SourceRegistry) -> Program:
    """Program of a summary in the file ``path``, with the table of moves beside it."""
    table_path = path.with_suffix(".parquet")
    table = None if summary.refused else shelf.table(table_path, COLUMNS, MADE_FROM)
    moves = None
    if table is not None:
        try:
            read = program_moves(table, summary.origin_mm)
            moves = read if len(read.time) else None
        except pa.ArrowException as error:
            shelf.broken[shown(table_path)] = f"its columns are not those of moves: {error}"
    return Program(summary=summary, moves=moves, files=(path, table_path))


def programs_section(programs: list[Program], shelf: SourceRegistry) -> Section | None:
    """All programs in a table, and those that cannot be run as written."""
    if not programs:
        return None
    refused = [p for p in programs if p.refused]
    beyond = [p for p in programs if p.summary.violations]
    text = [
        f"{counted(len(programs), 'part program')}, run through the identified control: the "
        "time of every block, the feed that it reaches, and what keeps it from more."
    ]
    if refused:
        text.append(f"{counted(len(refused), 'program')} could not be read:")
    if beyond:
        text.append(
            f"{counted(len(beyond), 'program')} must not be run as written, since the machine "
            "cannot do all of it: " + ", ".join(p.name for p in beyond) + "."
        )
    return Section(
        key="programs",
        title="Programs: where their time goes",
        text=text,
        pairs=[
            *((p.name, p.refused) for p in refused),
            *((p.name, _leaves(p)) for p in beyond),
        ],
        blocks=present(_overview_table(programs, shelf)),
    )


def _leaves(program: Program) -> str:
    return f"leaves the machine: {'; '.join(program.summary.violations)}"


def feed_classes(programs: Sequence[ProgramMoves]) -> Classes:
    """Classes, at most six, over the feeds that take 95 of 100 seconds of cutting."""
    chosen = [m.cutting & np.isfinite(m.reached) & (m.time > 0) for m in programs]
    feed = np.concatenate([*(m.reached[c] for m, c in zip(programs, chosen, strict=True)), []])
    time = np.concatenate([*(m.time[c] for m, c in zip(programs, chosen, strict=True)), []])
    if len(feed) == 0:
        return Classes(bounds=())
    order = np.argsort(feed)
    passed = np.cumsum(time[order]) / time.sum()
    low, high = (float(feed[order][np.searchsorted(passed, q)]) for q in (0.025, 0.97))
    return Classes(bounds=tuple(_bounds(low, high)))


def _bounds(low: float, high: float) -> list[float]:
    """Round feeds inside ``low`` to ``high``: evenly spaced within a span, else by ratio."""
    if high < 4 * low:
        even = [b for b in svg.ticks(low, high, most=5) if low < b < high]
        return even[: COLOURS - 1] if high > 1.02 * low else []
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for series in SERIES:
        inside = [m * 10.0**k for k in decades for m in series if low < m * 10.0**k < high]
        if len(inside) <= COLOURS + 1:  # one or two too many: what is slowest is one class
            break
    return inside[-(COLOURS - 1) :]


def simulated_page(
    program: Program, classes: Classes, shelf: SourceRegistry, assumed: Collection[str] = ()
) -> StandalonePage:
    """Page of a program that could be followed: its time, its path, its feed over time.

    ``assumed`` names the parameters of the control that its records do not determine.
    """
    summary, beyond = program.summary, program.summary.violations
    words = [*_loss(summary), _binding(program, assumed)]
    return StandalonePage(
        program=program.name,
        machine=summary.machine,
        about=f"Run through the identified control of {summary.machine}; positions are in the "
        "machine’s frame",
        origin=program.origin,
        status="failed" if beyond else "unknown",
        word="leaves the machine" if beyond else f"{duration(program.seconds)} predicted",
        sentences=[
            *([f"{sentence(_leaves(program))}."] if beyond else []),
            *(f"{sentence(w)}." for w in words if w),
        ],
        key_figures=_key_figures(program),
        sections=[time_section(program, classes, *program.sources(shelf))],
        running="Kerf: time of a part program",
        computed="Computed by Kerf from the program and the model of the machine’s control.",
    )


def _key_figures(program: Program) -> list[tuple[str, str, str]]:
    summary = program.summary
    path, blocks, tools = summary.path_length_mm, summary.blocks, _tools(summary)
    return [
        ("Time", duration(summary.total_time_s), program.interval),
        ("Cutting", duration(summary.cutting_time_s),
         percent(summary.cutting_time_s, summary.total_time_s)),
        ("Path", NOT_KNOWN if path is None else f"{number(path / 1000)}{NARROW}m", ""),
        ("Blocks", NOT_KNOWN if blocks is None else number(blocks),
         counted(len(tools), "tool") if tools else ""),
    ]  # fmt: skip


def _tools(summary: SimulatedProgram) -> list[ToolTime]:
    """Times of the tools, without that before the first is in the spindle."""
    return [used for used in summary.by_tool if used.tool != -1]


def time_section(
    program: Program, classes: Classes, summary: list[Source], moves: list[Source]
) -> Section:
    """Path and feed of a program, and its time by cause and by tool.

    The files of its ``summary`` and of its ``moves`` stand below the figures.
    """
    figures = [
        figure
        for figure in (
            _map(program, classes, moves),
            _bars(program, panels.cause_bars(program.summary), "what costs it", summary),
            _timeline(program, classes, moves),
            _bars(program, panels.tool_bars(program.summary), "tool", summary),
        )
        if figure is not None
    ]  # fmt: skip
    legend = [] if program.moves is None else _legend(program.moves, classes)
    kind = "one" if program.moves is None else "program"
    drawn = Figures(figures=figures, legend=[*legend, *TIME_LEGEND], kind=kind)
    blocks: list[Block] = [
        *([drawn] if figures else []),
        *present(_advice_table(program.summary, summary)),
    ]
    return Section(key="time-use", title="Where its time goes", blocks=blocks)


def _advice_table(program: SimulatedProgram, files: list[Source]) -> Table | None:
    """What the programmer can gain besides F and S."""
    total = program.total_time_s
    return tabulated("What would save time, for the programmer", program.advice, (
        Column("Change", lambda one: sentence(one.what)),
        Column("saves, s", lambda one: number(one.seconds), ""),
        Column("of the time", lambda one: percent(one.seconds, total), ""),
        Column("if", lambda one: one.assumes),
        Column("lines", lambda one: ", ".join(map(str, one.lines)) or "–"),
    ), files, note="Planned again by the same control with this one change, which is not made: "
       "savings do not add up, and none is promised.")  # fmt: skip


def _slowed(program: SimulatedProgram) -> dict[str, float]:
    """Time [s] of cuts below the programmed feed, by cause."""
    return {name: s for name, s in program.by_cause.items() if name not in FREE and s > 0}


def _loss(program: SimulatedProgram) -> list[str]:
    """Time lost by cutting below the programmed feed."""
    lost = sum(_slowed(program).values())
    spent = lost + program.by_cause.get("feed", 0.0)
    if spent <= 0:
        return []
    if lost < 0.005 * spent:
        return ["nearly all of the cutting time is spent at the programmed feed"]
    return [
        f"speeding up and slowing down costs {duration(lost)} of the cutting time "
        f"({percent(lost, spent)}) over a path at the programmed feed throughout"
    ]


def _binding(program: Program, assumed: Collection[str]) -> str:
    """Greatest loss beside the programmed feed and rapids, and its meaning."""
    costs, whole = _slowed(program.summary), sum(program.summary.by_cause.values())
    bound = {k: v for k, v in costs.items() if k in REMEDIES and v >= WORTH_SAYING * whole}
    if not bound:
        return ""
    worst = max(sorted(bound), key=lambda k: bound[k])
    rests = (
        "; the limit behind this is assumed, as the records do not determine it"
        if RESTS_ON.get(worst) in assumed else ""
    )  # fmt: skip
    return f"for {percent(bound[worst], whole)} of its time {REMEDIES[worst]}{rests}"


def _legend(moves: ProgramMoves, classes: Classes) -> list[tuple[str, str, str]]:
    used = set(classes.of(moves.reached[moves.cutting]).tolist())
    order = [i for i in range(len(classes)) if i in used] + [i for i in (UNKNOWN,) if i in used]
    legend = [classes.legend(i) for i in order]
    return [*legend, *([("l-rapid", "path of rapids", "line")] if moves.rapid.any() else [])]


def _map(program: Program, classes: Classes, files: list[Source]) -> Figure | None:
    moves = program.moves
    if moves is None:
        return None
    words = (
        f"Path of {program.name}, {counted(len(moves.time), 'move')}, coloured by the feed that "
        "each block reaches; dots are moves along the tool’s axis"
    )
    return Figure(
        svg=map_figure(moves, classes, words),
        caption=f"{words}. Rapids may leave the frame, which holds what is cut.",
        sources=files,
    )


def _timeline(program: Program, classes: Classes, files: list[Source]) -> Figure | None:
    shown = None if program.moves is None else panels.timeline(program.moves)
    if shown is None:
        return None
    words = (
        f"Feed over the time of {program.name}, {duration(shown.total)}: programmed against "
        "reached, while it cuts"
    )
    return Figure(
        svg=panels.timeline_figure(shown, classes, words),
        caption=f"{words}; below, what goes on, and which tool is in the spindle.",
        sources=files,
    )


def _bars(
    program: Program, groups: list[panels.Group], by: str, files: list[Source]
) -> Figure | None:
    if not groups:
        return None
    total = program.seconds or sum(bar.seconds for bar in groups[0][1])
    words = f"Predicted time of {program.name} and its share, by {by}"
    return Figure(
        svg=panels.bars_figure(groups, total, words),
        caption=f"{words}.",
        sources=files,
    )


def _overview_table(programs: list[Program], shelf: SourceRegistry) -> Table | None:
    def of_read(cell: Callable[[Program], str]) -> Callable[[Program], str]:
        return lambda program: "–" if program.refused else cell(program)

    def known(value: float | None) -> str:
        return NOT_KNOWN if value is None else number(value)

    def at_feed(program: Program) -> str:
        causes = program.summary.by_cause
        return percent(causes.get("feed", 0.0), sum(causes.values())) if causes else NOT_KNOWN

    def most(program: Program) -> str:
        causes = program.summary.by_cause
        other = {k: v for k, v in causes.items() if k != "feed"}
        if not other:
            return "–"
        worst = max(sorted(other), key=lambda k: other[k])
        return f"{panels.cause_words(worst)}, {percent(other[worst], sum(causes.values()))}"

    def advice(program: Program) -> str:
        first = next(iter(program.summary.advice), None)
        return "–" if first is None else f"{duration(first.seconds)}: {first.what.split(':')[0]}"

    def state(program: Program) -> Cell:
        if program.refused:
            return Cell(text="refused", status="failed")
        if program.summary.violations:
            return Cell(text="beyond the machine", status="failed")
        return Cell(text="read", status="passed")

    columns = [
        Column("Program", lambda p: code(p.name)),
        Column("predicted", of_read(lambda p: duration(p.seconds)), ""),
        Column("cutting", of_read(lambda p: percent(p.summary.cutting_time_s, p.seconds)), ""),
        Column("path", of_read(lambda p: known(
            None if p.summary.path_length_mm is None else p.summary.path_length_mm / 1000
        )), "m"),
        Column("blocks", of_read(lambda p: known(p.summary.blocks)), ""),
        Column("tools", lambda p: str(len(_tools(p.summary)) or "–"), ""),
        Column("at the programmed feed", of_read(at_feed), ""),
        Column("costs most else", of_read(most)),
        Column("would save most", of_read(advice)),
        *([Column("read", state)]
          if any(p.refused or p.summary.violations for p in programs) else []),
    ]  # fmt: skip
    return tabulated("Every part program, the longest first", programs, columns,
                     sources(shelf, *(p.files[0] for p in programs)), most=MOST_ROWS)  # fmt: skip
