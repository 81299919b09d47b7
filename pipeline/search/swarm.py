"""Particle swarm optimisation with constriction: each particle remembers its best and knows all's.

Clerc and Kennedy 2002 (IEEE Transactions on Evolutionary Computation 6(1)): the velocity becomes
chi (v + c_1 r (p - x) + c_2 r' (g - x)), p the particle's own best, g the best of all, with
chi = 2 / (phi - 2 + sqrt(phi^2 - 4 phi)), phi = c_1 + c_2 > 4, so that the swarm settles without a
limit.  The velocity is limited nevertheless, as Eberhart and Shi 2000 advise.  A particle that
meets a wall stops there.  Particles start at rest (Engelbrecht 2012).
"""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Range
from pipeline.search.operators import inside
from pipeline.search.result import Evolution, Progress, SearchSettings

SETTLES = 4.0
"""Sum of both attractions above which the constriction is defined [1]."""


@dataclass(frozen=True, kw_only=True)
class SwarmSettings(SearchSettings, section="swarm"):
    """Settings of the particle swarm."""

    own: Annotated[float, Range(least=0.0, most=10.0)] = 2.05
    best: Annotated[float, Range(least=0.0, most=10.0)] = 2.05
    """c_1 and c_2, attraction of a particle's own best and of the best of all [1]; their sum lies
    above 4."""
    fastest: Annotated[float, Range(above=0.0, most=1.0)] = 0.5
    """Greatest velocity along each axis, as a share of the box for each generation [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.own + self.best > SETTLES:
            raise ValueError(
                f"swarm.own = {self.own} and swarm.best = {self.best} must add up to more than "
                f"{SETTLES:g}, or the swarm never settles"
            )

    @property
    def constriction(self) -> float:
        """chi, the share of the velocity that is kept [1]."""
        phi = self.own + self.best
        return 2.0 / (phi - 2.0 + sqrt(phi * (phi - 4.0)))

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Particles that remember their own best, and stop at walls."""
        velocity, own, own_costs = np.zeros_like(unit), unit, costs
        while True:
            velocity = accelerated(velocity, own - unit, progress.unit - unit, self, rng)
            ahead = unit + velocity
            unit = inside(ahead.copy())
            velocity[ahead != unit] = 0.0
            costs = progress.evaluate(unit)
            better = costs < own_costs
            own_costs = np.where(better, costs, own_costs)
            own = np.where(better[:, None], unit, own)
            yield unit, costs


def accelerated(
    velocity: Floats, to_own: Floats, to_all: Floats, settings: SwarmSettings,
    rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """Velocities (P, D) of the next generation, by distances (P, D) to own and common best."""
    chance = rng.random((2, *velocity.shape))
    chi, most = settings.constriction, settings.fastest
    faster = chi * velocity
    faster += (chi * settings.own) * chance[0] * to_own
    faster += (chi * settings.best) * chance[1] * to_all
    limited: Floats = np.minimum(np.maximum(faster, -most, out=faster), most, out=faster)
    return limited
