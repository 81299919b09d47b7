"""Identification of a cut recovers what an independent simulation was given."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.tool import Tool
from pipeline.search.genetic import GeneticSettings
from pipeline.submodels.cutting.coefficients import mean_regression, modes, parameters
from pipeline.submodels.cutting.identify import identify_cutting_force
from pipeline.submodels.cutting.recordings import cut_harmonics
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingSetup, Dynamometer
from tests.submodels.cutting import recorded
from tests.submodels.cutting.recorded import (
    SETTINGS,
    SLOT,
    SLOTS,
    Truth,
    identified,
    known_of,
    recordings,
)

ENDS = SLOTS[::2]
"""The least and the greatest feed, where three tell no more of the claim."""
ROUNDED = Truth(flutes=3, runout=0.005, growth=0.008)
UNLIKE = Truth(flutes=4, runout=0.0, worn=(1.0, 1.6, 1.2, 0.9))
MIXED = Truth(natural=(2100.0, 1700.0, 2700.0), worn=(1.1, 0.95, 0.95))
MIX = [
    (4000.0, 0.04, 2.0, 0.0, np.pi), (4000.0, 0.1, 2.0, 0.0, np.pi),
    (4800.0, 0.07, 3.0, np.pi / 2, np.pi), (4800.0, 0.12, 3.0, 0.0, np.pi / 2),
]  # fmt: skip
NAMES = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")


def determined_by(truth, tests, seed=0):
    found = identified(truth, tuple(tests), seed)
    return {one.name: one for one in rows_of(found)}, found


def rows_of(found):
    return parameters(
        found.fit, found.uncertainty, found.not_sharp, SETTINGS.widest, found.mean_force
    )


def true_values(truth):
    values = dict(zip(NAMES, (*truth.cutting, *truth.edge), strict=True))
    return values | {"runout": 1e3 * truth.runout}


@pytest.mark.parametrize(
    ("truth", "tests"), [(SLOT, SLOTS), pytest.param(MIXED, MIX, marks=pytest.mark.proof)]
)
def test_coefficients_runout_and_modes_come_back(truth, tests):
    rows, found = determined_by(truth, tests)
    for name, value in true_values(truth).items():
        assert rows[name].determined
        # noise of 1 % and zeros of 1 N leave 1 %, edges that are not sharp as much again
        assert rows[name].value == pytest.approx(value, rel=0.02), name
    natural = [rows[0].value for rows in modes(found.fit, found.uncertainty, 0.5).values()]
    assert natural == pytest.approx(truth.natural, rel=0.01)


def test_means_alone_give_the_coefficients_of_cuts_without_runout():
    truth = Truth(flutes=2, runout=0.0)
    cuts = [cut_harmonics(one, SETTINGS) for one in recordings(truth, SLOTS)]
    _, rows = mean_regression(cuts, SETTINGS.widest)
    for one, value in zip(rows, (*truth.cutting, *truth.edge), strict=True):
        assert abs(one.value - value) <= one.half_width, one.name


def test_one_feed_does_not_tell_cutting_from_edge_by_means():
    cuts = [cut_harmonics(one, SETTINGS) for one in recordings(SLOT, SLOTS[:1])]
    _, rows = mean_regression(cuts, SETTINGS.widest)
    assert not any(one.determined for one in rows)
    assert "record cuts of the same tool at three feeds" in rows[0].remedy


def test_one_feed_tells_them_by_its_waveform():
    rows, _ = determined_by(SLOT, SLOTS[1:2])
    for name in ("K_tc", "K_te"):
        assert abs(rows[name].value - true_values(SLOT)[name]) <= rows[name].half_width


@pytest.mark.parametrize(
    ("growth", "tests"),
    [(0.008, ENDS), *(pytest.param(g, SLOTS, marks=pytest.mark.proof) for g in (0.003, 0.008))],
)
def test_rounded_edges_are_not_taken_for_runout(growth, tests):
    rows, found = determined_by(replace(ROUNDED, growth=growth), tests)
    runout = rows["runout"]
    at_once = found.fit.problem.geometry(found.fit.x)
    assert runout.determined
    assert abs(runout.value - 5.0) <= min(runout.half_width, 0.5)
    # an edge whose force is there at once would need a tenth of that thickness more of it
    assert 1e6 * abs(complex(at_once.along, at_once.across)) > 5.0 + 100 * growth
    said = float(runout.remark.split(" um of chip")[0].split()[-1])
    assert said == pytest.approx(1e3 * growth, rel=0.1)


def test_a_runout_that_is_not_determined_has_a_bound_and_what_to_record():
    _, found = determined_by(ROUNDED, ENDS)
    runout = parameters(found.fit, found.uncertainty, found.not_sharp, 1e-4, found.mean_force)[6]
    assert not runout.determined and runout.parameter.value is None
    assert float(runout.reason.split("at most ")[1].split(" um")[0]) >= 1e3 * ROUNDED.runout
    assert "dial gauge" in runout.remedy


@pytest.mark.proof
def test_unlike_edges_are_not_a_small_runout_where_the_waveform_tells_them_badly(monkeypatch):
    """A force at turns that no term explains: radii alike and edges alike leave as much over."""

    def rippled(truth, test, phase):
        force = clean(truth, test, phase)
        turn = 2 * np.pi * 1.002 * test[0] / 60 * np.arange(len(force)) / recorded.RATE
        ripple = [np.sin(5 * turn + phase), np.cos(7 * turn), np.sin(2 * turn + 2 * phase)]
        return force + 10.0 * np.stack(ripple, axis=1)

    clean = recorded.clean
    monkeypatch.setattr(recorded, "clean", rippled)
    found = identify_cutting_force(recordings(UNLIKE, ENDS), known_of(UNLIKE), SETTINGS)
    runout = rows_of(found)[6]
    assert not runout.determined and runout.half_width > 2.0
    assert "edges of different teeth" in runout.reason
    assert "mm a tooth, at which a tooth that stands back does not cut" in runout.remedy


@pytest.mark.proof
def test_unlike_edges_leave_a_runout_determined_where_the_waveform_tells_them_well():
    sharp = determined_by(UNLIKE, SLOTS)[0]["runout"]
    assert sharp.determined and sharp.half_width < 0.2


def test_two_teeth_do_not_tell_the_angle_of_a_runout():
    rows, _ = determined_by(SLOT, SLOTS)
    assert not rows["runout_angle"].determined
    assert "half the difference of their radii" in rows["runout"].remark


@pytest.mark.proof
def test_the_angle_of_a_runout_is_that_from_the_nearest_tooth():
    rows, _ = determined_by(MIXED, MIX)
    assert rows["runout_angle"].value == pytest.approx(MIXED.runout_angle, abs=5.0)


@pytest.mark.proof
def test_a_helix_that_is_sought_is_found():
    truth = Truth(flutes=2, runout=0.0, helix=38.0)
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=2)
    known = CuttingSetup(
        tool=tool, identified=("runout", "helix"),
        dynamometer=Dynamometer(feed="x", normal="y", axial="z"),
    )  # fmt: skip
    found = identify_cutting_force(recordings(truth, SLOTS), known, SETTINGS)
    helix = next(one for one in rows_of(found) if one.name == "helix")
    assert helix.determined
    assert helix.value == pytest.approx(38.0, abs=1.5)


def test_terms_that_recordings_do_not_ask_for_are_left_out():
    still, alike = (determined_by(*one)[1].fit.problem for one in ((ROUNDED, ENDS), (SLOT, SLOTS)))
    assert not still.terms.modes and not alike.terms.teeth


@pytest.mark.proof
def test_worn_teeth_are_asked_for():
    _, found = determined_by(MIXED, MIX)
    assert found.fit.problem.terms.teeth and found.fit.problem.terms.modes


def test_a_dynamometer_with_a_wrong_sign_is_noticed():
    wrong = CuttingSetup(tool=known_of(SLOT).tool, dynamometer=Dynamometer(
        feed="x", normal="y", axial="z"))  # fmt: skip
    turned = []
    for one in recordings(SLOT, SLOTS[:1]):
        one.cut[1].lines[:, 1] *= -1
        turned.append(one)
    assert (
        "correct the directions and signs" in identify_cutting_force(turned, wrong, SETTINGS).reason
    )


def test_without_recordings_to_learn_from_there_is_a_reason():
    others = [replace(one, role="held_out") for one in recordings(SLOT, SLOTS[:1])]
    assert "roles.training" in identify_cutting_force(others, known_of(SLOT), SETTINGS).reason


@pytest.mark.parametrize(
    "kind", [
        "one tooth", pytest.param("no axial force", marks=pytest.mark.proof),
        pytest.param("the same feed twice", marks=pytest.mark.proof),
    ],
)  # fmt: skip
def test_odd_series_give_an_answer(kind):
    """Columns that vanish or are the same make nothing fail, and no number out of nothing."""
    flutes = 1 if kind == "one tooth" else 2
    truth = Truth(flutes=flutes, runout=0.0)
    tests = (SLOTS[0], SLOTS[0]) if kind == "the same feed twice" else SLOTS[:2]
    series = recordings(truth, tests)
    if kind == "no axial force":
        for one in series:
            one.cut[1].lines[:, 2] = 0.0
            one.cut[1].scatter[:, 2] = 0.0
    found = identify_cutting_force(series, known_of(truth), SETTINGS)
    rows = rows_of(found)
    for one in rows[:2]:
        assert abs(one.value - true_values(truth)[one.name]) <= one.half_width
    if kind == "one tooth":
        assert not any(one.determined for one in rows if one.name.startswith("runout"))


@pytest.mark.proof
def test_the_genetic_algorithm_finds_the_same_optimum():
    settings = CuttingFitSettings(
        method="genetic", genetic=GeneticSettings(population=30, generations=60, stall=20)
    )
    truth = Truth(flutes=3, runout=0.006)
    found = identify_cutting_force(recordings(truth, SLOTS[:2]), known_of(truth), settings)
    assert [one.method for one in found.methods] == ["least_squares", "genetic"]
    best, other = (one.rms_error_percent for one in found.methods)
    assert other < best + 2.0  # the same bowl: other valleys are at 10 % and above
    assert found.fit.values[0] == pytest.approx(850e6, rel=0.03)


PROOF = [pytest.mark.slow, pytest.mark.proof]


@pytest.mark.parametrize(("seeds", "least"), [(1, 1), pytest.param(20, 17, marks=PROOF)])
def test_intervals_hold_the_truth(seeds, least):
    """95 % intervals over 20 seeds: 17 hits or more of each have a chance of 98 %."""
    hits = dict.fromkeys(NAMES, 0)
    for seed in range(seeds):
        rows, _ = determined_by(SLOT, SLOTS, seed)
        for name in NAMES:
            one = rows[name]
            hits[name] += abs(one.value - true_values(SLOT)[name]) <= one.half_width
    assert min(hits.values()) >= least, hits
