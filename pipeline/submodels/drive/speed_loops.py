"""PI against fuzzy PI on an axis as identified: motor, two masses on their shaft, friction.

Three sets of gains: those of the identified axis, those of Feed2025, and both kinds tuned by
the same search with the same number of evaluations for the same cost.  Current loops and inverter
are not identified: the loops run at 10 kHz with a bandwidth of 500 Hz, dead time is left out, and
so is a play between screw and carriage.  The step's ripple is that of the switched inverter.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from math import isfinite, pi
from typing import Any

import numpy as np

from pipeline.machine.axis.drive_parameters import DirectionFriction, FrictionParameters
from pipeline.machine.axis.drive_train import TransmissionParameters
from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    FuzzyParameters,
    PositionLoopParameters,
    SpeedLoopParameters,
)
from pipeline.machine.axis.motor import InverterParameters, MotorParameters
from pipeline.machine.axis.speed_trial import (
    TUNED,
    SpeedTrial,
    published,
    ramp_error,
    settling_time,
    tuned,
    with_speed_loop,
)
from pipeline.machine.axis.three_loop import follow_speed
from pipeline.machine.axis.three_loop_axis import ThreeLoopParameters
from pipeline.schema.drive import MOTOR, DriveAxis, DriveModel, Shaft, SpeedLoop, SpeedLoops
from pipeline.schema.model import Parameter
from pipeline.search.methods import minimise
from pipeline.submodels.drive.records import MotorRecords

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
    sides = {side: DirectionFriction(**vars(getattr(axis.feed_drive.friction, side)))
             for side in ("positive", "negative")}  # fmt: skip
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
        friction=FrictionParameters(**sides),
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


def _short(value: float) -> float:
    return float(f"{value:.4g}")


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
