"""What the page says of the cut: verdict, coefficients, searches, predictions, spindle, truth."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.charts.sections import Figures
from pipeline.schema.cutting import TermsTried
from pipeline.schema.model import Correlation, LeftOut, Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.cutting.headline import cutting_verdict
from pipeline.submodels.cutting.judged_tables import holds, off_percent
from pipeline.submodels.cutting.page import wear_note
from pipeline.submodels.cutting.runs import best_run, cutting_facts, worst_run
from pipeline.submodels.cutting.tables import unit_of, value_words
from tests.submodels.cutting.cutting_files import (
    POWERS,
    SPINDLE,
    TRUTH,
    block_words,
    coefficients,
    cross,
    folds,
    methods,
    model,
    name_of,
    page,
    parameter,
    predictions,
    recording,
    run,
    verdict,
    without_forces,
    words,
)


@pytest.fixture(scope="module")
def text():
    return words(page(model(), verdict(), predictions()))


def head_of(*runs, **other):
    """Verdict of a machine with judged cuts."""
    found = page(model(), verdict(*runs, **other)).verdict
    return f"{found.status} {found.sentence} {found.todo}".replace("\u00a0", " ")


# ---- the cut


def test_a_machine_without_cuts_has_no_part_of_the_page():
    found = page()
    assert found.verdict is None and not found.sections and not found.compared
    assert not found.key_figures and not found.notes and not found.doubts


def test_coefficients_stand_beside_those_of_the_mean_forces(text):
    # 1820 +- 4 % beside 1911 +- 12 %; 27.5 +- 12 % beside 28.875 +- 36 %
    assert "1 820 1 747 to 1 893 1 911 1 682 to 2 140 N/mm² (a)" in text
    assert "grows first as flank wear grows 27.5 24.2 to 30.8 28.9 18.5 to 39.3 N/mm (a)" in text
    assert "how far the tool’s axis is off the spindle’s 11.4 10.5 to 12.3 – – µm (a)" in text
    assert "How found: (a) least squares of every sample of the waveform" in text


def test_a_remark_on_a_determined_parameter_stands_in_its_row(text):
    assert "° from the tooth that stands out most, within half a pitch" in text


def test_what_is_not_determined_has_no_number_and_says_what_to_record(text):
    assert (
        "helix angle of the edges not determined – – – ° the tool is too short in the material: "
        "record a slot of 10 mm depth" in text
    )
    assert "Of the cut the records do not determine helix; the table of coefficients says" in text


def test_without_a_mean_force_regression_there_are_no_columns_for_it():
    said = words(page(model({"": coefficients(), "mean force": None})))
    assert "Mean forces alone" not in said
    assert "away from the workpiece 690 662 to 718 N/mm² –" in said
    assert "Those with a number were found by least squares of every sample" in said


def test_the_fit_says_its_residual_and_its_strongest_correlation(text):
    assert (
        "Identified from 2 recordings of a flat cutter (25 mm, 2 teeth) in aluminium 6061. The "
        "residual of the fit is 8.3 % of the RMS force over 19 800 samples of 198 revolutions; the "
        "condition is 212; the most correlated are K_te and K_tc (correlation −0.87)." in text
    )
    assert "In these records the tool’s axis was 11.4 µm off the spindle’s." in text


@pytest.mark.parametrize(("r", "said"), [(-0.97, True), (0.97, True), (0.94, False)])
def test_two_coefficients_known_as_a_sum_only_are_said_to_be(r, said):
    both = Correlation(names=("K_tc", "K_rc"), values=((1.0, r), (r, 1.0)))
    text = words(page(model(correlation=both)))
    assert ("so that little more than their sum is known" in text) == said


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        ((8.31, 8.62), "Least squares comes closer: 8.31 against 8.62 % of the RMS force"),
        ((8.62, 8.31), "The genetic search comes closer: 8.31 against 8.62 % of the RMS force"),
        ((8.31, 8.312), "Least squares and the genetic search are alike within 0.1 %"),
    ],
)
def test_the_search_that_comes_closer_is_said_with_its_price(errors, said):
    text = words(page(model(methods=methods(*errors, 40, 8000))))
    assert f"{said}; for each evaluation of least squares the genetic search needed 200." in text
    assert f"least squares {errors[0]:.3f} 40 kept genetic search {errors[1]:.3f} 8 000 –" in text


def test_a_search_that_is_far_off_had_not_converged():
    text = words(page(model(methods=methods(5.73, 35.3, 154, 691))))
    assert "the genetic search had not converged after 691 evaluations (35.3 %)." in text
    assert "for each evaluation" not in text


def test_recordings_carry_conditions_use_and_reason(text):
    assert "Recordings of the cut: 2 learnt from, 2 judged, 1 left out" in text
    assert "6-n6000f300ap3ae25 left out 6 000 0.0250 3 0 to 180 99 the tool was not in" in text


def test_the_chain_is_shown_with_units(text):
    assert (
        "x natural_frequency natural frequency of dynamometer and workpiece 1 130 1 107 to "
        "1 153 Hz" in text
    )


def test_terms_that_were_tried_stand_with_their_error_and_what_was_kept(text):
    assert "runout 11.41 – runout, ringing of the dynamometer’s channels 8.530 kept" in text
    assert "by the error on recordings left out" in text


def test_terms_of_one_recording_are_held_by_a_criterion_not_an_error():
    terms = (TermsTried(terms=(), value=-812.4, kept=True),)
    said = words(page(model(recordings=(recording(600, "training"),), terms=terms)))
    assert "by the information criterion" in said and "none −812.4 kept" in said


def test_what_was_learnt_beside_mechanics_says_where_it_holds(text):
    assert (
        "Beside mechanics the model holds what mechanics leave over, by the angle of the spindle; "
        "affine in the feed. That part was learnt, not understood, and is used only where it was "
        "learnt: 6 000 rev/min, 3 mm deep, learnt at 0.05 and 0.075 mm per tooth, used from "
        "0.025 to 0.15." in text
    )


def test_maintenance_reads_what_growth_means_and_what_one_set_cannot_say(text):
    assert "Edge coefficients that grow" in text and "clean the taper" in text
    assert "One set of records cannot say whether either has grown" in text


def test_files_of_recordings_that_were_learnt_from_stand_with_their_hash(text):
    files = text.split("Files that the coefficients were found from")[-1]
    assert f"{600:064x}" in files and f"{900:064x}" in files and f"{1200:064x}" not in files


def test_a_fit_that_could_not_be_made_says_why():
    said = words(page(without_forces(reason="no recording was made in the material")))
    assert "No coefficient of the cut could be found: no recording was made in the mat" in said
    assert "No force was recorded" not in said and "learnt, not understood" not in said


def test_without_a_dynamometer_and_without_logs_the_page_says_what_serves():
    said = "the load of the spindle serves: logged over MTConnect"
    assert said in words(page(without_forces(spindle=None)))
    assert said not in words(page(without_forces()))


# ---- the spindle


def test_specific_force_is_said_in_the_units_of_a_rate_of_chips(text):
    # 2010 N/mm^2 = 2010 J/cm^3; over a minute 2010 / 60 W
    assert "each cm³ of chips a minute takes 33.5 W at the tool" in text
    assert "with thin chips most. The load is a share of 15 kW." in text


def test_an_undetermined_specific_force_says_why():
    nothing = parameter(None, "N/mm^2", method="too few levels", remedy="record passes of 10 s")
    spindle = replace(SPINDLE, recordings=("a",), reason="no pass was long enough", assumed="")
    said = words(page(model({"spindle": {"specific_force": nothing}}, spindle=spindle)))
    assert "shows (a) no specific force could be had. No pass was long enough." in said
    assert "edges and all not determined – N/mm² too few levels: record passes of 10 s" in said


def test_logs_of_the_spindle_say_what_of_them_is_not_used(text):
    lost = "idle.txt is a copy of free.txt: record another"
    spindle = replace(
        SPINDLE, recordings=("free.txt", "passes.txt"),
        notes=("passes.txt: 2 of 9 lines that cut are not used (line 12, 14): too short",),
        left_out=(LeftOut(case="idle.txt", reason=lost),),
        reason=f"{lost}; no pass was long enough",
    )  # fmt: skip
    said = words(page(model(spindle=spindle)))
    assert "Logs of the spindle’s load: 2 used, 1 left out" in said
    assert "free.txt used – passes.txt used 2 of 9 lines that cut are not used (line 12" in said
    assert "idle.txt left out is a copy of free.txt: record another" in said
    assert said.count("a copy of free.txt") == 1 and "No pass was long enough." in said
    assert "Logs of the spindle" not in text  # all of them are used whole


def test_a_machine_with_nothing_but_its_spindles_load_says_what_forces_would_take():
    said = words(page(without_forces()))
    assert "No force was recorded on a dynamometer" in said and "edge: measure" not in said
    assert "each cm³ of chips a minute takes 33.5 W" in said
    assert "not held against any recording" not in said and "verdict.json" not in said


def test_without_records_of_the_spindle_nothing_is_said_of_it():
    assert "Power of the spindle" not in words(page(model({"spindle": None}, spindle=None)))


# ---- the verdict


def test_forces_within_their_limits_pass_with_each_worst_error():
    head = head_of(run(600, 4.0), run(1200, 9.0))
    # 9 %, 9 / 1.5 and 9 / 2
    assert (
        "passed Cutting forces are predicted within their limits: on 2 judged recordings the RMS "
        "force is wrong by up to 9.0 % (limit 20 %), the peak force by up to 6.0 % (limit 25 %) "
        "and the mean force by up to 4.5 % (limit 20 %)." in head
    )
    said = words(page(model(), verdict(run(600, 4.0), run(1200, 9.0))))
    assert "Forces of the cut 9.0 % worst of 2 judged recordings, limit 20 %" in said
    assert "Peak forces 6.0 % worst of 2 judged recordings, limit 25 %" in said


def test_forces_beyond_their_limits_fail_with_what_is_beyond():
    head = head_of(run(600, 4.0), run(1200, 31.0))
    assert "failed Cutting forces are not predicted within their limits: on 1 of 2 judged " in head
    assert "recordings the RMS force is wrong by up to 31 % (limit 20 %)" in head
    assert "mean force" not in head and "Do not plan cuts with these forces yet" in head


def test_a_judge_who_failed_without_a_failed_recording_is_believed_and_quoted():
    head = head_of(run(600, 4.0), status="failed", reasons=("the golden file was changed.",))
    assert head.startswith("failed") and "(the golden file was changed)." in head


@pytest.mark.parametrize(
    ("runs", "other", "why"),
    [
        ([run(600, 1.0, "training")], {}, "every recording was learnt from"),
        ([run(600, 1.0, status="not judged")], {}, "every recording was learnt from"),
        (
            [run(600, 1.0)],
            {"status": "not judged", "reasons": ("one tooth broke.",)},
            "one tooth broke.",
        ),
        ([run(600, 1.0)], {"status": "not judged", "reasons": ()}, "no recording was left to"),
    ],
)
def test_nobody_is_told_that_unjudged_forces_hold(runs, other, why):
    head = head_of(*runs, **other)
    assert head.startswith("unknown") and f"The cutting forces were not judged: {why}" in head
    assert "within their limits" not in head and ".." not in head
    assert "Keep a recording at another feed or depth out" in head


def test_coefficients_that_nobody_judged_say_so():
    said = words(page(model()))
    assert "unknown A model of the cutting forces was found and not held against any" in said
    assert "there is no verdict.json" in said
    assert "How well forces are predicted" not in said


@pytest.mark.parametrize(("errors", "status"), [((9.0, 8.0), "within"), ((9.0, 31.0), "beyond")])
def test_where_all_was_learnt_from_cross_predictions_are_told(errors, status):
    """They are no verdict; where they are beyond the limits nobody is to plan with the forces."""
    judged = verdict(run(600, 3.0, "training"), cross(600, errors[0]), cross(1200, errors[1]))
    found = page(model(folds=folds((600, 1200), (1200, 600))), judged).verdict
    assert found.status == "unknown" and found.reserved == (status == "beyond")
    assert "On 2 recordings predicted from the other the RMS force is wrong" in found.sentence
    assert ("Do not plan cuts" in found.todo) == (status == "beyond")


ERROR = st.floats(-200, 200)


@given(st.lists(st.tuples(ERROR, st.sampled_from(["held_out", "training"])), max_size=6))
def test_the_worst_and_the_best_are_the_ends_of_what_is_known(rows):
    runs = [run(100 + k, error, role) for k, (error, role) in enumerate(rows)]
    judged = verdict(*runs) if runs else verdict(run(1, 1.0, "training"))
    found = cutting_facts(
        Shown(machine="m", origin="simulated", model=model(), verdict=judged, predictions=None)
    )
    errors = [abs(error) for error, role in rows if role == "held_out"]
    worst, best = worst_run(found.judged), best_run(found.judged)
    assert [worst and worst.size("rms"), best and best.size("rms")] == (
        [max(errors), min(errors)] if errors else [None, None]
    )
    assert "None" not in cutting_verdict(found).sentence


# ---- predictions


def test_each_recording_has_its_errors_guess_and_verdict(text):
    # peak -1/1.5, mean 1/2 of the RMS error, the plain guess twice as far off
    assert "6-n6000f1200ap3ae25 6 000 0.100 3 9.4 18.8 −6.3 −12.5 +4.7 +9.4 passed" in text
    assert "6-n6000f600ap3ae25 6 000 0.0500 3 7.2 14.4 −4.8 −9.6 +3.6 +7.2 learnt from" in text
    assert "(limits: RMS 20 %, peak 25 %, mean 20 %)" in text
    assert "is nowhere closer than the model." in text
    assert "Plain guess: coefficients of the mean forces; no helix, runout or mode of a" in text


def test_mechanics_alone_stand_beside_what_was_learnt_over_them():
    said = words(page(model(), verdict(run(1200, 9.0, mechanics=13.0), run(1500, 8.0))))
    assert "mechanics alone" in said and "6 000 0.100 3 9.0 13.0 18.0 −6.0" in said
    assert "6 000 0.125 3 8.0 8.0 16.0" in said
    table = page(model(), verdict(run(1200, 9.0))).sections[1].blocks[0]
    assert "mechanics alone" not in [head.name for head in table.heads]


def test_components_show_forces_errors_and_which_is_closer():
    """Modelled and guessed forces that are 10 and 5 % too large."""
    curves = predictions((1200, 1.0))
    curves["predicted"] = 1.1 * curves["measured"]
    curves["baseline_plain"] = 1.05 * curves["measured"]
    section = page(model(), verdict(run(1200, 9.0)), curves).sections[1]
    (table,) = (b for b in section.blocks if getattr(b, "caption", "").startswith("Forces by"))
    assert [row[1].text for row in table.rows] == ["x", "y", "z", "resultant"]
    for row in table.rows:
        assert [row[k].text for k in (4, 5, 11, 12)] == ["+10.0", "+5.0", "10.0", "5.0"]
        assert row[13].text == "plain"


def test_where_the_plain_guess_is_closer_the_page_says_so():
    found = page(model(), verdict(run(1200, 9.0, plain=8.0), run(1500, 9.0)))
    (doubt,) = found.doubts
    assert doubt.startswith("On 1 of 2 judged recordings the plain guess (coefficients of the")
    assert doubt.endswith("comes closer to the forces than the model.")
    said = words(found)
    assert "is closer than the model in the RMS force on 1, in the peak force on 1 and in" in said


def test_a_plain_guess_with_a_better_mean_alone_is_said_and_is_no_doubt():
    found = page(model(), verdict(run(1200, 9.0, plain_mean=-1.0)))
    assert "is closer than the model in the mean force on 1." in words(found)
    assert not found.doubts


def test_what_is_beyond_its_limit_is_marked_and_not_said_again():
    reason = "RMS error: 31 % > 20 %"
    table = page(model(), verdict(run(1200, 31.0, reasons=(reason,)))).sections[1].blocks[0]
    marks = [cell.text for cell in table.rows[0] if cell.status == "failed"]
    assert marks == ["31.0", "failed"]  # peak and mean, 20.7 and 15.5 %, are within
    assert reason not in " ".join(block_words(table))
    odd = verdict(run(1200, 9.0, status="failed", reasons=("z drifted",)))
    assert "failed z drifted" in words(page(model(), odd))


@pytest.mark.parametrize(("error", "said"), [(35.0, True), (5.0, False)])
def test_a_fit_to_the_others_that_fails_is_said_in_the_head_of_a_model_that_passed(error, said):
    judged = verdict(run(600, 8.0, "training"), run(900, 4.0), cross(600, error))
    found = page(model(folds=folds((600, 1200))), judged)
    assert found.verdict.status == "passed"
    words = "fails when predicted by a fit to the other recordings: the RMS force is wrong by up"
    assert (words in " ".join(found.notes)) == said


def test_cross_predictions_name_what_they_were_fitted_on():
    runs = [run(f, 8.0, "training") for f in (600, 1200)]
    rows = tuple(recording(f, "training") for f in (600, 1200))
    found = model(folds=folds((600, 1200)), recordings=rows)
    said = words(page(found, verdict(*runs, cross(600, 9.0)), predictions()))
    assert (
        "6-n6000f600ap3ae25 6-n6000f1200ap3ae25 6 000 0.0500 3 9.0 18.0 −6.0 −12.0 +4.5 +9.0"
        in said
    )
    assert "Every recording was learnt from, so each is also predicted by a fit on the" in said
    assert "Forces of the cut 9.0 % worst of 1 cross prediction, limit 20 %" in said
    assert (
        "whose RMS error is 8.0 % (plain guess 16 %); fitted on other recordings it errs by 9.0 %. "
        "learnt from" in said
    )


# ---- files that are not there, numbers that are compared


@pytest.mark.parametrize("lost", ["model", "verdict", "predictions"])
def test_without_one_file_the_rest_stands(lost):
    files = {"model": model(), "verdict": verdict(), "predictions": predictions()} | {lost: None}
    found = page(*files.values())
    said = words(found)
    assert ("Coefficients of the cut" in said) == (lost != "model")
    assert ("6-n6000f1200ap3ae25" in said) or lost == "verdict"
    assert ("How well forces are predicted" in said) == (lost != "verdict")
    drawn = any(
        isinstance(b, Figures) for s in found.sections if s.key == "forces" for b in s.blocks
    )
    assert drawn == (lost == "model")


def test_key_figures_are_compared_with_the_last_reports():
    compared = page(model(), verdict(), predictions()).compared
    assert compared["cut_rms_percent"].value == pytest.approx(14.2)
    assert compared["cut_peak_percent"].value == pytest.approx(14.2 / 1.5)
    assert compared["cuts_judged"].value == 2
    assert page(model()).compared["cuts_judged"].value is None


@pytest.mark.parametrize(("factor", "worn"), [(1.4, True), (1.2, False), (0.7, False)])
def test_growth_counts_only_beyond_both_intervals(factor, worn):
    """12 % each way: 21 * 1.12 = 23.5 against 29.4 * 0.88 = 25.9."""
    note = wear_note("", "K_te", coefficients()["K_te"], coefficients(factor=factor)["K_te"])
    said = "K_te grew by more than both intervals allow: look for an edge that has worn since"
    assert note.startswith(said) == worn and bool(note) == worn


def test_grown_runout_sends_to_the_holder_and_shrunk_runout_to_nobody():
    before, grown, less = (parameter(value, "um", 0.08) for value in (11.4, 14.0, 8.0))
    assert "look for a tool that no longer runs true" in wear_note("", "runout", before, grown)
    assert wear_note("", "runout", before, less) == ""
    assert wear_note("channel x", "damping", before, grown) == ""
    force = POWERS["specific_force"]
    more = parameter(3000.0, "N/mm^2")
    assert wear_note("spindle", "specific_force", force, more).startswith("spindle specific_force")


# ---- truth of a simulated machine


def test_the_truth_stands_beside_what_was_found():
    said = words(page(model(), verdict(), None, truth={"cutting": TRUTH}))
    # K_te misses: 21 +- 12 % ends at 23.52; three pitches of two teeth are 540 deg
    assert "simulated against identified; 7 of 9 intervals hold the truth" in said
    assert "K_tc 1 800 1 820 +1.11 1 747 to 1 893 N/mm² holds the truth" in said
    assert "K_te 25.0 21.0 −16.00 18.5 to 23.5 N/mm misses the truth" in said
    assert "runout_angle 577 37.0 – 29.6 to 44.4 ° holds the truth, modulo 180°" in said
    assert "helix 30.0 not determined – – ° –" in said
    assert "specific_force 1 950 2 010 +3.08 1 869 to 2 151 N/mm² holds the truth" in said
    # at the tool 0.9 of what the motor takes: 603 W, and 1710 W against 1564 +- 42 W
    assert "no-load power at 6 000 603 614 +1.82 587 to 641 W holds the truth" in said
    assert "no-load power at 12 000 1 710 1 564 −8.54 1 522 to 1 606 W misses the truth" in said
    assert "no-load power at 500" not in said


def test_a_machine_without_a_known_truth_has_none_to_show():
    assert not page(model(), verdict()).truth


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e3), st.floats(-2, 2), st.integers(-5, 5))
def test_an_interval_holds_what_lies_within_it_and_whole_periods_from_it(value, half, place, k):
    p = Parameter(
        value=value, unit="deg", interval_95=(value - half, value + half), determined=True,
        method="",
    )  # fmt: skip
    true = value + place * half
    inside = value - half <= true <= value + half
    assert holds(p, true) == inside
    if abs(place) < 0.99:  # away from the ends, where a period's rounding counts
        assert holds(p, true + 120.0 * k, 120.0)
    if half < 50 and 1.01 < abs(place) < 1.2:  # beyond the end and short of the next period
        assert not holds(p, true + 120.0 * k, 120.0)


def test_what_is_not_determined_is_neither_shown_nor_compared():
    p = parameter(None, "um")
    assert value_words(p) == "not determined"
    assert holds(p, 3.0) is None and off_percent(p, 3.1) is None
    assert unit_of(p) == "µm"


def test_recordings_without_names_of_use_are_not_counted_as_training():
    said = words(page(model(recordings=(recording(600, "odd"),), tool={}, material="")))
    assert "The recordings that they were identified from of a tool are not named." in said


def test_the_worst_and_the_best_recording_are_named():
    assert name_of(1500) in words(page(model(), verdict(), predictions())).split("worst pred")[0]
