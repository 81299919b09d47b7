"""What the pages say of the cut: coefficients, searches, recordings, predictions, spindle."""

import re

import pytest
from cutting_folders import (
    SPINDLE,
    coefficients,
    cut_parameter,
    recording,
    with_cutting,
    write_cutting,
)
from drive_folders import report, section, with_drives
from page_reader import words
from report_folders import FLEET, empty_machine, machine

from pipeline.report import changes, machine_page, verdict
from pipeline.report.pages import write_report

SECTIONS = ("cutting", "forces")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    root = tmp_path_factory.mktemp("cutting")
    write_report([with_cutting(machine(root, "mill01", days=3))], FLEET, None, root / "out")
    return root / "out" / "mill01.html"


def test_a_machine_without_cuts_has_the_page_that_it_had(tmp_path, monkeypatch):
    fleet = [with_drives(machine(tmp_path, "m", days=3)), empty_machine(tmp_path, "new")]
    write_report(fleet, FLEET, None, tmp_path / "with")
    for module, names in (
        (machine_page, ("cutting_section", "prediction_section", "cutting_truth_table")),
        (verdict, ("cutting_verdict",)),
    ):
        for name in names:
            monkeypatch.setattr(module, name, lambda _: None)
    monkeypatch.setattr(machine_page, "cutting_key_figures", lambda _: [])
    monkeypatch.setattr(verdict, "plain_better_words", lambda _: "")
    for name in ("cutting_figures", "cutting_parameters"):
        monkeypatch.setattr(changes, name, lambda _: {})
    write_report(fleet, FLEET, None, tmp_path / "without")
    for name in ("m.html", "new.html", "index.html", "report.json"):
        assert (tmp_path / "with" / name).read_bytes() == (tmp_path / "without" / name).read_bytes()
    text = (tmp_path / "with/report.json").read_text() + words(tmp_path / "with/m.html")
    assert "cut_" not in text and "Forces of the cut" not in text


def test_coefficients_stand_beside_those_of_the_mean_forces(page):
    text = words(page)
    # 1820 +- 4 % beside 1911 +- 12 %; 27.5 +- 12 % beside 28.875 +- 36 %
    assert "1 820 1 747 to 1 893 1 911 1 682 to 2 140 N/mm² (a)" in text
    assert "grows first as flank wear grows 27.5 24.2 to 30.8 28.9 18.5 to 39.3 N/mm (a)" in text
    assert "how far the tool’s axis is off the spindle’s 11.4 10.5 to 12.3 – – µm (a)" in text
    assert "How found: (a) least squares of every sample of the waveform" in text


def test_what_is_not_determined_has_no_number_and_says_what_to_record(page):
    text = words(page)
    assert (
        "helix angle of the edges not determined – – – ° the tool is too short in the material; "
        "record a slot of 10 mm depth" in text
    )
    assert "Of the cut the records do not determine helix; the table of coefficients says" in text


def test_without_a_mean_force_regression_there_are_no_columns_for_it(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, mean_force={}, parameters=coefficients())
    text = report(folders, tmp_path)
    assert "Mean forces alone" not in text
    assert "away from the workpiece 690 662 to 718 N/mm² –" in text
    assert "Those with a number were found by least squares of every sample" in text


def test_a_parameter_of_the_regression_alone_is_shown_too(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, parameters={}, mean_force={"K_tc": cut_parameter(900.0, "N/mm2")})
    assert "K_tc cutting, along the cutting speed" in report(folders, tmp_path)
    assert "– – 900 864 to 936 N/mm² –" in report(folders, tmp_path)


def test_the_fit_says_what_it_leaves_and_what_it_tells_apart_worst(page):
    text = words(page)
    assert (
        "Found from 2 recordings of a flat cutter (25 mm, 2 teeth) in aluminium 6061. What the "
        "fit leaves over is 8.3 % of the RMS force over 19 800 samples of 198 revolutions; the "
        "condition is 212; told apart worst are K_te and K_tc (correlation −0.87)." in text
    )


@pytest.mark.parametrize(("r", "said"), [(-0.97, True), (0.97, True), (0.94, False)])
def test_two_coefficients_known_as_a_sum_only_are_said_to_be(tmp_path, r, said):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, correlation={"names": ["K_tc", "K_rc"], "matrix": [[1, r], [r, 1]]})
    assert ("so that little more than their sum is known" in report(folders, tmp_path)) == said


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        ((8.31, 8.62), "Least squares comes closer: 8.31 against 8.62 % of the RMS force"),
        ((8.62, 8.31), "The genetic search comes closer: 8.31 against 8.62 % of the RMS force"),
        ((8.31, 8.312), "Least squares and the genetic search are alike within 0.1 %"),
    ],
)
def test_the_search_that_comes_closer_is_said_with_its_price(tmp_path, errors, said):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, methods=[
        {"method": method, "rms_error_percent": error, "evaluations": n}
        for method, error, n in zip(("least_squares", "genetic"), errors, (40, 8000), strict=True)
    ])  # fmt: skip
    text = report(folders, tmp_path)
    assert f"{said}; for each evaluation of least squares the genetic search needed 200." in text
    assert f"least squares {errors[0]:.3f} 40 kept genetic search {errors[1]:.3f} 8 000 –" in text


def test_a_search_that_is_far_off_had_not_converged(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, methods=[
        {"method": "least_squares", "rms_error_percent": 5.73, "evaluations": 154},
        {"method": "genetic", "rms_error_percent": 35.3, "evaluations": 691}])  # fmt: skip
    text = report(folders, tmp_path)
    assert "the genetic search had not converged after 691 evaluations (35.3 %)." in text
    assert "for each evaluation" not in text


def test_recordings_carry_conditions_use_and_reason(page):
    text = words(page)
    assert "Recordings of the cut: 2 learnt from, 2 judged, 1 left out" in text
    assert "6-n6000f300ap3ae25 left out 6 000 0.0250 3 0 to 180 99 the tool was not in" in text


def test_the_chain_is_shown_with_units(page):
    assert "x natural_frequency natural frequency of dynamometer and workpiece 1 130 1 107 to " \
        "1 153 Hz" in words(page)  # fmt: skip


def test_specific_force_is_said_in_the_units_of_a_rate_of_chips(page):
    # 2010 N/mm^2 = 2010 J/cm^3; over a minute 2010 / 60 W
    assert "each cm³ of chips a minute asks for 33.5 W at the tool" in words(page)
    assert "with thin chips most. The load is a share of 15 kW." in words(page)


def test_an_undetermined_specific_force_says_why(tmp_path):
    nothing = cut_parameter(None, "N/mm^2", reason="record passes of 10 s")
    lost = {"recordings": ["a"], "reason": "no pass was long enough", "specific_force": nothing}
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, spindle=lost)
    text = report(folders, tmp_path)
    assert "shows (a) no specific force could be had. No pass was long enough." in text
    assert "edges and all not determined – N/mm² record passes of 10 s" in text


def test_logs_of_the_spindle_say_what_of_them_is_not_used(tmp_path):
    note = "passes.txt: 2 of 9 lines that cut are not used (line 12, 14): too short"
    lost = "idle.txt is a copy of free.txt: record another"
    spindle = SPINDLE | {"recordings": ["free.txt", "passes.txt"], "notes": [note],
                         "left_out": [{"recording": "idle.txt", "reason": lost}],
                         "reason": f"{lost}; no pass was long enough"}  # fmt: skip
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, spindle=spindle)
    text = report(folders, tmp_path)
    assert "Logs of the spindle’s load: 2 used, 1 left out" in text
    assert "free.txt used – passes.txt used 2 of 9 lines that cut are not used (line 12" in text
    assert "idle.txt left out is a copy of free.txt: record another" in text
    assert text.count("a copy of free.txt") == 1 and "No pass was long enough." in text


def test_logs_that_are_used_whole_have_no_table(page):
    assert "Logs of the spindle" not in words(page)


def test_without_a_dynamometer_and_without_logs_the_page_says_what_serves(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    nothing = {"parameters": {}, "mean_force": {}, "recordings": [], "fit": {}, "methods": []}
    write_cutting(folders, spindle={}, **nothing)
    assert "the load of the spindle serves: logged over MTConnect" in report(folders, tmp_path)
    write_cutting(folders, **nothing)
    assert "the load of the spindle serves" not in report(folders, tmp_path)


def test_a_machine_with_nothing_but_its_spindles_load_says_what_forces_would_take(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, parameters={}, mean_force={}, recordings=[], fit={}, methods=[])
    text = report(folders, tmp_path)
    assert "No force was recorded on a dynamometer" in text and "edge: measure" not in text
    assert "each cm³ of chips a minute asks for 33.5 W" in text
    assert "not held against any recording" not in text and "cutting_validation" not in text


def test_without_records_of_the_spindle_nothing_is_said_of_it(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, spindle={})
    assert "Power of the spindle" not in report(folders, tmp_path)


def test_terms_that_were_tried_stand_with_their_error_and_what_was_kept(page):
    text = words(page)
    assert "runout 11.41 – runout, ringing of the dynamometer’s channels 8.530 kept" in text
    assert "by the error on recordings left out" in text


def test_terms_of_one_recording_are_held_by_a_criterion_not_an_error(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, recordings=[recording(600, "training")],
                  terms=[{"terms": [], "value": -812.4, "kept": True}])  # fmt: skip
    text = report(folders, tmp_path)
    assert "by the information criterion" in text and "none −812.4 kept" in text


def test_what_was_learnt_beside_mechanics_says_where_it_holds(page):
    assert (
        "Beside mechanics the model holds what mechanics leave over, by the angle of the spindle. "
        "That part was learnt, not understood, and is used only where it was learnt: 6 000 "
        "rev/min, 3 mm deep, learnt at 0.05 and 0.075 mm a tooth, used from 0.025 to 0.15."
        in words(page)
    )


def test_a_fit_that_could_not_be_made_says_why(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, parameters={}, mean_force={}, fit=None, terms=[], remainder=None,
                  reason="no recording was made in the material")  # fmt: skip
    text = report(folders, tmp_path)
    assert "No coefficient of the cut could be found: no recording was made in the mat" in text
    assert "No force was recorded" not in text and "learnt, not understood" not in text


def test_maintenance_reads_what_growth_means_and_what_one_set_cannot_say(page):
    text = section(page, "cutting")
    assert "Edge coefficients that grow" in text and "clean the taper" in text
    assert "One set of records cannot say whether either has grown" in text


def test_files_of_recordings_that_were_learnt_from_stand_with_their_hash(page):
    text = section(page, "cutting").split("Files that the coefficients were found from")[-1]
    assert f"{600:064x}" in text and f"{900:064x}" in text and f"{1200:064x}" not in text


def test_every_figure_is_labelled_credited_and_small(page, tmp_path):
    text = "".join(section(page, key) for key in (*SECTIONS, "truth"))
    figures = re.findall(r"<figure>.*?</figure>", text, flags=re.S)
    assert len(figures) == 3  # no-load power, worst and best revolution
    assert max(map(len, figures)) < 60_000
    labels = re.findall(r'role="img" aria-label="([^"]*)"', "".join(figures))
    assert len(labels) == len(figures) and all(len(label) > 40 for label in labels)
    captions = re.findall(r"<(figcaption|caption|summary)>(.*?)</\1>", text, flags=re.S)
    assert all('class="label simulated"' in caption for _, caption in captions)
    folders = with_cutting(empty_machine(tmp_path, "rig", "recorded", credit="Records: Works, CC0"))
    report(folders, tmp_path)
    text = "".join(section(tmp_path / "out" / "rig.html", key) for key in SECTIONS)
    assert "label simulated" not in text
    made = re.findall(r'<p class="source">(Source.*?)</p>', text, flags=re.S)
    assert len(made) > 8 and all("Records: Works, CC0" in words for words in made)


def test_recordings_without_names_of_use_are_not_counted_as_training(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_cutting(folders, recordings=[recording(600, "odd")], tool={}, material="")
    text = report(folders, tmp_path)
    assert "The recordings that they were found from of a tool are not named." in text
