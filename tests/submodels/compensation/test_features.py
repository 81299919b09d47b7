"""What the networks look at: derivatives, reversals, regimes, run-up, and what is known when."""

import numpy as np
import pytest

from pipeline.nets.windows import WindowInput
from pipeline.schema.arrays import Floats
from pipeline.submodels.compensation.features import (
    BEND,
    COMMANDED,
    EVEN,
    MEASURED,
    MODELLED,
    RESIDUAL,
    REST,
    SCREW,
    TORQUE,
    TURN,
    before_motion,
    features_of,
    inputs_of,
    modelled_following,
    regimes,
)
from pipeline.submodels.compensation.records import AxisRun, Run
from tests.submodels.compensation.axis_files import PERIOD, Made, drive

T = PERIOD * np.arange(300)


def there_and_back(way: float = 2e-3) -> Floats:
    """Rest, ``way`` [m] to and fro at 40 mm/s, rest; shape (T,)."""
    rows = round(way / 0.04 / PERIOD)
    speed = np.concatenate([np.zeros(50), np.full(rows, 0.04), np.full(rows, -0.04), np.zeros(50)])
    return np.cumsum(speed) * PERIOD


def run(reference: Floats | None, error: Floats, **changes) -> Run:
    filled = changes.pop("filled", np.zeros(len(error), bool))
    command = changes.pop("command", None)
    axis = AxisRun(error=error, reference=reference, command=command, filled=filled)
    return Run(name="a", file="a", group="a", sha256="a", period=PERIOD, axes={"X": axis})


def test_speed_and_acceleration_of_a_parabola_are_exact():
    found = before_motion(0.3 + 0.02 * T - 0.7 * T**2, PERIOD, None, None)
    np.testing.assert_allclose(found["speed"], 0.02 - 1.4 * T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["acceleration"], -1.4, rtol=0, atol=1e-6)


@pytest.mark.parametrize("rows", range(1, 8))
def test_a_command_of_a_few_samples_has_features(rows):
    found = before_motion(0.5 * T[:rows], PERIOD, None, 5.0)
    assert {len(values) for values in found.values()} == {rows}
    assert all(np.isfinite(values).all() for values in found.values())
    assert found["speed"][-1] == pytest.approx(0.5 if rows >= 3 else 0.0)


def test_the_way_since_a_reversal_has_the_sign_of_the_motion():
    reference = there_and_back()
    found = before_motion(reference, PERIOD, None, None)["since reversal"]
    turn = 50 + 25
    assert (found[:45] == 0).all()  # before any motion
    assert (found[55 : turn - 3] > 1).all() and (found[turn + 3 :] < -1).all()
    assert found[turn - 4] == pytest.approx(1 + np.log10(1 + 1e-3 / 1e-6), abs=1e-9)
    after = np.abs(found[turn + 3 : turn + 25])
    assert (np.diff(after) >= 0).all() and after.max() == pytest.approx(4.0, abs=1e-3)
    begun = int(np.flatnonzero(found < 0)[0])
    way = np.abs(reference[turn + 5] - reference[begun])
    assert -found[turn + 5] == pytest.approx(1 + np.log10(1 + way / 1e-6), abs=1e-9)
    assert found[-1] == found[turn + 28]  # at rest it stays what it was


def test_regimes_of_a_stroke():
    speed = np.concatenate([
        np.zeros(100), np.linspace(0, 0.05, 100), np.full(100, 0.05), np.linspace(0.05, -0.05, 200),
        np.full(100, -0.05),
    ])  # fmt: skip
    signals = before_motion(np.cumsum(speed) * PERIOD, PERIOD, None, None)
    found = regimes(signals)
    turn = 400
    assert (found[:95] == REST).all()
    assert (found[160:195] == BEND).all() and (found[205:295] == EVEN).all()
    assert (found[turn + 3 : turn + 10] == TURN).all()  # 0.1 mm takes 20 samples
    assert (found[turn + 30 : 495] == BEND).all() and (found[505:] == EVEN).all()


@pytest.mark.parametrize("forward", [0.0, 0.6])
def test_a_recording_that_begins_in_motion_has_the_steady_error_at_once(forward):
    """e = v (1 - f_v) / (S_pp P_p)."""
    speed = 0.03
    error, _ = modelled_following("X", 0.1 + speed * T, PERIOD, drive(forward))
    np.testing.assert_allclose(error, speed * (1 - forward) / 60.0, rtol=2e-3)


def test_a_recording_that_begins_at_rest_has_no_error_there():
    error, _ = modelled_following("X", there_and_back(), PERIOD, drive())
    assert np.abs(error[:49]).max() < 1e-9 < 1e-5 < np.abs(error).max()


def test_what_is_learnt_is_measured_less_modelled():
    reference = there_and_back()
    modelled, _ = modelled_following("X", reference, PERIOD, drive())
    wrong = 1e-6 * np.arange(len(reference))
    found = features_of(run(reference, modelled + wrong), "X", drive(), step_s=0.004, lead_mm=None)
    np.testing.assert_allclose(found.recording.signals[RESIDUAL], wrong[::2], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.modelled + wrong[::2], found.measured, rtol=0, atol=1e-15)
    assert found.recording.step_s == pytest.approx(0.004)
    np.testing.assert_allclose(np.diff(found.time), 0.004)


def test_the_place_in_a_turn_of_the_screw():
    found = before_motion(np.array([0.0, 0.0025, 0.01, 0.0175]), PERIOD, None, 10.0)
    np.testing.assert_allclose(found["screw sine"], [0, 1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(found["screw cosine"], [1, 0, 1, 0], atol=1e-12)


def test_samples_beside_a_missing_one_are_not_known():
    filled = np.zeros(100, bool)
    filled[40] = True
    found = features_of(
        run(None, np.zeros(100), filled=filled), "X", None, step_s=PERIOD, lead_mm=None
    )
    assert np.flatnonzero(~found.known).tolist() == [39, 40, 41]


def test_nothing_measured_is_an_input_before_the_motion():
    found = [Made(0).features, Made(1).features]
    names = [one.name for one in inputs_of(found, None)]
    assert names == [*COMMANDED, *MODELLED]
    assert not MEASURED & set(names)
    assert all(one.older_than_s is None for one in inputs_of(found, None))


def test_an_estimation_sees_what_is_older_than_its_horizon():
    found = inputs_of([Made(0).features], 0.02)
    aged = {one.name: one.older_than_s for one in found if one.name in MEASURED}
    assert aged == {RESIDUAL: 0.02, TORQUE: 0.02}
    assert {one.name for one in found if one.older_than_s is None} == {*COMMANDED, *MODELLED}


def test_inputs_are_those_that_all_recordings_have():
    reference = there_and_back()
    error = np.zeros(len(reference))
    rich = features_of(
        run(reference, error, command=error), "X", drive(), step_s=0.004, lead_mm=5.0
    )
    plain = features_of(run(reference, error), "X", None, step_s=0.004, lead_mm=5.0)
    alone = features_of(run(None, error), "X", None, step_s=0.004, lead_mm=5.0)
    assert [one.name for one in inputs_of([rich], None)] == [*COMMANDED, *SCREW, *MODELLED]
    assert [one.name for one in inputs_of([rich, plain], None)] == [*COMMANDED, *SCREW]
    assert inputs_of([rich, alone], None) == ()
    assert inputs_of([rich, alone], 0.02) == (WindowInput(name=RESIDUAL, older_than_s=0.02),)
    assert (alone.regime == "").all() and (alone.modelled == 0).all()
