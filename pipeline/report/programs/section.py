"""Section on part programs: predicted time of each, where it is spent, and its cause."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, duration, number, percent
from pipeline.charts.sections import Block, Figure, Figures, Heading, Section
from pipeline.charts.sources import SourceRegistry, shown
from pipeline.charts.tables import MOST_ROWS, Cell, Head, Table, cells, left_out, numbers, sources
from pipeline.report.programs import times
from pipeline.report.programs.map import map_figure
from pipeline.report.programs.moves import (
    COLUMNS,
    UNKNOWN,
    FeedClasses,
    ProgramMoves,
    feed_classes,
    lengths,
    program_moves,
)
from pipeline.schema.program import SimulatedProgram

MOST_DRAWN = 12  # programs, the longest first; the table has them all
MOST_OPEN = 3  # programs whose figures need not be unfolded
WORTH_SAYING = 0.05  # of a program's time
AT_FEED = 0.98  # of the programmed feed; a block that reaches it counts as reaching it

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
    "exact stop": "exact stops slow it down: look at G61, G9 and M codes between cuts",
    "axis speed": "an axis goes as fast as it can: a higher feed gains nothing there",
    "jerk": "the limit of jerk slows it down: smoother paths would help",
}
"""What slows a program down most, and what its maker can do about it."""
RESTS_ON = {
    "acceleration": "cutting_acceleration", "corner": "corner_jump", "arc": "arc_acceleration",
    "curve": "arc_acceleration", "tolerance": "tolerance", "exact stop": "settle_time",
    "jerk": "jerk",
}  # fmt: skip
"""Parameter of the control that decides how much a bound costs."""
FREE = ("feed", "rapid", "spindle", "nothing")
"""What bounds a block as its programmer asked for."""
MADE_FROM = "the part program and the model of the control"


@dataclass(frozen=True, kw_only=True)
class Program:
    """One simulated part program; ``moves`` is None where nothing can be drawn.

    ``files`` are its summary and its table of moves.
    """

    summary: SimulatedProgram
    moves: ProgramMoves | None
    files: tuple[Path, Path]

    @property
    def name(self) -> str:
        """Name of the program."""
        return self.summary.program

    @property
    def refused(self) -> str:
        """Why it could not be read; empty when it could."""
        return self.summary.refused or ""

    @property
    def seconds(self) -> float | None:
        """Predicted time [s]."""
        return self.summary.total_time_s


def simulated_programs(folder: Path | None, shelf: SourceRegistry) -> list[Program]:
    """Simulated programs of a machine, the longest first."""
    paths = [] if folder is None else sorted(folder.glob("*.json"))
    programs = [one for path in paths if (one := _program(path, shelf)) is not None]
    return sorted(programs, key=lambda p: (-(p.seconds or 0.0), p.name))


def _program(path: Path, shelf: SourceRegistry) -> Program | None:
    summary = shelf.read(path, SimulatedProgram, MADE_FROM)
    if summary is None:
        return None
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


def programs_section(
    programs: list[Program], shelf: SourceRegistry, assumed: Collection[str] = ()
) -> Section | None:
    """Programs in a table, then each with its path, its feed over time, and its time by cause.

    ``assumed`` names the parameters of the control that its records do not determine.
    """
    if not programs:
        return None
    refused = [p for p in programs if p.refused]
    drawn = [p for p in programs if not p.refused][:MOST_DRAWN]
    classes = feed_classes([p.moves for p in drawn if p.moves is not None])
    text = [
        f"{counted(len(programs), 'part program')}, run through the identified control: the "
        "time of every block, the feed that it reaches, and what keeps it from more. Positions "
        "are in the machine’s frame."
    ]
    if len(programs) - len(refused) > len(drawn):
        text.append(f"The {len(drawn)} longest are drawn; the table has all of them.")
    if refused:
        text.append(f"{counted(len(refused), 'program')} could not be read:")
    beyond = [p for p in programs if p.summary.violations]
    if beyond:
        text.append(
            f"{counted(len(beyond), 'program')} must not be run as written, since the machine "
            "cannot do all of it: " + ", ".join(p.name for p in beyond) + "."
        )
    blocks: list[Block] = [_overview_table(programs, shelf)]
    for place, program in enumerate(drawn):
        blocks += _blocks(shelf, program, classes, assumed, folded=place >= MOST_OPEN)
    return Section(
        key="programs",
        title="Programs: where their time goes",
        text=text,
        pairs=[
            *((p.name, p.refused) for p in refused),
            *((p.name, f"leaves the machine: {'; '.join(p.summary.violations)}") for p in beyond),
        ],
        blocks=blocks,
    )


def _blocks(
    shelf: SourceRegistry, program: Program, classes: FeedClasses, assumed: Collection[str], *,
    folded: bool,
) -> list[Block]:  # fmt: skip
    heading = Heading(heading=program.name, text=_summary(program, assumed))
    parts = (
        _map(shelf, program, classes),
        _bars(shelf, program, times.limit_bars(program.summary), "what bounds its speed"),
        _timeline(shelf, program, classes),
        _bars(shelf, program, times.tool_and_type_bars(program.summary), "tool and type of block"),
    )
    figures = [f for f in parts if f is not None]
    if not figures:
        return [heading]
    legend = [] if program.moves is None else _legend(program.moves, classes)
    shown = Figures(
        figures=figures,
        legend=[*legend, *TIME_LEGEND],
        kind="one" if program.moves is None else "program",
        folded=f"{counted(len(figures), 'figure')} of {program.name}" if folded else "",
    )
    return [heading, shown]


def _summary(program: Program, assumed: Collection[str]) -> str:
    seconds, cutting = program.seconds, program.summary.cutting_time_s
    words = [f"Predicted {duration(seconds)}"]
    if program.summary.total_time_90_s is not None:
        low, high = program.summary.total_time_90_s
        words[0] += f" (90{NARROW}% interval {duration(low)} to {duration(high)})"
    if cutting is not None:
        words[0] += f", of which {duration(cutting)} cutting ({percent(cutting, seconds)})"
    path = program.summary.path_length_mm
    if path is not None:
        words[0] += f", over a path of {number(path / 1000)}{NARROW}m"
    if program.moves is not None:
        words += _loss(program.moves)
    words.append(_binding(program, assumed))
    return " ".join(f"{w[0].upper()}{w[1:]}." for w in words if w)


def _loss(moves: ProgramMoves) -> list[str]:
    """What it costs that cutting moves are not at the programmed feed throughout."""
    known = moves.cutting & np.isfinite(moves.programmed) & np.isfinite(moves.reached)
    spent = float(moves.time[known].sum())
    if spent <= 0:
        return []
    at_feed = known & (moves.reached >= AT_FEED * moves.programmed)
    share = percent(float(moves.time[at_feed].sum()), spent)
    share = "nearly all" if share.startswith(">") else share
    lost = lost_seconds(moves)
    if lost is None or lost < 0.005 * spent:
        return [f"{share} of the cutting time is spent in blocks that reach the programmed feed"]
    return [
        f"speeding up and slowing down costs {duration(lost)} of the cutting time "
        f"({percent(lost, spent)}) over a path at the programmed feed throughout"
    ]


def lost_seconds(moves: ProgramMoves) -> float | None:
    """Cutting time above path length over programmed feed [s]; None where nothing is cut.

    Moves of rotary axes alone have no path in millimetres and do not count.
    """
    length = lengths(moves)
    known = moves.cutting & np.isfinite(moves.programmed) & (length > 1e-6)
    if not known.any():
        return None
    ideal = 60 * length[known] / moves.programmed[known]
    return float(max(0.0, (moves.time[known] - ideal).sum()))


def _binding(program: Program, assumed: Collection[str]) -> str:
    """What costs most beside the programmed feed and rapids, and what that means."""
    costs = times.limit_seconds(program.summary)
    least = WORTH_SAYING * sum(costs.values())
    bound = {k: v for k, v in costs.items() if k in REMEDIES and v >= least}
    if not bound:
        return ""
    worst = max(sorted(bound), key=lambda k: bound[k])
    share = percent(bound[worst], sum(costs.values()))
    rests = (
        "; the limit behind this is assumed, as the records do not determine it"
        if RESTS_ON.get(worst) in assumed else ""
    )  # fmt: skip
    return f"for {share} of its time {REMEDIES[worst]}{rests}"


def _legend(moves: ProgramMoves, classes: FeedClasses) -> list[tuple[str, str, str]]:
    used = set(classes.of(moves.reached[moves.cutting]).tolist())
    order = [i for i in range(len(classes)) if i in used] + [i for i in (UNKNOWN,) if i in used]
    legend = [(f"s-{classes.colour(i)}", classes.words(i), "box") for i in order]
    return [*legend, *([("l-rapid", "path of rapids", "line")] if moves.rapid.any() else [])]


def _map(shelf: SourceRegistry, program: Program, classes: FeedClasses) -> Figure | None:
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
        sources=sources(shelf, program.files[1]),
    )


def _timeline(shelf: SourceRegistry, program: Program, classes: FeedClasses) -> Figure | None:
    shown = None if program.moves is None else times.timeline(program.moves)
    if shown is None:
        return None
    words = (
        f"Feed over the time of {program.name}, {duration(shown.total)}: programmed against "
        "reached, while it cuts"
    )
    return Figure(
        svg=times.timeline_figure(shown, classes, words),
        caption=f"{words}; below, what the axes fall short by, and which tool is in the spindle.",
        sources=sources(shelf, program.files[1]),
    )


def _bars(
    shelf: SourceRegistry, program: Program, groups: list[times.Group], by: str
) -> Figure | None:
    if not groups:
        return None
    total = program.seconds or sum(bar.seconds for bar in groups[0][1])
    words = f"Predicted time of {program.name} by {by}"
    return Figure(
        svg=times.bars_figure(groups, total, words),
        caption=f"{words}.",
        sources=sources(shelf, program.files[0]),
    )


def _overview_table(programs: list[Program], shelf: SourceRegistry) -> Table:
    """Every program: predicted time, cutting, path, blocks, tools, what binds it beside feed."""
    refused = any(p.refused or p.summary.violations for p in programs)
    return Table(
        caption=f"Every part program, the longest first{left_out(len(programs), MOST_ROWS)}",
        heads=[
            Head(name="Program"),
            *numbers(("predicted", ""), ("cutting", ""), ("path", "m"), ("blocks", ""),
                     ("tools", ""), ("at the programmed feed", "")),
            Head(name="else bound most by"),
            *([Head(name="read")] if refused else []),
        ],
        rows=[_row(program)[: None if refused else -1] for program in programs[:MOST_ROWS]],
        sources=sources(shelf, *(p.files[0] for p in programs)),
    )  # fmt: skip


def _row(program: Program) -> list[Cell]:
    name = Cell(text=program.name, code=True)
    if program.refused:
        return cells(name, *["–"] * 7, Cell(text="refused", status="failed"))
    summary, path, blocks = program.summary, program.summary.path_length_mm, program.summary.blocks
    limits = times.limit_seconds(summary)
    whole = sum(limits.values())
    other = {k: v for k, v in limits.items() if k not in FREE}
    most = max(sorted(other), key=lambda k: other[k]) if other else ""
    tools = [one for one in summary.by_tool if one.tool != -1]
    return cells(
        name,
        duration(program.seconds),
        percent(summary.cutting_time_s, program.seconds),
        NOT_KNOWN if path is None else number(path / 1000),
        NOT_KNOWN if blocks is None else number(blocks),
        number(len(tools)) if tools else "–",
        percent(limits.get("feed", 0.0), whole) if limits else NOT_KNOWN,
        f"{times.limit_words(most)}, {percent(other[most], whole)}" if most else "–",
        Cell(text="beyond the machine", status="failed")
        if summary.violations
        else Cell(text="read", status="passed"),
    )
