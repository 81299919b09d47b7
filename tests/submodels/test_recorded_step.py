"""Resolution of a recorded signal by its values, and what it leaves undecided of a judgement."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.submodels.contract import Target
from pipeline.submodels.judge import _scores, _shortfall
from pipeline.submodels.scoring import ALL, STEP
from pipeline.submodels.statistics import grid_step


@given(st.floats(1e-7, 10.0), st.integers(0, 100))
def test_the_step_of_a_rounded_signal_is_found(step: float, seed: int) -> None:
    signal = 40 * step * np.sin(0.01 * np.arange(2000)) + step * seed
    assert grid_step(step * np.round(signal / step)) == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_a_signal_without_steps_has_none(seed: int) -> None:
    assert grid_step(np.random.default_rng(seed).normal(size=500)) == 0.0
    assert grid_step(np.full(50, 3.0)) == grid_step(np.array([np.nan])) == 0.0


@pytest.mark.parametrize(("by", "column"), [("column", True), ("values", False)])
def test_a_difference_within_the_steps_is_not_decided(by: str, column: bool) -> None:
    """Two predictions that differ by far less than the steps: decided without, open with them."""
    random = np.random.default_rng(1)
    truth = 0.5 * np.sin(0.05 * np.arange(4000))
    measured = 0.1 * np.round(truth / 0.1)
    alike = [truth + random.normal(0, 0.05, 4000) for _ in range(2)]
    base, predicted = sorted(alike, key=lambda one: float(np.abs(one - measured).mean()))
    frame = pd.DataFrame({
        "quantity": "error", "regime": "", "measured": measured, "predicted": predicted,
        "baseline_persistence": base, "low": np.nan, "high": np.nan, "scored": True, "case": "a",
        "group": "a", "role": "held_out",
    })  # fmt: skip
    if column:
        frame = frame.assign(measured=measured + 1e-3 * random.normal(size=4000), step=0.1)
    target = Target(
        quantity="error", unit="um", baselines=("persistence",), must_beat=("persistence",)
    )
    assert not column or STEP in frame
    (score,) = (s for s in _scores(frame, target, "held_out") if s.group == ALL)
    worse, unsure = _shortfall(score, "persistence")
    assert not worse and "the sensor's steps leave" in unsure[0]
    (score,) = (s for s in _scores(frame.assign(step=0.0), target, "held_out") if s.group == ALL)
    assert _shortfall(score, "persistence")[0]
    far = frame.assign(baseline_persistence=measured)
    (score,) = (s for s in _scores(far, target, "held_out") if s.group == ALL)
    assert _shortfall(score, "persistence")[0]
