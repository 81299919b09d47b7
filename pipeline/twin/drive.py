"""One feed axis under its servo (Sim2023): parameters, start, stability of the loop, stored drive.

At each sample the servo sees the encoder and sets the command, which holds until the next sample.
The encoder sits on the motor: with backlash the carriage is elsewhere.

From one of the servo's samples to the next the deviation s = (x, v, J, v_seen, v_ref), J the
integral's share of the command as an acceleration, becomes G s: the linear part of the loop, in
slip and within the limit.  It is stable while all eigenvalues of G lie inside the unit circle.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.machine.axis.drive_parameters import DriveColumn, ServoParameters, drive_row
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import FOLLOWING, DriveAxis, DriveModel, FeedDriveParameters
from pipeline.schema.model import Condition
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.verdict import Fact


def loop_matrix(rows: Floats, period: float, substeps: int = 1) -> Floats:
    """Loop matrices G in the less viscous direction, (..., 5, 5).

    ``rows`` (..., 21) are those of :func:`pipeline.machine.axis.drive_parameters.drive_row`; the
    servo samples with ``period`` [s], its mechanics make ``substeps`` in it.
    """
    K, V, R, M, k, T_v, T_x = (
        rows[..., column]
        for column in (
            DriveColumn.LOOP_GAIN, DriveColumn.PROPORTIONAL, DriveColumn.INTEGRAL,
            DriveColumn.MASS, DriveColumn.FORCE_CONSTANT, DriveColumn.VELOCITY_LAG,
            DriveColumn.POSITION_LAG,
        )
    )  # fmt: skip
    seen, reached = _approach(T_v, period), _approach(T_x, period)
    zero, one = np.zeros_like(K), np.ones_like(K)
    v_seen = _row(zero, seen, zero, 1 - seen, zero)
    v_ref = _row(-reached * K, zero, zero, zero, 1 - reached)
    error = v_ref - v_seen
    J = _row(zero, zero, np.where(R > 0, one, zero), zero, zero)
    acceleration = (k * V / M)[..., np.newaxis] * error + _row(zero, zero, one, zero, zero)
    x, v = _row(one, zero, zero, zero, zero), _row(zero, one, zero, zero, zero)
    step = period / substeps
    half = 0.5 * step * np.minimum(*_viscous(rows))[..., np.newaxis] / M[..., np.newaxis]
    for _ in range(substeps):
        v_next = ((1 - half) * v + step * acceleration) / (1 + half)
        x, v = x + 0.5 * step * (v + v_next), v_next
    J_next = J + (period * k * R / M)[..., np.newaxis] * error
    return np.stack((x, v, J_next, v_seen, v_ref), axis=-2)


def stable(rows: Floats, period: float, substeps: int = 1) -> Bools:
    """Whether axes are stable; parameters as of :func:`loop_matrix`, shape (...)."""
    step = period / substeps
    # beyond this the step of viscous friction turns the speed round
    viscous = np.maximum(*_viscous(rows)) * step < 2 * rows[..., DriveColumn.MASS]
    radius = np.abs(np.linalg.eigvals(loop_matrix(rows, period, substeps))).max(axis=-1)
    return viscous & (radius < 1)


def check_stability(
    servo: ServoParameters, feed_drive: FeedDriveParameters, period: float, substeps: int = 1
) -> None:
    """Refuse a servo whose loop is unstable when it samples with ``period`` [s].

    Raises ValueError with the longest period at which it is stable, or with that there is none.
    """
    row = drive_row(servo, feed_drive)
    if stable(row, period, substeps):
        return
    bandwidth = feed_drive.force_constant * servo.proportional / feed_drive.mass
    loop = f"S_pp P_p = {servo.loop_gain:.4g} 1/s, k S_vp V_p / M = {bandwidth:.4g} 1/s"
    shorter = period * np.geomspace(0.99, 1e-6, 1000)
    good = next((T for T in shorter if stable(row, T, substeps)), None)
    if good is None:
        raise ValueError(
            f"the loop ({loop}) is unstable at any period from {shorter[-1]:.2g} to {period:.4g} s:"
            " lower the position gain, the integral gain or the lags"
        )
    raise ValueError(
        f"period = {period:.4g} s is too long for the loop ({loop}), which is stable up to "
        f"{good:.3g} s: lower the gains, or let the servo run in substeps"
    )


def _approach(lag: Floats, period: float) -> Floats:
    with np.errstate(divide="ignore", over="ignore"):
        return -np.expm1(-period / lag)


def _viscous(rows: Floats) -> tuple[Floats, Floats]:
    return rows[..., DriveColumn.VISCOUS_POSITIVE], rows[..., DriveColumn.VISCOUS_NEGATIVE]


def _row(*entries: Floats) -> Floats:
    return np.stack(entries, axis=-1)


@dataclass(frozen=True, kw_only=True)
class IdentifiedDrive:
    """One identified axis, ready for simulation."""

    feed_drive: FeedDriveParameters
    """Mechanics of the axis."""
    servo: ServoParameters | None
    """Loops of the axis; None where the records do not determine them."""
    command_unit: str
    force_unit: str
    """Units of its command, and of forces: the command's where the force constant is not listed."""
    servo_reason: str = ""
    """Reason why there is no servo."""
    bandwidth_Hz: float | None = None
    """Bandwidth of the filter through which its motion and force were compared [Hz]; None for
    none."""
    delay: float = 0.0
    """Delay of its motion behind its command [s]."""
    presliding_stiffness: float | None = None
    """Stiffness of its friction before it slides [N/m]; None where the records do not determine it,
    and friction that sticks holds exactly."""
    presliding_time: float | None = None
    """Time in which friction lets go of a standing axis, to 1/e [s]; None where it holds."""
    following_half_width: float | None = None
    """Half width of the 90 % interval of its following error [m]; None where it is not known."""
    speeds: Condition | None = None
    """Speeds of the recordings that it was learnt from, beyond which the interval is wider
    [mm/s]."""


def read_drives(path: Path) -> dict[str, IdentifiedDrive]:
    """Axes in the drives' ``model.json``, by letter.

    Raises StoreError when the file is missing, broken or of another form.
    """
    try:
        return identified_drives(read_json(path, DriveModel))
    except ValueError as error:
        why = error if isinstance(error, StoreError) else f"{error}: run `dvc repro`"
        raise StoreError(f"{path} holds no identified drives: {why}") from error


def identified_drives(model: DriveModel) -> dict[str, IdentifiedDrive]:
    """Axes of a stored model, by letter.

    Raises ValueError when a parameter is out of its range.
    """
    return {
        letter: replace(
            identified_drive(axis), speeds=model.conditions.get(next(iter(speed_of(letter, 0.0))))
        )
        for letter, axis in model.axes.items()
    }


def speed_of(letter: str, speed: float) -> dict[str, Fact]:
    """The condition of an axis: its highest speed [m/s], to three significant digits [mm/s]."""
    return {f"highest speed {letter}": Fact(value=float(f"{1e3 * speed:.3g}"), unit="mm/s")}


def identified_drive(axis: DriveAxis) -> IdentifiedDrive:
    """A stored axis, ready for simulation."""
    servo, band = None, axis.intervals.get(FOLLOWING)
    if axis.servo is not None:
        values = {name: value for name, value in vars(axis.servo).items() if value is not None}
        servo = ServoParameters(**values)
    return IdentifiedDrive(
        feed_drive=axis.feed_drive,
        servo=servo, command_unit=axis.command_unit, force_unit=axis.force_unit,
        servo_reason=axis.servo_reason, bandwidth_Hz=axis.fit.bandwidth_Hz,
        delay=axis.fit.delay_s or 0.0, presliding_stiffness=axis.presliding_stiffness,
        presliding_time=axis.presliding_time_s,
        following_half_width=None if band is None else 1e-6 * band.upper,
    )  # fmt: skip
