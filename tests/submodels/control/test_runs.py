"""Runs in a recording: when they start and end, what was held, what a log may leave out."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.moves import Kind
from pipeline.submodels.control.runs import (
    Run,
    Series,
    activities,
    feed_of_lines,
    joined,
    line_spans,
    operator_of,
    override_of_lines,
    plateau,
    read_runs,
    steady_ratios,
    stopped_within,
)
from tests.submodels.control.part_programs import change, circles, long_cuts, moves_of, truth
from tests.submodels.control.polled_logs import (
    ITEMS,
    Operated,
    in_force,
    logged_runs,
    polled_log,
    wall_spans,
    write_log,
)

LINES = [(1.0, 10.0), (2.0, 11.0), (3.0, 12.0), (4.0, 13.0)]


def read(path, **said):
    return read_runs(write_log(said, path / "log.parquet"), ITEMS, "log.txt")


def test_several_runs_of_one_file_are_numbered(tmp_path):
    states = [(1.0, "ACTIVE"), (2.5, "STOPPED"), (3.0, "ACTIVE"), (5.0, "PROGRAM_COMPLETED")]
    first, second = read(tmp_path, exec=states, ln=[*LINES, (5.0, 14.0)])
    assert [first.name, second.name] == ["log.txt", "log.txt (run 2)"]
    assert first.line.value.tolist() == [10, 11]
    assert second.line.value.tolist() == [11, 12, 13, 14]


def test_the_line_left_from_the_run_before_is_no_line_of_the_next(tmp_path):
    states = [(0.0, "ACTIVE"), (2.5, "STOPPED"), (3.0, "ACTIVE"), (6.0, "PROGRAM_COMPLETED")]
    lines = [(0.5, 80.0), (1.0, 90.0), (3.5, 7.0), (4.0, 8.0)]
    assert read(tmp_path, exec=states, ln=lines)[1].line.value.tolist() == [7, 8]


def test_a_recording_without_states_is_one_run_that_was_not_completed(tmp_path):
    [run] = read(tmp_path, ln=LINES)
    assert (run.start, run.end, run.completed) == (0.0, 3.0, False)


def test_what_became_unavailable_is_no_number(tmp_path):
    states = [(0.0, "ACTIVE"), (4.0, "PROGRAM_COMPLETED")]
    [run] = read(tmp_path, exec=states, ln=[*LINES, (3.5, np.nan)], vpath=[(1.0, np.nan)])
    assert run.line.value.tolist() == [10, 11, 12, 13]
    assert len(run.feed.time) == len(run.tool.time) == len(run.rapid_override.time) == 0


@pytest.mark.parametrize("lines", [[], [(1.0, 10.0)]], ids=["no line", "one line"])
def test_a_recording_that_says_nothing_of_lines_has_no_run(tmp_path, lines):
    assert read(tmp_path, exec=[(0.0, "ACTIVE"), (4.0, "STOPPED")], ln=lines) == []


@pytest.mark.parametrize("signal", ["line", "execution"])
def test_a_mapping_without_what_is_needed_is_refused_in_one_sentence(tmp_path, signal):
    path = write_log({"ln": LINES}, tmp_path / "log.parquet")
    items = {name: item for name, item in ITEMS.items() if name != signal}
    with pytest.raises(ValueError, match=rf"^mapping.signals names no data item for {signal}, "):
        read_runs(path, items, "log.txt")


WORDS = st.sampled_from(
    ["ACTIVE", "FEED_HOLD", "OPTIONAL_STOP", "STOPPED", "PROGRAM_COMPLETED", "READY", ""]
)


@given(st.lists(WORDS, min_size=1, max_size=25))
def test_runs_and_holds_are_those_of_a_walk_second_by_second(words):
    """Each second is in no run, active or held, as the word in force and the run it lies in say."""
    expected, running = [], False
    for word in words:
        held = word in ("FEED_HOLD", "OPTIONAL_STOP")
        running = word == "ACTIVE" or (running and held)
        expected.append((running, running and held))
    said = [(float(k), word) for k, word in enumerate(words)]
    found = list(activities(said, float(len(words))))
    second = np.arange(len(words)) * 1.0
    within = stopped_within(joined([(a.start, a.end) for a in found]), second, second + 1)
    held = stopped_within(joined([h for a in found for h in a.held]), second, second + 1)
    assert [(bool(w), bool(h)) for w, h in zip(within, held, strict=True)] == expected
    done = [a.completed for a in found if a.end < len(words)]
    assert done == [words[int(a.end)] == "PROGRAM_COMPLETED" for a in found if a.end < len(words)]


def test_a_series_keeps_its_value_until_the_next():
    series = Series(time=np.array([1.0, 2.0]), value=np.array([5.0, 6.0]))
    times = np.array([0.9, 1.0, 1.9, 2.0, 9.0])
    assert series.at(times, before=-1.0).tolist() == [-1, 5, 5, 6, 6]
    polled = series.polled()
    assert np.allclose(np.diff(polled.time), 0.15)
    assert set(polled.value[polled.time < 2.0]) == {5.0}


MOMENT = st.integers(0, 40)
SPANS = st.lists(st.tuples(MOMENT, MOMENT).map(lambda s: (min(s), max(s))), max_size=8)


def seconds(spans):
    """The whole seconds that lie in any of the spans."""
    return {k for first, last in spans for k in range(first, last)}


@given(SPANS)
def test_joined_spans_cover_the_same_seconds_in_order_and_apart(spans):
    found = joined(spans)
    assert seconds(found) == seconds(spans)
    assert all(before[1] < after[0] for before, after in pairwise(found))


@given(SPANS, st.lists(st.tuples(MOMENT, MOMENT), max_size=6))
def test_time_held_between_two_moments_is_counted_second_by_second(spans, pairs):
    begin = np.array([min(p) for p in pairs], dtype=float)
    end = np.array([max(p) for p in pairs], dtype=float)
    held = stopped_within(joined(spans), begin, end)
    covered = seconds(spans)
    expected = [len(covered & set(range(min(p), max(p)))) for p in pairs]
    np.testing.assert_allclose(held, expected, atol=1e-12)  # sums of whole numbers


@given(SPANS, st.floats(-5, 45), st.floats(-5, 45), st.floats(-5, 45))
def test_time_held_adds_up_over_neighbouring_stretches(spans, a, b, c):
    a, b, c = sorted((a, b, c))
    held = stopped_within(joined(spans), np.array([a, b, a]), np.array([b, c, c]))
    assert abs(held[0] + held[1] - held[2]) < 1e-9
    assert (held >= -1e-12).all() and (held <= np.array([b - a, c - b, c - a]) + 1e-9).all()


TEXT = [
    "%", "G21 G90 G94",
    *change(1, 3000), *long_cuts((600, 1200, 900)),
    *change(2, 5000), *long_cuts((800, 400)), *circles(15, (700,)),
    "M5", "M30", "%",
]  # fmt: skip
SECOND = TEXT.index("T2 M6") + 1
EXACT = 0.004
"""A plateau's width: readings on it differ by no more than this share."""


@pytest.fixture(scope="module")
def moves(tmp_path_factory):
    return moves_of(TEXT, tmp_path_factory.mktemp("programs"))


def run_of(moves, tmp_path, operated, seed=2):
    log = polled_log(moves, truth(), np.random.default_rng(seed), operated, begin=1.0)
    [run] = logged_runs(tmp_path / "log.parquet", log)
    return run


def cutting_lines(moves):
    return np.flatnonzero(np.isfinite(feed_of_lines(moves)))


@pytest.mark.parametrize("percent", [50.0, 85.0, 120.0])
def test_a_feed_override_that_is_never_said_is_read_from_the_feeds_reached(
    moves, tmp_path, percent
):
    run = run_of(moves, tmp_path, Operated(feed={0: percent}))
    assert not len(run.feed_override.time)
    found = operator_of(run, moves)
    cuts = cutting_lines(moves)
    np.testing.assert_allclose(found.feed[cuts], percent / 100, rtol=EXACT)
    assert found.feed_read == (len(cuts) - 1) / len(cuts)  # all but the arc
    np.testing.assert_array_equal(found.said, 1.0)


def test_an_override_turned_and_said_between_two_tools_holds_from_there(moves, tmp_path):
    run = run_of(moves, tmp_path, Operated(feed={0: 70.0, SECOND: 110.0}, said_from=SECOND))
    found = operator_of(run, moves)
    cuts = cutting_lines(moves)
    expected = in_force({0: 70.0, SECOND: 110.0}, cuts)
    np.testing.assert_allclose(found.feed[cuts], expected, rtol=EXACT)
    np.testing.assert_allclose(found.said[cuts], in_force({SECOND: 110.0}, cuts), rtol=1e-9)


def test_a_feed_edited_at_the_control_is_read_though_the_log_says_another(moves, tmp_path):
    edited = replace(moves, feed=np.where(moves.tool == 2, moves.feed * 0.8, moves.feed))
    run = run_of(edited, tmp_path, Operated(feed={0: 100.0}, said_from=1))
    found = operator_of(run, moves)
    cuts = np.unique(moves.line[moves.kind == Kind.FEED])
    by_tool = np.where(cuts > SECOND, 0.8, 1.0)
    np.testing.assert_allclose(found.feed[cuts], by_tool, rtol=EXACT)
    np.testing.assert_allclose(found.said, 1.0, rtol=1e-12)  # a mean over the time of a line


def test_the_rapid_override_is_that_of_the_time_of_each_line(moves, tmp_path):
    run = run_of(moves, tmp_path, Operated(rapid={0: 50.0, SECOND: 25.0}))
    found = operator_of(run, moves)
    lines = np.arange(1, len(found.rapid))
    # polls see a line late and pass over some; the last one is over when it is seen
    far = (np.abs(lines - SECOND) > 2) & (lines < lines[-1])
    expected = in_force({0: 50.0, SECOND: 25.0}, lines)
    np.testing.assert_allclose(found.rapid[1:][far], expected[far], rtol=1e-9)


def test_a_program_of_arcs_alone_is_read_on_its_arcs(tmp_path):
    text = ["%", "G21 G90 G94", *change(1, 3000), *circles(20, (600, 900)), "M5", "M30", "%"]
    moves = moves_of(text, tmp_path, "arcs")
    found = operator_of(run_of(moves, tmp_path, Operated(feed={0: 60.0})), moves)
    np.testing.assert_allclose(found.feed[cutting_lines(moves)], 0.6, rtol=EXACT)


def test_without_feeds_the_override_that_is_said_holds(moves, tmp_path):
    run = run_of(moves, tmp_path, Operated(feed={0: 100.0, SECOND: 60.0}, said_from=SECOND))
    nothing = Series(time=np.empty(0), value=np.empty(0))
    found = operator_of(replace(run, feed=nothing), moves)
    cuts = cutting_lines(moves)
    np.testing.assert_allclose(found.feed[cuts], in_force({SECOND: 60.0}, cuts), rtol=1e-9)
    assert found.feed_read == 0.0


def test_a_spindle_that_turns_slower_than_programmed_is_seen(moves, tmp_path):
    run = run_of(moves, tmp_path, Operated())
    slower = Series(time=run.speed.time, value=run.speed.value * 0.9)
    found = operator_of(replace(run, speed=slower), moves)
    turning = moves.line[(moves.direction != 0) & (moves.kind == Kind.FEED)]
    np.testing.assert_allclose(found.spindle[turning], 0.9, rtol=1e-9)


def test_holds_are_stops_as_long_as_they_were_but_for_polling(moves, tmp_path):
    holds = ((20.0, 7.0), (45.0, 3.0))
    log = polled_log(moves, truth(), np.random.default_rng(2), Operated(holds=holds), begin=1.0)
    [run] = logged_runs(tmp_path / "log.parquet", log)
    first = min(time for said in log.values() for time, _ in said)  # is 0 of the recording
    wall = np.array(wall_spans(holds)) + 1.0 - first
    late = np.array(operator_of(run, moves).stops) - wall
    # each end of a hold is seen by the next poll, up to 0.15 s + 3 x jitter later
    assert ((late >= -1e-6) & (late < 0.2)).all()


LINE_RUN = Run(
    recording="log", number=1, start=0.0, end=10.0, completed=True,
    line=Series(time=np.array([0.0, 4.0, 8.0]), value=np.array([1.0, 2.0, 4.0])),
)  # fmt: skip


def zeros(moves, *, feed=None, rapid=None):
    series = [
        Series(time=np.array(x)[:, 0], value=np.array(x)[:, 1]) if x else LINE_RUN.tool
        for x in (feed, rapid)
    ]
    run = replace(LINE_RUN, feed_override=series[0], rapid_override=series[1])
    return operator_of(run, moves).stops


def test_an_override_at_zero_stops_only_lines_that_heed_it(tmp_path):
    """Line 2 is a rapid, 1, 3 and 4 cut: each stands where its own override is at 0."""
    text = ["G21 G94 G1 X10 F600", "G0 X200", "G1 X180", "G1 X150"]
    moves = moves_of(text, tmp_path)
    knob = [(0.0, 100.0), (5.0, 0.0), (6.0, 100.0)]
    assert zeros(moves, rapid=knob) == ((5.0, 6.0),)
    early = [(0.0, 100.0), (1.0, 0.0), (2.0, 100.0)]
    assert zeros(moves, feed=early) == ((1.0, 2.0),)
    assert zeros(moves, rapid=[(0.0, 100.0), (8.5, 0.0), (9.0, 100.0)]) == ()
    assert zeros(moves, feed=[(0.0, 100.0), (9.0, 0.0)]) == ((9.0, 10.0),)  # until the end


def test_the_mean_over_a_line_leaves_out_the_time_at_zero():
    """Line 1 lasts 4 s: 1 s at 50 %, 1 s at 0, 2 s at 80 %; then 70 = (50 + 2 x 80) / 3."""
    knob = Series(time=np.array([0.0, 1.0, 2.0, 4.0]), value=np.array([50.0, 0.0, 80.0, 100.0]))
    mean = override_of_lines(LINE_RUN, knob, 6)
    np.testing.assert_allclose(mean, [0.7, 0.7, 1.0, 1.0, 1.0, 1.0], rtol=1e-12)


def test_without_a_line_of_the_program_nothing_was_overridden():
    knob = Series(time=np.array([0.0]), value=np.array([50.0]))
    np.testing.assert_array_equal(override_of_lines(LINE_RUN, knob, 1), [1.0])
    assert [len(part) for part in line_spans(LINE_RUN, 1)] == [0, 0, 0]


def test_a_plateau_is_the_highest_level_that_readings_share():
    level = plateau(np.array([0.4] * 20 + [0.8] * 8 + [0.801] * 2 + [2.1, 2.4]))
    assert level == pytest.approx(0.8)
    assert plateau(np.array([0.8] * 5)) is None  # under a second
    assert plateau(np.linspace(0.1, 1.0, 40)) is None
    assert plateau(np.array([])) is None


def test_readings_count_only_where_the_feed_stays_and_its_line_is_cut(moves, tmp_path):
    run = run_of(moves, tmp_path, Operated())
    lines, ratio = steady_ratios(run, moves)
    straight = set(moves.line[moves.kind == Kind.FEED].tolist())
    assert set(lines.tolist()) <= straight
    # of the readings that agree with the one before, all but those on the way up are the feed
    assert np.mean(np.abs(ratio - 1) < EXACT) > 0.95
    assert len(lines) > 100


def test_a_reading_that_is_older_than_its_line_does_not_count(tmp_path):
    """The line of the cut is shown at 4 s while the speed is still that of the rapid before."""
    moves = moves_of(["G21 G90 G94", "G0 X100", "G1 X180 F600"], tmp_path)
    rapid, cut = 20.0, 10.0  # mm/s
    run = replace(
        LINE_RUN,
        line=Series(time=np.array([0.0, 4.0]), value=np.array([2.0, 3.0])),
        feed=Series(time=np.array([0.0, 4.25, 9.0]), value=np.array([rapid, cut, cut])),
    )
    lines, ratio = steady_ratios(run, moves)
    assert set(lines.tolist()) == {3}
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-12)
