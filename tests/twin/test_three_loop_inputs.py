"""What the three-loop drive refuses, and what it does with the least input."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.machine.fuzzy_pi import FuzzyParameters
from pipeline.twin.three_loop import follow_position, follow_speed
from tests.twin.test_three_loop import TWISTING, H, position_loop, speed_loop, step


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reference": [[0.0]]}, r"reference has shape \(1, 1\)"),
        ({"reference": []}, r"reference has shape \(0,\)"),
        ({"reference": [0.0, np.nan]}, r"reference\[1\] = nan must be finite"),
        ({"load": [1.0, 2.0]}, "load has 2 samples, but the reference has 5"),
        ({"load": np.inf}, r"load\[0\] = inf must be finite"),
        ({"period": 1.5e-4}, r"period = 0\.00015 s .* multiple of current_loop\.period = 0\.0001"),
        ({"period": 0.0}, r"period = 0\.0 s"),
        ({"period": np.nan}, "period = nan s"),
        ({"steps": 0}, "steps = 0 must be a whole number"),
        ({"steps": 2.5}, r"steps = 2\.5 must be a whole number"),
        ({"steps": np.nan}, "steps = nan must be a whole number"),
        (
            {"drive": replace(TWISTING, transmission=replace(
                TWISTING.transmission, coupling_stiffness=1e9, screw_stiffness=1e9,
                axial_stiffness=1e15))},
            r"steps = 5 are too few for the shaft's resonance of 1\.21e\+06 1/s: take 243 or more",
        ),
        ({"drive": replace(TWISTING, position_loop=None)}, r"drive\.position_loop is missing"),
    ],
)  # fmt: skip
def test_inputs_that_do_not_fit_are_refused(change: dict, words: str) -> None:
    values = {"reference": np.zeros(5), "period": 1e-3, "drive": TWISTING} | change
    with pytest.raises(ValueError, match=words):
        follow_position(**values)


def test_a_drive_without_position_loop_follows_speeds() -> None:
    trace = follow_speed(step(10.0, 2000), H, replace(TWISTING, position_loop=None))
    assert trace.speed[-1] == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("fuzzy", [None, FuzzyParameters(error_scale=0.1, change_scale=1e-3)])
@pytest.mark.parametrize(("load", "target"), [(1e12, 0.0), (0.0, 1e308)])
def test_a_drive_that_runs_away_says_when_and_what_to_do(fuzzy, load, target) -> None:
    """Dragged beyond any speed; or sent to a place that no number holds."""
    drive = position_loop(speed_loop(TWISTING, fuzzy=fuzzy), gain=1e3)
    reference = np.array([0.0, target, target, target])
    with pytest.raises(ValueError, match=r"runs away at 0 s: lower the gains .* or the load"):
        follow_position(reference, 1e-3, drive, load=load)


def test_one_sample_is_the_start() -> None:
    trace = follow_position([0.25], 1e-3, TWISTING)
    assert trace.position == pytest.approx([0.25]) and trace.time.tolist() == [0.0]
