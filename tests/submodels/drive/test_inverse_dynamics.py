"""The table of regressors and what is searched on it, against direct evaluation."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.search.genetic import GeneticSettings
from pipeline.submodels.drive.feed_drive import genetic_dynamics
from pipeline.submodels.drive.identifiability import (
    PositionDisturbance,
    dynamics_uncertainty,
    instrumental,
    is_better,
    position_disturbance,
    scores_covariance,
)
from pipeline.submodels.drive.inverse_dynamics import (
    all_observable,
    jacobian,
    least_squares_dynamics,
    modelled_force,
    regressors,
)
from pipeline.submodels.drive.motion import Motion
from pipeline.submodels.statistics import block_numbers, correlation_rows

TRUE = {"mass": 120.0, "viscous_positive": 300.0, "viscous_negative": 250.0,
        "coulomb_level_positive": 60.0, "coulomb_level_negative": 45.0,
        "stribeck_amplitude_positive": 30.0, "stribeck_amplitude_negative": 25.0,
        "log_velocity_positive": np.log(0.004), "log_velocity_negative": np.log(0.007)}  # fmt: skip
PERIOD = 0.01


def moved(noise=0.0, noisy_acceleration=0.0, seed=0, samples=6000):
    """Unfiltered motion through all speeds, force by the formula."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(samples)
    way = np.sign(np.sin(2 * np.pi * t / 7.3))
    v = way * np.exp(np.interp(np.sin(2 * np.pi * t / 41.0), [-1, 1], np.log([2e-4, 0.4])))
    a = np.where(np.abs(v) > 0.02, 2 * np.sin(2 * np.pi * t / 0.83), 0.0)
    force = TRUE["mass"] * a
    for sign, name in ((1, "positive"), (-1, "negative")):
        there = v * sign > 0
        velocity = np.exp(TRUE[f"log_velocity_{name}"])
        dip = TRUE[f"stribeck_amplitude_{name}"] * np.exp(-((v / velocity) ** 2))
        rubbing = TRUE[f"coulomb_level_{name}"] + dip + TRUE[f"viscous_{name}"] * np.abs(v)
        force = force + there * sign * rubbing
    force = force + noise * rng.standard_normal(samples)
    measured = a + noisy_acceleration * rng.standard_normal(samples)
    return Motion(
        recording="a", period=PERIOD, bandwidth=None, time=t, position=np.cumsum(v) * PERIOD,
        velocity=v, acceleration=measured, force=force, load=None, instruments=(v, a),
        known=np.ones(samples, bool), moving=np.ones(samples, bool),
    )  # fmt: skip


def found_on(motion):
    rows = regressors([motion])
    return rows, least_squares_dynamics(rows, all_observable(rows))


def test_exact_rows_give_their_parameters_back():
    _, found = found_on(moved())
    for name, value in TRUE.items():
        # straight lines in the table of v_s: 0.2 % of the dip
        assert found.value(name) == pytest.approx(value, rel=5e-3), name
    assert np.abs(found.residuals).max() < 2e-3 * 30


def test_the_jacobian_is_that_of_the_model():
    rows, found = found_on(moved(noise=1.0))
    slopes = jacobian(rows, found.values)
    for k, value in enumerate(found.values):
        step = np.zeros(len(found.values))
        step[k] = 1e-6 * max(abs(value), 1.0)
        ends = [modelled_force(rows, found.values + s * step) for s in (1, -1)]
        change = (ends[0] - ends[1]) / (2 * step[k])
        assert slopes[:, k] == pytest.approx(change, abs=1e-5 * np.abs(change).max())


def test_a_tenth_of_wild_rows_changes_little():
    clean = moved(noise=1.0)
    rng = np.random.default_rng(3)
    wild = clean.force + 200 * (rng.random(len(clean.force)) < 0.1)
    rows, found = found_on(Motion(**{**clean.__dict__, "force": wild}))
    assert found.value("mass") == pytest.approx(TRUE["mass"], rel=0.01)
    # one-sided: 0.1 of the rows pull each level up by Huber's bound, two standard deviations
    level = TRUE["coulomb_level_positive"]
    assert found.value("coulomb_level_positive") == pytest.approx(level, abs=1.0)
    plain = np.linalg.lstsq(rows.linear, rows.force, rcond=None)[0]
    assert abs(plain[3] - TRUE["coulomb_level_positive"]) > 10


def test_the_genetic_algorithm_sees_the_same_sum_of_squares():
    rows, found = found_on(moved(noise=1.0, samples=2000))
    settings = GeneticSettings(population=40, generations=30, seed=0)
    blind = genetic_dynamics(rows, found, settings)
    direct = found.weights @ (rows.force - modelled_force(rows, blind.values)) ** 2
    assert blind.cost == pytest.approx(direct, rel=1e-9)
    assert blind.cost >= found.cost * (1 - 1e-9)


def test_instruments_find_the_mass_that_noise_hides():
    rows, found = found_on(moved(noise=1.0, noisy_acceleration=1.0))
    uncertainty = dynamics_uncertainty(rows, found)
    assert found.value("mass") < 0.8 * TRUE["mass"]  # errors in variables
    better = instrumental(rows, found)
    assert better is not None and is_better(better, found, uncertainty.half_width, 0.5)
    at = found.names.index("mass")
    assert better.half_width[at] < 0.1 * TRUE["mass"]
    # Huber's weights, of residuals that hold the same noise, leave a part of the bias
    assert better.values[at] == pytest.approx(TRUE["mass"], rel=0.05)


def test_instruments_are_not_taken_where_nothing_is_gained():
    rows, found = found_on(moved(noise=1.0))
    better = instrumental(rows, found)
    assert better is not None
    assert not is_better(better, found, dynamics_uncertainty(rows, found).half_width, 0.5)


@pytest.mark.parametrize("keep", [0.0, 0.8, 0.95])
def test_blocks_are_as_long_as_residuals_hang_together(keep):
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(20_000)
    for n in range(1, len(noise)):
        noise[n] += keep * noise[n - 1]
    together = (1 + keep) / (1 - keep)
    stretch = np.zeros(len(noise), np.int64)
    # autocorrelation below 5 % is cut off, a tenth of it for a slow decay
    assert correlation_rows(noise, stretch) == pytest.approx(together, rel=0.15)
    blocks = block_numbers(noise, stretch, 9)
    assert np.bincount(blocks).max() <= np.ceil(max(9 * together, 1))


def test_pushes_by_the_place_are_told_from_noise_in_time():
    motion = moved(samples=12_000)
    cogs = 5.0 * np.sin(2 * np.pi * motion.position / 0.02)
    rows, found = found_on(Motion(**{**motion.__dict__, "force": motion.force + cogs}))
    seen = position_disturbance(rows, found.residuals, TRUE["mass"])
    assert seen is not None
    assert seen.variance == pytest.approx(12.5, rel=0.5)  # 5^2 / 2, of strokes through few cogs
    assert 0.001 < seen.length < 0.01  # a quarter of a cog is 5 mm
    rng = np.random.default_rng(0)
    assert position_disturbance(rows, rng.standard_normal(len(rows.force)), TRUE["mass"]) is None


def test_rows_of_one_place_share_one_push():
    rows, _ = found_on(moved(samples=1000))
    many = len(rows.force)
    here = replace(rows, position=np.zeros(many), velocity=np.full(many, 1e-12))
    slopes = np.ones((many, 1))
    disturbance = PositionDisturbance(variance=4.0, length=1e-3, strokes=9)
    covariance = scores_covariance(here, slopes, disturbance)
    assert covariance[0, 0] == pytest.approx(4.0 * many**2)
