"""Figures of spindle growth: errors after starts and stops, fuzzy groups of the sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.charts.bands import Axis, Strip
from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE

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


def transitions(runs: Sequence[tuple[Floats, Floats]]) -> Transitions | None:
    """Errors [um] of all runs over the time since each began [s]; None with too few."""
    edges = np.arange(0.0, SHOWN_MIN + BIN_MIN, BIN_MIN)
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


def transition_strip(one: Transitions, limit: float | None) -> Strip:
    """Median and 90 % of the errors over the time since a start or a stop."""
    return Strip(
        head="Model less measured, µm", height=150, zero=True,
        areas=[("s-band", one.minutes, one.low, one.high)],
        curves=[("window", one.minutes, one.middle)],
        levels=() if limit is None else (-limit, limit),
    )  # fmt: skip


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


def network_strips(bands: Floats | None, weights: Floats) -> tuple[list[Strip], Axis]:
    """Bands (J, 2) of the network over the sensors, and the weight of each sensor in its group.

    ``weights`` (3, S) are those in front, middle and rear [1].
    """
    many = weights.shape[1]
    at = np.arange(1.0, many + 1.0)
    strips = []
    if bands is not None:
        dense = np.linspace(0.0, many - 1.0, 181)
        strips.append(Strip(
            head="Membership in the network’s bands", height=90, scale=(0.0, 1.05),
            curves=[(GROUP_CURVES[k % 3], dense + 1, values)
                    for k, values in enumerate(gaussian(dense, bands))],
        ))  # fmt: skip
    strips.append(Strip(
        head="Weight of each sensor in its group", height=90, scale=(0.0, 1.05),
        dots=[(f"s-{css}", at, row) for css, row in zip(GROUP_CURVES, weights, strict=True)],
    ))  # fmt: skip
    marks = [(float(k), str(int(k))) for k in at]
    return strips, Axis(words="Sensor, from front to rear", span=(0.5, many + 0.5), marks=marks)
