"""Figures of the feed drives: friction over speed, mass over time.

Friction is drawn against the direction of motion, so that both directions share one scale, over the
logarithm of speed, so that the slow end shows, where the force falls.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.charts.bands import Axis, Strip, axis, band, decades, readings, strips_figure
from pipeline.charts.numbers import counted, powers, quantity
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.sources import Source
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import CurvePoint, DriveAxis, FrictionPoint, RecursiveMass
from pipeline.schema.model import Parameter

SEEN = 0.15
"""Share of the forces' span up to which the scale includes an error bar [1]."""
MOST_POINTS = 250
"""Greatest number of points of a direction, the longest stretches first; the file has all."""
WIDEST = 7
"""Greatest number of decades of speed; slower than that is no motion."""
DIRECTIONS = ((1, "positive", "+"), (-1, "negative", "−"))
"""Sign of the speed, name and sign in words of each direction."""
SETTLED = 0.2
"""Share of a recording before which the recursive estimate may leave the figure [1]."""


def axis_figures(
    letter: str, one: DriveAxis, mass: Parameter | None, made: list[Source]
) -> Figures | None:
    """Friction and mass of an axis; None where neither can be drawn."""
    found = [drawn for drawn in (_friction(letter, one, made), _mass(letter, one, mass, made))
             if drawn is not None]  # fmt: skip
    if not found:
        return None
    return Figures(
        figures=[figure for figure, _ in found], kind="one" if len(found) == 1 else "",
        legend=[entry for _, legend in found for entry in legend],
    )  # fmt: skip


Drawing = tuple[Figure, list[tuple[str, str, str]]]
"""A figure with its part of the legend."""


def _friction(letter: str, one: DriveAxis, made: list[Source]) -> Drawing | None:
    drawn = friction_strip(one)
    if drawn is None:
        return None
    strip, below = drawn
    many = sum(len(x) for _, x, _ in strip.dots)
    words = (
        f"Friction of axis {letter} over speed: {counted(many, 'stretch', 'stretches')} of "
        "constant speed with 95 % intervals, and Stribeck’s curve."
    )
    figure = Figure(svg=strips_figure([strip], below, words, "friction"), caption=words,
                    sources=made)  # fmt: skip
    legend = []
    for _, name, sign in DIRECTIONS:
        if any(kind == f"p-{name}" for kind, *_ in strip.dots):
            legend.append((f"p-{name}", f"measured, towards {sign}{letter}", "dot"))
        if any(kind == f"curve-{name}" for kind, *_ in strip.curves):
            legend.append((f"l-curve-{name}", f"model, towards {sign}{letter}", "line"))
    return figure, legend


def friction_strip(one: DriveAxis) -> tuple[Strip, Axis] | None:
    """Points with error bars and the curve of each direction; None where there is nothing."""
    longest = sorted(one.friction_points, key=lambda point: -point.seconds)
    points = {name: _branch(longest, sign, MOST_POINTS) for sign, name, _ in DIRECTIONS}
    curves = {name: _branch(one.friction_curve, sign) for sign, name, _ in DIRECTIONS}
    every = [branch for branch in (*points.values(), *curves.values()) if branch.shape[1]]
    if not every:
        return None
    measured = np.concatenate([branch[0] for branch in points.values()])
    slow = 0.5 * measured.min() if len(measured) else min(branch[0].min() for branch in every)
    last = float(np.log10(1.15 * max(branch[0].max() for branch in every)))
    span = (float(min(max(np.log10(slow), last - WIDEST), last - 1)), last)
    whole = np.concatenate([branch[1] for branch in every])
    reach = SEEN * (float(np.ptp(whole)) or float(np.abs(whole).max(initial=0.0)))
    scale = band(0, 1, *(force + sign * np.minimum(half, reach)
                         for _, force, half in every for sign in (-1, 1)), zero=True)  # fmt: skip
    strip = Strip(
        head=f"Force against motion, {one.force_unit}".rstrip(", "), height=260,
        unit=one.force_unit, scale=(scale.low, scale.high),
        curves=[
            *((f"bar-{name}", *_bars(branch)) for name, branch in points.items()),
            *((f"curve-{name}", np.log10(branch[0]), branch[1])
              for name, branch in curves.items() if branch.shape[1] > 1),
        ],
        dots=[(f"p-{name}", np.log10(branch[0]), branch[1])
              for name, branch in points.items() if branch.shape[1]],
    )  # fmt: skip
    return strip, decades("Speed, mm/s", span)


def _branch(
    points: Sequence[FrictionPoint | CurvePoint], sign: int, most: int | None = None
) -> Floats:
    """Speed [mm/s], force against motion and half of its interval of one direction, (3, N)."""
    rows = [
        [sign * one.velocity_mm_s, sign * one.force, getattr(one, "half_width", None) or 0.0]
        for one in points if sign * one.velocity_mm_s > 0
    ]  # fmt: skip
    table = readings(np.array(rows, dtype=float).reshape(-1, 3))
    known = table[np.isfinite(table[:, :2]).all(axis=1)][:most]
    return np.nan_to_num(known[np.argsort(known[:, 0], kind="stable")]).T


def _bars(branch: Floats) -> tuple[Floats, Floats]:
    """Error bars as one curve that is lifted between them."""
    speed, force, half = branch[:, branch[2] > 0]
    ends = np.stack([force - half, force + half, np.full(len(force), np.nan)], axis=1)
    return np.repeat(np.log10(speed), 3), ends.ravel()


def _mass(
    letter: str, one: DriveAxis, mass: Parameter | None, made: list[Source]
) -> Drawing | None:
    found = one.recursive_mass
    batch = mass if mass is not None and mass.determined else None
    drawn = None if found is None else mass_strip(found, batch)
    if found is None or drawn is None:
        return None
    strip, below = drawn
    last = quantity(float(strip.curves[0][2][-1]), powers(found.unit))
    words = (
        f"Mass of axis {letter} through {found.recording or 'a recording'}: the recursive "
        f"estimate ends at {last}."
    )
    figure = Figure(svg=strips_figure([strip], below, words, "inertia"), caption=words,
                    sources=made)  # fmt: skip
    return figure, [("l-modelled", "recursive estimate", "line"),
                    ("s-band", "its 95 % band", "box"),
                    ("s-batch", "value of all training records", "box")]  # fmt: skip


def mass_strip(mass: RecursiveMass, batch: Parameter | None) -> tuple[Strip, Axis] | None:
    """The estimate with its band, and the value of all training recordings with its interval."""
    t, value, half = (readings(np.array(column, dtype=float))
                      for column in (mass.time_s, mass.value, mass.half_width))  # fmt: skip
    good = np.isfinite(t) & np.isfinite(value)
    if good.sum() < 2:
        return None
    order = np.argsort(t[good], kind="stable")
    t, value, half = (column[good][order] for column in (t, value, np.nan_to_num(half)))
    span = (float(t[0]), float(t[-1]))
    late = t >= span[0] + SETTLED * (span[1] - span[0])
    ends = None if batch is None else batch.interval_95
    levels = [] if batch is None or batch.value is None else [batch.value]
    scale = band(
        0, 1, (value - half)[late], (value + half)[late], np.array([*levels, *(ends or ())])
    )
    both = np.array(span)
    areas = [] if ends is None else [("s-batch", both, np.full(2, ends[0]), np.full(2, ends[1]))]
    strip = Strip(
        head=f"Mass, {mass.unit}", height=220, unit=mass.unit, scale=(scale.low, scale.high),
        areas=[*areas, ("s-band", t, value - half, value + half)],
        curves=[("modelled", t, value)], levels=levels,
    )  # fmt: skip
    return strip, axis("Time, s", span)
