"""The logger's files: layout, clock, faults, and the heat that they show."""

from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest

from .conftest import Simulated

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
