"""Each fault is found and named by the judge that all sub-models share."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.charts.judged import scores_table
from pipeline.optimisation.reliability.uncertainty import held_out_errors
from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.schema.model import Model, SourceFile
from pipeline.schema.predictions import read_predictions, write_predictions
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import (
    Fact,
    OutsideConditions,
    UsedModel,
    Verdict,
    outside_conditions,
    widening,
)
from pipeline.submodels.canaries import canaries, failures
from pipeline.submodels.cases import Case, Cases, Roles, conditions_of, held_back, role_of
from pipeline.submodels.contract import Prediction, Target, submodel
from pipeline.submodels.judge import judge, metrics
from pipeline.submodels.scoring import figures

ERRORS = {"train": 0.1, "a": 0.2, "b": 0.3, "c": 0.4}
"""Error of the model in each recording, constant over its samples."""


def sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def case(name: str, role: str, *, bytes_of: str = "", feed: float = 600.0) -> Case:
    file = SourceFile(file=f"{name}.csv", sha256=sha(bytes_of or name))
    return Case(
        name=name, group=name, role=role, files=(file,), load=lambda: name,
        conditions={"feed": Fact(value=feed, unit="mm/min"), "material": Fact(value="C45")},
    )  # fmt: skip


def predictor(one: Case) -> Prediction:
    """A ramp that is predicted too high by the recording's error; the baseline by 1."""
    measured = np.linspace(10.0, 20.0, 50)
    frame = pd.DataFrame(
        {
            "quantity": "force", "unit": "N", "t": np.arange(50.0), "measured": measured,
            "predicted": measured + ERRORS.get(one.name, 0.2), "low": measured - 0.5,
            "high": measured + 0.5, "baseline_mean": measured + 1.0,
        }
    )  # fmt: skip
    return Prediction(frame=frame.assign(regime=""))


def changed(**columns: Any):
    """A predictor with columns of another value, or of a function of its rows."""
    return lambda one: Prediction(frame=predictor(one).frame.assign(**columns))


def shifted(found: Prediction, by: float) -> Prediction:
    """A prediction moved by that, with those of its other trainings."""
    moved = [c for c in found.frame if c.startswith(("predicted", "again"))]
    return Prediction(frame=found.frame.assign(**{c: found.frame[c] + by for c in moved}))


TARGET = Target(
    quantity="force", unit="N", limits={"mae": 0.35}, baselines=("mean",), must_beat=("mean",)
)


def judged(name: str, cases: list[Case], *, target=TARGET, predict=predictor, sets=None, **files):
    training = [one for one in cases if one.role == "training"]
    model = Model(
        submodel=name, machine="mill", origin="simulated", parameters={},
        trained_on=tuple(one.training for one in training), conditions=conditions_of(training),
    )  # fmt: skip
    known = {f.file: {"sha256": f.sha256, "last": None} for one in cases for f in one.files}
    return judge(
        model, predict, Cases(cases=tuple(cases)), [target], sets=sets, files=known | files
    )


TRAIN, A, B = case("train", "training"), case("a", "held_out"), case("b", "held_out")


def test_a_sound_model_passes_on_what_it_was_not_fitted_on() -> None:
    found = judged("spindle", [TRAIN, A, B]).verdict
    assert (found.status, found.reasons, found.judged_role) == ("passed", (), "held_out")
    scores = {s.group: s for s in found.scores if s.role == "held_out"}
    assert (scores["a"].mae, scores["b"].rmse) == (0.2, 0.3)
    assert scores["all"].mae == 0.25
    assert scores["a"].coverage_90 == 1.0
    assert scores["a"].baselines["mean"].mae == 1.0
    (trained,) = found.of("force", group="train")
    assert (trained.status, trained.role) == ("not judged", "training")
    assert metrics(found)["force"]["skill_mae"] == {"mean": 0.75}


def test_an_error_beyond_its_limit_is_named_with_value_and_limit() -> None:
    found = judged("spindle", [TRAIN, A, case("c", "held_out")]).verdict
    assert found.status == "failed"
    assert found.reasons == ("c: force, mean error 0.4 N is above 0.35 N",)


def test_a_share_of_next_to_nothing_has_no_figure() -> None:
    """A force that was zero all the time: a relative error of it is no number for a person."""
    target = replace(TARGET, limits={"relative_percent": 15.0}, must_beat=())
    still = changed(measured=1e-9)
    (reason,) = judged("drive", [TRAIN, A], target=target, predict=still).verdict.reasons
    assert reason == "a: force, relative error more than 1000 % of nearly 0 is above 15 %"
    used = UsedModel(submodel="control", figures="times", status="failed", spread_percent=2710.0)
    assert used.sentence.endswith("standard deviation of more than 1000 % of nearly 0")


def test_one_bad_record_is_named_and_does_not_decide_alone() -> None:
    """Where the target says so, and enough others passed; two of them decide as before."""
    target = replace(TARGET, alone=3)
    good = [case(name, "held_out") for name in ("a", "b", "d")]

    def wild(one: Case) -> Prediction:
        found = predictor(one)
        bad = one.name.startswith("bad")
        return replace(found, frame=found.frame.assign(predicted=500.0)) if bad else found

    def of(*cases: Case, target: Target = target) -> Verdict:
        return judged("control", [TRAIN, *cases], target=target, predict=wild).verdict

    found = of(*good, case("bad", "held_out"))
    assert found.status == "passed"
    assert found.of("force", group="all", role="held_out")[0].max == 0.3
    (named,) = found.set_aside
    assert named.startswith("bad: force, mean error 485 N is above 0.35 N, alone of all")
    (score,) = found.of("force", group="bad")
    assert (score.status, score.alone) == ("failed", True)
    errors = held_out_errors("control", found)
    assert len(errors) == 3 and max(error for _, error in errors) < 0.03
    assert of(*good[:2], case("bad", "held_out")).status == "failed"
    assert of(*good, case("bad", "held_out"), target=TARGET).status == "failed"
    two = of(*good, case("bad", "held_out"), case("bad2", "held_out"))
    assert (two.status, two.set_aside) == ("failed", ())


def banded(*, half: float, quantity: str = "force") -> Callable[[Case], Prediction]:
    """The predictor with intervals of a half width."""

    def found(one: Case) -> Prediction:
        rows = predictor(one).frame.assign(quantity=quantity)
        low, high = rows["predicted"] - half, rows["predicted"] + half
        return Prediction(frame=rows.assign(low=low, high=high))

    return found


def test_an_interval_of_no_use_is_not_known() -> None:
    """Beyond 2.5 times the RMSE over the groups that decide; training cases say nothing."""
    rmse = (
        judged("spindle", [TRAIN, A, B]).verdict.of("force", group="all", role="held_out")[0].rmse
    )
    wide = judged("spindle", [TRAIN, A, B], predict=banded(half=2.6 * rmse)).verdict
    assert wide.unknown_intervals == {
        ("force", ""): "90 % interval not known: 1 training cases give one of 2.6 times the RMSE, "
        "no use above 2.5; record more of them"
    }
    assert metrics(wide)["force"]["half_width_over_rmse"] == "not known"
    assert wide.status == "passed"
    narrow = judged("spindle", [TRAIN, A, B], predict=banded(half=2.4 * rmse)).verdict
    assert not narrow.unknown_intervals
    assert metrics(narrow)["force"]["half_width_over_rmse"] == pytest.approx(2.4, rel=1e-4)


def test_an_interval_is_held_against_its_error_inside_of_the_learnt_conditions() -> None:
    """Outside it has to be wide: three groups inside decide, with fewer all of them do."""
    inside = [case(name, "held_out") for name in ("a", "b", "d")]
    far = case("far", "held_out", feed=9000.0)
    rmse = judged("spindle", [TRAIN, *inside]).verdict.of("force", group="all")[-1].rmse
    found = judged("spindle", [TRAIN, *inside, far], predict=banded(half=2.0 * rmse)).verdict
    (whole,) = found.of("force", group="all", role="held_out")
    assert found.outside and whole.half_width > 2.5 * whole.rmse and not whole.unknown_interval
    assert whole.half_width_over_rmse == pytest.approx(2.0, rel=1e-4)
    few = judged("spindle", [TRAIN, *inside[:2], far], predict=banded(half=2.0 * rmse)).verdict
    assert few.unknown_intervals


def test_a_served_interval_that_is_not_known_is_empty_and_the_prediction_stands(
    tmp_path: Path,
) -> None:
    one = submodel("drive")
    verdict = judged(
        "drive", [TRAIN, A, B], target=replace(TARGET, quantity="force X"),
        predict=banded(half=9.0, quantity="force X"),
    ).verdict  # fmt: skip
    write_json(verdict, tmp_path / "verdict.json")
    columns = one.unknown_columns(tmp_path)
    assert set(columns) == {"X_force_low", "X_force_high"}
    assert all(why.startswith("90 % interval not known") for why in columns.values())
    served = pd.DataFrame({"X_force": [1.0], "X_force_low": [-8.0], "X_force_high": [10.0]})
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(one), "serve", lambda self, folder: lambda table: served)
        patched.setattr(type(one), "example", lambda self, folder: pd.DataFrame())
        found = one.answer(tmp_path)(pd.DataFrame({"t": [0.0]}))
    assert found["X_force"].tolist() == [1.0]
    assert found[["X_force_low", "X_force_high"]].isna().all(axis=None)


def test_the_same_bytes_under_another_name_are_a_leak() -> None:
    copy = case("copy", "held_out", bytes_of="train")
    found = judged("spindle", [TRAIN, A, copy]).verdict
    assert found.status == "failed"
    assert (
        "copy.csv has the same bytes as train.csv, which the model was fitted on"
        in (found.reasons[0])
    )


def test_a_case_outside_of_the_learnt_conditions_is_named_and_its_interval_widened() -> None:
    trained = [TRAIN, case("train2", "training", feed=1200.0)]
    far = case("a", "held_out", feed=1800.0)
    result = judged("spindle", [*trained, far, B])
    (outside,) = result.verdict.outside
    assert (outside.case, outside.condition, outside.value) == ("a", "feed", 1800.0)
    assert outside.learnt == "600 to 1200"
    rows = result.predictions.set_index("case")
    inside = rows.loc["b", "high"] - rows.loc["b", "predicted"]
    widened = rows.loc["a", "high"] - rows.loc["a", "predicted"]
    # one width of the range beyond its end: twice as wide, of what the predictor said itself
    np.testing.assert_allclose(widened, 2 * 0.3)
    np.testing.assert_allclose(inside, 0.2)


def test_a_condition_that_was_learnt_at_zero_alone_has_no_distance() -> None:
    """An entry angle of 90 degrees beside slots alone: the interval stays finite."""
    outside = OutsideConditions(
        case="a", condition="entry angle", value=90.0, unit="deg", learnt="0"
    )
    assert widening(outside) == 2.0
    assert widening(replace(outside, learnt="60 to 80")) == 1.5


def test_a_word_that_was_not_learnt_is_outside() -> None:
    steel = replace(A, conditions={"material": Fact(value="1.4301")})
    (outside,) = outside_conditions(steel.conditions, conditions_of([TRAIN]))
    assert (outside.value, outside.learnt) == ("1.4301", "C45")


def test_a_model_that_is_worse_than_its_baseline_fails() -> None:
    worse = changed(predicted=lambda rows: rows["measured"] - 1.5)
    wide = replace(TARGET, limits={"mae": 9.0}, titles={"mean": "mean wear"})
    found = judged("spindle", [TRAIN, A, B], target=wide, predict=worse).verdict
    assert found.status == "failed"
    assert found.reasons == found.missed == (
        "force over all: mean error 1.5 N is not below that of mean wear, 1 N",
        "force over all: RMSE 1.5 N is not below that of mean wear, 1 N",
    )  # fmt: skip
    rows = {one.group: one for one in found.of("force", role="held_out")}
    assert {name: one.status for name, one in rows.items()} == {
        "a": "passed", "b": "passed", "all": "failed",
    }  # fmt: skip
    assert rows["all"].reasons == found.reasons


def test_better_on_one_of_two_errors_is_not_better() -> None:
    """Half of the samples right and half 1.9 off: a lower mean error than 1, a higher RMSE."""
    uneven = changed(predicted=lambda rows: rows["measured"] - 1.9 * (np.arange(len(rows)) % 2))
    wide = replace(TARGET, limits={"mae": 9.0})
    found = judged("spindle", [TRAIN, A, B], target=wide, predict=uneven).verdict
    assert found.status == "failed"
    assert [reason.split(":")[1][:5] for reason in found.reasons] == [" RMSE"]


@pytest.mark.parametrize(
    ("resolution", "status"), [(0.0, "not decided"), (1.0, "not decided"), (1e-6, "failed")]
)  # 0: the recorded values lie on whole numbers, which tells their step
def test_worse_by_less_than_the_sensor_tells_is_not_decided(resolution: float, status: str) -> None:
    hardly_worse = changed(
        predicted=lambda rows: 2.001 * rows["measured"] - 1.001 * rows["baseline_mean"]
    )
    near = replace(TARGET, limits={"mae": 9.0}, each_group=True, resolution=resolution)
    found = judged("spindle", [TRAIN, A, B], target=near, predict=hardly_worse).verdict
    assert found.status == status
    assert all(("not decided" in reason) == (status == "not decided") for reason in found.reasons)


def again(spread: float, one: Case) -> Prediction:
    """As :func:`predictor`, by four trainings whose errors differ by -1, 0, 0 and 1 ``spread``."""
    frame = predictor(one).frame
    repeated = {
        f"again_{k}": frame["predicted"] + spread * by for k, by in enumerate((-1, 0, 0, 1))
    }
    return Prediction(frame=frame.assign(**repeated))


T_3 = 3.182446305284263
"""Student's t of three degrees of freedom, 97.5 % (a table's 3.182)."""


@pytest.mark.parametrize(
    ("limit", "spread", "status"),
    [
        (0.35, 0.0, "passed"), (0.35, 0.01, "passed"), (0.35, 0.03, "not decided"),
        (0.25, 0.03, "not decided"), (0.25, 0.01, "failed"), (0.25, 0.0, "failed"),
    ],
)  # fmt: skip
def test_an_error_nearer_to_its_limit_than_trainings_differ_is_not_decided(
    limit: float, spread: float, status: str
) -> None:
    """0.05 N off a limit on either side; four trainings of deviation 0.8165 times ``spread``."""
    target = replace(TARGET, limits={"mae": limit})
    found = judged("wear", [TRAIN, B], target=target, predict=partial(again, spread)).verdict
    assert found.status == status
    if status == "not decided":
        assert found.reasons == (
            f"b: force, mean error 0.3 N is too near to the limit of {limit} N: trainings differ "
            f"by \u00b1 {0.03 * np.sqrt(2 / 3) * T_3:.2g} N, not decided",
        )
        assert found.missed == found.reasons
    (score,) = found.of("force", group="b")
    assert score.status == status
    assert score.spread.get("mae", 0.0) == pytest.approx(spread * np.sqrt(2 / 3) * T_3, rel=1e-5)
    assert metrics(found)["force"]["spread_mae"] == (score.spread["mae"] if spread else 0.0)
    trained = found.of("force", role="training")
    assert not any(one.spread for one in trained)


def test_an_error_that_surely_fails_is_not_covered_by_one_that_is_not_decided() -> None:
    target = replace(TARGET, limits={"mae": 0.35})
    cases = [TRAIN, B, case("d", "held_out")]
    near = partial(again, 0.03)
    found = judged(
        "wear", cases, target=target,
        predict=lambda one: shifted(near(one), 0.5 if one.name == "d" else 0.0),
    ).verdict  # fmt: skip
    assert found.status == "failed"
    assert found.reasons == ("d: force, mean error 0.7 N is above 0.35 N",)
    assert {s.group: s.status for s in found.scores if s.limits and s.role == "held_out"} == {
        "b": "not decided", "d": "failed",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("error", "status"),
    [(0.8, "passed"), (0.95, "not decided"), (1.05, "not decided"), (1.2, "failed")],
)
@pytest.mark.parametrize("each_group", [False, True])
def test_a_guess_that_is_beaten_by_less_than_trainings_differ_is_not_decided(
    error: float, status: str, each_group: bool
) -> None:
    """The guess is off by 1 N, trainings differ by 0.13 N."""

    def off(one: Case) -> Prediction:
        return shifted(again(0.05, one), error - ERRORS.get(one.name, 0.2))

    target = replace(TARGET, limits={"mae": 9.0}, each_group=each_group, resolution=1e-9)
    found = judged("wear", [TRAIN, B], target=target, predict=off).verdict
    assert found.status == status
    if status == "not decided":
        assert (
            f"force over all: mean error {error} N is too near to that of mean, 1 N: trainings "
            "differ by \u00b1 0.13 N, not decided"
        ) in found.reasons


@pytest.mark.parametrize(
    ("least", "most", "status"),
    [(0.5, 0.99, "passed"), (0.75, 0.99, "not decided"), (0.0, 0.75, "not decided"),
     (0.97, 0.99, "failed")],
)  # fmt: skip
def test_a_share_nearer_to_its_limit_than_trainings_differ_is_not_decided(
    least: float, most: float, status: str
) -> None:
    """80 % lie inside, of four trainings 70, 80, 80 and 80 %."""

    def shares(one: Case) -> Prediction:
        measured = np.linspace(10.0, 20.0, 100)
        off = np.repeat(np.arange(10.0), 10) + 0.5  # of ten levels, eight below 8
        frame = pd.DataFrame(
            {
                "quantity": "force", "unit": "N", "t": np.arange(100.0), "measured": measured,
                "predicted": measured - off, "low": measured - off, "regime": "",
                "high": measured - off + 8.0, "baseline_mean": measured + 99.0,
            }
        )  # fmt: skip
        repeated = {f"again_{k}": frame["predicted"] + by for k, by in enumerate((-0.7, 0, 0, 0))}
        return Prediction(frame=frame.assign(**repeated))

    target = replace(TARGET, limits={"mae": 99.0}, coverage=(least, most))
    learnt = [case(f"t{k}", "training") for k in range(9)]  # of fewer the width is wider by design
    found = judged("wear", [*learnt, A, B], target=target, predict=shares).verdict
    total = found.total("force")
    assert total is not None
    assert total.coverage_90 == 0.8
    assert total.spread["coverage_90"] == pytest.approx(0.05 * T_3, rel=1e-5)
    assert found.status == total.status == status


def test_predictions_of_other_trainings_are_judged_and_not_stored(tmp_path: Path) -> None:
    found = judged("wear", [TRAIN, B], predict=partial(again, 0.1))
    write_predictions(found.predictions, tmp_path / "predictions.parquet")
    assert not [c for c in read_predictions(tmp_path / "predictions.parquet") if "again" in c]
    write_json(found.verdict, tmp_path / "verdict.json")
    assert read_json(tmp_path / "verdict.json", Verdict) == found.verdict
    table = scores_table("scores", found.verdict.scores, [])
    assert table is not None
    of_b = next(row for row in table.rows if row[0].text == "b")
    assert [cell.text for cell in of_b[3:6]] == ["0.300 ± 0.26", "0.300 ± 0.26", "0.300 ± 0.26"]


def test_one_other_training_or_one_that_lacks_rows_tells_no_spread() -> None:
    def one_only(one: Case) -> Prediction:
        frame = again(0.1, one).frame
        half = frame["again_1"].where(frame["t"] > 3)
        return Prediction(frame=frame.assign(again_1=half, again_2=np.nan, again_3=np.nan))

    found = judged("wear", [TRAIN, B], predict=one_only).verdict
    assert not any(score.spread for score in found.scores)


def test_a_golden_file_that_changed_is_named() -> None:
    frozen = FrozenSet(
        files=(SourceFile(file="a.csv", sha256="0" * 64), SourceFile(file="gone.csv", sha256="1")),
        days=Days(first="2026-01-19", last="2026-01-25"),
    )
    late = {"late.txt": {"sha256": "2", "last": "2026-01-20T12:00:00Z"}}
    golden = replace(A, role="golden")
    sets = GoldenSets(machine="mill", golden=frozen)
    found = judged("spindle", [TRAIN, golden, B], sets=sets, **late).verdict
    assert found.status == "failed"
    changed, gone, new = found.reasons
    assert "a.csv of the golden set has sha256" in changed
    assert "frozen was 000000000000" in changed
    assert gone == "gone.csv of the golden set is not among the records"
    assert new == "late.txt reaches into the days of the golden set and was not frozen with it"


def test_a_golden_file_that_was_fitted_on_is_named() -> None:
    frozen = FrozenSet(files=TRAIN.files)
    found = judged("spindle", [TRAIN, A], sets=GoldenSets(machine="mill", golden=frozen)).verdict
    assert found.status == "failed"
    assert "train.csv of the golden set has the same bytes as train.csv" in found.reasons[0]


def frozen_set(*names: str, days: Days | None = None, whole: tuple[str, ...] = ()) -> GoldenSets:
    files = tuple(SourceFile(file=one, sha256=sha(one.removesuffix(".csv"))) for one in names)
    return GoldenSets(machine="mill", golden=FrozenSet(files=files, days=days, whole=whole))


MONDAY = Days(first="2026-01-19", last="2026-01-19")


@pytest.mark.parametrize(
    ("files", "sets", "day", "role"),
    [
        (["a.csv"], frozen_set("a.csv"), "", "golden"),
        (["a.csv"], frozen_set("a.csv"), "2026-01-19", "golden"),  # by name, though it has a day
        (["a.csv"], frozen_set("a.csv", days=MONDAY), "2026-01-20", "training"),
        (["a.csv"], frozen_set("a.csv", days=MONDAY, whole=("a.csv",)), "2026-01-20", "golden"),
        (["b.csv"], frozen_set("a.csv", days=MONDAY), "2026-01-19", "golden"),
        (["a.csv#tool=T3", "a.csv"], frozen_set("a.csv"), "", "golden"),
        (["a.csv#tool=T3", "a.csv"], frozen_set("a.csv#tool=T3"), "", "golden"),
        (["a.csv#tool=T3 (part 2)", "a.csv"], frozen_set("a.csv#tool=T3"), "", "golden"),
        (["a.csv#tool=T3,cut=1", "a.csv"], frozen_set("a.csv#tool=T3"), "", "golden"),
        (["a.csv#tool=T31", "a.csv"], frozen_set("a.csv#tool=T3"), "", "training"),
        (["a.csv"], frozen_set("a.csv#tool=T3"), "", "golden"),  # it holds frozen rows
        (["b.csv#tool=T3", "b.csv"], frozen_set("a.csv#tool=T3"), "", "training"),
    ],
)
def test_nothing_that_is_frozen_is_for_training(
    files: list[str], sets: GoldenSets, day: str, role: str
) -> None:
    assert role_of(files, Roles(training=("*.csv*",)), sets, day) == role


def test_a_training_case_with_frozen_bytes_is_left_out_of_the_fit() -> None:
    cases = Cases(cases=(TRAIN, case("copy", "training", bytes_of="a"), replace(A, role="golden")))
    kept = held_back(cases, frozen_set("a.csv"))
    assert [one.name for one in kept.cases] == ["train", "a"]
    (left,) = kept.left_out
    assert left.case == "copy"
    assert left.reason == ("copy.csv has the same bytes as a.csv, which is frozen: record another")
    assert held_back(cases, None) == cases


def test_other_days_of_one_log_are_learnt_from_beside_its_golden_day() -> None:
    log = (SourceFile(file="log.csv", sha256=sha("log")),)
    learnt = replace(case("2026-01-20", "training"), files=log)
    judged_day = replace(case("2026-01-19", "golden"), files=log)
    sets = frozen_set("log.csv", days=MONDAY)
    cases = Cases(cases=(learnt, judged_day))
    assert held_back(cases, sets).cases == cases.cases
    assert judged("spindle", [learnt, judged_day], sets=sets).verdict.status == "passed"
    whole = frozen_set("log.csv", days=MONDAY, whole=("log.csv",))
    assert [one.name for one in held_back(cases, whole).cases] == ["2026-01-19"]


def test_another_machines_golden_set_is_refused() -> None:
    sets = GoldenSets(machine="lathe", golden=FrozenSet(files=A.files))
    found = judged("spindle", [TRAIN, replace(A, role="golden")], sets=sets).verdict
    assert found.reasons[0] == "the golden set is one of lathe, not of mill"


def test_golden_cases_decide_where_there_are_some_and_sealed_ones_are_not_looked_at() -> None:
    sealed = replace(case("c", "sealed"), load=lambda: pytest.fail("a sealed case was loaded"))
    bad = case("c2", "held_out")
    golden = replace(A, role="golden")
    result = judged("drive", [TRAIN, golden, B, bad, sealed])
    assert result.verdict.judged_role == "golden"
    assert result.verdict.status == "passed"
    assert "c" not in set(result.predictions["case"])


def test_without_a_case_to_judge_by_the_reason_says_what_to_do() -> None:
    found = judged("drive", [TRAIN]).verdict
    assert found.status == "not judged"
    assert found.reasons[0].startswith("train.csv is the only recording of use")
    both = judged("drive", [TRAIN, case("train2", "training")]).verdict
    assert "leave some out of roles.training" in both.reasons[0]


def test_a_baseline_too_near_decides_nothing_where_nothing_is_limited() -> None:
    """With limits it is not decided, as a target without them is only shown."""
    spread = partial(again, 0.5)
    near = replace(TARGET, limits={}, each_group=False)

    def predict(one: Case) -> Prediction:
        found = spread(one).frame
        return Prediction(frame=found.assign(baseline_mean=found["predicted"] + 0.01))

    shown = judged("x", [TRAIN, A, B], target=near, predict=predict).verdict.total("force")
    limited = replace(near, limits={"mae": 99.0})
    held = judged("x", [TRAIN, A, B], target=limited, predict=predict).verdict.total("force")
    assert held is not None and held.status == "not decided"
    assert shown is None or shown.status == "not judged"


def test_every_group_counts_where_the_target_says_so() -> None:
    uneven = changed(baseline_mean=lambda rows: rows["measured"] + 0.25)
    each = replace(TARGET, each_group=True)
    found = judged("spindle", [TRAIN, A, B], target=each, predict=uneven).verdict
    assert any("b: RMSE 0.3 N is not below that of mean, 0.25 N" in r for r in found.reasons)


def test_the_bootstrap_draws_groups_and_says_how_sure_a_skill_is() -> None:
    cases = [TRAIN, *(case(f"h{k}", "held_out") for k in range(5))]
    (skill,) = judged("drive", cases).verdict.skills
    assert (skill.baseline, skill.groups) == ("mean", 5)
    assert skill.mae == pytest.approx(0.8)
    # the same error in every group: nothing to be unsure of
    assert skill.mae_interval_95 == pytest.approx((0.8, 0.8))
    (few,) = judged("drive", [TRAIN, A, B]).verdict.skills
    assert few.mae_interval_95 is None


def test_verdict_and_predictions_come_back_from_disk(tmp_path: Path) -> None:
    result = judged("drive", [TRAIN, A, B])
    write_json(result.verdict, tmp_path / "verdict.json")
    assert read_json(tmp_path / "verdict.json", Verdict) == result.verdict
    write_predictions(result.predictions, tmp_path / "predictions.parquet")
    back = read_predictions(tmp_path / "predictions.parquet")
    assert len(back) == 150
    np.testing.assert_array_equal(back["predicted"], result.predictions["predicted"])
    write_predictions(pd.DataFrame(), tmp_path / "empty.parquet")
    assert read_predictions(tmp_path / "empty.parquet").empty


def test_only_what_model_and_baselines_know_is_scored() -> None:
    def partly(one: Case) -> Prediction:
        frame = predictor(one).frame.copy()
        frame.loc[:9, "measured"] = np.nan
        frame.loc[10:19, "baseline_mean"] = np.nan
        frame.loc[20:29, "scored"] = False
        frame["scored"] = frame["scored"].fillna(True).astype(bool)
        return Prediction(frame=frame)

    (score,) = judged("drive", [TRAIN, A], predict=partly).verdict.of("force", group="a")
    assert score.n == 20


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30), st.floats(-10, 10))
def test_figures_are_those_of_their_definitions(values: list[float], off: float) -> None:
    measured = np.array(values)
    predicted = measured + off
    found, error = figures(predicted, measured), predicted - measured
    assert found.mae == pytest.approx(np.abs(error).mean(), rel=1e-5)
    assert found.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-5)
    assert found.bias == pytest.approx(error.mean(), rel=1e-5, abs=1e-300)
    assert found.max == pytest.approx(np.abs(error).max(), rel=1e-5)


def test_figures_of_nothing_are_none() -> None:
    assert figures(np.array([np.nan, 1.0]), np.array([1.0, np.nan])) == figures(
        np.array([]), np.array([])
    )


def test_roles_stand_in_one_place() -> None:
    roles = Roles(training=("servo/*",), training_days=Days(first="2026-01-05", last="2026-01-09"))
    sets = GoldenSets(
        machine="mill",
        golden=FrozenSet(
            files=(SourceFile(file="servo/b.csv", sha256="b"),),
            days=Days(first="2026-01-19", last="2026-01-25"),
        ),
        sealed=FrozenSet(files=(SourceFile(file="servo/c.csv", sha256="c"),)),
    )
    assert role_of(["servo/a.csv"], roles) == "training"
    assert role_of(["other/a.csv"], roles) == "held_out"
    assert role_of(["agent.txt"], roles, sets, "2026-01-06") == "training"
    assert role_of(["agent.txt"], roles, sets, "2026-01-12") == "held_out"
    assert role_of(["agent.txt"], roles, sets, "2026-01-20") == "golden"
    assert role_of(["servo/b.csv"], roles, sets) == "golden"
    assert role_of(["servo/c.csv"], roles, sets) == "sealed"


COVERED = replace(TARGET, coverage=(0.88, 0.92))


def with_share_inside(share: float):
    """A predictor whose interval holds this share of each recording's samples."""

    def high(rows: pd.DataFrame) -> "pd.Series[float]":
        outside = np.arange(len(rows)) >= round(share * len(rows))
        return rows["measured"] + np.where(outside, -0.1, 0.5)

    return changed(high=high)


def test_an_interval_that_holds_too_little_fails() -> None:
    found = judged("x", [TRAIN, A, B], target=COVERED, predict=with_share_inside(0.6)).verdict
    assert found.status == "failed"
    assert found.reasons == (
        "force: 60 % of the samples lie inside the 90 % interval, limits 88 to 92 %",
    )
    assert found.missed == found.reasons
    assert metrics(found)["force"]["coverage_90"] == 0.6


def test_the_width_of_an_interval_is_held_against_the_error() -> None:
    """An interval that holds everything may be of no use."""
    found = judged("spindle", [TRAIN, A, B]).verdict
    for one in (TRAIN, A, B):
        (score,) = found.of("force", group=one.group)
        frame = predictor(one).frame
        assert score.half_width == pytest.approx((frame["high"] - frame["low"]).mean() / 2)
        assert score.half_width_over_rmse == pytest.approx(score.half_width / score.rmse)
    (total,) = found.of("force", group="all", role="held_out")
    assert metrics(found)["force"]["half_width_over_rmse"] == pytest.approx(
        total.half_width / total.rmse, rel=1e-5
    )


def test_an_interval_that_holds_what_it_should_passes_and_is_shown_with_its_limits() -> None:
    found = judged("x", [TRAIN, A, B], target=COVERED, predict=with_share_inside(0.9)).verdict
    assert found.status == "passed"
    (total,) = found.of("force", group="all", role="held_out")
    assert (total.status, total.coverage_limits) == ("passed", (0.88, 0.92))
    assert all(s.coverage_limits is None for s in found.scores if s is not total)
    table = scores_table("scores", found.scores, [])
    assert table is not None and "88 to 92 % inside the 90 % interval" in table.note


def test_coverage_alone_decides_where_no_error_is_limited() -> None:
    only = replace(COVERED, limits={}, must_beat=())
    assert judged("x", [TRAIN, A], target=only, predict=with_share_inside(0.9)).verdict.status == (
        "passed"
    )


def test_a_prediction_without_the_interval_that_is_asked_for_fails() -> None:
    def bare(one: Case) -> Prediction:
        return Prediction(frame=predictor(one).frame.drop(columns=["low", "high"]))

    found = judged("x", [TRAIN, A], target=COVERED, predict=bare).verdict
    assert found.reasons == ("force has no 90 % interval, limits of the share inside 88 to 92 %",)


@pytest.mark.parametrize("shares", [(0.9, 88.0), (0.8, 1.0), (0.9, 0.8)])
def test_shares_that_are_none_or_that_any_width_keeps_are_refused(shares: Any) -> None:
    with pytest.raises(ValueError, match="coverage of force"):
        replace(TARGET, coverage=shares)


@pytest.mark.parametrize(("samples", "values", "found"), [(100, 10, 1), (99, 10, 0), (100, 9, 0)])
def test_a_prediction_without_any_error_has_seen_what_it_predicts(
    samples: int, values: int, found: int
) -> None:
    measured = np.arange(samples) % values * 0.5
    frame = pd.DataFrame({
        "quantity": "load", "regime": "", "role": "held_out", "measured": measured,
        "predicted": measured, "scored": True,
    })  # fmt: skip
    target = Target(quantity="load", unit="N")
    said = failures(canaries((), frame, [target], "held_out"))
    assert len(said) == found
    assert all("an input of the model holds the measurement" in one for one in said)
    frame.loc[3, "predicted"] += 1e-9
    assert failures(canaries((), frame, [target], "held_out")) == []
