"""Recordings of growth: a user's own channels, units, gaps and what is said of those of no use."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.signals.recordings import Channel
from pipeline.submodels.deformation.records import (
    DeformationRecords,
    GrowthRecording,
    Profile,
    conditions_of_profile,
    on_grid,
    read_profiles,
)
from tests.submodels.deformation.growth_files import (
    IDENTITY,
    NAMES,
    RECORDS,
    Made,
    made,
    signals_of,
)


def recording(folder: Path, one: Made, records: DeformationRecords = RECORDS) -> GrowthRecording:
    (found,) = read_profiles(signals_of(folder, {"a": one}), records, lambda name: True)
    return found


def profile(folder: Path, one: Made, records: DeformationRecords = RECORDS) -> Profile:
    found = recording(folder, one, records).profile
    assert found is not None
    return found


def test_channels_come_in_the_units_of_the_sub_model(tmp_path):
    one = made(1, minutes=40)
    found = profile(tmp_path, one)
    state = found.state
    assert state.temperatures == pytest.approx(one.temperatures, abs=1e-9)
    assert state.speed == pytest.approx(one.speed, abs=1e-6)  # rev/min, by way of rad/s
    assert found.growth == pytest.approx(one.growth, abs=1e-9)


def test_any_three_temperatures_and_a_probe_do(tmp_path):
    own = DeformationRecords(
        recordings=("growth/*.csv",),
        temperatures={name: Channel(column=name) for name in NAMES[1:4]},
        displacement=Channel(column="growth", factor=-1.0),
    )
    one = made(2, minutes=40)
    found = profile(tmp_path, one, own)
    assert found.state.channels.shape == (40, 3)
    assert found.growth == pytest.approx(-one.growth, abs=1e-9)
    assert "highest speed" not in conditions_of_profile(found, speed=False)


def test_a_log_of_mtconnect_is_a_recording(tmp_path):
    one, names = made(7, minutes=40), ("Sspeed", *NAMES, "air", "probe")
    start, lines, before = datetime(2026, 1, 5, 8, tzinfo=UTC), [], [""] * len(names)
    for k in range(40):
        values = [one.speed[k], *one.temperatures[k], one.ambient[k], 1e-3 * one.growth[k]]
        words = [f"{value:.6f}" for value in values]
        changed = [f"{n}|{w}" for n, w, old in zip(names, words, before, strict=True) if w != old]
        stamp = (start + timedelta(minutes=k)).strftime("%Y-%m-%dT%H:%M:%SZ")
        lines.append("|".join([stamp, *changed]))
        before = words
    (tmp_path / "raw/growth").mkdir(parents=True)
    (tmp_path / "raw/growth/a.txt").write_text("\n".join(lines) + "\n")
    log = RecordSource(format="shdr", files="growth/*.txt", values="units")
    ingest(tmp_path / "raw", tmp_path / "signals", [log], IDENTITY)
    own = DeformationRecords(
        recordings=("growth/*.txt",),
        temperatures={name: Channel(column=name, unit="degC") for name in NAMES},
        displacement=Channel(column="probe", unit="mm"),
        speed=Channel(column="Sspeed", unit="rev/min"),
        ambient=Channel(column="air", unit="degC"),
    )
    (found,) = read_profiles(tmp_path / "signals", own, lambda name: True)
    assert found.profile is not None, found.reason
    assert found.profile.state.temperatures == pytest.approx(one.temperatures, abs=1e-5)
    assert found.profile.state.speed == pytest.approx(one.speed, abs=1e-3)
    assert found.profile.growth == pytest.approx(one.growth, abs=1e-3)
    lost = replace(own, displacement=Channel(column="dial", unit="mm"))
    (none,) = read_profiles(tmp_path / "signals", lost, lambda name: True)
    assert none.profile is None and "no data item 'dial'" in none.reason


def test_a_probe_that_was_not_zeroed_starts_at_zero(tmp_path):
    one = made(3, minutes=40)
    signals = signals_of(tmp_path, {"a": replace(one, growth=one.growth + 250.0)})
    own = replace(RECORDS, probe_is_zeroed=False)
    (found,) = read_profiles(signals, own, lambda name: True)
    assert found.profile is not None
    assert found.profile.growth == pytest.approx(one.growth - one.growth[0], abs=1e-9)


def test_the_place_of_a_sensor_that_is_none_is_refused_by_its_name():
    with pytest.raises(ValueError, match="places names a sensor 'temperature_9'"):
        replace(RECORDS, places={"temperature_9": "head"})


def test_fewer_than_three_temperatures_are_refused():
    with pytest.raises(ValueError, match="names 2 sensors: name 3 or more"):
        replace(RECORDS, temperatures={name: Channel(column=name) for name in NAMES[:2]})


def test_a_recording_without_growth_is_left_out_with_the_reason(tmp_path):
    one = made(4, minutes=40)
    signals = signals_of(tmp_path, {"a": replace(one, growth=np.full(40, np.nan)), "b": one})
    first, second = read_profiles(signals, RECORDS, lambda name: True)
    assert first.profile is None and "'growth' holds no value" in first.reason
    assert second.profile is not None


def test_a_sensor_without_any_value_leaves_the_recording_of_use(tmp_path):
    one = made(5, minutes=40)
    one.temperatures[:, 2] = np.nan
    found = profile(tmp_path, one)
    assert np.isnan(found.state.temperatures[:, 2]).all()


def test_the_grid_takes_the_newest_row_and_none_later():
    clock, values = np.array([0.0, 59.0, 61.0, 400.0]), np.array([1.0, 2.0, 3.0, 4.0])
    found = on_grid(clock, values, 60.0 * np.arange(8), 180.0)
    assert found.tolist()[:4] == [1.0, 2.0, 3.0, 3.0]
    assert np.isnan(found[5:7]).all() and found[7] == 4.0


def test_the_warmth_at_the_start_is_known_with_a_broken_sensor(tmp_path):
    cold, warm = made(6, minutes=40), made(6, minutes=40, warm=True)
    warm.temperatures[:, 1] = 850.0
    found = read_profiles(signals_of(tmp_path, {"a": cold, "b": warm}), RECORDS, lambda name: True)
    warmth = [
        conditions_of_profile(one.profile, speed=True)["warmth at the start"].value
        for one in found
        if one.profile is not None
    ]
    assert abs(float(warmth[0] or 0)) < 1.0 < 3.0 < float(warmth[1] or 0) < 30.0


def test_a_recording_starts_with_the_first_values_of_its_sensors(tmp_path):
    one = made(8, minutes=40)
    one.temperatures[0, [1, 3]] = np.nan
    found = profile(tmp_path, one)
    state = found.state
    assert np.isfinite(state.temperatures[0]).all() and len(state.temperatures) == 39
    assert found.growth[0] == 0.0


def test_rows_farther_apart_than_the_longest_gap_say_what_to_set(tmp_path):
    one = made(9, minutes=40)
    slow = replace(RECORDS, period_s=10.0, longest_gap_s=30.0)
    found = recording(tmp_path, one, slow)
    assert found.profile is None and "rows are 60 s apart" in found.reason
    assert "set period_s to 60" in found.reason


def test_a_probe_that_begins_far_from_zero_names_the_setting(tmp_path):
    one = made(10, minutes=40)
    found = recording(tmp_path, replace(one, growth=one.growth + 500.0))
    assert found.profile is None and "probe_is_zeroed: false" in found.reason


def test_what_a_frozen_probe_shows_is_no_growth(tmp_path):
    one = made(5, minutes=120)
    frozen = one.growth.copy()
    frozen[40:] = frozen[40]
    found = profile(tmp_path, replace(one, growth=frozen))
    assert np.flatnonzero(np.isnan(found.growth)).tolist() == list(range(40, 120))


@pytest.mark.parametrize("standing", [False, True])
def test_readings_after_the_planned_end_are_not_read(tmp_path, standing):
    one = made(5, minutes=120)
    speed = np.where(np.arange(120) < 80, np.maximum(one.speed, 600.0), np.nan)
    speed[79] = 0.0 if standing else 600.0
    found = profile(tmp_path, replace(one, speed=speed))
    # a spindle that stands goes on standing; a value counts for the longest gap
    rows = 120 if standing else 80 + round(RECORDS.longest_gap_s / 60)
    assert len(found.state) == rows
