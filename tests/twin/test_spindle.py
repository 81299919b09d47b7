"""The spindle in its state table: units, sampling, and what is asked of the records."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import TARGET, SpindleRecords, spindle_stretches, stretch_of, with_heat
from tests.submodels.spindle.spindle_days import ONE, RECORDS, state_table

C_AXIS = replace(RECORDS, position_control=True)


def test_heat_sources_come_from_rpm_and_percent() -> None:
    """3000 rpm is 314.159 rad/s, 40 % is 0.4: the five sources worked out by hand."""
    state = pd.DataFrame(
        {
            "spindle_speed": [3000.0, -3000.0],
            "spindle_load": [40.0, -40.0],
            "spindle_position_control": [0.0, 1.0],
        }
    )
    found = with_heat(state, C_AXIS)
    omega = 314.1592653589793
    by_hand = {
        "bearing_friction": omega ** (5 / 3),
        "load_speed": 0.4 * omega,
        "copper": 0.16,
        "windage": omega**2,
    }
    for name, value in by_hand.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    np.testing.assert_array_equal(found["position_hold"], [0.0, 1.0])


def test_sources_are_taken_before_they_are_averaged() -> None:
    """Half the time at n is 2^(-1) of n^(5/3), not the 5/3 power of n/2."""
    state = state_table(ONE, 0, "2026-01-05", hours=1.0)
    state["spindle_speed"] = np.where(np.arange(3600) % 2, 3000.0, 0.0)
    (piece,) = spindle_stretches(
        state, "2026-01-05", RECORDS, step=10.0, bridge_s=60.0, shortest_s=60.0
    )
    np.testing.assert_allclose(
        piece.frame["bearing_friction"], 314.1592653589793 ** (5 / 3) / 2, rtol=1e-12
    )


@pytest.mark.parametrize(("records", "name"), [
    (RECORDS, "spindle_speed"),
    (RECORDS, "spindle_load"),
    (C_AXIS, "spindle_position_control"),
    (replace(RECORDS, ambient=True), "ambient_temperature"),
])  # fmt: skip
def test_a_missing_column_is_named(records: SpindleRecords, name: str) -> None:
    have = [s for s in records.signals if s != name]
    with pytest.raises(ValueError, match=f"no column {name}"):
        with_heat(pd.DataFrame({s: [1.0] for s in have}), records)


def test_position_control_that_is_not_recorded_heats_nothing() -> None:
    state = pd.DataFrame({"spindle_speed": [100.0], "spindle_load": [10.0]})
    assert with_heat(state, RECORDS)["position_hold"].tolist() == [0.0]
    assert "position_hold" not in RECORDS.sources
    assert C_AXIS.sources == list(SOURCES)


def test_a_stretch_to_predict_never_looks_at_the_temperature() -> None:
    state = state_table(ONE, 1, "2026-01-05", hours=1.0)
    first = stretch_of(state, 25.0, RECORDS, step=10.0)
    second = stretch_of(state.assign(**{TARGET: np.nan}), 25.0, RECORDS, step=10.0)
    pd.testing.assert_frame_equal(first.frame, second.frame)
    third = stretch_of(state.drop(columns=TARGET), 25.0, RECORDS, step=10.0)
    np.testing.assert_array_equal(first.frame["copper"], third.frame["copper"])
    assert len(first.frame) == 360
    assert first.frame[TARGET].iloc[0] == 25.0


def test_inputs_are_held_however_long_but_not_backwards() -> None:
    state = state_table(ONE, 2, "2026-01-05", hours=2.0)
    state["spindle_speed"] = 1000.0
    state.iloc[1000:5000, 0] = np.nan
    held = stretch_of(state, 25.0, RECORDS, step=10.0)
    assert len(held.frame) == 720
    assert held.bridged == 400
    assert held.frame["bearing_friction"].nunique() == 1
    state.iloc[:30, 0] = np.nan
    with pytest.raises(ValueError, match=r"06:00:30.*start where they are known"):
        stretch_of(state, 25.0, RECORDS, step=10.0)


def test_nothing_can_be_predicted_from_nothing() -> None:
    state = state_table(ONE, 3, "2026-01-05", hours=0.1)
    with pytest.raises(ValueError, match="no row of the state table knows all of spindle_speed"):
        stretch_of(state.assign(spindle_load=np.nan), 25.0, RECORDS, step=10.0)
    with pytest.raises(ValueError, match="has no row"):
        stretch_of(state.iloc[:0], 25.0, RECORDS, step=10.0)
    with pytest.raises(ValueError, match="start temperature nan"):
        stretch_of(state, float("nan"), RECORDS, step=10.0)
