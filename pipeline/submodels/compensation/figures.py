"""Figures of the error that is left over: along a motion, by network, the attention."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, clock, line, tick_words
from pipeline.schema.arrays import Floats
from pipeline.submodels.compensation.features import BEND, EVEN, REST, TURN
from pipeline.submodels.compensation.model import AttentionShown
from pipeline.submodels.compensation.page_facts import Traced, bare

TOP, ERROR, GAP = 18, 150, 30
"""Heights of the head, of a band, and between bands [px]."""
ROW, BAR = 26, 14
"""Heights of a row of bars and of its bar [px]."""
REGIME_CURVES = {REST: "f0", TURN: "f1", BEND: "f3", EVEN: "f5"}
"""CSS classes of regimes."""


def error_figure(one: Traced, span: tuple[float, float], heads: tuple[str, str],
                 label: str) -> Markup:  # fmt: skip
    """Error before with its predicted interval, and after, at one scale, below one another.

    ``span`` is the part that is drawn [s], ``heads`` stand above each.
    """
    here = (one.seconds >= span[0]) & (one.seconds <= span[1])
    first = band(TOP, ERROR, one.before[here], one.after[here], one.low[here], one.high[here],
                 zero=True)  # fmt: skip
    second = Band(top=first.bottom + GAP, height=ERROR, low=first.low, high=first.high)
    drawn = (
        (first, heads[0], [
            svg.tag("path", d=_area(one, span, first), class_="s-band"),
            line(one.seconds, one.before - one.after, span, first, "window"),
            line(one.seconds, one.before, span, first, "measured"),
        ]),
        (second, heads[1], [line(one.seconds, one.after, span, second, "measured")]),
    )  # fmt: skip
    parts = clock(span, TOP, second.bottom)
    for into, head, curves in drawn:
        parts += [svg.text(0, into.top - 7, head, "head"), *into.levels(5), into.content(curves)]
    return svg.figure(parts, height=second.bottom + 38, label=label, kind="trace")


def _area(one: Traced, span: tuple[float, float], into: Band) -> str:
    """The interval as an area, thinned to what a page can show; broken where it is not known."""
    here = (one.seconds >= span[0]) & (one.seconds <= span[1])
    here &= np.isfinite(one.low) & np.isfinite(one.high)
    if not here.any():
        return ""
    x = UNITS * (one.seconds[here] - span[0]) / max(span[1] - span[0], 1e-12)
    place = np.floor(x).astype(int) // 4
    first = np.flatnonzero(np.diff(place, prepend=-1))
    high = np.maximum.reduceat(one.high[here], first)
    low = np.minimum.reduceat(one.low[here], first)
    x = x[first]
    around = np.concatenate([into.down(high), into.down(low[::-1])])
    return svg.path_data(np.concatenate([x, x[::-1]]), around) + "z"


def bars_figure(
    rows: Sequence[tuple[str, float, float, bool]], most: float, head: str, label: str
) -> Markup:
    """RMSE of each network as a bar with the spread of the folds' networks.

    A row has words, RMSE and spread [um], and whether it serves; ``most`` [um] is at the right end.
    """
    bottom = TOP + ROW * len(rows)
    parts = [svg.text(0, TOP - 6, head, "head")]
    for mark in svg.ticks(0.0, most, most=5):
        x = 100 * mark / most
        parts += [svg.down(x, TOP, bottom),
                  svg.text(x, bottom + 16, tick_words(mark), svg.anchor(x))]  # fmt: skip
    for k, (words, rmse, spread, serves) in enumerate(rows):
        y = float(TOP + ROW * k + (ROW - BAR) / 2)
        parts.append(svg.text(0, y + 11, words, "name end", dx=-8))
        parts.append(svg.bar(0, 100 * rmse / most, y, BAR, "s-after" if serves else "s-before"))
        end = 100 * min(rmse + spread, most) / most
        if spread > 0:
            begin = 100 * max(rmse - spread, 0.0) / most
            middle = y + BAR / 2
            parts.append(svg.tag("line", x1=f"{begin:.2f}%", x2=f"{end:.2f}%", y1=middle,
                                 y2=middle, class_="asked"))  # fmt: skip
        parts.append(svg.text(end, y + 11, bare(rmse), "tick", dx=6))
    parts.append(svg.text(50, bottom + 33, "RMSE, µm", "tick mid"))
    return svg.figure(parts, height=bottom + 38, label=label, kind="runs")


def attention_figure(one: AttentionShown, label: str) -> Markup:
    """Mean weight over the window by regime."""
    curves = {name: np.array(values) for name, values in one.weights.items()}
    into = band(TOP, ERROR, *curves.values(), zero=True)
    into = Band(top=into.top, height=into.height, low=0.0, high=into.high)
    low = float(one.ms[0] - (one.ms[-1] - one.ms[0]) / max(2 * (len(one.ms) - 1), 1))
    x = UNITS * (np.array(one.ms) - low) / max(-low, 1e-9)
    parts = [
        svg.text(50, into.bottom + 31, "Time before the one that is predicted, ms", "tick mid")
    ]
    for mark in svg.ticks(low, 0.0, most=6):
        at = 100 * (mark - low) / max(-low, 1e-9)
        parts += [svg.down(at, TOP, into.bottom),
                  svg.text(at, into.bottom + 16, tick_words(mark), svg.anchor(at))]  # fmt: skip
    drawn = [svg.curve(x, into.down(values), REGIME_CURVES[name])
             for name, values in curves.items()]  # fmt: skip
    parts += [svg.text(0, TOP - 7, "Mean weight", "head"), *into.levels(4), into.content(drawn)]
    return svg.figure(parts, height=into.bottom + 38, label=label, kind="trace")


def history_figure(history: Floats, label: str) -> Markup:
    """Least validation RMSE after each generation, G of them; ``history`` (G,) [um]."""
    into = band(TOP, ERROR, history)
    many = len(history)
    wide = max(many - 1, 1)
    parts = [svg.text(50, into.bottom + 31, "Generation", "tick mid")]
    for mark in svg.ticks(1.0, float(many), most=8) if many > 1 else [1.0]:
        if mark == round(mark):
            at = 100 * (mark - 1) / wide
            parts += [svg.down(at, TOP, into.bottom),
                      svg.text(at, into.bottom + 16, tick_words(mark), svg.anchor(at))]  # fmt: skip
    curve = svg.curve(UNITS * np.arange(many) / wide, into.down(history), "window")
    parts += [svg.text(0, TOP - 7, "Best validation RMSE, µm", "head"), *into.levels(4),
              into.content([curve])]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 38, label=label, kind="trace")
