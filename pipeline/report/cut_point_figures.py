"""Blocks of a cut as points over the spindle's speed: against stability lobes, and the drive."""

from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number, real
from pipeline.charts.sources import dig, rows_of
from pipeline.charts.svg import anchor
from pipeline.report.cut_panel import Panel

TOP, HEIGHT = 22, 220  # px
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


def lobes_figure(lobes: dict[str, Any], label: str) -> Markup | None:
    """Limit of the axial depth over speed, with the blocks that have this engagement."""
    speeds, limit = _numbers(lobes, "speeds_rpm"), _numbers(lobes, "depth_limit_mm")
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
    panel = Panel(head="Axial depth, mm", top=TOP, height=HEIGHT, most=most)
    return _figure(panel, speeds, np.where(np.isnan(limit), most, limit), points, label, above=True)


def drive_figure(drive: dict[str, Any], rows: list[dict[str, Any]], label: str) -> Markup | None:
    """Cutting power of blocks against what the drive can give at their speed."""
    speeds, power = _numbers(drive, "speeds_rpm"), _numbers(drive, "power_kW")
    if len(speeds) < 2 or len(speeds) != len(power) or not np.isfinite(power).any():
        return None
    points = [
        (real(r.get("speed_rpm")), real(r.get("power_kW")), (real(r.get("drive_share")) or 0) > 1)
        for r in rows[:MOST_POINTS]
    ]
    found = [p for _, p, _ in points if p is not None]
    most = 1.15 * max([float(np.nanmax(power)), *found])
    panel = Panel(head="Cutting power, kW", top=TOP, height=HEIGHT, most=most)
    return _figure(panel, speeds, power, points, label, above=False)


def _numbers(found: dict[str, Any], name: str) -> np.ndarray:
    values = dig(found, name)
    known = values if isinstance(values, list) else []
    return np.array([np.nan if real(v) is None else float(v) for v in known])


def _figure(
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
