"""Parameters of a feed axis under its servo, and the axis as a row of numbers (Sim2023).

Their equations stand in :mod:`pipeline.machine.axis.drive`.  Compiled loops, fits and variations of
parameters take servo and mechanics of an axis as a row, its numbers in the order of
:class:`DriveColumn`.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.drive import FeedDriveParameters, FrictionParameters
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class ServoParameters(Ranged, section="servo"):
    """Position and velocity loop of one axis."""

    position_gain: Positive
    """P_p [1/s]."""
    velocity_gain: Positive
    """V_p, command per velocity error [A s/m] ([V s/m] where the command is a voltage)."""
    integral_gain: NotNegative = 0.0
    """V_i [A/m]."""
    position_scale: Positive = 1.0
    velocity_scale: Positive = 1.0
    integral_scale: NotNegative = 1.0
    """S_pp, S_vp, S_vi: factors of the control that the vendor does not publish."""
    velocity_feedforward: NotNegative = 0.0
    """f_v, share of the reference's velocity that is fed forward; 0 for none, 1 for all."""
    acceleration_feedforward: NotNegative = 0.0
    """f_a, command for one unit of the reference's acceleration [A s^2/m]."""
    current_limit: Annotated[float, Range(above=0.0, finite=False, unit="A")] = inf
    """Greatest command [A]; while it holds the integral does not grow towards it."""
    velocity_lag: NotNegative = 0.0
    """T_v, time constant of the measured velocity that is fed back [s]; 0 for none."""
    position_lag: NotNegative = 0.0
    """T_x, time constant of v_ref between the position and the velocity loop [s]; 0 for none."""

    @property
    def loop_gain(self) -> float:
        """S_pp P_p [1/s]: at a constant feed v without feed-forward the error is v over it."""
        return self.position_scale * self.position_gain

    @property
    def proportional(self) -> float:
        """S_vp V_p [A s/m]."""
        return self.velocity_scale * self.velocity_gain

    @property
    def integral(self) -> float:
        """S_vi V_i [A/m]."""
        return self.integral_scale * self.integral_gain


def friction_force(v: ArrayLike, friction: FrictionParameters) -> Floats:
    """Force against motion at steady speeds [N] of any shape; 0 at standstill, where it is open."""
    speed = np.asarray(v, dtype=np.float64)
    force = np.zeros_like(speed)
    for sign, side in ((1.0, friction.positive), (-1.0, friction.negative)):
        sliding = speed * sign > 0
        s = speed[sliding] * sign
        stribeck = (side.static - side.coulomb) * np.exp(-((s / side.stribeck_velocity) ** 2))
        force[sliding] = sign * (side.coulomb + stribeck + side.viscous * s)
    return force


@dataclass(frozen=True, kw_only=True)
class DriveStart(Ranged, section="start"):
    """The axis at the first sample."""

    position: Annotated[float, Range(unit="m")]
    velocity: Annotated[float, Range(unit="m/s")] = 0.0
    """Position [m] and velocity [m/s] at the encoder."""
    command: Annotated[float, Range(unit="A")] = 0.0
    """First command, which the integral is set for [A]; without integral gain it has no meaning."""
    reference_velocity: Annotated[float, Range(unit="m/s")] = 0.0
    """Speed of the reference before the first sample, for the feed-forward [m/s]."""


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


def samples(name: str, values: ArrayLike, length: int | None = None) -> Floats:
    """``values`` as finite numbers, shape (T,)."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not array.size:
        raise ValueError(f"{name} has shape {array.shape}: give one row of at least one sample")
    if length is not None and len(array) != length:
        raise ValueError(f"{name} has {len(array)} samples, the reference {length}: give as many")
    wrong = np.flatnonzero(~np.isfinite(array))
    if wrong.size:
        raise ValueError(f"{name}[{wrong[0]}] = {array[wrong[0]]}: give finite samples")
    return array


def check_steps(period: float, substeps: int) -> None:
    """Refuse a period or a number of substeps that is none."""
    if not (isfinite(period) and period > 0):
        raise ValueError(f"period = {period} s must be finite and positive")
    if substeps < 1:
        raise ValueError(f"substeps = {substeps} must be at least 1")
