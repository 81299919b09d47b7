"""A machine's file proposed from a Devices document and logs, and what stops a newcomer."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import yaml

from pipeline.app.machine import fleet_text, machine_text, propose, said
from pipeline.app.records import (
    ItemSeries,
    item_record,
    lines,
    machine_records,
    without_holes,
)
from pipeline.schema.store import write_table
from pipeline.signals.cleaning.recorded import near
from pipeline.signals.formats import format_of, looks_like
from pipeline.stages.compose import composed

DEVICE = """<Device name="{name}" id="{name}"><DataItems/><Components>
<Axes id="{name}a"><Components>
<Rotary id="{name}s" name="S"><DataItems>
<DataItem id="{name}1" name="n1" category="SAMPLE" type="ROTARY_VELOCITY"
 units="REVOLUTION/MINUTE"/>
<DataItem id="{name}2" name="p1" category="SAMPLE" type="LOAD" units="PERCENT"/>
<DataItem id="{name}3" name="w1" category="SAMPLE" type="TEMPERATURE" units="CELSIUS"/>
</DataItems></Rotary>
<Linear id="{name}x" name="X"><DataItems>
<DataItem id="{name}4" name="{x}" category="SAMPLE" type="LOAD" units="PERCENT"/>
</DataItems></Linear></Components></Axes></Components></Device>"""


@pytest.fixture
def given(tmp_path: Path) -> tuple[Path, Path]:
    """A Devices document of two devices, and a log of the second with an item of neither."""
    inside = DEVICE.format(name="one", x="px") + DEVICE.format(name="two", x="load_of_x")
    devices = tmp_path / "Devices.xml"
    devices.write_text(f"<MTConnectDevices><Devices>{inside}</Devices></MTConnectDevices>")
    said = []
    for second in range(50):
        time = f"2026-03-0{1 + second // 25}T08:00:{second:02d}Z"
        for item, value in (("n1", 3000), ("p1", 20 + second % 3), ("w1", 30 + second / 10),
                            ("load_of_x", second), ("stranger", 1)):  # fmt: skip
            said.append(f"{time}|{item}|{value}")
    log = tmp_path / "log.txt"
    log.write_text("\n".join(said) + "\n")
    return devices, log


def test_the_device_is_the_one_whose_items_the_log_has(
    given: tuple[Path, Path], tmp_path: Path
) -> None:
    devices, log = given
    found = propose("lathe", devices, [log], None, tmp_path / "raw")
    assert found.device == "two"
    assert found.strangers == ["stranger"]
    assert found.days == ["2026-03-01", "2026-03-02"]
    values = yaml.safe_load(machine_text(found))
    assert values["mapping"]["signals"] == {
        "spindle_speed": "n1", "spindle_load": "p1", "spindle_temperature": "w1",
        "x_load": "load_of_x",
    }  # fmt: skip
    assert values["roles"]["training_days"] == {"first": "2026-03-01", "last": "2026-03-01"}
    assert values["records"][0]["device"] == "two"


SPINDLE = """<Rotary id="{n}" name="S{n}"><DataItems>
<DataItem id="{n}1" name="n{n}" category="SAMPLE" type="ROTARY_VELOCITY"/>
<DataItem id="{n}2" name="p{n}" category="SAMPLE" type="LOAD"/>
<DataItem id="{n}3" name="w{n}" category="SAMPLE" type="TEMPERATURE"/></DataItems></Rotary>"""
TIMER = '<DataItem id="{n}" name="{n}" category="SAMPLE" type="EQUIPMENT_TIMER" subType="{n}"/>'


def test_the_spindle_that_warms_is_modelled_and_timers_are_found(tmp_path: Path) -> None:
    """The first spindle turns all the time and stays warm, the second one turns less and warms.

    A year without a log lies between two shifts; it takes no part in the comparison.
    """
    devices, log = tmp_path / "Devices.xml", tmp_path / "log.txt"
    timers = "".join(TIMER.format(n=name) for name in ("POWERED", "WORKING", "LOADED"))
    axes = SPINDLE.format(n=1) + SPINDLE.format(n=2)
    devices.write_text(
        f'<Device id="d" name="d"><DataItems>{timers}</DataItems><Components><Axes id="a">'
        f"<Components>{axes}</Components></Axes></Components></Device>"
    )
    rows = []
    for minute in range(400):
        year, at = 2025 + minute // 200, minute % 200
        time = f"{year}-03-03T{8 + at // 60:02d}:{at % 60:02d}:00Z"
        values = {
            "n1": 500 + at, "p1": 5, "w1": 44 + at % 2, "n2": 900 * (at % 2), "p2": at % 7,
            "w2": 25 + at / 20, **dict.fromkeys(("POWERED", "WORKING", "LOADED"), minute),
        }  # fmt: skip
        rows += [f"{time}|{item}|{value}" for item, value in values.items()]
    log.write_text("\n".join(rows) + "\n")
    found = propose("lathe", devices, [log], None, tmp_path / "raw")
    signals = found.mapping.signals
    assert (signals["spindle_speed"], signals["second_spindle_speed"]) == ("n2", "n1")
    assert "its temperature moves most" in found.mapping.choices["spindle_speed"].why
    assert [signals[f"{one}_time"] for one in ("total", "auto", "cut")] == [
        "POWERED", "WORKING", "LOADED",
    ]  # fmt: skip


def test_without_a_day_of_records_no_sub_model_is_proposed(
    given: tuple[Path, Path], tmp_path: Path
) -> None:
    """A fleet is proposed that builds: a sub-model without training days would be refused."""
    log = tmp_path / "empty.txt"
    log.touch()
    found = propose("lathe", given[0], [log], "two", tmp_path / "raw")
    assert not found.lacking and not found.days
    assert "roles" not in yaml.safe_load(machine_text(found))
    assert yaml.safe_load(fleet_text(found, ["spindle"]))["submodels"] == {"spindle": []}
    (line,) = said(found, [("spindle", "spindle", "")])[-1:]
    assert "no day of records is here; put logs into data/raw/lathe, name days in roles" in line
    with pytest.raises(ValueError, match=r"empty\.txt is empty: give the Devices document, logs"):
        propose("lathe", None, [log], None, tmp_path / "raw")


def test_without_a_log_several_devices_are_a_question(
    given: tuple[Path, Path], tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="one, two: say which one with --device"):
        propose("lathe", given[0], [], None, tmp_path / "raw")


def test_unavailable_is_a_share_of_time() -> None:
    series = ItemSeries(
        time=np.array([0, 1, 4]) * 10**9, number=np.array([1.0, np.nan, 3.0]),
        known=np.array([True, False, True]), words=0,
    )  # fmt: skip
    row = item_record("n1", series, (0, 4 * 10**9), lambda time: time, signal="spindle_speed")
    assert row.unavailable == pytest.approx(3 / 4)
    assert (row.samples, row.low, row.high, row.interval_s) == (2, 1.0, 3.0, 4.0)


def test_days_without_a_log_count_neither_as_unavailable_nor_in_the_course() -> None:
    """An hour of one year and two of the next: its end and their beginning fall together."""
    hour, year = 3600 * 10**9, 365 * 24 * 3600 * 10**9
    time = np.concatenate([np.arange(3), year // hour + np.arange(3)]) * hour
    known = np.array([True, True, False, True, True, True])
    number = np.where(known, [0.0, 0.0, 0.0, 8.0, 8.0, 8.0], np.nan)
    series = ItemSeries(time=time, number=number, known=known, words=0)
    shortened = without_holes({"n1": series})
    assert np.diff(shortened(time)).tolist() == [hour, 0, 0, hour, hour]
    span = (0, int(shortened(time)[-1]))
    row = item_record("n1", series, span, shortened, signal="spindle_speed")
    assert row.unavailable == 0.0
    assert row.sparkline.replace(" ", "") == "▁▅██"
    assert row.last == "1971-01-01T02:00:00Z"


def test_an_item_without_records_is_said(tmp_path: Path) -> None:
    rows = machine_records(tmp_path, {"S1load": "spindle_load"}, {})
    assert "no record has a value of S1load, which the machine's file names as spindle_load" in (
        list(lines(rows))
    )


def test_columns_of_tables_have_the_units_of_their_layout(tmp_path: Path) -> None:
    fields = [pa.field("time", pa.timestamp("ns", tz="UTC")),
              pa.field("load", pa.float64(), metadata={"unit": "percent"})]  # fmt: skip
    table = pa.table({"time": [0, 10**9], "load": [1.0, 2.0]}, schema=pa.schema(fields))
    write_table(table, tmp_path / "traces/a.parquet")
    (row,) = machine_records(tmp_path, {}, {})
    assert (row.item, row.unit, row.samples) == ("load", "percent", 2)


def test_near_names_ignore_case() -> None:
    assert near(["S1LOAD"], ["S1load", "execution"]) == {"S1LOAD": ["S1load"]}


def test_a_log_that_begins_with_a_tag_is_a_log(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("<the rest of a document\n2026-01-05T08:00:00Z|n1|3000\n")
    assert format_of(path) == "shdr"
    path.write_text("<Device id='d'><DataItems/></Device>\n")
    assert format_of(path) == "mtconnect_xml"


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"BZh91AY&SY", "bzip2"),
        (b"00000000: 3c72 6573 7420 6f66 2061 2064\n", "hex dump"),
        (b"%\nO1234\nN10 G0 X1.\nX2. Y3.\nM30\n%\n", "part program"),
        (b"a,b,c\n1,2,3\n4,5,6\n7,8,9\n", "format csv"),
        (b"2026-01-05T08:00:00Z|n1|3000\n" * 5, ""),
    ],
)
def test_what_is_no_log_is_called_so(head: bytes, said: str) -> None:
    found = looks_like(head)
    assert said in found
    assert bool(found) == bool(said)


def test_an_unknown_machine_of_a_fleet_is_named_with_what_is_like_it() -> None:
    with pytest.raises(ValueError, match=r"'mazak1'.*did you mean mazak01"):
        composed(Path("conf"), ("fleet.machines=[mazak1]",))
