"""The verdict on cutting forces, alone and beside what else was judged of a machine."""

import pytest
from cutting_folders import (
    LIMITS,
    cut_run,
    name_of,
    with_cutting,
    write_cutting,
    write_cutting_validation,
)
from drive_folders import report
from hypothesis import given
from hypothesis import strategies as st
from page_reader import words
from report_folders import FLEET, empty_machine, machine

from pipeline.report.cutting_facts import Cutting, best_run, worst_run
from pipeline.report.cutting_verdict import cutting_verdict
from pipeline.report.pages import write_report


def head_of(folders, tmp_path) -> str:
    return report(folders, tmp_path).split("On this page")[0].split("The cut: forces")[0]


def judged(tmp_path, runs: list, **other) -> str:
    """The head of the page of a machine with nothing but judged cuts."""
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders)
    write_cutting_validation(folders, runs, **other)
    return head_of(folders, tmp_path)


def test_forces_within_their_limits_pass_with_each_worst_error(tmp_path):
    head = judged(tmp_path, [cut_run(600, 4.0), cut_run(1200, 9.0)])
    # 9 %, 9 / 1.5 and 9 / 2
    assert (
        "Passed Cutting forces are predicted within their limits: on 2 judged recordings the RMS "
        "force is wrong by up to 9.0 % (limit 20 %), the peak force by up to 6.0 % (limit 25 %) "
        "and the mean force by up to 4.5 % (limit 20 %)." in head
    )
    assert "Forces of the cut 9.0 % worst of 2 judged recordings, limit 20 %" in head
    assert "Peak forces 6.0 % worst of 2 judged recordings, limit 25 %" in head


def test_forces_beyond_their_limits_fail_with_what_is_beyond(tmp_path):
    head = judged(tmp_path, [cut_run(600, 4.0), cut_run(1200, 31.0)])
    assert "Failed Cutting forces are not predicted within their limits: on 1 of 2 judged " in head
    assert "recordings the RMS force is wrong by up to 31 % (limit 20 %)" in head
    assert "mean force" not in head.split("What to do now")[0]
    assert "Do not plan cuts with these forces yet" in head


def test_a_judge_who_failed_without_a_failed_recording_is_believed_and_quoted(tmp_path):
    head = judged(tmp_path, [cut_run(600, 4.0)], passed=False, reason="z was not recorded.")
    assert "Failed" in head and "(z was not recorded)." in head


@pytest.mark.parametrize(
    ("runs", "other", "why"),
    [
        ([cut_run(600, 1.0, "training")], {}, "every recording was learnt from"),
        ([cut_run(600, 1.0, status="not judged")], {}, "every recording was learnt from"),
        ([cut_run(600, 1.0)], {"passed": None, "reason": "one tooth broke."}, "one tooth broke."),
        ([cut_run(600, 1.0)], {"passed": "yes"}, "no recording was left to judge by"),
        ([], {"passed": True}, "every recording was learnt from"),
    ],
)
def test_nobody_is_told_that_unjudged_forces_hold(tmp_path, runs, other, why):
    head = judged(tmp_path, runs, **other)
    assert "No verdict" in head and f"The cutting forces were not judged: {why}" in head
    assert "within their limits" not in head and ".." not in head
    assert "Keep a recording at another feed or depth out" in head


def test_coefficients_that_nobody_judged_say_so(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders)
    head = head_of(folders, tmp_path)
    assert "No verdict A model of the cutting forces was found and not held against any" in head
    text = report(folders, tmp_path)
    assert "there is no cutting_validation.json" in text
    assert "How well forces are predicted" not in text


@pytest.mark.parametrize(("errors", "word"), [((9.0, 8.0), "Passed"), ((9.0, 31.0), "Failed")])
def test_where_all_was_learnt_from_cross_predictions_count(tmp_path, errors, word):
    cross = [cut_run(f, e, **{"from": [name_of(g)]})
             for f, g, e in zip((600, 1200), (1200, 600), errors, strict=True)]  # fmt: skip
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders)
    write_cutting_validation(folders, [cut_run(600, 3.0, "training")], cross)
    head = head_of(folders, tmp_path)
    assert f"{word} Cutting forces are" in head
    assert f"of 2 recordings predicted from the other {'' if word == 'Passed' else 'the'}" in (
        head.replace("on 2", "of 2")
    )


def test_forces_that_fail_put_a_passed_machine_under_reservation(tmp_path):
    folders = with_cutting(machine(tmp_path, "m", days=4), [cut_run(600, 31.0)])
    head = report(folders, tmp_path).split("What the machine did")[0]
    assert "Passed, with reservations" in head and "Do not plan cuts with these forces yet" in head


def test_the_index_gives_the_reason_of_a_reservation_not_what_passed(tmp_path):
    folders = with_cutting(machine(tmp_path, "m", days=4), [cut_run(600, 31.0), cut_run(900, 4.0)])
    write_report([folders], FLEET, None, tmp_path / "out")
    index = words(tmp_path / "out" / "index.html")
    assert "see How well forces are predicted on the machine’s page" in index
    assert "on 1 of 2 judged recordings the RMS force is wrong by up to" in index
    assert "thermal model passed" not in index


def test_the_index_carries_the_verdict_of_cuts_alone(tmp_path):
    write_report([with_cutting(empty_machine(tmp_path, "rig", "recorded"))], FLEET, None,
                 tmp_path / "out")  # fmt: skip
    text = words(tmp_path / "out" / "index.html")
    assert "1 machine: 1 passed." in text
    assert "plan cuts with these forces, with this tool and material. Cutting forces are" in text
    page = words(tmp_path / "out" / "rig.html").split("What was read")[0].lower()
    assert "thermal" not in page and "golden" not in page


ERROR = st.none() | st.floats(-200, 200)


@given(st.lists(st.tuples(ERROR, ERROR, st.sampled_from(["judged", "training"])), max_size=6))
def test_the_worst_and_the_best_are_the_ends_of_what_is_known(rows):
    document = {"limits": LIMITS, "passed": True, "recordings": [
        {"recording": str(i), "role": role, "components": {
            "x": {"rms_error_percent": a, "peak_error_percent": b}},
         "status": "passed" if role == "judged" else "not judged"}
        for i, (a, b, role) in enumerate(rows)]}  # fmt: skip
    cutting = Cutting(validation=document)
    counted = [(abs(a), b) for a, b, role in rows if role == "judged" and a is not None]
    errors = [a for a, _ in counted]
    peaks = [abs(b) for _, b in counted if b is not None]
    worst, best, peak = (worst_run(cutting.judged), best_run(cutting.judged),
                         worst_run(cutting.judged, "peak"))  # fmt: skip
    assert [worst and worst.size("rms"), best and best.size("rms")] == (
        [max(errors), min(errors)] if errors else [None, None]
    )
    assert (peak and peak.size("peak")) == (max(peaks) if peaks else None)
    assert "None" not in cutting_verdict(cutting).sentence
