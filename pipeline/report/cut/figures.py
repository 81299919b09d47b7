"""Figures of a cut: load and engagement over time, blocks against stability lobes and drive."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.svg import anchor
from pipeline.schema.arrays import Floats
from pipeline.schema.program_cut import Curve, DriveCurve, EngagementTrace, Lobes

WIDE = 10  # units of a column
NAMES = 11  # px: where the tools' names stand
NAMED = 0.035  # share of the program's time above which a tool's span is named
STEPS = ((120, 1), (7200, 60), (1e300, 3600))
"""Up to how many seconds the clock counts in seconds, minutes, hours."""
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


def values_of(curve: Curve) -> Floats:
    """A stored curve as an array; NaN where it has no value."""
    return np.array(curve, dtype=np.float64)


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


def tool_spans(trace: EngagementTrace, bottom: float) -> list[Markup]:
    """Where each tool begins, and its name above all heads where its span is wide enough."""
    parts = []
    for tool, start, end in trace.tools:
        parts.append(svg.down(100 * start, NAMES + 3, bottom, "grid change"))
        if end - start > NAMED and tool >= 0:
            parts.append(svg.text(50 * (start + end), NAMES, f"T{tool}", "tick mid"))
    return parts


def load_figure(trace: EngagementTrace, limit: float | None, label: str) -> Markup:
    """Peak load, lowest to highest in each column; what is above ``limit`` [N] stands out."""
    high, low = values_of(trace.load_N_high), values_of(trace.load_N_low)
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
        *clock(trace.total_s, panel.top, panel.bottom),
        *panel.frame(),
        panel.band(drawn, len(high)),
        *tool_spans(trace, panel.bottom),
    ]
    if limit is not None:
        parts.append(svg.across(panel.y(limit), "limit"))
        words = f"limit {number(limit)} N"
        parts.append(svg.text(100, panel.y(limit) - 5, words, "name end"))
    return svg.figure(parts, height=panel.bottom + 36, label=label, kind="golden")


def engagement_figure(trace: EngagementTrace, label: str) -> Markup:
    """Axial depth, radial depth, and the arc from entry to exit."""
    top: float = TOP
    parts: list[Markup] = []
    first = top
    for head, *ends in (
        ("Axial depth, mm", trace.axial_depth_mm_low, trace.axial_depth_mm_high),
        ("Radial depth, mm", trace.radial_depth_mm_low, trace.radial_depth_mm_high),
    ):
        low, high = (values_of(end) for end in ends)
        most = float(high[np.isfinite(high)].max(initial=0.0))
        panel = Panel(head=head, top=top, height=DEPTH_HEIGHT, most=1.08 * max(most, 1e-3))
        parts += [*panel.frame(), panel.band([panel.columns(low, high, "s-cut")], len(high))]
        top = panel.bottom + DEPTH_GAP
    entry, leave = values_of(trace.entry_deg), values_of(trace.exit_deg)
    whole = np.nanmax(leave) > 180.5
    angles = Panel(
        head="Engaged arc, °", top=top, height=DEPTH_HEIGHT, most=360.0 if whole else 180.0,
        marks=(0, 90, 180, 270, 360) if whole else (0, 45, 90, 135, 180),
    )  # fmt: skip
    arc = angles.columns(entry, leave, "s-rapid")
    parts += [*angles.frame(), angles.band([arc], len(entry))]
    behind = [*clock(trace.total_s, first, angles.bottom), *tool_spans(trace, angles.bottom)]
    return svg.figure([*behind, *parts], height=angles.bottom + 36, label=label, kind="golden")


def lobes_figure(lobes: Lobes, label: str) -> Markup | None:
    """Limit of the axial depth over speed, with the blocks that have this engagement."""
    speeds, limit = values_of(lobes.speeds_rpm), values_of(lobes.depth_limit_mm)
    if len(speeds) < 2:
        return None
    points = [
        (p.speed_rpm, p.axial_depth_mm, (p.margin or 0) < 0) for p in lobes.points[:MOST_POINTS]
    ]
    deepest = max((depth for _, depth, _ in points), default=0.0)
    lowest = float(limit[np.isfinite(limit)].min(initial=np.inf))
    most = max(1.3 * deepest, 2.5 * lowest if np.isfinite(lowest) else 0.0, 1e-3)
    panel = Panel(head="Axial depth, mm", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(
        panel, speeds, np.where(np.isnan(limit), most, limit), points, label, above=True
    )


def drive_figure(drive: DriveCurve, label: str) -> Markup | None:
    """Cutting power of blocks against what the drive can give at their speed."""
    speeds, power = values_of(drive.speeds_rpm), values_of(drive.power_kW)
    if not np.isfinite(power).any():
        return None
    points = [
        (p.speed_rpm, p.power_kW, (p.drive_share or 0) > 1) for p in drive.points[:MOST_POINTS]
    ]
    found = [p for _, p, _ in points if p is not None]
    most = 1.15 * max([float(np.nanmax(power)), *found])
    panel = Panel(head="Cutting power, kW", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(panel, speeds, power, points, label, above=False)


def _points_figure(
    panel: Panel, speeds: np.ndarray, level: np.ndarray,
    points: Sequence[tuple[float | None, float | None, bool]], label: str, *, above: bool,
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
