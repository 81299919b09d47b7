"""The section on part programs: what each is predicted to take, where and why."""

import numpy as np

from pipeline.charts.numbers import NARROW, counted, duration, number, percent, real
from pipeline.charts.sections import Block, Figure, Figures, Heading, Section
from pipeline.charts.sources import Source
from pipeline.charts.tables import sources
from pipeline.report.controlled import Program
from pipeline.report.facts import Facts
from pipeline.report.feed_classes import UNKNOWN, FeedClasses, feed_classes
from pipeline.report.program_bars import (
    Group,
    bars_figure,
    limit_bars,
    limit_seconds,
    tool_and_type_bars,
)
from pipeline.report.program_map import map_figure
from pipeline.report.program_moves import ProgramMoves, lengths
from pipeline.report.program_tables import programs_overview_table
from pipeline.report.program_timeline import timeline, timeline_figure

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


def programs_section(found: Facts) -> Section | None:
    """Programs in a table, then each with its path, its feed over time, and its time by cause."""
    programs = found.control.programs
    if not programs:
        return None
    refused = [p for p in programs if p.refused]
    drawn = [p for p in programs if not p.refused][:MOST_DRAWN]
    classes = feed_classes([p.moves for p in drawn if p.moves is not None])
    text = [
        f"{counted(len(programs), 'part program')}, run through the control that was found: the "
        "time of every block, the feed that it reaches, and what keeps it from more. Positions "
        "are in the machine’s frame."
    ]
    if len(programs) - len(refused) > len(drawn):
        text.append(f"The {len(drawn)} longest are drawn; the table has all of them.")
    if refused:
        text.append(f"{counted(len(refused), 'program')} could not be read:")
    blocks: list[Block] = [t for t in (programs_overview_table(found),) if t is not None]
    for place, program in enumerate(drawn):
        blocks += _program(found, program, classes, folded=place >= MOST_OPEN)
    return Section(
        key="programs",
        title="Programs: where their time goes",
        text=text,
        pairs=[(p.name, p.refused) for p in refused],
        blocks=blocks,
    )


def _program(found: Facts, program: Program, classes: FeedClasses, *, folded: bool) -> list[Block]:
    heading = Heading(heading=program.name, text=_summary(program))
    document = program.document
    parts = (
        _map(found, program, classes),
        _bars(found, program, limit_bars(document), "what bounds its speed"),
        _timeline(found, program, classes),
        _bars(found, program, tool_and_type_bars(document), "tool and type of block"),
    )
    figures = [f for f in parts if f is not None]
    if not figures:
        return [heading]
    drawn = program.moves is not None and len(program.moves.time) > 0
    legend = _legend(program.moves, classes) if drawn and program.moves is not None else []
    legend += TIME_LEGEND
    shown = Figures(
        figures=figures,
        legend=legend,
        kind="program" if drawn else "one",
        folded=f"{counted(len(figures), 'figure')} of {program.name}" if folded else "",
    )
    return [heading, shown]


def _summary(program: Program) -> str:
    seconds, cutting = program.seconds, real(program.document.get("cutting_time_s"))
    words = [f"Predicted {duration(seconds)}"]
    if cutting is not None:
        words[0] += f", of which {duration(cutting)} cutting ({percent(cutting, seconds)})"
    path = real(program.document.get("path_length_mm"))
    if path is not None:
        words[0] += f", over a path of {number(path / 1000)}{NARROW}m"
    if program.moves is not None and len(program.moves.time):
        words += _loss(program.moves)
    words.append(_binding(program))
    return " ".join(f"{w[0].upper()}{w[1:]}." for w in words if w)


def _loss(moves: ProgramMoves) -> list[str]:
    """How much of the cutting reaches the programmed feed, and what falling short costs."""
    known = moves.cutting & np.isfinite(moves.programmed) & np.isfinite(moves.reached)
    spent = float(moves.time[known].sum())
    if spent <= 0:
        return []
    at_feed = known & (moves.reached >= AT_FEED * moves.programmed)
    share = percent(float(moves.time[at_feed].sum()), spent)
    share = "nearly all" if share.startswith(">") else share
    words = [f"{share} of the cutting time is spent in blocks that reach the programmed feed"]
    lost = lost_seconds(moves)
    if lost is not None and lost >= 0.005 * spent:
        words.append(f"falling short of it costs {duration(lost)} ({percent(lost, spent)})")
    return words


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


def _binding(program: Program) -> str:
    """What costs most beside the programmed feed and rapids, and what that means."""
    costs = limit_seconds(program.document)
    least = WORTH_SAYING * sum(costs.values())
    bound = {k: v for k, v in costs.items() if k in REMEDIES and v >= least}
    if not bound:
        return ""
    worst = max(sorted(bound), key=lambda k: bound[k])
    share = percent(bound[worst], sum(costs.values()))
    return f"for {share} of its time {REMEDIES[worst]}"


def _legend(moves: ProgramMoves, classes: FeedClasses) -> list[tuple[str, str, str]]:
    used = set(classes.of(moves.reached[moves.cutting]).tolist())
    order = [i for i in range(len(classes)) if i in used] + [i for i in (UNKNOWN,) if i in used]
    legend = [(f"s-{classes.colour(i)}", classes.words(i), "box") for i in order]
    return [*legend, *([("l-rapid", "path of rapids", "line")] if moves.rapid.any() else [])]


def _made(found: Facts, program: Program, *, moves: bool) -> list[Source]:
    return sources(found.shelf, program.files[1 if moves else 0])


def _map(found: Facts, program: Program, classes: FeedClasses) -> Figure | None:
    moves = program.moves
    if moves is None or len(moves.time) == 0:
        return None
    words = (
        f"Path of {program.name}, {counted(len(moves.time), 'move')}, coloured by the feed that "
        "each block reaches; dots are moves along the tool’s axis"
    )
    return Figure(
        svg=map_figure(moves, classes, words),
        caption=f"{words}. Rapids may leave the frame, which holds what is cut.",
        sources=_made(found, program, moves=True),
    )


def _timeline(found: Facts, program: Program, classes: FeedClasses) -> Figure | None:
    shown = timeline(program.moves) if program.moves is not None and len(
        program.moves.time) else None  # fmt: skip
    if shown is None:
        return None
    words = (
        f"Feed over the time of {program.name}, {duration(shown.total)}: programmed against "
        "reached, while it cuts"
    )
    return Figure(
        svg=timeline_figure(shown, classes, words),
        caption=f"{words}; below, what the axes fall short by, and which tool is in the spindle.",
        sources=_made(found, program, moves=True),
    )


def _bars(found: Facts, program: Program, groups: list[Group], by: str) -> Figure | None:
    if not groups:
        return None
    total = program.seconds or sum(bar.seconds for bar in groups[0][1])
    words = f"Predicted time of {program.name} by {by}"
    return Figure(
        svg=bars_figure(groups, total, words),
        caption=f"{words}.",
        sources=_made(found, program, moves=False),
    )
