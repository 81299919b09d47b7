"""One axis as a row of numbers: what compiled loops, and who fits or varies parameters, work on."""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from pipeline.machine.feed_drive import FeedDriveParameters
from pipeline.machine.friction import DirectionFriction, FrictionParameters
from pipeline.machine.servo import ServoParameters


class DriveColumn(IntEnum):
    """Place of each number in a row; units as in the parameters' own classes."""

    LOOP_GAIN = 0
    PROPORTIONAL = 1
    INTEGRAL = 2
    VELOCITY_FEEDFORWARD = 3
    ACCELERATION_FEEDFORWARD = 4
    CURRENT_LIMIT = 5
    MASS = 6
    FORCE_CONSTANT = 7
    OFFSET = 8
    LOAD_FACTOR = 9
    """What the load is multiplied by [1]."""
    COULOMB_POSITIVE = 10
    STATIC_POSITIVE = 11
    STRIBECK_POSITIVE = 12
    VISCOUS_POSITIVE = 13
    COULOMB_NEGATIVE = 14
    STATIC_NEGATIVE = 15
    STRIBECK_NEGATIVE = 16
    VISCOUS_NEGATIVE = 17
    BACKLASH = 18
    VELOCITY_LAG = 19
    POSITION_LAG = 20


_POSITIVE = {
    DriveColumn.LOOP_GAIN, DriveColumn.PROPORTIONAL, DriveColumn.CURRENT_LIMIT, DriveColumn.MASS,
    DriveColumn.FORCE_CONSTANT, DriveColumn.STRIBECK_POSITIVE, DriveColumn.STRIBECK_NEGATIVE,
}  # fmt: skip
_SIGNED = {DriveColumn.OFFSET, DriveColumn.LOAD_FACTOR}


def check_rows(rows: npt.NDArray[np.float64]) -> None:
    """Refuse rows with a number out of its range; shape (..., 21).

    Raises
    ------
    ValueError
        With the place, the name and the value of the first.
    """
    for column in DriveColumn:
        values = rows[..., column]
        fits = np.isfinite(values)
        if column in _POSITIVE:
            fits, asked = fits & (values > 0), "finite and positive"
        elif column in _SIGNED:
            asked = "finite"
        else:
            fits, asked = fits & (values >= 0), "finite and at least 0"
        if column == DriveColumn.CURRENT_LIMIT:
            fits, asked = values > 0, "positive"
        if column in (DriveColumn.STATIC_POSITIVE, DriveColumn.STATIC_NEGATIVE):
            fits, asked = fits & (values >= rows[..., column - 1]), "finite, not below coulomb"
        if not fits.all():
            at = tuple(int(i) for i in np.argwhere(~fits)[0])
            raise ValueError(f"row {list(at)}: {column.name} = {values[at]} must be {asked}")


def drive_row(
    servo: ServoParameters, feed_drive: FeedDriveParameters, load_factor: float = 1.0
) -> npt.NDArray[np.float64]:
    """Row of one axis, shape (21,); what the vendor does not publish is multiplied in."""
    friction = feed_drive.friction
    sides = [
        [one.coulomb, one.static, one.stribeck_velocity, one.viscous]
        for one in (friction.positive, friction.negative)
    ]
    return np.array(
        [
            servo.loop_gain, servo.proportional, servo.integral, servo.velocity_feedforward,
            servo.acceleration_feedforward, servo.current_limit, feed_drive.mass,
            feed_drive.force_constant, feed_drive.offset, load_factor, *sides[0], *sides[1],
            feed_drive.backlash, servo.velocity_lag, servo.position_lag,
        ]
    )  # fmt: skip


def drive_of_row(row: npt.NDArray[np.float64]) -> tuple[ServoParameters, FeedDriveParameters]:
    """Servo and mechanics of a row of :func:`drive_row`, the scale factors 1.

    Raises
    ------
    ValueError
        When a number is out of its range.
    """
    position, velocity, integral, forward, ahead, limit, mass, k, offset = row[:9].tolist()
    sides = [
        DirectionFriction(coulomb=c, static=s, stribeck_velocity=v, viscous=mu)
        for c, s, v, mu in row[10:18].reshape(2, 4).tolist()
    ]
    servo = ServoParameters(
        position_gain=position, velocity_gain=velocity, integral_gain=integral,
        velocity_feedforward=forward, acceleration_feedforward=ahead, current_limit=limit,
        velocity_lag=float(row[DriveColumn.VELOCITY_LAG]),
        position_lag=float(row[DriveColumn.POSITION_LAG]),
    )  # fmt: skip
    feed_drive = FeedDriveParameters(
        mass=mass, force_constant=k, offset=offset, backlash=float(row[DriveColumn.BACKLASH]),
        friction=FrictionParameters(positive=sides[0], negative=sides[1]),
    )  # fmt: skip
    return servo, feed_drive
