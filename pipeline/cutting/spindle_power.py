"""What a spindle can give over its speed, and the force of the cut out of its power.

The motor gives constant torque up to its base speed and constant power from there to its top speed,
P_rated min(1, n / n_base).  The power that goes into the cut is that of the motor times the drive's
efficiency less what turning the spindle alone takes, P_0(n); over the cutting speed it is the
tangential force (Twin2026).  As printed there the force grows without bound as n goes to 0; here it
is not determined (NaN) below a least speed.
"""

from dataclasses import dataclass, fields
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

KW = 1e3
RPM = 1 / 60


@dataclass(frozen=True, kw_only=True)
class SpindleDrive:
    """Motor and drive of a main spindle.

    Parameters
    ----------
    rated_power_kW : float
        Of the motor from its base speed on [kW].
    base_speed_rpm : float
        [rev/min].
    top_speed_rpm : float
        [rev/min].
    efficiency : float
        From the motor's power to the tool's, 0 to 1.
    minimum_speed_rpm : float
        Below it power says nothing about force [rev/min].
    no_load_W : tuple of float
        p0, p1, p2, ... of P_0 = p0 + p1 n + p2 n^2 + ... [W, W s, W s^2, ...], n in rev/s.

    Raises
    ------
    ValueError
        When a value is out of its range, or the speeds are out of order.
    """

    rated_power_kW: float
    base_speed_rpm: float
    top_speed_rpm: float
    efficiency: float = 1.0
    minimum_speed_rpm: float = 100.0
    no_load_W: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        for item in fields(self):
            values = np.atleast_1d(getattr(self, item.name))
            if not np.isfinite(values).all():
                raise ValueError(f"spindle_drive.{item.name} = {values[0]} must be finite")
            if item.name != "no_load_W" and not values[0] > 0:
                raise ValueError(f"spindle_drive.{item.name} = {values[0]:g} must be positive")
        if self.efficiency > 1:
            raise ValueError(f"spindle_drive.efficiency = {self.efficiency:g} must be at most 1")
        if self.base_speed_rpm > self.top_speed_rpm:
            raise ValueError(
                f"spindle_drive.base_speed_rpm = {self.base_speed_rpm:g} must be at most "
                f"top_speed_rpm = {self.top_speed_rpm:g}"
            )

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
    power = drive.rated_power * np.minimum(1.0, speed / drive.base_speed)
    return np.where(speed <= drive.top_speed * (1 + 1e-9), power, np.nan)


def available_torque(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """Of the motor [N m], P_rated / (2 pi max(n, n_base)); NaN above the top speed."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    torque = drive.rated_power / (2 * np.pi * np.maximum(speed, drive.base_speed))
    return np.where(speed <= drive.top_speed * (1 + 1e-9), torque, np.nan)


def no_load_power(n: ArrayLike, drive: SpindleDrive) -> Floats:
    """P_0, what turning the spindle without a cut takes [W]."""
    speed = np.abs(np.asarray(n, dtype=np.float64))
    return cast(Floats, np.polynomial.polynomial.polyval(speed, drive.no_load_W))


def cutting_power(torque: ArrayLike, n: ArrayLike) -> Floats:
    """2 pi n T [W] of a cut's torque [N m] at a speed [rev/s]."""
    return 2 * np.pi * np.abs(np.asarray(n)) * np.asarray(torque, dtype=np.float64)


def motor_power(torque: ArrayLike, n: ArrayLike, drive: SpindleDrive) -> Floats:
    """What the motor gives for a cut's torque, (2 pi n T + P_0(n)) / efficiency [W]."""
    power = cutting_power(torque, n) + no_load_power(n, drive)
    return power / drive.efficiency


def tangential_force(power: ArrayLike, n: ArrayLike, D: ArrayLike, drive: SpindleDrive) -> Floats:
    """F_t = (P efficiency - P_0(n)) / v_c [N], the mean over all teeth.

    Parameters
    ----------
    power : array_like
        Of the motor [W].
    n : array_like
        Speed [rev/s].
    D : array_like
        Diameter of the tool [m].
    drive : SpindleDrive
        Of the machine.

    Returns
    -------
    ndarray
        NaN below the drive's least speed; negative where less power is taken than without a cut.
    """
    speed = np.abs(np.asarray(n, dtype=np.float64))
    known = speed >= drive.minimum_speed
    cutting_speed = np.pi * np.asarray(D, dtype=np.float64) * np.where(known, speed, 1.0)
    force = np.asarray(power) * drive.efficiency - no_load_power(speed, drive)
    return np.where(known, force / cutting_speed, np.nan)
