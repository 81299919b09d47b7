"""Figures of a cut: load and engagement over time, blocks against stability lobes and drive."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.svg import anchor
from pipeline.report.programs.panels import Panel, clock, tool_spans
from pipeline.schema.arrays import Floats
from pipeline.schema.program_cut import Curve, DriveCurve, EngagementTrace, Lobes

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


def values_of(curve: Curve) -> Floats:
    """A stored curve as an array; NaN where it has no value."""
    return np.array(curve, dtype=np.float64)


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
        *tool_spans(trace.tools, panel.bottom),
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
    behind = [*clock(trace.total_s, first, angles.bottom), *tool_spans(trace.tools, angles.bottom)]
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
