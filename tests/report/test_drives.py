"""What the pages say of the feed drives: parameters, searches, recordings, figures."""

import re

import pytest
from drive_folders import (
    axis_document,
    drive_parameter,
    drive_run,
    report,
    section,
    with_drives,
    write_drive,
)
from page_reader import words
from report_folders import FLEET, empty_machine, machine

from pipeline.report.pages import write_report

SECTIONS = ("drives", "following")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    root = tmp_path_factory.mktemp("drives")
    folders = with_drives(machine(root, "mill01", days=3))
    write_report([folders], FLEET, None, root / "out")
    return root


@pytest.fixture
def page(built):
    return built / "out" / "mill01.html"


def test_without_documents_there_is_no_section(tmp_path):
    write_report([machine(tmp_path, "m", days=3)], FLEET, None, tmp_path / "out")
    page = tmp_path / "out" / "m.html"
    assert [section(page, key) for key in SECTIONS] == ["", ""]
    assert "drives" not in words(page).lower()


def test_parameters_stand_in_shop_units_with_interval_and_remedy(page):
    text = words(page)
    # 0.0041 m/s +- 20 %; 0.0061 H +- 4 %
    assert "speed over which starting friction gives way, towards +X 4.10 3.28 to 4.92 mm/s" in text
    assert "inductance along the magnets’ flux 6.10 5.86 to 6.34 mH" in text
    assert (
        "friction at the start of motion, towards −Y not determined – N record reciprocation at "
        "speeds below 1 mm/s, 1 s each" in text
    )
    assert "Of the drives the records do not determine X offset, Y static_positive" in text


def test_an_interval_narrower_than_three_digits_is_not_printed_as_a_point(page):
    assert "position_scale gain of the position loop over its nominal one 1.1200 1.1178 to 1.1222" \
        in words(page)  # fmt: skip


def test_ways_that_several_parameters_share_are_said_once(tmp_path):
    ways = {"a": "motion", "b": "motion", "c": "the loop", "d": "the loop", "e": "a data sheet"}
    parameters = {name: {**drive_parameter(1.0, "N"), "how": way} for name, way in ways.items()}
    folders = empty_machine(tmp_path, "m")
    write_drive(folders, axes={"X": axis_document("X", parameters=parameters)})
    text = report(folders, tmp_path)
    assert "How found: (a) motion; (b) the loop." in text
    assert "d – 1.000 0.9700 to 1.030 N (b) e – 1.000 0.9700 to 1.030 N a data sheet" in text


def test_forces_of_an_unknown_drive_stay_in_its_command(tmp_path):
    folders = empty_machine(tmp_path, "m", "recorded")
    write_drive(folders, "X", axes={"X": axis_document(
        "X", command_unit="A", force_unit="A",
        parameters={"mass": drive_parameter(1.7, "A s^2/m")})})  # fmt: skip
    text = report(folders, tmp_path)
    assert "Nobody has said what force one A makes, so forces are in A: give force_constant" in text
    assert "inertia as mass 1.70 1.65 to 1.75 A s²/m" in text
    assert "Force against motion, A" in text


def test_what_the_fit_tells_apart_worst_is_named(page):
    assert (
        "What the fit leaves over is 2.6 % of the force over 23 410 samples; the condition is 42; "
        "told apart worst are viscous_positive and coulomb_positive (correlation −0.83)."
        in words(page)
    )


def test_an_axis_says_how_its_loops_were_found_or_why_not(tmp_path):
    folders = empty_machine(tmp_path, "m")
    loops = {
        "relative_error_percent": 0.882,
        "correlation": {
            "names": ["velocity_scale", "integral_scale"],
            "values": [[1, 0.97], [0.97, 1]],
        },
    }
    write_drive(folders, axes={
        "X": axis_document("X", servo_fit=loops),
        "Y": axis_document("Y", drive={"servo_reason": "Y has no reference"})})  # fmt: skip
    text = report(folders, tmp_path)
    assert (
        "Its loops’ gains leave 0.88 % of the command unexplained; told apart worst are "
        "integral_scale and velocity_scale (correlation 0.97)." in text
    )
    assert "Its loops could not be found: Y has no reference." in text


@pytest.mark.parametrize(
    ("errors", "said", "counts"),
    [
        ([(1.0, 2.0), (3.0, 5.0)], "Least squares won: of 2 tasks", (2, 0, 0)),
        ([(2.0, 1.0), (3.0, 2.0), (1, 4)], "The genetic search won: of 3 tasks", (1, 2, 0)),
        ([(1.0, 1.0005), (2.0, 2.0)], "Neither search won: of 2 tasks", (0, 0, 2)),
    ],
)
def test_the_search_that_won_is_said(tmp_path, errors, said, counts):
    rows = [
        {"task": f"t{i}", "method": method, "error": error, "evaluations": count}
        for i, pair in enumerate(errors)
        for method, error, count in zip(("least_squares", "genetic"), pair, (50, 10_000),
                                        strict=True)
    ]  # fmt: skip
    folders = empty_machine(tmp_path, "m")
    write_drive(folders, "X", axes={"X": axis_document("X", methods=rows)})
    text = report(folders, tmp_path)
    better, worse, alike = counts
    assert (
        f"{said} least squares has the smaller error in {better}, the genetic search in {worse}, "
        f"and in {alike} they are alike within 0.1 %; for each evaluation of least squares the "
        "genetic search needed 200 (median)." in text
    )


def test_recordings_say_what_was_done_to_them(tmp_path):
    folders = empty_machine(tmp_path, "m")
    write_drive(folders, recordings={
        "training": [{"recording": "a.csv", "seconds": 25.67, "notes": ["6 rows filled in"]}],
        "left_out": [{"recording": "b.csv", "reason": "has no command"}]})  # fmt: skip
    text = report(folders, tmp_path)
    assert "Found from 1 recording of X, Y and Z." in text
    assert "b.csv left out – has no command a.csv learnt from 25.7 6 rows filled in" in text


def test_each_recording_has_its_errors_guesses_and_verdict(page):
    text = words(page)
    assert "servo/program-plate X 24.6 6.2 38.4 412 1 604 7.3 9.5 30.1 71.0 passed" in text
    assert "servo/reciprocation-X X 24.6 2.6 38.4 412 1 604 2.1 2.7 8.65 71.0 learnt from" in text
    assert (
        "The twin’s X, Y and Z axes follow their records: on 2 judged recordings the force is "
        "wrong by up to 6.2 % (limit 10 %) and the following error by up to 9.4 % (limit 15 %)."
        in text
    )


def test_every_figure_is_labelled_credited_and_small(page, tmp_path):
    text = "".join(section(page, key) for key in (*SECTIONS, "truth"))
    figures = re.findall(r"<figure>.*?</figure>", text, flags=re.S)
    assert len(figures) == 3 + 1 + 2 * 3  # friction, mass of X, whole and close look
    assert max(map(len, figures)) < 60_000
    labels = re.findall(r'role="img" aria-label="([^"]*)"', "".join(figures))
    assert len(labels) == len(figures) and all(len(label) > 40 for label in labels)
    captions = re.findall(r"<(figcaption|caption|summary)>(.*?)</\1>", text, flags=re.S)
    assert all('class="label simulated"' in words for _, words in captions)
    folders = with_drives(empty_machine(tmp_path, "rig", "recorded", credit="Records: Works, CC0"))
    report(folders, tmp_path)
    text = "".join(section(tmp_path / "out" / "rig.html", key) for key in SECTIONS)
    assert "label simulated" not in text
    made = re.findall(r'<p class="source">(Source.*?)</p>', text, flags=re.S)
    assert len(made) > 12 and all("Records: Works, CC0" in words for words in made)


@pytest.mark.parametrize("level", [4.31, None])
def test_where_no_following_error_is_known_means_show_the_friction_levels(tmp_path, level):
    run = drive_run("experiment_02", 31.0, None)
    run["force"] |= {"unit": "A", "mean_measured": level, "mean_modelled": 4.28}
    said = report(with_drives(empty_machine(tmp_path, "mill"), {"X": [run]}), tmp_path)
    assert ("4.31" in said and "4.28" in said and "modelled" in said) == (level is not None)
