"""The gate of a promotion: what counts as better, what as worse, and what a sentence says of it."""

from pathlib import Path

import pytest

from pipeline.schema.golden import read_golden
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.verdict import Role, Score, Status, Verdict
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.contract import submodel
from pipeline.submodels.promotion import (
    Contest,
    PromotionSettings,
    compare,
    contest,
    objections,
    sealed_objections,
)
from pipeline.submodels.spindle.submodel import Judging, SpindleLimits
from pipeline.twin.spindle import SpindleRecords
from tests.bundled_project import DAYS, MACHINE, project, source, spindle


def verdict(
    errors: dict[str, float], role: Role = "golden", status: Status = "passed", spread: float = 0.0
) -> Verdict:
    """A verdict with one target whose errors by group are given; further scores decide nothing."""
    scores = [
        Score(quantity="force", unit="N", group=group, regime="", role=role, n=9, mae=error,
              rmse=1.2 * error, limits={"rmse": 9.0}, spread={"mae": spread}, status=status)
        for group, error in errors.items()
    ]  # fmt: skip
    training = Score(quantity="force", unit="N", group="t", regime="", role="training", n=9,
                     mae=99.0, rmse=99.0, limits={"rmse": 9.0})  # fmt: skip
    shown = Score(quantity="torque", unit="N m", group="a", regime="", role=role, n=9, mae=1.0,
                  rmse=1.0)  # fmt: skip
    return Verdict(
        submodel="drive", machine="m", origin="simulated", status=status, reasons=(),
        judged_role=role, golden=None, scores=(*scores, training, shown),
    )  # fmt: skip


OLD = {"a": 2.0, "b": 2.2, "c": 1.9, "d": 2.1}


def against(new: dict[str, float], **more: object) -> list[str]:
    compared = tuple(compare(verdict(OLD), verdict(new), 0.05))
    contests = [Contest(submodel="drive", compared=compared)]
    return objections(contests, statuses={"drive": "passed"}, **more)  # type: ignore[arg-type]


def test_one_that_is_better_in_every_group_serves() -> None:
    (found,) = compare(verdict(OLD), verdict({k: 0.8 * v for k, v in OLD.items()}), 0.05)
    assert (found.groups, found.better, found.worse) == (4, True, False)
    assert found.words == (
        "drive (force): mean error 1.64 N against the champion's 2.05 N over 4 groups"
    )
    assert against({k: 0.8 * v for k, v in OLD.items()}) == []


def test_a_difference_that_chance_could_make_does_not_count() -> None:
    mixed = {"a": 1.2, "b": 2.4, "c": 2.0, "d": 2.2}
    (said,) = against(mixed)
    assert said.startswith("no sub-model is significantly better (drive (force): mean error 1.95")
    assert against(OLD) == [
        "no sub-model is significantly better (drive (force): mean error 2.05 N against the "
        "champion's 2.05 N over 4 groups)"
    ]


def test_with_two_groups_nothing_is_significant_and_the_sentence_says_so() -> None:
    (said,) = against({"a": 0.1, "b": 0.1})
    assert said.startswith("with fewer than 3 groups no difference is significant")
    assert "--anyway" in said and "over 2 groups" in said


@pytest.mark.parametrize(("factor", "worse"), [(1.04, False), (1.06, True)])
def test_a_mean_error_may_rise_by_the_tolerance(factor: float, worse: bool) -> None:
    new = {k: factor * v for k, v in OLD.items()}
    (found,) = compare(verdict(OLD), verdict(new), PromotionSettings().tolerance)
    assert (found.better, found.worse) == (False, worse)
    assert any("it is worse: drive" in said for said in against(new)) is worse


@pytest.mark.parametrize(("spread", "better"), [(0.4, True), (0.42, False)])
def test_a_gain_that_another_training_would_not_show_is_none(spread: float, better: bool) -> None:
    """0.41 N better in the mean; trainings with other seeds differ by less, and by more."""
    new = {k: 0.8 * v for k, v in OLD.items()}
    (found,) = compare(verdict(OLD), verdict(new, spread=spread), 0.05)
    assert (found.better, found.worse) == (better, False)


def test_what_is_not_decided_speaks_neither_for_a_challenger_nor_against_it() -> None:
    better = tuple(compare(verdict(OLD), verdict({k: 0.5 * v for k, v in OLD.items()}), 0.05))
    contests = [Contest(submodel="drive", compared=better)]
    assert objections(contests, statuses={"drive": "not decided"}) == []
    (said,) = objections([], statuses={"wear": "not decided"}, added=["wear"])
    assert said == "no sub-model was compared, so that none is shown to be better"
    sealed = [Contest(submodel="drive", compared=better, status="not decided")]
    assert sealed_objections(sealed) == []


def test_better_in_one_sub_model_does_not_pay_for_another_that_is_worse() -> None:
    better = compare(verdict(OLD), verdict({k: 0.5 * v for k, v in OLD.items()}), 0.05)
    worse = compare(verdict(OLD), verdict({k: 1.2 * v for k, v in OLD.items()}), 0.05)
    contests = [Contest(submodel="a", compared=tuple(better)),
                Contest(submodel="b", compared=tuple(worse))]  # fmt: skip
    (said,) = objections(contests, statuses={"a": "passed", "b": "passed"})
    assert said.startswith("it is worse: drive (force): mean error 2.46 N")


def test_sub_models_that_came_went_failed_or_were_not_compared() -> None:
    assert objections([], statuses={"drive": "passed"}, added=["drive"]) == []
    (said,) = objections([], statuses={"drive": "not judged"}, added=["drive"])
    assert said == "no sub-model was compared, so that none is shown to be better"
    found = objections(
        [Contest(submodel="wear", compared=(), note="cannot be compared: model.json is broken")],
        statuses={"drive": "failed", "wear": "passed"}, added=["drive"], absent=["spindle"],
    )  # fmt: skip
    assert found == [
        "its drive failed: see drive/verdict.json",
        "it has no spindle, which the champion has",
        "wear: cannot be compared: model.json is broken",
        "no sub-model was compared, so that none is shown to be better",
    ]


def test_the_sealed_set_speaks_only_against() -> None:
    equal = tuple(compare(verdict(OLD, "sealed"), verdict(OLD, "sealed"), 0.05))
    assert sealed_objections([Contest(submodel="drive", compared=equal, status="passed")]) == []
    (said,) = sealed_objections([Contest(submodel="drive", compared=equal, status="failed")])
    assert said.startswith("its drive fails on the sealed set: drive (force)")


def test_champion_and_challenger_meet_on_the_golden_days(tmp_path: Path) -> None:
    """The truth against a model whose ambient is wrong by 2 K, on days of a known network."""
    wrong = spindle(project(tmp_path / "wrong"), error_K=2.0) / "spindle"
    root = project(tmp_path / "right")
    right = spindle(root) / "spindle"
    settings = Judging(
        identity=MachineIdentity(name=MACHINE, origin="simulated"), roles=Roles(),
        spindle=SpindleRecords(), spindle_limits=SpindleLimits(mae_K=9.0, rmse_K=9.0),
    )  # fmt: skip
    records = Records(
        manifest=root / f"data/signals/{MACHINE}/manifest.json",
        clean=root / f"data/clean/{MACHINE}",
    )
    sets = read_golden(root / f"data/golden/{MACHINE}.json")

    def met(champion: Path, challenger: Path) -> Contest:
        return contest(
            submodel("spindle"), settings, records, sets=sets, champion=champion,
            challenger=challenger, tolerance=0.05,
        )  # fmt: skip

    (found,) = met(wrong, right).compared
    assert (found.groups, found.better, found.worse) == (4, True, False)
    assert found.challenger < 1.0 < found.champion < 2.0  # readings are whole degrees
    (back,) = met(right, wrong).compared
    assert (back.better, back.worse) == (False, True)
    # a day that one of the two was fitted on is no contest
    model = wrong / "model.json"
    model.write_text(model.read_text().replace(digest(DAYS[0]), digest(DAYS[2])))
    (fair,) = met(wrong, right).compared
    assert fair.groups == 3
    model.write_text(model.read_text().replace('"network"', '"net"'))
    assert met(wrong, right).note.startswith("cannot be compared: ")


def digest(day: str) -> str:
    return source(day).sha256
