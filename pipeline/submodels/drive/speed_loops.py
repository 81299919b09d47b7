"""PI against fuzzy PI: a step of speed, a step of load, ramps (Feed2025); all of it simulated.

Both kinds stand around the same motor, shaft, friction and limits, and both can be tuned by the
same search with the same number of trials for the same cost: the integral of time times absolute
speed error over a step of the speed and over a step of the load, each counted from its own start,
up and down.

On an axis as identified there are three sets of gains: its own, those of Feed2025, and both kinds
tuned alike.  Current loops and inverter
are not identified: the loops run at 10 kHz with a bandwidth of 500 Hz, dead time is left out, and
so is a play between screw and carriage.  The step's ripple is that of the switched inverter.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite, nan, pi
from typing import Any

import numpy as np
import pandas as pd

from pipeline.machine.axis.drive_train import TransmissionParameters
from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    FuzzyParameters,
    PositionLoopParameters,
    SpeedLoopParameters,
)
from pipeline.machine.axis.motor import InverterParameters, MotorParameters
from pipeline.machine.axis.three_loop import ThreeLoopParameters, follow_position, follow_speed
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import (
    MOTOR,
    DriveAxis,
    DriveModel,
    Shaft,
    SpeedLoop,
    SpeedLoops,
)
from pipeline.schema.model import Parameter, significant
from pipeline.schema.ranges import Positive, Ranged
from pipeline.schema.si import RPM
from pipeline.search.methods import minimise
from pipeline.search.result import SearchResult
from pipeline.submodels.drive.records import MotorRecords

_short = partial(significant, digits=4)
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
    """Time after which an error stays within plus and minus ``band`` [s]; nan where it does not."""
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


CURRENT_LOOP = CurrentLoopParameters(bandwidth=2 * pi * 500)
"""Current loops of usual drives: 100 us (Siemens: SINAMICS S120 function manual)."""
POPULATION, GENERATIONS = 10, 8
"""Budget of the tuning of each kind."""
FEED = 1.5 / 60
"""Feed of the ramp [m/s]."""
DRAWN = 250
"""Points of a stored response [1]."""
STEADY = 0.2
"""Last share of the step over which the ripple is taken [1]."""
PAPER = (("PI", 0.064, 28.1), ("fuzzy PI", 0.060, 13.6))
"""Feed2025 at 1000 rev/min: kind, error of the speed [%], time until it is reached [ms]."""


def compared_loops(
    axes: Mapping[str, DriveAxis], parameters: Mapping[str, Mapping[str, Parameter]],
    shafts: Mapping[str, Shaft], records: MotorRecords | None,
) -> SpeedLoops | None:  # fmt: skip
    """Speed loops on the axis whose motor was recorded; None without one."""
    if records is None or records.axis not in axes:
        return None
    letter = records.axis
    try:
        drive = as_identified(axes[letter], letter, parameters, shafts.get(letter), records)
        loops = tuple(_loops(drive, axes[letter]))
    except ValueError as error:
        return SpeedLoops(axis=letter, reason=str(error))
    return SpeedLoops(axis=letter, loops=loops)


def as_identified(
    axis: DriveAxis, letter: str, parameters: Mapping[str, Mapping[str, Parameter]],
    shaft: Shaft | None, records: MotorRecords,
) -> ThreeLoopParameters:  # fmt: skip
    """Axis to its currents, with its gains; ValueError for an undetermined parameter."""
    own, motor = parameters[letter], parameters.get(MOTOR, {})
    servo = axis.servo
    if shaft is None or shaft.lead is None:
        raise ValueError("the shaft was not recorded at both ends, or the screw's lead not listed")
    if records.dc_link is None:
        raise ValueError("drive_records.motor.dc_link, the inverter's voltage, is not listed")
    if servo is None or servo.current_limit is None:
        raise ValueError("the loops were not found, or no current_limit is listed")
    ratio, k = shaft.lead / (2 * pi), axis.feed_drive.force_constant

    def known(group: Mapping[str, Parameter], name: str) -> float:
        found = group.get(name)
        if found is None or found.value is None:
            raise ValueError(f"{name} is not determined")
        return found.value

    motor_mass, stiffness = known(own, "motor_mass"), known(own, "shaft_stiffness")
    damping = own["shaft_damping"].value or 0.0
    load = axis.feed_drive.mass - motor_mass
    return ThreeLoopParameters(
        motor=MotorParameters(
            resistance=known(motor, "R"), inductance_d=known(motor, "L_d"),
            inductance_q=known(motor, "L_q"), flux=known(motor, "flux"),
            pole_pairs=records.pole_pairs, inertia=motor_mass * ratio**2,
        ),
        inverter=InverterParameters(dc_link=records.dc_link),
        transmission=TransmissionParameters(
            lead=shaft.lead, mass=load, axial_stiffness=stiffness,
            internal_damping=damping * ratio**2,
        ),
        friction=axis.feed_drive.friction,
        current_loop=CURRENT_LOOP,
        speed_loop=SpeedLoopParameters(
            torque_limit=servo.current_limit * k * ratio,
            proportional=servo.velocity_gain * servo.velocity_scale * k * ratio**2,
            integral=servo.integral_gain * servo.integral_scale * k * ratio**2,
        ),
        position_loop=PositionLoopParameters(gain=servo.position_gain * servo.position_scale),
    )  # fmt: skip


def _loops(drive: ThreeLoopParameters, axis: DriveAxis) -> Iterator[SpeedLoop]:
    trial = SpeedTrial(feeds=(FEED,))
    search = partial(minimise, "genetic", population=POPULATION, generations=GENERATIONS, seed=0)
    forward = 0.0 if axis.servo is None else axis.servo.velocity_feedforward
    scales = published(drive, "fuzzy PI", trial)[2:].tolist()
    own = drive.speed_loop
    rules = FuzzyParameters(error_scale=scales[0], change_scale=scales[1])
    for kind in TUNED:
        fuzzy = None if kind == "PI" else rules
        sets = {
            "as found": replace(drive, speed_loop=replace(own, fuzzy=fuzzy)),
            "Feed2025": with_speed_loop(drive, kind, published(drive, kind, trial)),
            "tuned alike": tuned(drive, kind, trial, search),
        }
        for gains, one in sets.items():
            yield _tried(one, kind, gains, trial, forward)


def _tried(
    drive: ThreeLoopParameters, kind: str, gains: str, trial: SpeedTrial, forward: float
) -> SpeedLoop:
    switched = replace(drive, inverter=replace(drive.inverter, switched=True))
    samples = round(trial.duration / trial.period) + 1
    trace = follow_speed(np.full(samples, trial.speed), trial.period, switched)
    share = trace.speed / trial.speed
    settled = settling_time(trace.time, 1 - share, 0.001)
    last = share[-round(STEADY * samples) :]
    following = ramp_error(drive, FEED, trial, feedforward=forward, direction=1)
    rows = np.unique(np.linspace(0, samples - 1, DRAWN).astype(int))
    return SpeedLoop(
        kind=kind, gains=gains, proportional=_short(drive.speed_loop.proportional),
        integral=_short(drive.speed_loop.integral),
        settling_ms=_ms(settled),
        reaching_ms=_ms(settling_time(trace.time, 1 - share, 0.02)),
        overshoot_percent=_short(100 * max(0.0, float(share.max()) - 1)),
        ripple_percent=_short(50 * float(np.ptp(last))) if isfinite(settled) else None,
        following_um=_short(1e6 * following),
        time_ms=tuple(_short(1e3 * t) for t in trace.time[rows].tolist()),
        speed_percent=tuple(round(100 * s, 3) for s in share[rows].tolist()),
    )  # fmt: skip


def _ms(seconds: float) -> float | None:
    return _short(1e3 * seconds) if isfinite(seconds) else None


def verdict_words(loops: SpeedLoops) -> str:
    """Whether a fuzzy speed loop is worth anything on this axis, in one sentence."""
    if loops.reason:
        return f"PI and fuzzy PI were not held against each other: {loops.reason}."
    both = {one.kind: one for one in loops.loops if one.gains == "tuned alike"}
    plain, fuzzy = both["PI"], both["fuzzy PI"]
    if plain.settling_ms is None or fuzzy.settling_ms is None or plain.following_um is None:
        return "Tuned alike, not both loops settle to 0.1 %: neither is called better."
    saved = 1 - fuzzy.settling_ms / plain.settling_ms
    nearer = 1 - (fuzzy.following_um or 0.0) / plain.following_um
    worth = saved > WORTH or nearer > WORTH
    worse = saved < -WORTH or nearer < -WORTH
    word = "helps in part" if worth and worse else "helps" if worth else "is not worth its rules"
    return (
        f"On this axis fuzzy PI {word}: tuned alike it settles in {fuzzy.settling_ms:g} ms against "
        f"{plain.settling_ms:g} ms of PI, and follows a ramp within {fuzzy.following_um:g} µm "
        f"against {plain.following_um:g} µm (simulated on the axis as identified)."
    )


WORTH = 0.1
"""Least share of time or error that fuzzy rules must save to be worth their upkeep [1]."""


def shaft_figures(model: DriveModel) -> dict[str, Any]:
    """Parameters of shafts and the speed loops, for the metrics."""
    names = ("shaft_stiffness", "shaft_damping", "backlash", "motor_mass")
    figures: dict[str, Any] = {
        f"shaft {letter}": {
            name: {"value": p.value, "interval_95": p.interval_95, "unit": p.unit}
            for name in names if (p := model.parameters[letter].get(name)) is not None
        }
        for letter in model.shafts
    }  # fmt: skip
    found = model.speed_loops
    if found is None:
        return figures
    figures[f"speed loops {found.axis}"] = {"reason": found.reason} if found.reason else {
        f"{one.kind}, {one.gains}": {
            "settling_ms": one.settling_ms, "reaching_ms": one.reaching_ms,
            "overshoot_percent": one.overshoot_percent, "ripple_percent": one.ripple_percent,
            "following_um": one.following_um,
        }
        for one in found.loops
    }  # fmt: skip
    return figures
