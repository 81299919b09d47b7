"""Harmonics of the model against closed forms and against time, and its waveform residual."""

import numpy as np
import pytest

from pipeline.cutting.force.force_law import regressors
from pipeline.cutting.tool import Tool
from pipeline.schema.cutting import CutConditions, StoredCutModel, ToolGeometry
from pipeline.schema.store import json_text, parsed
from pipeline.submodels.cutting.fit import Fit, fit_waveform
from pipeline.submodels.cutting.model import restored, stored, waveform_residuals
from pipeline.submodels.cutting.recordings import cut_harmonics
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.selection import model_of
from pipeline.submodels.cutting.waveform import (
    CutHarmonics,
    Problem,
    Terms,
    columns,
    mean_squares,
    tooth_columns,
    transfer,
)
from tests.submodels.cutting.recorded import SETTINGS, Truth, known_of, milled, recordings

SLOT = CutConditions(speed=100.0, f_z=1e-4, a_p=3e-3, phi_st=0.0, phi_ex=np.pi, flutes=2)
MILL = Tool(kind="flat", diameter_mm=25.0, flutes=2)


def test_harmonics_of_a_slot_are_those_of_sine_and_cosine():
    """Two straight teeth: F_y of K_tc is a f sin^2, of K_te a |sin|, by their Fourier sums."""
    found = columns(MILL, ToolGeometry(), SLOT, 8)
    a, f = SLOT.a_p, SLOT.f_z
    # steps of a 512th of a revolution: 1 in 1000 of the jump
    assert found[2, 1, 0] == pytest.approx(-a * f / 2, abs=1e-3 * a * f)
    assert found[2, 0, 0] == pytest.approx(1j * a * f / 2, abs=1e-3 * a * f)
    assert found[4, 1, 3] == pytest.approx(-4 * a / (np.pi * 15), abs=1e-3 * a)
    assert np.abs(found[1::2]).max() < 1e-12


@pytest.mark.parametrize("helix", [0.0, 0.5])
def test_means_are_those_of_the_closed_form(helix):
    arc = CutConditions(speed=80.0, f_z=6e-5, a_p=2e-3, phi_st=0.9, phi_ex=2.7, flutes=3)
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=3)
    found = columns(tool, ToolGeometry(helix=helix), arc, 3)[0].real
    exact = regressors(flutes=3, f_z=6e-5, a_p=2e-3, phi_st=0.9, phi_ex=2.7)
    step = 2 * np.pi / 256  # of the grid, within which an edge enters and leaves
    bound = 3 * 2e-3 * step / (2 * np.pi) * np.array([6e-5] * 3 + [1.0] * 3)
    assert (np.abs(found - exact) <= bound).all()


def test_runout_and_worn_teeth_are_those_of_a_simulation_in_time():
    truth = Truth(flutes=2, helix=35.0, runout=0.008, runout_angle=0.0, worn=(1.3, 0.7))
    arc = CutConditions(speed=100.0, f_z=1e-4, a_p=2e-3, phi_st=0.0, phi_ex=np.pi, flutes=2)
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=2)
    place = ToolGeometry(along=8e-6, helix=np.radians(35.0))
    values = np.concatenate([np.array(truth.cutting) * 1e6, np.array(truth.edge) * 1e3])
    said = columns(tool, place, arc, 45) @ values
    said = said + tooth_columns(tool, place, arc, 45) @ (-0.3 * np.array(truth.edge) * 1e3)
    angles = 0.2 + 2 * np.pi * np.arange(100) / 100
    in_time = milled(truth, rpm=6000, f_z=0.1, a_p=2.0, entry=0.0, leave=np.pi, seconds=0.01,
                     rate=1e4, phase=0.2)  # fmt: skip
    rest = wave(said, angles) - in_time
    # 45 harmonics of edges that enter over 13 degrees; the simulation's 24 slices
    assert np.sqrt((rest**2).mean()) < 0.02 * np.sqrt((in_time**2).mean())


def test_single_teeth_leave_the_mean_of_all_as_it_is():
    tool = Tool(kind="flat", diameter_mm=12.0, flutes=4)
    arc = CutConditions(speed=80.0, f_z=6e-5, a_p=2e-3, phi_st=0.0, phi_ex=2.0, flutes=4)
    found = tooth_columns(tool, ToolGeometry(helix=0.5), arc, 12)
    assert found.shape == (13, 3, 9)
    assert np.abs(found[::4]).max() < 1e-15  # those harmonics all teeth share


def test_a_mode_shows_rest_as_it_is_and_resonance_by_its_damping():
    natural, damping = np.array([500.0, 900.0, 2000.0]), np.array([0.05, 0.1, 0.02])
    found = transfer(np.array([0.0, 500.0]), natural, damping)
    assert found[0] == pytest.approx([1, 1, 1])
    assert found[1, 0] == pytest.approx(-1j / (2 * 0.05))


LINES = np.random.default_rng(1).normal(size=(2, 9, 3, 2)) @ [1, 1j]


def conditions(f_z, **changed):
    return CutConditions(**{
        "speed": 100.0, "f_z": f_z, "a_p": 2e-3, "phi_st": 0.0, "phi_ex": np.pi, "flutes": 2,
        **changed,
    })  # fmt: skip


def residuals_of(feeds=(5e-5, 1e-4), phases=(0.3, 1.9)):
    """Recordings of A f_z + B at some phases, of which the model says nothing."""
    order = np.arange(9)[:, None]
    cuts = [
        CutHarmonics(
            conditions=conditions(f), variance=np.full((9, 3), 1e-9),
            lines=(100 * LINES[0] + 1e6 * f * LINES[1]) * np.exp(1j * order * p),
        )
        for f, p in zip(feeds, phases, strict=True)
    ]  # fmt: skip
    return waveform_residuals(cuts, [np.zeros((9, 3))] * len(cuts), phases, 0.0)


def test_it_is_affine_in_the_feed():
    (found,) = residuals_of()
    exact = 100 * LINES[0] + 1e6 * 7e-5 * LINES[1]
    assert found.at(7e-5, 8) == pytest.approx(exact)


def test_one_feed_makes_it_constant():
    (found,) = residuals_of((5e-5, 5.1e-5))
    assert np.abs(found.slope).max() == 0.0


def test_far_beyond_the_feeds_it_does_not_run_away():
    (found,) = residuals_of()
    assert found.at(3e-4, 8) == pytest.approx(found.at(1.25e-4, 8))


@pytest.mark.parametrize(
    "other",
    [
        conditions(7e-5, speed=102.0), conditions(7e-5, a_p=2.1e-3), conditions(7e-5, phi_st=0.1),
        conditions(7e-5, phi_ex=3.0), conditions(2.1e-4), conditions(2.4e-5),
        conditions(7e-5, flutes=3),
    ],
)  # fmt: skip
def test_it_says_nothing_of_other_conditions(other):
    (found,) = residuals_of()
    assert not found.covers(other)
    assert found.covers(conditions(7e-5, speed=100.5))


def test_scatter_is_not_learnt():
    cut = CutHarmonics(
        conditions=conditions(5e-5), lines=LINES[0], variance=np.full((9, 3), 100.0),
    )  # fmt: skip
    (found,) = waveform_residuals([cut], [np.zeros((9, 3))], [0.0], 0.0)
    assert np.abs(found.constant).max() == 0.0


def test_it_helps_on_a_feed_between_where_the_law_is_bent():
    """Of four feeds one is left out in turn; a straight law leaves over what is bent in h^0.7."""
    truth = Truth(flutes=2, runout=0.0, exponent=0.3)
    tests = [(6000.0, f, 2.0, 0.0, np.pi) for f in (0.03, 0.06, 0.09, 0.12)]
    cuts = [cut_harmonics(one, SETTINGS) for one in recordings(truth, tests, 2, zero=0.0)]
    for out in (1, 2):
        rest = [cut for k, cut in enumerate(cuts) if k != out]
        fit = fit_waveform(known_of(truth).tool, rest, Terms())
        without, with_it = (
            mean_squares(cuts[out].lines - model_of(fit, with_residual=one).beside(cuts[out]))
            for one in (False, True)
        )
        whole = mean_squares(cuts[out].lines)
        # over the feed both are straight: what is left is the bend between the feeds
        assert with_it.sum() < 0.6 * without.sum()
        assert with_it.sum() < 0.03**2 * whole.sum()


@pytest.mark.parametrize("edge", ["at once", "exponential"])
def test_a_model_is_stored_in_full(edge):
    """Runout, modes, single teeth, the law's shape and what the mechanics leave over, of no fit."""
    truth = Truth(flutes=3, exponent=0.3)
    tests = [(6000.0, f, 2.0, 0.0, np.pi) for f in (0.05, 0.1)]
    cuts = [cut_harmonics(one, SETTINGS) for one in recordings(truth, tests)]
    problem = Problem(
        tool=known_of(truth).tool, cuts=cuts, terms=Terms(modes=True, teeth=True, edge=edge),
        left_out=np.ones(3),
    )  # fmt: skip
    x = np.mean(problem.bounds, axis=0)
    fit = Fit(problem=problem, x=x, solved=problem.solved(x), evaluations=1)
    model = model_of(fit, with_residual=True)
    text = json_text(stored(model)).encode()
    again = restored(parsed(text, StoredCutModel, "model.json"))
    here = cuts[0].conditions
    assert again.chip == model.chip and (model.line is None) == (edge == "at once")
    assert again.predicted(here, 20) == pytest.approx(model.predicted(here, 20), rel=1e-12)
    assert np.abs(model.predicted(here, 20) - model.mechanics(here, 20)).max() > 0
