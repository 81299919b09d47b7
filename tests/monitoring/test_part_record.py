"""As-built records of a log of two programs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from pipeline.monitoring.part_record import part_records
from pipeline.schema.bundle import Champion
from pipeline.schema.part_record import PartRecord
from pipeline.schema.program_cut import SimulatedProgram
from pipeline.schema.store import read_json, write_json, write_table
from pipeline.schema.twin_state import MANIFEST, StateDay, TwinState, day_path, read_day, write_day

M, DAY, ZONE = "mill", "2026-01-05", "Europe/Berlin"


def at(second: float) -> pd.Timestamp:
    return pd.Timestamp(DAY, tz=ZONE) + pd.Timedelta(seconds=second)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A day of 600 rows: O1 from 100 to 200, O1 from 300 to 420, O2 that is broken off."""
    clean, state = tmp_path / "clean" / M, tmp_path / "twin_state" / M
    time = pd.date_range(at(0), periods=600, freq="s").as_unit("ns")
    k = np.arange(600)
    load = np.where((k >= 350) & (k < 400), 80.0, 5.0)
    table = pa.table({
        "time": pa.array(time.asi8, pa.timestamp("ns", ZONE)), "spindle_load": load,
        "tool_number": np.where(k < 350, "3", "4"), "line": np.where(k < 150, 10.0, 20.0),
        "spindle_temperature": 20 + k / 100,
    })  # fmt: skip
    fields = [f.with_metadata({"unit": "PERCENT"}) if f.name == "spindle_load" else f
              for f in table.schema]  # fmt: skip
    write_table(table.cast(pa.schema(fields)), clean / "state" / f"{DAY}.parquet")
    utc = [at(s).tz_convert("UTC") for s in (100, 200, 300, 420, 500, 560)]
    cycles = pd.DataFrame({
        "cycle": [1, 2, 3], "program": ["O1", "O1", "O2"], "part": ["7", "8", None],
        "start": utc[::2], "end": utc[1::2], "active_s": [100.0, 120.0, 60.0],
        "feed_hold_s": 0.0, "interrupted_s": 0.0, "idle_s": 0.0, "tool_changes": 0,
        "complete": [True, True, False],
    })  # fmt: skip
    cycles.to_parquet(clean / "cycles.parquet")
    pd.DataFrame({
        "data_item": ["a", "a"], "level": ["fault", "warning"], "code": ["53", "54"],
        "message": "", "start": [utc[2], at(40).tz_convert("UTC")],
        "end": [pd.NaT, at(130).tz_convert("UTC")], "ended": "",
        "program": "O1", "line": [np.nan, 10.0],
    }).to_parquet(clean / "alarms.parquet")  # fmt: skip
    cut = load > 50
    write_day(time, {
        "mode": np.where(cut, "cut", "air"), "spindle_load": load,
        "spindle_temperature_measured": 20 + k / 100,
        "spindle_temperature_estimated": 20 + k / 100 - 0.5,
        "spindle_temperature_low": 19 + k / 100,
        "spindle_temperature_high": np.where(k < 360, 21 + k / 100, 19.8 + k / 100),
        "tangential_force_estimated": np.where(cut, 900.0, np.nan),
        "tangential_force_low": np.where(cut, 800.0, np.nan),
        "tangential_force_high": np.where(cut, 1000.0, np.nan),
    }, day_path(state, DAY))  # fmt: skip
    of_day = StateDay(role="held_out", seconds=600.0, known_s={},
                      unknown={"no_load_power": "no drive of the spindle"})  # fmt: skip
    write_json(TwinState(bundle="b" * 64, submodels={"spindle": "passed"}, period_s=1.0,
                         days={DAY: of_day}), state / MANIFEST)  # fmt: skip
    write_json(SimulatedProgram(program="O1", file="programs/O1.nc", sha256="c" * 64,
                                total_time_s=118.0, total_time_90_s=(110.0, 126.0)),
               tmp_path / "programs" / M / "O1.json")  # fmt: skip
    return tmp_path


CHAMPION = Champion(version=4, bundle="b" * 64, since="", by="", why="")


def records(data: Path, **wanted: str) -> list[PartRecord]:
    return list(part_records(M, "recorded", data, champion=CHAMPION, **wanted))


def test_a_part_is_a_complete_cycle_with_its_tools_loads_and_alarms(data: Path) -> None:
    first, second = records(data)
    assert (first.part, second.part, second.version) == ("7", "8", 4)
    assert second.start == "2026-01-05T00:05:00+01:00"  # at the plant
    assert (second.usual_s, second.usual_cycles) == (100.0, 1)
    assert [(t.tool, t.in_spindle_s, t.cutting_s) for t in second.tools] == [
        ("3", 50.0, 0.0), ("4", 70.0, 50.0),
    ]  # fmt: skip
    load = second.measured["spindle_load"]
    assert (load.unit, load.greatest, load.known_s) == ("PERCENT", 80.0, 120.0)
    assert [(a.code, a.seconds) for a in first.alarms] == [("54", 30.0)], "its time in the cycle"
    assert [(a.code, a.seconds) for a in second.alarms] == [("53", None)]
    assert [(b.line, b.seconds) for b in first.blocks] == [(10, 50.0), (20, 50.0)]


def test_the_twin_stands_beside_what_was_measured_and_what_is_not_known_has_its_reason(
    data: Path,
) -> None:
    first, second = records(data)
    force, heat = second.twin["tangential_force"], second.twin["spindle_temperature"]
    assert (force.estimated, force.low, force.known_s, force.measured) == (900.0, 800.0, 50.0, None)
    assert heat.outside == pytest.approx(0.5)  # 60 of 120 rows
    assert heat.measured == pytest.approx(heat.estimated + 0.5, abs=1e-4)
    assert second.programs[0].predicted_90_s == (110.0, 126.0)
    assert first.not_known["tangential_force"] == "known nowhere in this cycle"
    assert first.not_known["no_load_power"] == "no drive of the spindle"
    assert json.loads(json.dumps(second.sources))  # three files with hashes
    assert len(second.sources) == 3


def test_the_load_of_a_run_up_is_not_the_greatest_and_a_missing_interval_has_its_reason(
    data: Path,
) -> None:
    path, state = day_path(data / "twin_state" / M, DAY), data / "twin_state" / M / MANIFEST
    table = read_day(data / "twin_state" / M, DAY).to_pandas().set_index("time")
    values = {name: table[name].to_numpy() for name in table}
    steady = (np.arange(600) < 350) | (np.arange(600) >= 400)
    values |= {"spindle_steady": steady, "spindle_speed": np.full(600, 3000.0)}
    values["spindle_temperature_low"] = values["spindle_temperature_high"] = np.full(600, np.nan)
    write_day(pd.DatetimeIndex(table.index), values, path)
    twin = replace(read_json(state, TwinState), temperature_interval_unknown="one training day")
    write_json(twin, state)
    found = records(data)[1]
    load = found.measured["spindle_load"]
    assert (load.greatest, load.known_s) == (5.0, 70.0), "80 % are those of a run-up"
    assert found.twin["spindle_temperature"].low is None
    assert found.not_known["spindle_temperature_interval"] == "one training day"
    assert "spindle_load" not in found.not_known


def test_time_in_the_cut_is_not_known_without_a_state_of_the_twin(data: Path) -> None:
    day_path(data / "twin_state" / M, DAY).unlink()
    (data / "twin_state" / M / MANIFEST).unlink()
    found = records(data)[1]
    assert {t.cutting_s for t in found.tools} == {None}
    assert "no state of the twin" in found.not_known["tangential_force"]
    assert "run-ups count too" in found.not_known["spindle_load"]
    assert (found.bundle, found.version) == ("", None)


def test_no_part_and_no_log_are_a_sentence(data: Path) -> None:
    assert [one.part for one in records(data, first=DAY, program="O1")] == ["7", "8"]
    with pytest.raises(ValueError, match="no complete cycle of program O2"):
        records(data, program="O2")
    with pytest.raises(ValueError, match="from 2026-01-06 to its end"):
        records(data, first="2026-01-06")
    with pytest.raises(ValueError, match="no log of its programs"):
        list(part_records("none", "recorded", data))
