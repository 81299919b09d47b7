"""The registry on real bundles: who becomes what, and what a moved or changed project loads."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest

from pipeline.registry import bundle_hash, load, promote, register, versions
from pipeline.signals.windows import state_days
from pipeline.twin.spindle import TARGET
from pipeline.twin.spindle_model import load_spindle_model
from pipeline.validation.golden import Week, freeze, write_golden
from tests.small_project import (
    MACHINE,
    THURSDAY,
    build,
    change,
    files_of,
    inside,
    new_project,
    params,
)

Bundles = dict[str, Path]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that is built up to the verdict."""
    folder = new_project(tmp_path_factory.mktemp("project"))
    build(folder, "shop", "ingest", "clean", "identify_spindle")
    frozen = freeze(
        MACHINE, Week(first=THURSDAY, last=THURSDAY), files_of(folder / f"data/signals/{MACHINE}")
    )
    write_golden(frozen, folder / f"data/golden/{MACHINE}.json")
    return folder


@pytest.fixture(scope="module")
def bundles(project: Path, tmp_path_factory: pytest.TempPathFactory) -> Bundles:
    """Bundles of different forests; ``failed`` is one that its limits were too tight for."""
    kept = tmp_path_factory.mktemp("bundles")
    found = {}
    for name, trees, limit in (("first", 5, 5.0), ("second", 4, 5.0), ("failed", 3, 1e-6)):
        change(project, "residual_forest", trees=trees)
        change(project, "spindle_limits", mae_K=limit, rmse_K=limit)
        build(project, "train_residual", "validate")
        found[name] = kept / name
        shutil.copytree(project / f"data/models/{MACHINE}", found[name])
    return found


@pytest.fixture(autouse=True)
def own_store(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


@pytest.fixture(scope="module")
def empty_registry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store without a model: MLflow takes seconds to make one."""
    from pipeline.registry import _client

    root = tmp_path_factory.mktemp("empty")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        _client(root)
    return root


@pytest.fixture
def root(empty_registry: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    shutil.copytree(empty_registry, folder)
    return folder


@pytest.fixture
def register_in(root: Path, bundles: Bundles, project: Path) -> Callable[[str], int]:
    """Register one of the bundles by name; the number of its version."""
    made_with = params(project)["machine"][MACHINE]
    return lambda name: register(MACHINE, bundles[name], made_with, root).version


def aliases(root: Path) -> dict[str, int]:
    return {alias: v.version for v in versions(MACHINE, root) for alias in v.aliases}


def test_the_bundles_are_what_the_tests_need(bundles: Bundles) -> None:
    verdicts = {
        name: json.loads((folder / "validation.json").read_text())["verdict"]
        for name, folder in bundles.items()
    }
    assert verdicts == {"first": "passed", "second": "passed", "failed": "failed"}
    assert len({bundle_hash(folder) for folder in bundles.values()}) == 3


def test_without_a_registry_there_are_no_versions_and_none_is_made(tmp_path: Path) -> None:
    assert versions(MACHINE, tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_one_content_is_registered_once(root: Path, register_in: Callable[[str], int]) -> None:
    first = register_in("first")
    assert [register_in("first"), register_in("second"), register_in("first")] == [first, 2, first]
    assert [v.version for v in versions(MACHINE, root)] == [first, 2]


def test_a_run_says_what_the_version_was_made_of(
    root: Path, register_in: Callable[[str], int], bundles: Bundles
) -> None:
    register_in("first")
    from pipeline.registry import _client, model_name

    client = _client(root)
    found = client.get_model_version(model_name(MACHINE), "1")
    run = client.get_run(found.run_id).data
    document = json.loads((bundles["first"] / "validation.json").read_text())
    assert run.metrics["golden.model.mae_K"] == document["windows"]["all"]["model"]["mae_K"]
    assert run.params["shop.weeks"] == "1"
    assert found.tags["golden_sha256"] == document["golden"]["sha256"]
    assert found.tags["bundle_sha256"] == bundle_hash(bundles["first"])
    assert not list(root.rglob("*.pkl"))  # nothing in it runs when it is loaded


def test_the_first_that_passed_is_champion_and_later_ones_challenge(
    root: Path, register_in: Callable[[str], int]
) -> None:
    assert aliases(root) == {}
    register_in("failed")
    assert aliases(root) == {"challenger": 1}
    register_in("first")
    assert aliases(root) == {"challenger": 1, "champion": 2}
    register_in("second")
    assert aliases(root) == {"challenger": 3, "champion": 2}


def test_a_candidate_of_long_ago_that_comes_back_challenges_again(
    root: Path, register_in: Callable[[str], int]
) -> None:
    for name in ("first", "second", "failed"):
        register_in(name)
    assert aliases(root) == {"champion": 1, "challenger": 3}
    register_in("second")
    assert aliases(root) == {"champion": 1, "challenger": 2}


def test_promotion_keeps_the_champion_as_previous(
    root: Path, register_in: Callable[[str], int]
) -> None:
    register_in("first")
    register_in("second")
    assert promote(MACHINE, root).aliases == ("champion",)
    assert aliases(root) == {"previous": 1, "champion": 2}


def test_a_promotion_that_breaks_off_has_kept_the_champion(
    root: Path, register_in: Callable[[str], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    register_in("first")
    register_in("second")
    from mlflow import MlflowClient

    really = MlflowClient.set_registered_model_alias

    def breaks_off(self: MlflowClient, name: str, alias: str, version: str) -> None:
        if alias == "champion":
            raise OSError("the disk is full")
        really(self, name, alias, version)

    monkeypatch.setattr(MlflowClient, "set_registered_model_alias", breaks_off)
    with pytest.raises(OSError, match="disk"):
        promote(MACHINE, root)
    assert aliases(root) == {"previous": 1, "champion": 1, "challenger": 2}


def test_what_did_not_pass_is_not_promoted(root: Path, register_in: Callable[[str], int]) -> None:
    register_in("first")
    with pytest.raises(ValueError, match=f"{MACHINE} has no challenger"):
        promote(MACHINE, root)
    register_in("failed")
    with pytest.raises(ValueError, match=r"version 2, has the verdict 'failed'"):
        promote(MACHINE, root)
    assert aliases(root) == {"champion": 1, "challenger": 2}


@pytest.fixture(scope="module")
def day(project: Path) -> pd.DataFrame:
    """The clean state of a day from its first measured temperature on, with ``time`` a column."""
    (path,) = state_days(project / f"data/clean/{MACHINE}", THURSDAY, THURSDAY)
    folder = project / f"data/clean/{MACHINE}/state"
    state = pd.read_parquet(folder / f"{path}.parquet").reset_index()
    state = state.drop(columns="index", errors="ignore")
    return state.iloc[int(state[TARGET].notna().to_numpy().argmax()) :].head(4 * 3600)


def from_bundle(folder: Path, state: pd.DataFrame) -> pd.DataFrame:
    model = load_spindle_model(folder / "spindle_thermal.json", folder / "residual")
    found = model.predict(state.set_index("time"), float(state[TARGET].iloc[0]))
    return found.reset_index(names="time")


def test_what_is_loaded_predicts_what_the_bundle_predicts(
    root: Path, register_in: Callable[[str], int], bundles: Bundles, day: pd.DataFrame
) -> None:
    register_in("first")
    expected = from_bundle(bundles["first"], day)
    assert expected["spindle_temperature"].notna().all() and len(expected) > 100
    pd.testing.assert_frame_equal(load(MACHINE, root=root)(day), expected)
    with pytest.raises(ValueError, match=f"{MACHINE} has no previous"):
        load(MACHINE, "previous", root)


def test_the_model_says_what_its_input_lacks(
    root: Path, register_in: Callable[[str], int], day: pd.DataFrame
) -> None:
    register_in("first")
    predict = load(MACHINE, root=root)
    for wrong, said in (
        (day.drop(columns="time"), "no column time"),
        (day.drop(columns=TARGET), f"no column {TARGET}"),
        (day.head(0), "not known in the first row"),
        (day.assign(**{TARGET: float("nan")}), "not known in the first row"),
    ):
        with pytest.raises(ValueError, match=said):
            predict(wrong)


def test_a_moved_project_loads_and_registers_where_it_is_now(
    root: Path, register_in: Callable[[str], int], bundles: Bundles, day: pd.DataFrame
) -> None:
    register_in("first")
    expected = load(MACHINE, root=root)(day)
    moved = root.with_name("moved to elsewhere")
    shutil.copytree(root, moved)
    shutil.rmtree(root)
    pd.testing.assert_frame_equal(load(MACHINE, root=moved)(day), expected)
    assert register(MACHINE, bundles["second"], {}, moved).aliases == ("challenger",)
    assert not root.exists()
    promote(MACHINE, moved)
    pd.testing.assert_frame_equal(
        load(MACHINE, root=moved)(day), from_bundle(bundles["second"], day)
    )


def bundle_in(root: Path) -> Path:
    (found,) = root.rglob("artifacts/bundle")
    return found


def spoil(bundle: Path) -> None:
    path = bundle / "spindle_thermal.json"
    path.write_text(path.read_text().replace("0.", "1.", 1))


@pytest.mark.parametrize(
    "tamper",
    [
        spoil,
        lambda bundle: (bundle / "validation.json").unlink(),
        lambda bundle: (bundle / "residual/more").write_text("x"),
        lambda bundle: shutil.rmtree(bundle),
    ],
    ids=["changed", "without its verdict", "with another file", "gone"],
)
def test_a_bundle_that_is_not_the_registered_one_is_refused(
    tamper: Callable[[Path], None], root: Path, register_in: Callable[[str], int]
) -> None:
    register_in("first")
    load(MACHINE, root=root)
    tamper(bundle_in(root))
    with pytest.raises(ValueError, match=r"version 1 .* is no longer the one that was registered"):
        load(MACHINE, root=root)


def test_artifacts_left_behind_are_named(root: Path, register_in: Callable[[str], int]) -> None:
    register_in("first")
    shutil.rmtree(root / "mlartifacts")
    with pytest.raises(ValueError, match=r"bring mlartifacts along with mlflow\.db"):
        load(MACHINE, root=root)


def test_a_store_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").write_bytes(b"no database at all" * 100)
    with pytest.raises(ValueError, match=r"the registry sqlite:///.*mlflow\.db cannot be opened"):
        versions(MACHINE, tmp_path)


@pytest.fixture
def registered(project: Path) -> Iterator[Path]:
    yield project
    for path in (project / "mlflow.db", project / "data/registered.json"):
        path.unlink(missing_ok=True)
    shutil.rmtree(project / "mlartifacts", ignore_errors=True)


def test_the_stage_registers_every_machine_with_a_spindle(
    registered: Path, bundles: Bundles
) -> None:
    build(registered, "register")
    said = json.loads((registered / "data/registered.json").read_text())
    models = registered / f"data/models/{MACHINE}"
    assert said == {MACHINE: {"bundle_sha256": bundle_hash(models), "verdict": "failed"}}
    with inside(registered):
        assert aliases(Path()) == {"challenger": 1}
