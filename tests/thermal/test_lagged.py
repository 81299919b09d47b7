"""Lags and rates against their differential equation, their step, and the future."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.thermal.lagged import lag, lagged_features, rate

RNG = np.random.default_rng(0)
TIME = np.cumsum(RNG.uniform(20, 120, 80))
VALUES = np.cumsum(RNG.normal(size=(80, 3)), axis=0)


def test_a_lag_solves_its_differential_equation_at_uneven_samples() -> None:
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


def test_samples_between_change_no_lag() -> None:
    """Exact for straight steps: half steps give the same, and so does a record cut finer."""
    fine = np.sort(np.concatenate([TIME, (TIME[1:] + TIME[:-1]) / 2]))
    between = np.stack([np.interp(fine, TIME, c) for c in VALUES.T], axis=-1)
    np.testing.assert_allclose(lag(fine, between, 40.0)[::2], lag(TIME, VALUES, 40.0), atol=1e-11)


def test_a_very_long_constant_keeps_its_digits() -> None:
    found = lag([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 1e12)
    np.testing.assert_allclose(found, [0.0, 0.5e-12, 2e-12], rtol=1e-3)


def test_the_future_changes_nothing() -> None:
    some = {"lags_s": (60.0, 900.0), "rates_s": (200.0,)}
    speed = RNG.uniform(0, 800, 80)
    whole = lagged_features(TIME, VALUES, ambient=VALUES[:, 0], speed_rad_s=speed, **some)
    other, faster = VALUES.copy(), speed.copy()
    other[50:] += 100.0
    faster[50:] += 300.0
    changed = lagged_features(TIME, other, ambient=other[:, 0], speed_rad_s=faster, **some)
    assert np.array_equal(changed.values[:50], whole.values[:50])
    assert (changed.values[50] != whole.values[50]).all()
    cut = lagged_features(
        TIME[:50], VALUES[:50], ambient=VALUES[:50, 0], speed_rad_s=speed[:50], **some
    )
    assert np.array_equal(cut.values, whole.values[:50])


def test_columns_are_named_and_in_their_place() -> None:
    found = lagged_features(
        TIME, VALUES[:, :1], lags_s=(60.0,), rates_s=(200.0,), ambient=VALUES[:, 1],
        speed_rad_s=np.full(80, 30.0),
    )  # fmt: skip
    assert found.names == (
        "T1", "ambient", "speed", "speed^2", "T1 lag 60 s", "ambient lag 60 s", "speed^2 lag 60 s",
        "T1 rate 200 s",
    )  # fmt: skip
    column = dict(zip(found.names, found.values.T, strict=True))
    assert (column["speed^2"] == 900.0).all() and (column["ambient"] == VALUES[:, 1]).all()
    np.testing.assert_array_equal(column["T1 rate 200 s"], rate(TIME, VALUES[:, 0], 200.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"temperatures": [[20.0], [np.nan]]}, r"temperatures\[1, 0\] = nan at 60 s must"),
        ({"ambient": [np.inf, 1.0]}, r"ambient\[0\] = inf at 0 s"),
        ({"time_s": [0.0, 0.0]}, r"time_s\[1\] = 0\.0 s must be finite and later"),
        ({"lags_s": (0.0,)}, r"lag of 0\.0 s must be finite and positive"),
        ({"rates_s": (-1.0,)}, r"rate of -1\.0 s"),
        ({"speed_rad_s": [1.0]}, r"speed_rad_s of shape \(1,\) must have a row for each of 2"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(change: dict, words: str) -> None:
    given = {"time_s": [0.0, 60.0], "temperatures": [[20.0], [21.0]]} | change
    with pytest.raises(ValueError, match=words):
        lagged_features(given.pop("time_s"), given.pop("temperatures"), **given)
