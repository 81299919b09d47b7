"""The control of two real machines, found from their logs and judged on runs it never saw.

NIST / MTC box data package: two Hurco mills, logs of line numbers, and the programs that ran.
"""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.app.fleet import collect, use_fleet
from pipeline.schema.predictions import read_predictions
from pipeline.schema.store import read_json
from pipeline.schema.verdict import JudgedCase, Score, Verdict
from pipeline.stages.__main__ import run
from pipeline.submodels.control.submodel import FROM_SPEEDS, NAIVE, OVERRIDE_ONLY, TIME, WHOLE
from pipeline.twin.control import ControlModelFile
from tests.small_project import inside, with_conf

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = [
    pytest.mark.skipif(
        not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"
    ),
    pytest.mark.slow,
]  # fmt: skip
MODEL = "data/models/hurco/control"
BOX, PLATE = "logs/Box-OP2-Hurco02-{}of20.txt", "logs/Plate-Op1-Hurco04-{}of20.txt"
JUDGED = {
    BOX.format("06"): -2.0, BOX.format("07"): 4.2, BOX.format("08"): -2.3,
    BOX.format("09"): -2.4, BOX.format("10"): -1.8,
    f"{PLATE.format('04')} (run 2)": 0.8, PLATE.format("05"): -0.6,
}  # fmt: skip
"""Errors of the runs that are judged [%], as they were first found."""


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recorded-control")
    with_conf(folder, "recorded")
    with inside(folder):
        hurco = replace(use_fleet("recorded"), machines=("hurco",), submodels={}, optimised=())
        assert [files for _, _, files in collect(hurco, Path(RECORDINGS or ""))] == [23]
        run("compose", "conf", "params.yaml")
        signals, raw = "data/signals/hurco", "data/raw/hurco"
        run("ingest@hurco", raw, signals)
        run("identify_control@hurco", signals, raw, MODEL)
        run("judge_control@hurco", signals, raw, MODEL, "data/golden",
            "data/metrics/hurco_control.json")  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def verdict(project) -> Verdict:
    return read_json(project / MODEL / "verdict.json", Verdict)


@pytest.fixture(scope="module")
def model(project) -> ControlModelFile:
    return read_json(project / MODEL / "model.json", ControlModelFile)


def of_run(verdict: Verdict) -> dict[str, JudgedCase]:
    """Every run that was compared with a program, by its name."""
    return {case.case: case for case in verdict.cases if case.facts}


def value(case: JudgedCase, name: str):
    return case.facts[name].value


def whole(verdict: Verdict, role: str) -> dict[str, Score]:
    """Errors of the whole runs of a role."""
    scores = [s for s in verdict.of(TIME, role=role) if s.regime == WHOLE and s.group != "all"]
    return {score.group: score for score in scores}


def test_every_judged_run_is_within_the_limit(project, verdict):
    scores = whole(verdict, "held_out")
    judged = {name: score.mean_percent for name, score in scores.items()}
    assert judged == pytest.approx(JUDGED, abs=0.25)  # of a percent: what a change may move them
    assert max(map(abs, judged.values())) < 5.0
    assert all(score.status == "passed" for score in scores.values())
    assert (verdict.status, verdict.judged_role) == ("passed", "held_out")
    metrics = json.loads((project / "data/metrics/hurco_control.json").read_text())
    assert metrics["status"] == "passed"
    assert sum(value(run_, "completed") == "yes" for name, run_ in of_run(verdict).items()
               if name in judged) == 7  # fmt: skip


def test_each_run_is_matched_with_the_program_that_ran(verdict):
    ran = {name: value(run_, "program").split("_")[-1] for name, run_ in of_run(verdict).items()}
    box = {BOX.format(f"{n:02d}"): "REV-A OP2 (Front).NC" for n in range(6, 11)}
    assert ran == {
        **box,
        PLATE.format("01"): "PLATE-1.NC", PLATE.format("02"): "PLATE-2.NC",
        PLATE.format("03"): "PLATE-3.NC", PLATE.format("04"): "PLATE-5.NC",
        f"{PLATE.format('04')} (run 2)": "PLATE-4.NC", PLATE.format("05"): "PLATE-5.NC",
    }  # fmt: skip
    aborted = [n for n, run_ in of_run(verdict).items() if value(run_, "completed") == "no"]
    assert aborted == [PLATE.format("04")]


def test_runs_of_other_revisions_are_left_out_of_the_totals_with_the_reason(model, verdict):
    others = [BOX.format(f"{n:02d}") for n in range(1, 6)]
    assert [left.case for left in verdict.left_out] == others
    for left in verdict.left_out:
        assert "put the program that ran beside the log" in left.reason
    assert {model.programs[name].split("_")[-1] for name in others} == {"REV-A OP2 (Front).NC"}


def test_a_path_over_its_feed_is_a_much_worse_estimate(verdict):
    for name in JUDGED:
        run_ = of_run(verdict)[name]
        naive = value(run_, f"error of {NAIVE}")
        assert naive < -20, name
        assert abs(naive) > 5 * abs(value(run_, "error")), name


def test_feeds_that_the_speeds_tell_are_worth_more_than_what_the_log_says(verdict):
    """Plate 05 was cut at other feeds than its program says, and its log says no override."""
    run_ = of_run(verdict)[PLATE.format("05")]
    assert value(run_, f"error of {OVERRIDE_ONLY}") > 10
    assert abs(value(run_, "error")) < 1
    assert value(run_, "feed read from speeds") > 0.8


def test_errors_are_given_for_each_type_of_block(project, verdict):
    table = read_predictions(project / MODEL / "predictions.parquet")
    types = table[(table["quantity"] == TIME) & (table["regime"] != WHOLE)]
    for name in JUDGED:
        parts = types[types["case"] == name]
        assert {"rapid", "feed", "tool change", "spindle and M codes"} <= set(parts["regime"])
        compared = parts[parts["scored"] & (parts["measured"] > 0)]
        scored = {s.regime: s.mean_percent for s in verdict.of(TIME, group=name)}
        assert all(scored[regime] is not None for regime in compared["regime"])
        run_ = of_run(verdict)[name]
        measured, stops = value(run_, "measured"), value(run_, "stops")
        # the parts begin at the first line that was polled
        assert 0.9 * measured < parts["measured"].sum() < measured + stops + 0.3


def test_what_the_logs_determine_has_an_interval_and_the_rest_a_remedy(model):
    parameters = model.parameters[""]
    for stored in parameters.values():
        if stored.determined:
            low, high = stored.interval_95
            assert low <= stored.value <= high
        else:
            assert stored.value is None
            assert stored.remedy.startswith("log ")
    assert parameters["tool_change"].value == pytest.approx(6.04, abs=0.1)
    assert parameters["rapid_speed Z@hurco02"].value == pytest.approx(30000, rel=0.005)
    assert parameters["rapid_speed Z@hurco04"].value == pytest.approx(20320, rel=0.005)
    assert parameters["rapid_speed Z@hurco04"].method == FROM_SPEEDS == "steady speeds in rapids"


def test_stops_of_the_operator_are_no_part_of_a_run(verdict):
    stops = {name: value(run_, "stops") for name, run_ in of_run(verdict).items()}
    assert stops[PLATE.format("01")] == pytest.approx(174, abs=3)
    assert stops[BOX.format("07")] == pytest.approx(10, abs=1)
    assert stops[PLATE.format("05")] == 0.0
