"""Levels of a spindle's power, and the no-load power and specific force that they recover."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.submodels.cutting.regression import regression
from pipeline.submodels.cutting.spindle_load.identify import power_parameters
from pipeline.submodels.cutting.spindle_load.levels import (
    LoadLog,
    LoadScale,
    levels,
    load_levels,
    no_load,
    resolution,
    runs,
    settled,
    specific_force,
)

RATED_W = 15e3
BASE = 3000 / 60  # rev/s
NO_LOAD = (120.0, 4.0, 0.03)  # W, W s, W s^2: 1128 W at 8400 rpm
K_TC, K_TE = 800e6, 20e3
D, FLUTES = 12e-3, 3


DRIVE = SpindleDrive(rated_power_kW=RATED_W / 1e3, base_speed_rpm=BASE * 60, top_speed_rpm=12e3)
SCALE = LoadScale(drive=DRIVE)


def free_power(n: np.ndarray) -> np.ndarray:
    return NO_LOAD[0] + NO_LOAD[1] * n + NO_LOAD[2] * n**2


def shown(power: np.ndarray, n: np.ndarray, step: float, noise: float, random) -> np.ndarray:
    """Percent of the power available, noisy over a second, in steps of the display."""
    full = RATED_W * np.minimum(1.0, n / BASE)
    wander = random.standard_normal(len(n) + 20)
    wander = np.convolve(wander, np.ones(5) / np.sqrt(5), mode="same")[10:-10]
    percent = 100 * power / np.maximum(full, 1.0) + noise * wander
    return np.round(percent / step) * step if step else percent


def no_load_log(random, speeds_rpm: list[float], *, step: float, noise: float) -> LoadLog:
    """Steps of speed, 15 s each, with ramps of 2 s between them that take power."""
    pieces, power = [], []
    last = 0.0
    for rpm in speeds_rpm:
        n = rpm / 60
        ramp = np.linspace(last, n, 20)
        pieces += [ramp, np.full(150, n)]
        power += [free_power(ramp) + 4e3, np.full(150, free_power(np.array(n)))]
        last = n
    n, P = np.concatenate(pieces), np.concatenate(power)
    times, none = np.arange(len(n)) / 10, np.zeros(len(n))
    return LoadLog(times=times, speed=n, load=shown(P, n, step, noise, random),
                   cut=runs(settled(times, n)), removal=none, edge=none)  # fmt: skip


def cut_log(
    random, cuts: list[tuple[float, float, float]], *, step: float, noise: float, spread: float
) -> LoadLog:
    """Slots of (rpm, feed for each tooth in mm, depth in mm), 6 s each, no two quite alike."""
    n = np.repeat([rpm / 60 for rpm, _, _ in cuts], 60)
    label = np.repeat(np.arange(len(cuts)), 60)
    f_z, a_p = (np.repeat([c[i] * 1e-3 for c in cuts], 60) for i in (1, 2))
    removal, edge = cut_rates(
        flutes=FLUTES, diameter=D, n=n, f_z=f_z, a_p=a_p, phi_st=0.0, phi_ex=np.pi
    )
    factor = np.exp(spread * random.standard_normal(len(cuts)))[label]
    P = free_power(n) + factor * (K_TC * removal + K_TE * edge)
    return LoadLog(
        times=np.arange(len(n)) / 10, speed=n, load=shown(P, n, step, noise, random),
        cut=label, removal=removal, edge=edge,
    )  # fmt: skip


def cut_rates(
    *, flutes: ArrayLike, diameter: ArrayLike, n: ArrayLike, f_z: ArrayLike, a_p: ArrayLike,
    phi_st: ArrayLike, phi_ex: ArrayLike,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Removal rate [m^3/s] and edge rate [m^2/s] of a cut with constant engagement; in SI."""
    teeth, D, speed = (np.asarray(v, dtype=np.float64) for v in (flutes, diameter, n))
    entry, leave = np.asarray(phi_st), np.asarray(phi_ex)
    removal = teeth * speed * np.asarray(f_z) * a_p * D / 2 * (np.cos(entry) - np.cos(leave))
    edge = teeth * speed * np.asarray(a_p) * D / 2 * (leave - entry)
    return removal, edge


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
    load = METER.power([50.0, 50.0, 50.0], [25.0, 50.0, 100.0])
    np.testing.assert_allclose(load, [2250.0, 4500.0, 4500.0])
    np.testing.assert_allclose(replace(METER, of="rated").power(50.0, [25.0, 100.0]), 4500.0)


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


METER = LoadScale(
    drive=SpindleDrive(
        rated_power_kW=10.0, base_speed_rpm=3000.0, top_speed_rpm=8000.0, efficiency=0.9
    )
)


def log(**changes: object) -> LoadLog:
    times = np.arange(0, 12, 0.5)
    values = {
        "times": times, "speed": np.full(24, 50.0), "load": np.where(times < 6, 20.0, 40.0),
        "cut": np.where(times < 6, 0, 1), "removal": np.where(times < 6, 1e-6, 2e-6),
        "edge": np.zeros(24), **changes,
    }  # fmt: skip
    return LoadLog(**values)  # type: ignore[arg-type]


def test_rows_just_after_a_cut_began_do_not_count() -> None:
    """Their load is still on its way: 90 % of 2 kW and 4 kW come out without it."""
    late = np.where(np.arange(24) == 12, 25.0, log().load)
    found = load_levels(log(load=late), METER, settle_s=1.0)
    np.testing.assert_allclose(found.power, [1800.0, 3600.0])
    np.testing.assert_allclose(found.removal, [1e-6, 2e-6])
    assert found.samples.tolist() == [10, 10]  # of 12, two are within the first second
    np.testing.assert_allclose(found.deviation, 0.9 * 10e3 * 0.01 / np.sqrt(12))  # whole percents


def test_loads_not_known_do_not_count() -> None:
    holes = np.where(np.arange(24) % 2, np.nan, 20.0)
    assert load_levels(log(load=holes), METER).samples.tolist() == [5, 5]
    assert len(load_levels(log(speed=np.zeros(24)), METER)) == 0


def test_the_scale_is_said_in_words() -> None:
    assert METER.words == (
        "load is a percentage of the power available at its speed; 10 kW from 3000 rev/min, "
        "efficiency 0.9"
    )


SPEEDS = [600.0, 1500.0, 3000.0, 4500.0, 6000.0, 7200.0, 8400.0]
CUTS = [
    (3000.0, 0.04, 6.0), (3000.0, 0.08, 6.0), (3000.0, 0.15, 6.0),
    (6000.0, 0.03, 4.0), (6000.0, 0.06, 6.0), (6000.0, 0.10, 8.0),
    (8400.0, 0.05, 4.0), (8400.0, 0.08, 6.0),
]  # fmt: skip
SEEDS = 100
STEPS = [(0.0, 0.3), (0.1, 0.1), (1.0, 0.05), (1.0, 0.4)]
"""Step of the display and noise, in percent: fine and coarse, one that rounding dominates."""


def found(seed: int, step: float, noise: float, spread: float = 0.02):
    random = np.random.default_rng(seed)
    free = load_levels(no_load_log(random, SPEEDS, step=step, noise=noise), SCALE)
    cuts = load_levels(cut_log(random, CUTS, step=step, noise=noise, spread=spread), SCALE)
    idle = no_load(free)
    return idle, specific_force(cuts, idle)


def work_over_volume() -> float:
    """Of the slots of ``CUTS`` that all last as long, from the law at their mean thickness."""
    power = [rpm * f_z * a_p * (K_TC + K_TE * np.pi / 2 / (f_z * 1e-3)) for rpm, f_z, a_p in CUTS]
    return sum(power) / sum(rpm * f_z * a_p for rpm, f_z, a_p in CUTS)


def test_exact_powers_give_the_truth() -> None:
    idle, force = found(0, step=0.0, noise=0.0, spread=0.0)
    assert idle.fit.values == pytest.approx(NO_LOAD, rel=1e-6)
    assert force.fit.values == pytest.approx((K_TC, K_TE), rel=1e-6)
    assert (idle.lowest * 60, idle.highest * 60) == pytest.approx((600, 8400))


def test_all_of_it_scales_with_the_power_that_is_taken_for_known() -> None:
    """Twice the rated power, half the efficiency: the same; twice alone: twice of everything."""

    def values(**changes: float) -> np.ndarray:
        scale = replace(SCALE, drive=replace(DRIVE, **changes))
        random = np.random.default_rng(2)
        idle = no_load(load_levels(no_load_log(random, SPEEDS, step=1.0, noise=0.3), scale))
        log = cut_log(random, CUTS, step=1.0, noise=0.3, spread=0.02)
        force = specific_force(load_levels(log, scale), idle)
        return np.concatenate([idle.fit.half_width, force.fit.values, force.fit.half_width])

    twice = 2 * DRIVE.rated_power_kW
    np.testing.assert_allclose(values(rated_power_kW=twice), 2 * values(), rtol=1e-4)  # tau's 1e-6
    np.testing.assert_allclose(values(rated_power_kW=twice, efficiency=0.5), values(), rtol=1e-9)


@pytest.mark.parametrize(
    ("step", "noise"),
    [*(pytest.param(*one, marks=pytest.mark.proof) for one in STEPS[:3]), STEPS[3]],
)
def test_the_truth_is_within_the_intervals(step: float, noise: float) -> None:
    """Each 95 % interval holds it in 90 of 100 seeds at least."""
    n = np.array([900.0, 3000.0, 5000.0, 8000.0]) / 60
    hits = np.zeros(3 + len(n) + 2 + 1)
    work = work_over_volume()
    for seed in range(SEEDS):
        idle, force = found(seed, step, noise)
        hits += np.concatenate(
            [
                np.abs(idle.fit.values - NO_LOAD) <= idle.fit.half_width,
                np.abs(idle.power(n) - free_power(n)) <= idle.half_width(n),
                np.abs(force.fit.values - (K_TC, K_TE)) <= force.fit.half_width,
                [abs(force.value - work) <= force.half_width],
            ]
        )
    assert hits.min() >= 90, hits


def test_cuts_beyond_the_speeds_of_the_no_load_record_do_not_count() -> None:
    random = np.random.default_rng(4)
    free = load_levels(no_load_log(random, SPEEDS[:4], step=0.1, noise=0.1), SCALE)
    log = cut_log(random, CUTS, step=0.1, noise=0.1, spread=0.0)
    idle = no_load(free)
    assert specific_force(load_levels(log, SCALE), idle).cuts == 3
    fast = cut_log(random, CUTS[3:], step=0.1, noise=0.1, spread=0.0)
    with pytest.raises(ValueError, match="record cuts between 600 and 4500 rev/min"):
        specific_force(load_levels(fast, SCALE), idle)


def test_what_few_levels_do_not_tell_is_not_determined() -> None:
    random = np.random.default_rng(5)
    one = load_levels(no_load_log(random, [3000.0], step=1.0, noise=0.3), SCALE)
    with pytest.raises(ValueError, match=r"turns free at 1 settled speed\(s\): record it at 4"):
        no_load(one)
    three = load_levels(no_load_log(random, SPEEDS[2:5], step=0.1, noise=0.1), SCALE)
    idle = no_load(three)
    assert len(idle.fit.values) == 2 and idle.fit.freedom == 1
    same = cut_log(random, [CUTS[0]] * 6, step=1.0, noise=0.3, spread=0.02)
    force = specific_force(load_levels(same, SCALE), idle)
    assert force.cuts == 1  # six of the same are one: their rounding is the same
    document = power_parameters(idle, force, 0.5)
    assert document["K_tc"].determined is False and document["K_tc"].value is None
    assert "too few levels" in document["K_tc"].method


def test_one_thickness_of_chip_does_not_tell_edge_from_cutting() -> None:
    """Depth alone is changed: Q and w stay in proportion; the energy of both is still told."""
    random = np.random.default_rng(6)
    free = load_levels(no_load_log(random, SPEEDS, step=0.1, noise=0.1), SCALE)
    cuts = [(6000.0, 0.06, a_p) for a_p in (2.0, 4.0, 6.0, 8.0)]
    log = cut_log(random, cuts, step=0.1, noise=0.1, spread=0.01)
    force = specific_force(load_levels(log, SCALE), no_load(free))
    document = power_parameters(None, force, 0.5)
    assert document["K_tc"].determined is False and document["K_te"].determined is False
    low, high = document["specific_force"].interval_95
    mean = K_TC / 1e6 + K_TE / 1e3 * np.pi / 2 / 0.06  # of a slot: mean thickness 2 f_z / pi
    assert low <= mean <= high


def test_parameters_have_an_interval_or_the_reason_why_not() -> None:
    idle, force = found(7, step=1.0, noise=0.4)
    rows = power_parameters(idle, force, 0.5)
    assert set(rows) == {"p0", "p1", "p2", "specific_force", "K_tc", "K_te"}
    for one in rows.values():
        assert (one.value is None) == (one.interval_95 is None) == (not one.determined)
        assert one.method
    assert rows["specific_force"].unit == "N/mm^2"
    assert rows["K_tc"].interval_95 is not None
    low, high = rows["K_tc"].interval_95
    assert low <= K_TC / 1e6 <= high
