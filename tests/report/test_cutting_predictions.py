"""What the pages say of predicted forces: errors, limits, plain guess, cross predictions."""

import re

import pytest
from cutting_folders import cut_run, name_of, with_cutting, write_cutting_validation
from drive_folders import report, section
from page_reader import words
from report_folders import FLEET, empty_machine, machine

from pipeline.report.pages import write_report


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    root = tmp_path_factory.mktemp("predictions")
    write_report([with_cutting(machine(root, "mill01", days=3))], FLEET, None, root / "out")
    return root / "out" / "mill01.html"


def test_each_recording_has_its_errors_guess_and_verdict(page):
    text = words(page)
    # peak -1/1.5, mean 1/2 of the RMS error, the plain guess twice as far off
    assert "6-n6000f1200ap3ae25 6 000 0.100 3 9.4 18.8 −6.3 −12.5 +4.7 +9.4 passed" in text
    assert "6-n6000f600ap3ae25 6 000 0.0500 3 7.2 14.4 −4.8 −9.6 +3.6 +7.2 learnt from" in text
    assert "(limits: RMS 20 %, peak 25 %, mean 20 %)" in text
    assert "is nowhere closer than the model." in text
    assert "Plain guess: mean-force coefficients, no runout, no measuring chain." in text


def test_without_a_resultant_the_component_that_errs_most_is_judged(tmp_path):
    run = cut_run(1000, 15.0)
    for rows in (run["components"], run["plain"]["components"]):
        del rows["resultant"]
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting_validation(folders, [run])
    text = report(folders, tmp_path)
    # z, 1.2 of 15 %; peak -1/1.5 and mean 1/2 of that
    assert "6-n6000f1000ap3ae25 6 000 0.0833 3 18.0 36.0 −12.0 −24.0 +9.0 +18.0" in text
    assert "Where no resultant is known, the component that errs most stands for it." in text


def test_mechanics_alone_stand_beside_what_was_learnt_over_them(tmp_path):
    alone = {"components": cut_run(1200, 13.0)["components"]}
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting_validation(folders, [cut_run(1200, 9.0, mechanics=alone), cut_run(1500, 8.0)])
    text = report(folders, tmp_path)
    assert "mechanics alone" in text and "6 000 0.100 3 9.0 13.0 18.0 −6.0" in text
    assert "6 000 0.125 3 8.0 – 16.0" in text
    same = {"components": cut_run(1200, 9.0)["components"]}
    write_cutting_validation(folders, [cut_run(1200, 9.0, mechanics=same)])
    assert "mechanics alone" not in report(folders, tmp_path)


def test_components_show_forces_errors_and_which_is_closer(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting_validation(folders, [cut_run(1000, 15.0, plain=9.0)])
    text = report(folders, tmp_path)
    # x: 0.9 of 15 % and of 9 %; peak 420 N, of which the model has 1 - 13.5 / 150
    assert "6-n6000f1000ap3ae25 x 420 382 −9.0 −5.4" in text
    assert "231 13.5 8.1 plain" in text


def test_where_the_plain_guess_is_closer_the_page_says_so(tmp_path):
    folders = with_cutting(empty_machine(tmp_path, "m", "recorded"),
                           [cut_run(1200, 9.0, plain=8.0), cut_run(1500, 9.0)])  # fmt: skip
    text = report(folders, tmp_path)
    assert "Passed, with reservations" in text
    assert (
        "On 1 of 2 judged recordings the plain guess (mean-force coefficients, no runout, no "
        "measuring chain) comes closer to the forces than the model." in text
    )
    assert "is closer than the model in the RMS force on 1, in the peak force on 1 and in the " in (
        text
    )


def test_a_plain_guess_with_a_better_mean_alone_is_said_and_is_no_reservation(tmp_path):
    run = cut_run(1200, 9.0)
    run["plain"]["components"]["resultant"]["mean_error_percent"] = -1.0
    text = report(with_cutting(empty_machine(tmp_path, "m", "recorded"), [run]), tmp_path)
    assert "is closer than the model in the mean force on 1." in text
    assert "reservations" not in text


def test_what_is_beyond_its_limit_is_marked_and_not_said_again(tmp_path):
    said = "RMS error: 31 % > 20 %"
    run = cut_run(1200, 31.0, reason=said)
    folders = with_cutting(empty_machine(tmp_path, "m", "recorded"), [run])
    text = report(folders, tmp_path)
    marks = re.findall(r'is-failed"[^<]*<svg.*?</svg><span>([^<]*)</span>', section(
        tmp_path / "out/m.html", "forces").split("</table>")[0])  # fmt: skip
    assert marks == ["31.0", "failed"]  # peak and mean, 20.7 and 15.5 %, are within
    assert said not in text
    write_cutting_validation(folders, [cut_run(1200, 9.0, status="failed", reason="z drifted")])
    assert "failed z drifted" in report(folders, tmp_path)


def test_cross_predictions_name_what_they_were_fitted_on(tmp_path):
    both = [cut_run(f, 8.0, "training") for f in (600, 1200)]
    cross = [{**cut_run(600, 9.0, "training"), "status": "passed", "reason": "",
              "from": [name_of(1200)]}]  # fmt: skip
    text = report(with_cutting(empty_machine(tmp_path, "m", "recorded"), both, cross), tmp_path)
    assert (
        "6-n6000f600ap3ae25 6-n6000f1200ap3ae25 6 000 0.0500 3 9.0 18.0 −6.0 −12.0 +4.5 +9.0"
        in text
    )
    assert "Every recording was learnt from, so each is also predicted by a fit on the others" in (
        text
    )
    assert "Forces of the cut 9.0 % worst of 1 cross prediction, limit 20 %" in text
    assert (
        "whose RMS error is 8.0 % (plain guess 16 %); fitted on other recordings it errs by 9.0 %. "
        "learnt from" in text
    )
    assert "the coefficients were found from it" not in text  # said as "learnt from"
