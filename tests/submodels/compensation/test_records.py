"""Recordings of following errors: parts and their hashes, ends, gaps, what is missing."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.signals.recordings import Channel
from pipeline.submodels.compensation.records import ErrorChannels, Run, read_runs
from tests.submodels.compensation.axis_files import (
    ALONE,
    PERIOD,
    POSITIONS,
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
    assert "'tool'" in run.lacking["X"] and "compensation_records.parts" in run.lacking["X"]


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
