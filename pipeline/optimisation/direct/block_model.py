"""What a row takes at its F and S, told row by row: what the direct solution reckons with.

A row runs at its F, or as fast as it can, and takes an excess of time beside:

    t = L / min(v(F), v_reach) + t_excess

At first every row reaches what axes and arcs allow, and nothing is in excess: as if each ran at its
F all along.  Of a plan, v_reach is the greatest speed of rows too short for their F, and t_excess
what speeding up and slowing down takes; then the model holds near that plan.
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import plan
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, Objective

Floats = NDArray[np.float64]

HOUR = 3600.0
REACHED = 1.0 - 1e-6
"""Share of its F from which on a row counts as fast as that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockModel:
    """M rows of a problem and what is to be least.

    Parameters
    ----------
    problem : Problem
        What limits them, and what they take.
    objective : Objective
        ``pareto`` counts as time.
    reach : ndarray, shape (M,)
        Greatest speed along the path [m/s].
    excess : ndarray, shape (M,)
        Time beside that at this speed [s].
    """

    problem: Problem = field(repr=False)
    objective: Objective
    reach: Floats = field(repr=False)
    excess: Floats = field(repr=False)

    @classmethod
    def alone(cls, problem: Problem, objective: Objective) -> Self:
        """Each row at its F all along."""
        cap = problem.cut.plan.path.cap
        return cls(problem=problem, objective=objective, reach=cap, excess=np.zeros(len(cap)))

    @classmethod
    def planned(
        cls, problem: Problem, objective: Objective, feeds: Floats, speeds: Floats
    ) -> Self:  # fmt: skip
        """Each row as the control runs it at F and S of rows, both of shape (M,)."""
        path = problem.cut.plan.path
        found = plan(path, feeds=feeds, speeds=speeds)
        asked = problem.speed(found.feed, found.spindle_speed)
        short = found.v_peak < asked * REACHED
        reach = np.where(short & (found.v_peak > 0), found.v_peak, path.cap)
        along = np.minimum(asked, reach)
        steady = np.divide(path.length, along, out=np.zeros(len(along)), where=along > 0)
        excess = np.where(_fed(problem), np.maximum(found.motion.time - steady, 0.0), 0.0)
        return cls(problem=problem, objective=objective, reach=reach, excess=excess)

    @property
    def column(self) -> int:
        """Where the objective stands in arrays that have one column for each."""
        return column(self.objective)

    def values(self, feeds: Floats, speeds: Floats) -> Floats:
        """Objective of each row, (P, M), at F and S of that shape in the units of ``Moves``."""
        found: Floats = self.demands(feeds, speeds)[self.column]
        return found

    def demands(self, feeds: Floats, speeds: Floats) -> Floats:
        """All objectives of each row; shape (4, P, M)."""
        problem = self.problem
        before, turns = problem.cut.plan, problem.turns(speeds)
        fed = _fed(problem)
        along = np.minimum(problem.speed(feeds, turns), self.reach)
        time = before.path.length / np.where(fed, along, 1.0) + self.excess
        time = np.where(fed, time, before.motion.time)
        return problem.demand.of_rows(time, np.tile(before.wait, (len(time), 1)), turns)

    @property
    def second_price(self) -> float:
        """What a second of standstill costs in the units of the objective."""
        basis = self.problem.basis
        power = 0.0 if basis.energy is None else basis.energy.base_load_kW
        if self.objective == "cost" and basis.rates is not None:
            return basis.rates.per_second + power / HOUR * basis.rates.energy_per_kWh
        if self.objective == "energy":
            return power / HOUR
        return 1.0 if self.objective in ("time", "pareto") else 0.0


def column(objective: Objective) -> int:
    """Where an objective stands in arrays that have one column for each."""
    return OBJECTIVES.index("time" if objective == "pareto" else objective)


def _fed(problem: Problem) -> NDArray[np.bool_]:
    motion = problem.cut.plan.path.motion
    return np.isin(motion, (Motion.CUTTING, Motion.PER_TURN))
