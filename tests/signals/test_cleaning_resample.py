import numpy as np
from cleaning_records import NS, series
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.signals.cleaning.habits import Habit
from pipeline.signals.cleaning.position_control import position_control
from pipeline.signals.cleaning.resample import (
    grid,
    held,
    linear,
    on_spans,
    removed_holes,
    resampled,
)
from pipeline.signals.cleaning.settings import CleanSettings

SETTINGS = CleanSettings()
TODAY = 1_600_000_000 * NS  # where a float64 no longer tells nanoseconds apart


def ns(*seconds):
    return np.array([round(s * NS) for s in seconds], dtype=np.int64)


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
    found = resampled(position, "linear", ns(1800), Habit(typical_s=1.0), SETTINGS)
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
@settings(deadline=None)
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


def test_a_moving_c_axis_engages_and_a_turning_spindle_releases():
    angle = [(0, 0.0), (100, 40.0), (101, 90.0), (300, 0.0)]
    speed = [(0, 0.0), (50, 400.0), (60, 0.0), (500, 3.0), (600, 300.0)]
    found = control(angle, speed, [55, 99, 100, 400, 550, 600])
    assert found == [0, 0, 1, 1, 1, 0]


def test_an_angle_that_changes_while_the_spindle_turns_engages_nothing():
    assert control([(0, 0.0), (5, 77.0)], [(0, 800.0)], [6]) == [0]


def test_a_jump_of_the_angle_to_zero_engages_nothing():
    assert control([(0, 90.0), (20, 0.0)], [(0, 300.0), (10, 0.0)], [30]) == [0]


def test_a_motion_that_only_the_rate_shows_engages():
    rate = series([(0, 0.0), (7, 8.0), (8, 0.0)])
    found = control([(0, 0.0)], [(0, 300.0), (1, 0.0)], [6, 7, 20], rate=rate)
    assert found == [0, 1, 1]


def test_the_state_outlives_a_short_loss_and_not_a_night():
    angle = [(0, 0.0), (10, 90.0), (20, None), (80, 0.0), (100, None), (50_000, 0.0)]
    speed = [(0, 0.0), (20, None), (80, 0.0), (100, None), (50_000, 0.0)]
    found = control(angle, speed, [15, 50, 90, 200, 49_999, 50_000])
    np.testing.assert_array_equal(found, [1, 1, 1, np.nan, np.nan, 0])


def test_the_state_is_brought_over_from_the_day_before():
    assert control([(0, 0.0)], [(0, 0.0)], [5], initial=1.0) == [1]
