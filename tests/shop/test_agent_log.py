"""A week at the machine: its log and the logger's files, with the faults that are told."""

from collections import Counter
from datetime import datetime, timedelta
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from .conftest import LogFile, Record, Simulated

WRONG = {
    "zero_temperature": lambda r: r.name == "S1temp" and r.fields == ("0",),
    "speed_spike": lambda r: r.name == "S1n" and r.fields == ("65535",),
    "position_spike": lambda r: r.name.endswith("pos") and r.fields == ("99999.999",),
    "counter_reset": lambda r: r.name.startswith("t_") and r.fields == ("0",),
    "feedrate_spike": lambda r: r.name == "vpath" and _large(r.fields[0]),
}


def _large(value: str) -> bool:
    return value != "UNAVAILABLE" and abs(float(value)) > 2e4


def _time(text: str) -> datetime:
    return datetime.fromisoformat(text.removesuffix("Z"))


@pytest.fixture(scope="module")
def files(week: Simulated) -> dict[str, LogFile]:
    return {f["file"]: week.log(f["file"]) for f in week.truth["log"]["files"]}


def test_every_line_is_a_record_or_among_the_rejected(week, files):
    for told in week.truth["log"]["files"]:
        found = files[told["file"]]
        assert len(found.lines) == told["lines"]
        assert len(found.records) == told["records"]
        assert len(found.rejected) == told["rejected"]
    lines = Counter(line for f in files.values() for line in f.rejected)
    assert lines == Counter(r["line"] for r in week.truth["log"]["rejected"])


def test_lines_older_than_one_before_them_are_as_many_as_told(week, files):
    told = {f["file"]: f["out_of_order"] for f in week.truth["log"]["files"]}
    assert {name: f.out_of_order for name, f in files.items()} == told
    assert sum(told.values()) > 0


def test_wrong_values_are_as_many_as_told_and_where_told(week, files):
    records = [r for f in files.values() for r in f.records]
    for kind, is_wrong in WRONG.items():
        found = sorted((r.time, r.name, r.fields[0]) for r in records if is_wrong(r))
        told = [g for g in week.truth["log"]["glitches"] if g["kind"] == kind]
        assert found == sorted((_time(g["time"]), g["item"], g["value"]) for g in told)
    assert week.truth["log"]["counts"]["glitches"]["zero_temperature"] > 100


def test_all_items_become_unavailable_when_told(week, files):
    bursts = [b for b in week.truth["log"]["bursts"] if b["kind"] != "agent_start"]
    gone = Counter(
        r.time
        for f in files.values()
        for r in f.records
        if r.name == "exec" and r.fields == ("UNAVAILABLE",)
    )
    assert {_time(b["time"]) for b in bursts} <= set(gone)
    # each file says once what was known before it
    assert sum(gone.values()) == len(bursts) + len(files)


def test_late_lines_stand_after_younger_ones(week, files):
    records = [r for f in files.values() for r in f.records]
    where: dict[tuple[datetime, str], list[int]] = {}
    for k, r in enumerate(records):
        where.setdefault((r.time, f"{r.name}|{r.fields[0]}"), []).append(k)
    late = week.truth["log"]["late_lines"]
    assert late
    for told in late:
        (k,) = where[_time(told["time"]), told["record"]]
        assert records[k - 1].time > records[k].time


def test_weekend_and_night_are_silent(week, files):
    days = {d["date"]: d for d in week.truth["days"]}
    for name, found in files.items():
        day = days[name[6:16]]
        heard = [r for r in found.records if r.fields[0].upper() != "UNAVAILABLE"]
        if "on" not in day:
            assert not heard
            continue
        assert _time(day["on"]) <= min(r.time for r in heard)
        assert max(r.time for r in heard) <= _time(day["off"])
    off = [d for d in week.truth["days"] if "on" not in d]
    assert [datetime.fromisoformat(d["date"]).weekday() for d in off] == [5, 6]


def _execution(files: dict[str, LogFile]) -> list[Record]:
    return sorted(
        (r for f in files.values() for r in f.records if r.name == "exec"), key=lambda r: r.time
    )


def test_cycles_are_what_the_execution_shows(week, files):
    """Both ways: each edge of a cycle is a change of the log; no other automatic run is there."""
    changes = _execution(files)
    poll = timedelta(seconds=4.5)  # two polls of which one may be skipped, and a rounding
    starts = [r.time for r in changes if r.fields == ("ACTIVE",)]
    ends = [r.time for r in changes if r.fields[0] in ("READY", "STOPPED")]
    cycles = week.truth["cycles"]
    assert len(cycles) > 20
    for c in cycles:
        for edge, times in (("start", starts), ("end", ends)):
            moment = _time(c[edge])
            near = any(timedelta(0) <= t - moment <= poll for t in times)
            assert near or not c[f"{edge}_seen"], f"{edge} of cycle {c['number']} at {moment}"
    lost = [(_time(u["start"]), _time(u["end"]) + poll) for u in week.truth["log"]["unobserved"]]
    spans = [(_time(c["start"]), _time(c["end"])) for c in cycles]
    mode = {}
    for r in sorted((r for f in files.values() for r in f.records if r.name == "opmode"),
                    key=lambda r: r.time):  # fmt: skip
        mode[r.time] = r.fields[0]
    times = list(mode)
    for t in starts:
        before = [m for m in times if m <= t]
        if any(a <= t <= b for a, b in [*spans, *lost]) or not before:
            continue
        assert mode[before[-1]] == "MANUAL_DATA_INPUT", f"ACTIVE at {t} in no cycle"


def test_every_item_of_the_log_is_in_the_device_model(week, files):
    root = ElementTree.parse(week.folder / "Devices.xml").getroot()
    described = {e.get("name"): e for e in root.iter() if e.tag.endswith("}DataItem")}
    assert {r.name for f in files.values() for r in f.records} == set(described)
    differ = [e for e in described.values() if e.get("units") != e.get("nativeUnits")]
    assert {e.get("type") for e in differ} >= {"AXIS_FEEDRATE", "PATH_FEEDRATE"}
    ids = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(ids) == len(set(ids))


def test_an_adapter_writes_native_units_and_several_pairs_on_a_line(week, files):
    """Feeds of catalogue size: 8 to 66 mm/s; in mm/min sixty times that."""
    native = week.parameters.log.kind == "adapter"
    feeds = [
        float(r.fields[0])
        for f in files.values()
        for r in f.records
        if r.name == "vpath" and r.fields[0] != "UNAVAILABLE" and 0 < float(r.fields[0]) < 2e4
    ]
    median = sorted(feeds)[len(feeds) // 2]
    assert (median > 400) == native
    records = sum(len(f.records) for f in files.values())
    assert (records > 1.5 * sum(len(f.lines) for f in files.values())) == native


def test_the_c_axis_stands_still_in_spindle_mode_and_is_held_between_parts(week, files):
    records = [r for f in files.values() for r in f.records]
    modes = {r.fields[0] for r in records if r.name == "S1func"}
    if not week.parameters.c_axis:
        assert not modes
        return
    assert modes >= {"SPINDLE", "INDEX", "CONTOUR"}
    angles = {r.fields[0] for r in records if r.name == "Cang"} - {"UNAVAILABLE"}
    assert all(0 <= float(a) < 360 for a in angles)
    assert "90" in angles  # where it is held for loading


HEADER = 8


@pytest.fixture(scope="module")
def rows(week: Simulated) -> tuple[list[datetime], np.ndarray]:
    p = week.parameters.logger
    separator = ";" if p.decimal == "," else ","
    times, values = [], []
    for path in sorted((week.folder / "thermocouples").glob("*.csv")):
        for line in path.read_text(encoding=p.encoding).splitlines()[HEADER:]:
            time, *cells = line.split(separator)
            times.append(datetime.fromisoformat(time))
            values.append([float(c.replace(p.decimal, ".")) if c else np.nan for c in cells])
    return times, np.array(values)


def test_a_row_each_ten_seconds_of_the_loggers_clock(week, rows):
    times, values = rows
    assert len(times) == week.truth["thermocouples"]["rows"]
    assert values.shape[1] == len(week.truth["thermocouples"]["channels"]) == 6
    assert {b - a for a, b in pairwise(times)} == {timedelta(seconds=10)}


def test_one_file_a_day_with_names_and_units(week):
    p = week.parameters.logger
    files = sorted((week.folder / "thermocouples").glob("*.csv"))
    assert [f.stem for f in files] == [d["date"] for d in week.truth["days"]]
    lines = files[0].read_text(encoding=p.encoding).splitlines()
    separator = ";" if p.decimal == "," else ","
    assert lines[6].split(separator) == ["Time", *week.truth["thermocouples"]["channels"]]
    assert set(lines[7].split(separator)[1:]) == {"°C" if p.decimal == "," else "degC"}


def test_blanks_and_spikes_are_as_told(week, rows):
    _, values = rows
    told = week.truth["thermocouples"]
    assert int(np.isnan(values).sum()) == told["blank_cells"] > 0
    assert int((values > 1000).sum()) == len(told["spikes"]) > 0


def test_the_clock_is_off_by_what_is_told(week, rows):
    """A spike's place in the file, taken back through the stated clock, is its true time."""
    times, values = rows
    told = week.truth["thermocouples"]
    clock = told["clock"]
    start = datetime.fromisoformat(week.parameters.first_day)
    shown = sorted(times[k] for k in np.flatnonzero((values > 1000).any(axis=1)))
    true = sorted({datetime.fromisoformat(s["time"].removesuffix("Z")) for s in told["spikes"]})
    for a, b in zip(shown, true, strict=True):
        seconds = (b - start).total_seconds()
        off = seconds * clock["drift_s_per_day"] / 86400 + clock["offset_s"]
        expected = b + timedelta(seconds=off + 3600 * clock["zone_hours"])
        assert abs((a - expected).total_seconds()) < 0.01


def test_bearings_follow_the_work_and_the_weekend_is_cold(week, rows):
    times, values = rows
    values = np.where(values > 1000, np.nan, values)
    weekday = np.array([t.weekday() for t in times])
    hour = np.array([t.hour for t in times])
    front = values[:, 0] - values[:, 3]  # above the air
    working = np.nanmean(front[(weekday < 5) & (hour >= 9) & (hour < 13)])
    sunday = np.nanmean(front[weekday == 6])
    assert working > 8.0
    assert sunday < 3.0
