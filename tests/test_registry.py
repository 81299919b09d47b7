"""The registry on real bundles: registered once, served, promoted, loaded by later code."""

import json
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pandas as pd
import pytest

from pipeline.champions.promotion import events, judged, promote, rollback, settle
from pipeline.champions.serving import (
    champion_of,
    first_champion,
    first_serving,
    history_of,
    history_path,
    made_with,
    status,
)
from pipeline.registry import store
from pipeline.registry.loading import load, place_of
from pipeline.registry.provenance import CHAMPIONS, hash_of_files, requirements, training_files
from pipeline.registry.runs import model_card
from pipeline.registry.sqlite import Note, Version, write_note
from pipeline.registry.store import client_of, model_name, versions
from pipeline.schema.bundle import (
    Bundle,
    BundledModel,
    Champions,
    bundle_of,
    read_champions,
)
from pipeline.schema.decision import Decision
from pipeline.schema.history import document_of
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Status, Verdict
from pipeline.submodels.contract import submodel, submodels
from pipeline.twin.spindle import TARGET
from tests.bundled_project import (
    MACHINE,
    ROLES,
    empty_store,
    hour,
    project,
    quick_stores,
    registered,
    spindle,
)
from tests.test_cli import kerf, refused, rows_of

ROOT = Path(__file__).parents[1]
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)
CHAMPION = f"data/champion/{MACHINE}"
MODELS = f"data/models/{MACHINE}"
REGISTER = (
    "from pathlib import Path; from pipeline.fleet import Fleet; "
    f"from pipeline.stages.champion import champion; names = ('{MACHINE}',); "
    "fleet = Fleet(name='one', machines=names, submodels={'spindle': names}); "
    f"champion(Path('{MODELS}'), Path('champions.json'), Path('{CHAMPION}'), fleet=fleet); "
)
"""The stage ``champion`` in a process of its own."""


@pytest.fixture(autouse=True)
def own_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project whose first bundle, wrong by 2 K, serves, and whose second is the truth."""
    root = project(tmp_path_factory.mktemp("made") / "project")
    with pytest.MonkeyPatch.context() as patch, quick_stores():
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        spindle(root, error_K=2.0)
        shutil.copytree(root / MODELS, root.parent / "first")
        registered(root)
        spindle(root)
        registered(root)
        yield root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy of it: moved, like a project that was cloned with its store."""
    return shutil.copytree(made, tmp_path / "project", copy_function=copied)


def copied(source: str, target: str) -> None:
    """A copy; of the code in a bundle, which no test changes, a second name."""
    (os.link if source.endswith(".py") else shutil.copy2)(source, target)


def aliases(root: Path) -> dict[str, int]:
    return {alias: v.version for v in versions(MACHINE, root) for alias in v.aliases}


def later(hours: float) -> datetime:
    return NOON + timedelta(hours=hours)


def direct(folder: Path, table: pd.DataFrame) -> pd.DataFrame:
    """What the sub-model in ``folder`` predicts without any registry."""
    return submodel("spindle").serve(folder / "spindle")(table)


def test_without_a_registry_there_are_no_versions_and_none_is_made(tmp_path: Path) -> None:
    assert versions(MACHINE, tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_the_first_serves_and_a_later_one_challenges(made: Path) -> None:
    entry = champion_of(MACHINE, made)
    assert entry is not None
    assert not (made / CHAMPIONS).exists()  # nobody chose it
    assert (entry.version, entry.since, entry.by, entry.why) == (1, "", "dvc repro", "first bundle")
    newest = bundle_of(made / MODELS, MACHINE, ["spindle"])
    assert [v.version for v in versions(MACHINE, made)] == [1, 2]
    assert versions(MACHINE, made)[1].bundle == newest.sha256 != entry.bundle
    assert aliases(made) == {"champion": 1, "challenger": 2}
    (row,) = status(MACHINE, ("spindle",), made)
    assert (row["sub-model"], row["latest"], row["champion"]) == ("spindle", "passed", "passed")
    assert (row["origin"], row["serving"], row["challenger"]) == (
        "simulated", "version 1", "version 2"
    )  # fmt: skip


def test_nothing_new_is_registered_without_mlflow_and_changes_no_byte(root: Path) -> None:
    """In a process of its own: this one has imported MLflow."""
    before = files_of(root)
    code = f"{REGISTER}import sys; assert 'mlflow' not in sys.modules"
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    assert files_of(root) == before


def files_of(root: Path) -> dict[str, bytes]:
    """Bytes of what the stages write, the registry among it."""
    paths = [*root.glob("data/**/*"), root / "mlflow.db", root / CHAMPIONS]
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in paths
            if path.is_file()}  # fmt: skip


@pytest.mark.proof  # by a promotion too, in the ordinary suite
def test_a_store_that_was_deleted_is_filled_again(root: Path) -> None:
    serves = (root / CHAMPION / "bundle.json").read_bytes()
    (root / "mlflow.db").unlink()
    shutil.rmtree(root / "mlartifacts")
    status(MACHINE, ("spindle",), root)
    assert (root / CHAMPION / "bundle.json").read_bytes() == serves
    assert aliases(root) == {"champion": 1, "challenger": 2}
    expected = direct(root / CHAMPION, hour(root))
    pd.testing.assert_frame_equal(load(MACHINE, root=root)(hour(root)), expected)


def test_another_store_is_filled_as_well(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Named by MLFLOW_TRACKING_URI, it is asked through MLflow and not read as a file."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'other.db'}")
    registered(root)
    assert aliases(root) == {"champion": 1, "challenger": 2}
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    (root / "mlflow.db").unlink()
    assert versions(MACHINE, root) == []


def test_a_run_says_what_the_version_was_made_of(made: Path) -> None:
    client = client_of(made)
    version = client.get_model_version(model_name(MACHINE), "2")
    run = client.get_run(version.run_id).data
    verdict = read_json(made / MODELS / "spindle/verdict.json", Verdict)
    total = next(s for s in verdict.scores if (s.group, s.role) == ("all", "golden"))
    assert run.metrics["spindle.spindle_temperature_ windows.mae"] == total.mae
    assert run.metrics["spindle.parameter.cooling_rate"] == pytest.approx(1 / 900)
    assert run.params["roles.training_days.first"] == "2026-01-05"
    assert version.tags["golden_sha256"] == verdict.golden.sha256
    assert version.tags["bundle_sha256"] == bundle_of(made / MODELS, MACHINE, ["spindle"]).sha256
    assert not [tag for tag in version.tags if tag.startswith("unit.")]  # in the model's metadata
    assert len(version.tags["raw_sha256"]) == 64 and version.tags["dirty"] == ""
    assert not list(made.rglob("*.pkl"))  # nothing in it runs when it is read
    info = client.get_logged_model(version.source.rpartition("/")[2])
    assert info.name == "bundle"
    (learnt,) = client.get_run(version.run_id).inputs.dataset_inputs
    assert learnt.dataset.name == "spindle, 1 training files"
    files = training_files("spindle", made / MODELS / "spindle")
    assert hash_of_files(files).startswith(learnt.dataset.digest) and learnt.dataset.digest
    assert json.loads(learnt.dataset.source)["uri"].endswith(f"data/raw/{MACHINE}")


def test_a_card_begins_with_what_failed(made: Path) -> None:
    """MLflow cuts a long description off at its end."""
    folder = made / MODELS
    bundle = bundle_of(folder, MACHINE, ["spindle"])
    good = bundle.submodels["spindle"]
    both = replace(bundle, submodels={"spindle": good, "wear": replace(good, status="failed")})
    with mock.patch("pipeline.registry.runs._part", lambda name, *_: [f"## {name}"]):
        card = model_card(both, folder, {})
    assert card.index("## wear") < card.index("## spindle")


def test_each_identification_is_a_run_and_the_version_has_a_card(made: Path) -> None:
    client = client_of(made)
    version = client.get_model_version(model_name(MACHINE), "2")
    card = version.description
    for words in (
        f"# Digital twin of {MACHINE} (simulated records)",
        "Simulated:",
        "passed",
        "Learnt from: 2026-01-05",
        "golden records, frozen as",
        f"{TARGET} [degC]",
        "MAE",
        "limits",
    ):
        assert words in card, words
    children = [
        run
        for run in client.search_runs([client.get_run(version.run_id).info.experiment_id])
        if run.data.tags.get("mlflow.parentRunId") == version.run_id
    ]
    (run,) = children
    model = read_json(made / MODELS / "spindle/model.json", submodel("spindle").model)
    assert run.data.tags["submodel"] == "spindle"
    assert run.data.params["cooling_rate"] == "0.00111111 1/s"
    assert run.data.metrics["spindle.parameter.cooling_rate"] == pytest.approx(1 / 900)
    place = made / "mlartifacts" / run.info.artifact_uri.rpartition("/mlartifacts/")[2]
    listed = (place / "training_files.sha256").read_text().split()
    assert set(listed[::2]) == set(model.training_files)
    assert "<svg" in (place / "spindle.svg").read_text()


def test_the_version_that_serves_says_since_when_by_whom_and_why(root: Path) -> None:
    served = promote(MACHINE, root, why="a week in March", by="Ada")
    tags = {v.version: v.tags for v in versions(MACHINE, root)}
    assert tags[1]["promoted_by"] == "dvc repro" and tags[1]["promoted_why"] == "first bundle"
    said = [tags[2][f"promoted_{word}"] for word in ("at", "by", "why")]
    assert said == [served.since, "Ada", "a week in March"]
    client = client_of(root)
    card = client.get_registered_model(model_name(MACHINE)).description
    assert card == client.get_model_version(model_name(MACHINE), "2").description


def test_a_version_has_signature_example_units_and_pinned_requirements(made: Path) -> None:
    import mlflow

    place = place_of(versions(MACHINE, made)[0], made)
    model = mlflow.models.Model.load(str(place))
    assert model.metadata["units"]["spindle"] == {
        "spindle_speed": "rev/min", "spindle_load": "%", TARGET: "degC"
    }  # fmt: skip
    assert [(p.name, p.default) for p in model.signature.params] == [
        ("submodel", "spindle"), ("anyway", False)
    ]  # fmt: skip
    path = list(sys.path)
    served = mlflow.pyfunc.load_model(str(place))
    sys.path = path
    example = model.load_input_example(str(place))
    found = served.predict(example, params={"submodel": "spindle"})
    pd.testing.assert_frame_equal(found, direct(made / CHAMPION, example))
    assert set(model.signature.inputs.input_names()) == set(example.columns)
    assert model.signature.outputs.input_names() == list(found.columns)
    asked = (place / "requirements.txt").read_text().split()
    lock = (ROOT / "requirements.lock").read_text().split()
    assert all("==" in line and not line.startswith("kerf") for line in asked)
    assert set(requirements(submodels(), ROOT)) <= set(lock)
    names = {line.partition("==")[0] for line in asked} - {"mlflow"}
    assert names == {one.partition("==")[0] for one in requirements(["spindle"], ROOT)}
    assert "torch" not in names


TORCH = {"deformation", "following_residual", "wear", "synthesis"}
ALONE = """
import sys
from importlib import import_module
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from re import match

from pipeline.schema.imports import modules, reached


def closure(names):
    found, todo = set(), [one.lower() for one in names]
    while todo:
        name = todo.pop()
        if name in found:
            continue
        found.add(name)
        try:
            lines = requires(name) or ()
        except Exception:
            continue
        todo += [match(r"[\\w.-]+", one)[0].lower() for one in lines if "extra ==" not in one]
    return {one.replace("_", "-") for one in found}


submodel, *asked = sys.argv[1:]
whose = packages_distributions()


class Refuse:
    def find_spec(self, name, path=None, target=None):
        of = {one.lower().replace("_", "-") for one in whose.get(name.partition(".")[0], ())}
        if of and not of & (allowed | {"kerf-twin"}):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Refuse())
known = modules(Path(sys.modules["pipeline"].__file__).parent)
names = sorted(reached(known, [f"pipeline.submodels.{submodel}.submodel"], shown=True))
for allowed in (closure(set(asked) - {"torch"}), closure(asked)):
    try:
        for name in names:
            import_module(name)
        print("imported")
    except ModuleNotFoundError as error:
        print(error)
"""


def test_a_bundle_asks_for_what_the_code_of_its_sub_models_imports() -> None:
    found = {name: {one.partition("==")[0] for one in requirements([name], ROOT)}
             for name in submodels()}  # fmt: skip
    assert {name for name, asked in found.items() if "torch" in asked} == TORCH
    assert all({"numpy", "pandas", "scipy", "cattrs"} <= asked for asked in found.values())
    assert not any("trimesh" in asked for asked in found.values())  # an extra, done without


@pytest.mark.proof
def test_the_code_of_a_bundle_is_imported_with_its_requirements_alone() -> None:
    asked = [one.partition("==")[0] for one in requirements(["synthesis"], ROOT)]
    answer = subprocess.run(
        [sys.executable, "-c", ALONE, "synthesis", *asked], capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines() == ["No module named 'torch'", "imported"]


def test_a_moved_project_predicts_what_the_bundle_predicts(root: Path, made: Path) -> None:
    table = hour(root)
    for alias, folder in (("champion", CHAMPION), ("challenger", MODELS)):
        predict = load(MACHINE, alias, root)
        assert predict.submodels == ("spindle",)
        expected = direct(root / folder, table)
        assert expected[TARGET].notna().all() and len(expected) > 50
        pd.testing.assert_frame_equal(predict(table), expected)
    assert root.resolve() != made.resolve()
    with pytest.raises(ValueError, match=f"{MACHINE} has no previous: `kerf status`"):
        load(MACHINE, "previous", root)
    for wrong, said in (
        (table.drop(columns="time"), "no column time"),
        (table.head(0), "the table has no row"),
    ):
        with pytest.raises(ValueError, match=said):
            predict(wrong)


def test_one_bundle_serves_each_of_its_sub_models(made: Path, tmp_path: Path) -> None:
    """The pyfunc itself, on a folder: what it does with the name of a sub-model."""
    from pipeline.serving import Bundle as Served

    shutil.copytree(made / CHAMPION / "spindle", tmp_path / "spindle")
    submodels = {name: {"status": status} for name, status in (
        ("control", "failed"), ("cutting", "passed"), ("spindle", "passed"))}  # fmt: skip
    (tmp_path / "bundle.json").write_text(json.dumps({"machine": "m", "submodels": submodels}))
    served = Served()
    served.load_context(SimpleNamespace(artifacts={"bundle": str(tmp_path)}))
    table = hour(made)
    found = served.predict(None, table, {"submodel": "spindle"})
    pd.testing.assert_frame_equal(found, direct(tmp_path, table))
    with pytest.raises(ValueError, match=r"cutting.model\.json does not exist"):
        served.predict(None, table)  # the first that passed where none is named
    with pytest.raises(ValueError, match=r"control of m does not serve \(failed\): give the"):
        served.predict(None, table, {"submodel": "control", "anyway": False})
    with pytest.raises(ValueError, match=r"control.model\.json does not exist"):
        served.predict(None, table, {"submodel": "control", "anyway": True})
    with pytest.raises(ValueError, match="no sub-model 'drive'; it has control, cutting, spindle"):
        served.predict(None, table, {"submodel": "drive"})


RENAMED = (("cooling_rate", "rate_of_cooling"),
           ("pipeline.twin import spindle", "pipeline.twin import model_of_spindle as spindle"),
           ("pipeline.twin.spindle", "pipeline.twin.model_of_spindle"),
           ("SpindleRecords", "RecordsOfSpindle"))  # fmt: skip
"""A field, a module and a class that an earlier version of the code calls otherwise."""


def test_a_version_of_long_ago_predicts_what_it_predicted(tmp_path: Path, made: Path) -> None:
    """Registered by other code in another process, loaded beside today's code in this one."""
    old = project(tmp_path / "old")
    shutil.copytree(made.parent / "first", old / MODELS)
    (old / "mlflow.db").write_bytes(empty_store())
    shutil.copytree(ROOT / "pipeline", old / "pipeline")
    hour(old).to_parquet(old / "hour.parquet")
    for path in [*old.rglob("*.py"), old / MODELS / "spindle/model.json"]:
        text = now = path.read_text()
        for today, before in RENAMED:
            text = text.replace(today, before)
        if text != now:  # the rest stays compiled
            path.write_text(text)
    old_module = old / "pipeline/twin/spindle.py"
    old_module.rename(old_module.with_name("model_of_spindle.py"))
    code = f"{REGISTER}import pandas as pd; from pipeline.submodels.contract import submodel; " + (
        f"predict = submodel('spindle').serve(Path('{CHAMPION}/spindle')); "
        "predict(pd.read_parquet('hour.parquet')).to_parquet('predicted.parquet')"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=old, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(old)},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    with pytest.raises(ValueError, match="rate_of_cooling"):  # today's code cannot read it
        direct(old / CHAMPION, hour(old))
    predict = load(MACHINE, root=old)
    found = predict(hour(old))
    expected = pd.read_parquet(old / "predicted.parquet")
    pd.testing.assert_frame_equal(found, expected, check_dtype=False, check_exact=True)
    assert not any("model_of_spindle" in name for name in sys.modules)
    assert str(old) not in "".join(sys.path)
    pd.testing.assert_frame_equal(
        direct(made / MODELS, hour(made)), direct(made / MODELS, hour(old))
    )


def bundle_in(root: Path) -> Path:
    return place_of(versions(MACHINE, root)[0], root) / "artifacts/bundle"


def spoil(bundle: Path) -> None:
    path = bundle / "spindle/model.json"
    path.write_text(path.read_text().replace("0.", "1.", 1))


@pytest.mark.parametrize(
    "tamper",
    [
        spoil,
        lambda bundle: (bundle / "spindle/verdict.json").unlink(),
        lambda bundle: (bundle / "spindle/residual/more").write_text("x"),
        lambda bundle: shutil.rmtree(bundle),
    ],
    ids=["changed", "without its verdict", "with another file", "gone"],
)
def test_a_bundle_that_is_not_the_registered_one_is_refused(
    tamper: Callable[[Path], None], root: Path
) -> None:
    tamper(bundle_in(root))
    with pytest.raises(ValueError, match=r"version 1 .* is no longer the one that was registered"):
        load(MACHINE, root=root)


def test_artifacts_left_behind_are_named(root: Path) -> None:
    shutil.rmtree(root / "mlartifacts")
    with sqlite3.connect(root / "mlflow.db") as database:  # where it was registered is gone too
        for table, column in (("model_versions", "storage_location"), ("model_versions", "source"),
                              ("logged_models", "artifact_location")):  # fmt: skip
            database.execute(f"UPDATE {table} SET {column} = replace({column}, '/made', '/gone')")
    with pytest.raises(ValueError, match=r"bring mlartifacts along with mlflow\.db"):
        load(MACHINE, root=root)


def test_a_store_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(b"no database at all" * 100)
    with pytest.raises(ValueError, match=r"the registry sqlite:///.*mlflow\.db cannot be opened"):
        versions(MACHINE, tmp_path)


# Champions and promotion.


def test_a_better_challenger_is_promoted_and_the_champion_can_come_back(root: Path) -> None:
    first = champion_of(MACHINE, root)
    assert first is not None
    write_json(Champions().promoted("mill09", first), root / CHAMPIONS)
    now = promote(MACHINE, root, why="warmer oil", by="Kim", now=NOON)
    newest = bundle_of(root / MODELS, MACHINE, ["spindle"])
    assert (now.version, now.bundle, now.by, now.why) == (2, newest.sha256, "Kim", "warmer oil")
    assert (now.since, now.serving) == ("2026-03-01T12:00:00Z", ("spindle",))
    last = history_of(MACHINE, root)[-1].sha256
    assert read_champions(root / CHAMPIONS) == Champions(
        machines={MACHINE: now, "mill09": first}, histories={MACHINE: last}
    )
    assert aliases(root) == {"previous": 1, "champion": 2}
    assert read_json(root / CHAMPION / "bundle.json", Bundle) == newest
    with pytest.raises(ValueError, match=f"{MACHINE} has no challenger: run `dvc repro`"):
        promote(MACHINE, root, why="again")
    back = rollback(MACHINE, root, why="the oil was changed back", by="Kim", now=later(47))
    assert (back.version, back.bundle) == (1, first.bundle)
    assert aliases(root) == {"previous": 2, "champion": 1, "challenger": 2}
    assert bundle_of(root / CHAMPION, MACHINE, ["spindle"]).sha256 == first.bundle
    before = files_of(root)
    registered(root)
    settle(MACHINE, root)
    assert files_of(root) == before
    told = [(e.event, e.version, e.by) for e in history_of(MACHINE, root)]
    assert told == [("first", 1, "dvc repro"), ("promoted", 2, "Kim"), ("rolled back", 1, "Kim")]
    with pytest.raises(ValueError, match="has no version 7; there are 1, 2"):
        promote(MACHINE, root, why="x", to=7)
    with pytest.raises(ValueError, match="needs a reason"):
        promote(MACHINE, root, why=" ")


def test_the_commands_show_the_challenger_and_promote_it(root: Path) -> None:
    (root / "conf").mkdir()
    (root / "conf/machine").symlink_to(ROOT / "conf/machine")
    (row,) = rows_of(kerf(root, "status"))
    assert row == {
        "machine": MACHINE, "origin": "simulated", "sub-model": "spindle", "latest": "passed",
        "champion": "passed", "serving": "version 1", "challenger": "version 2",
    }  # fmt: skip
    assert "needs a reason: give it with --why" in refused(root, "promote", "-m", MACHINE)
    done = kerf(root, "promote", "-m", MACHINE, "--why", "two kelvin better")
    said = (
        f"{MACHINE}: version 2 is champion; git add champions.json data/history, and commit them\n"
    )
    assert done.stdout == said
    (row,) = rows_of(kerf(root, "status"))
    assert row["serving"].startswith("version 2 since 20") and row["challenger"] == "-"
    again = refused(root, "promote", "-m", MACHINE, "--why", "once more")
    assert f"{MACHINE} has no challenger: run `dvc repro`" in again
    done = kerf(root, "rollback", "-m", MACHINE, "--why", "back")
    assert done.stdout.startswith(
        f"{MACHINE}: version 1 is champion again, in the place of version 2; git add"
    )
    once_more = refused(root, "rollback", "-m", MACHINE, "--why", "back")
    assert f"no version served {MACHINE} before version 1; for --to there are 2" in once_more
    rows = rows_of(kerf(root, "history", "-m", MACHINE))
    assert [row["event"] for row in rows] == ["first", "promoted", "rolled back"]
    (none,) = rows_of(kerf(root, "history", "-m", MACHINE, "--at", "1999-12-31"))
    assert none["why"] == "nothing at 1999-12-31 serves"
    assert "write it as 2026-03-01" in refused(root, "history", "--at", "yesterday")


def test_a_promotion_that_breaks_off_is_brought_to_its_end_by_the_next_command(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks_off(changes: Note, name: str, database: Path) -> bool:
        if "champion" in changes.aliases:
            raise OSError("the disk is full")
        return write_note(changes, name, database)

    with monkeypatch.context() as patch:
        patch.setattr(store, "write_note", breaks_off)
        with pytest.raises(OSError, match="disk"):
            promote(MACHINE, root, why="better")
    assert aliases(root)["champion"] == 1
    settle(MACHINE, root)
    assert aliases(root) == {"previous": 1, "champion": 2}
    champion = read_champions(root / CHAMPIONS).machines[MACHINE]
    assert champion == champion_of(MACHINE, root)
    assert read_json(root / CHAMPION / "bundle.json", Bundle).sha256 == champion.bundle


def test_what_is_noted_without_mlflow_is_what_mlflow_notes(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = shutil.copytree(root, tmp_path / "other")
    now = NOON.timestamp()
    changes = Note(
        aliases={"champion": 2, "challenger": None, "reference": 1}, version=2,
        tags={"status": "failed", "gate": "may serve"}, description="new", card="card",
        run=versions(MACHINE, root)[1].run, metrics={"gate/may serve": 1.0, "gate/better": 0.0},
        files={"gate/decision.json": "{}"},
    )  # fmt: skip
    store.note(MACHINE, root, changes)
    assert not (root / "mlflow.db-journal").exists()
    monkeypatch.setattr(store, "write_note", lambda *_: False)  # as for tables of another release
    store.note(MACHINE, other, changes)
    seen = []
    for place in (root, other):
        client = client_of(place)
        run = client.get_run(changes.run)
        model = client.get_registered_model(model_name(MACHINE))
        assert model.last_updated_timestamp > now and model.description == "card"
        seen.append((versions(MACHINE, place), run.data.metrics, model.aliases,
                     client.get_metric_history(changes.run, "gate/better")[0].value))  # fmt: skip
    assert seen[0] == seen[1]
    assert aliases(root) == {"champion": 2, "reference": 1}
    files = [place / "mlartifacts" for place in (root, made_in(changes.run, other))]
    assert [len(list(one.rglob("gate/decision.json"))) for one in files] == [1, 1]


def made_in(run: str, root: Path) -> Path:
    """The project in which a run was made, to which MLflow writes, also from a copy of it."""
    return Path(client_of(root).get_run(run).info.artifact_uri.partition("/mlartifacts")[0][7:])


def test_promotion_and_rollback_do_without_mlflow_and_its_seconds(root: Path) -> None:
    """In a process of its own: this one has imported MLflow."""
    code = (
        "import sys; from pathlib import Path; "
        "from pipeline.champions.promotion import promote, rollback; "
        f"promote('{MACHINE}', Path(), why='x'); rollback('{MACHINE}', Path(), why='y'); "
        f"promote('{MACHINE}', Path(), why='z', to=2); assert 'mlflow' not in sys.modules"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    assert aliases(root) == {"previous": 1, "champion": 2}


def test_a_bundle_is_hashed_once_for_the_same_files(root: Path) -> None:
    folder = root / MODELS
    bundle = bundle_of(folder, MACHINE, ["spindle"])
    with mock.patch("pipeline.schema.bundle.model_hash", side_effect=AssertionError):
        assert bundle_of(folder, MACHINE, ["spindle"]) == bundle
    spoil(folder)
    assert bundle_of(folder, MACHINE, ["spindle"]) != bundle


def test_a_server_that_is_down_keeps_nobody_from_reading(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (root / "conf").mkdir()
    (root / "conf/machine").symlink_to(ROOT / "conf/machine")
    promote(MACHINE, root, why="two kelvin better", by="Kim")
    before = files_of(root)
    with socket.create_server(("127.0.0.1", 0)) as door:  # then closed: nobody listens there
        address = f"http://127.0.0.1:{door.getsockname()[1]}"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", address)
    done = kerf(root, "history", "-m", MACHINE)
    sentence = f"kerf: the registry {address} does not answer (Connection refused): the files"
    assert done.stderr.startswith(sentence) and done.stderr.count("\n") == 1
    assert [row["event"] for row in rows_of(done)] == ["first", "promoted"]
    done = kerf(root, "status")
    (row,) = rows_of(done)
    assert row["serving"].startswith("version 2 since 20") and row["champion"] == "passed"
    assert done.stderr.startswith(sentence) and done.stderr.count("\n") == 1
    assert files_of(root) == before


def test_one_that_failed_is_refused_and_serves_only_anyway(root: Path) -> None:
    spindle(root, mae_K=1e-6)
    with pytest.raises(ValueError, match=r"by rules 'no new failure', 'better': mend"):
        promote(MACHINE, root, why="try")
    assert aliases(root) == {"champion": 1, "challenger": 3}
    assert [e.event for e in history_of(MACHINE, root)] == ["first", "refused"]
    now = promote(MACHINE, root, why="no other", anyway=True)
    last = history_of(MACHINE, root)[-1]
    assert last.anyway and last.rules.startswith("rule 'no new failure' is broken")
    assert now.serving == ("spindle",)
    assert now.why == f"no other; anyway: {last.rules}"  # in champions.json, and a tag of MLflow
    (row,) = status(MACHINE, ("spindle",), root)
    assert (row["champion"], row["challenger"]) == ("failed", "-")


def test_the_command_says_which_rules_it_overrides(root: Path) -> None:
    (root / "conf").mkdir()
    (root / "conf/machine").symlink_to(ROOT / "conf/machine")
    spindle(root, error_K=4.0)
    words = ("promote", "-m", MACHINE, "--anyway")
    look = kerf(root, *words, "--dry-run")
    assert look.exit_code == 0 and "may not serve by the rules, and would with" in look.stdout
    done = kerf(root, *words, "--why", "a test of the alarm")
    first, *rules, last = done.stdout.splitlines()
    assert first == f"{MACHINE}: against the rules, by --anyway:"
    assert rules[0].startswith("  no new failure  broken  its spindle is failed where the champ")
    assert rules[1].startswith("  not worse       broken  worse: spindle")
    assert " K against the champion's " in rules[1] and "version 3 is champion" in last
    assert "anyway: rule 'no new failure' is broken" in kerf(root, "history").stdout


def test_a_refusal_is_a_sentence_a_line_for_each_rule_and_status_1(root: Path) -> None:
    (root / "conf").mkdir()
    (root / "conf/machine").symlink_to(ROOT / "conf/machine")
    spindle(root, error_K=4.0)
    done = kerf(root, "promote", "-m", MACHINE, "--why", "try", "--json", "-")
    said, *rules = done.stderr.splitlines()
    assert done.exit_code == 1 == kerf(root, "promote", "-m", MACHINE, "--dry-run").exit_code
    assert said.startswith(f"kerf: version 3 of {MACHINE} may not serve in the place of version 1 ")
    assert said.endswith("data/history/mill01/0002.json holds the decision") and len(said) < 220
    names = [one["name"] for one in json.loads(done.stdout)["rules"] if one["result"] == "broken"]
    assert [line[2:].partition("  ")[0] for line in rules] == names and "not worse" in names


def test_each_look_at_the_sealed_set_is_counted(root: Path) -> None:
    sealed = project(root.parent / "sealed", sealed=True)
    for name in ("data/clean", "data/signals", "data/golden"):
        shutil.rmtree(root / name)
        shutil.copytree(sealed / name, root / name)
    promote(MACHINE, root, why="better")
    (look,) = [e for e in events(MACHINE, root) if e.sealed]
    assert look.event == "promoted" and len(look.sealed) == 64
    decision = read_json(document_of(history_path(MACHINE, root), look), Decision)
    rule = decision.rules[-1]
    assert (rule.name, rule.result) == ("sealed", "kept")
    assert {one.groups for one in rule.figures} == {1}


def test_a_champion_that_lies_nowhere_is_named(root: Path) -> None:
    first = champion_of(MACHINE, root)
    assert first is not None
    lost = replace(first, version=7, bundle="0" * 64, by="somebody")
    write_json(Champions().promoted(MACHINE, lost), root / CHAMPIONS)
    with pytest.raises(ValueError, match=r"bundle 000000000000, which serves mill01 .*`dvc pull"):
        registered(root)
    write_json(Champions(), root / CHAMPIONS)
    registered(root)
    assert champion_of(MACHINE, root) == first


def test_a_first_champion_serves_until_somebody_chooses(root: Path) -> None:
    """The bundle in data/champion serves on, also in a store that never saw it; then a choice."""
    first = champion_of(MACHINE, root)
    assert first is not None
    with pytest.raises(ValueError, match="has no version 7"):
        promote(MACHINE, root, why="x", to=7)
    look = judged(MACHINE, root, to=1)  # says what the promotion does
    assert look.may_serve and "nobody had chosen" in look.rules[0].sentence
    chosen = promote(MACHINE, root, why="it is good", to=1)  # which git holds from now on
    assert (chosen.bundle, chosen.why) == (first.bundle, "it is good")
    assert [e.event for e in history_of(MACHINE, root)] == ["first", "promoted"]
    assert read_champions(root / CHAMPIONS).machines == {MACHINE: chosen}
    assert aliases(root) == {"champion": 1, "challenger": 2}
    with pytest.raises(ValueError, match="version 1 of mill01 is its champion already"):
        promote(MACHINE, root, why="again", to=1)


def test_a_store_that_lacks_the_champion_is_filled_before_a_promotion(root: Path) -> None:
    (root / "mlflow.db").unlink()
    shutil.rmtree(root / "mlartifacts")
    served = promote(MACHINE, root, why="better")
    assert (served.version, aliases(root)) == (2, {"previous": 1, "champion": 2})
    shutil.rmtree(root / CHAMPION)
    (root / CHAMPIONS).unlink()
    settle(MACHINE, root)  # the history says it
    assert read_champions(root / CHAMPIONS).machines == {MACHINE: served}
    assert bundle_of(root / CHAMPION, MACHINE, ["spindle"]).sha256 == served.bundle


def test_the_first_champion_is_one_that_passed_or_says_what_was_not_shown(tmp_path: Path) -> None:
    passed = Version(machine="m", version=1, bundle="a", status="passed", aliases=())
    newest = Version(machine="m", version=2, bundle="b", status="failed", aliases=())
    statuses: dict[str, Status] = {"drive": "failed", "spindle": "passed", "wear": "not judged"}
    submodels = {name: BundledModel(sha256="", status=one) for name, one in statuses.items()}
    bundle = Bundle(machine="m", origin="simulated", submodels=submodels, sha256="b")
    assert bundle.status == "failed"
    assert first_serving(bundle, [passed, newest]) == "a"
    assert first_serving(bundle, [newest]) == "b"
    alone = first_champion(bundle, tmp_path)
    assert (alone.version, alone.why) == (0, "first bundle: drive failed, wear not judged")
    assert alone.serving == ("spindle",)
    assert first_champion(bundle, tmp_path) == alone  # no clock in it


def test_the_settings_of_a_machine_are_those_of_its_sub_models(made: Path) -> None:
    settings = made_with(MACHINE, ("spindle",), made)
    assert set(settings) == {
        "identity", "roles", "spindle", "spindle_fit", "residual_forest", "spindle_interval",
        "spindle_limits",
    }  # fmt: skip
    assert settings["roles"] == ROLES
