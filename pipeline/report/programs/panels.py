"""Panels over a program's time or path; its feed over time, and bars by cause and tool."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import counted, duration, number, percent
from pipeline.charts.svg import anchor
from pipeline.report.programs.moves import Classes, ProgramMoves
from pipeline.schema.program_cut import SimulatedProgram, ToolTime

WIDE = 10
"""Units of a column."""
NAMES_AT = 11
"""Height at which the tools' names stand [px]."""
NAMED = 0.035
"""Share of the program above which a tool's span is named [1]."""
CLOCK = ((120, 1), (7200, 60), (1e300, 3600))
"""Clock formats: greatest time [s] of seconds, minutes, hours."""
Spans = Sequence[tuple[int, float, float]]
"""Tool, beginning and end as shares of the program [1]."""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Panel: its head, its place [px], the value at its top and its ticks."""

    head: str
    top: float
    height: float
    most: float
    marks: tuple[float, ...] = ()

    @property
    def bottom(self) -> float:
        """Lower edge [px]."""
        return self.top + self.height

    def y(self, value: float) -> float:
        """Height of a value [px]."""
        return self.top + self.height * (1 - value / self.most)

    def frame(self) -> list[Markup]:
        """Head, grid and numbers."""
        parts = [svg.text(0, self.top - 7, self.head, "head")]
        for mark in self.marks or svg.ticks(0.0, self.most, most=4):
            words = number(round(mark)) if mark >= 1e4 else f"{round(mark, 6) + 0.0:g}"
            parts += [
                svg.across(self.y(mark)),
                svg.text(0, self.y(mark) + 4, words, "tick end", dx=-6),
            ]
        return parts

    def columns(self, low: np.ndarray, high: np.ndarray, kind: str) -> Markup:
        """Columns from ``low`` to ``high`` (N,), at least a line thick; NaN draws nothing."""
        upper = np.rint(svg.FULL * (1 - np.minimum(high / self.most, 1.0)))
        lower = np.rint(svg.FULL * (1 - np.maximum(low / self.most, 0.0)))
        thick = np.ceil(svg.FULL / self.height)
        upper = np.minimum(upper, lower - thick)
        data = "".join(
            f"M{WIDE * i} {int(upper[i])}h{WIDE}v{int(lower[i] - upper[i])}h-{WIDE}z"
            for i in np.flatnonzero(np.isfinite(upper) & np.isfinite(lower)).tolist()
        )
        return svg.tag("path", d=data, class_=kind)

    def band(self, content: list[Markup], columns: int) -> Markup:
        """The viewport that ``columns`` are drawn in."""
        return svg.band(self.top, self.height, WIDE * columns, content)


def clock(total: float, top: float, bottom: float) -> list[Markup]:
    """Time along the bottom, with lines up to ``top``."""
    unit = next(size for most, size in CLOCK if total < most)
    words = {1: "Time, s", 60: "Time, min", 3600: "Time, h"}[unit]
    parts = [svg.text(50, bottom + 31, words, "tick mid")]
    for mark in svg.ticks(0.0, total / unit, most=6):
        x = 100 * mark * unit / total
        parts.append(svg.down(x, top, bottom))
        parts.append(svg.text(x, bottom + 16, f"{round(mark, 6) + 0.0:g}", anchor(x)))
    return parts


def tool_spans(
    tools: Spans, bottom: float, top: float = NAMES_AT + 3, names: float = NAMES_AT
) -> list[Markup]:
    """Begin of each tool, and its name where its span is wide enough."""
    parts = []
    for tool, start, end in tools:
        parts.append(svg.down(100 * start, top, bottom, "grid change"))
        if end - start > NAMED and tool >= 0:
            parts.append(svg.text(50 * (start + end), names, f"T{tool}", "tick mid"))
    return parts


BINS = 240  # columns over the program's time
TOP, FEED, STRIP, GAP = 18, 150, 14, 28  # px: head, heights of the bands, between them
SEEN = 0.05  # share of a column's time that must be cutting for a feed to be drawn
DOING = ("s-cut", "s-rapid", "s-still")
"""CSS classes of cutting, rapids, and all else."""
ROW, HEAD, BETWEEN = 21, 24, 14  # px: a bar, the head above a group, between groups
FILL = 66.0  # percent of the width that the longest bar takes; its time stands beside it
MOST = 10  # bars in a group; the rest are one
MOST_CAUSES = 15  # of the causes each has its bar

CAUSES = {
    "feed": "at programmed feed",
    "axis speed": "axis speed",
    "acceleration": "acceleration",
    "corner": "corners",
    "arc": "arcs",
    "tolerance": "path tolerance",
    "exact stop": "stops between blocks",
    "curve": "curves of chords",
    "rapid": "rapids",
    "spindle": "spindle waits",
    "tool change": "tool changes",
    "dwell": "dwell",
    "program stop": "program stops",
    "M code": "M codes",
}
"""Causes of time, in words."""

STANDING = ("spindle", "tool change", "dwell", "program stop", "M code")
"""Causes of time at which the axes stand anyway."""


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """Means over columns of equal time; NaN where nothing is cut."""

    total: float
    """Time of the program [s]."""
    programmed: np.ndarray
    reached: np.ndarray
    """Mean feed while cutting [mm/min]."""
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
        return np.diff(np.interp(edges, end, whole))

    known = spent(both.astype(float))
    cut = np.where(known > SEEN * total / BINS, known, np.nan)
    cutting, rapid = spent(moves.cutting.astype(float)), spent(moves.rapid.astype(float))
    return Timeline(
        total=total,
        programmed=spent(np.where(both, moves.programmed, 0.0)) / cut,
        reached=spent(np.where(both, moves.reached, 0.0)) / cut,
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
    """Two bands over the program's time: feed, programmed and reached, and what goes on."""
    strip_top = TOP + FEED + GAP
    bottom = strip_top + STRIP
    parts = [
        *clock(shown.total, TOP, bottom),
        *_feeds(shown, classes, TOP),
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
        panel.columns(np.zeros(BINS), np.where(kind == index, shown.reached, np.nan),
                      f"s-{classes.colour(index)}")
        for index in range(len(classes)) if (kind == index).any()
    ]  # fmt: skip
    level = svg.FULL * (1 - np.repeat(shown.programmed, 2) / high)
    line = svg.curve(WIDE * np.repeat(np.arange(BINS + 1), 2)[1:-1], level, "asked")
    return [*panel.frame(), panel.band([*columns, line], BINS)]


def _strip(shown: Timeline, top: float) -> list[Markup]:
    panel = Panel(head="", top=top, height=STRIP, most=1.0)
    content = [
        panel.columns(np.zeros(BINS), np.where(shown.doing == i, 1.0, np.nan), kind)
        for i, kind in enumerate(DOING) if (shown.doing == i).any()
    ]  # fmt: skip
    return [panel.band(content, BINS), *tool_spans(shown.tools, top + STRIP, top - 14, top - 5)]


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


def cause_bars(program: SimulatedProgram) -> list[Group]:
    """Time by what costs it, the longest bar first."""
    kinds = {"feed": "s-cut", "rapid": "s-rapid"} | dict.fromkeys(STANDING, "s-still")
    bars = [
        Bar(name=cause_words(name), parts=[(seconds, kinds.get(name, "s-lost"))])
        for name, seconds in program.by_cause.items()
    ]
    return _present([("What costs time", bars)], MOST_CAUSES)


def tool_bars(program: SimulatedProgram) -> list[Group]:
    """Time by tool, the longest bar first."""
    return _present([("By tool", [_tool_bar(one) for one in program.by_tool])])


def _present(groups: list[Group], most: int = MOST) -> list[Group]:
    shown = [(head, bars) for head, bars in groups if any(b.seconds > 0 for b in bars)]
    return [(head, _shortened(bars, most)) for head, bars in shown]


def cause_words(name: str) -> str:
    """Cause of time, in words; its own name when it is not listed here."""
    return CAUSES.get(name, name)


def _tool_bar(one: ToolTime) -> Bar:
    whole, cut, rapid = (max(0.0, x) for x in (one.time_s, one.cutting_s, one.rapid_s))
    return Bar(
        name=f"T{one.tool}" if one.tool >= 0 else "before a tool",
        parts=[(cut, "s-cut"), (rapid, "s-rapid"), (max(0.0, whole - cut - rapid), "s-still")],
    )


def _shortened(bars: list[Bar], most: int) -> list[Bar]:
    found = sorted((b for b in bars if b.seconds > 0), key=lambda b: (-b.seconds, b.name))
    rest = found[most - 1 :]
    if len(rest) < 2:
        return found
    kinds = list(dict.fromkeys(kind for b in rest for _, kind in b.parts))
    sums = [(sum(s for b in rest for s, k in b.parts if k == kind), kind) for kind in kinds]
    return [*found[: most - 1], Bar(name=counted(len(rest), "other"), parts=sums)]


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
