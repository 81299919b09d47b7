"""The gate of a promotion: what counts as better, what as worse, and what a sentence says of it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.schema.bundle import Bundle, BundledModel
from pipeline.schema.decision import Decision, PromotionSettings, Side
from pipeline.schema.golden import read_golden
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.verdict import Role, Score, Status, Verdict
from pipeline.submodels.cases import Cases, Records, Roles
from pipeline.submodels.contract import submodel
from pipeline.submodels.promotion import (
    Contest,
    compare,
    contest,
    first_rules,
    sealed_rule,
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
SETTINGS = PromotionSettings()


def scaled(factor: float) -> dict[str, float]:
    return {group: factor * error for group, error in OLD.items()}


def met(new: dict[str, float], name: str = "drive", spread: float = 0.0, **fields: Any) -> Contest:
    """A contest of a sub-model by the errors of its challenger."""
    compared = compare(verdict(OLD), verdict(new, spread=spread), SETTINGS)
    compared = [replace(one, submodel=name) for one in compared]
    given = {"champion": "passed", "challenger": "passed"} | fields
    return Contest(submodel=name, compared=tuple(compared), **given)


def bundle(statuses: dict[str, Status], sha256: str) -> Bundle:
    submodels = {name: BundledModel(sha256=sha256, status=one) for name, one in statuses.items()}
    return Bundle(machine="m", origin="simulated", submodels=submodels, sha256=sha256)


def against(
    *contests: Contest,
    newest: Sequence[Contest] = (),
    old: dict[str, Status] | None = None,
    new: dict[str, Status] | None = None,
    serving: Sequence[str] | None = None,
) -> dict[str, str]:
    """Rules that keep a challenger from serving, with their words."""
    names: dict[str, Status] = {one.submodel: "passed" for one in contests}
    champion, challenger = bundle(old or names, "1"), bundle(new or old or names, "2")
    rules = first_rules(
        contests, newest, champion=champion, challenger=challenger,
        serving=[n for n, one in champion.submodels.items() if one.status == "passed"]
        if serving is None else serving,
    )  # fmt: skip
    side = Side(version=1, bundle="")
    decision = Decision(machine="m", origin="simulated", champion=side, challenger=side,
                        changed=(), golden="", rules=tuple(rules))  # fmt: skip
    return {one.name: f"{one.result}: {one.sentence}" for one in decision.against}


def test_one_that_is_better_in_every_group_serves() -> None:
    (found,) = compare(verdict(OLD), verdict(scaled(0.8)), SETTINGS)
    assert (found.groups, found.result) == (4, "better")
    assert found.words == (
        "drive (force): mean error 1.64 N against the champion's 2.05 N over 4 groups"
    )
    assert against(met(scaled(0.8))) == {}


def test_a_difference_that_chance_could_make_does_not_count() -> None:
    mixed = {"a": 1.2, "b": 2.4, "c": 2.0, "d": 2.2}
    said = against(met(mixed))
    assert list(said) == ["better"]
    assert said["better"] == (
        "broken: drive is not significantly better: mean errors change by -4.9 % over 4 groups"
    )
    assert list(against(met(OLD))) == ["better"]


def test_two_groups_decide_nothing_and_the_sentence_says_how_many_are_needed() -> None:
    few = "drive: 2 groups to judge by, at least 3 are needed: not decided"
    assert against(met({"a": 0.1, "b": 0.1}))["better"] == f"not decided: {few}"
    said = against(met({"a": 0.1, "b": 0.1}), met(OLD, name="wear"))["better"]
    assert said.startswith(f"broken: {few}; wear is not significantly better")


@pytest.mark.parametrize(("factor", "worse"), [(1.04, False), (1.06, True)])
def test_a_mean_error_may_rise_by_the_tolerance(factor: float, worse: bool) -> None:
    (found,) = compare(verdict(OLD), verdict(scaled(factor)), SETTINGS)
    assert (found.result == "worse") is worse
    assert ("not worse" in against(met(scaled(factor)))) is worse


def test_good_on_average_and_bad_in_one_group_is_worse_and_the_group_is_named() -> None:
    new = scaled(0.5) | {"d": OLD["d"] + 1.1}
    (found,) = compare(verdict(OLD), verdict(new), SETTINGS)
    assert (found.result, found.worst_group) == ("worse", "d")
    assert found.challenger < found.champion
    assert against(met(new))["not worse"].endswith("over 4 groups, worst in d")


@pytest.mark.parametrize(("spread", "result"), [(0.4, "better"), (0.42, "not decided")])
def test_a_gain_that_another_training_would_not_show_is_not_decided(
    spread: float, result: str
) -> None:
    """0.41 N better in the mean; trainings with other seeds differ by less, and by more."""
    (found,) = compare(verdict(OLD), verdict(scaled(0.8), spread=spread), SETTINGS)
    assert found.result == result
    said = against(met(scaled(0.8), spread=spread)).get("better", "")
    assert said.startswith("not decided: the gain is within the spread") is (result != "better")


def test_a_rise_within_the_spread_of_trainings_does_not_block() -> None:
    better, unsure = met(scaled(0.5)), met(scaled(1.2), name="wear", spread=0.5)
    assert unsure.compared[0].result == "not decided"
    assert against(better, unsure) == {}


def test_better_in_one_sub_model_does_not_pay_for_another_that_is_worse() -> None:
    said = against(met(scaled(0.5)), met(scaled(1.2), name="wear"))
    assert list(said) == ["not worse"] and "wear (force): mean error 2.46 N" in said["not worse"]


def test_old_failures_do_not_block_and_new_ones_do() -> None:
    old: dict[str, Status] = {"drive": "passed", "wear": "failed", "control": "failed"}
    better = met(scaled(0.5))
    fails = met(OLD, name="wear", champion="failed", challenger="failed")
    assert against(better, fails, old=old) == {}  # wear failed in both, control is the same model
    new = met(scaled(0.5), challenger="failed")
    said = against(new, fails, old=old, new={**old, "drive": "failed"})
    assert said["no new failure"].startswith("broken: its drive is failed where the champion's")
    assert against(met(scaled(0.5), name="wear"), old=old, new={**old, "wear": "passed"}) == {}


def test_a_sub_model_that_does_not_serve_cannot_block() -> None:
    old: dict[str, Status] = {"drive": "passed", "wear": "failed"}
    worse = met(scaled(3.0), name="wear", champion="failed", challenger="failed")
    assert against(met(scaled(0.5)), worse, old=old) == {}
    assert list(against(worse, old=old)) == ["better"]
    assert "not worse" in against(met(scaled(0.5)), worse, old=old, serving=["drive", "wear"])


def test_sub_models_that_came_went_or_were_not_compared() -> None:
    one: dict[str, Status] = {"drive": "passed"}
    assert against(old={}, new=one) == {}
    assert list(against(old={}, new={"drive": "not judged"})) == ["better"]
    said = against(old={**one, "spindle": "passed"}, new=one)
    assert said["complete"] == "broken: it has no spindle, which serves"
    broken = Contest(submodel="wear", compared=(), note="cannot be compared: model.json is broken")
    said = against(met(scaled(0.5)), broken)
    assert said == {"not worse": "broken: wear: cannot be compared: model.json is broken"}


def test_what_was_frozen_or_is_seen_blocks_by_its_own_rule() -> None:
    said = against(met(scaled(0.5), learnt=("drive was fitted on a.csv of the golden set",)))
    assert said == {"unseen": "broken: drive was fitted on a.csv of the golden set"}
    said = against(met(scaled(0.5), canaries=("the residual is among the inputs",)))
    assert said == {"canaries": "broken: drive: the residual is among the inputs"}


def test_the_newest_day_may_not_be_worse() -> None:
    assert list(against(met(scaled(0.5)), newest=[met(scaled(1.2))])) == ["newest day"]
    assert against(met(scaled(0.5)), newest=[met(scaled(1.0))]) == {}


def test_the_sealed_set_speaks_only_against() -> None:
    equal = met(OLD)
    assert sealed_rule([equal]).result == "kept"
    rule = sealed_rule([met(OLD, challenger="failed")])
    assert rule.result == "broken" and rule.sentence.startswith("its drive fails on the sealed set")
    assert sealed_rule([]).result == "no data"


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

    def read() -> tuple[Cases, Any]:
        return submodel("spindle").cases(records, settings, sets), records.files

    def between(champion: Path, challenger: Path) -> Contest:
        found = contest(
            submodel("spindle"), settings, [read, read], sets=sets, champion=champion,
            challenger=challenger, settings=SETTINGS,
        )  # fmt: skip
        assert found is not None
        return found

    (found,) = between(wrong, right).compared
    assert (found.groups, found.result) == (4, "better")
    assert found.challenger < 1.0 < found.champion < 2.0  # readings are whole degrees
    (back,) = between(right, wrong).compared
    assert back.result == "worse"
    # a day that one of the two was fitted on is no contest
    model = wrong / "model.json"
    model.write_text(model.read_text().replace(digest(DAYS[0]), digest(DAYS[2])))
    (fair,) = between(wrong, right).compared
    assert fair.groups == 3
    model.write_text(model.read_text().replace('"network"', '"net"'))
    assert between(wrong, right).note.startswith("cannot be compared: ")


def digest(day: str) -> str:
    return source(day).sha256
