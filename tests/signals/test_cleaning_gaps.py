import numpy as np
from cleaning_records import NS, series

from pipeline.signals.cleaning.gaps import (
    Gap,
    continuous,
    instances,
    item_silences,
    missing_sequences,
    silences,
    unavailable,
)
from pipeline.signals.cleaning.habits import Habit, counted_intervals, habit
from pipeline.signals.cleaning.settings import CleanSettings

SETTINGS = CleanSettings()


def ns(*seconds):
    return np.array([round(s * NS) for s in seconds], dtype=np.int64)


def habit_of(time):
    return habit(counted_intervals(time, SETTINGS.off_after_s))


def test_unavailable_lasts_until_the_next_value():
    found = unavailable("a", series([(0, 1), (5, None), (7, None), (60, 2), (90, None)]))
    assert [(g.start // NS, g.end and g.end // NS) for g in found] == [(5, 60), (90, None)]


def test_habit_is_the_median_and_the_long_interval():
    time = np.cumsum(np.r_[np.full(2000, NS), 4 * NS, np.full(2000, NS)]).astype(np.int64)
    found = habit_of(time)
    assert 1.0 <= found.typical_s <= 2 ** (1 / 8)  # a bin of an eighth of an octave
    assert 1.0 <= found.long_s <= 2.0
    assert found.steady


def test_counted_intervals_of_two_files_add_up():
    a, b = ns(0, 1, 2, 4), ns(4, 8, 9)
    both = counted_intervals(np.r_[a, b[1:]], 900)
    assert (counted_intervals(a, 900) + counted_intervals(b, 900) == both).all()


def test_an_item_on_change_has_no_habit_and_a_clock_has_one():
    rng = np.random.default_rng(1)
    on_change = np.cumsum(rng.lognormal(2, 2, 3000) * NS).astype(np.int64)
    clock = np.cumsum(rng.normal(1.05, 0.01, 3000) * NS).astype(np.int64)
    assert not habit_of(on_change).steady
    assert habit_of(clock).steady


def test_an_item_that_follows_the_work_is_not_steady_however_regular_the_work():
    tool_changes = np.cumsum(np.random.default_rng(2).normal(60, 5, 2000) * NS).astype(np.int64)
    assert not habit_of(tool_changes).steady


def test_a_log_that_falls_silent_is_a_gap_and_its_habitual_pauses_are_none():
    time = ns(*range(0, 100), *range(400, 500))
    (gap,) = silences(time, Habit(typical_s=1, long_s=2, steady=True), SETTINGS, None)
    assert (gap.start // NS, gap.end // NS, gap.data_item) == (99, 400, None)


def test_a_steady_item_that_is_silent_while_others_speak_is_a_gap():
    clock = series([(t, t) for t in [*range(100), *range(200, 300)]])
    steady = Habit(typical_s=1, long_s=2, steady=True)
    (gap,) = item_silences("clock", clock, [], steady, SETTINGS)
    assert (gap.start // NS, gap.end // NS, gap.data_item) == (99, 200, "clock")
    lax = Habit(typical_s=1, long_s=2, steady=False)
    assert item_silences("clock", clock, [], lax, SETTINGS) == []
    whole = Gap(start=99 * NS, end=200 * NS, data_item=None, cause="silence")
    assert item_silences("clock", clock, [whole], steady, SETTINGS) == []


def test_a_changed_instance_is_a_gap():
    (gap,) = instances(ns(0, 1, 5, 6), np.array([7, 7, 8, 8], np.uint64), np.ones(4, bool))
    assert (gap.start // NS, gap.end // NS, gap.cause) == (1, 5, "instance")


def test_a_missing_sequence_number_is_a_gap_near_the_top_of_64_bits():
    top = 2**64 - 1
    sequence = np.array([*range(top - 20, top - 5), *range(top - 3, top)], dtype=np.uint64)
    time = ns(*range(len(sequence)))
    given, instance = np.ones(len(sequence), bool), np.full(len(sequence), 1, np.uint64)
    (gap,) = missing_sequences(time, sequence, instance, given)
    assert (gap.start // NS, gap.end // NS, gap.cause) == (14, 15, "sequence")


def test_a_record_that_is_a_choice_from_the_stream_has_no_sequence_gaps():
    n = 50
    found = missing_sequences(
        ns(*range(n)), np.arange(n, dtype=np.uint64) * 7, np.ones(n, np.uint64), np.ones(n, bool)
    )
    assert found == []


def test_numbers_that_go_on_prove_that_a_silence_lost_nothing():
    gap = Gap(start=1 * NS, end=50 * NS, data_item=None, cause="silence")
    time, instance, given = ns(0, 1, 50), np.ones(3, np.uint64), np.ones(3, bool)
    assert continuous(gap, time, np.array([4, 5, 6], np.uint64), instance, given)
    assert not continuous(gap, time, np.array([4, 5, 7], np.uint64), instance, given)
    assert not continuous(gap, time, np.array([4, 5, 6], np.uint64), instance, ~given)
