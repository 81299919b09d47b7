"""What all tables share: units at the door, time, rejected rows, and the real recordings."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recorder_tables import layout, nanoseconds, notes, trace_of, values

from pipeline.signals.columns import COLUMNS
from pipeline.signals.formats import (
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
)
from pipeline.signals.tables import columnar, csv_table
from pipeline.signals.tables.table import RawTable, assemble, known_signal


def trace(columns: Mapping[str, Any], form: TableLayout, **facts: Any) -> Trace:
    cells = {name: pa.array(values) for name, values in columns.items()}
    length = len(next(iter(cells.values())))
    facts.setdefault("lines", np.arange(1, length + 1))
    return assemble(RawTable(columns=cells, **facts), form)


def test_values_are_in_the_units_of_the_table_of_signals() -> None:
    form = layout(
        {
            "x_position": ("X", "inch"), "path_feedrate": ("F", "m/min"),
            "spindle_speed": ("S", "1/s"), "spindle_temperature": ("T", "°F"),
            "a_angle": ("A", "rad"), "spindle_load": ("L", ""), "force_x": ("Fx", "kN"),
            "line": ("N", None),
        },
        rate=1.0,
    )  # fmt: skip
    row = {"X": [2.0], "F": [6], "S": [50], "T": [212.0], "A": [np.pi], "L": [0.5], "Fx": [0.25],
           "N": [7]}  # fmt: skip
    result = trace(row, form)
    found = {name: values(result, name)[0] for name in result.table.schema.names[1:]}
    assert found == pytest.approx(
        {"x_position": 50.8, "path_feedrate": 100.0, "spindle_speed": 3000.0,
         "spindle_temperature": 100.0, "a_angle": 180.0, "spindle_load": 50.0,
         "force_x": 250.0, "line": 7.0}, rel=1e-15)  # fmt: skip
    for name in found:
        expected = COLUMNS[name].unit if name in COLUMNS else "NEWTON"
        assert result.table.schema.field(name).metadata[b"unit"].decode() == expected


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("spindle_speed", "spindle_speed"), ("turret_spindle_speed", "spindle_speed"),
        ("x_position_ref", "x_position"), ("second_spindle_load", "second_spindle_load"),
        ("coolant_line", None), ("force_x", None), ("part_program", None),
    ],
)  # fmt: skip
def test_names_that_end_with_a_known_signal(name: str, signal: str | None) -> None:
    found = known_signal(name)
    assert (found.name if found else None) == signal


def test_a_unit_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'turret_spindle_speed'.*'S'.*'bar' cannot become"):
        trace({"S": [1.0]}, layout({"turret_spindle_speed": ("S", "bar")}, rate=1.0))


def test_a_free_name_needs_a_unit() -> None:
    with pytest.raises(ValueError, match=r"'spindle_sped'.*spindle_speed.*unit"):
        trace({"S": [1.0]}, layout({"spindle_sped": ("S", None)}, rate=1.0))
    stated = trace({"S": [1.0]}, layout({"torque": ("S", None)}, rate=1.0), units={"S": "kNm"})
    assert values(stated, "torque") == [1000.0]
    with pytest.raises(UnreadableFile, match=r"'torque'.*'digit' is not known"):
        trace({"S": [1.0]}, layout({"torque": ("S", None)}, rate=1.0), units={"S": "digit"})


def test_words_and_missing_words() -> None:
    form = layout(
        {"execution": ("e", None), "tool_number": ("n", None), "phase": ("p", None)},
        rate=1.0,
        text=("phase",),
    )
    cells = {"e": [" ACTIVE ", "UNAVAILABLE", ""], "n": [8.0, None, 10.5], "p": ["1", "", None]}
    result = trace(cells, form)
    assert values(result, "execution") == ["ACTIVE", None, None]
    assert values(result, "tool_number") == ["8", None, "10.5"]
    assert values(result, "phase") == ["1", None, None]


def test_no_value_stands_for_missing() -> None:
    result = trace({"F": [1.0, np.nan, None]}, layout({"force_x": ("F", "N")}, rate=1.0))
    assert values(result, "force_x") == [1.0, None, None]
    infinite = trace({"F": [1.0, np.inf]}, layout({"force_x": ("F", "N")}, rate=1.0))
    assert [r.line for r in infinite.rejected] == [2]


def test_a_rejected_row_keeps_its_sampling_period() -> None:
    form = layout({"force_x": ("F", "N")}, rate=10.0)
    gap = [Rejection(line=3, reason="ragged")]
    result = trace({"F": [1.0, 2.0, 3.0]}, form, lines=np.array([2, 4, 5]), rejected=gap)
    assert values(result, "t") == [0.0, 0.2, 0.3]
    assert (len(result.rejected), result.kept) == (1, 3)


def test_a_regular_clock_is_exact_to_the_nanosecond() -> None:
    form = layout({"force_x": ("F", "N")}, rate=25600.0, start="2024-05-17T08:00:00.000000001Z")
    result = trace({"F": np.zeros(25601)}, form)
    time = np.array(nanoseconds(result))
    start = 1_715_932_800_000_000_001
    assert time[0] == start and time[-1] == start + 10**9
    exact = [start + round(k * 10**9 * 2 / 25600) // 2 for k in range(0, 25601, 128)]
    assert time[::128].tolist() == exact


@pytest.mark.parametrize(
    ("cell", "options", "expected"),
    [
        ("2024-05-17T08:00:00.123456789Z", {}, 1_715_932_800_123_456_789),
        ("2024-05-17T10:00:00+02:00", {}, 1_715_932_800_000_000_000),
        ("2024/05/17 08:00", {}, 1_715_932_800_000_000_000),
        ("2024-05-17 10:00:00,5", {"time_zone": "Europe/Berlin"}, 1_715_932_800_500_000_000),
        ("17.05.2024 08:00:00:001", {"time_format": "%d.%m.%Y %H:%M:%S:%f"},
         1_715_932_800_001_000_000),
        ("1715932800.123456789", {"time_unit": "unix_s"}, 1_715_932_800_123_456_789),
        ("1715932800123456789", {"time_unit": "unix_ns"}, 1_715_932_800_123_456_789),
        (1_715_932_800_123, {"time_unit": "unix_ms"}, 1_715_932_800_123_000_000),
        (1_715_932_800.5, {"time_unit": "unix_s"}, 1_715_932_800_500_000_000),
        ("0,000000001", {"time_unit": "s", "decimal": ",", "start": "2024-05-17T08:00:00Z"},
         1_715_932_800_000_000_001),
        (np.datetime64("2024-05-17T08:00:00.123456789"), {}, 1_715_932_800_123_456_789),
    ],
)  # fmt: skip
def test_instants(cell: Any, options: dict[str, Any], expected: int) -> None:
    form = layout({"force_x": ("F", "N")}, time="T", **{"time_unit": "iso", **options})
    assert nanoseconds(trace({"T": [cell], "F": [1.0]}, form)) == [expected]


@pytest.mark.parametrize(
    "cell",
    ["2024-02-30", "2023-02-29", "2024-13-01", "2024-01-01 24:00:00", "1500-01-01", "9999-01-01",
     "", "soon", "2024-10-27 02:30:00", "2024-03-31 02:30:00"],
)  # fmt: skip
def test_what_names_no_instant_is_rejected(cell: str) -> None:
    """The last two: the hour that the end of summer time repeats, and the one it skips."""
    form = layout({"force_x": ("F", "N")}, time="T", time_unit="iso", time_zone="Europe/Berlin")
    result = trace({"T": ["2024-07-01", cell], "F": [1.0, 2.0]}, form)
    assert values(result, "force_x") == [1.0]
    assert [r.line for r in result.rejected] == [2]
    assert (repr(cell) if cell else "nothing") in result.rejected[0].reason


def test_date_and_time_in_two_columns() -> None:
    form = layout({"force_x": ("F", "N")}, time="T", date="D", time_unit="iso")
    result = trace({"D": ["2024-05-17", ""], "T": ["08:00:00", "1:00"], "F": [1.0, 2.0]}, form)
    assert nanoseconds(result) == [1_715_932_800_000_000_000]
    assert len(result.rejected) == 1


def test_a_clock_that_runs_backwards_is_stated() -> None:
    form = layout({"force_x": ("F", "N")}, time="T")
    result = trace({"T": [0.0, 1.0, 0.5, 2.0], "F": [1.0, 2.0, 3.0, 4.0]}, form)
    assert values(result, "t") == [0.0, 1.0, 0.5, 2.0]
    assert notes(result)["clock_backwards"] == {"count": 1, "lines": [3]}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "neither time nor rate"),
        ({"time": "T", "time_unit": "min:s"}, "'min:s'"),
        ({"rate": 0.0}, "rate 0.0 Hz"),
        ({"rate": 1.0, "start": "noon"}, "'noon'"),
        ({"rate": 1.0, "text": ("word",)}, "'word'"),
        ({"time": "T", "delimiter": "::"}, "'::'"),
        ({"time": "T", "encoding": "utf-9"}, "'utf-9'"),
        ({"time": "T", "time_unit": "iso", "time_zone": "Mars/Base"}, "'Mars/Base'"),
    ],
)
def test_a_wrong_layout_is_an_error(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    path = tmp_path / "x.csv"
    path.write_text("T,F\n2024-01-01,1\n")
    form = layout({"force_x": ("F", "N")}, **options)
    with pytest.raises(ValueError, match=message) as error:
        trace_of(csv_table.read, path, form, "csv")
    assert not isinstance(error.value, UnreadableFile)


def parquet(folder: Path, table: pa.Table, form: TableLayout) -> Trace:
    path = folder / "x.parquet"
    pq.write_table(table, path)
    return trace_of(columnar.read_parquet, path, form, "parquet")


def test_parquet_reads_its_own_trace_back(tmp_path: Path) -> None:
    form = layout({"x_position": ("X", "inch")}, rate=2.0, start="2024-05-17T08:00:00Z")
    first = trace({"X": [1.0, None]}, form)
    again = parquet(
        tmp_path, first.table, layout({"x_position": ("x_position", None)}, time="time")
    )
    assert again.table.equals(first.table)


def test_parquet_of_another_schema(tmp_path: Path) -> None:
    table = pa.table({"T": [0.0], "list": [[1.0]], "words": ["a"]})
    with pytest.raises(UnreadableFile, match="'F' missing; the file has 'T'"):
        parquet(tmp_path, table, layout({"force_x": ("F", "N")}, time="T"))
    with pytest.raises(UnreadableFile, match="list"):
        parquet(tmp_path, table, layout({"force_x": ("list", "N")}, time="T"))
    with pytest.raises(UnreadableFile, match="holds 'a'"):
        parquet(tmp_path, table, layout({"force_x": ("words", "N")}, time="T"))
    rest = parquet(tmp_path, table, layout({}, time="T", rest=True))
    assert values(rest, "words") == ["a"]
    assert notes(rest)["columns_left_out"] == ["list"]


def test_damaged_parquet(tmp_path: Path) -> None:
    form = layout({"force_x": ("F", "N")}, rate=1.0)
    parquet(tmp_path, pa.table({"F": np.arange(1000.0)}), form)
    path = tmp_path / "x.parquet"
    whole = path.read_bytes()
    for length in (0, 3, 20, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(UnreadableFile):
            trace_of(columnar.read_parquet, path, form, "parquet")
    path.write_text("F\n1\n")
    with pytest.raises(UnreadableFile, match="no whole Parquet"):
        trace_of(columnar.read_parquet, path, form, "parquet")
