"""The load on the tool along a program's way at feed, as programmed and optimised."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import asked, real
from pipeline.charts.sources import dig
from pipeline.charts.svg import anchor
from pipeline.report.cut_panel import NAMED, NAMES, Panel

TOP, HEIGHT, GAP = 42, 130, 34  # px: tools and head, a panel, between panels
MOST = 450  # columns; the highest load of each is drawn
FAR = 10_000.0  # mm from which a way is told in metres

LEGEND = [("s-before", "as programmed", "box"), ("s-after", "optimised", "box")]
OVER = ("s-over", "above the limit", "box")


@dataclass(frozen=True, kw_only=True)
class WayLoad:
    """Highest load of N columns of equal way [N], NaN in air; the line that each begins in."""

    total: float
    load: np.ndarray
    line: np.ndarray


def way_load(document: dict[str, Any], which: str) -> WayLoad | None:
    """The load ``which`` ("before" or "after") of a document; None where there is none to draw."""
    found = dig(document, "trace", which)
    way, load, line = (_column(dig(found, key)) for key in ("way_mm", "load_N", "line"))
    if len(load) == 0 or not len(way) == len(load) == len(line) or not np.isfinite(load).any():
        return None
    total = real(dig(found, "total_mm"))
    if total is None:
        total = float(np.nanmax(way)) if np.isfinite(way).any() else 0.0
    if total <= 0 or not np.isfinite(way).all():
        return None
    many = min(MOST, len(load))
    place = np.clip((way / total * many + 1e-9).astype(int), 0, many - 1)
    high = np.full(many, -np.inf)
    np.maximum.at(high, place, np.where(np.isnan(load), -np.inf, load))
    first = np.searchsorted(np.maximum.accumulate(place), np.arange(many))
    line = line[np.minimum(first, len(line) - 1)]
    return WayLoad(total=total, load=np.where(high > -np.inf, high, np.nan), line=line)


def _column(values: Any) -> np.ndarray:
    known = values if isinstance(values, list) else []
    return np.array([np.nan if real(v) is None else float(v) for v in known], dtype=np.float64)


def load_figure(
    before: WayLoad, after: WayLoad, limit: float | None, tools: list[tuple[int, float, float]],
    label: str,
) -> Markup:  # fmt: skip
    """Two panels on one scale; what lies above ``limit`` [N] stands out."""
    most = 1.1 * max(float(np.nanmax(before.load)), float(np.nanmax(after.load)), limit or 1e-6)
    upper = Panel(head="Load as programmed, N", top=TOP, height=HEIGHT, most=most)
    lower = Panel(head="Load optimised, N", top=upper.bottom + GAP, height=HEIGHT, most=most)
    parts = [*_way(after, upper.top, lower.bottom), *_tools(tools, lower.bottom)]
    for panel, trace, kind in ((upper, before, "s-before"), (lower, after, "s-after")):
        parts += [*panel.frame(), _columns(panel, trace, limit, kind)]
        if limit is not None:
            parts.append(svg.across(panel.y(limit), "limit"))
            parts.append(svg.text(100, panel.top - 7, f"limit {asked(limit)} N", "name end"))
    return svg.figure(parts, height=lower.bottom + 54, label=label, kind="golden")


def _columns(panel: Panel, trace: WayLoad, limit: float | None, kind: str) -> Markup:
    low = np.zeros(len(trace.load))
    drawn = [panel.columns(low, trace.load, kind)]
    if limit is not None:
        over = np.where(trace.load > limit, trace.load, np.nan)
        drawn.append(panel.columns(np.full(len(low), limit), over, "s-over"))
    return panel.band(drawn, len(low))


def _way(trace: WayLoad, top: float, bottom: float) -> list[Markup]:
    """Way along the bottom, and below it the lines of the program."""
    far = trace.total >= FAR
    unit, name = (1e3, "m") if far else (1.0, "mm")
    parts = [
        svg.text(
            50, bottom + 48, f"Way at feed, {name}; below it the line of the program", "tick mid"
        )
    ]
    for mark in svg.ticks(0.0, trace.total / unit, most=4):
        x = 100 * mark * unit / trace.total
        line = trace.line[min(int(x / 100 * len(trace.line)), len(trace.line) - 1)]
        parts.append(svg.down(x, top, bottom))
        parts.append(svg.text(x, bottom + 16, f"{round(mark, 6) + 0.0:g}", anchor(x)))
        if np.isfinite(line):
            parts.append(svg.text(x, bottom + 31, f"{line:.0f}", anchor(x)))
    return parts


def _tools(tools: list[tuple[int, float, float]], bottom: float) -> list[Markup]:
    parts = []
    for tool, start, end in tools:
        parts.append(svg.down(100 * start, NAMES + 3, bottom, "grid change"))
        if end - start > NAMED:
            parts.append(svg.text(50 * (start + end), NAMES, f"T{tool}", "tick mid"))
    return parts


def tool_spans(document: dict[str, Any]) -> list[tuple[int, float, float]]:
    """Tools with where they begin and end, as shares of the way."""
    found = dig(document, "trace", "tools")
    spans = [s for s in found if isinstance(s, list)] if isinstance(found, list) else []
    return [
        (int(s[0]), float(s[1]), float(s[2])) for s in spans
        if len(s) == 3 and None not in map(real, s)
    ]  # fmt: skip
