"""A control judged on runs: errors, stops, what is not judged, and the naive estimate beside it."""

from dataclasses import replace

import numpy as np
import pytest
from pipeline.submodels.control.submodel import (WAIT, ControlLimits, control_metrics, control_verdict, naive_times)

from pipeline.gcode.moves import Kind
from pipeline.signals.ingest import MachineIdentity
from pipeline.submodels.control.programs import match
from pipeline.submodels.control.records import ControlRecords, observations
from pipeline.twin.program import planned_program
from tests.submodels.control.part_programs import exciting, moves_of, truth
from tests.submodels.control.polled_logs import ALONE, Operated, logged_runs, polled_log

RECORDS = ControlRecords(logs="*", programs="*", training=("train*",))
IDENTITY = MachineIdentity(name="mill", origin="simulated")
LIMITS = ControlLimits(total_percent=9.0)
POLLS = 0.3
"""Both ends of a run are seen up to a poll late [s]."""


@pytest.fixture(scope="module")
def moves(tmp_path_factory):
    return moves_of(exciting(), tmp_path_factory.mktemp("programs"))


@pytest.fixture
def judge(moves, tmp_path):
    """The verdict on runs of the program ``part``, by name, under ``control``."""

    def judged(runs, control=None, ran=None, limits=LIMITS, programs=None):
        programs = {"part": moves} if programs is None else programs
        matches = []
        for seed, (name, operated) in enumerate(runs.items()):
            rng = np.random.default_rng(seed)
            log = polled_log(moves, ran or truth(), rng, operated, begin=1.0)
            [run] = logged_runs(tmp_path / "log.parquet", log, name=name)
            matches.append(match(run, programs))
        found = observations(matches, RECORDS, programs, 1.0)
        controls = {"": control or truth()}
        return control_verdict(matches, found, controls, RECORDS, IDENTITY, limits)

    return judged


def total(moves, operated=ALONE):
    return planned_program(moves, truth(), operated.overrides(moves)).total


def test_the_true_control_is_right_but_for_polling(judge, moves):
    document = judge({"train": ALONE, "new": Operated(feed={0: 60.0})})
    for row, operated in zip(document["runs"], (ALONE, Operated(feed={0: 60.0})), strict=True):
        assert row["measured_s"] == pytest.approx(total(moves, operated), abs=POLLS)
        assert row["predicted_s"] == pytest.approx(total(moves, operated), rel=0.001)
        assert abs(row["error_percent"]) < 100 * POLLS / row["measured_s"] + 0.1
    assert [row["role"] for row in document["runs"]] == ["training", "judged"]
    assert document["passed"] is True
    assert document["left_out"] == []


def test_errors_are_those_of_the_times_beside_them(judge):
    [row] = judge({"new": Operated(feed={0: 80.0})})["runs"]
    pairs = [
        (row["error_percent"], row["predicted_s"], row["measured_s"]),
        (row["naive_error_percent"], row["naive_s"], row["measured_s"]),
        *(
            (part["error_percent"], part["predicted_s"], part["measured_s"])
            for part in row["by_type"].values()
        ),
    ]
    for error, predicted, measured in pairs:
        rounding = 100 * 0.01 / measured + 0.005  # times are rounded to 0.01 s
        assert error == pytest.approx(100 * (predicted / measured - 1), abs=rounding)


def test_types_add_up_to_the_run(judge):
    [row] = judge({"new": ALONE})["runs"]
    parts = row["by_type"].values()
    # segments begin at the first line that a poll saw
    assert sum(p["measured_s"] for p in parts) == pytest.approx(row["measured_s"], abs=POLLS)
    assert sum(p["predicted_s"] for p in parts) == pytest.approx(row["predicted_s"], abs=0.05)


def test_holds_of_the_operator_are_stops_and_no_error(judge, moves):
    [row] = judge({"new": Operated(holds=((40.0, 12.0), (90.0, 30.0)))})["runs"]
    assert row["stops_s"] == pytest.approx(42.0, abs=2 * POLLS)
    assert row["measured_s"] == pytest.approx(total(moves), abs=3 * POLLS)


def test_waiting_at_m1_beyond_a_moment_is_the_operators(judge, moves):
    """The machine stands 20 s at each M1 where 0.6 s is planned, and the log calls it active."""
    waited = replace(truth(), auxiliary=replace(truth().auxiliary, stop=20.0))
    [row] = judge({"new": ALONE}, ran=waited)["runs"]
    many = int((moves.kind == Kind.STOP).sum())
    beyond = 20.0 - truth().auxiliary.stop - WAIT
    assert row["stops_s"] == pytest.approx(many * beyond, abs=many * 0.1)
    assert row["measured_s"] == pytest.approx(total(moves) + many * WAIT, abs=many * 0.1 + POLLS)


def test_a_feed_that_only_the_speeds_tell_is_an_error_without_them(judge):
    [row] = judge({"new": Operated(feed={0: 50.0})})["runs"]
    assert row["feed_read_share"] > 0.5
    assert abs(row["error_percent"]) < 0.3
    assert row["recorded_override_only_error_percent"] < -10


def test_simple_estimates_are_far_off(judge):
    [row] = judge({"new": ALONE})["runs"]
    assert row["naive_error_percent"] < -40
    assert abs(row["error_percent"]) < 0.5


def test_a_naive_time_is_the_path_over_the_feed(moves):
    naive = naive_times(moves, np.full(len(moves), 0.5), 12000.0)
    cut, rapid = moves.kind == Kind.FEED, moves.kind == Kind.RAPID
    np.testing.assert_allclose(naive[cut], moves.length[cut] / (moves.feed[cut] / 120), rtol=1e-12)
    np.testing.assert_allclose(naive[rapid], moves.length[rapid] / 200, rtol=1e-12)
    assert (naive[~cut & ~rapid & (moves.kind != Kind.ARC)] == 0).all()


def test_a_slow_control_fails_and_the_worst_run_decides(judge, moves):
    slow = replace(truth(), auxiliary=replace(truth().auxiliary, tool_change=8.0))
    document = judge({"train": ALONE, "a": ALONE, "b": Operated(feed={0: 40.0})}, control=slow)
    errors = {row["run"]: row["error_percent"] for row in document["runs"]}
    late = 6 * (8.0 - truth().auxiliary.tool_change)
    assert errors["a"] == pytest.approx(100 * late / total(moves), abs=0.3)
    assert errors["a"] > LIMITS.total_percent > errors["b"] > 0
    assert document["passed"] is False
    metrics = control_metrics(document)
    assert metrics["verdict"] == "failed"
    assert metrics["runs_judged"] == 2
    assert metrics["worst_error_percent"] == errors["a"]
    assert metrics["mean_error_percent"] == round((errors["a"] + errors["b"]) / 2, 2)


def test_at_the_limit_a_run_passes(judge):
    slow = replace(truth(), auxiliary=replace(truth().auxiliary, tool_change=8.0))
    error = judge({"a": ALONE}, control=slow)["runs"][0]["error_percent"]
    at, below = (ControlLimits(total_percent=error - less) for less in (0.0, 0.01))
    assert judge({"a": ALONE}, control=slow, limits=at)["passed"] is True
    assert judge({"a": ALONE}, control=slow, limits=below)["passed"] is False


@pytest.mark.parametrize("runs", [{"train": ALONE}, {"new": Operated(abort=100.0)}, {}])
def test_without_a_run_to_judge_there_is_no_verdict(judge, runs):
    document = judge(runs)
    assert document["passed"] is None
    assert control_metrics(document) == {"verdict": "not judged", "runs_judged": 0}


def test_an_aborted_run_is_compared_up_to_its_last_line(judge, moves):
    [row] = judge({"new": Operated(abort=100.0)})["runs"]
    assert not row["completed"]
    assert 95 < row["measured_s"] <= 100 + POLLS
    assert abs(row["error_percent"]) < 100 * POLLS / 95


def test_runs_of_no_program_and_of_another_revision_are_left_out_with_the_reason(judge, moves):
    shorter = replace(moves, line=moves.line - 1)
    for programs in ({}, {"other": shorter}):
        document = judge({"new": ALONE}, programs=programs)
        assert document["runs"] == []
        assert document["passed"] is None
        [left] = document["left_out"]
        assert left["run"] == "new"
        assert left["reason"].startswith("new: no program of the machine fits")
