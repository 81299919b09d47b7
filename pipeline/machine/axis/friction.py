"""Friction of a guideway and its screw: Stribeck's curve, one set for each direction.

F_f(v) = [F_c + (F_s - F_c) exp(-(|v| / v_s)^2)] sgn v + mu_v v, with sets of their own for v > 0
and v < 0 (Sim2023).  At standstill friction balances whatever acts on it, up to F_s.

The step is implicit in the direction of motion (a proximal step): what a held force would make of
the speed is brought nearer to 0 by what friction can take, and no further.  It sticks exactly, does
not chatter, and needs no band of speeds that count as none.  Viscous friction is taken at both ends
of the step (Crank and Nicolson), the level at the old speed; at standstill, and where the step
passes it, the level is F_s.  Second order in the step but for the Stribeck term, which is of first.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import NotNegative, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class DirectionFriction(Ranged, section="friction"):
    """Friction in one direction of motion; all values count as positive.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    coulomb: NotNegative
    """Level F_c that speed does not change [N]."""
    static: NotNegative
    """Level F_s at the start of motion [N], at least ``coulomb``."""
    stribeck_velocity: Annotated[float, Range(above=0.0, unit="m/s")] = 0.005
    """Speed v_s over which the level falls from the static to the Coulomb one [m/s]."""
    viscous: NotNegative = 0.0
    """mu_v [N s/m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.static < self.coulomb:
            raise ValueError(
                f"friction.static = {self.static} N must not be below coulomb = {self.coulomb} N"
            )


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Friction in both directions of motion."""

    positive: DirectionFriction
    negative: DirectionFriction
    """For v > 0 and for v < 0."""


def friction_force(v: ArrayLike, friction: FrictionParameters) -> Floats:
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
    for sign, side in ((1.0, friction.positive), (-1.0, friction.negative)):
        sliding = speed * sign > 0
        s = speed[sliding] * sign
        stribeck = (side.static - side.coulomb) * np.exp(-((s / side.stribeck_velocity) ** 2))
        force[sliding] = sign * (side.coulomb + stribeck + side.viscous * s)
    return force
