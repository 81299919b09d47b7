"""Fuzzy c-means against scikit-fuzzy and its own optimum; sensor groups and their order."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skfuzzy import cmeans

from pipeline.thermal.cluster_kernel import BLOCK
from pipeline.thermal.clusters import (
    FuzzyClusterSettings,
    fuzzy_c_means,
    sensor_groups,
)

Array = NDArray[np.float64]


def clouds(many: int = 500, dimensions: int = 9, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    middles = rng.normal(0, 2.5, (3, dimensions))
    return middles[rng.integers(3, size=many)] + rng.normal(size=(many, dimensions))


def start(many: int, clusters: int, seed: int = 1) -> Array:
    u = np.random.default_rng(seed).uniform(0.01, 1, (many, clusters))
    return u / u.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("fuzzifier", [2.0, 1.5, 2.7])
@pytest.mark.parametrize("many", [BLOCK - 1, BLOCK, 500])
@pytest.mark.parametrize("iterations", [1, 2, 7, 400])
def test_it_equals_scikit_fuzzy_from_the_same_start(
    fuzzifier: float, many: int, iterations: int
) -> None:
    x, u = clouds(many), start(many, 3)
    settings = FuzzyClusterSettings(fuzzifier=fuzzifier, iterations=iterations, tolerance=1e-13)
    ours = fuzzy_c_means(x, 3, settings, memberships=u)
    centres, memberships, *_ = cmeans(x.T, 3, fuzzifier, 1e-13, iterations, init=u.T)
    np.testing.assert_allclose(ours.centres, centres, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours.memberships, memberships.T, rtol=0, atol=1e-6)


def test_the_objective_falls_at_each_iteration_and_comes_to_rest() -> None:
    x, u = clouds(), start(500, 4)
    found = [
        fuzzy_c_means(x, 4, FuzzyClusterSettings(iterations=n), memberships=u)
        for n in (*range(1, 30), 2000)
    ]
    falls = np.diff([one.objective for one in found])
    assert (falls <= 1e-9).all() and falls[0] < 0
    assert found[-1].converged and found[-1].iterations < 2000 and not found[0].converged


def test_the_centres_are_the_means_by_the_memberships_powers() -> None:
    x = clouds(seed=3)
    found = fuzzy_c_means(x, 3, FuzzyClusterSettings(fuzzifier=1.8))
    w = found.memberships**1.8
    np.testing.assert_allclose(found.centres, (w.T @ x) / w.sum(axis=0)[:, None], atol=1e-7)
    np.testing.assert_allclose(found.memberships.sum(axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("fuzzifier", [2.0, 1.05, 20.0])
def test_a_point_on_a_centre_belongs_to_it_alone(fuzzifier: float) -> None:
    # mirrored: the centres of the given start are 0 and 10, where two points lie
    x = np.array([[-1.0], [0.0], [1.0], [9.0], [10.0], [11.0]])
    u = np.repeat(np.eye(2), 3, axis=0)
    found = fuzzy_c_means(
        x, 2, FuzzyClusterSettings(fuzzifier=fuzzifier, iterations=1), memberships=u
    )
    assert found.memberships[[1, 4]].tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_centres_that_coincide_share_a_point_that_lies_on_them() -> None:
    x = np.array([[0.0], [0.0], [4.0]])
    u = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = fuzzy_c_means(x, 3, FuzzyClusterSettings(iterations=1), memberships=u)
    assert found.memberships.tolist() == [[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]


def test_the_same_seed_gives_the_same_clusters_bit_by_bit() -> None:
    x = clouds()
    one, two = (fuzzy_c_means(x, 3, FuzzyClusterSettings(seed=4)) for _ in range(2))
    assert np.array_equal(one.memberships, two.memberships)


@pytest.mark.parametrize(
    ("points", "clusters", "words"),
    [
        ([[0.0], [np.nan]], 1, r"points\[1, 0\] = nan must be finite"),
        ([[0.0], [1.0]], 3, "clusters = 3 of 2 points"),
        ([[1.0], [1.0], [2.0]], 3, "points lie in 2 places for 3 clusters"),
        ([1.0, 2.0], 1, r"points of shape \(2,\)"),
    ],
)  # fmt: skip
def test_it_refuses(points: list, clusters: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fuzzy_c_means(points, clusters)


def test_memberships_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 1\) must have a row for each of 3 points"):
        fuzzy_c_means([[0.0], [1.0], [2.0]], 2, memberships=np.ones((2, 1)))
    with pytest.raises(ValueError, match=r"fuzzifier = 1\.0 must lie above 1"):
        FuzzyClusterSettings(fuzzifier=1.0)


RISES = np.array([12.0, 11.5, 12.4, 6.0, 6.3, 5.8, 1.5, 1.2, 1.4])
"""Warming of nine sensors, three at the front bearings, three between, three at the rear [K]."""


def warming(seed: int = 0, offsets: float = 0.0) -> Array:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4, 300)[:, None]
    course = 1 - np.exp(-t / (0.6 + np.arange(9) / 10))
    return 20 + RISES * course + 0.02 * rng.normal(size=(300, 9)) + offsets * rng.normal(size=9)


@pytest.mark.parametrize("seed", range(6))
def test_groups_are_ordered_from_front_to_rear_whatever_the_seed(seed: int) -> None:
    found = sensor_groups(warming(offsets=3.0), settings=FuzzyClusterSettings(seed=seed))
    assert found.memberships.argmax(axis=0).tolist() == [0] * 3 + [1] * 3 + [2] * 3
    assert (np.diff(found.places) > 0).all()


def test_positions_turn_the_order_and_a_shuffle_of_channels_does_not() -> None:
    measured = warming()
    forward = sensor_groups(measured)
    backward = sensor_groups(measured, positions=-np.arange(9.0))
    np.testing.assert_allclose(backward.weights, forward.weights[::-1], atol=1e-9)
    mixed = np.random.default_rng(5).permutation(9)
    shuffled = sensor_groups(measured[:, mixed], positions=mixed.astype(float))
    np.testing.assert_allclose(shuffled.weights, forward.weights[:, mixed], atol=1e-6)


def test_group_temperatures_are_the_cluster_centres_in_time() -> None:
    measured = warming()
    centred = (measured - measured.mean(axis=0)).T
    centres = fuzzy_c_means(centred, 3).centres
    found = sensor_groups(measured).temperatures(measured)
    found -= found.mean(axis=0)
    order = np.argsort(-np.ptp(centres, axis=1))  # the front warms most
    np.testing.assert_allclose(found.T, centres[order], atol=1e-5)


def test_lost_sensors_have_no_weight_and_the_rest_is_renormalised() -> None:
    measured, lost = warming(), np.arange(9) == 1
    whole = sensor_groups(measured)
    measured[:, 1] = np.nan
    anew, less = sensor_groups(measured, lost=lost), whole.without(lost)
    for groups in (anew, less):
        assert (groups.weights[:, 1] == 0).all() and (groups.memberships[:, 1] == 0).all()
        np.testing.assert_allclose(groups.weights.sum(axis=1), 1)
        assert np.isfinite(groups.temperatures(np.where(lost, 999.0, 20.0))).all()
        np.testing.assert_allclose(groups.temperatures(np.where(lost, 999.0, 20.0)), 20.0)
    # a missing sample is a sensor that is lost for one sample
    np.testing.assert_allclose(whole.temperatures(measured), less.temperatures(warming()))


def test_sensors_that_cannot_be_grouped_are_refused() -> None:
    measured = warming()
    with pytest.raises(ValueError, match="2 of 9 sensors are left for 3 groups"):
        sensor_groups(measured, lost=np.arange(9) > 1)
    with pytest.raises(ValueError, match="lost of type int64"):
        sensor_groups(measured, lost=np.arange(9))
    with pytest.raises(ValueError, match="no sensor left"):
        sensor_groups(measured).without(np.ones(9, bool))
    measured[:, 4] = np.nan
    with pytest.raises(ValueError, match="0 of 300 times have all 9 sensors"):
        sensor_groups(measured)
    with pytest.raises(ValueError, match="positions must be one finite number for each of 9"):
        sensor_groups(warming(), positions=[1.0, 2.0])
