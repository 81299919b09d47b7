"""Mechanics of a feed drive as one mass on a screw, and the axis as a row of numbers (Sim2023).

M x'' = k A - F_f(x') - F_g - F_d: command A times the force constant k = 2 pi k_t / L, friction,
gravity less counterbalance, load.  The position is stepped by the trapezoid, so that the balance of
energy closes in each step: M (v_next^2 - v^2) / 2 = (k A - F_g - F_d - F_f) (x_next - x).  Compiled
loops, fits and variations of parameters take servo and mechanics of an axis as a row, its numbers
in the order of :class:`DriveColumn`.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import pi
from typing import Annotated

import numpy as np

from pipeline.machine.axis.friction import FrictionParameters
from pipeline.machine.axis.servo import ServoParameters
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class FeedDriveParameters(Ranged, section="feed_drive"):
    """Mechanics of one axis from its command to the carriage.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    mass: Positive
    """All that moves, the screw's and motor's inertia as mass: M + J (2 pi / L)^2 [kg]."""
    force_constant: Positive
    """Force on the carriage for one unit of the command [N/A] ([N/V] where the command is a
    voltage).  1 where it is unknown: then forces are in the command's unit, and so is M."""
    friction: FrictionParameters
    """Both directions."""
    offset: Annotated[float, Range(unit="N")] = 0.0
    """Force against positive motion that is always there: gravity less counterbalance [N]."""
    backlash: Annotated[float, Range(least=0.0, unit="m")] = 0.0
    """Between the screw and the carriage [m]; 0 for none."""


def force_constant(torque_constant: float, lead: float) -> float:
    """Return k = 2 pi k_t / L [N/A] of a motor of k_t [N m/A] on a screw of lead L [m/rev]."""
    return 2 * pi * torque_constant / lead


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
    """Factor on the load [1]."""
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


def check_rows(rows: Floats) -> None:
    """Refuse rows with a number out of its range; shape (..., 21).

    Raises
    ------
    ValueError
        With the index, the name and the value of the first.
    """
    for column in DriveColumn:
        values = rows[..., column]
        fits = np.isfinite(values)
        if column in _POSITIVE:
            fits, rule = fits & (values > 0), "finite and positive"
        elif column in _SIGNED:
            rule = "finite"
        else:
            fits, rule = fits & (values >= 0), "finite and at least 0"
        if column == DriveColumn.CURRENT_LIMIT:
            fits, rule = values > 0, "positive"
        if column in (DriveColumn.STATIC_POSITIVE, DriveColumn.STATIC_NEGATIVE):
            fits, rule = fits & (values >= rows[..., column - 1]), "finite, not below coulomb"
        if not fits.all():
            at = tuple(int(i) for i in np.argwhere(~fits)[0])
            raise ValueError(f"row {list(at)}: {column.name} = {values[at]} must be {rule}")


def drive_row(
    servo: ServoParameters, feed_drive: FeedDriveParameters, load_factor: float = 1.0
) -> Floats:
    """Row of one axis, shape (21,); the scale factors of the loops are multiplied in."""
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
