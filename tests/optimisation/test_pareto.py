"""Fronts of parts: nobody dominates, all keep the limits, the ends are the blockwise optima."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.genes import Front
from pipeline.optimisation.methods.genetic import pareto
from pipeline.optimisation.problem.arrays import Decision
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import OBJECTIVES, Grouping, SearchSettings
from pipeline.search.nsga2 import knee
from tests.optimisation.modal_programs import seeds
from tests.optimisation.problem_parts import cut_on, problem_on
from tests.optimisation.zigzags import FREE, PAPER, zigzag, zigzag_problem

SMALL = SearchSettings(front=16, generations=10)


@cache
def problem(seed: int) -> Problem:
    return zigzag_problem(seed, FREE if seed % 2 else PAPER)


@cache
def starts(seed: int) -> tuple[Decision, ...]:
    return tuple(blockwise_optimum(problem(seed), one, Grouping()) for one in OBJECTIVES)


@cache
def found(seed: int) -> Front:
    return pareto(problem(seed), starts(seed), OBJECTIVES, SMALL)


SEEDS = pytest.mark.parametrize("seed", seeds(1, 4))


def judged(seed: int, decision: Decision) -> tuple[np.ndarray, float]:
    one = problem(seed).evaluate(
        decision.groups, decision.feeds[None], decision.speeds[None]
    )  # fmt: skip
    return one.objectives[0], float(one.violation[0])


@SEEDS
def test_no_member_dominates_another(seed: int) -> None:
    values = found(seed).objectives
    better = (values[:, None] <= values).all(axis=2) & (values[:, None] < values).any(axis=2)
    assert not better.any() and 4 <= len(values) <= SMALL.front
    assert len(np.unique(values, axis=0)) == len(values)


@SEEDS
def test_every_member_keeps_the_limits_and_comes_to_what_is_told(seed: int) -> None:
    for decision, told in zip(found(seed).decisions, found(seed).objectives, strict=True):
        objectives, violation = judged(seed, decision)
        assert violation == 0 and (objectives == told).all()


@SEEDS
def test_its_ends_are_no_worse_than_the_blockwise_optima(seed: int) -> None:
    best = np.array([judged(seed, start)[0] for start in starts(seed)]).min(axis=0)
    assert (found(seed).objectives.min(axis=0) <= best).all()


@SEEDS
def test_the_knee_is_that_of_its_members(seed: int) -> None:
    front = found(seed)
    moves = problem(seed).cut.plan.path.moves
    before = problem(seed).evaluate_rows(moves.feed[None], moves.speed[None]).objectives[0]
    among = np.flatnonzero((front.objectives <= before).all(axis=1) == front.no_worse.any())
    assert front.knee == among[knee(front.objectives[among])]


@pytest.mark.parametrize("seed", [2, 3])
def test_the_knee_is_no_worse_than_the_program_though_that_of_all_members_is(seed: int) -> None:
    """A wide range of wear makes a slow and expensive member look like a small loss."""
    front = found(seed)
    assert front.no_worse[front.knee] and not front.no_worse[knee(front.objectives)]


def test_two_objectives_make_a_front_of_two() -> None:
    front = pareto(problem(0), starts(0)[:2], ("time", "cost"), SMALL)
    time, cost = front.objectives[:, 0], front.objectives[:, 1]
    assert (np.diff(time) > 0).all() and (np.diff(cost) < 0).all()
    assert front.knee == knee(front.objectives[:, :2])


def test_one_objective_makes_a_front_of_one_that_is_the_best_start() -> None:
    front = pareto(problem(0), starts(0), ("time",), SMALL)
    assert len(front.decisions) == 1 and front.knee == 0
    # in the time alone others may be as fast; none is faster than the blockwise optimum by much
    assert front.objectives[0, 0] == pytest.approx(judged(0, starts(0)[0])[0][0], rel=1e-6)


@SEEDS
def test_a_start_is_the_same_in_the_groups_of_the_front(seed: int) -> None:
    front = pareto(problem(seed), starts(seed), ("time",), replace(SMALL, generations=1))
    groups = front.decisions[0].groups
    for start in starts(seed):
        for group, values in ((groups.feed, start.row_feeds), (groups.speed, start.row_speeds)):
            free = group >= 0
            assert (np.unique(group[free]) == np.arange(group.max() + 1)).all()
            # rows of one group have one value in every start
            pairs = np.unique(np.stack([group[free], values[free]]), axis=1)
            assert pairs.shape[1] == group.max() + 1


def test_the_same_seed_gives_the_same_bytes() -> None:
    def run(seed: int) -> bytes:
        return pareto(
            problem(1), starts(1), OBJECTIVES, replace(SMALL, seed=seed)
        ).objectives.tobytes()  # fmt: skip

    assert run(3) == run(3) != run(4)


def test_a_callback_ends_it_with_a_front() -> None:
    seen = []

    def callback(generation: int, genes: np.ndarray, objectives: np.ndarray) -> bool:
        seen.append(generation)
        return generation == 2

    front = pareto(problem(1), starts(1), OBJECTIVES, SMALL, callback)
    assert seen == [1, 2] and front.evaluations == 4 + 2 * SMALL.front
    best = np.array([judged(1, start)[0] for start in starts(1)]).min(axis=0)
    assert (front.objectives.min(axis=0) <= best).all()


def test_more_generations_give_a_front_that_covers_more() -> None:
    def area(front: Front) -> float:
        low, high = front_of_all.min(axis=0), front_of_all.max(axis=0)
        scaled = (front.objectives[:, [0, 3]] - low) / (high - low)
        return float(np.trapezoid(scaled[:, 1], scaled[:, 0]))

    long = pareto(problem(2), starts(2), ("time", "wear"), SearchSettings(generations=80))
    short = pareto(problem(2), starts(2), ("time", "wear"), SearchSettings(generations=1))
    front_of_all = np.concatenate([long.objectives, short.objectives])[:, [0, 3]]
    assert area(long) < area(short)


def test_an_objective_that_is_not_known_is_refused() -> None:
    dull = problem_on(cut_on(zigzag(0)), PAPER, rates=None)
    start = blockwise_optimum(dull, "time", Grouping())
    with pytest.raises(ValueError, match="the cost of the part is not known"):
        pareto(dull, [start], ("time", "cost"), SMALL)


def test_starts_beyond_their_limits_are_refused() -> None:
    one = starts(0)[0]
    fast = Decision(groups=one.groups, feeds=2 * one.feeds, speeds=one.speeds)
    with pytest.raises(ValueError, match=r"no start of the front keeps the limits; .* by .* %"):
        pareto(problem(0), [fast], ("time", "wear"), SMALL)
