"""Windows at known wear: rates, gaps, conditions, interpolated wear, parts of tables, classes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recorder_tables import layout

from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.signals.recordings import Channel
from pipeline.signals.wear_lives import read_lives
from pipeline.signals.wear_windows import (
    ChannelScaling,
    ConditionTable,
    InCut,
    Lives,
    WearRecords,
    WearSource,
    WearWindows,
)
from tests.signals.wear_files import IDENTITY, SOURCES, raw_lives, signals_of, wear_at, wear_records


def joined(lives: Lives) -> WearWindows:
    return WearWindows.joined([life.windows for life in lives.lives])


def test_lives_hold_every_window_with_its_wear_and_conditions(tmp_path: Path) -> None:
    found = read_lives(signals_of(tmp_path, tools=2, cuts=3, rows=250), wear_records())
    assert [life.tool for life in found.lives] == ["T0", "T1"]
    assert not found.left_out
    windows = joined(found)
    assert windows.values.shape == (2 * 3 * 2, 2, 100)  # two windows of 100 in 250 rows
    assert windows.values.dtype == np.float32
    assert windows.units == ("N", "m/s^2")
    at = [wear_at(cut, 3, tool) for tool in range(2) for cut in range(3) for _ in range(2)]
    np.testing.assert_allclose(windows.wear, at, atol=0.006)  # the table has two decimals
    assert windows.conditions["cut_type"].tolist() == ["side"] * 6 + ["slot"] * 6
    np.testing.assert_allclose(windows.conditions["feed"][:6], [300, 300, 600, 600, 300, 300])
    np.testing.assert_allclose(windows.progress[:6], [0, 0, 2, 2, 4, 4])
    raw = pq.read_table(tmp_path / "raw/wear/T0_000.parquet").to_pandas()
    np.testing.assert_allclose(windows.values[1, 0], raw["force"][100:200], rtol=1e-6)


def test_wear_between_two_measurements_is_interpolated_and_said(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=1, cuts=4, blank=[(0, 1), (0, 3)])
    found = read_lives(signals, wear_records())
    life = found.lives[0].windows
    middle = life.progress == 2.0
    np.testing.assert_allclose(life.wear[middle], 0.5 * wear_at(2, 4, 0), atol=0.01)
    assert not life.measured[middle].any()
    assert life.measured[~middle].all()
    assert "no measurement of the same tool" in found.left_out["wear/T0_003.parquet"]
    left = read_lives(signals, wear_records(interpolate=False))
    assert "was not measured" in left.left_out["wear/T0_001.parquet"]


def test_of_a_tool_in_use_cuts_after_the_last_measurement_are_kept_without_wear(
    tmp_path: Path,
) -> None:
    signals = signals_of(tmp_path, tools=2, cuts=4, blank=[(0, 1), (0, 3), (1, 3)])
    found = read_lives(signals, wear_records(), in_use=("T0",))
    first, second = (life.windows for life in found.lives)
    last = first.progress == 6.0
    assert last.any() and np.isnan(first.wear[last]).all() and not first.measured[last].any()
    assert np.isfinite(first.wear[~last]).all()
    assert second.progress.max() == 4.0 and list(found.left_out) == ["wear/T1_003.parquet"]


def test_a_tool_in_use_that_nobody_measured_is_kept(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=2, cuts=2, blank=[(0, 0), (0, 1)])
    tool, other = read_lives(signals, wear_records(), in_use=("T0",)).lives
    assert tool.tool == "T0" and np.isnan(tool.windows.wear).all()
    assert np.isfinite(other.windows.wear).all()
    assert [one.tool for one in read_lives(signals, wear_records()).lives] == ["T1"]


def test_a_lower_rate_is_reached_behind_a_low_pass(tmp_path: Path) -> None:
    """180 Hz would fold to 20 Hz at a rate of 200 Hz; 30 Hz stays."""
    (tmp_path / "raw/wear").mkdir(parents=True)
    t = np.arange(4000) / 1000.0
    table = pd.DataFrame({
        "time": t, "force": np.sin(2 * np.pi * 30 * t), "vibration": np.sin(2 * np.pi * 180 * t),
    })  # fmt: skip
    raw_lives(tmp_path / "other", tools=1, cuts=1)
    pq.write_table(pa.Table.from_pandas(table), tmp_path / "raw/wear/T0_000.parquet")
    (tmp_path / "other/wear/lives.csv").rename(tmp_path / "raw/wear/lives.csv")
    ingest(tmp_path / "raw", tmp_path / "signals", SOURCES, IDENTITY)
    records = wear_records(rate_Hz=200.0, length=400)
    values = joined(read_lives(tmp_path / "signals", records)).values[:, :, 50:-50]
    assert values[0, 0].std() == pytest.approx(np.sqrt(0.5), rel=0.02)
    assert values[0, 1].std() < 0.02
    faster = read_lives(tmp_path / "signals", wear_records(rate_Hz=2000.0))
    assert "sampled at 1000 Hz" in faster.left_out["wear/T0_000.parquet"]


def table_signals(folder: Path, table: pd.DataFrame) -> Path:
    (folder / "raw").mkdir()
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), folder / "raw/all.parquet")
    units = {"experiment": None, "phase": None, "wear": "mm", "force": "N"}
    columns = {name: (name, unit) for name, unit in units.items()}
    form = layout(columns, time="time", text=("experiment", "phase"))
    source = RecordSource(format="parquet", files="*.parquet", table=form)
    ingest(folder / "raw", folder / "signals", (source,), IDENTITY)
    return folder / "signals"


def experiments(rows: int = 200) -> pd.DataFrame:
    parts = []
    for name in ("a", "b"):
        t = 0.5 * np.arange(rows)
        parts.append(pd.DataFrame({
            "time": t, "experiment": name, "wear": 1e-4 + 1e-3 * t / t[-1],
            "phase": np.where(np.arange(rows) < 100, "Layer 1 Up", "Repositioning"),
            "force": 100.0 + np.arange(rows),
        }))  # fmt: skip
    return pd.concat(parts, ignore_index=True)


OF_TABLE = WearRecords(
    recordings=("all.parquet",), channels={"force": Channel(column="force", quantity="force")},
    wear=WearSource(name="wear", unit="mm"), tool="experiment", parts=("experiment",),
    rate_Hz=2.0, length=20,
)  # fmt: skip


def test_parts_of_a_table_are_lives_with_hashes_of_their_own(tmp_path: Path) -> None:
    found = read_lives(table_signals(tmp_path, experiments()), OF_TABLE)
    assert [life.tool for life in found.lives] == ["a", "b"]
    life = found.lives[0]
    assert life.files[0].name == "all.parquet#experiment=a"
    assert life.files[0].file == "all.parquet"
    assert len(life.windows) == 10
    # wear at the middle of the first window, at 5 s of 99.5 s, in um
    assert life.windows.wear[0] == pytest.approx(0.1 + 1.0 * 5.0 / 99.5)
    np.testing.assert_allclose(np.diff(life.windows.progress), 10.0)
    assert life.files[0].sha256 == found.lives[1].files[0].sha256  # the same force twice


def test_words_of_the_process_tell_what_is_in_cut(tmp_path: Path) -> None:
    cut = InCut(channel=Channel(column="phase", quantity="words"), values=("Layer *",))
    found = read_lives(table_signals(tmp_path, experiments()), replace(OF_TABLE, in_cut=cut))
    assert len(found.lives[0].windows) == 5
    assert found.lives[0].windows.values.max() < 200.0


def test_a_level_tells_what_is_in_cut(tmp_path: Path) -> None:
    table = experiments()
    table["force"] = np.where(np.arange(len(table)) % 200 < 120, 0.5, 100.0)
    cut = InCut(channel=Channel(column="force", quantity="force"), share=0.5, over_s=0.5)
    found = read_lives(table_signals(tmp_path, table), replace(OF_TABLE, in_cut=cut))
    assert len(found.lives[0].windows) == 4  # 80 rows
    assert found.lives[0].windows.values.min() == 100.0


def test_no_window_reaches_over_a_gap(tmp_path: Path) -> None:
    table = experiments().drop(index=range(45, 60))
    found = read_lives(table_signals(tmp_path, table), OF_TABLE)
    jumps = np.abs(np.diff(found.lives[0].windows.values[:, 0], axis=1))
    assert jumps.max() == pytest.approx(1.0)  # the force grows by 1 N a row
    assert len(found.lives[0].windows) == 2 + 7  # of 45 and of 140 rows


def test_classes_are_words_and_other_words_are_named(tmp_path: Path) -> None:
    worn = WearSource(name="phase", worn=("Layer 1 Up",), unworn=("Repositioning",))
    signals = table_signals(tmp_path, experiments())
    life = read_lives(signals, replace(OF_TABLE, wear=worn)).lives[0].windows
    assert life.is_class
    assert life.wear.tolist() == [1.0] * 5 + [0.0] * 5
    other = WearSource(name="phase", worn=("Layer 1 Up",), unworn=("fresh",))
    left = read_lives(signals, replace(OF_TABLE, wear=other)).left_out
    assert "'Repositioning', neither Layer 1 Up nor fresh" in left["all.parquet#experiment=a"]


def test_recordings_without_use_are_said(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=1, cuts=2)
    first = "wear/T0_000.parquet"
    for changes, reason in (
        ({"length": 500}, "no stretch in cut lasts 0.5 s"),
        ({"channels": {"torque": Channel(column="torque")}}, "no channel 'torque'"),
        ({"table": ConditionTable(file="wear/lives.csv", key="file", name=r"T(\d)")}, "no row"),
    ):
        assert reason in read_lives(signals, wear_records(**changes)).left_out[first]
    with pytest.raises(ValueError, match="not among the records"):
        read_lives(signals, wear_records(table=ConditionTable(file="a.csv", key="file")))


def test_unknown_wear_is_read_where_it_is_to_be_estimated(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=1, cuts=2, blank=[(0, 1)])
    found = read_lives(signals, wear_records(table=None), known=False)
    windows = joined(found)
    assert np.isnan(windows.wear).all()
    assert np.isnan(windows.conditions["feed"]).all()
    assert set(windows.tool) == {"wear/T0_000.parquet", "wear/T0_001.parquet"}


def test_most_windows_are_spread_evenly(tmp_path: Path) -> None:
    found = read_lives(signals_of(tmp_path, tools=1, cuts=1, rows=1000), wear_records(most=3))
    np.testing.assert_allclose(found.lives[0].windows.time, [0.0, 0.4, 0.9], atol=0.101)
    assert len(found.lives[0].windows) == 3


def test_scaling_is_robust() -> None:
    random = np.random.default_rng(0)
    values = (5.0 + 2.0 * random.standard_normal((50, 2, 100))).astype(np.float32)
    values[0, 0] = 1e4  # 2 % of the channel gone wild
    values[:, 1] = 3.0
    scaling = ChannelScaling.of(values)
    assert scaling.shift[0] == pytest.approx(5.0, abs=0.1)
    assert scaling.scale == pytest.approx((2.0, 1.0), rel=0.05)
    assert scaling.scaled(values)[1:, 0].std() == pytest.approx(1.0, rel=0.05)


def test_a_copied_window_has_the_same_hash(tmp_path: Path) -> None:
    windows = joined(read_lives(signals_of(tmp_path, tools=2, cuts=1), wear_records()))
    hashes = windows.sha256s()
    assert len(set(hashes)) == len(windows)
    assert windows.of(slice(0, 1)).sha256s() == hashes[:1]


def test_settings_that_do_not_fit_are_refused() -> None:
    for changes, words in (
        ({"channels": {}}, "channels is empty"),
        ({"progress": "length"}, "'length' is none of"),
        ({"discrete": ("feed",)}, "'feed' is both"),
        ({"rate_Hz": 0.0}, "rate_Hz = 0.0 must be finite and positive"),
    ):
        with pytest.raises(ValueError, match=words):
            wear_records(**changes)
    with pytest.raises(ValueError, match="one class only"):
        WearSource(name="x", worn=("worn",))
    with pytest.raises(ValueError, match="cannot become"):
        WearSource(name="x", unit="N")
    with pytest.raises(ValueError, match="do not fit channel"):
        InCut(channel=Channel(column="force"), values=("a",))
