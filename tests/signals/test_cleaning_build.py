import json
from dataclasses import asdict

import cattrs
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cleaning_records import day_rows, nanoseconds, read, record

from pipeline.signals.cleaning.clean import clean
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings, PositionControl
from pipeline.signals.contracts import check

MACHINE = CleanMachine(
    signals={
        "execution": "exec",
        "controller_mode": "mode",
        "program": "prog",
        "spindle_temperature": "temp",
        "total_time": "clock",
    }
)
DAYS = ["2024-03-04T08:00:00", "2024-03-05T08:00:00", "2024-03-06T08:00:00"]


def dirty(seconds=range(0, 900)):
    """A day with zeros, a wild counter, a burst of UNAVAILABLE and two cycles."""
    rows = day_rows(seconds)
    rows += [(t + 0.5, "temp", 0.0) for t in range(100, 160, 2)]
    rows += [(300.5, "clock", 9e9)]
    rows += [(400.5, item, None) for item in ("exec", "mode", "prog", "temp", "clock")]
    rows = [r for r in rows if not 400.5 < r[0] < 430]
    rows += [(430, "exec", "READY"), (430, "mode", "AUTOMATIC"), (430, "prog", "O1")]
    for start in (200, 500):
        rows += [(start, "exec", "ACTIVE"), (start + 60, "exec", "READY")]
    return sorted(rows, key=lambda r: r[0])


@pytest.fixture
def signals(tmp_path):
    folder = tmp_path / "signals"
    for day in DAYS[:2]:
        record(folder, day[:10], dirty(), day)
    return folder


def trace(folder, time, **channels):
    """One recording with ``time`` [ns]."""
    path = folder / "traces" / "1.parquet"
    path.parent.mkdir(parents=True)
    moments = pa.array(time).cast(pa.timestamp("ns", tz="UTC"))
    pq.write_table(pa.table({"time": moments, **channels}), path)


def contents(out):
    """Everything in a clean folder: tables as tables, the summary as it stands."""
    found = {p.relative_to(out).as_posix(): pq.read_table(p) for p in out.rglob("*.parquet")}
    return found, json.loads((out / "summary.json").read_text())


def same(a, b):
    (tables_a, summary_a), (tables_b, summary_b) = contents(a), contents(b)
    assert tables_a.keys() == tables_b.keys()
    for name, table in tables_a.items():
        assert table.equals(tables_b[name], check_metadata=True), name
    assert summary_a == summary_b


def test_a_build_leaves_the_tables_of_the_contract(signals, tmp_path):
    out = tmp_path / "clean"
    clean(signals, out, machine=MACHINE)
    for name in ("cycles", "segments", "gaps", "audit", "alarms"):
        check(name, read(out / f"{name}.parquet"))
    for path in sorted((out / "state").glob("*.parquet")):
        check("state", read(path))
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    tables = {f"{n}.parquet" for n in ("cycles", "segments", "gaps", "audit", "alarms")}
    assert names == tables | {"summary.json", *(f"state/{d[:10]}.parquet" for d in DAYS[:2])}


def test_the_state_table_carries_units_and_covers_the_time_the_machine_was_on(signals, tmp_path):
    clean(signals, tmp_path / "clean", machine=MACHINE)
    table = pq.read_table(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    assert table.schema.field("spindle_temperature").metadata == {b"unit": b"CELSIUS"}
    time = table["time"].cast("int64").to_numpy()
    assert (np.diff(time) == 1_000_000_000).all()
    assert time[0] == nanoseconds(DAYS[0])
    assert len(time) == 900
    frame = table.to_pandas()
    assert set(frame["spindle_temperature"].dropna()) == {25.0}
    lost = frame["execution"].isna().to_numpy()
    assert np.flatnonzero(lost).tolist() == list(range(401, 430))


def test_each_removed_value_is_one_audit_row(signals, tmp_path):
    summary = clean(signals, tmp_path / "clean", machine=MACHINE)
    audit = read(tmp_path / "clean" / "audit.parquet")
    assert audit["rule"].value_counts().to_dict() == {"zero": 60, "counter": 2}
    assert audit["after"].isna().all()
    assert set(audit.loc[audit["rule"] == "counter", "before"]) == {"9000000000"}
    assert summary["total"]["removed"] == {"counter": 2, "zero": 60}


def test_a_speed_beyond_the_machine_is_removed_and_counted(tmp_path):
    """-1 read as a word of sixteen bits is a number that some spindle could have, not this one."""
    rows = [(k, "S", 65535 if k in (3, 4) else 8000) for k in range(10)]
    record(tmp_path / "signals", "a", rows, "2024-03-04T08:00:00")
    reach = CleanMachine(signals={"spindle_speed": "S"}, highest={"spindle_speed": 14400})
    summary = clean(tmp_path / "signals", tmp_path / "clean", machine=reach)
    assert summary["total"]["removed"] == {"out_of_range": 2}
    assert read(tmp_path / "clean/state/2024-03-04.parquet")["spindle_speed"].max() == 8000
    with pytest.raises(ValueError, match="highest of 'program' in the machine's mapping"):
        CleanMachine(highest={"program": 1})


def test_cycles_and_seconds_in_states(signals, tmp_path):
    summary = clean(signals, tmp_path / "clean", machine=MACHINE)
    found = read(tmp_path / "clean" / "cycles.parquet")
    assert found["active_s"].tolist() == [60.0] * 4
    assert found["complete"].all()
    day = summary["days"]["2024-03-05"]["execution_s"]
    assert day["ACTIVE"] == 120
    assert sum(day.values()) == 86_400


def test_a_new_day_leaves_the_days_before_alone_and_equals_a_build_from_nothing(signals, tmp_path):
    grown, whole = tmp_path / "grown", tmp_path / "whole"
    first = clean(signals, grown, machine=MACHINE)
    assert first["written"] == ["2024-03-04", "2024-03-05"]
    before = (grown / "state" / "2024-03-04.parquet").stat().st_mtime_ns
    assert clean(signals, grown, machine=MACHINE)["written"] == []
    record(signals, "2024-03-06", dirty(), DAYS[2])
    assert clean(signals, grown, machine=MACHINE)["written"] == ["2024-03-06"]
    assert (grown / "state" / "2024-03-04.parquet").stat().st_mtime_ns == before
    clean(signals, whole, machine=MACHINE)
    same(grown, whole)


def test_a_changed_file_and_a_removed_file_equal_a_build_from_nothing(signals, tmp_path):
    grown = tmp_path / "grown"
    clean(signals, grown, machine=MACHINE)
    record(signals, "2024-03-04", dirty(range(0, 800)), DAYS[0])
    assert "2024-03-04" in clean(signals, grown, machine=MACHINE)["written"]
    clean(signals, tmp_path / "changed", machine=MACHINE)
    same(grown, tmp_path / "changed")
    (signals / "observations" / "2024-03-04.parquet").unlink()
    clean(signals, grown, machine=MACHINE)
    clean(signals, tmp_path / "removed", machine=MACHINE)
    same(grown, tmp_path / "removed")


def test_changed_settings_write_every_day_again(signals, tmp_path):
    clean(signals, tmp_path / "clean", machine=MACHINE)
    other = CleanSettings(bridge_s=5.0)
    assert len(clean(signals, tmp_path / "clean", machine=MACHINE, settings=other)["written"]) == 2


def test_a_record_that_runs_over_midnight_has_no_seam(tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    rows = dirty()
    record(whole, "all", rows, "2024-03-04T23:50:00")
    record(cut, "1", [r for r in rows if r[0] < 600], "2024-03-04T23:50:00")
    record(cut, "2", [r for r in rows if r[0] >= 600], "2024-03-04T23:50:00")
    clean(whole, tmp_path / "a", machine=MACHINE)
    clean(cut, tmp_path / "b", machine=MACHINE)
    (a, _), (b, _) = contents(tmp_path / "a"), contents(tmp_path / "b")
    assert a.keys() == b.keys()
    assert all(table.equals(b[name]) for name, table in a.items())
    first = a["state/2024-03-05.parquet"].to_pandas().iloc[0]
    assert (first["execution"], first["program"]) == ("READY", "O1")  # said ten minutes before


def test_old_rows_at_a_files_start_restate_and_make_no_cycle(tmp_path):
    folder = tmp_path / "signals"
    record(folder, "1", dirty(), DAYS[0])
    hours = 3600 * 22  # the second file begins 22 hours before its live rows
    old = [(0, "exec", "ACTIVE"), (0, "mode", "AUTOMATIC"), (0, "prog", "O1"), (0, "temp", 25.0),
           (0, "clock", 1.0)]  # fmt: skip
    live = [(hours + t, "clock", float(5000 + t)) for t in range(100)]
    record(folder, "2", old + live, "2024-03-04T10:00:00")
    summary = clean(folder, tmp_path / "clean", machine=MACHINE)
    assert summary["total"]["restated"] == 5
    assert list(summary["days"]) == ["2024-03-04", "2024-03-05"]
    state = read(tmp_path / "clean" / "state" / "2024-03-05.parquet")
    assert len(state) == 100
    assert set(state["execution"]) == {"ACTIVE"}
    found = read(tmp_path / "clean" / "cycles.parquet")
    assert len(found) == 3  # two of the first day, one that is running when the second file begins
    assert found["active_s"].iloc[-1] < 100


def test_duplicates_and_rows_out_of_order_are_counted_and_change_nothing(tmp_path):
    rows = dirty()
    record(tmp_path / "tidy", "1", rows, DAYS[0])
    messy = rows[:50] + [rows[10]] + rows[52:60] + rows[50:52] + rows[60:]
    record(tmp_path / "messy", "1", messy, DAYS[0])
    clean(tmp_path / "tidy", tmp_path / "a", machine=MACHINE)
    total = clean(tmp_path / "messy", tmp_path / "b", machine=MACHINE)["total"]
    assert total["duplicates"] == 1
    assert total["late"] == 2
    (a, _), (b, _) = contents(tmp_path / "a"), contents(tmp_path / "b")
    assert all(table.equals(b[name]) for name, table in a.items())


def test_an_agent_that_began_anew_leaves_a_gap_and_nothing_known(tmp_path):
    folder = tmp_path / "signals"
    rows = day_rows(range(0, 100))
    record(folder, "1", rows, DAYS[0], instance=1)
    later = [(t, "clock", float(1000 + t)) for t in range(105, 200)]
    record(folder, "2", later, DAYS[0], instance=2)
    clean(folder, tmp_path / "clean", machine=MACHINE)
    gaps = read(tmp_path / "clean" / "gaps.parquet")
    assert "instance" in set(gaps["cause"])
    state = read(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    assert state["execution"].iloc[150:].isna().all()
    assert state["total_time"].iloc[150:].notna().all()


def test_units_are_converted_or_refused(tmp_path):
    folder = tmp_path / "signals"
    warm = [(t, i, v * 1.8 + 32 if i == "temp" else v) for t, i, v in day_rows(range(0, 50))]
    record(folder, "1", warm, DAYS[0])
    items = {"data_item": ["temp"], "units": ["FAHRENHEIT"]}
    pd.DataFrame(items).to_parquet(folder / "data_items.parquet")
    clean(folder, tmp_path / "clean", machine=MACHINE)
    state = read(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    np.testing.assert_allclose(state["spindle_temperature"].dropna(), 25.0, atol=1e-9)
    pd.DataFrame(items | {"units": ["PERCENT"]}).to_parquet(folder / "data_items.parquet")
    with pytest.raises(ValueError, match=r"'temp' is in 'PERCENT'.*spindle_temperature.*CELSIUS"):
        clean(folder, tmp_path / "other", machine=MACHINE)


def test_traces_are_cleaned_like_observations(tmp_path):
    n = 20_000
    time = nanoseconds(DAYS[0]) + np.arange(n) * 1_000_000
    trace(tmp_path / "signals", time, x=np.linspace(0, 20, n, endpoint=False))
    machine = CleanMachine(signals={"x_position": "x"})
    clean(tmp_path / "signals", tmp_path / "clean", machine=machine)
    state = read(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    np.testing.assert_allclose(state["x_position"], np.arange(20), atol=1e-9)


def test_a_logger_that_runs_all_night_does_not_switch_the_machine_on(signals, tmp_path):
    machine = CleanMachine(signals={**MACHINE.signals, "ambient_temperature": "air"})
    time = nanoseconds("2024-03-04T00:00:05") + np.arange(0, 3 * 86_400, 10) * 1_000_000_000
    trace(signals, time, air=15 + np.arange(len(time)) / 1000)
    summary = clean(signals, tmp_path / "clean", machine=machine)
    assert [note["seconds"] for note in summary["days"].values()] == [900, 900, 0]
    state = read(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    assert state["ambient_temperature"].notna().all()  # also while the agent reported nothing
    np.testing.assert_allclose(np.diff(state["ambient_temperature"]), 1e-4, atol=1e-9)
    segments = read(tmp_path / "clean" / "segments.parquet")
    assert (segments["kind"] == "off").sum() == 1


@pytest.mark.parametrize(("pause", "again"), [(300, True), (3000, False)], ids=["short", "long"])
def test_after_a_silence_a_value_counts_again_only_if_the_machine_was_not_off(
    tmp_path, pause, again
):
    rows = day_rows(range(0, 600))
    rows += [(t, "clock", float(1000 + t)) for t in range(600 + pause, 800 + pause)]
    record(tmp_path / "signals", "1", rows, DAYS[0])
    summary = clean(tmp_path / "signals", tmp_path / "clean", machine=MACHINE)
    state = read(tmp_path / "clean" / "state" / "2024-03-04.parquet")
    since = (state["time"] - state["time"].iloc[0]).dt.total_seconds()
    inside = (since > 600) & (since < 600 + pause)
    assert inside.sum() == (299 if again else 0)
    assert state.loc[inside].drop(columns="time").isna().all(axis=None)
    assert state.loc[since >= 600 + pause, "execution"].eq("READY").all() == again
    seconds = summary["days"]["2024-03-04"]["execution_s"]
    known = 599.25 + (199 if again else 0)  # up to the last word before, and after
    assert seconds["READY"] == pytest.approx(known, abs=1e-3)
    (gap,) = read(tmp_path / "clean" / "gaps.parquet").to_dict("records")
    assert gap["cause"] == "silence"
    assert pd.isna(gap["data_item"])  # the machine as a whole
    assert (gap["end"] - gap["start"]).total_seconds() == pytest.approx(pause, abs=1)


def test_a_folder_without_records_gives_empty_tables(tmp_path):
    (tmp_path / "signals").mkdir()
    summary = clean(tmp_path / "signals", tmp_path / "clean", machine=MACHINE)
    assert summary["total"]["seconds"] == 0
    assert summary["absent"] == sorted(MACHINE.items)
    for name in ("cycles", "segments", "gaps", "audit", "alarms"):
        assert check(name, read(tmp_path / "clean" / f"{name}.parquet")).empty


def test_settings_come_from_plain_dictionaries_and_refuse_what_is_out_of_range():
    converter = cattrs.Converter(forbid_extra_keys=True)
    machine = converter.structure(
        {"signals": {"spindle_speed": "S"}, "position_control": {"angle": "C", "speed": "S"}},
        CleanMachine,
    )
    assert machine.position_control == PositionControl(angle="C", speed="S")
    assert machine.names == ("spindle_speed", "spindle_position_control")
    assert converter.structure(asdict(CleanSettings()), CleanSettings) == CleanSettings()
    with pytest.raises(ValueError, match=r"settle_s = -1.* s must lie from 1 to 86400"):
        CleanSettings(settle_s=-1.0)
    with pytest.raises(ValueError, match=r"spindle_sped.*spindle_speed"):
        CleanMachine(signals={"spindle_sped": "S"})
    with pytest.raises(ValueError, match="'S' stands for"):
        CleanMachine(signals={"spindle_speed": "S", "spindle_load": "S"})
