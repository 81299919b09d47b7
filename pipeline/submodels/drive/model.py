"""Drives of a machine: identification of every axis and motor, and the stored model of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from pipeline.machine.axis.drive_parameters import ServoParameters, friction_force
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import (
    CurvePoint,
    DriveAxis,
    DriveMotor,
    FitFacts,
    FrictionPoint,
    RecursiveMass,
    Servo,
)
from pipeline.schema.model import Correlation, LeftOut, Parameter, significant
from pipeline.submodels.drive import loop_gain
from pipeline.submodels.drive.comparison import compared_force, constant_level
from pipeline.submodels.drive.estimates import AxisFit
from pipeline.submodels.drive.feed_drive import FeedDriveFit, identify_feed_drive
from pipeline.submodels.drive.motor import MotorFit, identify_motor
from pipeline.submodels.drive.presliding import PreslidingFit, identify_presliding
from pipeline.submodels.drive.records import (
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
    MotorRecords,
    Recording,
    of_axis,
)
from pipeline.submodels.drive.servo_fit import ServoFit, identify_servo
from pipeline.submodels.drive.shaft import ShaftFit, identify_shaft
from pipeline.twin.drive import identified_drive

CURVE = 40
"""Number of speeds of the stored friction curve in each direction [1]."""
MOTOR_NAMES = {"resistance": "R", "inductance_d": "L_d", "inductance_q": "L_q"}
"""Symbols by which a motor's parameters are stored."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentifiedAxis:
    """Everything that the recordings determine of one axis."""

    drive: FeedDriveFit
    servo: ServoFit
    presliding: PreslidingFit | None = None
    mass: RecursiveMass | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveIdentification:
    """Drives of a machine as identified from its recordings."""

    axes: Mapping[str, IdentifiedAxis]
    """Axes whose mechanics were identified, by letter."""
    open_axes: Mapping[str, str] = field(default_factory=dict)
    """Reason why an axis was not identified."""
    motor: MotorFit | None = None
    motor_axis: str = ""
    """Motor and the letter of its axis; "" without recordings of a motor."""
    motor_reason: str = ""
    """Reason why there is no motor."""
    shafts: Mapping[str, ShaftFit] = field(default_factory=dict)
    """Shafts of the axes whose both ends were recorded."""
    loop_gains: Mapping[str, loop_gain.LoopGain] = field(default_factory=dict)
    """Gains of axes with recorded commanded and actual position, with or without a torque."""


def identify_drives(
    recordings: Sequence[Recording],
    records: DriveRecords,
    prior: DrivePrior,
    settings: DriveFitSettings,
) -> DriveIdentification:
    """Everything that the recordings determine of a machine's drives."""
    training = [one for one in recordings if one.trained]
    each = [(axis, of_axis(training, axis), prior, settings) for axis in records.axes]
    tried = dict(zip(records.axes, mapped(_whole_axis, each), strict=True))
    axes = {axis: one for axis, one in tried.items() if not isinstance(one, str)}
    missing = {
        axis: _reason(recordings, axis, why) for axis, why in tried.items() if isinstance(why, str)
    }
    gains = loop_gains(training, records, settings.widest)
    if not axes and not gains:
        raise ValueError(
            "no drive can be identified: " + "; ".join(f"{a}: {why}" for a, why in missing.items())
        )
    motor, reason = _motor(recordings, records.motor, settings.widest)
    return DriveIdentification(
        axes=axes, open_axes=missing, motor=motor, shafts=_shafts(training, axes, prior, settings),
        motor_axis=records.motor.axis if records.motor else "", motor_reason=reason,
        loop_gains=gains,
    )  # fmt: skip


def loop_gains(
    training: Sequence[Recording], records: DriveRecords, widest: float
) -> dict[str, loop_gain.LoopGain]:
    """Loop gains of the axes whose commanded and actual position was recorded."""
    tracked = {axis: [one.tracked[axis] for one in training if axis in one.tracked]
               for axis in records.axes}  # fmt: skip
    tried = {axis: loop_gain.loop_gain(parts, widest) for axis, parts in tracked.items()}
    return {axis: gain for axis, gain in tried.items() if gain is not None}


def _whole_axis(
    task: tuple[str, Sequence[Recording], DrivePrior, DriveFitSettings],
) -> IdentifiedAxis | str:
    """Mechanics, loops, presliding and mass over time of an axis, or why there are none."""
    from pipeline.submodels.drive.recursive import mass_trace

    axis, training, prior, settings = task
    try:
        found = identified_axis(axis, training, prior, settings)
    except ValueError as error:
        return str(error)
    servo, spring = found.servo.servo, None
    if servo is not None:
        screw = found.drive.feed_drive
        spring = identify_presliding(training, axis, servo, screw, settings.widest)
    return replace(found, presliding=spring, mass=mass_trace(training, axis, found.drive))


def identified_axis(
    axis: str, training: Sequence[Recording], prior: DrivePrior, settings: DriveFitSettings
) -> IdentifiedAxis:
    """Mechanics and loops of one axis from recordings to train on."""
    drive = identify_feed_drive(training, axis, prior, settings)
    return IdentifiedAxis(drive=drive, servo=identify_servo(training, axis, settings))


def axis_again(
    letter: str, recordings: Sequence[Recording], axes: Mapping[str, IdentifiedAxis],
    prior: DrivePrior, settings: DriveFitSettings,
) -> DriveAxis | None:  # fmt: skip
    """The axis as some recordings tell it; None where they determine less of it than ``axes``.

    Without what no force and following error depends on: presliding, the constant level of the
    force, methods that are only compared.
    """
    try:
        own = identified_axis(letter, recordings, prior, replace(settings, compare=False))
    except ValueError:
        return None
    if not _determined_of(axes[letter]) <= _determined_of(own):
        return None
    return _axis(own)


def _determined_of(axis: IdentifiedAxis) -> set[str]:
    return {name for name, one in _fitted(axis).items() if one.determined}


def _shafts(
    training: Sequence[Recording],
    axes: Mapping[str, IdentifiedAxis],
    prior: DrivePrior,
    settings: DriveFitSettings,
) -> dict[str, ShaftFit]:
    """Shafts of the axes whose both ends were recorded."""

    def of(axis: str) -> ShaftFit | None:
        fit = axes[axis].drive
        return identify_shaft(
            training, axis, force_constant=fit.feed_drive.force_constant,
            force_unit=fit.force_unit, lead=prior.axis(axis).screw_lead, widest=settings.widest,
        )  # fmt: skip

    found = zip(axes, mapped(of, axes), strict=True)
    return {axis: shaft for axis, shaft in found if shaft is not None}


def _reason(recordings: Sequence[Recording], axis: str, otherwise: str) -> str:
    """Why an axis is not identified: what its training recordings lack, if all lack it."""
    training = [one for one in recordings if one.trained and not one.motor]
    reasons = {one.lacking[axis] for one in training if axis in one.lacking}
    silent = training and all(axis in one.lacking for one in training)
    return "; ".join(sorted(reasons)) if silent else otherwise


def _motor(
    recordings: Sequence[Recording], records: MotorRecords | None, widest: float
) -> tuple[MotorFit | None, str]:
    if records is None:
        return None, ""
    shown = [one for one in recordings if one.motor]
    if not shown:
        return None, f"no recording fits drive_records.motor.recordings = {records.recordings!r}"
    longest = max(shown, key=lambda one: one.samples)
    signals = {name: longest.motor[name] for name in ("u_d", "u_q", "i_d", "i_q")}
    signals["w_e"] = records.pole_pairs * longest.motor["speed"]
    try:
        return identify_motor(signals, period=longest.period, widest=widest, held=records.held), ""
    except ValueError as error:
        return None, f"{longest.name}: {error}"


def stored_axis(
    letter: str, estimate: IdentifiedAxis, recordings: Sequence[Recording]
) -> DriveAxis:
    """Axis as it is stored, with the mean force level of its training ``recordings``."""
    axis = _axis(estimate)
    drive = identified_drive(axis)
    shown = [one for one in recordings if one.trained and letter in one.axes]
    return replace(axis, constant_level=constant_level([compared_force(one, letter, drive)
                                                        for one in shown]))  # fmt: skip


def _axis(axis: IdentifiedAxis) -> DriveAxis:
    """Axis as it is stored, without the constant level of its force."""
    fit, servo, spring = axis.drive, axis.servo, axis.presliding
    seen = (None, None) if spring is None else (spring.stiffness, spring.time)
    stiffness, time = (significant(o.value) if o and o.determined else None for o in seen)
    return DriveAxis(
        command_unit=fit.command_unit, force_unit=fit.force_unit,
        feed_drive=fit.feed_drive,
        servo=None if servo.servo is None else _servo(servo.servo), servo_reason=servo.reason,
        friction_points=tuple(
            FrictionPoint(
                velocity_mm_s=significant(1e3 * one.velocity), force=significant(one.force),
                half_width=_known(one.half_width), seconds=round(one.seconds, 3),
            )
            for one in fit.points
        ),
        friction_curve=_curve(fit),
        methods=tuple(
            replace(one, error=None if one.error is None else _known(one.error))
            for one in (*fit.methods, *servo.methods)
        ),
        fit=replace(_facts(fit), delay_s=_known(fit.delay)), servo_fit=_facts(servo),
        recursive_mass=axis.mass, presliding_stiffness=stiffness, presliding_time_s=time,
    )  # fmt: skip


def stored_motor(fit: MotorFit, axis: str) -> DriveMotor:
    """The motor as it is stored, without its parameters."""
    names = tuple(MOTOR_NAMES.get(name, name) for name in fit.names)
    return DriveMotor(
        axis=axis, windows=fit.windows, left_out=fit.left_out, condition=_known(fit.condition),
        correlation=_correlation(names, fit.correlation),
    )  # fmt: skip


def axis_parameters(letter: str, identification: DriveIdentification) -> dict[str, Parameter]:
    """Parameters of an axis: of its mechanics, of its servo, of its position loop alone."""
    axis = identification.axes.get(letter)
    known = {} if axis is None else _fitted(axis)
    if letter in identification.loop_gains:
        known[loop_gain.NAME] = identification.loop_gains[letter].parameter
    if axis is not None and axis.presliding is not None:
        known |= axis.presliding.parameters(axis.drive.force_unit)
    if letter in identification.shafts:
        known |= identification.shafts[letter].parameters
    return known


def _fitted(axis: IdentifiedAxis) -> dict[str, Parameter]:
    fits: tuple[AxisFit, ...] = (axis.drive, axis.servo)
    return {name: _parameter(fit, i) for fit in fits for i, name in enumerate(fit.names)}


def motor_parameters(fit: MotorFit, pole_pairs: int) -> dict[str, Parameter]:
    """Parameters of the motor by their symbols; k_t = 3/2 p phi_f of an ampere's amplitude."""
    known = {MOTOR_NAMES.get(name, name): _parameter(fit, i) for i, name in enumerate(fit.names)}
    flux, factor = known["flux"], 1.5 * pole_pairs
    ends = None
    if flux.interval_95 is not None:
        low, high = flux.interval_95
        ends = significant(factor * low), significant(factor * high)
    torque = replace(
        flux, unit="N m/A", value=None if flux.value is None else significant(factor * flux.value),
        interval_95=ends,
        method=f"3/2 p flux: {flux.method}" if flux.determined else flux.method,
    )  # fmt: skip
    return known | {"torque_constant": torque}


def left_out(
    identification: DriveIdentification, recordings: Sequence[Recording]
) -> tuple[LeftOut, ...]:
    """Recordings without an axis or of another servo, and axes that no recording shows."""
    rows = [
        LeftOut(case=one.name, reason="; ".join(sorted(set(one.lacking.values()))))
        for one in recordings
        if not one.axes and not one.motor and not one.tracked
    ]
    rows += [
        LeftOut(case="all of them", reason=f"axis {axis}: {why}")
        for axis, why in identification.open_axes.items()
    ]
    rows += [
        LeftOut(
            case=name,
            reason=f"servo of axis {letter}: taken with other gains than the first recording",
        )
        for letter, axis in identification.axes.items()
        for name in axis.servo.left_out
    ]
    if identification.motor_reason:
        rows.append(LeftOut(case="the motor's", reason=identification.motor_reason))
    return tuple(rows)


def _servo(servo: ServoParameters) -> Servo:
    """Loops as stored: an infinite limit is none."""
    return Servo(**{k: v for k, v in asdict(servo).items() if not np.isinf(v)})


def _parameter(fit: AxisFit, i: int) -> Parameter:
    return Parameter.estimated(
        float(fit.values[i]), float(fit.low[i]), float(fit.high[i]), fit.units[i],
        method=fit.how[i], remedy=fit.remedy[i], determined=bool(fit.determined[i]),
    )  # fmt: skip


def _facts(fit: AxisFit) -> FitFacts:
    error = fit.relative_error_percent
    return FitFacts(
        samples=fit.samples, bandwidth_Hz=_known(fit.bandwidth_Hz), condition=_known(fit.condition),
        relative_error_percent=round(float(error), 3) if np.isfinite(error) else None,
        rank=fit.rank, correlation=_correlation(fit.correlated, fit.correlation),
    )  # fmt: skip


def _correlation(names: tuple[str, ...], values: Floats) -> Correlation:
    rounded: list[list[float]] = np.round(values, 3).tolist()
    return Correlation(names=names, values=tuple(map(tuple, rounded)))


def _curve(fit: FeedDriveFit) -> tuple[CurvePoint, ...]:
    """Friction and offset over speed, from the slowest to the fastest point in each direction."""
    speeds = np.abs([one.velocity for one in fit.points])
    if not len(speeds):
        return ()
    steps = np.geomspace(0.8 * speeds.min(), speeds.max(), CURVE)
    velocity = np.r_[-steps[::-1], steps]
    force = friction_force(velocity, fit.feed_drive.friction) + fit.feed_drive.offset
    return tuple(
        CurvePoint(velocity_mm_s=significant(1e3 * v), force=significant(f))
        for v, f in zip(velocity.tolist(), force.tolist(), strict=True)
    )


def _known(value: float) -> float | None:
    """Value to five significant digits; None when it is not finite."""
    return significant(value) if np.isfinite(value) else None
