"""Calibrated intervals: coverage of groups not seen, drift, causality, few groups."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.schema.store import read_json, write_json
from pipeline.submodels.conformal import (
    ALL_REGIMES,
    AdaptiveSettings,
    Band,
    Residuals,
    adaptive,
    bands,
    chosen_step,
    interval,
    splits,
)


def days(generator: np.random.Generator, count: int, *, between: float, samples: int = 200):
    """Residuals of groups with an offset of their own and noise of standard deviation 1."""
    error = between * generator.normal(size=(count, 1)) + generator.normal(size=(count, samples))
    return Residuals(
        error=error.ravel(),
        regime=np.full(error.size, ""),
        group=np.repeat([f"day {i}" for i in range(count)], samples),
        t=np.tile(np.arange(float(samples)), count),
    )


def inside(error, low, high) -> float:
    return float(np.mean((low <= error) & (error <= high)))


EXCHANGED = [(2.0, 4, 40), (0.0, 10, 1), (0.5, 30, 1)]
"""Spread between groups, groups and samples of each: every value of each, all pairs in a proof."""


@pytest.mark.parametrize(
    ("between", "count", "samples"),
    [
        *EXCHANGED,
        *(pytest.param(*one, marks=pytest.mark.proof)
          for one in product((0.0, 0.5, 2.0), (4, 10, 30), (1, 40)) if one not in EXCHANGED),
    ],
)  # fmt: skip
def test_exchangeable_groups_are_covered_and_no_wider_than_they_need(
    count: int, between: float, samples: int
) -> None:
    """90 % in the mean; from ten on hardly wider than if all were known.

    Four groups of one sample each hold what four of them can, K / (K + 1).  The allowance is what
    so many draws of ``count`` groups leave open, most where each group is one number in effect.
    """
    generator = np.random.default_rng(1)
    shares, widths = [], []
    for _ in range(60):
        new = days(generator, 30, between=between, samples=samples).error
        band = bands(days(generator, count, between=between, samples=samples))[""]
        shares.append(inside(new, -band.lower, band.upper))
        widths.append(band.upper / np.hypot(between, 1.0))
    expected = count / (count + 1) if count * samples < 9 else 0.9
    assert np.mean(shares) == pytest.approx(expected, abs=0.04 if count > 4 else 0.06)
    assert np.median(widths) < 1.645 * {4: 1.5, 10: 1.25, 30: 1.15}[count]


def few_groups(between: float) -> list[float]:
    """Share of a new group's samples in an interval from four others, 300 times.

    That interval is never wider than the greatest of the four groups' own 90 % quantiles.
    """
    generator = np.random.default_rng(2)
    shares = []
    for _ in range(300):
        found = days(generator, 5, between=between)
        new = found.group == "day 4"
        old = found.where(~new)
        band = bands(old)[""]
        own = [np.quantile(np.abs(old.error[old.group == f"day {k}"]), 0.9) for k in range(4)]
        assert band.upper <= 1.01 * max(own) and band.groups == 4
        shares.append(inside(found.error[new], -band.lower, band.upper))
    return shares


@pytest.mark.parametrize("between", [0.0, 0.5, 2.0])
def test_few_groups_hold_90_percent_of_a_new_one_in_the_mean_or_a_little_more(
    between: float,
) -> None:
    shares = few_groups(between)
    assert 0.88 - 2 * np.std(shares) / 300**0.5 <= np.mean(shares) <= 0.94


def test_few_groups_that_have_nothing_in_common_hold_all_but_the_share_of_the_next() -> None:
    """Each new group is in or out: four of five, K / (K + 1), less what the worst leaves out."""
    shares = few_groups(20.0)
    assert np.mean(shares) >= 0.8 - 3 * 0.4 / np.sqrt(300)


def test_the_half_width_of_a_regime_is_its_own() -> None:
    """Ten alike groups: rough hours get ten times the width of calm ones, not the worst of each."""
    generator = np.random.default_rng(5)
    found = days(generator, 10, between=0.0, samples=400)
    rough = np.tile(np.arange(400) < 20, 10)
    words = np.where(rough, "rough", "calm")
    mixed = Residuals(
        error=np.where(rough, 10, 1) * found.error, regime=words, group=found.group, t=found.t
    )
    band = bands(mixed)
    assert band["calm"].upper == pytest.approx(1.645, rel=0.1)
    assert band["rough"].upper == pytest.approx(16.45, rel=0.15)


def test_a_long_group_weighs_as_much_as_a_short_one() -> None:
    """Nine calm groups of one sample each, one rough group of a thousand."""
    error = np.concatenate([np.arange(1.0, 30.0), np.full(1000, 100.0)])
    group = np.concatenate([[f"{i}" for i in range(29)], np.full(1000, "long")])
    found = Residuals(error=error, regime=np.full(len(error), ""), group=group, t=0 * error)
    assert bands(found)[""].upper <= 29.0


def test_a_band_a_regime_and_that_over_all_for_what_was_hardly_seen() -> None:
    regime = np.array(["warming", "cooling"] * 10 + ["rare"])
    group = np.array([str(i // 2) for i in range(20)] + ["0"])
    error = np.array([2.0, -1.0] * 10 + [9.0])
    found = bands(Residuals(error=error, regime=regime, group=group, t=np.zeros(21)))
    assert set(found) == {ALL_REGIMES, "warming", "cooling"}
    assert found["warming"] == Band(lower=2.0, upper=2.0, n=10, groups=10)
    low, high = interval(np.zeros(3), np.array(["cooling", "warming", "never seen"]), found)
    np.testing.assert_allclose(high, [1.0, 2.0, found[ALL_REGIMES].upper])
    np.testing.assert_allclose(low, -high)


def test_without_a_residual_the_message_says_what_to_record() -> None:
    with pytest.raises(ValueError, match="two training groups at least, record another"):
        bands(Residuals.joined([]))


def test_each_group_is_predicted_by_a_model_that_did_not_see_it() -> None:
    names = [f"g{i}" for i in range(7)]

    def residuals_of(fitted: list[str], left: list[str]) -> Residuals:
        assert not set(fitted) & set(left) and sorted(fitted + left) == names
        error = np.full(len(left), float(len(fitted)))
        words = np.array(left)
        return Residuals(error=error, regime=np.full(len(left), ""), group=words, t=0 * error)

    found = Residuals.joined(residuals_of(fitted, left) for fitted, left in splits(names, 3))
    assert found.group.tolist() == names
    assert list(splits(["alone"], 3)) == []


def drifting(samples: int = 20_000):
    """Errors whose spread grows threefold, and the bands of what they were before."""
    generator = np.random.default_rng(3)
    spread = np.linspace(1.0, 3.0, samples)
    return np.arange(float(samples)), spread * generator.normal(size=samples), {
        ALL_REGIMES: Band(lower=1.645, upper=1.645, n=1000, groups=30)
    }  # fmt: skip


@pytest.mark.parametrize("delay", [0.0, 300.0])
def test_adaptive_holds_90_percent_under_drift_where_split_does_not(delay: float) -> None:
    t, error, band = drifting()
    regime, still = np.full(len(t), ""), np.zeros(len(t))
    assert inside(error, *interval(still, regime, band)) < 0.75
    chosen = AdaptiveSettings(step=0.02, delay_s=delay)
    # the factor ends within 3 of where it began, so the share is 0.9 within 3 / (step N)
    found = inside(error, *adaptive(t, error, still, regime, band, chosen))
    assert found == pytest.approx(0.9, abs=3 / (0.02 * len(t)) + delay / len(t))


def test_a_step_of_0_is_the_split_interval() -> None:
    t, error, band = drifting(500)
    regime, still = np.full(len(t), ""), np.zeros(len(t))
    found = adaptive(t, error, still, regime, band, AdaptiveSettings(step=0.0))
    np.testing.assert_array_equal(found, interval(still, regime, band))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 199), st.floats(0.0, 50.0))
def test_what_is_not_known_yet_changes_nothing(at: int, delay: float) -> None:
    generator = np.random.default_rng(4)
    t, error = np.arange(200.0), 3 * generator.normal(size=200)
    regime = np.where(np.arange(200) % 3 == 0, "a", "b")
    band = {ALL_REGIMES: Band(lower=1.0, upper=2.0, n=9, groups=9)}
    chosen = AdaptiveSettings(step=0.1, delay_s=delay)
    before = adaptive(t, error, np.zeros(200), regime, band, chosen)
    other = np.where(t >= at, 100.0, error)
    after = adaptive(t, other, np.zeros(200), regime, band, chosen)
    same = t < at + max(delay, 1.0)  # what is measured at a time is known one sample later at best
    np.testing.assert_array_equal(before[0][same], after[0][same])
    np.testing.assert_array_equal(before[1][same], after[1][same])
    later = t >= at + delay + 3
    if later.any():
        assert not np.array_equal(before[1][later], after[1][later])


def test_a_regime_follows_its_own_errors_only_and_nan_changes_nothing() -> None:
    t = np.arange(100.0)
    regime = np.where(t % 2 == 0, "rough", "calm")
    error = np.where(t % 2 == 0, 5.0, np.nan)
    band = {ALL_REGIMES: Band(lower=1.0, upper=1.0, n=9, groups=9)}
    _, high = adaptive(t, error, np.zeros(100), regime, band, AdaptiveSettings(step=0.1))
    assert (high[1::2] == 1.0).all()
    assert high[98] == pytest.approx(min(1 + 0.09 * 49, 5.0), abs=0.2)


def test_the_step_is_chosen_by_what_the_training_groups_show() -> None:
    t, error, band = drifting(4000)
    words = np.full(len(t), "")
    drift = Residuals(error=error, regime=words, group=words, t=t)
    assert chosen_step(drift, band, (0.0, 0.02), 0.0) == 0.02
    calm = Residuals(error=np.sin(t) * 1.9, regime=words, group=words, t=t)
    wide = {ALL_REGIMES: Band(lower=1.9, upper=1.9, n=1000, groups=30)}
    assert chosen_step(calm, wide, (0.0, 1.0), 0.0) == 0.0


def test_times_that_fall_are_refused() -> None:
    band = {ALL_REGIMES: Band(lower=1.0, upper=1.0, n=9, groups=9)}
    with pytest.raises(ValueError, match="falls to 1 s at sample 2"):
        adaptive(
            np.array([0.0, 2.0, 1.0]), np.zeros(3), np.zeros(3), np.full(3, ""), band,
            AdaptiveSettings(),
        )  # fmt: skip


def test_a_band_is_stored_and_read(tmp_path) -> None:
    stored = {"warming": Band(lower=1.0, upper=1.5, n=20, groups=4)}
    write_json(stored, tmp_path / "bands.json")
    assert read_json(tmp_path / "bands.json", dict[str, Band]) == stored
