"""What all searches with a population share: counts, bounds, seeds, kinds of numbers, failures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.search import result
from pipeline.search.methods import METHODS, minimise
from tests.search.landscapes import rastrigin, sphere

NAMES = sorted(METHODS)
LOW, HIGH = np.full(3, -2.0), np.full(3, 3.0)
BUDGET = {"population": 8, "generations": 20}


class Counting:
    """A cost that keeps what it was asked."""

    def __init__(self, cost=sphere) -> None:
        self.cost, self.asked = cost, []

    def __call__(self, x: np.ndarray) -> np.ndarray:
        self.asked.append(x.copy())
        return self.cost(x)


@pytest.mark.parametrize("name", NAMES)
@given(
    population=st.integers(2, 12),
    generations=st.integers(1, 8),
    d=st.integers(1, 4),
    seed=st.integers(0, 99),
    data=st.data(),
)
@settings(deadline=None, max_examples=25)
def test_bounds_counts_and_history_hold(
    name: str, population: int, generations: int, d: int, seed: int, data: st.DataObject
) -> None:
    kinds = st.lists(st.booleans(), min_size=d, max_size=d)
    log, integer = np.array(data.draw(kinds)), np.array(data.draw(kinds))
    low = np.where(log, 1.0, -np.arange(1.0, d + 1))
    high = low + np.arange(d) * 100.0  # the first is held
    cost = Counting()
    found = minimise(
        name, cost, low, high, population=population, generations=generations, seed=seed,
        log=log, integer=integer,
    )  # fmt: skip
    asked = np.concatenate(cost.asked)
    assert ((asked >= low) & (asked <= high)).all()
    assert (asked[:, integer] == np.floor(asked[:, integer])).all()
    assert [len(x) for x in cost.asked] == [population] * generations
    assert found.evaluations == population * generations
    best = np.minimum.accumulate(sphere(asked))[population - 1 :: population]
    np.testing.assert_array_equal(found.history, best)
    np.testing.assert_array_equal(found.x, asked[np.argmin(sphere(asked))])
    np.testing.assert_array_equal(found.costs, np.sort(sphere(found.population)))
    assert found.stopped == "generations"
    assert found.at_bounds[0] == 0


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_bytes_and_another_does_not(name: str) -> None:
    one, two = (minimise(name, rastrigin, LOW, HIGH, **BUDGET, seed=3) for _ in range(2))
    assert one.population.tobytes() == two.population.tobytes()
    assert one.history.tobytes() == two.history.tobytes()
    other = minimise(name, rastrigin, LOW, HIGH, **BUDGET, seed=4)
    assert other.population.tobytes() != one.population.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_all_begin_with_the_same_population(name: str) -> None:
    """So that a comparison on one seed is one of what they make of it."""
    costs = [Counting(), Counting()]
    for search, cost in zip((name, "random"), costs, strict=True):
        minimise(search, cost, LOW, HIGH, **BUDGET, seed=5, start=[[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(costs[0].asked[0], costs[1].asked[0])
    assert costs[0].asked[0][0].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("name", [name for name in NAMES if name != "random"])
def test_it_is_better_than_random_search_on_the_same_budget(name: str) -> None:
    """Eight variables, 1500 evaluations, the optimum off the middle; the median of nine seeds."""
    low, high = np.full(8, -2.0), np.full(8, 3.0)

    def median(search: str) -> float:
        return float(
            np.median(
                [
                    minimise(search, sphere, low, high, population=30, generations=50, seed=s).cost
                    for s in range(9)
                ]
            )
        )

    assert median(name) < 0.5 * median("random")


@pytest.mark.parametrize("name", NAMES)
def test_the_tuning_of_a_network_in_small(name: str) -> None:
    """A rate over two decades, a whole number of units and a decay: as few evaluations as there."""

    def cost(x: np.ndarray) -> np.ndarray:
        rate, units, decay = np.log10(x[:, 0]), x[:, 1], np.log10(x[:, 2])
        return (rate + 2.4) ** 2 + ((units - 70) / 50) ** 2 + (0.3 * (decay + 2.5)) ** 2

    found = minimise(
        name, cost, [1e-3, 50, 1e-4], [1e-1, 100, 1e-1], **BUDGET,
        log=[True, False, True], integer=[False, True, False], seed=1,
    )  # fmt: skip
    # the middle of the box, 1e-2 and 75 and 3e-3, costs 0.17
    assert found.cost < 0.1
    assert found.x[1] == int(found.x[1])


@pytest.mark.parametrize("name", ["whale", "swarm", "wolf"])
def test_an_optimum_at_its_bounds_is_reported_by_name(name: str) -> None:
    """As the published search of the feed axis ended: on three lower bounds."""
    found = minimise(
        name, lambda x: np.log(x).sum(axis=1), [0.001, 50, 1e-4, 2], [0.01, 100, 0.1, 2],
        population=8, generations=30, log=[True, False, True, False],
        integer=[False, True, False, False],
    )  # fmt: skip
    names = ("learning rate", "units", "decay", "layers")
    assert found.bounds_hit(names) == {"learning rate": "low", "units": "low", "decay": "low"}
    with pytest.raises(ValueError, match="3 names for 4 parameters"):
        found.bounds_hit(names[:3])


@pytest.mark.parametrize("name", NAMES)
def test_an_optimum_inside_is_at_no_bound(name: str) -> None:
    found = minimise(name, sphere, LOW, HIGH, population=20, generations=40)
    assert found.at_bounds.tolist() == [0, 0, 0] and found.bounds_hit("abc") == {}


@pytest.mark.parametrize("name", ["genetic", "swarm"])
def test_costs_that_are_no_number_count_as_the_worst(name: str) -> None:
    def cost(x: np.ndarray) -> np.ndarray:
        return np.where(x[:, 0] < 0.3, np.nan, sphere(x))

    found = minimise(name, cost, LOW, HIGH, **BUDGET)
    assert 0 < found.failed < found.evaluations
    assert np.isfinite(found.cost) and found.x[0] >= 0.3
    lost = minimise(name, lambda x: np.full(len(x), np.nan), LOW, HIGH, **BUDGET)
    assert lost.cost == np.inf and lost.failed == lost.evaluations == 160
    assert ((lost.x >= LOW) & (lost.x <= HIGH)).all()


@pytest.mark.parametrize("name", ["genetic", "swarm"])
def test_a_cost_that_spoils_its_array_does_no_harm(name: str) -> None:
    def spoiling(x: np.ndarray) -> np.ndarray:
        costs = sphere(x)
        x[:] = np.nan
        return costs

    one, two = (minimise(name, cost, LOW, HIGH, **BUDGET) for cost in (sphere, spoiling))
    assert one.population.tobytes() == two.population.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_it_ends_by_limit_stall_and_callback(name: str) -> None:
    method = METHODS[name]

    def ended(**more):
        some = method(population=8, generations=50, **more)
        return result.minimise(sphere, LOW, HIGH, some)

    good = ended(limit=1.0)
    assert good.stopped == "limit" and good.cost <= 1.0 < good.history[-2]
    # nothing gains more than the largest cost of the box, 27
    idle = ended(stall=3, stall_gain=30.0)
    assert (idle.stopped, idle.generations) == ("stall", 4)
    seen = []

    def callback(done: int, x: np.ndarray, cost: float) -> bool:
        seen.append((done, cost))
        return done == 5

    found = minimise(name, sphere, LOW, HIGH, **BUDGET, callback=callback)
    assert found.stopped == "callback" and found.evaluations == 40
    assert seen == list(enumerate(found.history.tolist(), start=1))


@pytest.mark.parametrize("name", NAMES)
def test_one_individual_and_one_generation_are_enough(name: str) -> None:
    few = max(1, 2 * (name == "genetic"))
    assert minimise(name, sphere, LOW, HIGH, population=few, generations=3).evaluations == 3 * few
    assert minimise(name, sphere, LOW, HIGH, population=few, generations=1).evaluations == few


def test_a_search_that_is_none_is_refused_with_the_names_of_those_there_are() -> None:
    with pytest.raises(ValueError, match="'krill' is not one of genetic, whale, swarm, wolf"):
        minimise("krill", sphere, LOW, HIGH, **BUDGET)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("setting", "value"), [("population", 0), ("generations", 0), ("stall", 2.5), ("seed", -1)]
)
def test_settings_out_of_range_are_refused_by_name(name: str, setting: str, value) -> None:
    with pytest.raises(ValueError, match=rf"^{name}\.{setting} = {value} "):
        METHODS[name](**{setting: value})
