"""Lags against their differential equation, their step, and the future."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.thermal.sensors import lag

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
)  # fmt: skip
def test_what_cannot_be_is_refused(change, words):
    given = {"time_s": [0.0, 60.0], "values": [[20.0], [21.0]], "constant_s": 60.0} | change
    with pytest.raises(ValueError, match=words):
        lag(**given)
