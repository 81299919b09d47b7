"""Typical and worst case of a sub-model: measured and predicted over time, and what is left."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.charts import judged
from pipeline.charts.bands import Strip, axis, readings, strips_figure
from pipeline.charts.numbers import TOGETHER, number, relative
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.sources import Source
from pipeline.schema.verdict import Score, Verdict

if TYPE_CHECKING:
    import pandas as pd

CLOSE, LEAST_ROWS = 0.08, 600
"""Share of a case that the close look shows [1], and the samples from which there is one [1]."""
MILLIMETRES_FROM = 3000.0
"""Length from which micrometres are drawn as millimetres [um]."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """Drawing of a typical and of the worst case, and its axis."""

    quantity: str
    """Quantity whose error ranks the cases."""
    regime: str = ""
    """Its regime."""
    error: str = "rmse"
    """Error that ranks."""
    shown: tuple[str, ...] = ()
    """Quantities that are drawn below one another; that one itself where none is named."""
    axis: str = "Time, s"
    """Axis in words."""
    factor: float = 1.0
    """Unit of the axis over that of the stored column ``t``."""
    other: tuple[str, str] | None = None
    """Regime, or baseline, that is drawn beside the model, and it in words."""
    beside: Callable[[str], Sequence[Strip]] = lambda group: ()
    """Further strips below, by the case."""
    legend: Sequence[tuple[str, str, str]] = ()
    """Entries of the legend for these."""


def case_figures(
    rows: "pd.DataFrame | None",
    v: Verdict,
    one: Drawn,
    case: str,
    made: list[Source],
    *,
    alone: bool,
) -> Figures | None:
    """Drawing of the worst case and its greatest error, where ``alone`` of the typical one too.

    ``rows``: stored predictions; ``case``: kind of a group of records, in words.
    """
    if rows is None or not len(rows):
        return None
    ranked = [
        s for s in v.of(one.quantity, role=v.judged_role)
        if s.regime == one.regime and s.group != "all" and getattr(s, one.error) is not None
    ]  # fmt: skip
    ranked.sort(key=lambda s: abs(getattr(s, one.error)))
    if not ranked:
        return None
    chosen = {id(ranked[-1]): (ranked[-1], "Worst")}
    if alone and len(ranked) > 1:
        chosen = {id(ranked[len(ranked) // 2]): (ranked[len(ranked) // 2], "Typical")} | chosen
    figures: list[Figure] = []
    for score, words in chosen.values():
        strips, span = _strips(rows, score, one)
        if not strips:
            continue
        caption = (
            f"{words} {case}, {judged.case_words(score.group)}: "
            f"{judged.quantity_words(score)}, {judged.HEADS[one.error]} "
            f"{sized(getattr(score, one.error), one.error, score.unit)}."
        )
        figures.append(_figure(strips, one, span, caption, made))
        if words == "Worst" and (close := _close(strips, span)) is not None:
            ends = " to ".join(number(end) for end in close)
            unit = one.axis.rpartition(", ")[2]
            caption = f"The same about its greatest error, from {ends} {unit}."
            figures.append(_figure(strips, one, close, caption, made))
    if not figures:
        return None
    legend = [("l-measured", "measured", "line"), ("l-window", "predicted", "line")]
    if any(strip.areas for strip in strips):
        legend.append(("s-band", "its 90 % interval", "box"))
    if one.other is not None:
        legend.append(("l-free", one.other[1], "dash"))
    if any(strip.levels for strip in strips):
        legend.append(("l-limit", "limit of the largest error", "dots"))
    return Figures(figures=figures, legend=[*legend, *one.legend])


def sized(value: float | None, error: str, unit: str) -> str:
    """Size of an error with its unit."""
    if error.endswith("percent"):
        return relative(value, lambda x: number(x, 2), "%")
    return f"{number(value)}{TOGETHER}{judged.unit_words(unit)}".rstrip()


def _strips(
    rows: "pd.DataFrame", score: Score, one: Drawn
) -> tuple[list[Strip], tuple[float, float]]:
    """Measured and predicted, what is left, and strips of its own, of one case."""
    mine = rows[rows["group"] == score.group]
    of = mine[(mine["quantity"] == score.quantity) & (mine["regime"] == score.regime)]
    error = np.abs((of["predicted"] - of["measured"]).to_numpy(float))
    if not np.isfinite(error).any():
        return [], (0.0, 1.0)
    case = str(of["case"].iloc[int(np.nanargmax(error))]) if "case" in of else ""
    mine = mine[mine["case"] == case] if case else mine
    found: list[Strip] = []
    for quantity in one.shown or (score.quantity,):
        of = mine[mine["quantity"] == quantity]
        of = of[np.isfinite(readings(of["t"].to_numpy(float)))].sort_values("t", kind="stable")
        main = of[of["regime"] == score.regime]
        if len(main) > 2:
            found += _pair(main, of, one, quantity, score if not one.shown else None)
    if not found:
        return [], (0.0, 1.0)
    x = found[0].curves[-1][1]
    return [*found, *one.beside(case or score.group)], (float(x.min()), float(x.max()))


def _pair(
    main: "pd.DataFrame", of: "pd.DataFrame", one: Drawn, quantity: str, score: Score | None
) -> list[Strip]:
    """A strip of measured and predicted, and for the quantity that ranks one of what is left."""
    t, measured, predicted, low, high = (
        readings(main[name].to_numpy(float)) if name in main else np.full(len(main), np.nan)
        for name in ("t", "measured", "predicted", "low", "high")
    )
    t = one.factor * t
    unit = str(main["unit"].iloc[0]) if "unit" in main else (score.unit if score else "")
    largest = float(np.nanmax(np.abs([measured, predicted]), initial=0.0))
    factor = 1e-3 if unit == "um" and largest >= MILLIMETRES_FROM else 1.0
    unit = "mm" if factor != 1.0 else judged.unit_words(unit)
    error_unit = unit if score is None or factor != 1.0 else judged.unit_words(score.unit)
    measured, predicted, low, high = (factor * v for v in (measured, predicted, low, high))
    curves = [("window", t, predicted), ("measured", t, measured)]
    if one.other is not None:
        column = f"baseline_{one.other[0]}"
        other = main if column in main else of[of["regime"] == one.other[0]]
        values = other[column if column in main else "predicted"].to_numpy(float)
        curves.insert(0, ("free", one.factor * other["t"].to_numpy(float), factor * values))
    areas = [("s-band", t, low, high)] if np.isfinite(low).any() else []
    words = quantity.replace("_", " ")
    head = f"{words[:1].upper()}{words[1:]}{f', {unit}' if unit else ''}"
    strips = [Strip(head=head, curves=curves, areas=areas)]
    if score is None:
        return strips
    limit = score.limits.get("max")
    left = [(kind, x, y - measured) for kind, x, y in curves[:-1] if len(y) == len(measured)]
    strips.append(Strip(
        head=f"Predicted less measured, {error_unit}".rstrip(", "), height=70, zero=True,
        curves=left, levels=() if limit is None else (-factor * limit, factor * limit),
    ))  # fmt: skip
    return strips


def _figure(
    strips: Sequence[Strip], one: Drawn, span: tuple[float, float], caption: str,
    made: list[Source],
) -> Figure:  # fmt: skip
    svg = strips_figure(strips, axis(one.axis, span), caption)
    return Figure(svg=svg, caption=caption, sources=made)


def _close(strips: Sequence[Strip], span: tuple[float, float]) -> tuple[float, float] | None:
    """The stretch about the greatest error; None in a case too short for one."""
    _, t, predicted = strips[0].curves[-2]
    measured = strips[0].curves[-1][2]
    width = CLOSE * (span[1] - span[0])
    if len(t) < LEAST_ROWS or not width:
        return None
    middle = float(t[int(np.nanargmax(np.abs(predicted - measured)))])
    start = min(max(middle - width / 2, span[0]), span[1] - width)
    return start, start + width
