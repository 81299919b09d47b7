"""The mean revolution: speed and wander from the record itself, harmonics as they were put in."""

import numpy as np
import pytest

from pipeline.identification.cutting.revolution import mean_revolution, wave

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
