"""Figures of tool wear: wear over the life of each tool, measured and told, with its interval."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, line, tick_words
from pipeline.schema.arrays import Bools, Floats

TOP, HEIGHT = 18, 170
"""Heights of the head and of the band [px]."""
MARK = 0.9
"""Width of a mark of a measurement, in percent of the figure."""
MARK_PX = 5.0
"""Its height [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Life:
    """One tool that was held out, K readings in the order of its use."""

    use: Floats
    """Use of the tool, in ``unit``; shape (K,)."""
    unit: str
    """Unit of the use, as it is printed."""
    measured: Floats
    predicted: Floats
    low: Floats
    high: Floats
    guess: Floats
    """Wear; NaN where there is none; shape (K,)."""
    scored: Bools
    """Whether the wear was measured, not interpolated; shape (K,)."""


def life_figure(one: Life, head: str, label: str) -> Markup:
    """Wear over the use of a tool: interval, model, guess, and the measurements as marks."""
    span = float(one.use[0]), float(max(one.use[-1], one.use[0] + 1e-9))
    known = np.isfinite(one.low) & np.isfinite(one.high)
    into = band(
        TOP, HEIGHT, one.measured, one.predicted, one.guess, one.low[known], one.high[known],
        zero=True,
    )  # fmt: skip
    curves = [
        svg.tag("path", d=_outline(one, span, into, known), class_="s-band"),
        line(one.use, one.guess, span, into, "speed"),
        line(one.use, one.predicted, span, into, "window"),
        line(one.use, one.measured, span, into, "measured"),
    ]
    marks = [
        svg.bar(_across(use, span) - MARK / 2, MARK, into.pixel(wear) - MARK_PX / 2, MARK_PX,
                "s-f-none")
        for use, wear in zip(one.use[one.scored], one.measured[one.scored], strict=True)
    ]  # fmt: skip
    sparse = marks if len(marks) <= UNITS // 40 else []
    parts = [svg.text(0, into.top - 7, head, "head"), *into.levels(4), into.content(curves)]
    return svg.figure([*_clock(span, one.unit, into), *parts, *sparse],
                      height=into.bottom + 38, label=label, kind="growth")  # fmt: skip


def _across(use: float, span: tuple[float, float]) -> float:
    return 100 * (use - span[0]) / (span[1] - span[0])


def _clock(span: tuple[float, float], unit: str, into: Band) -> list[Markup]:
    words = f"Use of the tool, {unit}" if unit else "Recordings of the tool"
    parts = [svg.text(50, into.bottom + 33, words, "tick mid")]
    for mark in svg.ticks(*span, most=6):
        x = _across(mark, span)
        parts += [svg.down(x, TOP, into.bottom),
                  svg.text(x, into.bottom + 16, tick_words(mark), svg.anchor(x))]  # fmt: skip
    return parts


def _outline(one: Life, span: tuple[float, float], into: Band, known: Bools) -> str:
    """The interval as an area."""
    if not known.any():
        return ""
    x = UNITS * (one.use[known] - span[0]) / (span[1] - span[0])
    around = np.concatenate([into.down(one.high[known]), into.down(one.low[known][::-1])])
    return svg.path_data(np.concatenate([x, x[::-1]]), around) + "z"
