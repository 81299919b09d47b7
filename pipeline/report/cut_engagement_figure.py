"""How much of the tool is in the material over a program's time: depths, and angles in the cut."""

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.report.cut_panel import Panel, clock, tool_spans
from pipeline.report.cut_trace import CutTrace

TOP, HEIGHT, GAP = 42, 88, 30  # px

LEGEND = [
    ("s-cut", "from the lowest to the highest of each column", "box"),
    ("s-rapid", "from entry to exit", "box"),
]


def engagement_figure(trace: CutTrace, label: str) -> Markup:
    """Axial depth, radial depth, and the arc from entry to exit."""
    top: float = TOP
    parts: list[Markup] = []
    first = top
    for name, head in (
        ("axial_depth_mm", "Axial depth, mm"),
        ("radial_depth_mm", "Radial depth, mm"),
    ):
        panel = _panel(trace.high[name], head, top)
        columns = panel.columns(trace.low[name], trace.high[name], "s-cut")
        parts += [*panel.frame(), panel.band([columns], len(trace))]
        top = panel.bottom + GAP
    angles = Panel(
        head="Engaged arc, °",
        top=top, height=HEIGHT, most=360.0 if np.nanmax(trace.exit) > 180.5 else 180.0,
        marks=(0, 90, 180, 270, 360) if np.nanmax(trace.exit) > 180.5 else (0, 45, 90, 135, 180),
    )  # fmt: skip
    arc = angles.columns(trace.entry, trace.exit, "s-rapid")
    parts += [*angles.frame(), angles.band([arc], len(trace))]
    behind = [*clock(trace.total, first, angles.bottom), *tool_spans(trace, angles.bottom)]
    return svg.figure([*behind, *parts], height=angles.bottom + 36, label=label, kind="golden")


def _panel(high: np.ndarray, head: str, top: float) -> Panel:
    most = float(high[np.isfinite(high)].max(initial=0.0))
    return Panel(head=head, top=top, height=HEIGHT, most=1.08 * max(most, 1e-3))
