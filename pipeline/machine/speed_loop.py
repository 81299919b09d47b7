"""The speed loop: PI on the motor's speed, its output a torque with a limit.

T* = K_p e + integral(K_i e) dt, |T*| <= limit.  While the limit holds the integral does not grow
towards it (conditional integration), so that the torque leaves the limit at |e| = (limit - x) / K_p
and not only when the error changes its sign.  The gain stands inside the integral x, so that gains
that change (see :mod:`pipeline.machine.fuzzy_pi`) give no jump.
"""

from dataclasses import dataclass
from math import isfinite

from pipeline.machine.fuzzy_pi import FuzzyParameters


@dataclass(frozen=True, kw_only=True)
class SpeedLoopParameters:
    """One speed loop.

    Parameters
    ----------
    torque_limit : float
        Greatest torque that is asked for [N m].
    proportional : float
        K_p [N m s/rad]; with ``fuzzy`` the middle of its range.
    integral : float
        K_i [N m/rad]; with ``fuzzy`` the middle of its range.
    fuzzy : FuzzyParameters, optional
        Rules that move both gains; none for a PI with fixed gains.
    every : int
        Periods of the current loop for one of the speed loop.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    torque_limit: float
    proportional: float = 0.5
    integral: float = 40.0
    fuzzy: FuzzyParameters | None = None
    every: int = 1

    def __post_init__(self) -> None:
        for name in ("torque_limit", "proportional"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"speed_loop.{name} = {value} must be finite and positive")
        if not (isfinite(self.integral) and self.integral >= 0):
            raise ValueError(f"speed_loop.integral = {self.integral} must be finite, at least 0")
        if not (isfinite(self.every) and self.every >= 1 and self.every % 1 == 0):
            raise ValueError(f"speed_loop.every = {self.every} must be a whole number from 1")
