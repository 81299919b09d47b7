"""Gaps, glitches and resampling of one data item's time series."""

import numpy as np
import pytest
from cleaning_records import NS, series
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.signals.cleaning.day import position_control
from pipeline.signals.cleaning.gaps import (
    Gap,
    ReportingInterval,
    continuous,
    counted_intervals,
    instances,
    item_silences,
    missing_sequences,
    reporting_interval,
    silences,
    unavailable,
)
from pipeline.signals.cleaning.series import (
    grid,
    held,
    linear,
    on_spans,
    removed_holes,
    resampled,
    without_glitches,
)
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import column

SETTINGS = CleanSettings()


def ns(*seconds):
    return np.array([round(s * NS) for s in seconds], dtype=np.int64)


def interval_of(time):
    return reporting_interval(counted_intervals(time, SETTINGS.off_after_s))


def test_unavailable_lasts_until_the_next_value():
    found = unavailable("a", series([(0, 1), (5, None), (7, None), (60, 2), (90, None)]))
    assert [(g.start // NS, g.end and g.end // NS) for g in found] == [(5, 60), (90, None)]


def test_the_reporting_interval_is_the_median_and_the_long_interval():
    time = np.cumsum(np.r_[np.full(2000, NS), 4 * NS, np.full(2000, NS)]).astype(np.int64)
    found = interval_of(time)
    assert 1.0 <= found.typical_s <= 2 ** (1 / 8)  # a bin of an eighth of an octave
    assert 1.0 <= found.long_s <= 2.0
    assert found.steady


def test_counted_intervals_of_two_files_add_up():
    a, b = ns(0, 1, 2, 4), ns(4, 8, 9)
    both = counted_intervals(np.r_[a, b[1:]], 900)
    assert (counted_intervals(a, 900) + counted_intervals(b, 900) == both).all()


def test_an_item_on_change_has_no_steady_interval_and_a_clock_has_one():
    rng = np.random.default_rng(1)
    on_change = np.cumsum(rng.lognormal(2, 2, 3000) * NS).astype(np.int64)
    clock = np.cumsum(rng.normal(1.05, 0.01, 3000) * NS).astype(np.int64)
    assert not interval_of(on_change).steady
    assert interval_of(clock).steady


def test_an_item_that_follows_the_work_is_not_steady_however_regular_the_work():
    tool_changes = np.cumsum(np.random.default_rng(2).normal(60, 5, 2000) * NS).astype(np.int64)
    assert not interval_of(tool_changes).steady


def test_a_log_that_falls_silent_is_a_gap_and_its_usual_pauses_are_none():
    time = ns(*range(0, 100), *range(400, 500))
    (gap,) = silences(time, ReportingInterval(typical_s=1, long_s=2, steady=True), SETTINGS, None)
    assert (gap.start // NS, gap.end // NS, gap.data_item) == (99, 400, None)


def test_a_steady_item_that_is_silent_while_others_speak_is_a_gap():
    clock = series([(t, t) for t in [*range(100), *range(200, 300)]])
    steady = ReportingInterval(typical_s=1, long_s=2, steady=True)
    (gap,) = item_silences("clock", clock, [], steady, SETTINGS)
    assert (gap.start // NS, gap.end // NS, gap.data_item) == (99, 200, "clock")
    lax = ReportingInterval(typical_s=1, long_s=2, steady=False)
    assert item_silences("clock", clock, [], lax, SETTINGS) == []
    whole = Gap(start=99 * NS, end=200 * NS, data_item=None, cause="silence")
    assert item_silences("clock", clock, [whole], steady, SETTINGS) == []


def test_a_changed_instance_is_a_gap():
    (gap,) = instances(ns(0, 1, 5, 6), np.array([7, 7, 8, 8], np.uint64))
    assert (gap.start // NS, gap.end // NS, gap.cause) == (1, 5, "instance")


def test_a_missing_sequence_number_is_a_gap_near_the_top_of_64_bits():
    top = 2**64 - 1
    sequence = np.array([*range(top - 20, top - 5), *range(top - 3, top)], dtype=np.uint64)
    time = ns(*range(len(sequence)))
    (gap,) = missing_sequences(time, sequence, np.full(len(sequence), 1, np.uint64))
    assert (gap.start // NS, gap.end // NS, gap.cause) == (14, 15, "sequence")


def test_a_record_that_is_a_choice_from_the_stream_has_no_sequence_gaps():
    n = 50
    sequence = np.arange(n, dtype=np.uint64) * 7
    assert missing_sequences(ns(*range(n)), sequence, np.ones(n, np.uint64)) == []


def test_numbers_that_go_on_prove_that_a_silence_lost_nothing():
    gap = Gap(start=1 * NS, end=50 * NS, data_item=None, cause="silence")
    time, instance, nothing = ns(0, 1, 50), np.ones(3, np.uint64), np.zeros(0, np.uint64)
    assert continuous(gap, time, np.array([4, 5, 6], np.uint64), instance)
    assert not continuous(gap, time, np.array([4, 5, 7], np.uint64), instance)
    assert not continuous(gap, ns(), nothing, nothing)


TEMPERATURE = column("spindle_temperature")


STEP = [(t, 25) for t in range(100)] + [(t, 60) for t in range(100, 200)]
RESET = [(t, 9000 + t) for t in range(100)] + [(t, t - 100) for t in range(100, 300)]
ZEROS = [(t, 0 if t % 2 else 25 + t // 200) for t in range(600)]
THROUGH_ZERO = [(60.0 * k, v) for k, v in enumerate([2, 1, 0, 0, -1, -2, -1, 0, 1])]


def counter(wild):
    return [(t, wild if t == 100 else 1000 + t) for t in range(200)]


def but(points, *removed):
    """Values of the points without those that are ``removed``."""
    return [v for _, v in points if v not in removed]


@pytest.mark.parametrize(
    ("name", "points", "left"),
    [
        ("spindle_temperature", [(0, 25), (1, 0), (2, 25)], [25, 25]),
        ("spindle_temperature", [(0, 25), (1, 0), (2, 0), (3, 0), (4, 26)], [25, 26]),
        ("spindle_temperature", ZEROS, but(ZEROS, 0)),
        ("spindle_temperature", [(0, 0), (1, 22), (2, 0), (3, 22), (4, 0)], [22, 22]),
        ("spindle_temperature", THROUGH_ZERO, but(THROUGH_ZERO)),
        # 25 K in an hour is no fast change, but an item that reports on change would have said 24
        ("spindle_temperature", [(0, 25), (3600, 0), (3601, 25)], [25, 25]),
        ("spindle_temperature", [(0, 25), (1, 25), (2, 60), (3, 25), (4, 25)], [25] * 4),
        ("spindle_temperature", STEP, but(STEP)),
        *(("total_time", counter(wild), but(counter(wild), wild)) for wild in (1_001_000, 0, 17)),
        ("total_time", RESET, but(RESET)),
        ("path_feedrate", [(0, 30), (1, 0), (2, 30)], [30, 0, 30]),
    ],
    ids=["zero", "zeros", "zeros for minutes", "zero at both ends", "through zero",
         "zero after a hold", "spike", "lasting step", "counter jumps", "counter falls to 0",
         "counter falls", "counter is reset", "feed stops"],
)  # fmt: skip
def test_what_cannot_be_true_is_removed_and_all_else_stays(name, points, left):
    done = without_glitches(series(points), column(name), SETTINGS)
    assert done.series.value.tolist() == left


def test_a_cold_morning_after_a_warm_evening_is_no_glitch():
    points = [(0, 45), (1, 45), (2, None), (50_000, 22), (50_001, 0), (50_002, 22)]
    done = without_glitches(series(points), TEMPERATURE, SETTINGS)
    np.testing.assert_array_equal(done.series.value, [45, 45, np.nan, 22, 22])


def test_values_out_of_the_physical_range_are_removed():
    done = without_glitches(
        series([(0, 10.0), (1, 7e5), (2, -7e5)]), column("path_feedrate"), SETTINGS
    )
    assert done.series.value.tolist() == [10.0]
    assert done.rule.tolist() == ["", "out_of_range", "out_of_range"]


values = st.one_of(
    st.none(), st.sampled_from([0.0, 21.0, 25.0, 26.0, 80.0, 999.0]), st.floats(-40, 220)
)
steps = st.floats(0.01, 4000)


@given(st.lists(st.tuples(steps, values), min_size=1, max_size=60), st.sampled_from(
    ["spindle_temperature", "total_time", "path_feedrate"]))  # fmt: skip
@settings(deadline=None, max_examples=50)
def test_cleaning_twice_changes_nothing_and_nothing_is_invented(drawn, name):
    time = np.cumsum([dt for dt, _ in drawn])
    raw = series(list(zip(time, (v for _, v in drawn), strict=True)))
    once = without_glitches(raw, column(name), SETTINGS)
    twice = without_glitches(once.series, column(name), SETTINGS)
    assert not twice.removed.any()
    assert len(once.series.time) + once.removed.sum() == len(raw.time)
    np.testing.assert_array_equal(once.series.value, raw.value[~once.removed])
    assert ((once.rule != "") == once.removed).all()


TODAY = 1_600_000_000 * NS  # where a float64 no longer tells nanoseconds apart


def test_a_value_is_held_until_the_next_and_not_known_before_the_first():
    found = held(series([(1, 5), (3, 7)]), ns(0, 1, 2, 3, 9))
    np.testing.assert_array_equal(found, [np.nan, 5, 5, 7, 7])


def test_words_are_held_and_none_where_not_known():
    found = held(series([(1, "READY"), (3, None)]), ns(0, 2, 3, 4))
    assert found.tolist() == [None, "READY", None, None]


def test_nothing_is_held_across_what_is_not_known():
    clean = series([(0, 5), (10, 6)]).unknown_at(ns(4))
    np.testing.assert_array_equal(held(clean, ns(3, 4, 9, 10)), [5, np.nan, np.nan, 6])
    np.testing.assert_array_equal(linear(clean, ns(3, 4, 9, 10), 100), [5, np.nan, np.nan, 6])


def test_a_line_joins_neighbours_and_not_values_far_apart():
    points = series([(0, 0), (2, 4), (100, 8)])
    np.testing.assert_array_equal(linear(points, ns(1, 2, 50, 100), 3), [2, 4, 4, 8])


def test_the_line_is_exact_at_todays_nanoseconds():
    base = series([(0, 0.0), (1, 1.0)])
    late = type(base)(time=base.time + TODAY, value=base.value, fresh=base.fresh)
    assert linear(late, ns(0.25) + TODAY, 2)[0] == 0.25


def test_an_axis_that_stood_for_an_hour_does_not_creep():
    position = series([(0, 10.0), (3600, 50.0)])
    found = resampled(position, "linear", ns(1800), typical_s=1.0, settings=SETTINGS)
    assert found.tolist() == [10.0]


def test_the_grid_covers_only_stretches_in_which_the_machine_was_on():
    spoken = ns(0.5, 1.5, 3.2, 5000.0, 5001.0)
    spans = on_spans(spoken, SETTINGS)
    at = grid(spans, 0, 86400 * NS, 1.0)
    np.testing.assert_array_equal(at // NS, [1, 2, 3, 5000, 5001])


@given(
    st.lists(st.floats(0, 200), min_size=1, max_size=30, unique=True),
    st.lists(st.floats(0, 220), min_size=1, max_size=30),
)
@settings(deadline=None, max_examples=50)
def test_held_equals_a_plain_search_backwards(times, asked):
    times = sorted(times)
    points = series([(t, float(k)) for k, t in enumerate(times)])
    found = held(points, ns(*asked))
    for one, value in zip(ns(*asked), found, strict=True):
        earlier = [k for k, t in enumerate(points.time) if t <= one]
        assert value == earlier[-1] if earlier else np.isnan(value)


def test_a_short_run_of_removed_values_is_bridged_and_a_long_one_is_a_hole():
    raw = series([(0, 25), (1, 0), (2, 25), (3, 0), (100, 0), (200, 25)])
    removed = np.array([False, True, False, True, True, False])
    assert (removed_holes(raw, removed, 60.0) // NS).tolist() == [3]


def control(angle, speed, at, **more):
    state = position_control(series(angle), series(speed), SETTINGS, **more)
    return held(state, ns(*at)).tolist()


@pytest.mark.parametrize(
    ("angle", "speed", "rate", "at", "expected"),
    [
        ([(0, 0.0), (100, 40.0), (101, 90.0), (300, 0.0)],
         [(0, 0.0), (50, 400.0), (60, 0.0), (500, 3.0), (600, 300.0)], None,
         [55, 99, 100, 400, 550, 600], [0, 0, 1, 1, 1, 0]),
        ([(0, 0.0), (5, 77.0)], [(0, 800.0)], None, [6], [0]),
        ([(0, 90.0), (20, 0.0)], [(0, 300.0), (10, 0.0)], None, [30], [0]),
        ([(0, 0.0)], [(0, 300.0), (1, 0.0)], [(0, 0.0), (7, 8.0), (8, 0.0)], [6, 7, 20], [0, 1, 1]),
    ],
    ids=["moves and turns", "angle while it turns", "jump to zero", "only the rate shows it"],
)  # fmt: skip
def test_what_engages_position_control_and_what_releases_it(angle, speed, rate, at, expected):
    assert control(angle, speed, at, rate=None if rate is None else series(rate)) == expected


def test_the_state_outlives_a_short_loss_and_not_a_night():
    angle = [(0, 0.0), (10, 90.0), (20, None), (80, 0.0), (100, None), (50_000, 0.0)]
    speed = [(0, 0.0), (20, None), (80, 0.0), (100, None), (50_000, 0.0)]
    found = control(angle, speed, [15, 50, 90, 200, 49_999, 50_000])
    np.testing.assert_array_equal(found, [1, 1, 1, np.nan, np.nan, 0])


def test_the_state_is_brought_over_from_the_day_before():
    assert control([(0, 0.0)], [(0, 0.0)], [5], initial=1.0) == [1]
