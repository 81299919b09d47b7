"""Stretches of constant speed and the curve through them."""

import numpy as np
import pytest

from pipeline.search.genetic import GeneticSettings
from pipeline.submodels.drive.feed_drive import (
    FrictionPoint,
    Segment,
    constant_speed_segments,
    curve_force,
    friction_points,
    genetic_curves,
    least_squares_curves,
)
from pipeline.submodels.drive.motion import Motion

PLUS = np.array([60.0, 30.0, np.log(0.004), 300.0])
MINUS = np.array([50.0, 20.0, np.log(0.006), 350.0])


def points(noise=0.0, slowest=2e-4):
    rng = np.random.default_rng(0)
    speeds = np.geomspace(slowest, 0.4, 16)
    return [
        FrictionPoint(velocity=sign * v, force=sign * float(f) + noise * rng.standard_normal(),
                      half_width=1.0, seconds=1.0)
        for sign, values in ((1, PLUS), (-1, MINUS))
        for v, f in zip(speeds, curve_force(speeds, values), strict=True)
    ]  # fmt: skip


def plateau(speeds, seconds=2.0, noise=2.0, keep=0.9, period=0.01, seed=0):
    """Motion of constant speeds with ramps between, force 100 N and noise that hangs together."""
    rng = np.random.default_rng(seed)
    held = [np.full(int(seconds / period), v) for v in speeds]
    ramps = [np.linspace(a, b, 20) for a, b in zip(speeds, [*speeds[1:], 0.0], strict=True)]
    velocity = np.concatenate([part for pair in zip(held, ramps, strict=True) for part in pair])
    force = 100 + np.zeros(len(velocity))
    shock = 0.0
    for n in range(len(force)):
        shock = keep * shock + noise * (1 - keep**2) ** 0.5 * rng.standard_normal()
        force[n] += shock
    acceleration = np.gradient(velocity, period)
    return Motion(
        recording="a", period=period, bandwidth=None, time=period * np.arange(len(velocity)),
        position=np.cumsum(velocity) * period, velocity=velocity, acceleration=acceleration,
        force=force, load=None, instruments=(velocity, acceleration),
        known=np.ones(len(velocity), bool), moving=np.abs(velocity) > 1e-6,
    )  # fmt: skip


def test_each_constant_speed_is_one_segment():
    speeds = [0.01, 0.05, -0.02]
    found = constant_speed_segments([plateau(speeds)], 0.5)
    assert [one.velocity for one in found] == pytest.approx(speeds, rel=1e-3)
    assert [one.seconds for one in found] == pytest.approx([2.0] * 3, abs=0.05)
    assert constant_speed_segments([plateau(speeds)], 3.0) == []


def test_the_error_of_a_mean_knows_that_samples_hang_together():
    misses, said = [], []
    for seed in range(200):
        (one,) = constant_speed_segments([plateau([0.05], seconds=4.0, seed=seed)], 0.5)
        misses.append(one.force - 100)
        said.append(one.error)
    # (1 + 0.9) / (1 - 0.9) = 19 samples count as one; the estimate of that is itself rough
    assert np.median(said) == pytest.approx(np.std(misses), rel=0.25)
    assert np.std(misses) > 3 * 2.0 / np.sqrt(400)  # which independent samples would have


def test_points_join_repeated_speeds_and_their_scatter_counts():
    strokes = [Segment(recording="a", velocity=0.1 * (1 + 1e-3 * k), force=50.0 + k, error=0.01,
                       seconds=1.0) for k in range(3)]  # fmt: skip
    other = Segment(recording="a", velocity=0.2, force=60.0, error=0.5, seconds=1.0)
    joined, alone = friction_points([*strokes, other])
    assert (joined.force, joined.seconds) == (pytest.approx(51.0), 3.0)
    # standard error 1/sqrt(3) of three strokes, Student's t of two degrees of freedom 4.30
    assert joined.half_width == pytest.approx(4.303 / np.sqrt(3), rel=1e-3)
    assert alone.half_width == pytest.approx(1.96 * 0.5)


def test_exact_points_give_their_curves_back():
    found = least_squares_curves(points())
    assert found.values[0] == pytest.approx(PLUS, rel=1e-4)
    assert found.values[1] == pytest.approx(MINUS, rel=1e-4)
    assert found.error < 1e-4


def test_the_genetic_algorithm_searches_the_same_objective():
    data = points(noise=1.0)
    settings = GeneticSettings(population=60, generations=300, seed=1)
    best, blind = least_squares_curves(data), genetic_curves(data, settings)
    assert best.error <= blind.error < 1.3 * best.error
    assert (
        best.evaluations < blind.evaluations == 2 * (60 + 299 * 59)
    )  # the elite is not asked anew


def test_a_direction_without_points_stays_open():
    found = least_squares_curves([one for one in points() if one.velocity > 0])
    assert np.isfinite(found.values[0]).all() and np.isnan(found.values[1]).all()
