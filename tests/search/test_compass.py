"""A few evaluations around a start: budget, bounds, and what parabolas promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.search.compass import compass
from tests.search.landscapes import LANDSCAPES, rosenbrock, sphere


@given(
    d=st.integers(1, 6),
    evaluations=st.integers(1, 60),
    step=st.floats(1e-3, 1),
    landscape=st.sampled_from(sorted(LANDSCAPES)),
    seed=st.integers(0, 99),
)
@settings(max_examples=40)
def test_it_is_never_worse_than_its_start_and_never_over_its_budget(
    d: int, evaluations: int, step: float, landscape: str, seed: int
) -> None:
    some = LANDSCAPES[landscape]
    low, high = some.bounds(d)
    start = np.random.default_rng(seed).uniform(low, high)
    asked = []

    def cost(x: np.ndarray) -> np.ndarray:
        asked.append(x)
        return some.cost(x)

    found = compass(cost, low, high, start, evaluations=evaluations, step=step)
    x = np.concatenate(asked)
    assert ((x >= low) & (x <= high)).all()
    assert found.evaluations == len(x) <= evaluations
    # 1e-9: the start goes through the unit cube and back
    assert found.cost <= some.cost(start[None])[0] * (1 + 1e-9)
    assert found.cost == some.cost(x).min()
    assert (np.diff(found.history) <= 0).all()


@given(
    centre=st.lists(st.floats(0.3, 0.7), min_size=1, max_size=5),
    scale=st.floats(0.01, 100),
    seed=st.integers(0, 99),
)
def test_of_a_sum_of_parabolas_it_finds_the_least_in_one_round(
    centre: list[float], scale: float, seed: int
) -> None:
    weight = np.random.default_rng(seed).uniform(0.5, 2, len(centre))

    def cost(x: np.ndarray) -> np.ndarray:
        return scale * (1 + (weight * (x - centre) ** 2).sum(axis=1))

    d = len(centre)
    found = compass(cost, np.zeros(d), np.ones(d), np.full(d, 0.5), evaluations=2 * d + 3)
    # differences of costs near 1 over steps of 0.1 hold 1e-16 / 0.01
    assert found.x == pytest.approx(np.array(centre), abs=1e-12)


def test_axes_take_turns_where_a_round_has_no_place_for_all() -> None:
    start = np.full(8, 0.9)
    # six evaluations a round ask for two axes: four rounds see all eight
    seen = set()

    def cost(x: np.ndarray) -> np.ndarray:
        seen.update(np.flatnonzero((x != start).any(axis=0)).tolist())
        return -np.ones(len(x))

    compass(cost, np.zeros(8), np.ones(8), start, evaluations=8)
    assert seen == {0, 1, 2}
    compass(cost, np.zeros(8), np.ones(8), start, evaluations=18)
    assert seen == set(range(8))


def test_axes_that_act_on_each_other_take_more_rounds_but_get_there() -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return (x.sum(axis=1) - 1) ** 2 + 0.1 * (x[:, 0] - x[:, 1] - 0.2) ** 2

    found = compass(cost, [0, 0], [1, 1], [0.1, 0.1], evaluations=400)
    # steps shrink by 4 a round that fails: 60 rounds leave next to nothing
    assert found.x == pytest.approx([0.6, 0.4], abs=1e-4)


def test_a_logarithmic_axis_is_searched_by_its_orders_of_magnitude() -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return (np.log10(x[:, 0]) + 4) ** 2

    found = compass(cost, [1e-8], [1.0], [1e-6], evaluations=5, log=True)
    assert found.x[0] == pytest.approx(1e-4, rel=1e-9)


def test_what_is_held_stays_and_what_fails_is_no_gain() -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return np.where(x[:, 0] < 0.5, np.nan, sphere(x))

    found = compass(cost, [0, 3], [1, 3], [0.8, 3], evaluations=40)
    assert found.x[1] == 3 and 0.5 <= found.x[0] < 0.51
    assert found.failed > 0


def test_a_callback_ends_it() -> None:
    found = compass(
        rosenbrock, [-2, -2], [2, 2], [-1.2, 1.0], evaluations=6000,
        callback=lambda done, x, cost: done == 3,
    )  # fmt: skip
    assert (found.stopped, found.generations) == ("callback", 3)
    # the start, and two rounds of four neighbours and two promises
    assert found.evaluations == 13


@pytest.mark.parametrize(("evaluations", "step"), [(0, 0.1), (5, 0.0), (5, 1.5)])
def test_no_budget_and_no_step_are_refused(evaluations: int, step: float) -> None:
    with pytest.raises(ValueError, match=rf"evaluations = {evaluations} .*step = {step}"):
        compass(sphere, [0.0], [1.0], [0.5], evaluations=evaluations, step=step)
