"""Fuzzy c-means against scikit-fuzzy and its own optimum; sensor groups and their order."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skfuzzy import cmeans

from pipeline.thermal.sensors import (
    _at_rest,
    fuzzy_c_means,
    memberships,
    objective,
    sensor_groups,
)

Array = NDArray[np.float64]


def clouds(many: int = 500, dimensions: int = 9, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    middles = rng.normal(0, 2.5, (3, dimensions))
    return middles[rng.integers(3, size=many)] + rng.normal(size=(many, dimensions))


@pytest.mark.parametrize("many", [9, 500])
def test_it_comes_to_rest_where_scikit_fuzzy_does(many):
    x = clouds(many)
    centres, found = fuzzy_c_means(x, 3)
    theirs, shares, *_ = cmeans(x.T, 3, 2.0, 1e-13, 400, init=found.T)
    np.testing.assert_allclose(centres, theirs, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found, shares.T, rtol=0, atol=1e-6)


def test_the_objective_is_least_there():
    """Neither other centres nor other memberships near by have a lower one."""
    x, rng = clouds(), np.random.default_rng(2)
    centres, found = fuzzy_c_means(x, 4)

    def objective(at: Array, shares: Array) -> float:
        return float((shares**2 * ((x[:, None] - at) ** 2).sum(axis=2)).sum())

    least = objective(centres, found)
    for _ in range(20):
        moved = centres + 0.01 * rng.normal(size=centres.shape)
        other = np.clip(found + 0.01 * rng.normal(size=found.shape), 1e-9, None)
        assert objective(moved, found) > least
        assert objective(centres, other / other.sum(axis=1, keepdims=True)) > least


@pytest.mark.parametrize("seed", range(12))
def test_the_least_of_several_minima_is_found(seed):
    """Two groups close together and two far off: many a start puts both centres into one."""
    rng = np.random.default_rng(7)
    middles = np.array([[0.0, 0.0], [0.9, 0.0], [30.0, 0.0], [31.0, 0.0], [0.0, 40.0]])
    x = middles[np.repeat(range(5), 12)] + 0.1 * rng.normal(size=(60, 2))
    starts = [_at_rest(x, x[rng.choice(60, 5, replace=False)]) for _ in range(40)]
    costs = [objective(x, one) for one in starts]
    assert max(costs) > 1.2 * min(costs)
    assert objective(x, fuzzy_c_means(x, 5, seed=seed)[0]) < 1.0001 * min(costs)


def test_a_point_on_a_centre_belongs_to_it_alone_and_to_centres_that_coincide_alike():
    x = np.array([[0.0], [10.0], [1.0]])
    alone = memberships(x, np.array([[0.0], [10.0]]))
    assert alone[:2].tolist() == [[1.0, 0.0], [0.0, 1.0]]
    np.testing.assert_allclose(alone[2], [81 / 82, 1 / 82])
    shared = memberships(x, np.array([[0.0], [0.0], [4.0]]))
    assert shared[0].tolist() == [0.5, 0.5, 0.0]


def test_the_same_seed_gives_the_same_clusters_bit_by_bit():
    one, two = (fuzzy_c_means(clouds(), 3, seed=4)[1] for _ in range(2))
    assert np.array_equal(one, two)


def test_points_in_fewer_places_than_clusters_are_refused():
    with pytest.raises(ValueError, match="points lie in 2 places for 3 clusters"):
        fuzzy_c_means([[1.0], [1.0], [2.0]], 3)


RISES = np.array([12.0, 11.5, 12.4, 6.0, 6.3, 5.8, 1.5, 1.2, 1.4])
"""Warming of nine sensors, three at the front bearings, three between, three at the rear [K]."""


def warming(seed: int = 0, offsets: float = 0.0) -> Array:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4, 300)[:, None]
    course = 1 - np.exp(-t / (0.6 + np.arange(9) / 10))
    return 20 + RISES * course + 0.02 * rng.normal(size=(300, 9)) + offsets * rng.normal(size=9)


@pytest.mark.parametrize("seed", range(6))
def test_groups_are_ordered_from_front_to_rear_whatever_the_seed(seed):
    found = sensor_groups(warming(offsets=3.0), seed=seed)
    assert found.argmax(axis=0).tolist() == [0] * 3 + [1] * 3 + [2] * 3
    backward = sensor_groups(warming(offsets=3.0)[:, ::-1], seed=seed)
    np.testing.assert_allclose(backward[::-1, ::-1], found, atol=1e-6)


def test_group_temperatures_are_the_cluster_centres_in_time():
    measured = warming()
    centred = measured - measured.mean(axis=0)
    centres = fuzzy_c_means(centred.T, 3)[0]
    order = np.argsort(-np.ptp(centres, axis=1))  # the front warms most
    weights = sensor_groups(measured)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(centred @ weights.T, centres[order].T, atol=1e-5)


def test_sensors_that_cannot_be_grouped_are_refused():
    with pytest.raises(ValueError, match="300 samples of 2 sensors for 3 groups"):
        sensor_groups(warming()[:, :2])
