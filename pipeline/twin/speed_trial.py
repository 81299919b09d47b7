"""What a speed loop is put through: a step of the speed, one of the load, ramps of the position."""

from dataclasses import dataclass, fields, replace
from math import isfinite, nan, pi

import numpy as np
import numpy.typing as npt

from pipeline.twin.three_loop import follow_position, follow_speed
from pipeline.twin.three_loop_parameters import ThreeLoopParameters

Floats = npt.NDArray[np.float64]

RPM = 2 * pi / 60
"""[rad/s]."""


@dataclass(frozen=True, kw_only=True)
class SpeedTrial:
    """What the speed loops are put through.

    Parameters
    ----------
    speed : float
        Height of the step [rad/s].
    load : float
        Force on the carriage that follows on it [N].
    duration : float
        Of each of both [s].
    feeds : tuple of float
        Feeds of the ramps [m/s].
    way : float
        Length of the ramps [m].
    acceleration : float
        At both ends of a ramp [m/s^2].
    period : float
        Between samples [s].

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    speed: float = 1000 * RPM
    load: float = 2000.0
    duration: float = 0.15
    feeds: tuple[float, ...] = (1.5 / 60, 3.0 / 60)
    way: float = 0.1
    acceleration: float = 1.0
    period: float = 1e-4

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            for one in value if item.name == "feeds" else (value,):
                if not (isfinite(one) and one > 0):
                    raise ValueError(f"trial.{item.name} = {value} must be finite and positive")


@dataclass(frozen=True, kw_only=True)
class StepResponse:
    """How a speed follows a step, and a step of the load after it.

    Parameters
    ----------
    settling_2, settling_01 : float
        Time after which the speed stays within 2 % and 0.1 % of the step [s]; nan for never.
    overshoot : float
        Share of the step [1].
    dip : float
        Greatest loss of speed under the load, as a share of the step [1].
    recovery : float
        Time after which the speed under load stays within 2 % of the step [s]; nan for never.
    cost : float
        Integral of time times absolute error over both [rad s].
    """

    settling_2: float
    settling_01: float
    overshoot: float
    dip: float
    recovery: float
    cost: float


def settling_time(time: Floats, error: Floats, band: float) -> float:
    """Return the time after which an error stays within a band; nan when it is outside at the end.

    Parameters
    ----------
    time, error : ndarray, shape (T,)
        [s], and any unit.
    band : float
        In the error's unit.
    """
    outside = np.flatnonzero(~(np.abs(error) <= band))
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    return nan if last + 1 == time.size else float(time[last + 1] - time[0])


def step_response(
    drive: ThreeLoopParameters, trial: SpeedTrial, direction: int = 1
) -> StepResponse:
    """Return what a step of the speed, and then one of the load, do to a drive.

    Parameters
    ----------
    drive : ThreeLoopParameters
        The axis; its position loop stays open.
    trial : SpeedTrial
        Steps and how long they are watched.
    direction : int
        1 or -1, of the speed; the load is against it.

    Raises
    ------
    ValueError
        When the drive runs away.
    """
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
    """Return positions [m] of a ramp with constant acceleration at its ends, and a rest after it.

    Parameters
    ----------
    feed : float
        [m/s]; where the way is too short for it the peak is lower.
    trial : SpeedTrial
        Way, acceleration and period.
    """
    a = trial.acceleration
    peak = min(feed, np.sqrt(a * trial.way))
    rise, total = peak / a, trial.way / peak + peak / a
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
    """Return the greatest distance of the carriage from a ramp [m].

    Parameters
    ----------
    drive : ThreeLoopParameters
        The axis, with a position loop.
    feed : float
        [m/s].
    trial : SpeedTrial
        Way, acceleration and period.
    feedforward : float
        Share of the reference's velocity that is fed forward [1].
    direction : int
        1 or -1.

    Raises
    ------
    ValueError
        When there is no position loop, or the drive runs away.
    """
    if drive.position_loop is None:
        raise ValueError("drive.position_loop is missing: a ramp of positions needs one")
    outer = replace(drive.position_loop, velocity_feedforward=feedforward)
    trace = follow_position(
        direction * ramp(feed, trial), trial.period, replace(drive, position_loop=outer)
    )
    return float(np.abs(trace.reference - trace.position).max())
