"""The direct solution: block by block the best F, stretch by stretch the best S.

It is exact where blocks do not interact: where each row runs at its F nearly all along, so that
what one block does changes nothing for the next.  Where rows are too short for that, what they
reach is taken from the plan of the solution so far, and the best of a few rounds is the answer.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import where
from pipeline.optimisation.direct.block_model import BlockModel, column
from pipeline.optimisation.direct.block_optimum import block_optimum
from pipeline.optimisation.direct.feed_groups import feed_groups
from pipeline.optimisation.direct.speed_refinement import refined
from pipeline.optimisation.direct.speeds import best_speeds, spread
from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.groups import Groups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, Grouping, Objective

Floats = NDArray[np.float64]

ROUNDS = 3
"""Of looking at the plan of the best so far."""
WORTH = 1e-4
"""What another round has to gain, as a share."""


def direct(problem: Problem, objective: Objective, grouping: Grouping) -> Decision:
    """F and S of least time, cost, energy or wear, reckoned row by row.

    Parameters
    ----------
    problem : Problem
        Of M rows.
    objective : Objective
        What is to be least; ``pareto`` counts as time.
    grouping : Grouping
        Which blocks share an F or an S.

    Returns
    -------
    Decision
        Inside all limits; S in whole rev/min or as programmed.

    Raises
    ------
    ValueError
        When the objective is not known for this part, or no F and S keep the limits.
    """
    which = column(objective)
    whole = _as_programmed(problem, objective)
    kept: list[tuple[float, Decision]] = []
    passed = np.inf
    for decision in _rounds(problem, objective, grouping, whole):
        found = problem.evaluate(decision.groups, decision.feeds[None], decision.speeds[None])
        passed = min(passed, float(found.violation[0]))
        if found.violation[0] > 0.0:
            continue
        value, best = float(found.objectives[0, which]), _least(kept)
        kept.append((value, decision))
        if value > best * (1 - WORTH):
            break
    if not kept:
        raise ValueError(_passed(problem, passed))
    return min(kept, key=lambda one: one[0])[1]


def _least(kept: list[tuple[float, Decision]]) -> float:
    return min((value for value, _ in kept), default=np.inf)


def _rounds(
    problem: Problem, objective: Objective, grouping: Grouping, whole: float
) -> Iterator[Decision]:
    """Solutions, each reckoned with what the rows reach in the one before."""
    model = BlockModel.alone(problem, objective)
    for _ in range(1 + ROUNDS):
        decision = _solved(model, grouping, whole)
        yield decision
        speeds = decision.row_speeds
        fastest = block_optimum(
            BlockModel.alone(problem, "time"), problem.editable.block, speeds[None]
        )  # fmt: skip
        model = BlockModel.planned(problem, objective, fastest.feeds[0], speeds)


def _solved(model: BlockModel, grouping: Grouping, whole: float) -> Decision:
    problem = model.problem
    moves = problem.cut.plan.path.moves
    pieces, found = best_speeds(model, grouping, whole)
    speeds = refined(model, pieces, found, problem.editable.block)
    row_speeds = spread(speeds, found.stretch, moves.speed)
    whole = min(whole, _of_blocks(model, row_speeds))
    feed, feeds = feed_groups(model, grouping, found.stretch, row_speeds, whole)
    groups = Groups(
        feed=feed, speed=found.stretch, own_feed=moves.feed, own_speed=moves.speed
    )  # fmt: skip
    return Decision(groups=groups, feeds=feeds, speeds=speeds)


def _as_programmed(problem: Problem, objective: Objective) -> float:
    moves = problem.cut.plan.path.moves
    found = problem.evaluate_rows(moves.feed[None], moves.speed[None])
    whole = float(found.objectives[0, column(objective)])
    if not np.isfinite(whole):
        raise ValueError(
            f"the {OBJECTIVES[column(objective)]} of {moves.files[0]} is not known (see not_known "
            "of kerf simulate): give what is missing, or choose another objective"
        )
    return whole


def _of_blocks(model: BlockModel, speeds: Floats) -> float:
    """What the part takes with each block at its best F."""
    problem = model.problem
    values = block_optimum(model, problem.editable.block, speeds[None]).values[0]
    bad = np.isinf(values)
    if bad.any():
        moves, row = problem.cut.plan.path.moves, int(bad.argmax())
        raise ValueError(
            f"{where(moves, row)}: the line is run at S of {_listed(problem, speeds, row)} rev/min "
            "and no F keeps the limits at all of them: widen the limits, or write it once for each"
        )
    return float(values.sum())


def _listed(problem: Problem, speeds: Floats, row: int) -> str:
    block = problem.editable.block
    same = block == block[row] if block[row] >= 0 else np.arange(len(block)) == row
    return ", ".join(f"{speed:g}" for speed in np.unique(speeds[same]).tolist())


def _passed(problem: Problem, violation: float) -> str:
    return (
        f"{problem.cut.plan.path.moves.files[0]}: no F and S were found that keep all limits; the "
        f"best passes them by {100 * violation:.3g} % in sum over its blocks: widen the limits"
    )
