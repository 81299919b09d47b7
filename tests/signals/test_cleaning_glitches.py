import numpy as np
import pytest
from cleaning_records import series
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.signals.cleaning.glitches import without_glitches
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import column

SETTINGS = CleanSettings()
TEMPERATURE = column("spindle_temperature")


def kept(points, signal=TEMPERATURE):
    return without_glitches(series(points), signal, SETTINGS).series.value.tolist()


def test_a_zero_between_good_temperatures_is_removed():
    assert kept([(0, 25), (1, 0), (2, 25)]) == [25, 25]


def test_several_zeros_in_a_row_are_removed():
    assert kept([(0, 25), (1, 0), (2, 0), (3, 0), (4, 26)]) == [25, 26]


def test_zeros_that_alternate_for_minutes_are_removed_and_the_good_values_stay():
    points = [(t, 0 if t % 2 else 25 + t // 200) for t in range(600)]
    assert kept(points) == [v for _, v in points if v]


def test_a_series_that_begins_and_ends_with_zero_keeps_its_good_values():
    assert kept([(0, 0), (1, 22), (2, 0), (3, 22), (4, 0)]) == [22, 22]


def test_a_temperature_that_passes_through_zero_is_kept():
    points = [(60.0 * k, v) for k, v in enumerate([2, 1, 0, 0, -1, -2, -1, 0, 1])]
    assert kept(points) == [v for _, v in points]


def test_a_zero_at_the_end_of_a_long_hold_is_removed_though_the_mean_slope_is_small():
    # 25 K in an hour is no fast change, but an item that reports on change would have said 24, 23…
    assert kept([(0, 25), (3600, 0), (3601, 25)]) == [25, 25]


def test_a_cold_morning_after_a_warm_evening_is_no_glitch():
    points = [(0, 45), (1, 45), (2, None), (50_000, 22), (50_001, 0), (50_002, 22)]
    done = without_glitches(series(points), TEMPERATURE, SETTINGS)
    np.testing.assert_array_equal(done.series.value, [45, 45, np.nan, 22, 22])


def test_a_single_spike_is_removed_and_a_lasting_step_is_kept():
    assert kept([(0, 25), (1, 25), (2, 60), (3, 25), (4, 25)]) == [25, 25, 25, 25]
    step = [(t, 25) for t in range(100)] + [(t, 60) for t in range(100, 200)]
    assert kept(step) == [v for _, v in step]


def test_values_out_of_the_physical_range_are_removed():
    done = without_glitches(
        series([(0, 10.0), (1, 7e5), (2, -7e5)]), column("path_feedrate"), SETTINGS
    )
    assert done.series.value.tolist() == [10.0]
    assert done.rule.tolist() == ["", "out_of_range", "out_of_range"]


@pytest.mark.parametrize("wild", [1_000_000 + 1000, 0, 17])
def test_a_counter_that_jumps_or_falls_back_loses_only_the_wild_values(wild):
    points = [(t, 1000 + t) for t in range(200)]
    points[100] = (100, wild)
    expected = [v for t, v in points if t != 100]
    assert kept(points, column("total_time")) == expected


def test_a_counter_that_was_reset_counts_on():
    points = [(t, 9000 + t) for t in range(100)] + [(t, t - 100) for t in range(100, 300)]
    assert kept(points, column("total_time")) == [v for _, v in points]


def test_feed_that_jumps_to_zero_is_kept():
    assert kept([(0, 30), (1, 0), (2, 30)], column("path_feedrate")) == [30, 0, 30]


values = st.one_of(
    st.none(), st.sampled_from([0.0, 21.0, 25.0, 26.0, 80.0, 999.0]), st.floats(-40, 220)
)
steps = st.floats(0.01, 4000)


@given(st.lists(st.tuples(steps, values), min_size=1, max_size=60), st.sampled_from(
    ["spindle_temperature", "total_time", "path_feedrate"]))  # fmt: skip
@settings(deadline=None)
def test_cleaning_twice_changes_nothing_and_nothing_is_invented(drawn, name):
    time = np.cumsum([dt for dt, _ in drawn])
    raw = series(list(zip(time, (v for _, v in drawn), strict=True)))
    once = without_glitches(raw, column(name), SETTINGS)
    twice = without_glitches(once.series, column(name), SETTINGS)
    assert not twice.removed.any()
    assert len(once.series.time) + once.removed.sum() == len(raw.time)
    np.testing.assert_array_equal(once.series.value, raw.value[~once.removed])
    assert ((once.rule != "") == once.removed).all()
