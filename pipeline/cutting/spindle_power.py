"""What a spindle can give over its speed, and the force of the cut out of its power.

The motor gives constant torque up to its base speed and constant power from there to its top speed,
P_rated min(1, n / n_base).  The power of the motor, here always that of its shaft, times the
efficiency of the way to the tool is what the cut takes and what turning the spindle alone takes,
P_0(n); the cut's part over the cutting speed is the tangential force (Twin2026).  As printed there
the force grows without bound as n goes to 0; here it is not determined (NaN) below a least speed.
"""

from dataclasses import dataclass, fields
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.tool_life import cutting_speed

Floats = NDArray[np.float64]

KW = 1e3
RPM = 1 / 60


@dataclass(frozen=True, kw_only=True)
class SpindleDrive:
    """Motor and drive of a main spindle.

    Parameters
    ----------
    rated_power_kW : float
        At the motor's shaft, from its base speed on [kW].
    base_speed_rpm : float
        [rev/min].
    top_speed_rpm : float
        [rev/min].
    efficiency : float
        Mechanical, from the motor's shaft to the tool, above 0 to 1: bearings, belt, gears.
    motor_efficiency : float
        Electrical, from the supply to the motor's shaft, above 0 to 1: inverter and motor.  Only
        electricity depends on it; 0.9 is usual of 10 to 20 kW near the rated power, and too much
        for a motor that hardly works.
    minimum_speed_rpm : float
        Below it power says nothing about force [rev/min].
    no_load_W : tuple of float
        p0, p1, p2, ... of P_0 = p0 + p1 n + p2 n^2 + ... [W, W s, W s^2, ...], n in rev/s; like
        all that the cut takes, reckoned at the tool.

    Raises
    ------
    ValueError
        When a value is out of its range, or the speeds are out of order.
    """

    rated_power_kW: float
    base_speed_rpm: float
    top_speed_rpm: float
    efficiency: float = 1.0
    motor_efficiency: float = 0.9
    minimum_speed_rpm: float = 100.0
    no_load_W: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        for item in fields(self):
            values = np.atleast_1d(getattr(self, item.name))
            if not len(values):
                raise ValueError(
                    f"spindle_drive.{item.name} is empty: write [0.0] where nothing is known of it"
                )
            if not np.isfinite(values).all():
                raise ValueError(f"spindle_drive.{item.name} = {values[0]} must be finite")
            if item.name != "no_load_W" and not values[0] > 0:
                raise ValueError(f"spindle_drive.{item.name} = {values[0]:g} must be positive")
        for name, high, limit in (
            ("efficiency", 1.0, "1"),
            ("motor_efficiency", 1.0, "1"),
            ("base_speed_rpm", self.top_speed_rpm, f"top_speed_rpm = {self.top_speed_rpm:g}"),
            ("minimum_speed_rpm", self.top_speed_rpm, f"top_speed_rpm = {self.top_speed_rpm:g}"),
        ):
            value = getattr(self, name)
            if value > high:
                raise ValueError(f"spindle_drive.{name} = {value:g} must be at most {limit}")

    @property
    def rated_power(self) -> float:
        """[W]."""
        return self.rated_power_kW * KW

    @property
    def base_speed(self) -> float:
        """[rev/s]."""
        return self.base_speed_rpm * RPM

    @property
    def top_speed(self) -> float:
        """[rev/s]."""
        return self.top_speed_rpm * RPM

    @property
    def minimum_speed(self) -> float:
        """[rev/s]."""
        return self.minimum_speed_rpm * RPM


def power_curve(n: ArrayLike, *, rated: float, base_speed: float) -> Floats:
    """P_rated min(1, n / n_base) [W] of a rated power [W], speed and base speed [rev/s]."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    return rated * np.minimum(1.0, speed / base_speed)


def available_power(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """P_rated min(1, n / n_base) of the motor [W]; NaN above the top speed.

    Parameters
    ----------
    n : array_like
        Speed [rev/s], its sign does not count.
    drive : SpindleDrive
        Of the machine.

    Examples
    --------
    >>> drive = SpindleDrive(rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0)
    >>> (available_power([10.0, 25.0, 100.0], drive) / 1e3).round(6).tolist()
    [4.4, 11.0, 11.0]
    """
    speed = np.abs(np.asarray(n, dtype=np.float64))
    power = power_curve(speed, rated=drive.rated_power, base_speed=drive.base_speed)
    return np.where(speed <= drive.top_speed * (1 + 1e-9), power, np.nan)


def available_torque(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """Of the motor [N m], P_rated / (2 pi max(n, n_base)); NaN above the top speed."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    torque = drive.rated_power / (2 * np.pi * np.maximum(speed, drive.base_speed))
    return np.where(speed <= drive.top_speed * (1 + 1e-9), torque, np.nan)


def no_load_power(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """P_0, what turning the spindle without a cut takes [W].

    Never below 0, wherever a polynomial leads outside the speeds that it was found at.
    """
    speed = np.abs(np.asarray(n, dtype=np.float64))
    power = cast(Floats, np.polynomial.polynomial.polyval(speed, drive.no_load_W))
    return np.maximum(power, 0.0)


def cutting_power(torque: ArrayLike, n: ArrayLike) -> Floats:
    """2 pi n T [W] of a cut's torque [N m] at a speed [rev/s]."""
    return 2 * np.pi * np.abs(np.asarray(n)) * np.asarray(torque, dtype=np.float64)


def shaft_power(cutting: ArrayLike, no_load: ArrayLike, drive: SpindleDrive) -> Floats:
    """What the motor gives for a cut's power P_c beside P_0, (P_c + P_0) / efficiency [W]."""
    power: Floats = np.asarray(cutting, dtype=np.float64) + np.asarray(no_load, dtype=np.float64)
    return power / drive.efficiency


def motor_power(torque: ArrayLike, n: ArrayLike, drive: SpindleDrive) -> Floats:
    """What the motor gives for a cut's torque, (2 pi n T + P_0(n)) / efficiency [W]."""
    return shaft_power(cutting_power(torque, n), no_load_power(n, drive), drive)


def tangential_force(power: ArrayLike, n: ArrayLike, D: ArrayLike, drive: SpindleDrive) -> Floats:
    """F_t = (P efficiency - P_0(n)) / v_c [N], the mean over all teeth.

    Parameters
    ----------
    power : array_like
        Of the motor [W].
    n : array_like
        Speed [rev/s], its sign does not count.
    D : array_like
        Diameter of the tool [m].
    drive : SpindleDrive
        Of the machine.

    Returns
    -------
    ndarray
        NaN below the drive's least speed; negative where less power is taken than without a cut.

    Raises
    ------
    ValueError
        When a diameter is not positive and finite.
    """
    diameter = np.asarray(D, dtype=np.float64)
    bad = ~((diameter > 0.0) & (diameter < np.inf))
    if bad.any():
        raise ValueError(f"D = {diameter[bad].flat[0]} of the tool must be positive and finite")
    speed = np.abs(np.asarray(n, dtype=np.float64))
    known = speed >= drive.minimum_speed
    v_c = cutting_speed(diameter, np.where(known, speed, 1.0))
    force = np.asarray(power) * drive.efficiency - no_load_power(speed, drive)
    return np.where(known, force / v_c, np.nan)
