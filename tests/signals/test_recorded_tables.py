"""The real recordings, read with the layouts that a machine's file would give."""

import os
from pathlib import Path

import numpy as np
import pytest
from recorder_tables import layout, notes, trace_of, values

from pipeline.signals.tables import arrays, columnar, csv_table

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = pytest.mark.skipif(
    not RECORDINGS, reason="KERF_RECORDINGS names no folder of recordings"
)


def recordings(folder: str, pattern: str) -> list[Path]:
    found = sorted((Path(str(RECORDINGS)) / folder).glob(pattern))
    assert found, f"no {pattern} in {folder}"
    return found


def test_kistler() -> None:
    forces = {"force_x": ("Fx", None), "force_y": ("Fy", None), "force_z": ("Fz", "N")}
    form = layout(forces, time="Time", units_row=True)
    for path in recordings("kistler_slot", "*.csv"):
        result = trace_of(csv_table.read, path, form, "csv")
        data = path.read_text().splitlines()[20:]
        assert result.kept == len(data) and not result.rejected
        first = [float(cell) for cell in data[0].split(",")]
        assert [values(result, n)[0] for n in ("t", "force_x", "force_y", "force_z")] == first


def test_emps() -> None:
    form = layout(
        {"x_position": ("qm", "m"), "x_position_ref": ("qg", "m"), "command": ("vir", "V")},
        time="t",
    )
    (path,) = recordings("emps", "*.mat")
    result = trace_of(arrays.read_mat, path, form, "matlab")
    assert result.kept == 24841
    assert np.median(np.diff(values(result, "t"))) == pytest.approx(1e-3, rel=1e-4)  # 1 kHz
    assert max(values(result, "x_position")) == pytest.approx(230, abs=30)  # its stroke is 0.25 m
    assert notes(result)["constants"]["gtau"] == pytest.approx(35.15, abs=0.01)


def test_umich_mill() -> None:
    signals = {
        "x_position": ("X1_ActualPosition", "mm"), "x_position_ref": ("X1_CommandPosition", "mm"),
        "x_current": ("X1_CurrentFeedback", "A"), "spindle_power": ("S1_OutputPower", "kW"),
        "process": ("Machining_Process", None),
    }  # fmt: skip
    form = layout(signals, rate=10.0, rest=True, text=("process",))
    paths = recordings("umich_mill", "experiment_*.csv")
    for path in paths[::6]:
        result = trace_of(csv_table.read, path, form, "csv")
        assert result.kept == len(path.read_text().splitlines()) - 1
        assert result.table.num_columns == 49  # 48 and the time
        assert values(result, "t")[10] == 1.0
        assert result.table.schema.field("spindle_power").metadata[b"unit"] == b"WATT"


def test_fanuc_millturn() -> None:
    form = layout(
        {"spindle_speed": ("Speed_MainSpindle", "rpm"), "tool_number": ("TOOL_Number", None),
         "x_following_error": ("Psition_ERR_X", "mm"),
         "spindle_current": ("Current_MainSpindle", "")},
        time="Time", time_unit="ms",
    )  # fmt: skip
    (path,) = recordings("fanuc_millturn", "KS*.parquet")
    result = trace_of(columnar.read_parquet, path, form, "parquet")
    assert result.kept == 177_000
    assert values(result, "t")[-1] == 176.999
    form = layout({"spindle_speed": ("speed_main", "rpm"), "x_torque_command": ("tcmd_x", "")},
                  time="index", time_unit="ms", rest=True)  # fmt: skip
    (path,) = recordings("fanuc_millturn", "split*.parquet")
    result = trace_of(columnar.read_parquet, path, form, "parquet")
    assert result.kept == 458_288
    assert result.table.column("x_torque_command").null_count > 0
    assert notes(result)["clock_backwards"]["count"] > 0


def test_uniwear() -> None:
    form = layout(
        {"force_z": ("force_z", "N"), "tool_wear": ("tool_wear", "mm"),
         "experiment": ("experiment_tag", None)},
        time="timestamp", text=("experiment",),
    )  # fmt: skip
    (path,) = recordings("uniwear", "*.parquet")
    result = trace_of(columnar.read_parquet, path, form, "parquet")
    assert result.kept == 35_923
    assert len(set(values(result, "experiment"))) == 10
    assert notes(result)["clock_backwards"]["count"] == 9  # each experiment starts anew


def test_log_without_header() -> None:
    names = ("time", "machine", "code", "event", "a", "b", "c")
    form = layout(
        {"machine": ("machine", None), "event": ("event", None), "code": ("code", ""),
         "detail": ("a", None)},
        text=("machine", "event", "detail"), names=names, time="time", time_unit="iso",
        ragged="fill",
    )  # fmt: skip
    for path in recordings("mtconnect_docs", "*ProductionLog_-_Orig.csv"):
        result = trace_of(csv_table.read, path, form, "csv")
        assert result.kept == len(path.read_text().splitlines()) and not result.rejected
        assert str(result.table.column("time")[0]) == "2013-08-22 10:32:46+00:00"
        assert values(result, "detail")[3].startswith("AAAB_001")
