"""Panels over a program's time or path: frame, columns, clock, tools; classes of colour."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.svg import anchor
from pipeline.schema.arrays import Floats

WIDE = 10
"""Units of a column."""
NAMES_AT = 11
"""Height at which the tools' names stand [px]."""
NAMED = 0.035
"""Share of the program above which a tool's span is named [1]."""
CLOCK = ((120, 1), (7200, 60), (1e300, 3600))
"""Clock formats: greatest time [s] of seconds, minutes, hours."""
COLOURS = 6
"""Colours of the scale in style.css, f0 to f5."""
UNKNOWN = -1
"""Class of a missing value."""
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


@dataclass(frozen=True, kw_only=True)
class Classes:
    """Classes of a quantity between ``bounds``, ascending, each with a colour and its words."""

    bounds: tuple[float, ...]
    unit: str = "mm/min"
    alike: str = "at one feed"
    """Words of the only class there is."""
    unknown: str = "feed not known"

    def __len__(self) -> int:
        return len(self.bounds) + 1

    def of(self, values: Floats) -> np.ndarray:
        """Class of each value; :data:`UNKNOWN` where it is missing."""
        found = np.searchsorted(np.array(self.bounds), values, side="right")
        return np.where(np.isfinite(values), found, UNKNOWN)

    def colour(self, index: int) -> str:
        """CSS name of a class's colour; few classes lie as far apart as many."""
        if index == UNKNOWN:
            return "f-none"
        return f"f{round(index * (COLOURS - 1) / max(1, len(self) - 1))}"

    def words(self, index: int) -> str:
        """Range of a class."""
        ends = [number(round(b) if b >= 1 else b) for b in self.bounds]
        if index == UNKNOWN:
            return self.unknown
        if not ends:
            return self.alike
        if index == 0:
            return f"below {ends[0]} {self.unit}"
        if index == len(ends):
            return f"{ends[-1]} {self.unit} and more"
        return f"{ends[index - 1]} to {ends[index]}"

    def legend(self, index: int) -> tuple[str, str, str]:
        """Entry of a class in the legend."""
        return f"s-{self.colour(index)}", self.words(index), "box"
