"""Stretches between polls: they cover the run, keep waits apart, share out what was measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.moves import Kind
from pipeline.submodels.control.fit import planned
from pipeline.submodels.control.runs import Run, Series
from pipeline.submodels.control.segments import TOGETHER, WAITS, clusters, observe, shares
from pipeline.twin.control import planned_program
from tests.submodels.control.part_programs import exciting, moves_of, truth
from tests.submodels.control.polled_logs import ALONE, Operated, logged_runs, polled_log

SHORTEST = 1.0


@pytest.fixture(scope="module")
def moves(tmp_path_factory):
    return moves_of(exciting(), tmp_path_factory.mktemp("programs"))


def observed(moves, tmp_path, operated=ALONE):
    log = polled_log(moves, truth(), np.random.default_rng(3), operated, begin=1.0)
    [run] = logged_runs(tmp_path / "log.parquet", log)
    return observe(run, "part", moves, "", SHORTEST)


def test_segments_follow_one_another_from_the_first_line_to_the_end(moves, tmp_path):
    one = observed(moves, tmp_path)
    assert one.after[-1] == len(moves)
    np.testing.assert_array_equal(one.first[1:], one.after[:-1])
    np.testing.assert_array_equal(one.begin[1:], one.end[:-1])
    assert (one.after > one.first).all()
    assert one.end[-1] == one.run.end
    assert one.measured.sum() == pytest.approx(one.end[-1] - one.begin[0])


def test_short_segments_are_those_of_waits_and_before_them(moves, tmp_path):
    one = observed(moves, tmp_path)
    waits = np.isin(moves.kind, WAITS)
    has_wait = np.array(
        [waits[first:after].any() for first, after in zip(one.first, one.after, strict=True)]
    )
    before_wait = np.append(has_wait[1:], True)
    short = one.end - one.begin < SHORTEST
    assert not (short & ~has_wait & ~before_wait).any()
    assert has_wait.sum() > 20


def test_durations_are_the_planned_ones_but_for_polling(moves, tmp_path):
    """Under the true control; each end of a segment is up to a poll late, a quarter at most."""
    one = observed(moves, tmp_path)
    error = one.measured - planned(one, truth())
    assert np.abs(error).max() < 0.25
    assert abs(error.mean()) < 0.02  # late at both ends alike


def test_holds_are_not_measured(moves, tmp_path):
    held = Operated(holds=((30.0, 8.0), (100.0, 20.0)))
    one = observed(moves, tmp_path, held)
    assert np.abs(one.measured - planned(one, truth())).max() < 0.4  # and two polls of a hold
    assert one.end[-1] - one.begin[0] - one.measured.sum() == pytest.approx(28.0, abs=0.4)


def test_an_aborted_run_ends_where_its_last_line_began(moves, tmp_path):
    one = observed(moves, tmp_path, Operated(abort=80.0))
    until = int(one.after[-1])
    assert until < len(moves)
    assert one.end[-1] <= one.run.end
    assert planned_program(moves, truth()).time[:until].sum() < 80.0


def test_types_share_what_was_measured_and_what_was_predicted(moves, tmp_path):
    one = observed(moves, tmp_path)
    times = planned_program(moves, truth()).time
    parts = shares(one, times)
    measured = sum(part.measured for part in parts.values())
    predicted = sum(part.predicted for part in parts.values())
    assert measured == pytest.approx(one.measured.sum(), rel=1e-12)
    covered = slice(one.first[0], one.after[-1])
    assert predicted == pytest.approx(times[covered].sum(), rel=1e-12)
    of_type = times[covered][moves.kind[covered] == Kind.TOOL_CHANGE].sum()
    assert parts["tool change"].predicted == pytest.approx(of_type, rel=1e-12)
    assert set(parts) == {"rapid", "feed", "arc", "tool change", "spindle and M codes"}


def test_a_segment_that_is_predicted_to_take_no_time_is_shared_evenly(moves, tmp_path):
    one = observed(moves, tmp_path)
    parts = shares(one, np.zeros(len(moves)))
    assert sum(part.measured for part in parts.values()) == pytest.approx(
        one.measured.sum(), rel=1e-12
    )


def test_neighbours_are_in_one_cluster_and_runs_in_none_together(moves, tmp_path):
    one = observed(moves, tmp_path)
    found = clusters([one, one])
    many = len(one.measured)
    assert (found[:TOGETHER] == 0).all()
    assert found[TOGETHER] == 1
    assert not set(found[:many]) & set(found[many:])
    assert np.bincount(found).max() == TOGETHER
    assert len(clusters([])) == 0


@given(
    lines=st.lists(st.integers(-1, 500), min_size=2, max_size=40),
    completed=st.booleans(),
    shortest=st.floats(0.0, 10.0),
)
def test_whatever_lines_a_log_shows_segments_have_rows_and_time(moves, lines, completed, shortest):
    run = Run(
        recording="log", number=1, start=0.0, end=len(lines) + 1.0, completed=completed,
        line=Series(time=np.arange(len(lines)) + 0.5, value=np.array(lines, dtype=float)),
    )  # fmt: skip
    one = observe(run, "part", moves, "", shortest)
    assert (one.after >= one.first).all()
    assert (one.measured >= 0).all()
    assert one.measured.sum() <= run.end - run.start + 1e-9
    assert np.isfinite(planned(one, truth())).all()
