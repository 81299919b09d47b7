"""One number means one bundle for ever, in whichever registry; two machines change at once."""

import logging
import shutil
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Thread
from unittest import mock

import pandas as pd
import pytest
from mlflow import MlflowClient

from pipeline.champions.promotion import delete, judged, promote, rollback
from pipeline.champions.serving import history_of, keep_serving, locked, status
from pipeline.registry.runs import renumber
from pipeline.registry.store import client_of, model_name, versions
from pipeline.schema.bundle import bundle_of, read_champions
from tests.bundled_project import MACHINE, project, quick_stores, registered, spindle
from tests.small_project import ROOT
from tests.test_cli import kerf, rows_of

NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A project in which version 2 serves in the place of version 1."""
    root = project(tmp_path_factory.mktemp("numbers") / "project")
    with pytest.MonkeyPatch.context() as patch, quick_stores():
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        for error_K in (2.0, 1.0):
            spindle(root, error_K=error_K)
            registered(root)
        promote(MACHINE, root, why="better", by="Kim", now=NOON)
        yield root


@pytest.fixture
def root(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    return shutil.copytree(made, tmp_path / "project")


def bundles(root: Path) -> dict[int, str]:
    return {one.version: one.bundle for one in versions(MACHINE, root)}


def test_a_registry_that_is_filled_again_counts_on_by_the_history(
    root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    before = bundles(root)
    (root / "mlflow.db").unlink()
    shutil.rmtree(root / "mlartifacts")
    spindle(root)  # a third
    with caplog.at_level(logging.WARNING):
        registered(root)
    assert caplog.messages == [
        f"the registry had no version of {MACHINE}: it holds 1, 2, 3 now, by the numbers of its "
        "history, and counts on after 2"
    ]
    newest = bundle_of(root / f"data/models/{MACHINE}", MACHINE, ["spindle"]).sha256
    assert bundles(root) == before | {3: newest}
    (row,) = status(MACHINE, ("spindle",), root)
    assert row["serving"].startswith("version 2 ") and row["challenger"] == "version 3"
    assert rollback(MACHINE, root, why="back", to=1, now=NOON).bundle == before[1]
    assert promote(MACHINE, root, why="forth", to=3, now=NOON).bundle == newest
    delete(MACHINE, 2, root, why="room")
    assert [e.version for e in history_of(MACHINE, root)] == [1, 2, 1, 3, 2]
    registered(root)  # what was deleted stays away
    assert set(bundles(root)) == {1, 3}


def test_a_registry_that_counts_otherwise_than_the_history_is_numbered_anew(
    root: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Another clone has registered versions of its own before it got the history by git."""
    clone = project(tmp_path / "clone")
    for error_K in (2.0, 1.5, 0.5):
        spindle(clone, error_K=error_K)
        registered(clone)
    other = bundles(clone)
    client_of(clone).set_registered_model_alias(model_name(MACHINE), "reference", "2")
    assert other[1] == bundles(root)[1] and other[2] != bundles(root)[2]
    for name in ("champions.json", f"data/history/{MACHINE}.jsonl"):
        (clone / name).parent.mkdir(exist_ok=True)
        shutil.copy(root / name, clone / name)
    shutil.copytree(root / f"data/history/{MACHINE}", clone / f"data/history/{MACHINE}")
    shutil.rmtree(clone / f"data/champion/{MACHINE}")
    shutil.copytree(root / f"data/champion/{MACHINE}", clone / f"data/champion/{MACHINE}")
    with caplog.at_level(logging.WARNING):
        registered(clone)
    assert caplog.messages == [
        f"version 2 of {MACHINE} in the registry is version 4 now: in its history 2 is another "
        "bundle"
    ]
    now = {one.version: one for one in versions(MACHINE, clone)}
    assert {n: one.bundle for n, one in now.items()} == {
        1: other[1], 3: other[3], 4: other[2], 5: bundles(root)[2]
    }  # fmt: skip
    assert now[4].aliases == ("reference",) and Path(now[4].place.removeprefix("file://")).is_dir()
    assert rollback(MACHINE, clone, why="back", to=1, now=NOON).bundle == other[1]
    assert rollback(MACHINE, clone, why="forth", to=2, now=NOON).bundle == bundles(root)[2]
    # version 2 is the history's, also where the registry had to give it another number
    assert rollback(MACHINE, clone, why="back", to=1, now=NOON).bundle == other[1]
    with pytest.raises(ValueError, match="has no version 5; there are 1, 2, 3, 4"):
        promote(MACHINE, clone, why="forth", to=5, now=NOON)
    assert judged(MACHINE, clone, to=2).challenger.bundle == bundles(root)[2]
    with pytest.raises(ValueError, match="version 2 of mill01 served less than"):
        delete(MACHINE, 2, clone, why="room", now=NOON)
    delete(MACHINE, 2, clone, why="room", now=NOON + timedelta(days=9))
    assert history_of(MACHINE, clone)[-1].version == 2 and set(bundles(clone)) == {1, 3, 4}


def test_a_number_that_was_given_anew_already_is_not_given_twice(root: Path) -> None:
    """A run broke off between the new number and the deletion of the old one."""
    known = {2: bundles(root)[1]}
    first, second = versions(MACHINE, root)
    with (
        mock.patch.object(MlflowClient, "delete_model_version", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        renumber(second, root, known)
    assert set(bundles(root)) == {1, 2, 3}
    assert renumber(second, root, known) == 3
    assert bundles(root) == {1: first.bundle, 3: second.bundle}


def test_two_machines_do_not_lose_each_other_s_line_of_champions_json(root: Path) -> None:
    """Whoever changes the file waits for whoever holds it, and reads it after that."""
    chosen = root / "champions.json"
    said = chosen.read_text()
    chosen.unlink()
    words = (
        "from pathlib import Path; from pipeline.champions.promotion import settle; "
        f"print(1, flush=True); settle('{MACHINE}', Path('{root}'))"
    )
    command = [sys.executable, "-c", words]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as other, locked("champions", root):
        assert other.stdout is not None and other.stdout.readline() == b"1\n"
        with pytest.raises(subprocess.TimeoutExpired):
            other.wait(4)
        chosen.write_text(said.replace(f'"{MACHINE}"', '"mill02"'))
    assert other.returncode == 0
    assert set(read_champions(chosen).machines) == {"mill02", MACHINE}


def test_the_stage_waits_for_whoever_holds_its_machine(root: Path) -> None:
    stage = Thread(target=keep_serving, args=(MACHINE, ("spindle",), root))
    with locked(MACHINE, root):
        stage.start()
        stage.join(1.5)
        assert stage.is_alive()
    stage.join(60)
    assert not stage.is_alive()


def test_the_command_says_what_served_on_a_day_of_the_plant(root: Path) -> None:
    """A day of New York ends at 05:00 UTC of the next."""
    (root / "conf").mkdir()
    (root / "conf/machine").symlink_to(ROOT / "conf/machine")
    day = min((root / f"data/clean/{MACHINE}/state").glob("*.parquet"))
    state = pd.read_parquet(day)
    state.assign(time=state["time"].dt.tz_convert("America/New_York")).to_parquet(day)
    back = datetime(2026, 3, 4, 4, tzinfo=UTC)  # 23:00 of the day before
    rollback(MACHINE, root, why="back", by="Lee", now=back, force=True)

    def on(at: str) -> list[tuple[str, str]]:
        rows = rows_of(kerf(root, "history", "-m", MACHINE, "--at", at))
        return [(row["version"], row["by"]) for row in rows]

    assert on("2026-03-01") == on("2026-03-02") == [("2", "Kim")]
    assert on("2026-03-03") == [("2", "Kim"), ("1", "Lee")]
    assert on("2026-03-04") == [("1", "Lee")]
    assert on("2026-03-04T03:59Z") == [("2", "Kim")] and on("2026-03-04T04:00Z") == [("1", "Lee")]
