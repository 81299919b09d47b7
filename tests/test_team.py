"""A team's registry: MLflow's server on PostgreSQL and S3, two people at once."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from pipeline.champions.promotion import promote, rollback
from pipeline.champions.serving import status
from pipeline.registry.loading import load
from pipeline.registry.store import EXPERIMENT, client_of, versions
from pipeline.schema.bundle import bundle_of
from tests.bundled_project import MACHINE, hour, project, registered, spindle
from tests.team_servers import BUCKET, Team, s3_client, team
from tests.test_registry import CHAMPION, MODELS, ROOT, aliases, direct

__all__ = ["team"]  # the fixture
BARRIER = """
import sys, time
from pathlib import Path
import mlflow
from tests.bundled_project import registered
from pipeline.champions.promotion import promote, rollback
root, by, ready, go = sys.argv[1:]
Path(ready).touch()
while not Path(go).exists():
    time.sleep(0.002)
"""
"""Beginning of a process of one of two people, who wait for each other."""
PROMOTE = f"""
try:
    print("won", promote("{MACHINE}", Path(root), why="better", by=by).version)
except ValueError as error:
    print("lost", error)
"""


@pytest.fixture
def server(team: Team, monkeypatch: pytest.MonkeyPatch) -> Team:
    """The servers, with no registered model and experiment of another test."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", team.tracking)
    client = client_of(Path())
    before = client.get_experiment_by_name(EXPERIMENT)
    if before is not None:  # a deleted one keeps its name
        client.rename_experiment(before.experiment_id, f"before {before.experiment_id}")
    for model in client.search_registered_models():
        client.delete_registered_model(model.name)
    return team


def at_once(root: Path, what: str, **clones: Path) -> dict[str, str]:
    """Words of processes of several people that begin together, by name of the person."""
    go = root / "go"
    running = {}
    for by, clone in clones.items():
        words = [sys.executable, "-c", BARRIER + what, str(clone), by, str(root / by), str(go)]
        running[by] = subprocess.Popen(
            words, cwd=clone, env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
    while not all((root / by).exists() for by in clones):
        assert all(one.poll() is None for one in running.values())
    go.touch()
    said = {by: one.communicate() for by, one in running.items()}
    assert not any(one.returncode for one in running.values()), said
    return {by: out for by, (out, _) in said.items()}


@pytest.mark.proof
def test_a_server_on_postgresql_and_s3_registers_promotes_and_serves(
    server: Team, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    root = project(tmp_path / "one")
    spindle(root, error_K=2.0)
    registered(root)
    first = direct(root / CHAMPION, hour(root))
    spindle(root)
    registered(root)
    assert aliases(root) == {"champion": 1, "challenger": 2}
    (row,) = status(MACHINE, ("spindle",), root)
    assert (row["serving"], row["challenger"]) == ("version 1", "version 2")
    now = promote(MACHINE, root, why="warmer oil", by="Kim")
    assert aliases(root) == {"previous": 1, "champion": 2}
    tags = versions(MACHINE, root)[1].tags
    assert (tags["promoted_at"], tags["promoted_by"]) == (now.since, "Kim")
    assert not (root / "mlflow.db").exists()
    found = s3_client(server.s3).list_objects_v2(Bucket=BUCKET, Prefix="mlflow/", MaxKeys=5)
    assert found["KeyCount"] == 5
    # somebody else, whose clone has neither the first bundle nor its model
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    other = shutil.copytree(root, tmp_path / "other")
    shutil.rmtree(other / CHAMPION)
    shutil.rmtree(other / "data/warm")
    back = rollback(MACHINE, other, why="the oil was changed back", by="Robin")
    assert bundle_of(other / CHAMPION, MACHINE, ["spindle"]).sha256 == back.bundle != now.bundle
    (kept,) = (other / "mlartifacts/from_server").iterdir()
    assert not list(kept.rglob("*.py"))  # what a promotion needs, without the code
    for alias, expected in (("champion", first), ("previous", direct(root / CHAMPION, hour(root)))):
        pd.testing.assert_frame_equal(load(MACHINE, alias, other)(hour(root)), expected)
    assert not list(scratch.iterdir())  # what was brought lies in the project, nowhere else
    before = {path: path.stat().st_mtime_ns for path in other.rglob("mlartifacts/**/*.json")}
    load(MACHINE, root=other)
    assert {
        path: path.stat().st_mtime_ns for path in other.rglob("mlartifacts/**/*.json")
    } == before
    assert capfd.readouterr().out == ""


@pytest.mark.proof
def test_two_who_register_at_once_both_find_their_bundle(server: Team, tmp_path: Path) -> None:
    """Neither experiment nor registered model is there when both look."""
    one, two = project(tmp_path / "one"), project(tmp_path / "two")
    spindle(one)
    spindle(two, error_K=0.1)
    at_once(tmp_path, """
from tests.bundled_project import spindle
registered(Path(root))
""", Kim=one, Robin=two)  # fmt: skip
    known = {v.bundle for v in versions(MACHINE, one)}
    assert known == {bundle_of(root / MODELS, MACHINE, ["spindle"]).sha256 for root in (one, two)}


@pytest.fixture
def clones(server: Team, tmp_path: Path) -> dict[str, Path]:
    """Two clones of a project whose champion is wrong by 2 K, each with a better challenger."""
    one = project(tmp_path / "one")
    spindle(one, error_K=2.0)
    registered(one)
    two = shutil.copytree(one, tmp_path / "two")
    for root, error_K in ((one, 0.0), (two, 0.1)):
        spindle(root, error_K=error_K)
        registered(root)
    return {"Kim": one, "Robin": two}


@pytest.mark.proof
def test_of_two_who_promote_at_once_one_wins_and_the_other_is_told(
    clones: dict[str, Path], tmp_path: Path
) -> None:
    said = at_once(tmp_path, PROMOTE, **clones)
    (winner,) = [by for by, words in said.items() if words.startswith("won")]
    (loser,) = [by for by, words in said.items() if words.startswith("lost")]
    assert winner in said[loser]
    number = int(said[winner].split()[1])
    assert aliases(clones[winner])["champion"] == number
    served = {v.version: v.bundle for v in versions(MACHINE, clones[winner])}[number]
    newest = {by: bundle_of(root / MODELS, MACHINE, ["spindle"]).sha256
              for by, root in clones.items()}  # fmt: skip
    assert served == newest[winner]
    assert newest[loser] != bundle_of(clones[loser] / CHAMPION, MACHINE, ["spindle"]).sha256


@pytest.mark.proof
def test_a_clone_that_did_not_hear_of_a_promotion_does_not_undo_it(
    clones: dict[str, Path],
) -> None:
    now = promote(MACHINE, clones["Kim"], why="better", by="Kim")
    registered(clones["Robin"])  # `dvc repro` before `git pull`
    assert aliases(clones["Kim"])["champion"] == now.version


@pytest.fixture
def hangs_up() -> Iterator[tuple[str, list[int]]]:
    """Address of a server that ends each connection at once, and what it counted."""
    seen: list[int] = []
    with socket.create_server(("127.0.0.1", 0)) as door:

        def end() -> None:
            while True:
                try:
                    door.accept()[0].close()
                except OSError:
                    return
                seen.append(1)

        threading.Thread(target=end, daemon=True).start()
        yield f"http://127.0.0.1:{door.getsockname()[1]}", seen
        door.shutdown(socket.SHUT_RDWR)


def test_a_server_that_does_not_answer_is_one_sentence_soon(
    hangs_up: tuple[str, list[int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, seen = hangs_up
    monkeypatch.setenv("MLFLOW_TRACKING_URI", address)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR", "0")
    with pytest.raises(ValueError, match=f"the registry {address} does not answer .*when it does"):
        versions(MACHINE, tmp_path)
    assert len(seen) == 1  # before MLflow is imported, which tries it for seconds
