"""The mean revolution of a recording: each component measured with its spread, and modelled."""

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, line, plain
from pipeline.charts.svg import anchor
from pipeline.report.cutting_traces import CutTrace

TOP, HEIGHT, GAP = 18, 120, 28  # px: head, a component, between two
TURN = (0.0, 360.0)  # deg
QUARTER = 90.0  # deg between two lines
CURVES = (("plain", "free"), ("modelled", "modelled"), ("measured", "measured"))
"""Kinds of curves with their CSS class, the last drawn on top."""


def revolution_figure(trace: CutTrace, label: str, *, with_plain: bool = True) -> Markup:
    """Components below one another over the spindle's angle, each on its own scale with 0."""
    parts: list[Markup] = []
    top = float(TOP)
    for axis in trace.axes:
        curves = [(trace.known(kind, axis), css) for kind, css in CURVES
                  if with_plain or kind != "plain"]  # fmt: skip
        known = [(values, css) for values, css in curves if values is not None]
        ends = spread(trace, axis)
        into = band(top, HEIGHT, *(values for values, _ in known), *(ends or ()), zero=True)
        drawn = [line(trace.angle, values, TURN, into, css) for values, css in known]
        cloud = _cloud(trace.angle, ends, into) if ends else []
        parts += [svg.text(0, top - 7, f"F{axis}, N", "head"), *into.levels(5),
                  into.content([*cloud, *drawn])]  # fmt: skip
        top = into.bottom + GAP
    bottom = top - GAP
    return svg.figure([*_angles(bottom), *parts], height=bottom + 36, label=label, kind="trace")


def spread(trace: CutTrace, axis: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Lower and upper end (T,) of what 95 % of the revolutions show; None where not said."""
    low, high = trace.known("low", axis), trace.known("high", axis)
    return None if low is None or high is None else (low, high)


def _cloud(
    angle: np.ndarray, ends: tuple[np.ndarray, np.ndarray], into: Band
) -> list[Markup]:  # fmt: skip
    """The spread as a filled area, one path for each stretch over which both ends are known."""
    x = UNITS * (angle - TURN[0]) / (TURN[1] - TURN[0])
    low, high = (into.down(v) for v in ends)
    good = np.isfinite(low) & np.isfinite(high) & (angle >= TURN[0]) & (angle <= TURN[1])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    areas = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        around = np.concatenate([np.arange(start, end), np.arange(start, end)[::-1]])
        y = np.concatenate([high[start:end], low[start:end][::-1]])
        areas.append(svg.path_data(x[around], y) + "z")
    return [svg.tag("path", d="".join(areas), class_="s-still", fill_opacity=0.6)]


def _angles(bottom: float) -> list[Markup]:
    parts = [svg.text(50, bottom + 31, "Angle of the spindle, °", "tick mid")]
    for mark in np.arange(TURN[0], TURN[1] + 1, QUARTER):
        x = 100 * float(mark - TURN[0]) / (TURN[1] - TURN[0])
        parts += [svg.down(x, TOP, bottom), svg.text(x, bottom + 16, plain(float(mark)),
                                                     anchor(x))]  # fmt: skip
    return parts
