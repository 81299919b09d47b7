"""Days from midnight to midnight of a plant's clock, and records cleaned by them."""

import numpy as np
import pytest
from cleaning_records import day_rows, read, record

from pipeline.charts.sources import SourceRegistry
from pipeline.report.folders import MachineFolders
from pipeline.report.work import work
from pipeline.schema.days import clock, day_end, day_of, day_start, days_of
from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.signals.cleaning.clean import clean
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.contracts import check
from pipeline.signals.windows import read_state, state_days
from pipeline.submodels.cases import Records, files_of_day, files_of_days
from pipeline.submodels.contract import submodel

HOUR = 3600 * 10**9
NEW_YORK = "America/New_York"
SIGNALS = {"execution": "exec", "program": "prog", "spindle_temperature": "temp"}


def at(text):
    return int(np.datetime64(text, "ns").astype(np.int64))


@pytest.mark.parametrize(
    ("day", "zone", "first", "hours"),
    [
        ("2026-01-05", "UTC", "2026-01-05T00:00", 24),
        ("2026-01-05", NEW_YORK, "2026-01-05T05:00", 24),
        ("2026-07-06", NEW_YORK, "2026-07-06T04:00", 24),
        ("2026-03-08", NEW_YORK, "2026-03-08T05:00", 23),
        ("2026-11-01", NEW_YORK, "2026-11-01T04:00", 25),
        ("2026-01-05", "Asia/Kolkata", "2026-01-04T18:30", 24),
        ("2026-09-27", "Pacific/Auckland", "2026-09-26T12:00", 23),  # from +12 to +13
        ("2026-04-05", "Pacific/Auckland", "2026-04-04T11:00", 25),
        ("2026-01-05", "Asia/Kathmandu", "2026-01-04T18:15", 24),
        ("2018-11-04", "America/Sao_Paulo", "2018-11-04T03:00", 23),  # its midnight does not exist
    ],
)
def test_a_day_goes_from_midnight_to_midnight_of_the_plant(day, zone, first, hours):
    start, end = day_start(day, zone), day_end(day, zone)
    assert (start, end - start) == (at(first), hours * HOUR)
    assert (day_of(start, zone), day_of(end - 1, zone)) == (day, day)
    assert day_of(start - 1, zone) < day < day_of(end, zone)
    assert days_of(np.array([end, start - 1, start, start + 1]), zone) == [
        day_of(start - 1, zone), day, day_of(end, zone)
    ]  # fmt: skip


def test_the_clock_shows_an_hour_twice_and_leaves_one_out():
    """On 1 November 2026 New York has 01:30 twice, on 8 March no 02:30."""
    twice = clock(np.array([at("2026-11-01T05:30"), at("2026-11-01T06:30")]), NEW_YORK)
    assert (twice == at("2026-11-01T01:30")).all()
    spring = clock(np.array([at("2026-03-08T06:30"), at("2026-03-08T07:30")]), NEW_YORK)
    assert spring.tolist() == [at("2026-03-08T01:30"), at("2026-03-08T03:30")]


def test_records_are_cleaned_by_the_days_of_the_plant(tmp_path):
    """Records from 18:30 to 00:30 in New York are cut at its midnight, five hours after UTC's."""
    signals = tmp_path / "signals"
    record(signals, "night", day_rows(range(0, 6 * 3600, 5)), "2026-11-01T23:30:00")
    night = {}
    for zone in ("UTC", NEW_YORK):
        out = tmp_path / zone
        clean(signals, out, machine=CleanMachine(signals=SIGNALS, time_zone=zone))
        for path in (out / "state").glob("*.parquet"):
            check("state", read(path))
        night[zone] = {day: read_state(out, day) for day in state_days(out)}
    assert list(night["UTC"]) == ["2026-11-01", "2026-11-02"]
    assert list(night[NEW_YORK]) == ["2026-11-01", "2026-11-02"]
    first = night[NEW_YORK]["2026-11-01"].index
    assert str(first[0]) == "2026-11-01 18:30:00-05:00"
    assert str(first[-1]) == "2026-11-01 23:59:59-05:00"
    together = [np.concatenate([f.index.asi8 for f in days.values()]) for days in night.values()]
    assert (together[0] == together[1]).all()  # the same instants, of UTC, on disk
    values = [
        np.concatenate([f["spindle_temperature"] for f in d.values()]) for d in night.values()
    ]
    assert np.array_equal(*values, equal_nan=True)


@pytest.mark.parametrize(("day", "hours"), [("2026-11-01", 25.0), ("2026-03-08", 23.0)])
def test_the_report_counts_the_hours_that_the_day_has(tmp_path, day, hours):
    signals, out = tmp_path / "signals", tmp_path / "clean"
    record(signals, "shift", day_rows(range(0, 3600, 5)), f"{day}T15:00:00")
    clean(signals, out, machine=CleanMachine(signals=SIGNALS, time_zone=NEW_YORK))
    folders = MachineFolders(
        name="lathe", signals=signals, clean=out, models=tmp_path, golden=tmp_path,
        origin="recorded",
    )  # fmt: skip
    done = work(folders, SourceRegistry())
    assert [d.day for d in done.days] == [day]
    assert sum(done.days[0].seconds.values()) == pytest.approx(3600 * hours)
    assert done.time_zone == NEW_YORK
    assert done.last == pytest.approx(at(f"{day}T16:00") / 1e9, abs=301)


@pytest.mark.parametrize(
    ("zone", "hint"),
    [("America/New_Yrk", "did you mean America/New_York"), ("local", "is not a time zone")],
)
def test_a_zone_that_is_not_known_is_refused(zone, hint):
    with pytest.raises(ValueError, match=hint) as refused:
        CleanMachine(time_zone=zone)
    assert zone in str(refused.value)


def test_a_file_belongs_to_the_day_of_the_plant_on_which_it_ends():
    files = {"a.txt": {"last": "2026-01-15T02:00:00Z"}, "table.csv": {"last": None}}
    assert files_of_day(files, "2026-01-14", NEW_YORK) == ["a.txt"]
    assert files_of_day(files, "2026-01-15", "UTC") == ["a.txt"]
    assert files_of_day(files, "2026-01-15", NEW_YORK) == []


def test_a_log_that_is_one_file_for_weeks_belongs_to_each_of_its_days():
    """A file that ends in the days goes before one that reaches over them."""
    files = {"all.txt": {"first": "2026-01-05T06:00:00Z", "last": "2026-01-16T15:00:00Z"}}
    days = Days(first="2026-01-08", last="2026-01-09")
    assert files_of_days(files, days, "UTC") == ["all.txt"]
    before = Days(first="2026-01-02", last="2026-01-04")
    assert files_of_days(files, before, "UTC") == []
    files["friday.txt"] = {"first": "2026-01-09T06:00:00Z", "last": "2026-01-09T15:00:00Z"}
    assert files_of_days(files, days, "UTC") == ["friday.txt"]


def test_days_that_were_frozen_by_another_clock_are_refused(tmp_path):
    signals, out = tmp_path / "signals", tmp_path / "clean"
    record(signals, "shift", day_rows(range(0, 3600, 5)), "2026-01-14T15:00:00")
    clean(signals, out, machine=CleanMachine(signals=SIGNALS, time_zone=NEW_YORK))
    (signals / "manifest.json").write_text('{"files": {}}')
    days = Days(first="2026-01-14", last="2026-01-14")
    sets = GoldenSets(machine="lathe", golden=FrozenSet(files=(), days=days))
    with pytest.raises(ValueError, match="those of UTC, its records are cut by America/New_York"):
        submodel("spindle").cases(Records(signals=signals, clean=out), None, sets)
