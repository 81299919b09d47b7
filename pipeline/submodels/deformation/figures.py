"""Figures of spindle growth: recordings, starts and stops, fuzzy groups of the sensors.

Bands of a recording stand below one another over its time: temperatures, growth with its 90 %
interval, what the model is off by, spindle speed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, beyond, beyond_words, line, tick_words
from pipeline.charts.numbers import number
from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE

TOP, TEMPERATURES, GROWTH, ERROR, SPEED, GAP = 18, 120, 150, 70, 34, 28
"""Heights of the head, of the bands, and between them [px]."""
GROUP_CURVES = ("f1", "f3", "f5")
"""CSS classes of front, middle and rear."""
GROUP_NAMES = ("front", "middle", "rear")
NARROWEST = 0.3
"""Least width of a band of the network [channels]; where its stored places begin."""
BIN_MIN = 5.0
"""Width of a step after a start or a stop [min]."""
SHOWN_MIN = 90.0
"""Time after a start or a stop that is drawn [min]."""
FEWEST = 3
"""Starts or stops below which a step is not drawn [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """One recording as it is drawn: T samples."""

    time: Floats
    """Since the start [s]; shape (T,)."""
    measured: Floats
    predicted: Floats
    low: Floats
    high: Floats
    """Growth [um]; shape (T,)."""
    temperatures: Mapping[str, Floats] = field(default_factory=dict)
    """Temperatures [degC] by the CSS class and the name of the sensor, joined by a blank; empty
    where the signals are not there; shape (T',)."""
    speed: Floats | None = None
    """Speed [rev/min]; shape (T',) or None."""
    clock: Floats = field(default_factory=lambda: np.zeros(0))
    """Times of temperatures and speed [s]; shape (T',)."""

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        return float(self.time[0]), float(self.time[-1])


def recording_figure(one: Recorded, limit: float | None, label: str) -> Markup:
    """Temperatures, growth, error and speed of one recording, below one another."""
    parts: list[Markup] = []
    top, span = float(TOP), one.span
    if one.temperatures:
        sound = [v for css, v in one.temperatures.items() if not css.startswith("batch")]
        into = band(top, TEMPERATURES, *(sound or one.temperatures.values()))
        curves = [line(one.clock, values, span, into, css.split()[0])
                  for css, values in one.temperatures.items()]  # fmt: skip
        percent = 100 * (one.clock - span[0]) / max(span[1] - span[0], 1e-12)
        shown = (one.clock >= span[0]) & (one.clock <= span[1])
        outside = [beyond(percent[shown], values[shown], into, "°C")
                   for values in one.temperatures.values()]  # fmt: skip
        parts += _band(f"Temperatures, °C{beyond_words(outside, '°C')}", into, curves)
        parts += [mark for sensor in outside for mark in sensor.marks]
        top = into.bottom + GAP
    into = band(top, GROWTH, one.measured, one.low, one.high, zero=True)
    parts += _band("Growth, µm", into, [
        svg.tag("path", d=_outline(one, span, into), class_="s-band"),
        line(one.time, one.predicted, span, into, "window"),
        line(one.time, one.measured, span, into, "measured"),
    ])  # fmt: skip
    error = one.predicted - one.measured
    reach = 1.15 * max(float(np.nanmax(np.abs(error), initial=0.0)), limit or 0.0, 0.1)
    into = Band(top=into.bottom + GAP, height=ERROR, low=-reach, high=reach)
    limits = [svg.across(into.pixel(end), "grid limit") for end in (-limit, limit)] if limit else []
    curve = line(one.time, error, span, into, "window")
    parts += [*_band("Model less measured, µm", into, [curve]), *limits]
    if one.speed is not None:
        into = band(into.bottom + GAP, SPEED, one.speed, zero=True)
        fastest = float(np.nanmax(one.speed, initial=0.0))
        words = f"Spindle speed, up to {number(round(fastest))} rev/min"
        parts.append(svg.text(0, into.top - 7, words, "head"))
        parts += [svg.across(into.bottom),
                  into.content([line(one.clock, one.speed, span, into, "speed")])]  # fmt: skip
    across = _minutes((span[0] / MINUTE, span[1] / MINUTE), TOP, into.bottom)
    return svg.figure([*across, *parts], height=into.bottom + 38, label=label, kind="growth")


def _band(head: str, into: Band, curves: list[Markup]) -> list[Markup]:
    return [svg.text(0, into.top - 7, head, "head"), *into.levels(4), into.content(curves)]


def _minutes(span: tuple[float, float], top: float, bottom: float) -> list[Markup]:
    parts = [svg.text(50, bottom + 33, "Time, min", "tick mid")]
    for mark in _round_minutes(*span):
        x = 100 * (mark - span[0]) / max(span[1] - span[0], 1e-9)
        parts += [svg.down(x, top, bottom),
                  svg.text(x, bottom + 16, tick_words(mark), svg.anchor(x))]  # fmt: skip
    return parts


def _round_minutes(first: float, last: float) -> list[float]:
    """Five to seven marks at minutes that a clock shows."""
    step = next((s for s in (5, 10, 15, 30, 60, 120, 240, 480) if (last - first) / s <= 7), 1440)
    return [float(m) for m in np.arange(np.ceil(first / step) * step, last + 1e-9, step)]


def _outline(one: Recorded, span: tuple[float, float], into: Band) -> str:
    """The interval as an area; broken where an end is not known."""
    known = np.isfinite(one.low) & np.isfinite(one.high)
    t, low, high = one.time[known], one.low[known], one.high[known]
    if not len(t):
        return ""
    x = UNITS * (t - span[0]) / max(span[1] - span[0], 1e-9)
    around = np.concatenate([into.down(high), into.down(low[::-1])])
    return svg.path_data(np.concatenate([x, x[::-1]]), around) + "z"


# ---- starts and stops


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Errors after a start or a stop, in steps of time: K steps."""

    minutes: Floats
    """Middle of each step [min]; shape (K,)."""
    low: Floats
    middle: Floats
    high: Floats
    """5, 50 and 95 % of the samples lie below [um]; NaN with too few; shape (K,)."""
    count: int
    """Starts or stops [1]."""

    @property
    def widest(self) -> float:
        """Greatest magnitude [um]."""
        return float(np.nanmax(np.abs([self.low, self.high]), initial=0.0))


def transitions(
    runs: Sequence[tuple[Floats, Floats]], shown_min: float = SHOWN_MIN
) -> Transitions | None:
    """Errors of all runs over the time since each began; None with too few.

    Parameters
    ----------
    runs : sequence of (ndarray, ndarray)
        Time since its begin [s] and error [um] of each.
    shown_min : float
        Time that is drawn [min].
    """
    edges = np.arange(0.0, shown_min + BIN_MIN, BIN_MIN)
    values = np.full((3, len(edges) - 1), np.nan)
    for k, (first, last) in enumerate(pairwise(edges.tolist())):
        within = [e[(t >= first * MINUTE) & (t < last * MINUTE) & np.isfinite(e)] for t, e in runs]
        there = [e for e in within if len(e)]
        if len(there) >= FEWEST:
            values[:, k] = np.quantile(np.concatenate(there), (0.05, 0.5, 0.95))
    if not np.isfinite(values).any():
        return None
    last = int(np.flatnonzero(np.isfinite(values[1]))[-1]) + 1
    minutes = 0.5 * (edges[:-1] + edges[1:])
    return Transitions(minutes=minutes[:last], low=values[0, :last], middle=values[1, :last],
                       high=values[2, :last], count=len(runs))  # fmt: skip


def transition_figure(one: Transitions, reach: float, limit: float | None, label: str) -> Markup:
    """Median and 90 % of the errors over the time since a start or a stop."""
    span = (0.0, float(one.minutes[-1] + BIN_MIN / 2))
    into = Band(top=TOP, height=GROWTH, low=-reach, high=reach)
    known = np.isfinite(one.low)
    x = UNITS * one.minutes / span[1]
    around = np.concatenate([into.down(one.high[known]), into.down(one.low[known][::-1])])
    area = svg.path_data(np.concatenate([x[known], x[known][::-1]]), around) + "z"
    parts = _band("Model less measured, µm", into, [
        svg.tag("path", d=area, class_="s-band"),
        svg.curve(x, into.down(one.middle), "window"),
    ])  # fmt: skip
    if limit:
        parts += [svg.across(into.pixel(end), "grid limit") for end in (-limit, limit)]
    return svg.figure([*_minutes(span, TOP, into.bottom), *parts], height=into.bottom + 38,
                      label=label, kind="growth")  # fmt: skip


# ---- the fuzzy-filtered network and the groups


def network_bands(document: Mapping[str, Any], sensors: int) -> Floats:
    """Centre and width [channels] of each band of a stored fuzzy-filtered network, shape (J, 2)."""
    places = np.asarray(document["state"]["places"], dtype=float)
    low, high = np.array([0.0, NARROWEST]), np.array([sensors - 1.0, float(sensors)])
    found: Floats = low + places[:, :2] * (high - low)
    return found[np.argsort(found[:, 0], kind="stable")]


def gaussian(at: Floats, bands: Floats) -> Floats:
    """Membership of places along the sensors in each band [1], shape (J, N)."""
    result: Floats = np.exp(-0.5 * ((at - bands[:, :1]) / bands[:, 1:2]) ** 2)
    return result


def network_figure(bands: Floats | None, weights: Floats, label: str) -> Markup:
    """Bands of the network over the sensor index, and each sensor's weight in its group.

    Parameters
    ----------
    bands : ndarray, shape (J, 2), or None
        Centre and width [channels]; None where no network is there.
    weights : ndarray, shape (3, S)
        Of each sensor in front, middle and rear [1].
    label : str
        In words.
    """
    many = weights.shape[1]
    parts, top = [], float(TOP)
    edge = 0.5 / many
    if bands is not None:
        into = Band(top=top, height=ERROR + 20, low=0.0, high=1.05)
        dense = np.linspace(0.0, many - 1.0, 181)
        x = UNITS * (edge + (1 - 2 * edge) * dense / max(many - 1, 1))
        curves = [svg.curve(x, into.down(values), GROUP_CURVES[k % 3])
                  for k, values in enumerate(gaussian(dense, bands))]  # fmt: skip
        parts += _band("Membership in the network’s bands", into, curves)
        top = into.bottom + GAP
    into = Band(top=top, height=ERROR + 20, low=0.0, high=1.05)
    parts += _band("Weight of each sensor in its group", into, [])
    wide = 100 / many
    for k, css in enumerate(GROUP_CURVES):
        for sensor, share in enumerate(weights[k]):
            y = into.pixel(float(share))
            parts.append(svg.bar(wide * (sensor + 0.2 + 0.2 * k), 0.2 * wide * 0.9, y,
                                 into.bottom - y, f"s-{css}"))  # fmt: skip
    for sensor in range(many):
        parts.append(svg.text(wide * (sensor + 0.5), into.bottom + 16, str(sensor + 1), "tick mid"))
    parts.append(svg.text(50, into.bottom + 33, "Sensor, from front to rear", "tick mid"))
    return svg.figure(parts, height=into.bottom + 38, label=label, kind="growth")
