"""90 % prediction intervals of a spindle's temperature, calibrated on held-out training days.

The regimes follow from the information at the time of the prediction: whether the network's free
run warms, cools or is steady, and how long ago the temperature was measured.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged, Share
from pipeline.submodels.conformal import Labels, interval
from pipeline.twin.spindle import TARGET, SpindleIntervals


@dataclass(frozen=True, kw_only=True)
class IntervalSettings(Ranged, section="spindle_interval"):
    """Calibration of prediction intervals."""

    folds: Annotated[int, Range(least=2)] = 5
    """Groups of training days that are left out in turn, at most one group a day."""
    trend_s: Positive = 600.0
    steady_K_h: NotNegative = 1.0
    """Warming and cooling are a change of the network's free run over ``trend_s`` [s] faster than
    ``steady_K_h`` [K/h]."""
    windows_horizons_s: tuple[Positive, ...] = (600.0, 1800.0)
    free_run_horizons_s: tuple[Positive, ...] = (3600.0, 14400.0)
    """Times since the last measured temperature that part the regimes, rising [s]."""
    steps: tuple[Share, ...] = (0.0, 0.003, 0.01, 0.03)
    """Steps with which the width may follow earlier errors of a day; training days left out choose,
    0 for not at all."""


def state_words(physics: Floats, step: float, how: SpindleIntervals) -> Labels:
    """Whether a temperature warms, cools or is steady at each step, (T,), from its past.

    ``physics`` (T,) is the free run of the network [degC], ``step`` in s.
    """
    at = np.arange(len(physics))
    before = np.maximum(at - max(round(how.trend_s / step), 1), 0)
    hours = np.maximum(at - before, 1) * step / 3600
    rate = (physics - physics[before]) / hours
    words = np.where(rate > how.steady_K_h, "warming", "steady")
    return np.where(rate < -how.steady_K_h, "cooling", words)


def horizon_words(since: Floats, edges: tuple[float, ...]) -> Labels:
    """Age of the temperature reading in words, (T,); empty where it is missing.

    Examples
    --------
    >>> horizon_words(np.array([0.0, 700.0, 3000.0]), (600.0, 1800.0)).tolist()
    ['up to 10 min', 'up to 30 min', 'over 30 min']
    """
    names = [f"up to {edge / 60:g} min" for edge in edges]
    names.append(f"over {edges[-1] / 60:g} min" if edges else "")
    found = np.array(names)[np.searchsorted(np.array(edges), np.nan_to_num(since), side="left")]
    return np.where(np.isfinite(since), found, "")


def regimes(
    physics: Floats, since: Floats, step: float, how: SpindleIntervals, edges: tuple[float, ...]
) -> Labels:
    """Regime of the prediction interval at each step, (T,): state, then horizon.

    ``physics`` (T,) is the free run of the network [degC], ``since`` (T,) the time since the last
    measured temperature that the prediction looks at [s], ``edges`` those of the horizons [s].
    """
    states = state_words(physics, step, how)
    return np.char.add(np.char.add(states, ", "), horizon_words(since, edges)).astype(str)


def with_interval(
    served: pd.DataFrame, step: float, how: SpindleIntervals, factor: float = 1.0
) -> pd.DataFrame:
    """A served free run with its 90 % interval, ``low`` and ``high`` [degC].

    ``served`` holds ``spindle_temperature`` and ``physics`` [degC] by ``step`` [s]; ``factor`` on
    the half widths counts conditions beyond those that were learnt [1].
    """
    physics = served["physics"].to_numpy(float)
    since = np.arange(len(physics), dtype=np.float64) * np.float64(step)
    words = regimes(physics, since, step, how, how.free_run_horizons_s)
    predicted = served[TARGET].to_numpy(float)
    low, high = interval(predicted, words, how.free_run)
    return served.assign(
        low=predicted + factor * (low - predicted), high=predicted + factor * (high - predicted)
    )
