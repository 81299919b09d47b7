"""The life of a model: what the gate refuses by which rule, what it lets in, and what stays known.

The machine has two sub-models: the spindle's, whose error is set, and a control that failed.
"""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

from pipeline.app.output import LOG
from pipeline.app.programs import passed_status
from pipeline.champions.promotion import (
    RefusedError,
    decided,
    delete,
    events,
    judged,
    promote,
    rollback,
    settle,
)
from pipeline.champions.serving import champion_of, history_of, history_path, keep_serving
from pipeline.registry.store import client_of, model_name, versions
from pipeline.schema.bundle import Served, bundle_of, read_champions
from pipeline.schema.decision import Decision
from pipeline.schema.history import document_of, looks, served_until, serving_during
from pipeline.schema.store import StoreError, read_json, write_json
from pipeline.schema.verdict import Canary, Verdict
from tests.bundled_project import GOLDEN, MACHINE, project, quick_stores, source, spindle
from tests.twin.cut_parts import CONTROL

NAMES = ("control", "spindle")
MODELS, CHAMPION = f"data/models/{MACHINE}", f"data/champion/{MACHINE}"
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


def at(hours: float) -> datetime:
    return NOON + timedelta(hours=hours)


def with_failed_control(root: Path) -> None:
    """A control that failed, the same in every bundle."""
    from tests.test_program_commands import control_model

    folder = root / MODELS / "control"

    write_json(replace(control_model(m=CONTROL), machine=MACHINE), folder / "model.json")
    failed = Verdict(
        submodel="control", machine=MACHINE, origin="simulated", status="failed",
        reasons=("the mean error is above its limit",), judged_role=None, golden=None, scores=(),
    )  # fmt: skip
    write_json(failed, folder / "verdict.json")
    write_json(Served(inputs={"block": "long"}, outputs={"t": "double"}), folder / "served.json")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project whose first bundle, with a spindle wrong by 1 K, serves."""
    root = project(tmp_path_factory.mktemp("life") / "project", sealed=True)
    values = yaml.safe_load((root / "params.yaml").read_text())
    values["fleet"]["submodels"]["control"] = [MACHINE]
    for section in ("mapping", "control", "setup", "control_records"):
        values["machine"][MACHINE][section] = {}
    values |= {"control_fit": {}, "control_limits": {}}
    values["spindle_limits"] = {"mae_K": 5.0, "rmse_K": 5.0}  # as spindle() judges
    (root / "params.yaml").write_text(yaml.safe_dump(values))
    with pytest.MonkeyPatch.context() as patch, quick_stores():
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        with_failed_control(root)
        spindle(root, error_K=1.0)
        keep_serving(MACHINE, NAMES, root)
        yield root


@pytest.fixture
def root(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    return shutil.copytree(made, tmp_path / "project")


def challenged(root: Path, error_K: float, change: Callable[[Verdict], Verdict] | None) -> None:
    """A challenger by the error of its spindle, with its verdict changed."""
    spindle(root, error_K=error_K)
    path = root / MODELS / "spindle/verdict.json"
    if change is not None:
        write_json(change(read_json(path, Verdict)), path)


def noisy(verdict: Verdict) -> Verdict:
    """Trainings with other seeds differ by more than what is gained."""
    scores = [replace(one, spread={"mae": 9.0, "rmse": 9.0}) for one in verdict.scores]
    return replace(verdict, scores=tuple(scores))


def leaking(verdict: Verdict) -> Verdict:
    said = Canary(name="inputs", status="failed", words="the residual is among the inputs")
    return replace(verdict, canaries=(said,))


def bad_in_one(verdict: Verdict) -> Verdict:
    """Far worse on the last golden day, better on all others."""
    scores = [
        replace(one, mae=5.0, rmse=5.0) if one.group == GOLDEN[1] else one for one in verdict.scores
    ]
    return replace(verdict, scores=tuple(scores))


@pytest.mark.parametrize(
    ("error_K", "change", "rule"),
    [(2.0, None, "not worse"), (0.0, leaking, "canaries"), (0.0, bad_in_one, "not worse"),
     (0.0, noisy, "better")],
    ids=["worse", "leaking", "bad in one regime", "within the spread of seeds"],
)  # fmt: skip
def test_each_is_refused_by_its_rule_and_the_history_tells_it(
    root: Path, error_K: float, change: Callable[[Verdict], Verdict] | None, rule: str
) -> None:
    challenged(root, error_K, change)
    with pytest.raises(RefusedError, match=f"version 1 by rules? .*'{rule}'"):
        promote(MACHINE, root, why="try", by="Kim", now=NOON)
    first, last = history_of(MACHINE, root)
    assert (first.event, last.event, last.version, last.sealed) == ("first", "refused", 2, "")
    decision = read_json(document_of(history_path(MACHINE, root), last), Decision)
    assert decision.against[0].name == rule and len(decision.against) <= 1 + (rule == "not worse")
    if change is bad_in_one:
        assert f"worst in {GOLDEN[1]}" in decision.objections
    entry = champion_of(MACHINE, root)
    assert entry is not None and entry.version == 1 and entry.serving == ("spindle",)


def test_one_that_was_fitted_on_the_golden_week_is_refused(root: Path) -> None:
    challenged(root, 0.0, None)
    model = root / MODELS / "spindle/model.json"
    stored = json.loads(model.read_text())
    day = GOLDEN[0]
    stored["trained_on"].append({"case": day, "group": day, "files": [
        {"file": source(day).file, "sha256": source(day).sha256}]})  # fmt: skip
    model.write_text(json.dumps(stored))
    with pytest.raises(RefusedError, match="version 1 by rules 'unseen', ") as refused:
        promote(MACHINE, root, why="try")
    words = refused.value.decision.against[0].words
    assert words == (f"spindle was fitted on {source(day).file} of the golden set",)


def test_an_override_puts_into_service_what_it_names_alone(
    root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The spindle that fails anew serves by it, and the control that never served does not."""
    challenged(root, 0.0, lambda verdict: replace(verdict, status="failed"))
    now = promote(MACHINE, root, why="no other", by="Kim", anyway=True, now=NOON)
    decision = decided(MACHINE, root)
    assert now.serving == ("spindle",) and decision.overridden
    assert (decision.unproven, decision.idle) == ("spindle failed", "control failed")
    assert [one.name for one in decision.against] == ["no new failure", "better"]
    monkeypatch.setattr(LOG, "propagate", True)
    monkeypatch.chdir(root)
    served = passed_status(Path(CHAMPION) / "spindle", "model of spindle", anyway=False)
    assert served == "failed" and list(dict.fromkeys(caplog.messages)) == [
        "the model of spindle failed; it serves against the rules, by "
        "--anyway, as Kim promoted version 2 on 2026-03-01T12:00:00Z: no other"
    ]
    for folder in (f"{CHAMPION}/control", f"{MODELS}/spindle"):
        with pytest.raises(ValueError, match="mend that first, or use it with --anyway"):
            passed_status(Path(folder), "model", anyway=False)


def test_an_override_of_nothing_says_so_and_spends_no_look(root: Path) -> None:
    first = promote(MACHINE, root, why="accepted", by="Kim", to=1, anyway=True, now=NOON)
    decision = decided(MACHINE, root)
    assert first.serving == ("spindle",) and decision.anyway and not decision.overridden
    challenged(root, 2.0, None)
    promote(MACHINE, root, why="try", by="Kim", anyway=True, now=at(1))
    assert [entry.sealed for entry in history_of(MACHINE, root)] == ["", "", ""]


def test_a_better_spindle_serves_beside_an_old_failure_comes_back_and_all_is_told(
    root: Path,
) -> None:
    challenged(root, 0.0, None)
    look = judged(MACHINE, root)
    assert look.may_serve and history_of(MACHINE, root) == ()
    now = promote(MACHINE, root, why="new oil", by="Kim", now=NOON)
    assert (now.version, now.serving) == (2, ("spindle",))
    entry = history_of(MACHINE, root)[-1]
    decision = read_json(document_of(history_path(MACHINE, root), entry), Decision)
    results = {one.name: one.result for one in decision.rules}
    assert results == dict.fromkeys(results, "kept") | {"newest day": "no data"}
    failing = next(one for one in decision.rules if one.name == "no new failure")
    assert failing.words == () and decision.idle == "control failed"
    assert len(entry.sealed) == 64 and not entry.anyway
    # what the registry holds of it
    (version,) = [v for v in versions(MACHINE, root) if v.version == 2]
    assert version.tags["gate"] == "may serve"
    client = client_of(root)
    card = client.get_model_version(model_name(MACHINE), "2").description
    assert card.startswith(
        "Gate: against version 1 it may serve. Kim, 2026-03-01T12:00:00Z: new oil."
    )
    assert "# Digital twin of mill01 (simulated records)" in card
    metrics = client.get_run(version.run).data.metrics
    assert metrics["gate/may serve"] == 1.0 and metrics["gate/no new failure"] == 1.0
    assert any(key.startswith("gate/not worse/spindle") for key in metrics)
    files = {one.path for one in client.list_artifacts(version.run, "gate")}
    assert files == {"gate/decision.json"}
    # back, within the warm hours without a question
    back = rollback(MACHINE, root, why="noise in the bearing", by="Lee", now=at(47))
    assert back.version == 1 and read_champions(root / "champions.json").machines[MACHINE] == back
    assert bundle_of(root / CHAMPION, MACHINE, NAMES).sha256 == back.bundle
    with pytest.raises(ValueError, match=r"has not served for 49 h, and is warm for 48 h.*--force"):
        rollback(MACHINE, root, why="again", to=2, now=at(47 + 49))
    rollback(MACHINE, root, why="again", by="Lee", to=2, force=True, now=at(47 + 49))
    told = [(e.event, e.version, e.by, e.why) for e in events(MACHINE, root)]
    assert told == [
        ("first", 1, "dvc repro", "first bundle: control failed"),
        ("promoted", 2, "Kim", "new oil"),
        ("rolled back", 1, "Lee", "noise in the bearing"),
        ("rolled back", 2, "Lee", "again"),
    ]
    entries = events(MACHINE, root)
    until = [served_until(entries, one) for one in entries]
    assert until == [*(one.at for one in entries[1:]), ""]
    assert [looks(entries, one) for one in entries] == [0, 1, 1, 1]
    moments = [f"2026-03-0{day}T13:00:00Z" for day in (1, 4, 6)]
    served = [serving_during(entries, at, at) for at in moments]
    assert [[one.version for one in some] for some in served] == [[2], [1], [2]]


def test_what_serves_served_of_late_or_is_a_reference_cannot_be_deleted(root: Path) -> None:
    challenged(root, 0.0, None)
    promote(MACHINE, root, why="new oil", by="Kim", now=NOON)
    for number, why in ((2, "serves"), (1, "served less than 48 h ago")):
        with pytest.raises(ValueError, match=f"version {number} of {MACHINE} {why}"):
            delete(MACHINE, number, root, why="room", now=at(1))
    client_of(root).set_registered_model_alias(model_name(MACHINE), "reference", "1")
    with pytest.raises(ValueError, match="is a reference"):
        delete(MACHINE, 1, root, why="room", now=at(100))
    client_of(root).delete_registered_model_alias(model_name(MACHINE), "reference")
    places = [Path(v.place.removeprefix("file://")).parent.name for v in versions(MACHINE, root)]
    folders = [root / "mlartifacts/models" / name for name in places]
    size = sum(one.stat().st_size for folder in (folders[0], root / f"data/warm/{MACHINE}")
               for one in folder.rglob("*") if one.is_file())  # fmt: skip
    assert delete(MACHINE, 1, root, why="room", by="Kim", now=at(100)) == size > 1e6
    assert [one.exists() for one in folders] == [False, True]
    assert not (root / f"data/warm/{MACHINE}").exists()
    assert [v.version for v in versions(MACHINE, root)] == [2]
    assert history_of(MACHINE, root)[-1].event == "deleted"
    with pytest.raises(ValueError, match="has no version 9"):
        delete(MACHINE, 9, root, why="room")


def test_what_an_experiment_makes_challenges_nobody(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    challenged(root, 0.0, None)
    monkeypatch.setenv("DVC_EXP_BASELINE_REV", "abc")
    assert keep_serving(MACHINE, NAMES, root).version == 1
    assert [v.version for v in versions(MACHINE, root)] == [1]
    monkeypatch.delenv("DVC_EXP_BASELINE_REV")
    keep_serving(MACHINE, NAMES, root)
    assert [v.aliases for v in versions(MACHINE, root)] == [("champion",), ("challenger",)]


def test_a_history_that_was_changed_is_refused_with_its_line(root: Path) -> None:
    challenged(root, 0.0, None)
    promote(MACHINE, root, why="new oil", by="Kim", now=NOON)
    path = history_path(MACHINE, root)
    path.write_text(path.read_text().replace("dvc repro", "Kim"))
    with pytest.raises(StoreError, match=r"mill01.jsonl, line 2 does not follow the line before"):
        settle(MACHINE, root)
    path.write_text("no line\n")
    (root / "champions.json").write_text('{"machines": {}}')
    with pytest.raises(StoreError, match=r"line 1 is no JSON.*git checkout"):
        champion_of(MACHINE, root)


def test_the_last_line_and_the_decisions_are_guarded_too(root: Path) -> None:
    challenged(root, 0.0, None)
    promote(MACHINE, root, why="new oil", by="Kim", now=NOON)
    path = history_path(MACHINE, root)
    lines = path.read_text()
    for changed in (lines.replace("new oil", "old oil"), lines.partition("\n")[0] + "\n", ""):
        path.write_text(changed)
        for read in (history_of, events, settle):
            with pytest.raises(StoreError, match=r"lacks the entry .* by champions.json; .*git ch"):
                read(MACHINE, root)
    path.write_text(lines)
    document = document_of(path, history_of(MACHINE, root)[-1])
    said = document.read_text()
    document.write_text(said.replace("new oil", "old oil"))
    with pytest.raises(StoreError, match=r"0002.json is not the decision that .*line 2 names"):
        judged(MACHINE, root)
    document.unlink()
    with pytest.raises(StoreError, match=r"0002.json does not exist: restore it with `git ch"):
        judged(MACHINE, root)
    document.write_text(said)
    chosen = root / "champions.json"
    chosen.write_text(chosen.read_text().replace('"version": 2', '"version": 7'))
    with pytest.raises(StoreError, match=r"does not name version 2 as champion of mill01 "):
        champion_of(MACHINE, root)


def test_a_rollback_to_what_served_against_the_rules_says_so(root: Path) -> None:
    challenged(root, 2.0, None)
    promote(MACHINE, root, why="try", by="Kim", anyway=True, now=NOON)
    rollback(MACHINE, root, why="back", by="Lee", now=at(1))
    assert not history_of(MACHINE, root)[-1].anyway
    forth = rollback(MACHINE, root, why="forth", by="Lee", to=2, now=at(2))
    last = history_of(MACHINE, root)[-1]
    assert last.anyway and "rule 'not worse' is broken" in last.rules
    assert forth.why.startswith("forth; anyway: rule")


def test_a_look_before_a_promotion_registers_nothing(root: Path) -> None:
    challenged(root, 0.0, None)
    before = versions(MACHINE, root)
    look = judged(MACHINE, root)
    assert look.may_serve and look.challenger.version == 0
    assert versions(MACHINE, root) == before
    assert promote(MACHINE, root, why="new oil", by="Kim", now=NOON).version == 2


def test_a_further_rollback_goes_one_further_back(root: Path) -> None:
    for error_K in (0.5, 0.0):
        challenged(root, error_K, None)
        promote(MACHINE, root, why="better", by="Kim", now=NOON)
    for version in (2, 1):
        assert rollback(MACHINE, root, why="noise", by="Lee", now=at(1)).version == version
    with pytest.raises(ValueError, match=r"before version 1; for --to there are 2, 3$"):
        rollback(MACHINE, root, why="noise", now=at(2))
    assert rollback(MACHINE, root, why="mended", to=3, now=at(2)).version == 3
    assert rollback(MACHINE, root, why="not mended", now=at(3)).version == 1


def test_the_files_follow_the_history(root: Path) -> None:
    """What a run that broke off, or another branch, left behind is brought up."""
    challenged(root, 0.0, None)
    promote(MACHINE, root, why="new oil", by="Kim", now=NOON)
    before = (root / "champions.json").read_bytes()
    (root / "champions.json").write_text('{"machines": {}, "looks": []}')
    shutil.rmtree(root / CHAMPION)
    settle(MACHINE, root)
    assert (root / "champions.json").read_bytes() == before
    champion = champion_of(MACHINE, root)
    assert champion is not None
    assert bundle_of(root / CHAMPION, MACHINE, NAMES).sha256 == champion.bundle
