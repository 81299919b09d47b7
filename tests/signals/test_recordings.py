"""Recordings of sub-models: real files through the ingest, and made ones with what can be wrong."""

import hashlib
import json
import os
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from cattrs import structure
from recorder_tables import layout

from pipeline.report.records import FileRead
from pipeline.schema.identity import MachineIdentity
from pipeline.signals.conditions import Condition, ConditionSources
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.signals.recordings import (
    QUANTITIES,
    Channel,
    read_recordings,
)
from pipeline.signals.units import conversion
from pipeline.signals.windows import uniform_segments

CONF = Path(__file__).parents[2] / "conf" / "machine"
DATA = Path(os.environ.get("KERF_RECORDINGS", "/nowhere"))
real = pytest.mark.skipif(not DATA.exists(), reason="KERF_RECORDINGS names no folder of recordings")

T = np.arange(40) * 0.01
FORCE = Channel(column="F", quantity="force")


def column(values, unit=None):
    return values, unit


def records(folder, tables, runs=None):
    """A machine's folder as the ingest writes it; ``tables`` by the names of their raw files."""
    (folder / "traces").mkdir(parents=True)
    files = {}
    for name, columns in tables.items():
        if columns is None:
            files[name] = {"sha256": name, "output": None, "reason": "it is no file of ours"}
            continue
        arrays = {key: pa.array(values) for key, (values, _) in columns.items()}
        fields = [
            pa.field(key, array.type, metadata={"unit": columns[key][1]} if columns[key][1] else {})
            for key, array in arrays.items()
        ]
        table = pa.table(list(arrays.values()), schema=pa.schema(fields))
        pq.write_table(table, folder / "traces" / f"{name}.parquet")
        files[name] = {
            "sha256": hashlib.sha256(repr(columns).encode()).hexdigest(),
            "output": f"traces/{name}.parquet", "rows": table.num_rows, "first": None,
            "notes": {"constants": {"gain": 2.0}}, "reason": None,
        }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps({"files": files}))
    if runs is not None:
        pq.write_table(runs, folder / "runs.parquet")
    return folder


def one(folder, channels, **columns):
    (recording,) = read_recordings(records(folder, {"a.csv": columns}), channels)
    return recording.load()


def ingested(tmp_path, machine, few="*"):
    described = yaml.safe_load((CONF / f"{machine}.yaml").read_text())
    sources = [structure(source, RecordSource) for source in described["records"]]
    (tmp_path / "raw").mkdir()
    for path in (DATA / machine).glob(few):
        (tmp_path / "raw" / path.name).symlink_to(path)
    ingest(tmp_path / "raw", tmp_path / "out", sources, MachineIdentity(name=machine))
    return tmp_path / "out"


@real
def test_a_benchmark_drive_in_si_with_its_constants(tmp_path):
    import scipy.io

    channels = {
        "position": Channel(column="x_position", quantity="position"),
        "reversed": Channel(column="x_position", quantity="position", factor=-1),
        "command": Channel(column="x_voltage", quantity="voltage"),
        "load": Channel(column="[Pp]ulses*", quantity="force", unit="N"),
    }
    (emps,) = read_recordings(ingested(tmp_path, "emps"), channels, patterns=["*.mat"])
    raw = DATA / "emps" / "DATA_EMPS.mat"
    assert emps.sha256 == hashlib.sha256(raw.read_bytes()).hexdigest()
    assert emps.constants["gtau"] == pytest.approx(35.15, abs=0.01)  # published, N/V
    samples, data = emps.load(), scipy.io.loadmat(raw)
    np.testing.assert_allclose(samples.channels["position"], data["qm"].ravel(), rtol=1e-12)
    np.testing.assert_array_equal(samples.channels["reversed"], -samples.channels["position"])
    np.testing.assert_allclose(samples.channels["command"], data["vir"].ravel(), rtol=1e-12)
    assert samples.units == {"position": "m", "reversed": "m", "command": "V"}
    assert "'[Pp]ulses*'" in samples.lacking["load"]  # the other recording of the benchmark has it
    (segment,) = uniform_segments(samples.time[samples.complete()])
    assert segment.period == pytest.approx(1e-3) and not segment.filled.any()


@real
def test_a_mill_at_ten_samples_a_second_with_phases_in_words(tmp_path):
    channels = {
        "velocity": Channel(column="x_velocity", quantity="velocity"),
        "phase": Channel(column="process", quantity="words"),
    }
    folder = ingested(tmp_path, "umich_mill", few="experiment_0[1-3].csv")
    found = read_recordings(folder, channels, patterns=["experiment_*.csv"])
    assert [r.name for r in found] == [f"experiment_0{k}.csv" for k in (1, 2, 3)]
    samples = found[0].load()
    assert len(samples.time) == found[0].rows and samples.time[1] == pytest.approx(0.1)
    assert "Prep" in set(samples.words["phase"]) and samples.units["velocity"] == "m/s"


@real
def test_slots_on_a_dynamometer_with_conditions_in_their_names(tmp_path):
    described = yaml.safe_load((CONF / "kistler_slot.yaml").read_text())["cutting_records"]
    sources = ConditionSources(
        name=described["name"],
        everywhere=described["conditions"],
        units={"speed_rpm": "rpm", "feed_mm_min": "mm/min", "axial_depth_mm": "mm",
               "radial_depth_mm": "mm", "immersion": None},
    )  # fmt: skip
    channels = {axis: Channel(column=f"force_{axis}", quantity="force") for axis in "xyz"}
    found = read_recordings(
        ingested(tmp_path, "kistler_slot"), channels, patterns=["*.csv"], conditions=sources
    )
    assert len(found) == 2
    slot = next(one for one in found if one.name == "6-n6000f600ap3ae25.csv")
    assert slot.conditions["speed_rpm"].to("rad/s") == pytest.approx(6000 * 2 * pi / 60)
    assert slot.conditions["feed_mm_min"].to("m/s") == pytest.approx(0.01)
    assert slot.conditions["immersion"].value == "slot"
    samples = slot.load()
    segment = max(uniform_segments(samples.time), key=lambda one: one.samples)
    assert 0 < segment.period < 1e-3
    assert np.ptp(samples.channels["x"][samples.complete("xyz")]) > 50


def test_units_are_converted_to_si_and_the_declared_one_stands_in(tmp_path):
    samples = one(
        tmp_path,
        {
            "force": FORCE,
            "bare": Channel(column="G", quantity="force", unit="kN"),
            "temperature": Channel(column="K", quantity="temperature"),
            "emission": Channel(column="AE", quantity="acoustic_emission", unit="mV"),
            "command": Channel(column="C"),
        },
        t=column(T), F=column(T, "kN"), G=column(T), K=column(T, "CELSIUS"), AE=column(T, "V"),
        C=column(T, "PERCENT"),
    )  # fmt: skip
    values = samples.channels
    np.testing.assert_allclose(values["force"], 1000 * T)
    np.testing.assert_allclose(values["bare"], 1000 * T)
    np.testing.assert_allclose(values["temperature"], T + 273.15)
    np.testing.assert_allclose(values["emission"], 1000 * T)
    np.testing.assert_array_equal(values["command"], T)
    assert samples.units == {
        "force": "N", "bare": "N", "temperature": "K", "emission": "mV", "command": "PERCENT",
    }  # fmt: skip


def test_what_is_lacking_is_said_and_the_rest_is_there(tmp_path):
    channels = {
        "force": FORCE,
        "missing": Channel(column="H", quantity="force", remedy="record the dynamometer"),
        "wrong": Channel(column="L", quantity="force"),
        "unitless": Channel(column="U", quantity="force"),
        "text": Channel(column="W", quantity="force"),
        "empty": Channel(column="E", quantity="force"),
    }
    samples = one(
        tmp_path, channels, t=column(T), F=column(T, "N"), L=column(T, "mm"), U=column(T),
        W=column(["on"] * 40), E=column(np.full(40, np.inf), "N"),
    )  # fmt: skip
    assert list(samples.channels) == ["force"]
    assert samples.lacking["missing"] == "it has no channel 'H': record the dynamometer"
    assert "'L' is in mm" in samples.lacking["wrong"]
    assert "'U' is in no unit" in samples.lacking["unitless"]
    assert "'W' holds words" in samples.lacking["text"]
    assert "'E' holds no value" in samples.lacking["empty"]


def test_rows_without_a_value_are_nan_and_not_complete(tmp_path):
    force = T.copy()
    force[3] = np.nan
    other: list[float | None] = [None, *T[1:]]
    samples = one(
        tmp_path,
        {"force": FORCE, "other": Channel(column="G", quantity="force")},
        t=column(T), F=column(force, "N"), G=column(other, "N"),
    )  # fmt: skip
    assert np.flatnonzero(~samples.complete()).tolist() == [0, 3]
    assert np.flatnonzero(~samples.complete(["force"])).tolist() == [3]


def test_a_recording_of_two_clocks_is_timed_by_the_one_that_counts_from_its_start(tmp_path):
    stamps = (1_700_000_000_000_000_000 + np.arange(40) * 20_000_000).astype("datetime64[ns]")
    samples = one(
        tmp_path / "both", {"force": FORCE}, t=column(T), time=column(stamps), F=column(T, "N")
    )
    np.testing.assert_array_equal(samples.time, T)
    samples = one(tmp_path / "utc", {"force": FORCE}, time=column(stamps), F=column(T, "N"))
    np.testing.assert_allclose(samples.time, 2 * T, atol=1e-12)
    samples = one(tmp_path / "none", {"force": FORCE}, F=column(T, "N"))
    assert "it has no time" in samples.lacking["force"]


def test_an_empty_file_and_one_that_vanished_lose_no_other(tmp_path):
    good = {"t": column(T), "F": column(T, "N")}
    empty = {"t": column(np.zeros(0)), "F": column(np.zeros(0), "N")}
    folder = records(
        tmp_path, {"a": good, "b": empty, "c": {**good, "G": column(T)}, "d": None, "e": {
            **good, "H": column(T)}},
    )  # fmt: skip
    (folder / "traces" / "c.parquet").unlink()
    (folder / "traces" / "e.parquet").write_bytes(b"PAR1 cut off")
    found = read_recordings(folder, {"force": FORCE})
    lacking = [recording.load().lacking.get("force", "") for recording in found]
    assert lacking == [
        "",
        "it has no rows: record it again",
        "traces/c.parquet cannot be read: run `dvc repro`",
        "it is no file of ours",
        "traces/e.parquet cannot be read: run `dvc repro`",
    ]


def test_of_copies_the_preferred_one_is_kept(tmp_path):
    good = {"t": column(T), "F": column(T, "N")}
    folder = records(tmp_path, {"a": good, "b": good, "c": {**good, "G": column(T)}})
    found = read_recordings(folder, {"force": FORCE}, preferred=lambda name: name == "b")
    assert [one.reason for one in found] == ["it is a copy of b: record another", "", ""]
    assert found[0].load().lacking == {"force": "it is a copy of b: record another"}
    found = read_recordings(folder, {}, patterns=["[bc]"])
    assert [one.name for one in found] == ["b", "c"] and found[0].constants == {"gain": 2.0}


def test_a_channel_is_read_only_when_it_is_named(tmp_path):
    (recording,) = read_recordings(
        records(tmp_path, {"a": {"t": column(T), "F": column(T, "N")}}),
        {"force": FORCE, "other": replace(FORCE, column="G")},
    )
    assert list(recording.load(["force"]).channels) == ["force"]
    assert recording.load(["force"]).lacking == {}
    with pytest.raises(ValueError, match="'torque' is not declared: declare it, or use one of fo"):
        recording.load(["torque"])


def test_conditions_come_from_runs_patterns_and_names(tmp_path):
    good = {"t": column(T), "F": column(T, "N")}
    fields = [
        pa.field("file", pa.string()), pa.field("rows", pa.int64()), pa.field("tool", pa.string()),
        pa.field("wear", pa.float64(), metadata={"unit": "mm"}),
    ]  # fmt: skip
    runs = pa.table([["w_f0.1.csv"], [40], ["T5"], [0.12]], schema=pa.schema(fields))
    folder = records(tmp_path, {"w_f0.1.csv": good, "w_f0.2.csv": {**good, "G": column(T)}}, runs)
    sources = ConditionSources(
        everywhere={"speed": 3000.0},
        by_pattern={"*f0.2*": {"feed": 0.25}},
        name=r"f(?P<feed>[\d.]+)",
        units={"speed": "1/min", "feed": "mm"},
    )
    first, second = read_recordings(folder, {"force": FORCE}, conditions=sources)
    assert first.conditions == {
        "speed": Condition(value=3000.0, unit="1/min", source="recordings.conditions"),
        "tool": Condition(value="T5", source="runs.parquet"),
        "wear": Condition(value=0.12, unit="mm", source="runs.parquet"),
        "feed": Condition(value=0.1, unit="mm", source="its name"),
    }
    assert first.conditions["wear"].to("um") == pytest.approx(120)
    with pytest.raises(ValueError, match="'T5' is a word"):
        first.conditions["tool"].to("m")
    assert second.reason == (
        "its feed is 0.25 by recordings.by_pattern, '*f0.2*' and 0.2 by its name: "
        "correct one of them"
    )
    assert len(second.load().channels["force"]) == 40


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (ConditionSources(name="("), "is no regular expression"),
        (ConditionSources(name="(?P<a>.)", units={"b": "mm"}), "has the group 'a'"),
        (ConditionSources(name="(?P<a>x)", units={"a": "mm"}), "a = 'x', which is no number"),
    ],
)
def test_a_wrong_expression_is_the_reason(tmp_path, sources, message):
    folder = records(tmp_path, {"x": {"t": column(T), "F": column(T, "N")}})
    (found,) = read_recordings(folder, {"force": FORCE}, conditions=sources)
    assert message in found.reason


def test_settings_that_are_wrong_for_all_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"manifest.json cannot be read: run `dvc repro`"):
        read_recordings(tmp_path / "nothing", {})
    folder = records(tmp_path / "some", {"a.csv": {"t": column(T)}})
    with pytest.raises(ValueError, match=r"fits drive_records.recordings = '\*.mat'"):
        read_recordings(folder, {}, patterns=["*.mat"], section="drive_records.recordings")
    with pytest.raises(ValueError, match=r"'F': quantity 'loudness' is none of .* name its unit"):
        Channel(column="F", quantity="loudness")
    with pytest.raises(ValueError, match="channel 'F': unit 'MILLIMETER' cannot become"):
        replace(FORCE, unit="mm")
    with pytest.raises(ValueError, match="factor = inf must be finite"):
        replace(FORCE, factor=float("inf"))
    with pytest.raises(ValueError, match="factor = 0 leaves nothing"):
        replace(FORCE, factor=0.0)


def test_channels_are_declared_in_a_machines_file():
    text = "spindle_growth: {column: probe_1, quantity: displacement, unit: um, factor: -1.0}"
    (channel,) = structure(yaml.safe_load(text), dict[str, Channel]).values()
    assert channel.si_unit == "m" and conversion(channel.unit, channel.si_unit)[0] == 1e-6


@pytest.mark.parametrize(
    ("quantity", "unit", "factor"),
    [("ratio", "PERCENT", 0.01), ("flow", "LITER/SECOND", 1e-3), ("angle", "DEGREE", pi / 180),
     ("angular_velocity", "REVOLUTION/MINUTE", 2 * pi / 60), ("torque", "NEWTON_METER", 1.0),
     ("frequency", "HERTZ", 1.0), ("strain", "µε", 1e-6), ("pressure", "bar", 1e5)],
)  # fmt: skip
def test_quantities_have_si_units(quantity, unit, factor):
    assert conversion(unit, QUANTITIES[quantity])[0] == pytest.approx(factor, rel=1e-14)


FAULTY_ROWS = 2000
DISPLACEMENTS = layout(
    {"x_position": ("x", "mm"), "growth": ("g", "um"), "planned_speed": ("n", "rev/min")}, time="t"
)


def faulty(tmp_path, change, rows=FAULTY_ROWS):
    """A recording of 500 Hz with a position, a probe and a plan, changed, after its ingest."""
    rng, t = np.random.default_rng(0), np.arange(rows) * 2e-3
    columns = {
        "t": t, "x": 50 * np.sin(3 * t) + rng.normal(0, 1e-3, rows),
        "g": 10 * t + rng.normal(0, 0.1, rows), "n": np.round(3000 + 100 * t),
    }  # fmt: skip
    change(columns)
    raw = tmp_path / "raw"
    raw.mkdir()
    pd.DataFrame(columns).to_csv(raw / "a.csv", index=False)
    source = RecordSource(format="csv", files="*.csv", table=DISPLACEMENTS)
    ingest(raw, tmp_path / "out", [source], MachineIdentity(name="m"))
    channels = {
        "x": Channel(column="x_position", quantity="position"),
        "g": Channel(column="growth", quantity="displacement"),
        "n": Channel(column="planned_speed", quantity="angular_velocity"),
    }
    return read_recordings(tmp_path / "out", channels)[0]


def test_a_jump_that_no_axis_makes_is_named_and_its_far_side_not_read(tmp_path):
    def jump(columns):
        columns["x"][1500:] += 45.0

    found = faulty(tmp_path, jump)
    assert found.notes == ("x_position jumps by 44.73 mm in 2 ms at 2.998 s",)
    missing = np.flatnonzero(np.isnan(found.load().channels["x"]))
    assert missing.tolist() == list(range(1497, FAULTY_ROWS))
    assert np.isfinite(found.load().channels["g"]).all()


def test_a_reading_that_is_gone_for_some_rows_is_not_read_there(tmp_path):
    def spike(columns):
        columns["x"][700:703] = 1e4

    samples = faulty(tmp_path, spike).load()
    assert np.flatnonzero(np.isnan(samples.channels["x"])).tolist() == list(range(697, 706))


def test_a_frozen_probe_an_early_end_and_repeated_stamps_are_named(tmp_path):
    def wrong(columns):
        columns["g"][1200:] = columns["g"][1200]
        columns["n"][1600:] = np.nan
        columns["t"][[100, 200]] = columns["t"][[99, 199]]

    found = faulty(tmp_path, wrong)
    probe, plan = found.notes
    assert probe.startswith("growth holds") and probe.endswith("from 2.4 s to the end")
    assert plan == "planned_speed ends at 3.198 s, the recording goes on to 3.998 s"
    notes = json.loads((tmp_path / "out" / "manifest.json").read_text())["files"]["a.csv"]["notes"]
    assert notes["repeated_stamps"] == {"count": 2, "lines": [102, 202]}
    read = FileRead(notes=notes)
    assert read.faults == ["2 rows repeat the time stamp before them", *found.notes]
    assert FileRead(notes={"ends_early": "it is cut"}).faults == ["it is cut"]


def test_quick_noise_strokes_and_standing_axes_are_no_faults(tmp_path):
    def fair(columns):
        columns["x"][:] = np.round(np.clip(50 * np.sin(columns["t"] * 8), -40, 40), 3)
        columns["x"][1500:] = columns["x"][1500]
        columns["g"][:] += np.random.default_rng(1).normal(0, 5e4, FAULTY_ROWS)  # 50 mm

    assert faulty(tmp_path, fair).notes == ()


def test_a_distance_to_go_that_jumps_at_each_block_is_no_fault(tmp_path):
    def blocks(columns):
        columns["x"][:] = 80.0 - 80.0 * (columns["t"] / 0.5 % 1.0)

    assert faulty(tmp_path, blocks).notes == ()
