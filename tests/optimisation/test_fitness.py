"""Limits first in one number, whatever the objectives; and what is counted."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.optimisation.search.fitness import Fitness

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
