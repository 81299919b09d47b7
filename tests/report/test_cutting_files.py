"""Files of the cut that are absent, broken, odd or hostile; and what changed since the last."""

import json
import shutil

import pytest
from cutting_folders import (
    coefficients,
    cut_parameter,
    cut_run,
    parameters,
    trace,
    with_cutting,
    write_cutting,
    write_cutting_traces,
    write_cutting_validation,
)
from drive_folders import report
from page_reader import outline, words
from report_folders import FLEET, empty_machine, machine, write_table

from pipeline.report.pages import write_report


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    root = tmp_path_factory.mktemp("cutting")
    folders = with_cutting(machine(root, "mill01", days=3))
    write_report([folders], FLEET, None, root / "out")
    return root


FILES = {"cutting.json": "Coefficients of the cut",
         "cutting_validation.json": "6-n6000f1200ap3ae25 6 000 0.100 3 9.4",
         "cutting_traces.parquet": "Angle of the spindle, °"}  # fmt: skip


@pytest.mark.parametrize("broken", FILES)
@pytest.mark.parametrize("content", [None, b"\x00no"], ids=["absent", "broken"])
def test_without_one_file_the_rest_stands(built, tmp_path, broken, content):
    shutil.copytree(built, tmp_path / "root")
    folders = empty_machine(tmp_path / "root", "mill01")
    path = folders.models / broken
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    text = report(folders, tmp_path)
    there = {name for name, said in FILES.items() if said in text}
    lost = {broken} | ({"cutting_traces.parquet"} if "validation" in broken else set())
    assert there == FILES.keys() - lost
    assert (f"{broken} was left out: not " in text) == (content is not None)


def test_columns_of_another_kind_are_said_not_raised(tmp_path):
    folders = with_cutting(empty_machine(tmp_path, "m", "recorded"))
    path = folders.models / "cutting_traces.parquet"
    write_table(path, {"recording": ["a", "a"], "angle_deg": ["early", "late"]})
    text = report(folders, tmp_path)
    assert "cutting_traces.parquet was left out: its columns are not those of traces" in text
    write_table(path, {"recording": ["a"]})
    text = report(folders, tmp_path)
    assert "cutting_traces.parquet was left out: has no column angle_deg" in text


ODD = {
    "parameters": {"K_tc": {"value": "x", "determined": True, "unit": 3, "interval_95": 4},
                   "K_te": {"value": 3.0, "determined": True, "interval_95": [2, "x"]},
                   "K_re": {"value": 3.0, "determined": "yes", "interval_95": [5, 1]}, "b": 1},
    "mean_force": [3], "correlation": {"names": ["a"], "matrix": [[1, 2], 3]}, "fit": [],
    "measuring_chain": {"x": 3, "y": {"a": 2, "b": {"value": None}}}, "tool": "flat",
    "methods": [{"method": "genetic", "rms_error_percent": True}, 4, {}], "method": 3,
    "recordings": [{"recording": {}, "role": 3, "speed_rpm": "x", "revolutions": []}, 5],
    "spindle": {"no_load": {"coefficients": {"p0": {"value": 1e300}, "p1": {}, "q": 3},
                            "range_rpm": [1, "x"], "points": [1, {"speed_rpm": -4,
                                                                  "power_W": 1e13}]},
                "specific_force": [], "recordings": 3, "reason": 5},
    "limits": {"rms_percent": "x"}, "passed": "yes", "reason": ["a"],
    "cross": [1, {"recording": 3, "from": 3, "components": []}], "machine": None,
}  # fmt: skip
ODD_ROWS = {
    "limits": [],
    "passed": False,
    "recordings": [
        {
            "recording": {},
            "role": 3,
            "components": {"x": 4, "y": {"measured": 3}},
            "plain": [],
            "conditions": 3,
        },
        {"role": "judged", "status": "failed", "components": {"x": {"rms_error_percent": True}}},
    ],
}


@pytest.mark.parametrize(
    "content", ["{}", "[]", json.dumps(ODD), json.dumps(ODD_ROWS), '{"recordings": {"a": 1}}']
)
def test_documents_of_another_shape_never_stop_the_report(built, tmp_path, content):
    shutil.copytree(built, tmp_path / "root")
    folders = empty_machine(tmp_path / "root", "mill01")
    for path in folders.models.rglob("*.json"):
        path.write_text(content)
    assert "What the machine did" in report(folders, tmp_path)


def test_text_from_files_stays_text(tmp_path):
    hostile = "<script>alert('x')</script>"
    folders = empty_machine(tmp_path, "m")
    lost = cut_parameter(None, hostile, reason=hostile)
    write_cutting(folders, parameters={hostile: lost}, material=hostile)
    run = {**cut_run(600, 99.0), "recording": hostile, "reason": hostile}
    write_cutting_validation(folders, [{**run, "plain": {"what": hostile}}])
    write_cutting_traces(folders, [{**trace(600), "recording": [hostile] * len(trace(600)[
        "angle_deg"])}])  # fmt: skip
    text = report(folders, tmp_path)
    assert text.count("alert") > 4
    assert "script" not in [t for t, _ in outline(tmp_path / "out" / "m.html").tags]


def second_report(tmp_path, factor: float, runout: float) -> str:
    folders = with_cutting(empty_machine(tmp_path, "m"))
    write_report([folders], FLEET, None, tmp_path / "one")
    grown = cut_parameter(runout, "um", 0.08)
    write_cutting(folders, parameters={**parameters(), **coefficients(0.04, factor),
                                       "runout": grown})  # fmt: skip
    write_cutting_validation(folders, [cut_run(1200, 11.0)])
    write_report([folders], FLEET, tmp_path / "one", tmp_path / "out")
    return words(tmp_path / "out" / "m.html").split("What changed since the last report")[-1]


def test_the_second_report_says_what_moved_and_what_that_means(tmp_path):
    text = second_report(tmp_path, 1.4, 14.0)
    # 12 % each way: 21 * 1.12 = 23.5 against 29.4 * 0.88 = 25.9; runout 12.3 against 12.9
    assert "Parameter cut K_te 21.0 N/mm 29.4 N/mm +8.40 N/mm" in text
    assert "Error of cutting forces (RMS), worst recording 14.2 % 11.0 % −3.20 %" in text
    assert "Cuts judged 2 1 −1" in text


@pytest.mark.parametrize(("factor", "worn"), [(1.4, True), (1.2, False), (0.7, False)])
def test_growth_counts_only_beyond_both_intervals(tmp_path, factor, worn):
    second_report(tmp_path, factor, 11.4)
    text = words(tmp_path / "out" / "m.html")
    said = "K_te grew by more than both intervals allow: look for an edge that has worn since"
    assert (said in text) == worn
    assert "runout grew" not in text


def test_grown_runout_sends_to_the_holder_and_shrunk_runout_to_nobody(tmp_path):
    second_report(tmp_path / "a", 1.0, 14.0)
    text = words(tmp_path / "a/out/m.html")
    assert "runout grew by more than both intervals allow: look for a tool that no longer" in text
    second_report(tmp_path / "b", 1.0, 8.0)
    assert "runout grew" not in words(tmp_path / "b/out/m.html")


def test_two_runs_give_the_same_bytes(tmp_path):
    folders = with_cutting(machine(tmp_path / "root", "mill01", days=3))
    for name in ("a", "b"):
        write_report([folders], FLEET, None, tmp_path / name)
    assert (tmp_path / "a/mill01.html").read_bytes() == (tmp_path / "b/mill01.html").read_bytes()
