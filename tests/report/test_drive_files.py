"""Files of the drives that are absent, broken, odd or hostile; and what changed since the last."""

import json
import shutil

import pytest
from drive_folders import (
    axis_document,
    drive_run,
    report,
    trace,
    with_drives,
    write_drive,
    write_drive_validation,
    write_traces,
)
from page_reader import outline, words
from report_folders import FLEET, empty_machine, machine

from pipeline.report.pages import write_report


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    root = tmp_path_factory.mktemp("drives")
    folders = with_drives(machine(root, "mill01", days=3))
    write_report([folders], FLEET, None, root / "out")
    return root


FILES = {"drive.json": "Parameters of axis X",
         "drive_validation.json": "servo/circle-20mm X 24.6",
         "drive_traces.parquet": "Modelled less measured, µm"}  # fmt: skip


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
    lost = {broken} | ({"drive_traces.parquet"} if broken == "drive_validation.json" else set())
    assert there == FILES.keys() - lost
    assert (f"{broken} was left out: not " in text) == (content is not None)


def test_columns_of_another_kind_are_said_not_raised(tmp_path):
    folders = with_drives(empty_machine(tmp_path, "m", "recorded"))
    write_traces(folders, [{**trace("a", "X", rows=2), "time_s": ["early", "late"]}])
    text = report(folders, tmp_path)
    assert "drive_traces.parquet was left out: its columns are not those" in text
    write_traces(folders, [{"axis": ["X"], "time_s": [0.0]}])
    assert "drive_traces.parquet was left out: has no column recording" in report(folders, tmp_path)


ODD = {
    "axes": {"X": {"parameters": {"mass": {"value": "x", "determined": True, "unit": 3}, "b": 1},
                   "friction_points": [1, {"velocity_mm_s": "x"}, {"velocity_mm_s": 3.0}],
                   "friction_curve": {"a": 1}, "methods": [{"error": True}, 4], "fit": [],
                   "recursive": {"time_s": [1, "x"], "value": [2]}, "command_unit": 7},
             "Y": [1, {"recording": {}, "role": 3, "force": 4, "following": [], "seconds": "x"}],
             "Z": None},
    "motor": [], "recordings": {"training": 3, "left_out": [5]}, "found_from": [],
    "limits": {"force_percent": "x"}, "passed": "yes", "reason": ["a"],
}  # fmt: skip


@pytest.mark.parametrize("content", ["{}", "[]", json.dumps(ODD), '{"axes": [1]}'])
def test_documents_of_another_shape_never_stop_the_report(built, tmp_path, content):
    shutil.copytree(built, tmp_path / "root")
    folders = empty_machine(tmp_path / "root", "mill01")
    for path in folders.models.rglob("*.json"):
        path.write_text(content)
    assert "What the machine did" in report(folders, tmp_path)


def test_text_from_files_stays_text(tmp_path):
    hostile = "<script>alert('x')</script>"
    folders = empty_machine(tmp_path, "m")
    write_drive(folders, axes={hostile: axis_document("X", command_unit=hostile)})
    write_drive_validation(folders, {hostile: [drive_run(hostile, 99.0, 1.0, reason=hostile)]})
    write_traces(folders, [trace(hostile, "X", rows=9) | {"axis": [hostile] * 9}])
    assert "alert" in report(folders, tmp_path)
    assert "script" not in [t for t, _ in outline(tmp_path / "out" / "m.html").tags]


def test_the_second_report_says_what_moved(tmp_path):
    folders = with_drives(empty_machine(tmp_path, "m"))
    write_report([folders], FLEET, None, tmp_path / "one")
    write_drive(folders, axes={"X": axis_document("X", 441.0)})
    write_drive_validation(folders, {"X": [drive_run("servo/circle-20mm", 5.2, 9.4)]})
    write_report([folders], FLEET, tmp_path / "one", tmp_path / "out")
    text = words(tmp_path / "out" / "m.html")
    assert "Parameter drive X mass 420 kg 441 kg +21.0 kg" in text
    assert "Error of the axes’ force, worst judged recording 6.20 % 5.20 % −1.00 %" in text
    assert "Axes judged in recordings 5 1 −4" in text


def test_two_runs_give_the_same_bytes(built, tmp_path):
    folders = with_drives(machine(tmp_path / "root", "mill01", days=3))
    for name in ("a", "b"):
        write_report([folders], FLEET, None, tmp_path / name)
    assert (tmp_path / "a/mill01.html").read_bytes() == (tmp_path / "b/mill01.html").read_bytes()
