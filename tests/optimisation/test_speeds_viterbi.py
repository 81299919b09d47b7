"""Viterbi's way through the grid of speeds, against all ways."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.optimisation.direct.cheapest_path import cheapest_path


def price(path, values, change, kind, word):
    """What a way costs, added up as it stands in the docstring."""
    total = sum(values[stage, state] for stage, state in enumerate(path))
    for stage in range(1, len(path)):
        before, after = path[stage - 1], path[stage]
        if before != after:
            total += change[kind[stage], before, after] + word[stage]
    return total


@st.composite
def stages(draw):
    """Up to 5 stages of up to 4 states, some forbidden, two kinds of change."""
    many, states = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    cost = st.one_of(st.floats(0.0, 10.0), st.just(np.inf))
    numbers = draw(st.lists(cost, min_size=many * states, max_size=many * states))
    moves = draw(st.lists(cost, min_size=2 * states**2, max_size=2 * states**2))
    kind = draw(st.lists(st.integers(0, 1), min_size=many, max_size=many))
    word = draw(st.lists(st.floats(0.0, 3.0), min_size=many, max_size=many))
    change = np.reshape(moves, (2, states, states))
    change[:, range(states), range(states)] = 0.0
    return np.reshape(numbers, (many, states)), change, np.array(kind), np.array(word)


@given(stages())
def test_no_way_is_cheaper(given_stages):
    """Exhaustive search; sums of at most 9 terms below 10 agree to 1e-12."""
    values, change, kind, word = given_stages
    least = min(
        price(path, values, change, kind, word)
        for path in product(range(values.shape[1]), repeat=len(values))
    )
    found = price(cheapest_path(values, change, kind, word), values, change, kind, word)
    assert found == least or found == pytest.approx(least, rel=1e-12, abs=1e-12)


def test_of_equal_speeds_the_lowest_is_taken_and_kept():
    values = np.array([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 2.0]])
    path = cheapest_path(values, np.full((1, 3, 3), 0.5), np.zeros(3, int), np.zeros(3))
    assert path.tolist() == [1, 1, 1]


def test_equal_changes_come_early():
    """S changes in the air before a cut rather than with it."""
    values = np.array([[0.0, 5.0], [0.0, 0.0], [5.0, 0.0]])
    change = np.ones((1, 2, 2))
    path = cheapest_path(values, change, np.zeros(3, int), np.zeros(3))
    assert path.tolist() == [0, 1, 1]
