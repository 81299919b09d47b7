"""Trial of speed loops, PI against fuzzy PI: a step of speed, a step of load, ramps (Feed2025).

Both kinds stand around the same motor, shaft, friction and limits, and both can be tuned by the
same search with the same number of trials for the same cost: the integral of time times absolute
speed error over a step of the speed and over a step of the load, each counted from its own start,
up and down.  All of it is simulated.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan
from typing import Protocol

import numpy as np
import pandas as pd

from pipeline.machine.axis.loops import FuzzyParameters
from pipeline.machine.axis.three_loop import follow_position, follow_speed
from pipeline.machine.axis.three_loop_axis import ThreeLoopParameters
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Ranged
from pipeline.schema.si import RPM

TUNED = {
    "PI": {"proportional": (0.05, 10.0), "integral": (2.0, 4000.0)},
    "fuzzy PI": {
        "proportional": (0.05, 10.0),
        "integral": (2.0, 4000.0),
        "error_scale": (0.01, 10.0),
        "change_scale": (1e-5, 1e-1),
    },
}
"""Bounds of the tuned parameters: gains (for fuzzy the output scales, middle and span
together), and the input scales; all on a logarithmic scale."""


class SearchResult(Protocol):
    """Result of a search."""

    @property
    def x(self) -> Floats:
        """The best individual, shape (D,)."""


Search = Callable[[Callable[[Floats], Floats], Floats, Floats], SearchResult]
"""Takes costs (P, D) -> (P,) and both bounds, shape (D,)."""


@dataclass(frozen=True, kw_only=True)
class SpeedTrial(Ranged, section="trial"):
    """Steps and ramps that a speed loop is tested with."""

    speed: Positive = 1000 * RPM
    """Height of the step [rad/s]."""
    load: Positive = 2000.0
    """Force on the carriage that follows on it [N]."""
    duration: Positive = 0.15
    """Duration of each of both [s]."""
    feeds: tuple[Positive, ...] = (1.5 / 60, 3.0 / 60)
    """Feeds of the ramps [m/s]."""
    stroke: Positive = 0.1
    """Length of the ramps [m]."""
    acceleration: Positive = 1.0
    """Acceleration at both ends of a ramp [m/s^2]."""
    period: Positive = 1e-4
    """Sampling period [s]."""


@dataclass(frozen=True, kw_only=True)
class StepResponse:
    """Response of the speed to a step, and to a step of the load after it."""

    settling_2: float
    settling_01: float
    """Time after which the speed stays within 2 % and 0.1 % of the step [s]; nan for never."""
    overshoot: float
    """Share of the step [1]."""
    dip: float
    """Greatest loss of speed under the load, as a share of the step [1]."""
    recovery: float
    """Time after which the speed under load stays within 2 % of the step [s]; nan for never."""
    cost: float
    """Integral of time times absolute error over both [rad s]."""


def settling_time(time: Floats, error: Floats, band: float) -> float:
    """Time after which an error stays within a band [s]; nan when it is outside at the end.

    Parameters
    ----------
    time, error : ndarray, shape (T,)
        [s], and any unit.
    band : float
        Half width of the band, in the error's unit.
    """
    outside = np.flatnonzero(~(np.abs(error) <= band))
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    return nan if last + 1 == time.size else float(time[last + 1] - time[0])


def step_response(
    drive: ThreeLoopParameters, trial: SpeedTrial, direction: int = 1
) -> StepResponse:
    """Response of a drive to a step of the speed, and then one of the load."""
    half = round(trial.duration / trial.period)
    load = np.zeros(2 * half + 1)
    load[half:] = direction * trial.load
    speed = np.full(load.size, direction * trial.speed)
    trace = follow_speed(speed, trial.period, drive, load=load)
    error = 1 - trace.speed / speed
    time = trace.time[: half + 1]
    first, second = error[: half + 1], error[half:]
    cost = trial.speed * np.trapezoid(time * (np.abs(first) + np.abs(second)), time)
    return StepResponse(
        settling_2=settling_time(time, first, 0.02),
        settling_01=settling_time(time, first, 0.001),
        overshoot=max(0.0, float(-first.min())),
        dip=max(0.0, float(second.max())),
        recovery=settling_time(time, second, 0.02),
        cost=float(cost),
    )


def ramp(feed: float, trial: SpeedTrial) -> Floats:
    """Positions [m] of a ramp with constant acceleration at its ends, and a rest after it.

    Where the stroke is too short for ``feed`` [m/s] the peak is lower.
    """
    a = trial.acceleration
    peak = min(feed, np.sqrt(a * trial.stroke))
    rise, total = peak / a, trial.stroke / peak + peak / a
    t = trial.period * np.arange(round((total + trial.duration) / trial.period) + 1)
    up = a * np.minimum(t, rise) ** 2 / 2
    on = peak * np.clip(t - rise, 0, total - 2 * rise)
    left = np.clip(total - t, 0, rise)
    down = a * (rise**2 - left**2) / 2
    return np.asarray(up + on + down)


def ramp_error(
    drive: ThreeLoopParameters,
    feed: float,
    trial: SpeedTrial,
    *,
    feedforward: float,
    direction: int,
) -> float:
    """Greatest distance of the carriage from a ramp [m].

    The ramp has the speed ``feed`` [m/s] in the ``direction`` 1 or -1; ``feedforward`` is the share
    of it that is fed forward [1].
    """
    if drive.position_loop is None:
        raise ValueError("drive.position_loop is missing: a ramp of positions needs one")
    outer = replace(drive.position_loop, velocity_feedforward=feedforward)
    trace = follow_position(
        direction * ramp(feed, trial), trial.period, replace(drive, position_loop=outer)
    )
    return float(np.abs(trace.reference - trace.position).max())


def with_speed_loop(drive: ThreeLoopParameters, kind: str, values: Floats) -> ThreeLoopParameters:
    """Drive with a speed loop of a kind of ``TUNED`` and these values, shape (D,)."""
    named = dict(zip(TUNED[kind], map(float, values), strict=True))
    fuzzy = None
    if "error_scale" in named:
        fuzzy = FuzzyParameters(
            error_scale=named["error_scale"], change_scale=named["change_scale"]
        )
    loop = replace(
        drive.speed_loop,
        proportional=named["proportional"],
        integral=named["integral"],
        fuzzy=fuzzy,
    )
    return replace(drive, speed_loop=loop)


def published(drive: ThreeLoopParameters, kind: str, trial: SpeedTrial) -> Floats:
    """Feed2025's gains, and input scales that the step and its acceleration just fill.

    The input scales are not published; full torque on the whole inertia is the greatest change.
    """
    inertia = drive.motor.inertia + drive.transmission.load_inertia
    fastest = drive.speed_loop.torque_limit / inertia
    values = [0.5, 40.0, 10 / trial.speed, 10 / fastest]
    return np.array(values[: len(TUNED[kind])])


def tuned(
    drive: ThreeLoopParameters, kind: str, trial: SpeedTrial, search: Search
) -> ThreeLoopParameters:
    """Drive with the best speed loop of a search.

    ``search`` takes costs over a population and both bounds, and returns the best individual as
    ``x``, in logarithms to the base 10.
    """

    def costs(logarithms: Floats) -> Floats:
        drives = [with_speed_loop(drive, kind, 10.0**x) for x in logarithms]
        both = [[step_response(one, trial, sign).cost for sign in (1, -1)] for one in drives]
        return np.sum(both, axis=1)

    low, high = np.log10(np.array(list(TUNED[kind].values()))).T
    return with_speed_loop(drive, kind, 10.0 ** search(costs, low, high).x)


def compare_speed_loops(
    drive: ThreeLoopParameters, trial: SpeedTrial, search: Search | None = None
) -> pd.DataFrame:
    """PI and fuzzy PI side by side, with Feed2025's gains and tuned.

    A row each for gains, speed loop and direction of the step. The columns carry their units;
    errors of the ramps are the carriage's, without and with velocity feed-forward.
    """
    rows = []
    for kind in TUNED:
        loops = {"Feed2025": with_speed_loop(drive, kind, published(drive, kind, trial))}
        if search is not None:
            loops["tuned"] = tuned(drive, kind, trial, search)
        for gains, one in loops.items():
            for direction in (1, -1):
                head = {"gains": gains, "speed loop": kind, "direction": direction}
                rows.append(head | _figures(one, trial, direction))
    return pd.DataFrame(rows).set_index(["gains", "speed loop", "direction"]).sort_index()


def _figures(drive: ThreeLoopParameters, trial: SpeedTrial, direction: int) -> dict[str, float]:
    step = step_response(drive, trial, direction)
    figures = {
        "settling to 2 % [ms]": 1e3 * step.settling_2,
        "settling to 0.1 % [ms]": 1e3 * step.settling_01,
        "overshoot [%]": 100 * step.overshoot,
        "dip under load [%]": 100 * step.dip,
        "recovery [ms]": 1e3 * step.recovery,
        "cost [mrad s]": 1e3 * step.cost,
    }
    for feed in trial.feeds:
        for feedforward in (0, 1):
            error = ramp_error(drive, feed, trial, feedforward=feedforward, direction=direction)
            name = f"error at {60e3 * feed:g} mm/min, feed-forward {feedforward} [mm]"
            figures[name] = 1e3 * error
    return figures
