"""How a spindle changes its speed: constant torque up to the base speed, constant power above."""

from dataclasses import dataclass

import numpy as np

from pipeline.shop.s_curve import Floats
from pipeline.shop.spindle_parameters import MotorParameters

RPM = 2 * np.pi / 60


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """From speed ``n_0`` to ``n_1`` [rev/min] with ``overload`` [1] times the rated power.

    J dω/dt = P/max(ω, ω_b): from rest, ω takes J ω_b ω / P up to ω_b and J (ω² + ω_b²) / 2P above.
    """

    motor: MotorParameters
    overload: float
    n_0: float
    n_1: float

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return abs(self._from_rest(self.n_1) - self._from_rest(self.n_0))

    def at(self, time: Floats) -> Floats:
        """Speed ``time`` (T,) [s] after the beginning [rev/min]; ``n_1`` after the end."""
        way = np.clip(time, 0, self.duration)
        rising = 1 if self.n_1 > self.n_0 else -1
        spent = np.maximum(self._from_rest(self.n_0) + rising * way, 0)
        base, lever = self.motor.base_speed * RPM, self.motor.inertia / self._power
        low = spent / (lever * base)
        high = np.sqrt(np.maximum(2 * spent / lever - base**2, 0))
        speed = np.where(low <= base, low, high) / RPM
        return np.where(time >= self.duration, self.n_1, speed)

    @property
    def _power(self) -> float:
        return self.overload * self.motor.rated_power

    def _from_rest(self, speed: float) -> float:
        omega, base = speed * RPM, self.motor.base_speed * RPM
        lever = self.motor.inertia / self._power
        return lever * (base * omega if omega <= base else (omega**2 + base**2) / 2)
