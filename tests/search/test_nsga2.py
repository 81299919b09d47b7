"""NSGA-II against fronts of closed form, against limits, and against pymoo on the same budget."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu

from pipeline.search.nsga2 import FrontSettings, front
from tests.search.fronts import (
    binh_korn,
    binh_korn_front,
    hypervolume,
    ideal_hypervolume,
    on_front,
    zdt,
)

GENES, SMALL = 30, FrontSettings(population=20, generations=15, seed=3)


def found(which: int, seed: int, generations: int = 200):
    settings = FrontSettings(population=100, generations=generations, seed=seed)
    return front(zdt(which), np.zeros(GENES), np.ones(GENES), settings)


def theirs(which: int, seed: int, generations: int = 200) -> np.ndarray:
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.optimize import minimize
    from pymoo.problems import get_problem

    result = minimize(
        get_problem(f"zdt{which}"), NSGA2(pop_size=100), ("n_gen", generations), seed=seed
    )
    assert result.algorithm.evaluator.n_eval == 100 * generations
    return np.asarray(result.F)


@pytest.mark.parametrize("which", [1, 2, 3])
def test_it_reaches_the_fronts_of_closed_form(which: int) -> None:
    result = found(which, seed=1)
    f, second = result.objectives.T
    # g - 1 is what 20 000 evaluations leave of nine units (Deb et al. 2002: below 0.04 mean)
    assert np.abs(second - on_front(which, f)).mean() < 0.02
    assert hypervolume(result.objectives) > 0.98 * ideal_hypervolume(which)
    assert len(result.x) == 100


@pytest.mark.filterwarnings("ignore::DeprecationWarning:pymoo")
@pytest.mark.parametrize(
    ("which", "seeds", "generations"),
    [(1, 4, 40), *(pytest.param(which, 11, 200, marks=pytest.mark.proof) for which in (1, 2, 3))],
)
def test_its_front_is_not_worse_than_pymoos(which: int, seeds: int, generations: int) -> None:
    mine = [hypervolume(found(which, seed, generations).objectives) for seed in range(seeds)]
    other = [hypervolume(theirs(which, seed, generations)) for seed in range(seeds)]
    worse = mannwhitneyu(mine, other, alternative="less").pvalue
    # three problems together at 5 % (Bonferroni)
    assert worse > 0.05 / 3, f"{np.median(mine):.5f} against {np.median(other):.5f}"


def test_limits_come_first() -> None:
    settings = FrontSettings(population=60, generations=100, seed=2)
    result = front(binh_korn, [0.0, 0.0], [5.0, 3.0], settings)
    assert (result.violation == 0).all()
    scale = np.array([136.0, 50.0])  # what the front spans
    known = binh_korn_front() / scale
    distance = [np.hypot(*(known - member / scale).T).min() for member in result.objectives]
    # a tenth of the gap between 60 members over a front of length 1.6
    assert np.mean(distance) < 0.0027
    ends = result.objectives / scale
    assert ends.min(axis=0) == pytest.approx([0.0, 4.0 / 50.0], abs=0.01)


def test_without_an_individual_inside_the_limits_the_least_violation_stands() -> None:
    def judge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.stack([x[:, 0], -x[:, 0]], axis=1), 1 + np.abs(x[:, 0] - 0.3)

    result = front(judge, [0.0], [1.0], FrontSettings(population=20, generations=60))
    # steps of mutation shrink with the distance: 60 generations leave less than a thousandth
    assert result.violation.max() < 1.001 and result.x[0, 0] == pytest.approx(0.3, abs=1e-3)


def test_one_objective_alone_gives_its_least() -> None:
    def judge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return ((x - 0.25) ** 2).sum(axis=1, keepdims=True), np.zeros(len(x))

    result = front(judge, [0, 0], [1, 1], FrontSettings(population=20, generations=80))
    assert len(result.x) == 1 and result.x[0] == pytest.approx([0.25, 0.25], abs=0.01)


@given(
    population=st.integers(4, 21),
    generations=st.integers(1, 6),
    d=st.integers(1, 4),
    objectives=st.integers(1, 4),
    seed=st.integers(0, 99),
)
@settings(deadline=None)
def test_bounds_counts_and_domination_hold_whatever_the_settings(
    population: int, generations: int, d: int, objectives: int, seed: int
) -> None:
    asked = []

    def judge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        asked.append(x.copy())
        centres = np.linspace(0.2, 0.8, objectives)
        return np.stack([((x - c) ** 2).sum(axis=1) for c in centres], axis=1), np.maximum(
            0.0, 0.1 - x[:, 0]
        )

    low, high = np.zeros(d), np.linspace(1, 2, d)
    some = FrontSettings(population=population, generations=generations, seed=seed)
    result = front(judge, low, high, some)
    x = np.concatenate(asked)
    assert ((x >= low) & (x <= high)).all()
    assert result.evaluations == len(x) == population * generations
    ours = result.objectives
    dominated = (ours[:, None] <= ours).all(axis=2) & (ours[:, None] < ours).any(axis=2)
    assert not dominated.any()
    assert len(np.unique(result.x, axis=0)) == len(result.x) >= 1


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    def run(seed: int) -> bytes:
        settings = FrontSettings(population=20, generations=15, seed=seed)
        return front(zdt(1), np.zeros(5), np.ones(5), settings).x.tobytes()

    assert run(3) == run(3) != run(4)


def test_a_start_on_the_front_stays() -> None:
    start = np.zeros((1, 5))
    result = front(zdt(1), np.zeros(5), np.ones(5), SMALL, start=start)
    # the start is the least of the first objective: nothing dominates it
    assert result.objectives[0] == pytest.approx([0.0, 1.0], abs=1e-15)


def test_a_callback_ends_it_with_the_front_it_saw() -> None:
    seen = []

    def callback(done: int, x: np.ndarray, objectives: np.ndarray) -> bool:
        seen.append((x, objectives))
        return done == 4

    result = front(zdt(1), np.zeros(5), np.ones(5), SMALL, callback=callback)
    assert (result.stopped, result.generations, len(seen)) == ("callback", 4, 4)
    assert result.evaluations == 4 * SMALL.population
    assert (result.x == seen[-1][0]).all() and (result.objectives == seen[-1][1]).all()


def test_one_that_fails_counts_as_the_worst() -> None:
    def judge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        objectives, violation = zdt(1)(x)
        objectives[x[:, 0] > 0.5] = np.nan
        return objectives, violation

    result = front(judge, np.zeros(5), np.ones(5), SMALL)
    assert result.failed > 0 and (result.x[:, 0] <= 0.5).all()


def test_an_answer_of_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(20,\).*return shapes \(20, O\) and \(20,\)"):
        front(lambda x: (x[:, 0], x[:, 0]), [0.0], [1.0], SMALL)


def test_more_starts_than_places_are_refused() -> None:
    with pytest.raises(ValueError, match=r"start has 21 individuals.*population of the front"):
        front(zdt(1), np.zeros(2), np.ones(2), SMALL, start=np.zeros((21, 2)))


def test_a_front_of_three_places_is_refused() -> None:
    with pytest.raises(ValueError, match=r"front.population = 3 must be finite and at least 4"):
        FrontSettings(population=3)
