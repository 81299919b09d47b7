"""Axes that the tests of the drive follow references with."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters


@dataclass(frozen=True, kw_only=True)
class DriveParameters:
    """One axis: its loops and its mechanics."""

    servo: ServoParameters
    feed_drive: FeedDriveParameters


T = 1e-3
UP = DirectionFriction(coulomb=60.0, static=90.0, stribeck_velocity=0.01, viscous=200.0)
DOWN = DirectionFriction(coulomb=50.0, static=85.0, stribeck_velocity=0.006, viscous=300.0)
BOTH = FrictionParameters(positive=UP, negative=DOWN)
FREE = DirectionFriction(coulomb=0.0, static=0.0, stribeck_velocity=0.005, viscous=0.0)
NONE = FrictionParameters(positive=FREE, negative=FREE)
AXIS = DriveParameters(
    servo=ServoParameters(position_gain=40.0, velocity_gain=100.0, integral_gain=2000.0),
    feed_drive=FeedDriveParameters(mass=150.0, force_constant=300.0, friction=BOTH),
)


def with_servo(axis: DriveParameters, **values: float) -> DriveParameters:
    return replace(axis, servo=replace(axis.servo, **values))


def with_drive(axis: DriveParameters, **values: object) -> DriveParameters:
    return replace(axis, feed_drive=replace(axis.feed_drive, **values))


def ramp(speed: float, seconds: float, period: float = T) -> NDArray[np.float64]:
    return speed * period * np.arange(round(seconds / period))


def to_and_fro(samples: int, period: float = T) -> NDArray[np.float64]:
    """Fast and slow, with reversals."""
    t = period * np.arange(samples)
    return 0.02 * np.sin(2 * t) + 0.001 * np.sin(9 * t)
