"""No-load power and specific force from spindle loads: a known truth comes back, honestly."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.mean_force import mean_torque
from pipeline.identification.cutting.spindle_power import cut_rates, specific_force
from pipeline.identification.cutting.spindle_power_document import spindle_document
from pipeline.identification.cutting.spindle_power_levels import levels
from pipeline.identification.cutting.spindle_power_log import load_levels
from pipeline.identification.cutting.spindle_power_no_load import no_load
from tests.identification.cutting.spindle_loads import (
    FLUTES,
    K_TC,
    K_TE,
    NO_LOAD,
    SCALE,
    D,
    cut_log,
    free_power,
    no_load_log,
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


def test_power_of_a_cut_is_that_of_its_mean_torque() -> None:
    """Q and w against the closed form of the mean torque: 2 pi n M = K_tc Q + K_te w."""
    law = ForceLaw(K_tc=K_TC, K_rc=0.0, K_te=K_TE)
    for arc in ((0.0, np.pi), (0.0, 0.9), (2.0, np.pi)):
        cut = {"flutes": FLUTES, "f_z": 0.08e-3, "a_p": 3e-3, "phi_st": arc[0], "phi_ex": arc[1]}
        torque = mean_torque(law, radius=D / 2, **cut)
        Q, w = cut_rates(diameter=D, n=50.0, **cut)
        assert K_TC * Q + K_TE * w == pytest.approx(2 * np.pi * 50.0 * torque, rel=1e-12)
    v_f = FLUTES * 50.0 * 0.08e-3
    slot = cut_rates(diameter=D, n=50.0, **{**cut, "phi_st": 0.0})[0]
    assert slot == pytest.approx(D * 3e-3 * v_f, rel=1e-12)  # a_e a_p v_f


def test_exact_powers_give_the_truth() -> None:
    idle, force = found(0, step=0.0, noise=0.0, spread=0.0)
    assert idle.coefficients == pytest.approx(NO_LOAD, rel=1e-6)
    assert force.fit.values == pytest.approx((K_TC, K_TE), rel=1e-6)
    assert (idle.lowest * 60, idle.highest * 60) == pytest.approx((600, 8400))


def test_all_of_it_scales_with_the_power_that_is_taken_for_known() -> None:
    """Twice the rated power, half the efficiency: the same; twice alone: twice of everything."""

    def values(**changes: float) -> np.ndarray:
        scale, random = replace(SCALE, **changes), np.random.default_rng(2)
        idle = no_load(load_levels(no_load_log(random, SPEEDS, step=1.0, noise=0.3), scale))
        log = cut_log(random, CUTS, step=1.0, noise=0.3, spread=0.02)
        force = specific_force(load_levels(log, scale), idle)
        return np.concatenate([idle.fit.half_width, force.fit.values, force.fit.half_width])

    twice = 2 * SCALE.rated_power_kW
    np.testing.assert_allclose(values(rated_power_kW=twice), 2 * values(), rtol=1e-4)  # tau's 1e-6
    np.testing.assert_allclose(values(rated_power_kW=twice, efficiency=0.5), values(), rtol=1e-9)


@pytest.mark.parametrize(("step", "noise"), STEPS)
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


def test_a_coarser_display_makes_wider_intervals() -> None:
    """The same spindle with little noise, shown in tenths and in whole percents."""
    width = {
        step: np.median(
            [
                np.concatenate([idle.fit.half_width, force.fit.half_width])
                for idle, force in (found(seed, step, 0.05, 0.0) for seed in range(20))
            ],
            axis=0,
        )
        for step in (0.1, 1.0)
    }
    assert (width[1.0] > 2.5 * width[0.1]).all()


def test_more_samples_of_one_level_do_not_make_rounding_smaller() -> None:
    """A load that stands still between two whole percents is as unsure after an hour."""
    for many in (20, 20000):
        found = levels(np.zeros(many, dtype=int), 50.0, np.full(many, 600.0), 150.0)
        assert float(found.deviation[0]) == pytest.approx(150.0 / np.sqrt(12), rel=1e-9)


def test_a_known_edge_force_takes_its_uncertainty_along() -> None:
    random = np.random.default_rng(3)
    free = load_levels(no_load_log(random, SPEEDS, step=0.1, noise=0.1), SCALE)
    cuts = load_levels(cut_log(random, CUTS, step=0.1, noise=0.1, spread=0.01), SCALE)
    idle = no_load(free)
    sure, loose, sought = (
        specific_force(cuts, idle, edge=(K_TE, 0.0)).fit,
        specific_force(cuts, idle, edge=(K_TE, 0.3 * K_TE)).fit,
        specific_force(cuts, idle).fit,
    )
    assert sure.half_width[0] < loose.half_width[0]
    assert sure.half_width[0] < sought.half_width[0]
    for fit in (sure, loose, sought):
        assert abs(fit.values[0] - K_TC) <= fit.half_width[0]


def test_cuts_beyond_the_speeds_of_the_no_load_record_do_not_count() -> None:
    random = np.random.default_rng(4)
    free = load_levels(no_load_log(random, SPEEDS[:4], step=0.1, noise=0.1), SCALE)
    log = cut_log(random, CUTS, step=0.1, noise=0.1, spread=0.0)
    idle = no_load(free)
    assert specific_force(load_levels(log, SCALE), idle).cuts == 3
    fast = cut_log(random, CUTS[3:], step=0.1, noise=0.1, spread=0.0)
    with pytest.raises(ValueError, match="record cuts between 600 and 4500 rpm"):
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
    document = spindle_document(idle, force, recordings=["a.txt"], widest=0.5)
    assert document["K_tc"]["determined"] is False and document["K_tc"]["value"] is None
    assert "too few levels" in document["K_tc"]["reason"]


def test_one_thickness_of_chip_does_not_tell_edge_from_cutting() -> None:
    """Depth alone is changed: Q and w stay in proportion; the energy of both is still told."""
    random = np.random.default_rng(6)
    free = load_levels(no_load_log(random, SPEEDS, step=0.1, noise=0.1), SCALE)
    cuts = [(6000.0, 0.06, a_p) for a_p in (2.0, 4.0, 6.0, 8.0)]
    log = cut_log(random, cuts, step=0.1, noise=0.1, spread=0.01)
    force = specific_force(load_levels(log, SCALE), no_load(free))
    document = spindle_document(None, force, recordings=[], widest=0.5)
    assert document["K_tc"]["determined"] is False and document["K_te"]["determined"] is False
    low, high = document["specific_force"]["interval_95"]
    mean = K_TC / 1e6 + K_TE / 1e3 * np.pi / 2 / 0.06  # of a slot: mean thickness 2 f_z / pi
    assert low <= mean <= high


def test_the_document_is_plain_json_in_the_form_of_parameters() -> None:
    idle, force = found(7, step=1.0, noise=0.4)
    document = spindle_document(idle, force, recordings=["a.txt"], widest=0.5, assumed="power")
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again["no_load"]["range_rpm"] == [600.0, 8400.0]
    entries = [*again["no_load"]["coefficients"].values(), again["specific_force"], again["K_tc"]]
    for entry in entries:
        assert set(entry) == {"value", "unit", "interval_95", "determined", "reason", "how"}
        assert (entry["value"] is None) == (not entry["determined"]) == bool(entry["reason"])
    assert again["specific_force"]["unit"] == "N/mm^2"
    low, high = again["K_tc"]["interval_95"]
    assert low <= K_TC / 1e6 <= high
    at = {point["speed_rpm"]: point for point in again["no_load"]["curve"]}
    assert sorted(at) == SPEEDS
