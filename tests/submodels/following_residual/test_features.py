"""Recordings of following errors and what the networks look at: parts, gaps, regimes, inputs."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.nets.windows import WindowInput
from pipeline.schema.arrays import Floats
from pipeline.signals.recordings import Channel
from pipeline.submodels.following_residual.features import (
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
from pipeline.submodels.following_residual.records import AxisRun, ErrorChannels, Run, read_runs
from tests.submodels.following_residual.axis_files import (
    ALONE,
    PERIOD,
    POSITIONS,
    Made,
    drive,
    error_table,
    records,
    write_signals,
)

ROWS = 200


def parabola(offset: float = 0.0, rows: int = ROWS) -> pd.DataFrame:
    t = PERIOD * np.arange(rows)
    command = 0.5 * t**2 + offset
    return pd.DataFrame({
        "t": t, "x_command": command, "x_actual": command - 1e-5 * t - 3e-6 * t**2,
        "x_current": 1.0 + t,
    })  # fmt: skip


def cut(offset: float, tool: float, split: int) -> pd.DataFrame:
    return parabola(offset).assign(tool=tool, split=split)


def runs_of(folder: Path, tables: dict[str, pd.DataFrame], **changes) -> dict[str, Run]:
    training = changes.pop("training", lambda name, file: False)
    found = read_runs(write_signals(folder, tables), records(**changes), training)
    return {run.name: run for run in found}


def test_columns_tell_parts_of_a_table_apart(tmp_path):
    whole = pd.concat([cut(0, 1.0, 0), cut(1, 2.0, 0), cut(2, 2.0, 1)], ignore_index=True)
    whole["t"] = PERIOD * np.arange(len(whole))
    found = runs_of(tmp_path, {"a": whole}, parts=("tool", "split"), group="tool")
    names = [f"feed/a.csv#tool={tool},split={split}" for tool, split in ((1, 0), (2, 0), (2, 1))]
    assert list(found) == names
    assert [found[name].group for name in names] == ["tool 1", "tool 2", "tool 2"]
    assert {run.file for run in found.values()} == {"feed/a.csv"}
    for k, name in enumerate(names):
        reference = found[name].axes["X"].reference
        assert reference is not None
        np.testing.assert_allclose(reference, parabola(k)["x_command"], atol=1e-12)


def test_parts_without_a_group_belong_to_themselves(tmp_path):
    whole = pd.concat([cut(0, 1.0, 0), cut(1, 2.0, 0)], ignore_index=True)
    whole["t"] = PERIOD * np.arange(len(whole))
    found = runs_of(tmp_path, {"a": whole}, parts=("tool",))
    assert [run.group for run in found.values()] == list(found)


@pytest.mark.parametrize("beside", [True, False])
def test_a_part_has_the_hash_of_its_samples_in_whatever_file(tmp_path, beside):
    """Also where it is all that its file holds."""
    first = pd.concat([cut(0, 1.0, 0), cut(1, 2.0, 0)], ignore_index=True)
    first["t"] = PERIOD * np.arange(len(first))
    second = pd.concat([cut(5, 7.0, 0)] * beside + [cut(1, 9.0, 0)], ignore_index=True)
    second["t"] = PERIOD * np.arange(len(second))
    found = runs_of(tmp_path, {"a": first, "b": second}, parts=("tool",))
    one, other = found["feed/a.csv#tool=1"], found["feed/a.csv#tool=2"]
    assert one.sha256 != other.sha256
    assert found["feed/b.csv#tool=9"].sha256 == other.sha256


def test_a_column_of_parts_that_is_missing_is_said(tmp_path):
    (run,) = runs_of(tmp_path, {"a": parabola()}, parts=("tool",)).values()
    assert not run.axes
    assert "'tool'" in run.lacking["X"] and "following_residual_records.parts" in run.lacking["X"]


def test_the_end_of_a_training_recording_is_a_recording_of_its_own(tmp_path):
    found = runs_of(
        tmp_path, {"a": parabola(), "b": parabola(1.0)}, last_share=0.25,
        training=lambda name, file: file == "feed/a.csv",
    )  # fmt: skip
    assert list(found) == ["feed/a.csv#begin", "feed/a.csv#end", "feed/b.csv"]
    begin, end = found["feed/a.csv#begin"], found["feed/a.csv#end"]
    assert (begin.samples, end.samples) == (150, 50)
    assert (begin.last, end.last, found["feed/b.csv"].last) == (False, True, False)
    assert end.start == pytest.approx(150 * PERIOD)
    assert len({begin.sha256, end.sha256, found["feed/b.csv"].sha256}) == 3
    assert begin.group != end.group
    reference = end.axes["X"].reference
    assert reference is not None
    np.testing.assert_allclose(reference, parabola()["x_command"][150:], atol=1e-12)


def test_a_training_recording_with_a_gap_gives_an_end_too(tmp_path):
    broken = parabola().drop(index=range(90, 110))
    found = runs_of(
        tmp_path, {"a": broken}, last_share=0.25, training=lambda name, file: file == "feed/a.csv"
    )
    assert [name for name, run in found.items() if run.last] == [
        "feed/a.csv (part 1)#end", "feed/a.csv (part 2)#end",
    ]  # fmt: skip


def test_a_missing_channel_takes_its_axis_alone(tmp_path):
    other = ErrorChannels(
        reference=Channel(column="y_command", unit="m"),
        position=Channel(column="x_actual", unit="m"),
    )
    axes = {"X": POSITIONS, "Y": other}
    (run,) = runs_of(tmp_path, {"a": parabola()}, axes=axes).values()
    assert list(run.axes) == ["X"]
    assert "'y_command'" in run.lacking["Y"]


def test_a_gap_makes_two_recordings(tmp_path):
    broken = parabola().drop(index=range(90, 110))
    found = runs_of(tmp_path, {"a": broken})
    assert list(found) == ["feed/a.csv (part 1)", "feed/a.csv (part 2)"]
    first, second = found.values()
    assert (first.samples, second.samples) == (90, 90)
    assert second.start == pytest.approx(110 * PERIOD)
    assert first.sha256 != second.sha256
    assert not first.axes["X"].filled.any()


def test_rows_that_are_missing_lie_on_a_curve_and_are_marked(tmp_path):
    """A straight line is 2 * 0.5 * PERIOD^2 off in the middle of three."""
    (run,) = runs_of(tmp_path, {"a": parabola().drop(index=[50, 51, 52, 120])}).values()
    axis = run.axes["X"]
    assert np.flatnonzero(axis.filled).tolist() == [50, 51, 52, 120]
    assert axis.reference is not None
    np.testing.assert_allclose(axis.reference, parabola()["x_command"], rtol=0, atol=1e-12)
    t = PERIOD * np.arange(ROWS)
    np.testing.assert_allclose(axis.error, 1e-5 * t + 3e-6 * t**2, rtol=0, atol=1e-12)


def test_the_error_alone_is_enough(tmp_path):
    (run,) = runs_of(tmp_path, {"a": error_table(0)}, axes={"X": ALONE}).values()
    axis = run.axes["X"]
    assert axis.reference is None and axis.command is None
    np.testing.assert_array_equal(axis.error, error_table(0)["x_error"])


def test_an_axis_names_its_error_or_both_positions():
    with pytest.raises(ValueError, match="neither its error nor both"):
        ErrorChannels(reference=Channel(column="x_command"))


def test_a_group_is_one_of_the_parts():
    with pytest.raises(ValueError, match="group = 'tool' is none of"):
        records(group="tool", parts=("split",))


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
