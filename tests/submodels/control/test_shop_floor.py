"""The control of the simulated shop floor, another machine than the twin's, is identified.

Its truth says what was done: runs, stops, overrides, times of tools.
"""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from pipeline.parameters import structure
from pipeline.shop.control.records import write_control
from pipeline.shop.parameters import ShopParameters
from pipeline.stages.__main__ import run
from tests.small_project import MACHINE, ROOT, inside, params

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """Logs and programs of one machine, ingested, identified and judged."""
    folder = tmp_path_factory.mktemp("shop-control")
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    active = folder / "conf/fleet/active.yaml"
    active.unlink()
    active.symlink_to("simulated.yaml")
    with inside(folder):
        run("compose", "conf", "params.yaml")
        values = params(folder)
        machine = values["machine"][MACHINE]
        floor = structure(values, f"machine.{MACHINE}.shop", ShopParameters)
        (folder / "truth.json").write_text(json.dumps(write_control(folder / "raw", floor)))
        machine["records"] = [
            r for r in machine["records"] if r["files"].startswith(("control/", "programs/"))
        ]
        (folder / "params.yaml").write_text(yaml.safe_dump(values))
        run(f"ingest@{MACHINE}", "raw", "signals")
        run(f"identify_control@{MACHINE}", "signals", "raw", "control.json")
        run(f"validate_control@{MACHINE}", "signals", "raw", "control.json", "verdict.json",
            "metrics.json")  # fmt: skip
    return folder


def loaded(project, name):
    return json.loads((project / f"{name}.json").read_text())


def test_times_of_tools_and_rates_are_the_true_ones(project):
    found = loaded(project, "control")["parameters"]
    true = loaded(project, "truth")["parameters"]
    assert found["tool_change"]["value"] == pytest.approx(true["tool_change"], abs=0.1)
    z = found["rapid_speed Z"]
    assert z["low"] <= true["z"]["rapid"] <= z["high"]
    # M1 answers after 0.08 s; whatever stops also checks that the axes are in position
    assert found["stop"]["value"] == pytest.approx(true["codes"]["m1"], abs=0.1)
    codes = [true["codes"][name] for name in ("m8", "m9")]
    assert min(codes) - 0.1 < found["m_code"]["value"] < max(codes) + 0.1


def test_judged_runs_are_predicted_within_two_percent(project):
    verdict = loaded(project, "verdict")
    judged = [r for r in verdict["runs"] if r["role"] == "judged" and r["completed"]]
    assert len(judged) == 2
    assert max(abs(r["error_percent"]) for r in judged) < 2.0
    assert min(abs(r["naive_error_percent"]) for r in judged) > 20
    assert verdict["passed"] is True


def test_runs_are_matched_with_the_programs_that_the_truth_names(project):
    verdict = loaded(project, "verdict")
    ran = {r["run"]: r["program"] for r in verdict["runs"]}
    told = loaded(project, "truth")["runs"]
    assert ran == {r["file"]: f"programs/{r['program']}.nc" for r in told if r["program"]}
    [edited] = [r for r in told if r["edited_from"]]
    assert [left["run"] for left in verdict["left_out"]] == [edited["file"]]
    aborted = [r["file"] for r in told if not r["completed"]]
    assert [r["run"] for r in verdict["runs"] if not r["completed"]] == aborted


def test_measured_times_and_stops_are_the_true_ones(project):
    runs = {r["run"]: r for r in loaded(project, "verdict")["runs"]}
    for told in loaded(project, "truth")["runs"]:
        if not told["program"] or not told["completed"]:
            continue
        row = runs[told["file"]]
        held = [stop["seconds"] for stop in (*told["feed_holds"], *told["rapid_stops"])]
        polls = 0.4 * (1 + len(held))  # two polls for each span, of a display that ramps
        assert row["stops_s"] == pytest.approx(sum(held), abs=polls)
        assert row["measured_s"] + row["stops_s"] == pytest.approx(told["duration_s"], abs=polls)
        if told["feed_override"][0][1] != 100.0:  # turned before the run: the log does not say it
            assert abs(row["recorded_override_only_error_percent"]) > 5
            assert abs(row["error_percent"]) < 0.5
