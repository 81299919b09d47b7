"""Promote, rollback, register, fill anew, nightly, killed at any moment: one champion."""

import os
import shutil
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import chdir
from pathlib import Path
from random import Random

import pytest

from pipeline.champions.promotion import promote, rollback, settle
from pipeline.champions.serving import champion_of, history_of
from pipeline.monitoring.budget import MonitoringSettings
from pipeline.registry.store import versions
from pipeline.schema.bundle import read_champions, stored_bundle
from pipeline.schema.ledger import read_ledger
from pipeline.stages.nightly import nightly
from tests.bundled_project import FLEET, MACHINE, project, quick_stores, registered, spindle

CHAMPION = f"data/champion/{MACHINE}"
LEDGER = Path(f"data/ledger/{MACHINE}.jsonl")


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """Projects as they are before each operation."""
    folder = tmp_path_factory.mktemp("killed")
    with pytest.MonkeyPatch.context() as patch, quick_stores():
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        challenged = project(folder / "promote", sealed=True)
        spindle(challenged, error_K=2.0)
        registered(challenged)
        fresh = shutil.copytree(challenged, folder / "register")
        spindle(fresh)
        spindle(challenged)
        registered(challenged)
        promoted = shutil.copytree(challenged, folder / "rollback")
        promote(MACHINE, promoted, why="better", by="Kim")
        serving = project(folder / "nightly", golden=("2026-01-19", "2026-01-20"))
        spindle(serving)
        registered(serving)
        yield {"promote": challenged, "register": fresh, "rollback": promoted,
               "fill": other_registry(folder / "fill", promoted), "nightly": serving}  # fmt: skip


def other_registry(root: Path, promoted: Path) -> Path:
    """A clone of a project whose registry has another bundle as version 1, and no more."""
    project(root, sealed=True)
    spindle(root, error_K=1.5)
    registered(root)
    for name in ("champions.json", "data/history", CHAMPION, f"data/models/{MACHINE}"):
        if (root / name).is_dir():
            shutil.rmtree(root / name)
        copy = shutil.copytree if (promoted / name).is_dir() else shutil.copy
        copy(promoted / name, root / name)
    return root


def scored(root: Path) -> None:
    """Score the two nights after the golden days, as `kerf nightly` does."""
    with chdir(root):
        folders = [
            Path("data") / name / MACHINE for name in ("champion", "raw", "signals", "clean")
        ]
        nightly(*folders, Path("data/golden"), LEDGER, fleet=FLEET, monitoring=MonitoringSettings())


OPERATIONS: dict[str, Callable[[Path], object]] = {
    "promote": lambda root: promote(MACHINE, root, why="better", by="Kim"),
    "rollback": lambda root: rollback(MACHINE, root, why="worse", by="Lee"),
    "register": registered,
    "fill": registered,
    "nightly": scored,
}


def killed_after(root: Path, operation: Callable[[Path], object], seconds: float) -> bool:
    """Run an operation in a process of its own and kill it; whether it had ended by then."""
    child = os.fork()
    if child == 0:
        try:
            operation(root)
            os._exit(0)
        except BaseException:  # noqa: BLE001, the parent sees the status
            traceback.print_exc()
            os._exit(1)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return not os.WIFSIGNALED(status)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "times"),
    [("promote", 60), ("rollback", 40), ("register", 30), ("fill", 40), ("nightly", 30)],
)
def test_there_is_one_champion_and_a_whole_history(
    before: dict[str, Path], tmp_path: Path, name: str, times: int
) -> None:
    start, operation = before[name], OPERATIONS[name]
    taken = shutil.copytree(start, tmp_path / "whole")
    began = time.perf_counter()
    operation(taken)
    whole = time.perf_counter() - began
    both = {champion_of(MACHINE, one) for one in (start, taken)}
    bundles, draw = {one.bundle for one in both if one}, Random(name)
    for number in range(times):
        root = shutil.copytree(
            start, tmp_path / f"killed{number}"
        )  # stores are known by their place
        ended = killed_after(root, operation, draw.uniform(0, 1.2 * whole))
        entries = history_of(MACHINE, root)  # raises where the chain is not whole
        held = stored_bundle(root / CHAMPION, MACHINE)
        assert held is not None and held.sha256 in bundles, f"{name} {number}"
        chosen = read_champions(root / "champions.json").machines.get(MACHINE)
        assert chosen is None or chosen.bundle in bundles
        assert [v.version for v in versions(MACHINE, root) if "champion" in v.aliases]
        settle(MACHINE, root)
        now = champion_of(MACHINE, root)
        assert now is not None and history_of(MACHINE, root)[: len(entries)] == entries
        (version,) = [v for v in versions(MACHINE, root) if "champion" in v.aliases]
        served = stored_bundle(root / CHAMPION, MACHINE)
        assert served is not None and version.bundle == now.bundle == served.sha256
        numbers = {v.bundle: v.version for v in versions(MACHINE, root)}
        assert len(numbers) == len(versions(MACHINE, root)), f"{name} {number}"  # none twice
        if name == "fill":
            registered(root)
            assert len(versions(MACHINE, root)) == len(versions(MACHINE, taken)) == 2
            own = {e.version: e.bundle for e in entries}
            assert all(own.get(n, bundle) == bundle for bundle, n in numbers.items())
        if entries:
            assert read_champions(root / "champions.json").machines[MACHINE].bundle == now.bundle
        if name == "nightly":
            there = read_ledger(root / LEDGER)  # raises where a line is none
            assert there in ((), read_ledger(taken / LEDGER))
            assert there or not ended
        if ended:
            assert now.bundle == (champion_of(MACHINE, taken) or now).bundle
        shutil.rmtree(root)
