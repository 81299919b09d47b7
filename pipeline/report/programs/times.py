"""Time of a program: feed over time, and bars by tool, by type of block and by limit."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import counted, duration, percent
from pipeline.report.programs.moves import ProgramMoves
from pipeline.report.programs.panels import Classes, Panel, clock, tool_spans
from pipeline.schema.program_cut import SimulatedProgram, ToolTime

BINS = 240  # columns over the program's time
TOP, FEED, SHARE, STRIP, GAP = 18, 150, 64, 14, 28  # px: head, heights of the bands, between them
SEEN = 0.05  # share of a column's time that must be cutting for a feed to be drawn
DOING = ("s-cut", "s-rapid", "s-still")
"""CSS classes of cutting, rapids, and all else."""
ROW, HEAD, BETWEEN = 21, 24, 14  # px: a bar, the head above a group, between groups
FILL = 66.0  # percent of the width that the longest bar takes; its time stands beside it
MOST = 10  # bars in a group; the rest are one

LIMITS = {
    "feed": "programmed feed",
    "axis speed": "axis speed",
    "acceleration": "acceleration",
    "corner": "corners",
    "arc": "arcs",
    "tolerance": "path tolerance",
    "exact stop": "exact stops",
    "curve": "curves made of chords",
    "rapid": "rapid speed",
    "jerk": "jerk",
    "spindle": "spindle",
    "nothing": "nothing: it stands",
}
"""Limits of the speed of a block, in words."""

TYPE_KIND = {"rapid": "s-rapid", "feed": "s-cut", "arc": "s-cut"}
LIMIT_KIND = {"feed": "s-cut", "rapid": "s-rapid", "spindle": "s-still", "nothing": "s-still"}


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """Means over columns of equal time; NaN where nothing is cut."""

    total: float
    """Time of the program [s]."""
    programmed: np.ndarray
    reached: np.ndarray
    """Mean feed while cutting [mm/min]."""
    share: np.ndarray
    """Reached feed over programmed feed, 1 at most [1]."""
    doing: np.ndarray
    """Index into :data:`DOING` of what takes most of the column."""
    tools: list[tuple[int, float, float]]
    """Spans of one tool that a column can show, as shares of the time [1]."""


def timeline(moves: ProgramMoves) -> Timeline | None:
    """Timeline of a program; None when it takes no time."""
    end = np.concatenate([[0.0], np.cumsum(moves.time)])
    total = float(end[-1])
    if total <= 0:
        return None
    both = moves.cutting & np.isfinite(moves.programmed) & np.isfinite(moves.reached)
    edges = np.linspace(0.0, total, BINS + 1)

    def spent(weight: np.ndarray) -> np.ndarray:
        """Integral of a weight (M,) over the time of each column."""
        whole = np.concatenate([[0.0], np.cumsum(moves.time * np.where(weight > 0, weight, 0.0))])
        found: np.ndarray = np.diff(np.interp(edges, end, whole))
        return found

    known = spent(both.astype(float))
    cut = np.where(known > SEEN * total / BINS, known, np.nan)
    ratio = np.minimum(np.where(both, moves.reached / moves.programmed, 0.0), 1.0)
    cutting, rapid = spent(moves.cutting.astype(float)), spent(moves.rapid.astype(float))
    return Timeline(
        total=total,
        programmed=spent(np.where(both, moves.programmed, 0.0)) / cut,
        reached=spent(np.where(both, moves.reached, 0.0)) / cut,
        share=spent(ratio) / cut,
        doing=np.argmax([cutting, rapid, total / BINS - cutting - rapid], axis=0),
        tools=_tools(moves.tool, end / total),
    )


def _tools(tool: np.ndarray, at: np.ndarray) -> list[tuple[int, float, float]]:
    edges = np.concatenate([[0], np.flatnonzero(np.diff(tool)) + 1, [len(tool)]])
    return [
        (int(tool[a]), float(at[a]), float(at[b]))
        for a, b in pairwise(edges) if at[b] - at[a] > 1 / BINS
    ]  # fmt: skip


def timeline_figure(shown: Timeline, classes: Classes, label: str) -> Markup:
    """Three bands over the program's time: feed, how much of it is missing, what goes on."""
    share_top = TOP + FEED + GAP
    strip_top = share_top + SHARE + GAP
    bottom = strip_top + STRIP
    parts = [
        *clock(shown.total, TOP, bottom),
        *_feeds(shown, classes, TOP),
        *_shortfall(shown, share_top),
        *_strip(shown, strip_top),
    ]
    return svg.figure(parts, height=bottom + 36, label=label, kind="golden")


def _feeds(shown: Timeline, classes: Classes, top: float) -> list[Markup]:
    known = np.concatenate([shown.programmed, shown.reached])
    known = known[np.isfinite(known)]
    high = 1.04 * float(known.max()) if len(known) else 1.0
    panel = Panel(head="Feed, mm/min: programmed (line) and reached", top=top, height=FEED,
                  most=high)  # fmt: skip
    kind = classes.of(shown.reached)
    columns = [
        svg.tag("path", d=_columns(kind == index, 1 - shown.reached / high, None),
                class_=f"s-{classes.colour(index)}")
        for index in range(len(classes)) if (kind == index).any()
    ]  # fmt: skip
    level = svg.FULL * (1 - np.repeat(shown.programmed, 2) / high)
    line = svg.curve(10 * np.repeat(np.arange(BINS + 1), 2)[1:-1], level, "asked")
    return [*panel.frame(), panel.band([*columns, line], BINS)]


def _shortfall(shown: Timeline, top: float) -> list[Markup]:
    panel = Panel(head="Reached of the programmed feed, %", top=top, height=SHARE, most=100.0,
                  marks=(0, 50, 100))  # fmt: skip
    known = np.isfinite(shown.share)
    gap = svg.tag("path", d=_columns(known, np.zeros(BINS), 1 - shown.share), class_="s-lost")
    met = svg.tag("path", d=_columns(known, 1 - shown.share, None), class_="s-met")
    return [*panel.frame(), panel.band([met, gap], BINS)]


def _columns(where: np.ndarray, upper: np.ndarray, lower: np.ndarray | None) -> str:
    """Path data of columns from ``upper`` to ``lower`` (the bottom), as shares of the height."""
    high = np.rint(svg.FULL * np.nan_to_num(upper)).astype(int)
    low = np.full(BINS, svg.FULL) if lower is None else np.rint(
        svg.FULL * np.nan_to_num(lower)
    ).astype(int)  # fmt: skip
    drawn = np.flatnonzero(where & (low > high))
    return "".join(f"M{10 * i} {high[i]}h10v{low[i] - high[i]}h-10z" for i in drawn.tolist())


def _strip(shown: Timeline, top: float) -> list[Markup]:
    content = [
        svg.tag("path", d=_columns(shown.doing == i, np.zeros(BINS), None), class_=kind)
        for i, kind in enumerate(DOING) if (shown.doing == i).any()
    ]  # fmt: skip
    parts = [svg.band(top, STRIP, 10 * BINS, content)]
    return [*parts, *tool_spans(shown.tools, top + STRIP, top - 14, top - 5)]


@dataclass(frozen=True, kw_only=True)
class Bar:
    """Bar: its name, and parts of (seconds, CSS class)."""

    name: str
    parts: list[tuple[float, str]]

    @property
    def seconds(self) -> float:
        """Length of the whole bar [s]."""
        return sum(seconds for seconds, _ in self.parts)


Group = tuple[str, list[Bar]]
"""A head and the bars below it."""


def limit_seconds(program: SimulatedProgram) -> dict[str, float]:
    """Time [s] by what limits the speed of a block, only what takes any."""
    return _seconds(program.by_limit)


def _seconds(times: Mapping[str, float]) -> dict[str, float]:
    return {name.replace("_", " ").lower(): value for name, value in times.items() if value > 0}


def limit_bars(program: SimulatedProgram) -> list[Group]:
    """Time by what limits the speed of a block, the longest bar first."""
    bars = [
        Bar(name=limit_words(name), parts=[(seconds, LIMIT_KIND.get(name, "s-lost"))])
        for name, seconds in limit_seconds(program).items()
    ]
    return _present([("What bounds the speed", bars)])


def tool_and_type_bars(program: SimulatedProgram) -> list[Group]:
    """Time by tool and by type of block, the longest bar first."""
    tools = [_tool_bar(one) for one in program.by_tool]
    types = [
        Bar(name=name, parts=[(seconds, TYPE_KIND.get(name, "s-still"))])
        for name, seconds in _seconds(program.by_type).items()
    ]
    return _present([("By tool", tools), ("By type of block", types)])


def _present(groups: list[Group]) -> list[Group]:
    return [(head, _shortened(bars)) for head, bars in groups if any(b.seconds > 0 for b in bars)]


def limit_words(name: str) -> str:
    """Bound of the speed, in words; its own name when it is not listed here."""
    return LIMITS.get(name, name)


def _tool_bar(one: ToolTime) -> Bar:
    whole, cut, rapid = (max(0.0, x) for x in (one.time_s, one.cutting_s, one.rapid_s))
    return Bar(
        name=f"T{one.tool}" if one.tool >= 0 else "before a tool",
        parts=[(cut, "s-cut"), (rapid, "s-rapid"), (max(0.0, whole - cut - rapid), "s-still")],
    )


def _shortened(bars: list[Bar]) -> list[Bar]:
    found = sorted((b for b in bars if b.seconds > 0), key=lambda b: (-b.seconds, b.name))
    rest = found[MOST - 1 :]
    if len(rest) < 2:
        return found
    kinds = list(dict.fromkeys(kind for b in rest for _, kind in b.parts))
    sums = [(sum(s for b in rest for s, k in b.parts if k == kind), kind) for kind in kinds]
    return [*found[: MOST - 1], Bar(name=counted(len(rest), "other"), parts=sums)]


def bars_figure(groups: list[Group], total: float, label: str) -> Markup:
    """Groups of bars below one another, all to one scale; shares are of ``total`` [s]."""
    longest = max(bar.seconds for _, bars in groups for bar in bars)
    parts: list[Markup] = []
    y = 0.0
    for head, bars in groups:
        parts.append(svg.text(0, y + 14, head, "head"))
        y += HEAD
        for bar in bars:
            parts += _bar(bar, y, FILL / longest, total)
            y += ROW
        y += BETWEEN
    return svg.figure(parts, height=y - BETWEEN, label=label, kind="bars")


def _bar(bar: Bar, y: float, scale: float, total: float) -> list[Markup]:
    parts = [svg.text(0, y + 14, bar.name, "name end", dx=-8)]
    x = 0.0
    for seconds, kind in bar.parts:
        if seconds > 0:
            parts.append(svg.bar(x, seconds * scale, y + 3, ROW - 7, kind))
            x += seconds * scale
    words = f"{duration(bar.seconds)} · {percent(bar.seconds, total)}"
    return [*parts, svg.text(x, y + 14, words, "tick", dx=7)]
