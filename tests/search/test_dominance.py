"""Sorting by domination against its definition, crowding distances, and the knee of a front."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.search.nsga2 import crowded_tournament, crowding, knee, ranks, survivors

GRID = st.integers(0, 4).map(float)  # few values, so that ties are common


def populations() -> st.SearchStrategy[tuple[np.ndarray, np.ndarray]]:
    return st.tuples(st.integers(1, 14), st.integers(1, 4)).flatmap(
        lambda shape: st.tuples(
            arrays(np.float64, shape, elements=GRID),
            arrays(np.float64, shape[:1], elements=st.sampled_from([0.0, 0.0, 0.0, 1.0, 2.0])),
        )
    )


def beats(one: np.ndarray, other: np.ndarray, mine: float, theirs: float) -> bool:
    """Constrained domination, word for word (Deb et al. 2002, definition 1)."""
    if mine == 0 and theirs == 0:
        return all(a <= b for a, b in zip(one, other, strict=True)) and any(
            a < b for a, b in zip(one, other, strict=True)
        )
    if mine == 0 or theirs == 0:
        return mine == 0
    return mine < theirs


def peeled(objectives: np.ndarray, violation: np.ndarray) -> list[int]:
    """Ranks by taking away, again and again, those whom nobody left beats."""
    left, found, rank = set(range(len(objectives))), [-1] * len(objectives), 0
    while left:
        front = [
            j
            for j in left
            if not any(
                beats(objectives[i], objectives[j], violation[i], violation[j]) for i in left
            )
        ]
        for j in front:
            found[j] = rank
        left -= set(front)
        rank += 1
    return found


@given(population=populations())
@settings(deadline=None)
def test_ranks_are_those_of_the_definition(population: tuple[np.ndarray, np.ndarray]) -> None:
    assert ranks(*population).tolist() == peeled(*population)


@given(population=populations(), data=st.data())
@settings(deadline=None)
def test_ranks_do_not_know_the_order_of_individuals(
    population: tuple[np.ndarray, np.ndarray], data: st.DataObject
) -> None:
    objectives, violation = population
    order = data.draw(st.permutations(range(len(violation))))
    assert (ranks(objectives[order], violation[order]) == ranks(*population)[order]).all()


def test_what_keeps_the_limits_comes_first_whatever_it_costs() -> None:
    objectives = np.array([[9.0, 9.0], [0.0, 0.0], [1.0, 1.0]])
    assert ranks(objectives, np.array([0.0, 2.0, 1.0])).tolist() == [0, 2, 1]


def test_crowding_is_the_neighbours_distance_as_a_share_of_the_range() -> None:
    front = np.array([[0.0, 10.0], [1.0, 4.0], [4.0, 1.0], [10.0, 0.0]])
    # (4 - 0) / 10 + (10 - 1) / 10, (10 - 1) / 10 + (4 - 0) / 10
    assert crowding(front) == pytest.approx([np.inf, 1.3, 1.3, np.inf], rel=1e-15)


@given(front=populations().map(lambda p: p[0]))
def test_the_ends_of_each_objective_stand_infinitely_free(front: np.ndarray) -> None:
    free = np.isposinf(crowding(front))
    for column in front.T:
        assert free[column == column.min()].any() and free[column == column.max()].any()


def test_one_objective_without_a_range_does_not_count() -> None:
    front = np.array([[0.0, 3.0], [1.0, 3.0], [2.0, 3.0], [4.0, 3.0]])
    assert crowding(front)[1:3] == pytest.approx([0.5, 0.75], rel=1e-15)


@given(population=populations(), share=st.floats(0, 1))
@settings(deadline=None)
def test_no_survivor_is_worse_than_one_that_is_left(
    population: tuple[np.ndarray, np.ndarray], share: float
) -> None:
    objectives, violation = population
    stay, room = survivors(objectives, violation, max(1, round(share * len(violation))))
    gone = np.setdiff1d(np.arange(len(violation)), stay)
    front = ranks(objectives, violation)
    assert (np.diff(front[stay]) >= 0).all()
    last = front[stay].max()
    assert (front[gone] >= last).all()
    everyone = crowding(objectives[front == last])[np.cumsum(front == last) - 1]
    cut = gone[front[gone] == last]
    assert (everyone[cut] <= room[front[stay] == last].min(initial=np.inf)).all()


@given(population=populations(), draws=st.integers(1, 30), seed=st.integers(0, 99))
@settings(deadline=None)
def test_the_worst_of_all_never_wins_against_another(
    population: tuple[np.ndarray, np.ndarray], draws: int, seed: int
) -> None:
    objectives = np.concatenate([population[0], np.full((1, population[0].shape[1]), 9.0)])
    violation = np.append(population[1], 3.0)
    room = np.append(np.zeros(len(violation) - 1), np.inf)
    won = crowded_tournament(objectives, violation, room, draws, np.random.default_rng(seed))
    # in a round nobody meets oneself; an odd one out may meet oneself across two rounds
    assert (won == len(violation) - 1).sum() <= (draws if len(violation) % 2 else 0)
    assert won.shape == (draws,)


def test_of_those_that_do_not_dominate_each_other_the_freer_wins() -> None:
    objectives = np.array([[0.0, 1.0], [1.0, 0.0]])
    won = crowded_tournament(
        objectives, np.zeros(2), np.array([1.0, 2.0]), 50, np.random.default_rng(0)
    )
    assert (won == 1).all()


def test_chance_decides_between_equals() -> None:
    won = crowded_tournament(
        np.zeros((2, 2)), np.zeros(2), np.ones(2), 400, np.random.default_rng(0)
    )
    # binomial: 200 and a standard deviation of 10
    assert 150 < (won == 0).sum() < 250


# the knee: closed forms, symmetries, and degenerate fronts


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
