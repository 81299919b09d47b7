"""What the page says of the feed drives: verdict, parameters, searches, recordings, truth."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.charts.numbers import resolved
from pipeline.schema.model import Parameter
from pipeline.schema.verdict import Fact
from pipeline.submodels.drive.page import Driven, _held, drive_page, drives_verdict
from pipeline.submodels.drive.page_parameters import (
    truth_as_fitted,
)
from pipeline.submodels.drive.submodel import SUBMODEL
from tests.submodels.drive.shown_drives import (
    FACTS,
    METHOD,
    drive_axis,
    drive_model,
    method,
    parameter,
    plain,
    shown,
    verdict_on,
    words,
)


@pytest.fixture(scope="module")
def text():
    return words(SUBMODEL.page(shown()))


def said(**changes) -> str:
    return words(drive_page(shown(**changes)))


def axes(**changes):
    """A model of X alone, with parts of the axis changed."""
    return drive_model("X", axes={"X": drive_axis("X", **changes)})


def test_without_files_there_is_no_page():
    assert drive_page(shown(model=None, verdict=None, predictions=None, truth=None)) is None


@pytest.mark.parametrize("absent", ["model", "verdict", "predictions", "truth"])
def test_without_one_file_the_rest_stands(absent):
    found = said(**{absent: None})
    assert ("Parameters of axis X" in found) == (absent != "model")
    assert ("servo/circle-20mm X 24.6" in found) == (absent != "verdict")
    drawn = absent not in ("model", "verdict", "predictions")
    assert ("where the twin is farthest off" in found) == drawn
    assert ("intervals hold the truth" in found) == (absent not in ("model", "truth"))


def test_parameters_stand_in_shop_units_with_interval_and_remedy(text):
    # 0.0041 m/s +- 20 %; 0.0061 H +- 4 %
    assert "speed over which starting friction gives way, towards +X 4.10 3.28 to 4.92 mm/s" in text
    assert "inductance along the magnets’ flux 6.10 5.86 to 6.34 mH" in text
    assert (
        "friction at the start of motion, towards −Y not determined – N the records do not hold "
        "it; record reciprocation at speeds below 1 mm/s, 1 s each" in text
    )
    assert (
        "Of the drives the records do not determine (X) force that is always there, such as "
        "gravity less counterbalance; (Y) friction at the start of motion, towards +Y"
    ) in text


def test_an_interval_narrower_than_three_digits_is_not_printed_as_a_point(text):
    assert (
        "position_scale gain of the position loop over its nominal one 1.1200 1.1178 to 1.1222"
        in text
    )


def test_methods_that_several_parameters_share_are_said_once():
    used = {"a": "motion", "b": "motion", "c": "the loop", "d": "the loop", "e": "a data sheet"}
    parameters = {name: replace(parameter(1.0, "N"), method=one) for name, one in used.items()}
    found = said(model=drive_model("X", parameters={"X": parameters}))
    assert "Methods: (a) motion; (b) the loop." in found
    assert "d – 1.000 0.9700 to 1.030 N (b) e – 1.000 0.9700 to 1.030 N a data sheet" in found
    assert METHOD not in found


def test_forces_of_an_unknown_drive_stay_in_its_command():
    model = axes(force_unit="A")
    model = replace(model, parameters={"X": {"mass": parameter(1.7, "A s^2/m")}})
    found = said(model=model)
    assert (
        "Nobody has said what force one A makes, so forces are in A: give force_constant" in found
    )
    assert "inertia as mass 1.70 1.65 to 1.75 A s²/m" in found


def test_the_strongest_correlation_of_the_fit_is_named(text):
    assert (
        "The residual of the fit is 2.6 % of the force over 23 410 samples; the condition is 42; "
        "the most correlated are viscous_positive and coulomb_positive (correlation −0.83)." in text
    )


def test_an_axis_says_how_its_loops_were_identified_or_why_not():
    correlation = replace(FACTS.correlation, names=("velocity_scale", "integral_scale"),
                          values=((1, 0.97), (0.97, 1)))  # fmt: skip
    loops = replace(FACTS, relative_error_percent=0.882, correlation=correlation)
    assert (
        "Its loops’ gains leave 0.88 % of the command unexplained; the most correlated are "
        "integral_scale and velocity_scale (correlation 0.97)." in said(model=axes(servo_fit=loops))
    )
    found = said(model=axes(servo_reason="X has no reference"))
    assert "Its loops could not be found: X has no reference." in found


@pytest.mark.parametrize(
    ("errors", "won", "counts"),
    [
        ([(1.0, 2.0), (3.0, 5.0)], "Least squares won: of 2 tasks", (2, 0, 0)),
        ([(2.0, 1.0), (3.0, 2.0), (1, 4)], "The genetic search won: of 3 tasks", (1, 2, 0)),
        ([(1.0, 1.0005), (2.0, 2.0)], "Neither search won: of 2 tasks", (0, 0, 2)),
    ],
)
def test_the_search_that_won_is_said(errors, won, counts):
    rows = tuple(
        method(f"t{i}", name, float(error), count)
        for i, pair in enumerate(errors)
        for name, error, count in zip(("least_squares", "genetic"), pair, (50, 10_000), strict=True)
    )
    better, worse, alike = counts
    assert (
        f"{won} least squares has the smaller error in {better}, the genetic search in {worse}, "
        f"and in {alike} they are alike within 0.1 %; for each evaluation of least squares the "
        "genetic search needed 200 (median)." in said(model=axes(methods=rows))
    )


def test_recordings_say_what_was_done_to_them(text):
    assert "Identified from 3 recordings of X, Y and Z." in text
    assert "servo/short left out has 3 rows" in text
    assert "servo/reciprocation-X 55.9 –" in text
    assert "servo/reciprocation-X fitted on servo/reciprocation-X.csv 0606" in text


def test_each_recording_has_its_errors_guesses_and_verdict(text):
    assert "servo/program-plate X 24.6 6.2 38.4 412 1 604 7.3 9.5 30.1 71.0 passed" in text
    assert "servo/reciprocation-X X 24.6 2.6 38.4 412 1 604 2.1 2.7 8.65 71.0 fitted on" in text
    assert (
        "The twin’s X, Y and Z axes follow their records: on 2 judged recordings the force is "
        "wrong by up to 6.2 % (limit 10 %) and the following error by up to 9.4 % (limit 15 %)."
        in text
    )
    assert "Following errors 9.4 % worst of judged recordings, axis Z, limit 15 %" in text


@pytest.mark.parametrize("level", [4.31, None])
def test_where_no_following_error_is_known_means_show_the_friction_levels(level):
    from pipeline.schema.verdict import Fact

    facts = {"mean force X modelled": Fact(value=4.28, unit="A")}
    if level is not None:
        facts["mean force X measured"] = Fact(value=level, unit="A")
    found = said(verdict=verdict_on({("X", "experiment_02"): (31.0, None)}, facts=facts))
    assert ("4.31 4.28" in found and "modelled" in found) == (level is not None)


def test_what_a_recording_does_not_show_is_a_dash_not_a_number():
    found = said(verdict=verdict_on({("X", "one"): (4.0, None)}))
    assert "on 1 judged recording the force is wrong by up to 4.0 % (limit 10 %)." in found
    assert "one X 24.6 4.0 38.4 passed" in found and "plain guess is speed over" not in found
    found = said(verdict=verdict_on({("X", "one"): (4.0, None), ("X", "two"): (None, 3.0)}))
    assert "one X 24.6 4.0 38.4 – – – – – – passed" in found
    assert "two X 24.6 – – 412 1 604 3.0 3.9 12.4 71.0 passed" in found
    found = said(verdict=verdict_on({("X", "still"): (6.69e8, None)}))
    assert "still X 24.6 — (of nearly 0) 38.4 failed" in found
    assert "the force is wrong by up to more than 1000 % of nearly 0 (limit 10 %)" in found


def test_a_failed_axis_is_named_with_what_is_beyond_its_limit():
    runs = {("X", "a"): (3.0, 4.0), ("Z", "a"): (13.0, 4.0), ("Z", "b"): (3.0, 3.0)}
    verdict = drives_verdict(Driven.of(shown(verdict=verdict_on(runs))))
    assert verdict.status == "failed"
    assert plain(verdict.sentence) == (
        "The twin’s Z axis does not follow its records: on 1 of 2 judged recordings the force is "
        "wrong by up to 13 % (limit 10 %); X does."
    )
    assert verdict.todo.startswith("Do not plan with the twin’s Z yet")


@pytest.mark.parametrize(
    ("runs", "changes", "why"),
    [
        ({("X", "a"): (1.0, 1.0, "training")}, {}, "every recording of X was learnt from"),
        ({("X", "a"): (1.0, 1.0)}, {"status": "not judged", "reasons": ("Y was left out.",)},
         "Y was left out."),
        ({("X", "a"): (1.0, 1.0)}, {"status": "not judged"}, "no recording"),
        ({}, {}, "every recording of X was learnt from"),
    ],
)  # fmt: skip
def test_nobody_reads_that_unjudged_drives_follow(runs, changes, why):
    verdict = drives_verdict(Driven.of(shown(verdict=verdict_on(runs, **changes))))
    assert verdict.status == "unknown"
    assert verdict.sentence.startswith(f"The twin’s drives were not judged: {why}")
    sentence = plain(verdict.sentence)
    assert not any(one in sentence for one in ("follow their", "follows its", ".."))
    counts = "On the judged recordings the force is wrong by up to 1.0 %" in sentence
    assert counts == bool(changes)


def test_a_verdict_on_training_records_does_not_hold():
    verdict = verdict_on(status="failed", reasons=("a.csv has the same bytes as b.csv",))
    found = drives_verdict(Driven.of(shown(verdict=verdict)))
    assert found.status == "failed" and "same bytes" in found.sentence


def test_why_a_run_failed_is_said_and_what_holds_for_the_axis_is_not_repeated():
    why = "no training recording of axis X has a reference"
    runs = {("X", "one"): (14.0, None), ("X", "two"): (4.0, None)}
    verdict = verdict_on(runs, notes=dict.fromkeys(("one", "two"), f"X: {why}"))
    found = said(model=axes(servo_reason=why), verdict=verdict)
    assert "one X 24.6 14.0 38.4 failed force X, relative error 14 % is above 10 %" in found
    assert "two X 24.6 4.0 38.4 passed –" in found
    assert found.count(why) == 1


def test_what_the_next_report_is_compared_with():
    compared = drive_page(shown()).compared
    assert compared["drive_force_percent"].value == 6.2
    assert compared["drive_following_percent"].value == 9.4
    assert compared["drives_judged"].value == 5


def test_the_truth_stands_beside_what_was_identified(text):
    assert "7 of 8 intervals hold the truth" in text
    assert "X mass 421.0 420.0 −0.24 417.5 to 422.5 kg holds the truth" in text
    assert "X stribeck_velocity_positive 4.00 4.10 +2.50 3.28 to 4.92 mm/s holds the truth" in text
    assert "X viscous_positive 960 902 −6.04 875 to 929 N s/m misses the truth" in text
    assert "Y static_positive 430 not determined – – N –" in text
    assert "motor L_d 6.00 6.10 +1.67 5.86 to 6.34 mH holds the truth" in text


def test_intervals_that_miss_the_truth_are_named_outside_of_the_folded_table():
    notes = " ".join(drive_page(shown()).notes).replace("\u202f", " ")
    assert "Of 8 intervals of 95 % of the drives’ parameters 7 hold the simulated truth" in notes
    assert "X viscous_positive misses it" in notes


@given(st.floats(1e-3, 1e4), st.floats(1e-3, 0.5))  # narrower than five digits show
def test_printed_intervals_keep_their_width(value, share):
    low, high = value * (1 - share), value * (1 + share)
    digits = resolved(low, high)
    printed = [float(f"{x:.{digits}g}") for x in (low, high)]
    # two digits of the width: either end is off by at most a twentieth of it
    assert printed[1] - printed[0] == pytest.approx(high - low, rel=0.1)


LEVEL = st.floats(10.0, 1e3)


@given(LEVEL, LEVEL, LEVEL, st.floats(-2e3, 2e3), st.booleans())
def test_a_truth_split_as_the_fit_splits_it_has_the_same_force_in_motion(
    positive, negative, more, force, alike
):
    truth = {"coulomb_positive": positive, "coulomb_negative": negative, "offset": force,
             "static_positive": positive + more, "static_negative": negative + more}  # fmt: skip
    found = truth_as_fitted(truth, {
        "coulomb_positive": parameter(5.0, "N"),
        "coulomb_negative": parameter(5.0 if alike else 6.0, "N"),
        "offset": parameter(1.0 if alike else None, "N")})  # fmt: skip
    for kind in ("coulomb", "static"):
        there, back = (
            [t[f"{kind}_positive"] + t["offset"], -t[f"{kind}_negative"] + t["offset"]]
            for t in (truth, found)
        )
        assert back == pytest.approx(there, abs=1e-9)
    if alike:
        assert found["coulomb_positive"] == pytest.approx(found["coulomb_negative"])
    else:
        assert found["offset"] == 0


def test_a_fit_that_separates_friction_and_force_is_held_against_the_plain_truth():
    truth = {"coulomb_positive": 3.0, "coulomb_negative": 5.0, "offset": 7.0}
    found: dict[str, Parameter] = {"coulomb_positive": parameter(3.1, "N"),
                                   "coulomb_negative": parameter(4.9, "N"),
                                   "offset": parameter(7.2, "N")}  # fmt: skip
    assert truth_as_fitted(truth, found) == truth


DISTURBED = {
    "disturbance X enters at": Fact(value="the speed command"),
    "disturbance X, factor": Fact(value=2.5, unit="m/s per unit of the channel"),
    "disturbance X, factor, half width": Fact(value=0.12, unit="m/s per unit of the channel"),
    "disturbance X, error explained": Fact(value=98.0, unit="%"),
    "disturbance X, cause": Fact(value="the disturbance enters at the speed command, not as a "
                                       "force on the axis, it acts as if in mm/s"),
}  # fmt: skip


def test_where_a_disturbance_enters_stands_on_the_page():
    found = said(verdict=verdict_on(facts=DISTURBED))
    assert "Recorded disturbances" in found
    assert "the speed command 2.50 ± 0.12 m/s per unit of the channel – 98 " in found
    assert "acts as if in mm/s" in found
    assert "Recorded disturbances" not in said()


def test_a_failed_axis_names_the_cause_of_its_disturbance_in_the_headline():
    failed = verdict_on({("X", "pulses.mat"): (4.0, 16.0)}, facts=DISTURBED)
    sentence = drives_verdict(Driven.of(shown(verdict=failed))).sentence
    assert "enters at the speed command, not as a force on the axis" in sentence


@pytest.mark.parametrize(("held", "short"), [(0.85, True), (0.94, False)])
def test_intervals_that_hold_fewer_samples_than_promised_say_so(held, short):
    found = verdict_on()
    total = replace(
        found.scores[0],
        quantity="force X",
        group="all",
        coverage_90=held,
        regime="",
        role="held_out",
    )
    judged = replace(found, scores=(*found.scores, total))
    words_ = _held(judged, "force X").replace("\u202f", " ")
    assert f"held {100 * held:.0f} % of the judged samples" in words_
    assert ("fewer than the 90 % that are promised" in words_) == short
