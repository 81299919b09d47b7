"""Genes of shares: they keep the limits, they come back as they were, and 1 is the greatest F."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.genes import BoundedGenes, Fitness, group_bounds
from pipeline.optimisation.problem.arrays import Decision, Groups
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import Grouping
from tests.optimisation.problem_parts import MODES
from tests.optimisation.zigzags import FREE, PAPER, zigzag_problem

LIMITS = {"paper": PAPER, "free": FREE}


@cache
def shares_of(limits: str, seed: int) -> tuple[Problem, Decision, BoundedGenes]:
    problem = zigzag_problem(seed, LIMITS[limits])
    start = blockwise_optimum(problem, "cost", Grouping(least_speed_gain=1e-4))
    return problem, start, BoundedGenes.of(problem, start)


def random_genes(shares: BoundedGenes, many: int, seed: int) -> np.ndarray:
    chance = np.random.default_rng(seed).random((many, len(shares.low)))
    return shares.low + chance * (shares.high - shares.low)


@pytest.mark.parametrize(("limits", "seed"), [
    pytest.param(limits, seed, marks=() if seed == 1 else pytest.mark.proof)
    for limits in sorted(LIMITS)
    for seed in range(4)
])  # fmt: skip
@given(chance=st.integers(0, 999))
@settings(max_examples=50)
def test_whatever_the_genes_the_limits_are_kept(limits: str, seed: int, chance: int) -> None:
    problem, start, shares = shares_of(limits, seed)
    feeds, speeds = shares.decoded(random_genes(shares, 8, chance))
    low, high = group_bounds(problem, start.groups, speeds)
    possible = (low <= high).all(axis=1)
    # slow spindles may lack the torque for the least F; the faster half of the range has it
    assert possible[(speeds > 4500).all(axis=1)].all()
    violation = problem.evaluate(start.groups, feeds, speeds).violation
    assert (violation[possible] == 0).all() and (violation[~possible] > 0).all()


@pytest.mark.parametrize("limits", sorted(LIMITS))
def test_a_decision_comes_back_from_its_genes(limits: str) -> None:
    _, start, shares = shares_of(limits, 1)
    feeds, speeds = shares.decoded(shares.encoded(start.feeds[None], start.speeds[None]))
    assert (speeds[0] == start.speeds).all()
    # a logarithm and its inverse
    assert feeds[0] == pytest.approx(start.feeds, rel=1e-12)


@given(chance=st.integers(0, 999))
@settings(max_examples=30)
def test_genes_come_back_from_their_decision(chance: int) -> None:
    _, _, shares = shares_of("paper", 1)
    genes = random_genes(shares, 5, chance)
    again = shares.decoded(shares.encoded(*shares.decoded(genes)))
    for one, other in zip(shares.decoded(genes), again, strict=True):
        assert other == pytest.approx(one, rel=1e-12)


def test_one_is_the_greatest_feed_and_zero_the_least() -> None:
    problem, start, shares = shares_of("paper", 1)
    many = start.groups.feeds
    genes = np.tile(shares.high, (2, 1))
    genes[0, :many] = 0.0
    feeds, speeds = shares.decoded(genes)
    beyond = np.tile(feeds[1], (many, 1))
    beyond[np.arange(many), np.arange(many)] *= 1.001
    below = np.tile(feeds[0], (many, 1))
    below[np.arange(many), np.arange(many)] *= 0.9
    moves, group = problem.cut.plan.path.moves, start.groups.feed
    falls = (moves.start[:, 2] > moves.end[:, 2]) & ~problem.cuts & (group >= 0)
    down = np.isin(np.arange(many), group[falls])  # at most as programmed, which is no limit
    assert (start.groups.row_feeds(feeds[1])[falls] <= moves.feed[falls] * (1 + 1e-9)).all()
    for tried, free in ((beyond, ~down), (below, np.ones(many, dtype=bool))):
        found = problem.evaluate(start.groups, tried, np.tile(speeds[0], (many, 1)))
        assert (found.violation[free] > 0).all()
    assert down.any() and not down.all()
    assert (feeds[0] < feeds[1]).all()


def test_speeds_are_whole_or_as_the_start_had_them() -> None:
    problem, start, _ = shares_of("paper", 1)
    odd = Decision(groups=start.groups, feeds=start.feeds, speeds=start.speeds - 0.4)
    shares = BoundedGenes.of(problem, odd)
    _, kept = shares.decoded(shares.encoded(odd.feeds[None], odd.speeds[None]))
    assert (kept == odd.speeds).all()
    genes = random_genes(shares, 200, 0)
    _, speeds = shares.decoded(genes)
    assert ((speeds == np.round(speeds)) | (speeds == odd.speeds)).all()


def test_speeds_have_the_range_of_all_their_rows() -> None:
    _, start, shares = shares_of("paper", 1)
    many = start.groups.feeds
    assert (shares.low[many:] == 1000).all() and (shares.high[many:] == 8000).all()
    narrow = zigzag_problem(1, replace(PAPER, speed_rpm=(5000.2, 5000.8)))
    held = BoundedGenes.of(narrow, replace(start, speeds=np.full(len(start.speeds), 5000.5)))
    assert (held.low[many:] == 5000.5).all() and (held.high[many:] == 5000.5).all()


def test_lobes_are_kept_too() -> None:
    stiff = tuple(replace(mode, stiffness_N_m=30e6) for mode in MODES)
    problem = zigzag_problem(0, FREE, dynamics=TipDynamics(source="made up", every=stiff))
    moves = problem.cut.plan.path.moves
    groups = Groups(
        feed=problem.editable.block, speed=np.where(problem.editable.speed, 0, -1),
        own_feed=moves.feed, own_speed=moves.speed,
    )  # fmt: skip
    start = Decision(groups=groups, feeds=np.full(groups.feeds, 100.0), speeds=np.array([9500.0]))
    shares = BoundedGenes.of(problem, start)
    feeds, speeds = shares.decoded(random_genes(shares, 40, 0))
    low, high = group_bounds(problem, groups, speeds)
    possible = (low <= high).all(axis=1)
    stable = problem.stable(groups.row_speeds(speeds)).all(axis=1)
    assert 0 < stable.sum() < 40 and not possible[~stable].any()
    violation = problem.evaluate(groups, feeds, speeds).violation
    assert (violation[possible] == 0).all() and (violation[~stable] > 0).all()


VALUES = st.floats(0, 1e12)


def fitness(values, violation, **choices) -> Fitness:
    """Of individuals with given objectives, whose genes are their places."""
    found = SimpleNamespace(objectives=np.array(values)[:, None], violation=np.array(violation))
    return Fitness(
        problem=SimpleNamespace(evaluate=lambda groups, feeds, speeds: found),
        genes=SimpleNamespace(groups=None, decoded=lambda genes: (genes, genes)),
        column=0, **choices,
    )  # fmt: skip


def places(many: int) -> np.ndarray:
    return np.arange(float(many))[:, None]


@given(inside=st.lists(VALUES, min_size=1), beyond=st.lists(VALUES, min_size=1),
       over=st.floats(1e-9, 1e9), reference=st.floats(1e-3, 1e6))  # fmt: skip
def test_nothing_beyond_a_limit_costs_less_than_what_is_inside(
    inside: list[float], beyond: list[float], over: float, reference: float
) -> None:
    violation = [0.0] * len(inside) + [over] * len(beyond)
    costs = fitness(inside + beyond, violation, reference=reference)(places(len(violation)))
    assert costs[: len(inside)].max() <= 1.0 <= costs[len(inside) :].min()


@given(values=st.lists(st.floats(0.1, 10), min_size=2, max_size=9, unique=True))
def test_inside_the_limits_the_objective_orders(values: list[float]) -> None:
    costs = fitness(values, np.zeros(len(values)), reference=1.0)(places(len(values)))
    # neighbouring floats may come to the same cost, but not change places
    assert (np.diff(costs[np.argsort(values)]) >= 0).all()


def test_beyond_the_limits_the_violation_orders() -> None:
    costs = fitness([1.0, 2.0, 3.0], [0.3, 0.2, 0.1], reference=1.0)(places(3))
    assert costs.tolist() == [1.3, 1.2, 1.1]


def test_a_weight_makes_it_a_penalty() -> None:
    costs = fitness([10.0, 30.0], [2.0, 0.0], reference=10.0, weight=0.5)(places(2))
    assert costs.tolist() == [2.0, 3.0]


def test_it_counts_and_keeps_the_best_that_was_inside() -> None:
    one = fitness([5.0, 3.0, 1.0, 4.0], [0.0, 0.0, 0.1, 0.0], reference=1.0)
    one(places(4))
    assert (one.evaluations, one.best, one.history) == (4, 3.0, [5.0, 3.0, 3.0, 3.0])
    assert one.decision is not None and one.decision.feeds == 1.0
    one(places(4))
    assert (one.evaluations, len(one.history)) == (8, 8)


def test_what_is_not_known_is_no_best() -> None:
    one = fitness([np.nan, 7.0], [0.0, 0.0], reference=1.0)
    costs = one(places(2))
    assert np.isnan(costs[0]) and one.best == pytest.approx(7.0, rel=0)
