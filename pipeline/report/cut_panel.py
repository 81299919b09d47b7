"""Panels over a program's time: columns of lowest and highest values against a scale."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.svg import anchor
from pipeline.report.cut_trace import CutTrace

WIDE = 10  # units of a column
NAMES = 11  # px: where the tools' names stand
NAMED = 0.035  # share of the program's time above which a tool's span is named
STEPS = ((120, 1), (7200, 60), (1e300, 3600))
"""Up to how many seconds the clock counts in seconds, minutes, hours."""


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
    """Where each tool begins, and its name above all heads where there is room."""
    parts = []
    for tool, start, end in trace.tools:
        parts.append(svg.down(100 * start, NAMES + 3, bottom, "grid change"))
        if end - start > NAMED and tool >= 0:
            parts.append(svg.text(50 * (start + end), NAMES, f"T{tool}", "tick mid"))
    return parts
