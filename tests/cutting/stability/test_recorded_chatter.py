"""Chatter in recordings: simulated cuts inside and beyond the limit, lines that are no chatter."""

import sys
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest

from pipeline.cutting.stability.recorded_chatter import recorded_chatter, stable_speeds
from pipeline.cutting.stability.semi_discretisation import RegenerativeCut
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.schema.arrays import Floats
from tests.cutting.chatter import depth_limits
from tests.cutting.milling_in_time import Simulated, recording

RATE, N_S, TEETH = 10240.0, 100.0, 3
AXES: tuple[Literal["x", "y"], ...] = ("x", "y")
NOISES = (0.03, 0.1, 0.3)
"""Standard deviation of the recorder's noise over that of the signal [1]."""


def cut_of(seed: int) -> tuple[list[Mode], RegenerativeCut, float]:
    """A drawn tool and cut, at 2 to 8 waves of chatter between two teeth."""
    draw = np.random.default_rng(seed)
    teeth, width = int(draw.integers(2, 6)), draw.uniform(0.3, 1.0)
    arc, up = np.arccos(1 - 2 * width), draw.random() < 0.5
    specific, stiffness = draw.uniform(6e8, 1.2e9), draw.uniform(5e6, 2e7)
    cut = RegenerativeCut(
        K_tc=specific, K_rc=specific * draw.uniform(0.2, 0.4), flutes=teeth,
        entry=0.0 if up else np.pi - arc, exit=arc if up else np.pi,
    )  # fmt: skip
    middle = draw.uniform(500, 1500)
    modes = [
        Mode(direction=axis, natural_frequency_Hz=f, damping=draw.uniform(0.02, 0.05),
             mass_kg=stiffness / (2 * np.pi * f) ** 2)
        for axis, f in zip(AXES, (middle, middle * draw.uniform(0.85, 1.15)), strict=True)
    ]  # fmt: skip
    return modes, cut, middle / (draw.uniform(2.0, 8.0) * teeth)


def simulated(seed: int, over: float) -> tuple[Simulated, RegenerativeCut, float]:
    """Recording at ``over`` times the depth limit, its cut, its speed [1/s]."""
    modes, cut, n = cut_of(seed)
    limit = float(depth_limits(modes, cut, [n], highest=0.1).depth_limit[0])
    made = recording(
        modes, cut, n, over * limit, seconds=400 / n, random=np.random.default_rng(seed),
        runout=2e-6, feed=1e-4, roughness=0.02,
    )  # fmt: skip
    return made, cut, n


def noisy(signal: Floats, noise: float, seed: int) -> Floats:
    random = np.random.default_rng(seed)
    return signal + noise * signal.std() * random.standard_normal(len(signal))


def synthetic(seconds: float = 4.0, n: float = N_S, teeth: int = TEETH) -> tuple[Floats, Floats]:
    """Time and a stable cut: tooth passing, runout, noise."""
    t = np.arange(int(seconds * RATE)) / RATE
    y = sum(np.cos(2 * np.pi * k * teeth * n * t + k) / k for k in range(1, 8))
    y = y + 0.3 * np.cos(2 * np.pi * n * t) + 0.1 * np.cos(2 * np.pi * 2 * n * t)
    return t, y + 0.1 * np.random.default_rng(1).standard_normal(len(t))


def test_a_hopf_line_is_found_with_its_begin_though_the_speed_is_off_by_a_percent() -> None:
    t, y = synthetic()
    y = y + np.where(t > 1.5, 0.8 * np.cos(2 * np.pi * 757.3 * t), 0.0)
    found = recorded_chatter(y, RATE, 1.01 * N_S, TEETH)
    assert (found.verdict, found.kind) == ("chatter", "quasi-periodic")
    assert found.frequency_Hz == pytest.approx(757.3, abs=1.0)  # a third of a bin
    assert found.begins_s == pytest.approx(1.5, abs=0.05)
    assert found.seconds_in_cut == pytest.approx(4.0, abs=0.1)
    assert found.speed_rpm == pytest.approx(6000.0, rel=3e-4)


def test_period_doubling_of_an_odd_number_of_teeth_is_named() -> None:
    t, y = synthetic()
    y = y + sum(np.cos(2 * np.pi * (k + 0.5) * TEETH * N_S * t) for k in range(3))
    found = recorded_chatter(y, RATE, N_S, TEETH)
    assert (found.verdict, found.kind) == ("chatter", "period doubling")


def test_period_doubling_of_two_teeth_is_not_told_from_runout() -> None:
    t, y = synthetic(teeth=2)
    y = y + sum(2 * np.cos(2 * np.pi * (k + 0.5) * 2 * N_S * t) for k in range(3))
    found = recorded_chatter(y, RATE, N_S, 2)
    assert found.verdict == "not decided" and "runout" in found.why


@pytest.mark.parametrize("wander", [0.0, 2e-4, 1e-3])
@pytest.mark.parametrize("seconds", [3.0, 8.0, 20.0])
def test_the_flank_of_a_tooth_passing_line_is_no_chatter(wander: float, seconds: float) -> None:
    t = np.arange(int(seconds * RATE)) / RATE
    turned = 2 * np.pi * np.cumsum(N_S * (1 + wander * np.sin(2 * np.pi * 0.7 * t))) / RATE
    y = sum(np.cos(k * TEETH * turned + k) / k for k in range(1, 6))
    y = y + 0.05 * np.random.default_rng(1).standard_normal(len(t))
    found = recorded_chatter(y, RATE, 1.005 * N_S, TEETH)
    assert (found.verdict, found.frequency_Hz) == ("stable", None)


def test_a_cut_that_begins_late_has_its_time_within_half_a_segment() -> None:
    t, y = synthetic(9.0)
    rest = 0.1 * np.random.default_rng(3).standard_normal(len(t))
    found = recorded_chatter(np.where((t > 2.0) & (t < 7.0), y, rest), RATE, N_S, TEETH)
    assert found.seconds_in_cut == pytest.approx(5.0, abs=0.64)


def test_runout_mains_and_a_shaken_structure_are_no_chatter() -> None:
    t, y = synthetic()
    assert recorded_chatter(y, RATE, N_S, TEETH).verdict == "stable"
    hum = sum(0.5 * np.cos(2 * np.pi * 50 * k * t) for k in (1, 3, 5))
    assert recorded_chatter(y + hum, RATE, N_S, TEETH).verdict == "stable"
    spectrum = np.fft.rfft(np.random.default_rng(2).standard_normal(len(t)))
    f = np.fft.rfftfreq(len(t), 1 / RATE)
    shaken = np.fft.irfft(spectrum / (750**2 - f**2 + 2j * 0.003 * 750 * f), len(t))
    found = recorded_chatter(y + 0.5 * shaken / shaken.std(), RATE, N_S, TEETH)
    assert found.verdict == "stable" and "random" in found.why


def test_a_line_that_sounds_before_the_cut_is_another_machine() -> None:
    t, y = synthetic(6.0)
    rest = 0.1 * np.random.default_rng(3).standard_normal(len(t))
    y = np.where(t > 2.0, y, rest) + 0.5 * np.cos(2 * np.pi * 757.3 * t)
    assert recorded_chatter(y, RATE, N_S, TEETH).verdict == "stable"


@pytest.mark.parametrize("begin", [0.0, 1.2, 4.0])
def test_chatter_that_starts_and_stops_is_found_with_its_begin(begin: float) -> None:
    t, y = synthetic(8.0)
    y = y + np.where((t > begin) & (t < begin + 2.8), 0.8 * np.cos(2 * np.pi * 757.3 * t), 0.0)
    found = recorded_chatter(y, RATE, N_S, TEETH)
    assert found.verdict == "chatter"
    assert found.envelope == pytest.approx(1.0, abs=0.1)
    assert found.begins_s == pytest.approx(begin, abs=0.05)


def test_chatter_that_comes_and_goes_is_never_stable() -> None:
    t, y = synthetic(16.0)
    for on, off in ((1.6, 3.2), (2.5, 2.5), (2.0, 6.0), (3.2, 1.5)):  # 1.28 s is a segment
        y_on = y + np.where(t % (on + off) < on, 0.8 * np.cos(2 * np.pi * 757.3 * t), 0.0)
        assert recorded_chatter(y_on, RATE, N_S, TEETH).verdict != "stable", (on, off)


def test_chatter_through_a_change_of_speed_is_not_another_machine() -> None:
    t = np.arange(int(8 * RATE)) / RATE
    n = np.interp(t, [2.5, 5.5], [N_S, 1.15 * N_S])
    turned = 2 * np.pi * np.cumsum(n) / RATE
    y = sum(np.cos(k * TEETH * turned + k) / k for k in range(1, 8)) + 0.3 * np.cos(turned)
    y = y + 0.8 * np.cos(2 * np.pi * 757.3 * t)
    y = y + 0.1 * np.random.default_rng(1).standard_normal(len(t))
    found = recorded_chatter(y, RATE, n, TEETH)
    assert found.verdict == "chatter"
    assert found.frequency_Hz == pytest.approx(757.3, abs=1.0)


def test_a_line_that_sounds_in_a_pause_of_the_cut_is_another_machine() -> None:
    t, y = synthetic(9.0)
    rest = 0.1 * np.random.default_rng(3).standard_normal(len(t))
    y = np.where((t > 3.0) & (t < 6.0), rest, y) + 0.5 * np.cos(2 * np.pi * 757.3 * t)
    assert recorded_chatter(y, RATE, N_S, TEETH).verdict == "stable"


def test_chatter_at_orders_of_the_rotation_has_no_envelope_of_another_line() -> None:
    t, y = synthetic(teeth=4)
    y = y + sum(3 * np.cos(2 * np.pi * (k + 0.5) * 4 * N_S * t) for k in range(3))
    spectrum = np.fft.rfft(np.random.default_rng(2).standard_normal(len(t)))
    f = np.fft.rfftfreq(len(t), 1 / RATE)
    shaken = np.fft.irfft(spectrum / (750**2 - f**2 + 2j * 0.003 * 750 * f), len(t))
    found = recorded_chatter(y + 0.3 * shaken / shaken.std(), RATE, N_S, 4)
    assert (found.verdict, found.kind) == ("chatter", "period doubling")
    assert (found.envelope, found.false_alarm, found.begins_s) == (None, None, None)


@pytest.mark.parametrize(
    ("seconds", "rate", "n", "why"),
    [(0.5, RATE, N_S, "too short"), (4.0, 1000.0, N_S, "band"), (4.0, RATE, 137.0, "no cut")],
)
def test_what_cannot_be_decided_has_its_reason(
    seconds: float, rate: float, n: float, why: str
) -> None:
    _, y = synthetic(seconds)
    found = recorded_chatter(y, rate, n, TEETH)
    assert found.verdict == "not decided" and why in found.why


def test_speeds_lie_in_the_range_of_the_machine() -> None:
    speeds = stable_speeds(800.0, 4, 5000.0, (3000.0, 12000.0))
    assert speeds == (12000.0, 6000.0, 4000.0, 3000.0)
    assert all(a > b for a, b in pairwise(speeds))


def test_simulated_cuts_on_both_sides_of_the_limit() -> None:
    for over, verdict in ((0.9, "stable"), (1.1, "chatter")):
        made, cut, n = simulated(0, over)
        found = recorded_chatter(noisy(made.acceleration, 0.1, 1), made.rate, 1.005 * n, cut.flutes)
        assert found.verdict == verdict


@pytest.mark.proof
@pytest.mark.parametrize("noise", NOISES)
def test_verdicts_are_right_in_95_of_100_and_frequencies_within_a_percent(
    noise: float, capsys: pytest.CaptureFixture[str]
) -> None:
    right, wrong, off = 0, [], []
    for seed in range(50):
        for over, verdict in ((0.9, "stable"), (1.1, "chatter")):
            made, cut, n = simulated(seed, over)
            nominal = n * np.random.default_rng(seed).uniform(0.99, 1.01)
            heard = np.stack(
                [noisy(made.acceleration, noise, seed), noisy(made.force, noise, seed)]
            )
            found = recorded_chatter(heard, made.rate, nominal, cut.flutes, derivatives=(2, 0))
            right += found.verdict == verdict
            if found.verdict != verdict:
                wrong.append((seed, over, cut.flutes, found.verdict, found.why))
            elif found.frequency_Hz and verdict == "chatter":
                off.append(abs(found.frequency_Hz / loudest_line(made, n, cut.flutes) - 1))
    capsys.readouterr()
    with capsys.disabled():
        spread = np.quantile(off, [0.5, 0.9, 0.95, 1.0]).round(5).tolist()
        sys.stdout.write(f"\nnoise {noise}: {right} of 100, frequency off by {spread}\n")
        sys.stdout.writelines(f"{one}\n" for one in wrong)
    assert right >= 95
    assert np.quantile(off, 0.95) < 0.01


def loudest_line(made: Simulated, n: float, teeth: int) -> float:
    """Strongest line of the displacement between those of the teeth, without noise [Hz]."""
    late = made.displacement[len(made.displacement) // 3 :]
    size = 8 * len(late)
    power = np.abs(np.fft.rfft((late - late.mean()) * np.hanning(len(late)), size))
    f = np.fft.rfftfreq(size, 1 / made.rate)
    between = np.abs(f / n - np.rint(f / n / teeth) * teeth) > 0.1
    return float(f[np.argmax(np.where(between, power, 0.0))])


def test_a_speed_that_changes_more_than_twofold_is_not_judged() -> None:
    t, y = synthetic()
    found = recorded_chatter(y, RATE, np.where(t < 1.0, 0.01, N_S), TEETH)
    assert found.verdict == "not decided" and "more than twofold" in found.why
    assert "unknown" in recorded_chatter(y, RATE, np.where(t < 1.0, np.nan, N_S), TEETH).why
