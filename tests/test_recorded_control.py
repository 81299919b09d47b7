"""The control of two real machines, found from their logs and judged on runs it never saw.

NIST / MTC box data package: two Hurco mills, logs of line numbers, and the programs that ran.
"""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.app.fleet import collect, use_fleet
from pipeline.stages.__main__ import run
from tests.small_project import ROOT, inside

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = [
    pytest.mark.skipif(
        not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"
    ),
    pytest.mark.slow,
]  # fmt: skip
MODEL = "data/models/hurco"
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
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    with inside(folder):
        hurco = replace(use_fleet("recorded"), machines=("hurco",), spindles=(), drives=(), cuts=())
        assert [files for _, _, files in collect(hurco, Path(RECORDINGS or ""))] == [23]
        run("compose", "conf", "params.yaml")
        for place in ("data/signals", MODEL, "data/metrics"):
            Path(place).mkdir(parents=True)
        signals, raw, model = "data/signals/hurco", "data/raw/hurco", f"{MODEL}/control.json"
        run("ingest@hurco", raw, signals)
        run("identify_control@hurco", signals, raw, model)
        run("validate_control@hurco", signals, raw, model, f"{MODEL}/control_validation.json",
            "data/metrics/hurco_control.json")  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def verdict(project):
    return json.loads((project / MODEL / "control_validation.json").read_text())


@pytest.fixture(scope="module")
def model(project):
    return json.loads((project / MODEL / "control.json").read_text())


def of_run(verdict):
    return {row["run"]: row for row in verdict["runs"]}


def test_every_judged_run_is_within_the_limit(project, verdict):
    judged = {
        name: row["error_percent"]
        for name, row in of_run(verdict).items()
        if row["role"] == "judged" and row["completed"]
    }
    assert judged == pytest.approx(JUDGED, abs=0.25)  # of a percent: what a change may move them
    assert max(map(abs, judged.values())) < 5.0
    assert verdict["passed"] is True
    metrics = json.loads((project / "data/metrics/hurco_control.json").read_text())
    assert (metrics["verdict"], metrics["runs_judged"]) == ("passed", 7)


def test_each_run_is_matched_with_the_program_that_ran(verdict):
    ran = {name: row["program"].split("_")[-1] for name, row in of_run(verdict).items()}
    box = {BOX.format(f"{n:02d}"): "REV-A OP2 (Front).NC" for n in range(6, 11)}
    assert ran == {
        **box,
        PLATE.format("01"): "PLATE-1.NC", PLATE.format("02"): "PLATE-2.NC",
        PLATE.format("03"): "PLATE-3.NC", PLATE.format("04"): "PLATE-5.NC",
        f"{PLATE.format('04')} (run 2)": "PLATE-4.NC", PLATE.format("05"): "PLATE-5.NC",
    }  # fmt: skip
    assert [name for name, row in of_run(verdict).items() if not row["completed"]] == [
        PLATE.format("04")
    ]


def test_runs_of_other_revisions_are_left_out_of_the_totals_with_the_reason(model, verdict):
    others = [BOX.format(f"{n:02d}") for n in range(1, 6)]
    assert [left["run"] for left in verdict["left_out"]] == others
    for left in verdict["left_out"]:
        assert "put the program that ran beside the log" in left["reason"]
    trained = {row["run"]: row["program"] for row in model["runs"]["training"]}
    assert {trained[name].split("_")[-1] for name in others} == {"REV-A OP2 (Front).NC"}


def test_a_path_over_its_feed_is_a_much_worse_estimate(verdict):
    for name in JUDGED:
        row = of_run(verdict)[name]
        assert row["naive_error_percent"] < -20, name
        assert abs(row["naive_error_percent"]) > 5 * abs(row["error_percent"]), name


def test_feeds_that_the_speeds_tell_are_worth_more_than_what_the_log_says(verdict):
    """Plate 05 was cut at other feeds than its program says, and its log says no override."""
    row = of_run(verdict)[PLATE.format("05")]
    assert row["recorded_override_only_error_percent"] > 10
    assert abs(row["error_percent"]) < 1
    assert row["feed_read_share"] > 0.8


def test_errors_are_given_for_each_type_of_block(verdict):
    for name in JUDGED:
        row = of_run(verdict)[name]
        assert {"rapid", "feed", "tool change", "spindle and M codes"} <= set(row["by_type"])
        for part in row["by_type"].values():
            assert part["error_percent"] is not None or part["measured_s"] <= 0
        parts = sum(part["measured_s"] for part in row["by_type"].values())
        # the parts begin at the first line that was polled
        assert 0.9 * row["measured_s"] < parts < row["measured_s"] + row["stops_s"] + 0.3


def test_what_the_logs_determine_has_an_interval_and_the_rest_a_remedy(model):
    parameters = model["parameters"]
    for stored in parameters.values():
        if stored["determined"]:
            assert stored["low"] <= stored["value"] <= stored["high"]
        else:
            assert stored["value"] is None
            assert stored["remedy"].startswith("log ")
    assert parameters["tool_change"]["value"] == pytest.approx(6.04, abs=0.1)
    assert parameters["rapid_speed Z@hurco02"]["value"] == pytest.approx(30000, rel=0.005)
    assert parameters["rapid_speed Z@hurco04"]["value"] == pytest.approx(20320, rel=0.005)
    assert parameters["rapid_speed Z@hurco04"]["how"] == "steady speeds in rapids"


def test_stops_of_the_operator_are_no_part_of_a_run(verdict):
    stops = {name: row["stops_s"] for name, row in of_run(verdict).items()}
    assert stops[PLATE.format("01")] == pytest.approx(174, abs=3)
    assert stops[BOX.format("07")] == pytest.approx(10, abs=1)
    assert stops[PLATE.format("05")] == 0.0
