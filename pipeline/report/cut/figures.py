"""Figures of a cut: load and engagement over time, blocks against stability lobes and drive."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number, real
from pipeline.charts.svg import anchor
from pipeline.report.cut.tables import entry, rows_of
from pipeline.schema.arrays import Floats

WIDE = 10  # units of a column
NAMES = 11  # px: where the tools' names stand
NAMED = 0.035  # share of the program's time above which a tool's span is named
STEPS = ((120, 1), (7200, 60), (1e300, 3600))
"""Up to how many seconds the clock counts in seconds, minutes, hours."""
BANDS = ("load_N", "axial_depth_mm", "radial_depth_mm")
"""Quantities of which a column holds the lowest and the highest value."""
TOP = 42  # px: tools and head above the first panel
LOAD_HEIGHT = 210  # px
DEPTH_HEIGHT, DEPTH_GAP = 88, 30  # px
POINT_TOP, POINT_HEIGHT = 22, 220  # px
LOAD_LEGEND = [
    ("s-cut", "peak load in a revolution, from the lowest to the highest of each column", "box"),
    ("s-band", "below the lowest", "box"),
]
OVER_LEGEND = ("s-over", "above the limit", "box")
ENGAGEMENT_LEGEND = [
    ("s-cut", "from the lowest to the highest of each column", "box"),
    ("s-rapid", "from entry to exit", "box"),
]
UNITS = 1000  # across a curve's viewport
MOST_POINTS = 400  # drawn; the nearest to their limit

LOBES_LEGEND = [
    ("s-unstable", "chatters", "box"),
    ("p-positive", "block, stable", "dot"),
    ("p-failed", "block, chatters", "dot"),
]
DRIVE_LEGEND = [
    ("l-measured", "what the drive can give", "line"),
    ("p-positive", "block", "dot"),
    ("p-failed", "block, above it", "dot"),
]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One panel: its head, where it lies [px], the value at its top and its ticks."""

    head: str
    top: float
    height: float
    most: float
    marks: tuple[float, ...] = ()

    @property
    def bottom(self) -> float:
        """[px]."""
        return self.top + self.height

    def y(self, value: float) -> float:
        """Of a value [px]."""
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


@dataclass(frozen=True, kw_only=True)
class CutTrace:
    """N columns of equal time; NaN where nothing is cut.

    Parameters
    ----------
    total : float
        Time of the program [s].
    low, high : dict of str to array (N,)
        Lowest and highest value in each column, by the names of :data:`BANDS`.
    entry, exit : array (N,)
        Least angle of entry and greatest of exit [deg].
    tools : list of (number, start, end)
        Spans of one tool as shares of the time [1].
    """

    total: float
    low: dict[str, Floats]
    high: dict[str, Floats]
    entry: Floats
    exit: Floats
    tools: list[tuple[int, float, float]]

    def __len__(self) -> int:
        return len(self.entry)

    @property
    def cut(self) -> Floats:
        """Which columns cut; shape (N,)."""
        found: Floats = np.isfinite(self.entry)
        return found


def cut_trace(document: dict[str, Any]) -> CutTrace | None:
    """The trace of a document of ``kerf simulate``; None when it has none that can be drawn."""
    found = entry(document, "cut", "trace")
    total = real(entry(found, "total_s"))
    enter = _column(entry(found, "entry_deg"))
    if total is None or total <= 0 or not np.isfinite(enter).any():
        return None
    low = {name: _column(entry(found, f"{name}_low")) for name in BANDS}
    high = {name: _column(entry(found, f"{name}_high")) for name in BANDS}
    leave = _column(entry(found, "exit_deg"))
    if any(len(c) != len(enter) for c in (*low.values(), *high.values(), leave)):
        return None
    return CutTrace(
        total=total,
        low=low,
        high=high,
        entry=enter,
        exit=leave,
        tools=_tools(entry(found, "tools")),
    )


def _column(values: Any) -> Floats:
    known = values if isinstance(values, list) else []
    return np.array([np.nan if real(v) is None else float(v) for v in known])


def _tools(spans: Any) -> list[tuple[int, float, float]]:
    known = spans if isinstance(spans, list) else []
    return [
        (int(number), float(start), float(end))
        for number, start, end in (s for s in known if isinstance(s, list) and len(s) == 3)
        if None not in (real(number), real(start), real(end))
    ]


def clock(total: float, top: float, bottom: float) -> list[Markup]:
    """Time along the bottom, with lines up to ``top``."""
    unit = next(size for most, size in STEPS if total < most)
    words = {1: "Time, s", 60: "Time, min", 3600: "Time, h"}[unit]
    parts = [svg.text(50, bottom + 31, words, "tick mid")]
    for mark in svg.ticks(0.0, total / unit, most=6):
        x = 100 * mark * unit / total
        parts.append(svg.down(x, top, bottom))
        parts.append(svg.text(x, bottom + 16, f"{round(mark, 6) + 0.0:g}", anchor(x)))
    return parts


def tool_spans(trace: CutTrace, bottom: float) -> list[Markup]:
    """Where each tool begins, and its name above all heads where its span is wide enough."""
    parts = []
    for tool, start, end in trace.tools:
        parts.append(svg.down(100 * start, NAMES + 3, bottom, "grid change"))
        if end - start > NAMED and tool >= 0:
            parts.append(svg.text(50 * (start + end), NAMES, f"T{tool}", "tick mid"))
    return parts


def load_figure(trace: CutTrace, limit: float | None, label: str) -> Markup:
    """Peak load, lowest to highest in each column; what is above ``limit`` [N] stands out."""
    high, low = trace.high["load_N"], trace.low["load_N"]
    known = high[np.isfinite(high)]
    top_value = max(float(known.max(initial=0.0)), limit or 0.0, 1e-6)
    panel = Panel(head="Load in the plane, N", top=TOP, height=LOAD_HEIGHT, most=1.08 * top_value)
    drawn = [
        panel.columns(np.zeros(len(low)), np.where(low > 0, low, np.nan), "s-band"),
        panel.columns(low, high, "s-cut"),
    ]
    if limit is not None:
        over = np.where(high > limit, high, np.nan)
        drawn.append(panel.columns(np.maximum(low, limit), over, "s-over"))
    parts = [
        *clock(trace.total, panel.top, panel.bottom),
        *panel.frame(),
        panel.band(drawn, len(trace)),
        *tool_spans(trace, panel.bottom),
    ]
    if limit is not None:
        parts.append(svg.across(panel.y(limit), "limit"))
        words = f"limit {number(limit)} N"
        parts.append(svg.text(100, panel.y(limit) - 5, words, "name end"))
    return svg.figure(parts, height=panel.bottom + 36, label=label, kind="golden")


def engagement_figure(trace: CutTrace, label: str) -> Markup:
    """Axial depth, radial depth, and the arc from entry to exit."""
    top: float = TOP
    parts: list[Markup] = []
    first = top
    for name, head in (
        ("axial_depth_mm", "Axial depth, mm"),
        ("radial_depth_mm", "Radial depth, mm"),
    ):
        panel = _depth_panel(trace.high[name], head, top)
        columns = panel.columns(trace.low[name], trace.high[name], "s-cut")
        parts += [*panel.frame(), panel.band([columns], len(trace))]
        top = panel.bottom + DEPTH_GAP
    angles = Panel(
        head="Engaged arc, °",
        top=top, height=DEPTH_HEIGHT, most=360.0 if np.nanmax(trace.exit) > 180.5 else 180.0,
        marks=(0, 90, 180, 270, 360) if np.nanmax(trace.exit) > 180.5 else (0, 45, 90, 135, 180),
    )  # fmt: skip
    arc = angles.columns(trace.entry, trace.exit, "s-rapid")
    parts += [*angles.frame(), angles.band([arc], len(trace))]
    behind = [*clock(trace.total, first, angles.bottom), *tool_spans(trace, angles.bottom)]
    return svg.figure([*behind, *parts], height=angles.bottom + 36, label=label, kind="golden")


def _depth_panel(high: np.ndarray, head: str, top: float) -> Panel:
    most = float(high[np.isfinite(high)].max(initial=0.0))
    return Panel(head=head, top=top, height=DEPTH_HEIGHT, most=1.08 * max(most, 1e-3))


def lobes_figure(lobes: dict[str, Any], label: str) -> Markup | None:
    """Limit of the axial depth over speed, with the blocks that have this engagement."""
    speeds, limit = _column(entry(lobes, "speeds_rpm")), _column(entry(lobes, "depth_limit_mm"))
    if len(speeds) < 2 or len(speeds) != len(limit) or not np.isfinite(speeds).all():
        return None
    rows = rows_of(lobes, "points")[:MOST_POINTS]
    points = [
        (real(r.get("speed_rpm")), real(r.get("axial_depth_mm")), (real(r.get("margin")) or 0) < 0)
        for r in rows
    ]
    depths = [d for _, d, _ in points if d is not None]
    finite = limit[np.isfinite(limit)]
    lowest = float(finite.min(initial=np.inf))
    most = max([1.3 * max(depths, default=0.0), 2.5 * lowest if np.isfinite(lowest) else 0.0, 1e-3])
    panel = Panel(head="Axial depth, mm", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(
        panel, speeds, np.where(np.isnan(limit), most, limit), points, label, above=True
    )


def drive_figure(drive: dict[str, Any], rows: list[dict[str, Any]], label: str) -> Markup | None:
    """Cutting power of blocks against what the drive can give at their speed."""
    speeds, power = _column(entry(drive, "speeds_rpm")), _column(entry(drive, "power_kW"))
    if len(speeds) < 2 or len(speeds) != len(power) or not np.isfinite(power).any():
        return None
    points = [
        (real(r.get("speed_rpm")), real(r.get("power_kW")), (real(r.get("drive_share")) or 0) > 1)
        for r in rows[:MOST_POINTS]
    ]
    found = [p for _, p, _ in points if p is not None]
    most = 1.15 * max([float(np.nanmax(power)), *found])
    panel = Panel(head="Cutting power, kW", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(panel, speeds, power, points, label, above=False)


def _points_figure(
    panel: Panel, speeds: np.ndarray, level: np.ndarray,
    points: list[tuple[float | None, float | None, bool]], label: str, *, above: bool,
) -> Markup:  # fmt: skip
    """A curve over speed with points; what lies ``above`` it is shaded."""
    low, high = float(speeds[0]), float(speeds[-1])
    x = UNITS * (speeds - low) / (high - low)
    y = svg.FULL * (1 - np.minimum(level / panel.most, 1.0))
    drawn = []
    if above:
        line = svg.path_data(x, y)
        drawn.append(svg.tag("path", d=f"{line}V0H{round(float(x[0]))}z", class_="s-unstable"))
    drawn.append(svg.curve(x, y, "measured"))
    parts = panel.frame()
    for mark in svg.ticks(low, high, most=6):
        at = 100 * (mark - low) / (high - low)
        parts.append(svg.down(at, panel.top, panel.bottom))
        parts.append(svg.text(at, panel.bottom + 16, number(round(mark)), anchor(at)))
    parts.append(svg.text(50, panel.bottom + 31, "Speed of the spindle, rev/min", "tick mid"))
    parts.append(svg.band(panel.top, panel.height, UNITS, drawn))
    for speed, value, bad in sorted(points, key=lambda p: p[2]):
        if speed is None or value is None or not low <= speed <= high:
            continue
        place = f"{100 * (speed - low) / (high - low):.2f}%"
        kind = "point p-failed" if bad else "point p-positive"
        parts.append(svg.tag("circle", cx=place, cy=panel.y(value), r=4.5, class_=kind))
    return svg.figure(parts, height=panel.bottom + 36, label=label, kind="golden")
