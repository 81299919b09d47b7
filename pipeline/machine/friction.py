"""Friction of a guideway and its screw: Stribeck's curve, one set for each direction.

F_f(v) = [F_c + (F_s - F_c) exp(-(|v| / v_s)^2)] sgn v + mu_v v, with sets of their own for v > 0
and v < 0 (Sim2023).  At standstill friction holds whatever is asked of it, up to F_s.

The step is implicit in the direction of motion (a proximal step): what a held force would make of
the speed is brought nearer to 0 by what friction can take, and no further.  It sticks exactly, does
not chatter, and needs no band of speeds that count as none.
"""

from dataclasses import dataclass, fields
from math import exp

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, kw_only=True)
class DirectionFriction:
    """Friction in one direction of motion; all values count as positive.

    Parameters
    ----------
    coulomb : float
        Level F_c that speed does not change [N].
    static : float
        Level F_s at the start of motion [N], at least ``coulomb``.
    stribeck_velocity : float
        Speed v_s over which the one goes over into the other [m/s].
    viscous : float
        mu_v [N s/m].

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    coulomb: float
    static: float
    stribeck_velocity: float = 0.005
    viscous: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"friction.{item.name} = {value} must be finite and at least 0")
        if self.stribeck_velocity == 0:
            raise ValueError("friction.stribeck_velocity = 0 m/s must be positive")
        if self.static < self.coulomb:
            raise ValueError(
                f"friction.static = {self.static} N must not be below coulomb = {self.coulomb} N"
            )


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Friction in both directions of motion.

    Parameters
    ----------
    positive, negative : DirectionFriction
        For v > 0 and for v < 0.
    """

    positive: DirectionFriction
    negative: DirectionFriction


def friction_force(v: ArrayLike, friction: FrictionParameters) -> NDArray[np.float64]:
    """Force against motion at steady speeds [N]; 0 at standstill, where it is not a function of v.

    Parameters
    ----------
    v : array_like
        Speed [m/s], any shape.
    friction : FrictionParameters
        Both directions.
    """
    speed = np.asarray(v, dtype=np.float64)
    force = np.zeros_like(speed)
    for sign, one in ((1.0, friction.positive), (-1.0, friction.negative)):
        there = speed * sign > 0
        s = speed[there] * sign
        dip = (one.static - one.coulomb) * np.exp(-((s / one.stribeck_velocity) ** 2))
        force[there] = sign * (one.coulomb + dip + one.viscous * s)
    return force


def speed_after(
    v: float, force: float, mass: float, period: float, friction: FrictionParameters
) -> tuple[float, float]:
    """Speed one step on under a held force, and friction's mean over the step.

    Viscous friction is taken at both ends of the step (Crank and Nicolson), the level at the old
    speed; at standstill, and where the step passes it, the level is F_s.  Second order in the step
    but for the dip, which is of first order.

    Parameters
    ----------
    v : float
        Speed before [m/s].
    force : float
        All that pushes but friction [N].
    mass, period : float
        [kg], [s].
    friction : FrictionParameters
        Both directions.

    Returns
    -------
    v_next : float
        [m/s]; 0 while ``force`` is not above F_s at standstill.
    mean : float
        Force against positive motion [N]: M (v_next - v) / period = force - mean.
    """
    before = friction.positive if v > 0 else friction.negative
    free = v + period / mass * (force - 0.5 * before.viscous * v)
    after = friction.positive if free > 0 else friction.negative
    dip = exp(-((v / before.stribeck_velocity) ** 2)) if v * free > 0 else 1.0
    level = after.coulomb + (after.static - after.coulomb) * dip
    slip = max(abs(free) - period / mass * level, 0.0)
    slip /= 1.0 + 0.5 * period / mass * after.viscous
    v_next = slip if free > 0 else -slip
    return v_next, force - mass * (v_next - v) / period
