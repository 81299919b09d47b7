"""The verdict on the feed drives, alone and beside what else was judged of a machine."""

import pytest
from drive_folders import (
    RUNS,
    axis_document,
    drive_run,
    report,
    with_drives,
    write_drive,
    write_drive_validation,
)
from hypothesis import given
from hypothesis import strategies as st
from page_reader import words
from report_folders import FLEET, empty_machine, machine

from pipeline.charts.sections import PartVerdict, combined
from pipeline.report.pages import write_report


def judged(folders, tmp_path, runs, **other) -> str:
    """The head of the page of a machine with nothing but judged drives."""
    write_drive(folders, "".join(runs))
    write_drive_validation(folders, runs, **other)
    return report(folders, tmp_path).split("On this page")[0].split("The feed drives: what")[0]


def test_what_a_recording_does_not_show_is_a_dash_not_a_number(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    text = judged(folders, tmp_path, {"X": [drive_run("one", 4.0, None)]})
    assert "on 1 judged recording the force is wrong by up to 4.0 % (limit 10 %)." in text
    text = report(folders, tmp_path)
    assert "one X 24.6 4.0 38.4 passed" in text and "plain guess is speed over" not in text
    runs = {"X": [drive_run("one", 4.0, None), drive_run("two", None, 3.0)]}
    write_drive_validation(folders, runs)
    text = report(folders, tmp_path)
    assert "one X 24.6 4.0 38.4 – – – – – – passed" in text
    assert "two X 24.6 – – 412 1 604 3.0 3.9 12.4 71.0 passed" in text


def test_a_failed_axis_is_named_with_what_is_beyond_its_limit(tmp_path):
    runs = {"X": [drive_run("a", 3.0, 4.0)],
            "Z": [drive_run("a", 13.0, 4.0), drive_run("b", 3.0, 3.0)]}  # fmt: skip
    head = judged(empty_machine(tmp_path, "m", "recorded"), tmp_path, runs)
    assert "Failed The twin’s Z axis does not follow its records: on 1 of 2 judged recordings " in (
        head
    )
    assert "the force is wrong by up to 13 % (limit 10 %); X does." in head
    assert "following error" not in head.split("What to do now")[0]
    assert "Do not plan with the twin’s Z yet" in head


@pytest.mark.parametrize(
    ("runs", "other", "why"),
    [
        ({"X": [drive_run("a", 1.0, 1.0, "training")]}, {}, "every recording of X was learnt from"),
        ({"X": [drive_run("a", 1.0, 1.0, status="not judged")]}, {"passed": None}, "no recording"),
        ({"X": [drive_run("a", 1.0, 1.0)]}, {"passed": None, "reason": "Y was left out."},
         "Y was left out."),
        ({}, {}, "every recording of X was learnt from"),
    ],
)  # fmt: skip
def test_nobody_is_told_that_unjudged_drives_follow(tmp_path, runs, other, why):
    head = judged(empty_machine(tmp_path, "m", "recorded"), tmp_path, runs, **other)
    assert "No verdict" in head and f"The twin’s drives were not judged: {why}" in head
    assert "follow their" not in head and "follows its" not in head
    assert ".." not in head
    counts = other.get("reason") is not None
    assert ("On the judged recordings the force is wrong by up to 1.0 %" in head) == counts


def test_drives_that_fail_put_a_passed_machine_under_reservation(tmp_path):
    folders = with_drives(
        machine(tmp_path, "m", days=4), {**RUNS, "Y": [drive_run("a", 4.0, 31.0)]}
    )
    head = report(folders, tmp_path).split("What the machine did")[0]
    assert "Passed, with reservations" in head
    assert "Do not plan with the twin’s Y yet" in head
    assert "Following errors 31.0 % worst of judged recordings, axis Y, limit 15 %" in head


def test_the_index_carries_the_verdict_of_drives_alone(tmp_path):
    write_report([with_drives(empty_machine(tmp_path, "rig", "recorded"))], FLEET, None,
                 tmp_path / "out")  # fmt: skip
    text = words(tmp_path / "out" / "index.html")
    assert "1 machine: 1 passed." in text
    assert "the twin’s axes move as the machine’s do. The twin’s X, Y and Z axes follow" in text
    assert "spindle" not in words(tmp_path / "out" / "rig.html").split("What was read")[0].lower()


STATUSES = ("passed", "failed", "attention", "unknown")


@given(st.lists(st.sampled_from(STATUSES), min_size=1, max_size=4))
def test_the_whole_is_as_good_as_its_first_judged_part_and_no_better_than_the_rest(statuses):
    parts = [PartVerdict(status=s, sentence=f"s{i}", todo=f"t{i}") for i, s in enumerate(statuses)]
    whole, ranked = combined(parts)
    known = [s for s in statuses if s != "unknown"]
    expected = known[0] if known else "unknown"
    if expected == "passed" and "failed" in known:
        expected = "attention"
        assert whole.todo == f"t{statuses.index('failed')}"
    assert whole.status == expected
    assert sorted(p.sentence for p in ranked) == sorted(p.sentence for p in parts)


def test_why_a_run_failed_is_said_and_what_holds_for_the_axis_is_not_repeated(tmp_path):
    why = "no training recording of axis X has a reference"
    folders = empty_machine(tmp_path, "m", "recorded")
    write_drive(folders, axes={"X": axis_document("X", drive={"servo_reason": why})})
    write_drive_validation(folders, {"X": [
        drive_run("one", 14.0, None, reason=f"force 14 % > 10 %; {why}"),
        drive_run("two", 4.0, None, reason=why)]})  # fmt: skip
    text = report(folders, tmp_path)
    assert "one X 24.6 14.0 38.4 failed force 14 % > 10 % two X 24.6 4.0 38.4 passed –" in text
    assert text.count(why) == 1
