"""Fuzzy c-means against scikit-fuzzy and its own optimum; lags against their equation."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from skfuzzy import cmeans

from pipeline.thermal.sensors import (
    _at_rest,
    fuzzy_c_means,
    lag,
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


RNG = np.random.default_rng(0)
TIME = np.cumsum(RNG.uniform(20, 120, 80))
VALUES = np.cumsum(RNG.normal(size=(80, 3)), axis=0)


def test_a_lag_solves_its_differential_equation_at_uneven_samples():
    found = lag(TIME, VALUES[:, 0], 300.0)
    y = [VALUES[0, 0]]
    for k in range(len(TIME) - 1):  # kinks at the samples: integrated piece by piece
        slope = (VALUES[k + 1, 0] - VALUES[k, 0]) / (TIME[k + 1] - TIME[k])
        answer = solve_ivp(
            lambda t, y, k=k, slope=slope: (VALUES[k, 0] + slope * (t - TIME[k]) - y) / 300.0,
            (TIME[k], TIME[k + 1]), y[-1:], method="DOP853", rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        y.append(answer.y[0, -1])
    np.testing.assert_allclose(found, y, atol=1e-9)


def test_a_single_sample_rests():
    assert lag([5.0], [[20.0, 30.0]], 600.0).tolist() == [[20.0, 30.0]]


def test_samples_between_change_no_lag():
    """Exact for straight steps: half steps give the same, and so does a record cut finer."""
    fine = np.sort(np.concatenate([TIME, (TIME[1:] + TIME[:-1]) / 2]))
    between = np.stack([np.interp(fine, TIME, c) for c in VALUES.T], axis=-1)
    np.testing.assert_allclose(lag(fine, between, 40.0)[::2], lag(TIME, VALUES, 40.0), atol=1e-11)


def test_a_very_long_constant_keeps_its_digits():
    found = lag([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 1e12)
    np.testing.assert_allclose(found, [0.0, 0.5e-12, 2e-12], rtol=1e-3)


def test_the_future_changes_nothing():
    whole, other = lag(TIME, VALUES, 900.0), VALUES.copy()
    other[50:] += 100.0
    changed = lag(TIME, other, 900.0)
    assert np.array_equal(changed[:50], whole[:50])
    assert (changed[50] != whole[50]).all()
    assert np.array_equal(lag(TIME[:50], VALUES[:50], 900.0), whole[:50])


def test_a_column_is_the_same_alone_and_beside_others():
    for beside in (VALUES, np.asfortranarray(VALUES), VALUES.reshape(80, 3, 1)):
        found = lag(TIME, beside, 60.0).reshape(80, 3)
        for k in range(3):
            assert np.array_equal(found[:, k], lag(TIME, VALUES[:, k], 60.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"values": [[20.0], [np.nan]]}, r"values\[1, 0\] = nan at 60 s must"),
        ({"values": [1.0]}, r"values of shape \(1,\) must have a row for each of 2"),
        ({"time_s": [0.0, 0.0]}, r"time_s\[1\] = 0\.0 s must be finite and later"),
        ({"constant_s": 0.0}, r"lag of 0\.0 s must be finite and positive"),
    ],
)
def test_what_cannot_be_is_refused(change, words):
    given = {"time_s": [0.0, 60.0], "values": [[20.0], [21.0]], "constant_s": 60.0} | change
    with pytest.raises(ValueError, match=words):
        lag(**given)
