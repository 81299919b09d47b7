"""Derivatives, filters and the choice of their bandwidth against closed forms."""

import numpy as np
import pytest

from pipeline.submodels.drive.motion import (
    NOISE,
    PRESLIDING,
    SURVIVES,
    _bandwidth,
    _surviving,
    first_difference,
    gaussian,
    motion,
    parallel_bandwidth,
    reach,
    second_difference,
    white_noise,
)
from pipeline.submodels.drive.records import AxisConstants, AxisRecord, Recording

T = 1e-3
TIME = T * np.arange(8000)


def recording(position, command=None, **options):
    axis = AxisRecord(
        command=np.sin(TIME) if command is None else command, position=position,
        constants=AxisConstants(force_constant=2.0), **options,
    )  # fmt: skip
    return Recording(name="a", trained=True, period=T, air=np.ones(len(TIME), bool),
                     axes={"X": axis})  # fmt: skip


@pytest.mark.parametrize(("derivative", "order"), [(first_difference, 1), (second_difference, 2)])
def test_differences_are_of_fourth_order(derivative, order):
    errors = []
    for period in (0.02, 0.01):
        t = period * np.arange(int(2 / period))
        exact = np.cos(5 * t) * 5 if order == 1 else -25 * np.sin(5 * t)
        errors.append(np.abs(derivative(np.sin(5 * t), period) - exact)[3:-3].max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.1)


def test_the_gaussian_halves_power_at_its_bandwidth_and_keeps_what_is_slow():
    places = np.array([4000])
    for frequency, gain in ((0.0, 1.0), (10.0, 2**-0.5), (30.0, 2**-4.5)):
        wave = np.cos(2 * np.pi * frequency * (TIME - TIME[4000]))
        found = (gaussian(places, len(TIME), T, 10.0) @ wave)[0]
        # its tails are cut at 3 standard deviations, a weight of 0.3 %
        assert found == pytest.approx(gain, abs=5e-3), frequency


def test_the_gaussians_memory_ends():
    places, bump = np.array([4000]), np.zeros(len(TIME))
    bump[4000 + reach(T, 10.0) + 1 :] = 1e6
    assert (gaussian(places, len(TIME), T, 10.0) @ bump)[0] == 0


def test_motion_of_a_sine_and_its_force():
    wave = 0.05 * np.sin(2 * np.pi * TIME)
    found = motion(recording(wave), "X", 12.0)
    inner = found.known
    omega = 2 * np.pi
    speed = 0.05 * omega * np.cos(omega * found.time)
    assert found.velocity[inner] == pytest.approx(speed[inner], abs=1e-5 * 0.05 * omega)
    pull = -(omega**2) * 0.05 * np.sin(omega * found.time)
    assert found.acceleration[inner] == pytest.approx(pull[inner], abs=1e-4 * 0.05 * omega**2)
    assert found.force[inner] == pytest.approx(2 * np.sin(found.time)[inner], abs=1e-5)


def test_a_motion_behind_its_command_is_brought_together():
    wave = 0.05 * np.sin(2 * np.pi * TIME)
    early = np.sin(2 * np.pi * (TIME + 4e-3))
    found = motion(recording(wave, early), "X", 12.0, delay=4e-3)
    inner = found.known
    expected = 2 * np.sin(2 * np.pi * found.time)
    assert found.force[inner] == pytest.approx(expected[inner], abs=1e-4)


def test_after_a_reversal_friction_is_not_judged_before_presliding_is_over():
    found = motion(recording(1e-3 * np.abs(TIME - 4.0)), "X", 50.0)
    gone = 1e-3 * np.abs(found.time - 4.0)
    assert not found.moving[(found.time > 4.0) & (gone < 0.8 * PRESLIDING)].any()
    assert found.moving[(found.time > 4.1) & found.known].all()


@pytest.mark.parametrize("noise", [1e-7, 1e-6])
def test_noise_of_a_position_is_seen_under_its_motion(noise):
    rng = np.random.default_rng(0)
    smooth = 0.05 * np.sin(2 * np.pi * TIME)
    assert white_noise(smooth + noise * rng.standard_normal(len(TIME))) == pytest.approx(
        noise**2, rel=0.1  # 8000 samples, of which differences leave a third independent
    )  # fmt: skip
    assert white_noise(np.round(smooth / 1e-6) * 1e-6) == pytest.approx(1e-12 / 12, rel=0.1)


def test_the_bandwidth_falls_with_noise_and_keeps_its_bias_below_the_limit():
    rng = np.random.default_rng(1)
    # a triangle of speed: its acceleration has a wide spectrum
    speed = 0.2 * np.abs((2 * TIME) % 2 - 1)
    smooth = np.cumsum(speed) * T
    chosen = []
    for noise in (1e-8, 3e-6, 3e-5):
        bandwidth = parallel_bandwidth(
            [recording(smooth + noise * rng.standard_normal(len(TIME)))], "X", 1.0
        )
        chosen.append(bandwidth)
        density = 2 * T * noise**2 * (2 * np.pi) ** 4 * bandwidth**5 / 5
        assert density < 2 * NOISE * 0.4**2  # the acceleration is 0.4 m/s^2
    assert chosen[0] >= chosen[1] > 1.2 * chosen[2]


def test_records_with_all_derivatives_in_a_full_band_are_taken_as_they_are():
    rng = np.random.default_rng(2)
    jumps = rng.standard_normal(len(TIME))
    one = recording(None, velocity=np.cumsum(jumps) * T, acceleration=jumps)
    assert parallel_bandwidth([one], "X", 0.2) is None
    found = motion(one, "X", None)
    assert np.array_equal(found.acceleration, jumps)
    assert found.known.all()


def strokes(period: float, ramp: float = 0.1, held: float = 0.6, rest: float = 0.5):
    """Velocity [m/s] of sixteen strokes from stop to stop, ramped by half a cosine."""
    rng, parts = np.random.default_rng(0), [np.zeros(round(1.0 / period))]
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(round(ramp / period)) * period / ramp)
    for k in range(16):
        speed = float(rng.uniform(0.01, 0.05)) * (1 if k % 2 else -1)
        parts += [speed * rise, np.full(round(held / period), speed), speed * rise[::-1],
                  np.zeros(round(rest / period))]  # fmt: skip
    return np.concatenate(parts)


@pytest.mark.parametrize(("period", "step", "wider"), [(2e-3, 1e-6, False), (1e-2, 1e-4, True)])
def test_the_acceleration_survives_the_cut_around_stops(period, step, wider):
    """A coarse position asks for a narrow filter, whose memory cuts all ramps away."""
    velocity = strokes(period)
    place = np.round(np.cumsum(velocity) * period / step) * step
    axis = AxisRecord(command=velocity, position=place, constants=AxisConstants())
    one = Recording(name="a", trained=True, period=period, air=np.ones(len(place), bool),
                    axes={"X": axis})  # fmt: skip
    power, narrow, _ = _bandwidth(one, "X", 8.0)
    assert narrow is not None
    true = float(np.sqrt(np.mean(np.gradient(velocity, period) ** 2)))
    assert np.sqrt(power) == pytest.approx(true, rel=0.15)  # noise is no acceleration
    assert (_surviving(one, "X", narrow) < SURVIVES * true) == wider
    found = parallel_bandwidth([one], "X", 0.2)
    assert found is not None and (found > narrow) == wider
    assert _surviving(one, "X", found) > SURVIVES * true
