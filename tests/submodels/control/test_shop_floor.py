"""The control of the simulated shop floor, another machine than the twin's, is identified.

Its truth says what was done: runs, stops, overrides, times of tools.
"""

import json
import shutil
from pathlib import Path

import pytest

from pipeline.parameters import structure
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.shop.control.records import write_control
from pipeline.shop.parameters import ShopParameters
from pipeline.stages.__main__ import run
from pipeline.submodels.control.submodel import NAIVE, OVERRIDE_ONLY, TIME
from pipeline.twin.control import WHOLE, ControlModelFile
from tests.small_project import MACHINE, ROOT, inside, params, store

pytestmark = pytest.mark.proof


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """Logs and programs of one machine, ingested, identified and judged."""
    folder = tmp_path_factory.mktemp("shop-control")
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    shutil.copy(folder / "conf/fleet/simulated.yaml", folder / "conf/fleet/active.yaml")
    with inside(folder):
        run("compose", "conf", "params.yaml", "data/settings")
        values = params(folder)
        machine = values["machine"][MACHINE]
        floor = structure(values, f"machine.{MACHINE}.shop", ShopParameters)
        (folder / "truth.json").write_text(json.dumps(write_control(folder / "raw", floor)))
        machine["records"] = [
            r for r in machine["records"] if r["files"].startswith(("control/", "programs/"))
        ]
        store(folder, values)
        run(f"ingest@{MACHINE}", "raw", "signals")
        run(f"identify_control@{MACHINE}", "signals", "raw", "control", "golden")
        run(f"judge_control@{MACHINE}", "signals", "raw", "control", "golden", "metrics.json",
            "plots")  # fmt: skip
    return folder


def true_of(project):
    return json.loads((project / "truth.json").read_text())


def verdict_of(project):
    return read_json(project / "control/verdict.json", Verdict)


def runs_of(project):
    """Facts of every run that was compared, by its name, with its role and status."""
    verdict = verdict_of(project)
    found = {}
    for case in verdict.cases:
        if case.facts:
            (whole,) = [s for s in verdict.of(TIME, group=case.group) if s.regime == WHOLE] or [
                None
            ]
            status = "not judged" if whole is None else whole.status
            facts = {name: fact.value for name, fact in case.facts.items()}
            found[case.case] = {**facts, "role": case.role, "status": status}
    return found


def test_times_of_tools_and_rates_are_the_true_ones(project):
    found = read_json(project / "control/model.json", ControlModelFile).parameters[""]
    true = true_of(project)["parameters"]
    assert found["tool_change"].value == pytest.approx(true["tool_change"], abs=0.1)
    low, high = found["rapid_speed Z"].interval_95
    assert low <= true["z"]["rapid"] <= high
    # M1 answers after 0.08 s; whatever stops also checks that the axes are in position
    assert found["stop"].value == pytest.approx(true["codes"]["m1"], abs=0.1)
    codes = [true["codes"][name] for name in ("m8", "m9")]
    assert min(codes) - 0.1 < found["m_code"].value < max(codes) + 0.1


def test_judged_runs_are_predicted_within_two_percent(project):
    judged = [r for r in runs_of(project).values() if r["status"] != "not judged"]
    assert len(judged) == 2
    assert max(abs(r["error"]) for r in judged) < 2.0
    assert min(abs(r[f"error of {NAIVE}"]) for r in judged) > 20
    assert verdict_of(project).status == "passed"


def test_runs_are_matched_with_the_programs_that_the_truth_names(project):
    runs, stated = runs_of(project), true_of(project)["runs"]
    ran = {name: r["program"] for name, r in runs.items()}
    assert ran == {r["file"]: f"programs/{r['program']}.nc" for r in stated if r["program"]}
    [edited] = [r for r in stated if r["edited_from"]]
    assert [one.case for one in verdict_of(project).left_out] == [edited["file"]]
    aborted = [r["file"] for r in stated if not r["completed"]]
    assert [name for name, r in runs.items() if r["completed"] == "no"] == aborted


def test_measured_times_and_stops_are_the_true_ones(project):
    runs = runs_of(project)
    for stated in true_of(project)["runs"]:
        if not stated["program"] or not stated["completed"]:
            continue
        row = runs[stated["file"]]
        held = [stop["seconds"] for stop in (*stated["feed_holds"], *stated["rapid_stops"])]
        polls = 0.4 * (1 + len(held))  # two polls for each span, of a display that ramps
        assert row["stops"] == pytest.approx(sum(held), abs=polls)
        assert row["measured"] + row["stops"] == pytest.approx(stated["duration_s"], abs=polls)
        if stated["feed_override"][0][1] != 100.0:  # turned before the run: no log says it
            assert abs(row[f"error of {OVERRIDE_ONLY}"]) > 5
            assert abs(row["error"]) < 0.5
