"""One number for each individual of a search: limits first, then the objective.

With the objective v as a share of a reference, what keeps all limits costs v / (1 + v), less than
1 however much it takes; what does not costs 1 and the sum of its violations.  A search that only
compares costs never takes a violation for a gain, and no weight has to be chosen.
"""

from dataclasses import dataclass, field
from math import inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.groups import Groups
from pipeline.optimisation.problem.problem import Problem

Floats = NDArray[np.float64]


class Genes(Protocol):
    """What stands for F and S in a search."""

    @property
    def groups(self) -> Groups:
        """What shares an F, what an S."""
        ...

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F, shape (P, G), and S, shape (P, H), of genes, shape (P, D)."""
        ...


@dataclass(kw_only=True)
class Fitness:
    """Judges individuals, counts them, and keeps the best that was inside all limits.

    Parameters
    ----------
    problem : Problem
        What evaluates them.
    genes : Genes
        What they are made of.
    column : int
        Of the objective, see :data:`~pipeline.optimisation.settings.OBJECTIVES`.
    reference : float
        The objective's size; above 0.
    weight : float, optional
        Of violations beside the objective as a share of the reference, as Sim2023 has it: a
        penalty, in place of limits first.
    """

    problem: Problem
    genes: Genes
    column: int
    reference: float
    weight: float | None = None
    best: float = inf
    decision: Decision | None = None
    evaluations: int = 0
    history: list[float] = field(default_factory=list)

    def __call__(self, genes: Floats) -> Floats:
        """Costs, shape (P,), of genes, shape (P, D); NaN where the objective is not known."""
        feeds, speeds = self.genes.decoded(genes)
        found = self.problem.evaluate(self.genes.groups, feeds, speeds)
        value = found.objectives[:, self.column]
        inside = found.violation <= 0
        self._keep(np.where(inside, value, inf), feeds, speeds)
        share = value / self.reference
        if self.weight is not None:
            penalised: Floats = share + self.weight * found.violation
            return penalised
        return np.where(inside, share / (1 + share), 1 + found.violation)

    def _keep(self, values: Floats, feeds: Floats, speeds: Floats) -> None:
        values = np.where(np.isnan(values), inf, values)
        self.evaluations += len(values)
        best_so_far = np.minimum.accumulate(np.minimum(values, self.best))
        self.history.extend(best_so_far.tolist())
        k = int(values.argmin())
        if values[k] < self.best:
            self.best = float(values[k])
            self.decision = Decision(
                groups=self.genes.groups, feeds=feeds[k].copy(), speeds=speeds[k].copy()
            )
