"""The load on the tool over a program's time, against its limit."""

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.report.cut_panel import Panel, clock, tool_spans
from pipeline.report.cut_trace import CutTrace

TOP, HEIGHT = 42, 210  # px: tools and head, panel

LEGEND = [
    ("s-cut", "peak load in a revolution, from the lowest to the highest of each column", "box"),
    ("s-band", "below the lowest", "box"),
]
OVER = ("s-over", "above the limit", "box")


def load_figure(trace: CutTrace, limit: float | None, label: str) -> Markup:
    """Peak load, lowest to highest in each column; what is above ``limit`` [N] stands out."""
    high, low = trace.high["load_N"], trace.low["load_N"]
    known = high[np.isfinite(high)]
    top_value = max(float(known.max(initial=0.0)), limit or 0.0, 1e-6)
    panel = Panel(head="Load in the plane, N", top=TOP, height=HEIGHT, most=1.08 * top_value)
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
