"""Steady part of a recording and its mean revolution: speed and harmonics as put in."""

import numpy as np
import pytest

from pipeline.submodels.cutting.revolution import mean_revolution, steady_part, wave

RATE, SPEED = 1e4, 66.7


def record(angle, lines, noise=0.0, seed=0):
    random = np.random.default_rng(seed)
    return wave(lines, angle) + random.normal(0, noise, (len(angle), lines.shape[1]))


def some_lines(harmonics=20):
    random = np.random.default_rng(3)
    size = 100.0 / (1 + np.arange(harmonics + 1)[:, None])
    lines = size * (random.normal(size=(harmonics + 1, 3, 2)) @ [1, 1j])
    lines[0] = lines[0].real
    return lines


def test_harmonics_and_speed_come_back():
    true, put_in = 1.004 * SPEED, some_lines()
    angle = 0.7 + 2 * np.pi * true / RATE * np.arange(9000)
    found = mean_revolution(record(angle, put_in, 2.0), RATE, SPEED, 3, 24)
    # the phase of 60 revolutions is known to a few mrad, over which the speed is a slope
    assert found.speed == pytest.approx(true, rel=1e-5)
    turned = np.exp(-1j * 0.7 * np.arange(21))[:, None]
    error = np.abs(found.lines[:21] * turned - put_in)
    # a phase of some mrad turns harmonic h by h times as much
    assert (error < 4 * 2.0 * np.sqrt(2 / 9000) + 0.02 * np.abs(put_in)).all()
    assert np.abs(found.lines[21:]).max() < 6 * 2.0 * np.sqrt(2 / 9000)


def test_a_spindle_that_wanders_is_followed():
    """0.3 % to and fro would smear harmonic 20 by a radian and more."""
    time = np.arange(12000) / RATE
    wander = 0.003 * 2 * np.pi * SPEED / (2 * np.pi * 1.5) * np.sin(2 * np.pi * 1.5 * time)
    put_in = some_lines()
    found = mean_revolution(record(2 * np.pi * SPEED * time + wander, put_in), RATE, SPEED, 3, 24)
    assert np.abs(found.lines[15:21]) == pytest.approx(np.abs(put_in[15:]), rel=0.05)
    assert found.coherent.min() > 0.995


def test_scatter_is_that_of_the_noise():
    put_in = some_lines()
    angle = 2 * np.pi * SPEED / RATE * np.arange(20000)
    found = mean_revolution(record(angle, put_in, 5.0), RATE, SPEED, 3, 24)
    expected = 5.0**2 * 2 / 20000  # of real and imaginary part of a mean harmonic
    # 44 blocks of revolutions, three channels, eight harmonics: the mean is within 10 %
    assert found.scatter[5:13].mean() == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [(700, RATE, "revolutions, 6 are the least"), (9000, 400.0, "record faster")],
)
def test_too_little_is_said(samples, rate, message):
    angle = 2 * np.pi * SPEED / rate * np.arange(samples)
    with pytest.raises(ValueError, match=message):
        mean_revolution(record(angle, some_lines()), rate, SPEED, 3, 24)


def test_what_does_not_repeat_is_no_cut():
    noise = np.random.default_rng(0).normal(size=(9000, 3))
    with pytest.raises(ValueError, match="of its forces repeat with a spindle near 4002 rev/min"):
        mean_revolution(noise, RATE, SPEED, 3, 24)


def test_a_wrong_speed_is_refused():
    angle = 2 * np.pi * 1.37 * SPEED / RATE * np.arange(9000)
    with pytest.raises(ValueError, match="correct its speed"):
        mean_revolution(record(angle, some_lines()), RATE, SPEED, 3, 24)


TURN = 150.0


def entering_and_leaving(air=3000, ramp=4500, full=9000, zero=0.0):
    """Force that grows over the way in and ends at once, samples 150 a revolution."""
    size = np.concatenate([np.zeros(air), np.linspace(0, 1, ramp), np.ones(full)])
    angle = 2 * np.pi * np.arange(len(size)) / TURN
    shape = np.stack([100 + 80 * np.sin(3 * angle), 60 * np.cos(3 * angle), 20 + 0 * angle], 1)
    noise = np.random.default_rng(0).normal(0, 0.5, shape.shape)
    return size[:, None] * shape + noise + zero


def test_the_way_in_is_left_out():
    steady = steady_part(entering_and_leaving(), TURN, 4500.0)
    assert steady.first >= 3000 + 4500 - 2 * TURN  # contact shows within two revolutions
    assert steady.first <= 3000 + 4500 + 5 * TURN
    assert steady.last == 16500


def test_the_zero_is_that_of_the_air():
    steady = steady_part(entering_and_leaving(zero=np.array([7.0, -3.0, 2.0])), TURN, 4500.0)
    assert steady.zero_measured
    # 20 revolutions of noise of 0.5 N: 0.01 N
    assert steady.zero[steady.first] == pytest.approx([7.0, -3.0, 2.0], abs=0.05)


def test_a_zero_that_drifts_is_a_line_between_air_and_air():
    force = np.concatenate([entering_and_leaving(ramp=0), entering_and_leaving(full=0, ramp=0)])
    drift = np.linspace(0, 12, len(force))[:, None]
    steady = steady_part(force + drift, TURN, 0.0)
    assert np.abs(steady.zero - drift).max() < 0.1


def test_without_air_the_zero_is_not_known():
    steady = steady_part(entering_and_leaving(air=0, ramp=0), TURN, 4500.0)
    assert not steady.zero_measured
    assert (steady.first, steady.last) == (0, 9000)


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (np.zeros((9000, 3)), "there is no cut"),
        (np.zeros((100, 3)), "shorter than one revolution"),
        (entering_and_leaving(full=100), "nowhere fully in the material"),
    ],
)
def test_no_steady_part_is_said(force, message):
    with pytest.raises(ValueError, match=message):
        steady_part(force, TURN, 4500.0)
