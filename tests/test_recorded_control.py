"""The control of two real machines, found from their logs and judged on runs it never saw.

NIST / MTC box data package: two Hurco mills, logs of line numbers, and the programs that ran.
"""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest

from pipeline.app.fleet import collect, use_fleet
from pipeline.schema.golden import GoldenSets
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.__main__ import run
from pipeline.submodels.control.page import measured_time
from pipeline.submodels.control.submodel import NAIVE, OVERRIDE_ONLY, TIME
from pipeline.twin.control import WHOLE, ControlModelFile
from tests.shared import made_once
from tests.small_project import ROOT, inside

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = pytest.mark.skipif(
    not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"
)
MODEL = "data/models/hurco/control"
BOX, PLATE = "logs/Box-OP2-Hurco02-{}of20.txt", "logs/Plate-Op1-Hurco04-{}of20.txt"
JUDGED = {
    BOX.format("06"): -2.6, BOX.format("07"): 3.7, BOX.format("08"): -2.9,
    BOX.format("09"): -2.9, BOX.format("10"): -2.3,
    f"{PLATE.format('04')} (run 2)": 0.8, PLATE.format("05"): -0.3,
}  # fmt: skip
"""Errors of the runs that are judged [%], as they were first found."""


@pytest.fixture(
    scope="module",
    params=["no interval", pytest.param("with intervals", marks=pytest.mark.proof)],
)
def project(request, tmp_path_factory) -> Path:
    """Built from the logs; the fits that leave runs out take five of six seconds.

    They give the interval of a time, on which no test here rests but the last.
    """
    name = f"recorded-control-{request.param.split()[0]}"
    if request.param == "with intervals":
        return made_once(tmp_path_factory, name, build)
    with mock.patch("pipeline.submodels.control.submodel.time_bands", return_value={}):
        return made_once(tmp_path_factory, name, build)


def build(folder: Path) -> None:
    shutil.copytree(ROOT / "conf", folder / "conf")
    frozen = read_json(ROOT / "data/golden/hurco.json", GoldenSets)
    assert frozen.golden is not None and frozen.sealed is not None
    # the bars below were set on all runs, before two of them were sealed
    every = replace(frozen.golden, files=(*frozen.golden.files, *frozen.sealed.files))
    write_json(replace(frozen, golden=every, sealed=None), folder / "data/golden/hurco.json")
    with inside(folder):
        hurco = replace(use_fleet("recorded"), machines=("hurco",), submodels={}, optimised=())
        assert [files for _, _, files in collect(hurco, Path(RECORDINGS or ""))] == [23]
        run("compose", "conf", "params.yaml", "data/settings")
        signals, raw = "data/signals/hurco", "data/raw/hurco"
        run("ingest@hurco", raw, signals)
        run("identify_control@hurco", signals, raw, MODEL, "data/golden")
        run("judge_control@hurco", signals, raw, MODEL, "data/golden",
            "data/metrics/hurco_control.json", "data/plots/hurco_control")  # fmt: skip


@pytest.fixture(scope="module")
def verdict(project):
    return read_json(project / MODEL / "verdict.json", Verdict)


@pytest.fixture(scope="module")
def model(project):
    return read_json(project / MODEL / "model.json", ControlModelFile)


def of_run(verdict):
    """Facts of every run that was compared, by its name."""
    return {c.case: {n: f.value for n, f in c.facts.items()} for c in verdict.cases if c.facts}


def test_every_golden_run_is_within_the_limit(project, verdict):
    judged = {
        s.group: of_run(verdict)[s.group]["error"]
        for s in verdict.of(TIME, role="golden")
        if s.regime == WHOLE and s.group != "all"
    }
    assert judged == pytest.approx(JUDGED, abs=0.25)  # of a percent: what a change may move them
    assert max(map(abs, judged.values())) < 5.0
    assert (verdict.status, verdict.judged_role) == ("passed", "golden")
    metrics = json.loads((project / "data/metrics/hurco_control.json").read_text())
    assert metrics["status"] == "passed"
    # the aborted run of plate 04 is compared up to its last line and counts for nothing
    assert metrics["cases_judged"] == 8


def test_each_run_is_matched_with_the_program_that_ran(verdict):
    ran = {name: row["program"].split("_")[-1] for name, row in of_run(verdict).items()}
    box = {BOX.format(f"{n:02d}"): "REV-A OP2 (Front).NC" for n in range(6, 11)}
    assert ran == {
        **box,
        PLATE.format("01"): "PLATE-1.NC", PLATE.format("02"): "PLATE-2.NC",
        PLATE.format("03"): "PLATE-3.NC", PLATE.format("04"): "PLATE-5.NC",
        f"{PLATE.format('04')} (run 2)": "PLATE-4.NC", PLATE.format("05"): "PLATE-5.NC",
    }  # fmt: skip
    assert [name for name, row in of_run(verdict).items() if row["completed"] == "no"] == [
        PLATE.format("04")
    ]


def test_runs_of_other_revisions_are_left_out_of_the_totals_with_the_reason(model, verdict):
    others = [BOX.format(f"{n:02d}") for n in range(1, 6)]
    left_out = {left.case: left.reason for left in verdict.left_out}
    for name in others:
        assert "put the program that ran beside the log" in left_out[name]
    assert {model.programs[name].split("_")[-1] for name in others} == {"REV-A OP2 (Front).NC"}


def test_a_path_over_its_feed_is_a_much_worse_estimate(verdict):
    for name in JUDGED:
        row = of_run(verdict)[name]
        assert row[f"error of {NAIVE}"] < -20, name
        assert abs(row[f"error of {NAIVE}"]) > 5 * abs(row["error"]), name
    (skill,) = [s for s in verdict.skills if s.regime == WHOLE and s.baseline == NAIVE]
    assert skill.mae_interval_95[0] > 0.8


def test_feeds_that_the_speeds_tell_are_worth_more_than_what_the_log_says(verdict):
    """Plate 05 was cut at other feeds than its program says, and its log says no override."""
    row = of_run(verdict)[PLATE.format("05")]
    assert row[f"error of {OVERRIDE_ONLY}"] > 10
    assert abs(row["error"]) < 1
    assert row["feed read from speeds"] > 0.8


def test_errors_are_given_for_each_type_of_block(verdict):
    for name in JUDGED:
        row = of_run(verdict)[name]
        types = {s.regime: s for s in verdict.of(TIME, group=name) if s.regime != WHOLE}
        assert {"rapid", "feed", "tool change", "spindle and M codes"} <= set(types)
        # the parts begin at the first line that was polled
        parts = sum(measured_time(s) for s in types.values())
        assert 0.9 * row["measured"] < parts < row["measured"] + row["stops"] + 0.3


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
    assert parameters["rapid_speed Z@hurco04"].method == "steady speeds in rapids"


def test_what_one_mill_alone_determines_is_of_the_other_where_it_is_not_determined(model):
    """Hurco02 ran a spot drill: no chord, and arcs that are too slow for any limit."""
    parameters = model.parameters[""]
    for name in ("arc_acceleration XYZ", "cutting_acceleration XYZ"):
        assert parameters[f"{name}@hurco04"].determined
        assert parameters[f"{name}@hurco02"].method == "of hurco04, not determined here"
    slow, fast = (end.axes["X"] for end in model.ends["hurco02"])
    assert slow.arc_acceleration < 330 < 850 < fast.arc_acceleration
    used = model.control["hurco02"].axes
    assert 85 < used["X"].corner_jump < 300  # between the other's and the machine's file
    assert 20000 < used["Y"].rapid_speed < 30000  # as the rapids that both mills' speeds show
    assert "hurco04" not in model.ends or (
        model.ends["hurco04"][0].axes == model.control["hurco04"].axes
    )


def test_stops_of_the_operator_are_no_part_of_a_run(verdict):
    stops = {name: row["stops"] for name, row in of_run(verdict).items()}
    assert stops[PLATE.format("01")] == pytest.approx(174, abs=3)
    assert stops[BOX.format("07")] == pytest.approx(10, abs=1)
    assert stops[PLATE.format("05")] == 0.0


def test_times_have_an_interval_where_runs_were_left_out(model, request):
    fitted = request.node.callspec.params["project"] == "with intervals"
    assert bool(model.intervals) == fitted
    assert all(band.lower > 0 and band.upper > 0 for band in model.intervals.values())
