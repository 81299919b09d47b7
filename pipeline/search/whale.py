"""Whale optimisation algorithm: individuals circle the best one, spiral towards it, or roam.

Mirjalili and Lewis 2016 (Advances in Engineering Software 95), Eq. (2.1) to (2.8): with a falling
evenly from 2 to 0, A = 2 a r - a and C = 2 r', each whale Z does one of three things,

- encircles the best so far, Z <- Z* - A |C Z* - Z|, where |A| < 1,
- roams about another whale Z_r, Z <- Z_r - A |C Z_r - Z|, where |A| >= 1,
- or, at even odds with both, spirals, Z <- |Z* - Z| exp(b l) cos(2 pi l) + Z*, l from -1 to 1.

C Z* depends on where zero lies: the whales are drawn to it whatever the cost.  ``origin`` says
which point of the box it is; in boxes that are symmetric about zero, as in the paper, the middle.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Range, Share
from pipeline.search.operators import encircled, inside
from pipeline.search.result import Evolution, Progress, SearchSettings


@dataclass(frozen=True, kw_only=True)
class WhaleSettings(SearchSettings, section="whale"):
    """Settings of the whale optimisation algorithm; the defaults are those of its authors."""

    reach: Positive = 2.0
    """a at the beginning [1]; it falls evenly to 0."""
    spiral: Annotated[float, Range(least=0.0, most=10.0)] = 1.0
    """b, how fast the spiral widens [1]."""
    least_turn: Annotated[float, Range(least=-10.0, most=10.0)] = -1.0
    greatest_turn: Annotated[float, Range(least=-10.0, most=10.0)] = 1.0
    """Range of l, turns of the spiral [1]."""
    roams: bool = True
    """Whether whales with abs(A) >= 1 roam about another whale, else they encircle the best one."""
    by_axis: bool = False
    """Whether A and C are drawn for each axis, as the paper's text has it, or once for each whale,
    as in its authors' program, which draws the whale to roam about anew for each axis, too."""
    origin: Share = 0.5
    """Place on every axis of the unit cube that the formulas take for zero [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.least_turn > self.greatest_turn:
            raise ValueError(
                f"whale.least_turn = {self.least_turn} must not lie above whale.greatest_turn = "
                f"{self.greatest_turn}"
            )

    def evolution(
        self, progress: Progress, rng: np.random.Generator, unit: Floats, costs: Floats
    ) -> Evolution:
        """Whales whose reach falls evenly."""
        while True:
            left = 1.0 - (len(progress.history) - 1) / self.generations
            unit = moved(unit, progress.unit, left * self.reach, self, rng)
            yield unit, progress.evaluate(unit)


def moved(
    unit: Floats, best: Floats, reach: float, settings: WhaleSettings, rng: np.random.Generator
) -> Floats:
    """Whales ``unit`` (P, D) a generation later, in the unit cube.

    ``best`` (D,) is Z*, the best so far; ``reach`` a of this generation [1].
    """
    many, genes = unit.shape
    chance = rng.random((3, many, 1))
    step = rng.random((many, genes if settings.by_axis else 1))
    swing = rng.random(step.shape)
    step *= 2.0 * reach
    step -= reach  # A
    swing *= 2.0  # C
    z, goal = unit - settings.origin, best - settings.origin
    prey = goal
    if settings.roams:
        other = z.take((many * chance[0, :, 0]).astype(np.intp), axis=0)
        goal = np.where(np.abs(step) >= 1.0, other, prey)
    circled = encircled(z, goal, step, swing)
    turn = settings.least_turn + (settings.greatest_turn - settings.least_turn) * chance[1]
    widening = np.exp(settings.spiral * turn) * np.cos(2.0 * np.pi * turn)
    spiral = np.abs(prey - z)
    spiral *= widening
    spiral += prey
    whales = np.where(chance[2] < 0.5, circled, spiral)
    whales += settings.origin
    return inside(whales)
