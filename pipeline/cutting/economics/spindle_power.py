"""Power of a spindle drive over its speed, and of a cut.

The motor gives constant torque up to its base speed and constant power from there to its top speed,
P_rated min(1, n / n_base).  The power of the motor, here always that of its shaft, times the
efficiency from there to the tool is the cutting power and the no-load power of the spindle, P_0(n).
"""

from dataclasses import dataclass
from typing import Annotated, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Finite, Positive, Range, Ranged
from pipeline.schema.si import KW, MINUTE


@dataclass(frozen=True, kw_only=True)
class SpindleDrive(Ranged, section="spindle_drive"):
    """Motor and drive of a main spindle; minimum, base and top speed ascend."""

    rated_power_kW: Positive
    """Rated power at the motor's shaft, from the base speed on [kW]."""
    base_speed_rpm: Positive
    """[rev/min]."""
    top_speed_rpm: Positive
    """[rev/min]."""
    efficiency: Annotated[float, Range(above=0.0, most=1.0)] = 1.0
    """Mechanical, from the motor's shaft to the tool, above 0 to 1: bearings, belt, gears."""
    motor_efficiency: Annotated[float, Range(above=0.0, most=1.0)] = 0.9
    """Electrical, from the supply to the motor's shaft, above 0 to 1: inverter and motor.  Only
    electricity depends on it; 0.9 is usual of 10 to 20 kW near the rated power, and too much for a
    motor that hardly works."""
    minimum_speed_rpm: Positive = 100.0
    """Speed below which power does not determine force [rev/min]."""
    no_load_W: tuple[Finite, ...] = (0.0,)
    """p0, p1, p2, ... of P_0 = p0 + p1 n + p2 n^2 + ... [W, W s, W s^2, ...], n in rev/s; like all
    that the cut takes, reckoned at the tool."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.no_load_W:
            raise ValueError("spindle_drive.no_load_W is empty: write [0.0] where it is not known")
        for name in ("base_speed_rpm", "minimum_speed_rpm"):
            if getattr(self, name) > self.top_speed_rpm:
                raise ValueError(
                    f"spindle_drive.{name} = {getattr(self, name):g} must be at most "
                    f"top_speed_rpm = {self.top_speed_rpm:g}"
                )

    @property
    def rated_power(self) -> float:
        """[W]."""
        return self.rated_power_kW * KW

    @property
    def base_speed(self) -> float:
        """[rev/s]."""
        return self.base_speed_rpm / MINUTE

    @property
    def top_speed(self) -> float:
        """[rev/s]."""
        return self.top_speed_rpm / MINUTE

    @property
    def minimum_speed(self) -> float:
        """[rev/s]."""
        return self.minimum_speed_rpm / MINUTE


def power_curve(n: ArrayLike, *, rated: float, base_speed: float) -> Floats:
    """P_rated min(1, n / n_base) [W] of a rated power [W], speed and base speed [rev/s]."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    return rated * np.minimum(1.0, speed / base_speed)


def available_power(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """P_rated min(1, |n| / n_base) of the motor [W] at n [rev/s]; NaN above the top speed.

    Examples
    --------
    >>> drive = SpindleDrive(rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0)
    >>> (available_power([10.0, 25.0, 100.0], drive) / 1e3).round(6).tolist()
    [4.4, 11.0, 11.0]
    """
    speed = np.abs(np.asarray(n, dtype=np.float64))
    power = power_curve(speed, rated=drive.rated_power, base_speed=drive.base_speed)
    return np.where(speed <= drive.top_speed * (1 + 1e-9), power, np.nan)


def no_load_power(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """No-load power P_0 of the turning spindle [W]; at least 0 outside the speeds of its fit."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    power = cast(Floats, np.polynomial.polynomial.polyval(speed, drive.no_load_W))
    return np.maximum(power, 0.0)


def cutting_power(torque: ArrayLike, n: ArrayLike) -> Floats:
    """2 pi n T [W] of a cut's torque [N m] at a speed [rev/s]."""
    return 2 * np.pi * np.abs(np.asarray(n)) * np.asarray(torque, dtype=np.float64)


def shaft_power(cutting: ArrayLike, no_load: ArrayLike, drive: SpindleDrive) -> Floats:
    """Power of the motor for a cut of power P_c, (P_c + P_0) / efficiency [W]."""
    power: Floats = np.asarray(cutting, dtype=np.float64) + np.asarray(no_load, dtype=np.float64)
    return power / drive.efficiency


def motor_power(torque: ArrayLike, n: ArrayLike, drive: SpindleDrive) -> Floats:
    """Power of the motor for a cut of torque T, (2 pi n T + P_0(n)) / efficiency [W]."""
    return shaft_power(cutting_power(torque, n), no_load_power(n, drive), drive)
