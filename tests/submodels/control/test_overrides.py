"""What the operator did, recovered from polled logs of runs under known overrides and holds."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.gcode.moves import Kind
from pipeline.submodels.control.runs import (
    Run,
    Series,
    feed_of_lines,
    line_spans,
    operator_of,
    override_of_lines,
    plateau,
    steady_ratios,
)
from tests.submodels.control.part_programs import change, circles, long_cuts, moves_of, truth
from tests.submodels.control.polled_logs import (
    Operated,
    in_force,
    logged_runs,
    polled_log,
    wall_spans,
)

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
    knob = Series(
        time=np.array([0.0, 1.0, 2.0, 4.0]), value=np.array([50.0, 0.0, 80.0, 100.0])
    )  # fmt: skip
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
