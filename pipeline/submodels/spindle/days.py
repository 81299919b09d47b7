"""Day of a spindle, predicted in windows and as a free run, with 90 % prediction intervals.

In windows the temperature is measured at the start of each, then only speed, load and states are
known; as a free run it is measured once, at the day's beginning.  The first hour after a start and
the cooling of a spindle that stands are shown apart: there a model that only follows is wrong.

Regimes of the intervals follow from the information at the time of the prediction: whether the
network's free run warms, cools or is steady, and how long ago the temperature was measured.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.predictions import AGAIN
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged, Share
from pipeline.schema.verdict import Fact
from pipeline.signals.windows import StateSegment
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import Labels, adaptive, interval
from pipeline.submodels.contract import IntervalLimits, Prediction, SeenInputs
from pipeline.twin.spindle import (
    TARGET,
    SpindleIntervals,
    SpindleModel,
    SpindleRecords,
    spindle_stretches,
    window_starts,
)

BASELINE_TITLES = {
    "persistence": "the temperature stays as it is", "physics": "physics alone",
    "forest": "with the forest", "day_mean": "day’s mean",
}  # fmt: skip
"""Baselines in words."""


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


WINDOWS, FREE_RUN = "windows", "free run"
"""Regimes: from a measured temperature over a window; from the day's first temperature only."""
FIRST_HOUR, COOLING = "first hour after a start", "cooling"
"""Parts of a day that are shown apart, of both regimes."""
APART = tuple(
    f"{regime}, {part}" for regime in (WINDOWS, FREE_RUN) for part in (FIRST_HOUR, COOLING)
)
"""Regimes of the parts that are shown apart."""
START_S = 3600.0
"""Time after a start that is shown apart [s]."""


@dataclass(frozen=True, kw_only=True)
class SpindleLimits(IntervalLimits, section="spindle_limits"):
    """Limits on the errors of a spindle's temperature (Twin2026)."""

    window_s: Positive = 3600.0
    """Length of the windows that start from a measured temperature [s]."""
    mae_K: Positive = 2.0
    rmse_K: Positive = 3.0
    """Limits on every working day, in windows [K]."""
    working_day_s: Positive = 3600.0
    """Least recorded time of a working day [s]."""
    bridge_s: NotNegative = 600.0
    """Longest gap over which the inputs of a window are held [s]."""
    rest_s: Positive = 3600.0
    """A spindle that turns after this long at rest, or for the first time of a day, starts [s]."""
    pause_s: Positive = 600.0
    """A spindle that has stood this long cools [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Predictions of one day in one regime, (T,) each, in steps; NaN without data."""

    index: pd.DatetimeIndex
    """Time of each step, in the plant's zone."""
    measured: Floats
    predicted: Floats
    physics: Floats
    persistence: Floats
    """Temperatures [degC]: measured, of the whole model, of the network alone, as it was given."""
    regime: Labels
    """Regime of the prediction interval."""
    again: Floats
    """Predictions of the whole model with other training seeds; shape (K, T)."""

    @property
    def seconds(self) -> Floats:
        """Time since midnight of the plant [s]."""
        return np.asarray((self.index - self.index[0].normalize()).total_seconds(), dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class DayRuns:
    """A day's whole stretch, and its predictions in windows and as a free run."""

    stretch: StateSegment
    windows: Run
    free_run: Run


def stretches(
    model: SpindleModel, state: pd.DataFrame, day: str, bridge_s: float
) -> Iterator[StateSegment]:
    """Stretches of a day, however short, over gaps of up to ``bridge_s`` [s]."""
    yield from spindle_stretches(
        state, day, model.records, step=model.step_s, bridge_s=bridge_s, shortest_s=0.0
    )


def runs_of(
    model: SpindleModel,
    state: pd.DataFrame,
    day: str,
    *,
    window_s: float,
    bridge_s: float,
    intervals: SpindleIntervals,
) -> DayRuns | None:
    """A day in windows and as a free run; None without speed, load or temperature.

    ``window_s`` and ``bridge_s`` [s] are the length of a window, and how long unknown inputs are
    held in windows; ``intervals`` says how regimes of the prediction interval are parted.
    """
    whole = list(stretches(model, state, day, np.inf))
    if not whole:
        return None
    free = whole[0]
    measured = free.frame[TARGET].to_numpy(float)
    physics, (corrected, *again) = model.free_run(free)
    compared = np.isfinite(measured) & np.isfinite(corrected)
    # persistence of a free run is the first temperature that is compared
    first = float(measured[compared][0]) if compared.any() else float("nan")
    since = np.arange(len(measured), dtype=np.float64) * np.float64(free.step)
    index = pd.DatetimeIndex(free.frame.index)
    free_run = Run(
        index=index, measured=measured, predicted=corrected, physics=physics,
        persistence=np.full(len(measured), first),
        regime=regimes(physics, since, free.step, intervals, intervals.free_run_horizons_s),
        again=np.reshape(again, (-1, len(measured))),
    )  # fmt: skip
    others = [f"{AGAIN}{k}" for k in range(len(again))]
    columns = pd.DataFrame(
        np.nan, index=index, columns=["physics", "persistence", "since", "predicted", *others]
    )
    for stretch in stretches(model, state, day, bridge_s):
        alone, own, persistence = model.windows(stretch, window_s)
        at = np.full(len(alone), np.nan)
        length = max(round(window_s / stretch.step), 1)
        for start in window_starts(stretch.frame[TARGET].to_numpy(float), length):
            part = at[start : start + length]
            part[:] = np.arange(len(part)) * stretch.step
        columns.loc[stretch.frame.index] = np.column_stack([alone, persistence, at, *own])
    windows = replace(
        free_run,
        predicted=columns["predicted"].to_numpy(), physics=columns["physics"].to_numpy(),
        persistence=columns["persistence"].to_numpy(),
        regime=regimes(
            physics, columns["since"].to_numpy(), free.step, intervals,
            intervals.windows_horizons_s,
        ),
        again=columns[others].to_numpy().T,
    )  # fmt: skip
    return DayRuns(stretch=free, windows=windows, free_run=free_run)


def after_starts(frame: pd.DataFrame, step: float, rest_s: float) -> Bools:
    """Whether the spindle started within the last hour, (T,).

    A start is the first step that turns the spindle, or holds it in position, on a day or after
    ``rest_s`` without either.
    """
    warmed = heated(frame)
    at = np.arange(len(frame))
    last = np.maximum.accumulate(np.where(warmed, at, -1))
    before = np.concatenate([[-1], last[:-1]])
    starts = warmed & ((before < 0) | ((at - before) * step > rest_s))
    latest = np.maximum.accumulate(np.where(starts, at, -1))
    return (latest >= 0) & ((at - latest) * step < START_S)


def cooling(frame: pd.DataFrame, step: float, pause_s: float) -> Bools:
    """Whether the spindle turned or was held earlier this day and has stood ``pause_s``, (T,)."""
    at = np.arange(len(frame))
    last = np.maximum.accumulate(np.where(heated(frame), at, -1))
    return (last >= 0) & ((at - last) * step > pause_s)


def heated(frame: pd.DataFrame) -> Bools:
    """Whether the spindle turns or is held in position, (T,)."""
    return (frame[["bearing_friction", "position_hold"]] > 0).any(axis=1).to_numpy()


def predicted_day(
    model: SpindleModel,
    case: Case,
    limits: SpindleLimits,
    intervals: SpindleIntervals | None,
    tried: SpindleModel | None = None,
) -> Prediction:
    """A day in windows and as a free run; nothing where it is no working day.

    ``tried`` is the network with its forest where the forest is not used: shown beside it.
    """
    state = case.load()
    whole = list(stretches(model, state, case.name, np.inf))
    known = sum((len(s.frame) - s.bridged) * s.step for s in whole)
    day = other = None
    if known >= limits.working_day_s:
        how = intervals or SpindleIntervals()
        day, other = (
            None if one is None else runs_of(
                one, state, case.name, window_s=limits.window_s, bridge_s=limits.bridge_s,
                intervals=how,
            )
            for one in (model, tried)
        )  # fmt: skip
    if day is None:
        note = f"no working day: {known:.0f} s with speed, load and temperature"
        return Prediction(frame=pd.DataFrame(), note=note)
    windows = _rows(day.windows, WINDOWS, None if other is None else other.windows)
    free_run = _rows(day.free_run, FREE_RUN, None if other is None else other.free_run)
    if intervals is not None:
        own = day.windows
        windows["low"], windows["high"] = adaptive(
            own.seconds, own.measured, own.predicted, own.regime, intervals.windows,
            intervals.follow,
        )  # fmt: skip
        own = day.free_run
        free_run["low"], free_run["high"] = interval(own.predicted, own.regime, intervals.free_run)
    frame, step = day.stretch.frame, day.stretch.step
    parts = {
        FIRST_HOUR: after_starts(frame, step, limits.rest_s),
        COOLING: cooling(frame, step, limits.pause_s),
    }
    apart = [
        rows[where].assign(regime=f"{regime}, {part}")
        for regime, rows in ((WINDOWS, windows), (FREE_RUN, free_run))
        for part, where in parts.items()
        if where.any()
    ]
    seconds = int(windows["scored"].sum()) * step
    facts = {
        "compared in windows": Fact(value=round(seconds), unit="s"),
        "windows": Fact(value=int(np.ceil(seconds / limits.window_s)), unit="1"),
        "compared over whole days": Fact(
            value=round(int(free_run["scored"].sum()) * step), unit="s"
        ),
    }
    return Prediction(
        frame=pd.concat([windows, free_run, *apart], ignore_index=True), facts=facts,
        seen=(_seen(day, model.records),),
    )  # fmt: skip


def _seen(day: DayRuns, records: SpindleRecords) -> SeenInputs:
    """Temperature of a day, the network's free run, and what network and forest look at."""
    frame, run = day.stretch.frame, day.free_run
    wanted = dict.fromkeys((*records.inputs, *records.extra))
    inputs = {name: frame[name].to_numpy(float) for name in wanted if name in frame.columns}
    return SeenInputs(
        quantity=TARGET, t=run.seconds, measured=run.measured,
        inputs={"temperature of the network": run.physics, **inputs},
    )  # fmt: skip


def _rows(run: Run, regime: str, tried: Run | None) -> pd.DataFrame:
    """Rows of a day: ``t`` in seconds since midnight of the plant."""
    known = [run.measured, run.predicted, *([run.persistence] if regime == WINDOWS else [])]
    found = pd.DataFrame(
        {
            "quantity": TARGET, "unit": "CELSIUS", "regime": regime, "t": run.seconds,
            "measured": run.measured, "predicted": run.predicted,
            "baseline_persistence": run.persistence, "baseline_physics": run.physics,
            "baseline_day_mean": float(np.nanmean(run.measured)),
            "scored": np.isfinite(known).all(axis=0),
            **{f"{AGAIN}{k}": one for k, one in enumerate(run.again)},
        }
    )  # fmt: skip
    return found if tried is None else found.assign(baseline_forest=tried.predicted)
