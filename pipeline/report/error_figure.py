"""Errors of predicted times, one run a row, against the limit and against the plain guess."""

from typing import Any

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import real, signed
from pipeline.charts.svg import anchor
from pipeline.report.controlled import run_status

ROW, TOP = 22, 6  # px
WIDEST = 60.0  # percent; an error beyond it stands at the edge as an arrow
LONGEST = 24  # letters of a run's name that stand beside it
KIND = {"passed": "p-passed", "failed": "p-failed", "unknown": "p-learnt"}


def error_figure(runs: list[dict[str, Any]], limit: float | None, label: str) -> Markup:
    """A point for each predicted time and each plain guess, joined; the limit as a band."""
    low, high = _span(runs, limit)
    bottom = TOP + ROW * len(runs)

    def place(value: float) -> float:
        return 100 * (value - low) / (high - low)

    parts: list[Markup] = []
    if limit is not None:
        ends = [place(max(low, -limit)), place(min(high, limit))]
        parts.append(svg.bar(ends[0], ends[1] - ends[0], TOP, bottom - TOP, "s-limits"))
    for mark in svg.ticks(low, high, most=6):
        x = place(mark)
        parts.append(svg.down(x, TOP, bottom, "grid zero" if mark == 0 else "grid"))
        parts.append(svg.text(x, bottom + 16, signed(mark, 0), anchor(x)))
    for row, run in enumerate(runs):
        parts += _row(run, TOP + ROW * (row + 0.5), limit, (low, high))
    return svg.figure(parts, height=bottom + 24, label=label, kind="runs")


def _span(runs: list[dict[str, Any]], limit: float | None) -> tuple[float, float]:
    found = [real(r.get(key)) for r in runs for key in ("error_percent", "naive_error_percent")]
    known = [max(-WIDEST, min(WIDEST, v)) for v in found if v is not None]
    reach = 1.5 * limit if limit else 1.0
    return min([-reach, *(v - 2 for v in known)]), max([reach, *(v + 2 for v in known)])


def _row(
    run: dict[str, Any], y: float, limit: float | None, span: tuple[float, float]
) -> list[Markup]:  # fmt: skip
    low, high = span
    error, naive = real(run.get("error_percent")), real(run.get("naive_error_percent"))
    name = str(run.get("run") or "")
    words = name.rpartition("/")[2].replace(".txt", "")
    words = words if len(words) <= LONGEST else f"…{words[1 - LONGEST :]}"
    parts = [svg.text(0, y + 4, words, "name end", dx=-8)]
    at = [
        100 * (min(max(v, low), high) - low) / (high - low) for v in (naive, error) if v is not None
    ]
    if len(at) == 2:
        ends = {"x1": f"{at[0]:.2f}%", "x2": f"{at[1]:.2f}%"}
        parts.append(svg.tag("line", y1=y, y2=y, class_="join", **ends))
    if naive is not None:
        parts.append(_point(naive, y, "p-naive", span))
    if error is not None:
        parts.append(_point(error, y, KIND[run_status(run, limit)], span))
        parts.append(svg.text(100, y + 4, f"{signed(error)} %", "tick", dx=8))
    return parts


def _point(value: float, y: float, kind: str, span: tuple[float, float]) -> Markup:
    low, high = span
    if value < low or value > high:
        edge, arrow = (0, "◂") if value < low else (100, "▸")
        return svg.text(edge, y + 4, arrow, "tick" if edge == 0 else "tick end")
    x = f"{100 * (value - low) / (high - low):.2f}%"
    return svg.tag(
        "circle", cx=x, cy=y, r=3.5 if kind == "p-naive" else 5.0, class_=f"point {kind}"
    )
