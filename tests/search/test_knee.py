"""The knee of a front: closed forms, symmetries, and fronts that are hardly any."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.search.knee import knee


def test_of_a_hyperbola_it_is_where_the_slope_is_that_of_the_ends() -> None:
    x = np.linspace(0.1, 1, 901)
    # y = 0.1 / x from (0.1, 1) to (1, 0.1): slope -1 at the root of 0.1
    assert x[knee(np.stack([x, 0.1 / x], axis=1))] == pytest.approx(np.sqrt(0.1), abs=1e-3)


def test_of_a_sphere_bent_to_the_ideal_it_is_its_middle() -> None:
    a, b = np.meshgrid(np.linspace(0, np.pi / 2, 61), np.linspace(0, np.pi / 2, 61))
    sphere = np.stack([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)], axis=-1)
    front = 1 - sphere.reshape(-1, 3)
    # a step of the grid is 0.026
    assert front[knee(front)] == pytest.approx(np.full(3, 1 - 3**-0.5), abs=0.02)


@given(
    scale=st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3),
    offset=st.lists(st.floats(-10, 10), min_size=3, max_size=3),
    many=st.integers(1, 20),
    seed=st.integers(0, 999),
)
def test_it_does_not_know_the_units(
    scale: list[float], offset: list[float], many: int, seed: int
) -> None:
    front = np.random.default_rng(seed).random((many, 3))
    assert knee(front * scale + np.array(offset)) == knee(front)


@given(columns=st.permutations(range(4)), seed=st.integers(0, 999))
def test_it_does_not_know_the_order_of_objectives(columns: list[int], seed: int) -> None:
    front = np.random.default_rng(seed).random((9, 4))
    assert knee(front[:, columns]) == knee(front)


@pytest.mark.parametrize(
    ("front", "place"),
    [
        ([[3.0, 5.0, 7.0]], 0),  # one member
        ([[1.0, 2.0]] * 3, 0),  # the same three times
        ([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]], 0),  # a line: all as far, the first
        ([[0.0, 1.0], [0.8, 0.8], [1.0, 0.0]], 0),  # away from the ideal: an end
        ([[0.0, 1.0], [1.0, 0.0]], 0),  # two ends
        ([[5.0], [4.0], [6.0]], 1),  # one objective
        ([[0.0, 1.0, 2.0], [0.4, 0.4, 2.0], [1.0, 0.0, 2.0]], 1),  # one objective without a range
        ([[0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.3, 0.3, 0.3]], 2),  # two objectives that go together
    ],
)
def test_it_is_defined_for_every_front(front: list[list[float]], place: int) -> None:
    assert knee(front) == place


@pytest.mark.parametrize("front", [np.empty((0, 2)), [[0.0, np.nan]], [1.0, 2.0]])
def test_no_front_has_no_knee(front: object) -> None:
    with pytest.raises(ValueError, match="has no knee"):
        knee(front)  # type: ignore[arg-type]
