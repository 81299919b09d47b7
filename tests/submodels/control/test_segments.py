"""Stretches between polls: they cover the run, keep waits apart, share out what was measured."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.moves import Kind
from pipeline.schema.model import Band
from pipeline.submodels.control.fit import planned
from pipeline.submodels.control.programs import Match
from pipeline.submodels.control.runs import Run, Series
from pipeline.submodels.control.segments import TOGETHER, WAITS, clusters, observe, shares
from pipeline.submodels.control.submodel import DWELL, MatchedRun, predicted
from pipeline.twin.control import WHOLE, planned_program, time_interval
from tests.submodels.control.part_programs import exciting, moves_of, rapids, truth
from tests.submodels.control.polled_logs import ALONE, Operated, Polling, logged_runs, polled_log

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


def test_no_segment_ends_at_the_programs_end(moves, tmp_path):
    """Its line shows while the last rapid still runs."""
    one = observed(moves, tmp_path)
    assert not (moves.kind[one.first] == Kind.END).any()


@pytest.mark.parametrize("period", [0.1, 0.4])
def test_the_latency_of_stamps_is_found_from_the_log(moves, tmp_path, period):
    polling = Polling(period=period)
    log = polled_log(moves, truth(), np.random.default_rng(3), ALONE, polling, begin=1.0)
    [run] = logged_runs(tmp_path / "log.parquet", log)
    assert run.latency == pytest.approx(period, rel=0.15)


def run_of(moves, folder, seed=5):
    log = polled_log(moves, truth(), np.random.default_rng(seed), ALONE, begin=1.0)
    [run] = logged_runs(folder / "log.parquet", log)
    one = observe(run, "part", moves, "", SHORTEST)
    return MatchedRun(match=Match(run=run, program="part"), observed=(one,))


BANDS = {name: Band(lower=0.01, upper=0.01, n=9, groups=3) for name in ("", WHOLE)}


def test_the_interval_of_a_measured_dwell_holds_the_latency_of_the_stamps(tmp_path):
    """G4 is exact to a tick of the control, its stamps to a poll at each end."""
    dwells = [line for k in range(3) for line in (f"G1 X{20 * (k % 2)} F1000", "G4 P700")]
    moves = moves_of(["G21 G90 G94", *rapids((50, 300)), *dwells, "G0 X0", "M30"], tmp_path)
    inside = []
    for seed in range(8):
        frame = predicted(run_of(moves, tmp_path, seed), {"": truth()}, BANDS).frame
        [row] = frame[frame["regime"] == DWELL].itertuples()
        assert row.exact == row.predicted == pytest.approx(2.1)
        assert 0.15 < row.high - row.predicted < 0.45
        inside.append(row.low < row.measured < row.high)
    assert sum(inside) >= 7
    plan = planned_program(moves, truth())
    low, high = time_interval(plan, BANDS, {})  # said of a program: the dwells to a tick each
    assert high - low == pytest.approx(0.02 * (plan.total - 2.1) + 6 * 0.001, abs=2e-3)


def test_the_interval_of_a_time_reaches_as_far_as_the_runs_leave_it_open(moves, tmp_path):
    """Of arcs, where arc acceleration is open; of rapids not."""
    slow, fast = (
        replace(truth(), axes={
            a: replace(x, arc_acceleration=400.0 * k) for a, x in truth().axes.items()
        })
        for k in (0.3, 3.0)
    )  # fmt: skip
    run = run_of(moves, tmp_path)
    narrow = predicted(run, {"": truth()}, BANDS).frame.set_index("regime")
    wide = predicted(run, {"": truth()}, BANDS, {"": (slow, fast)}).frame.set_index("regime")
    for regime in ("arc", WHOLE):
        assert wide.high[regime] > narrow.high[regime] + 1
        assert wide.low[regime] < narrow.low[regime]
    assert wide.high["rapid"] == narrow.high["rapid"]
    plan = planned_program(moves, truth())
    low, high = time_interval(plan, BANDS, {}, (slow, fast))
    assert low < planned_program(moves, fast).total
    assert high > planned_program(moves, slow).total
    assert time_interval(plan, BANDS, {})[1] < planned_program(moves, slow).total
