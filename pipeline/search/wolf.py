"""Grey wolf optimiser: the pack closes in on the mean of what its three best ones suggest.

Mirjalili, Mirjalili and Lewis 2014 (Advances in Engineering Software 69), Eq. (3.1) to (3.7): with
a falling evenly from 2 to 0, A = 2 a r - a and C = 2 r' for each axis and each leader Z_k (alpha,
beta, delta: the three best so far), Z <- mean over k of Z_k - A |C Z_k - Z|.

C Z_k depends on where zero lies: the wolves are drawn to it whatever the cost.  ``origin`` says
which point of the box it is; in boxes that are symmetric about zero, as in the paper, the middle.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Share
from pipeline.search.operators import encircled, inside
from pipeline.search.result import Evolution, Progress, SearchSettings

LEADERS = 3
"""Alpha, beta and delta, the wolves that lead; fewer in a smaller pack."""


@dataclass(frozen=True, kw_only=True)
class WolfSettings(SearchSettings, section="wolf"):
    """Settings of the grey wolf optimiser; the defaults are those of the paper."""

    reach: Positive = 2.0
    """a at the beginning [1]; it falls evenly to 0."""
    origin: Share = 0.5
    """Place on every axis of the unit cube that the formulas take for zero [1]."""

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Wolves about the three best so far."""
        leaders, theirs = unit[:0], costs[:0]
        while True:
            leaders, theirs = _best_of(leaders, theirs, unit, costs)
            left = 1.0 - (len(progress.history) - 1) / self.generations
            unit = moved(unit, leaders, left * self.reach, self.origin, rng)
            costs = progress.evaluate(unit)
            yield unit, costs


def _best_of(leaders: Floats, theirs: Floats, unit: Floats, costs: Floats) -> tuple[Floats, Floats]:
    """The best of the leaders so far and the pack, and their costs, best first."""
    joined, all_costs = np.concatenate([leaders, unit]), np.concatenate([theirs, costs])
    order = all_costs.argsort(kind="stable")[:LEADERS]
    return joined[order], all_costs[order]


def moved(
    unit: Floats, leaders: Floats, reach: float, origin: float, rng: np.random.Generator
) -> Floats:
    """Wolves ``unit`` (P, D) a generation later, in the unit cube.

    ``leaders`` (L, D) are the best so far, L up to 3; ``reach`` is a of this generation [1];
    ``origin`` the place on every axis that the formulas take for zero [1].
    """
    shape = (len(leaders), *unit.shape)
    step = rng.random(shape)
    step *= 2.0 * reach
    step -= reach
    swing = rng.random(shape)
    swing *= 2.0
    suggested = encircled(unit - origin, leaders[:, None] - origin, step, swing)
    return inside(suggested.sum(axis=0) / len(leaders) + origin)
