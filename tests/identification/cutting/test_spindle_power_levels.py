"""Settled samples, levels, and what the load of a display is worth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.identification.cutting.spindle_power_levels import (
    levels,
    resolution,
    runs,
    settled,
    shown_power,
)
from pipeline.identification.cutting.spindle_power_regression import regression


def test_samples_count_once_the_speed_was_kept_and_not_before_it_changes() -> None:
    times = np.arange(0, 20, 0.5)
    speed = np.where(times < 5, 0.0, np.where(times < 12, 50.0, 80.0))
    found = times[settled(times, speed, settle_s=2.0)]
    # from 2 s after it was reached until more than 1 s before it changes
    assert found.tolist() == [*np.arange(7.0, 11.0, 0.5), *np.arange(14.0, 20.0, 0.5)]


def test_a_slow_ramp_is_no_level() -> None:
    times = np.arange(0, 60, 0.1)
    assert not settled(times, 20 + 0.5 * times, settle_s=2.0).any()  # 2 % and more in 2 s
    assert settled(times, np.full(600, -20.0), settle_s=2.0).sum() == 580  # either sense turns


def test_speeds_not_known_and_short_records_are_not_settled() -> None:
    times = np.arange(0, 10, 0.1)
    speed = np.full(100, 50.0)
    speed[40] = np.nan
    found = settled(times, speed, settle_s=1.0)
    assert not found[35:51].any() and found[20:35].all() and found[51:].all()
    assert settled([], []).shape == (0,)
    assert not settled([0.0], [50.0]).any()


@given(
    st.lists(st.sampled_from([0.0, 30.0, 30.2, 50.0]), min_size=1, max_size=40),
    st.floats(0.1, 3.0),
)
def test_settled_is_what_its_definition_says(speeds: list[float], settle_s: float) -> None:
    times, n = np.arange(len(speeds)) * 0.5, np.array(speeds)
    found = settled(times, n, settle_s=settle_s)
    for i, t in enumerate(times):
        ahead = (times <= t + settle_s / 2) | (np.arange(len(n)) <= i + 1)
        window = n[(times >= t - settle_s) & ahead]
        kept = window.min() > 0 and window.max() - window.min() <= 0.01 * window.max()
        assert found[i] == (kept and t - settle_s >= times[0])


def test_load_is_power_of_what_the_motor_has_at_that_speed() -> None:
    load = shown_power([50.0, 50.0, 50.0], [25.0, 50.0, 100.0], rated_W=10e3, base_speed=50.0)
    np.testing.assert_allclose(load, [2500.0, 5000.0, 5000.0])
    rated = shown_power(50.0, [25.0, 100.0], rated_W=10e3, base_speed=50.0, of="rated")
    np.testing.assert_allclose(rated, 5000.0)


def test_runs_and_steps() -> None:
    np.testing.assert_array_equal(runs([False, True, True, False, True]), [-1, 0, 0, -1, 1])
    assert resolution([3.0, 9.0, 9.0]) == 1.0  # two readings do not make a display of sixes
    assert resolution(np.arange(0.0, 100.0, 5.0)) == 5.0
    assert resolution([12.3, 15.0]) == 0.1
    assert resolution([3.0]) == 1.0
    assert resolution(np.random.default_rng(0).normal(size=500)) < 1e-3


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3, 0.6])
def test_the_deviation_of_a_mean_is_what_rounding_and_noise_leave(noise: float) -> None:
    """Over levels anywhere between two steps, errors are no larger than said.

    400 levels tell their RMS to 4 %.  Rounding alone is exact; noise of a third of a step averages
    more out than readings on two steps can prove, so that the deviation is five times too careful.
    """
    random = np.random.default_rng(8)
    ratio = []
    for _ in range(400):
        true = random.uniform(3, 7)
        reading = np.round(true + noise * random.standard_normal(200))
        found = levels(np.zeros(200, dtype=int), 50.0, reading, 1.0)
        ratio.append((found.power[0] - true) / found.deviation[0])
    assert 0.15 < np.sqrt(np.mean(np.square(ratio))) < 1.1


def test_levels_alike_are_one_and_what_does_not_count_is_left_out() -> None:
    label = np.repeat([0, 1, 2, -1], 10)
    speed = np.repeat([50.0, 50.2, 80.0, 99.0], 10)
    power = np.repeat([600.0, 620.0, 900.0, np.nan], 10)
    found = levels(label, speed, power, 1.0)
    assert len(found) == 2
    np.testing.assert_allclose(found.speed, [50.1, 80.0])
    np.testing.assert_allclose(found.power, [610.0, 900.0])
    assert found.samples.tolist() == [20, 10]
    assert found.deviation[0] > 9.0  # what two runs of the same level differ by is not noise
    assert len(levels(np.full(3, -1), 1.0, 1.0, 1.0)) == 0


def test_regression_is_ordinary_least_squares_when_all_readings_are_as_good() -> None:
    random = np.random.default_rng(9)
    design = np.stack([np.ones(9), np.linspace(0, 5, 9)], axis=1)
    readings = design @ [2.0, -0.7] + 0.3 * random.standard_normal(9)
    found = regression(design, readings, 1e-12 * np.eye(9), np.ones(9))
    values, squares, *_ = np.linalg.lstsq(design, readings)
    covariance = np.linalg.inv(design.T @ design) * squares[0] / 7
    np.testing.assert_allclose(found.values, values, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-3)  # tau to 1e-6
    np.testing.assert_allclose(
        found.half_width, 2.3646 * np.sqrt(np.diag(covariance)), rtol=1e-3
    )  # Student's t of 7


def test_columns_that_cannot_be_told_apart_are_not_determined() -> None:
    column = np.array([1.0, 2.0, 3.0, 4.0])
    found = regression(np.stack([column, 2 * column], axis=1), column, np.eye(4), column)
    assert np.isinf(found.half_width).all() and np.isnan(found.values).all()
    few = regression(column[:1, None], column[:1], np.eye(1), column[:1])
    assert np.isinf(few.half_width).all() and few.freedom == 0
