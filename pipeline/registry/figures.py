"""Figures that stand by themselves in MLflow: measured against predicted, as SVG."""

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.schema.bundle import PREDICTIONS, VERDICT
from pipeline.schema.predictions import first_judged, read_predictions, shown_predictions
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

SIDE, MARGIN = 420, 60
"""Side of the square of the figure, and what its words take on each side [px]."""


def scatter(folder: Path) -> str:
    """Measured against predicted by the first decisive score, as an SVG file; or empty."""
    if not (folder / PREDICTIONS).exists():
        return ""
    verdict = read_json(folder / VERDICT, Verdict)
    one = first_judged(verdict)
    points = shown_predictions(verdict, read_predictions(folder / PREDICTIONS))
    if one is None or points.empty:
        return ""
    title = f"{verdict.machine} {one.quantity} [{one.unit}], {one.role.replace('_', ' ')}"
    return str(_square(points, f"{title}, {verdict.origin}"))


def _square(points: "pd.DataFrame", title: str) -> str:
    """A square with one scale for both axes, its diagonal, and a dot a row."""
    both = points[["measured", "predicted"]]
    low, high = float(both.min().min()), float(both.max().max())
    step = (SIDE / (high - low)) if high > low else 0.0

    def place(value: float) -> float:
        return (value - low) * step

    whole = SIDE + 2 * MARGIN
    parts = [
        svg.tag("rect", width=whole, height=whole, fill="white"),
        svg.tag("line", x1=MARGIN, y1=MARGIN + SIDE, x2=MARGIN + SIDE, y2=MARGIN, stroke="gray"),
        svg.tag("text", title, x=MARGIN, y=MARGIN / 2, font_size=13),
        svg.tag("text", f"measured, {number(low)} to {number(high)}", x=MARGIN, font_size=12,
                y=whole - MARGIN / 2),
        svg.tag("text", "predicted, same scale", x=0, y=0, font_size=12,
                transform=f"translate({MARGIN / 2} {MARGIN + SIDE}) rotate(-90)"),
    ]  # fmt: skip
    for measured, predicted in both.itertuples(index=False):
        x, y = MARGIN + place(measured), MARGIN + SIDE - place(predicted)
        parts.append(svg.tag("circle", cx=x, cy=y, r=2, fill="#1f5fa8", fill_opacity=0.6))
    return str(svg.tag("svg", svg.group(parts), xmlns="http://www.w3.org/2000/svg",
                       width=whole, height=whole, role="img", aria_label=title))  # fmt: skip
