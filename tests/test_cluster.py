"""A fleet on a Dask cluster of real processes: the bits of DVC's own run, whoever dies."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
import yaml
from dvc.cli import main as dvc
from dvc.repo import Repo

from pipeline.app.cluster import identify_fleet
from pipeline.parallel import PLACE, _client, mapped
from tests.cluster import ROOT, cluster
from tests.small_project import inside
from tests.submodels.spindle.spindle_days import ONE, state_table
from tests.test_cli import kerf
from tests.test_parallel import absent, process_of, refuse

DAYS = ("2026-01-05", "2026-01-06", "2026-01-07")
LAST = "2026-01-07"
FITTING = {
    "spindle_fit": {"step_s": 60.0, "nodes": [1], "time_constants_s": [1500.0]},
    "residual_forest": {"trees": 5, "every_s": 3600.0}, "spindle_interval": {"folds": 2},
}  # fmt: skip


def project(root: Path, machines: Sequence[str], wrong: Sequence[str] = ()) -> Path:
    """Clean records of spindles of one type, and DVC's stage that identifies them."""
    rng = np.random.default_rng(4)
    known = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    kept = {"vars": ["fleet.yaml"], "stages": {"identify_spindle": known["identify_spindle"]}}
    write(root / "dvc.yaml", yaml.safe_dump(kept))
    write(root / "fleet.yaml", yaml.safe_dump({"submodels": {"spindle": list(machines)}}))
    write(root / "data/code.json", json.dumps({"identify_spindle": "1"}))
    roles = {"training_days": {"first": DAYS[0], "last": LAST}}
    own = {}
    for name in machines:
        heating = {one: value * np.exp(rng.normal(0, 0.2)) for one, value in ONE.heating.items()}
        clean = root / f"data/clean/{name}/state"
        clean.mkdir(parents=True)
        for number, day in enumerate(DAYS):
            table = state_table(replace(ONE, heating=heating), number, day, 1.5).reset_index()
            table.to_parquet(clean / f"{day}.parquet")
        files = {f"{day}.txt": {"sha256": day, "last": f"{day}T16:00:00Z"} for day in DAYS}
        write(root / f"data/signals/{name}/manifest.json", json.dumps({"files": files}))
        write(root / f"data/index/{name}.json", json.dumps({"timed": name, "frozen": ""}))
        sections = ["identity", "roles", "spindle", *FITTING]
        write(root / f"data/settings/sections/{name}.json", json.dumps(dict.fromkeys(sections, 1)))
        days = {"first": "2025-01-01", "last": "2025-01-02"}
        own[name] = {"identity": {"name": name, "origin": "simulated"}, "spindle": {},
                     "roles": {"training_days": days} if name in wrong else roles}  # fmt: skip
    values = {"fleet": {"name": "many", "machines": list(machines)}, "machine": own, **FITTING}
    write(root / "params.yaml", yaml.safe_dump(values))
    with inside(root):
        Repo.init(no_scm=True).close()
    return root


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def command(folder: Path, *words: str, status: int = 0, **around: str) -> tuple[float, str]:
    """Seconds and output of a command of Python in a folder."""
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), "DVC_NO_ANALYTICS": "1", **around},
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return time.monotonic() - began, done.stdout + done.stderr


def models(root: Path) -> dict[str, bytes]:
    folder = root / "data/models"
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def lock(root: Path) -> Any:
    return yaml.safe_load((root / "dvc.lock").read_text())


def test_a_cluster_gives_results_and_first_errors_as_here(tmp_path: Path) -> None:
    with cluster(tmp_path):
        found = mapped(np.sqrt, [np.arange(3.0), np.arange(4.0)], compute="dask")
        assert [one.tolist() for one in found] == [[0.0, 1.0, 2**0.5], [0.0, 1.0, 2**0.5, 3**0.5]]
        assert os.getpid() not in mapped(process_of, range(2)), "they ran in this process"
        assert mapped(process_of, range(2), compute="serial") == [os.getpid()] * 2
        assert set(mapped(place_inside, range(2))) == {"serial"}, "a task starts processes itself"
        with pytest.raises(ValueError, match=r"^O1\.nc:2:3: X: give a number$") as caught:
            mapped(refuse, range(5))
        assert caught.value.line == 2  # type: ignore[attr-defined]
        with pytest.raises(FileNotFoundError, match=r"'no-such-file-7'"):
            mapped(absent, [7, 8])


def test_a_worker_that_lacks_what_makes_the_bits_the_same_is_refused(tmp_path: Path) -> None:
    """It is the only one: beside others a few quick tasks may never reach it."""
    refused = pytest.raises(OSError, match=r"without \w+=.*: start it by `kerf worker`")
    with cluster(tmp_path, bare=True), refused:
        mapped(process_of, range(2))


def place_inside(task: int) -> str:
    return os.environ[PLACE]


def test_wrong_places_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(PLACE, raising=False)
    with pytest.raises(ValueError, match="compute = 'dask' without a cluster: give the address"):
        mapped(abs, [1, 2], compute="dask")
    monkeypatch.setenv(PLACE, "cluster")
    with pytest.raises(ValueError, match="KERF_COMPUTE = 'cluster': give serial, processes or"):
        mapped(abs, [1, 2])
    monkeypatch.setenv(PLACE, "serial")
    assert mapped(process_of, range(2)) == [os.getpid()] * 2


def test_a_stage_waits_for_the_model_that_it_reads(tmp_path: Path) -> None:
    root = project(tmp_path / "p", ["m01"])
    stages = yaml.safe_load((root / "dvc.yaml").read_text())
    stages["stages"]["identify_following_residual"] = {
        "foreach": ["m01"],
        "do": {"cmd": "python -m pipeline.stages identify_following_residual@${item} a b c d",
               "deps": ["data/models/${item}/spindle"], "outs": ["c/model.json"]},
    }  # fmt: skip
    write(root / "dvc.yaml", yaml.safe_dump(stages))
    with inside(root):
        errors = identify_fleet([], ["following_residual"], print)
    assert errors == [
        "identify_following_residual@m01 reads a model that is out of date: identify that one first"
    ]


def test_identify_does_what_dvc_asks_and_dvc_takes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process, which has loaded DVC; the proof below identifies in others."""
    monkeypatch.setenv(PLACE, "serial")
    root = project(tmp_path / "p", ["m01", "m02"], wrong=["m02"])
    done = kerf(root, "identify")
    assert done.exit_code == 2
    assert "identify_spindle@m01: 2 files" in done.stdout
    assert "kerf: identify_spindle@m02: no stretch of at least 3600 s" in done.stderr
    assert set(models(root)) == {"m01/spindle/model.json", "m01/spindle/residual/forest.json"}
    assert set(lock(root)["stages"]) == {"identify_spindle@m01"}
    lines: list[str] = []
    with inside(root):
        capsys.readouterr()
        assert dvc(["status", "identify_spindle@m01"]) == 0
        assert "up to date" in capsys.readouterr().out
        assert identify_fleet(["m01"], ["spindle"], lines.append) == lines == []
        with pytest.raises(ValueError, match=r"dvc\.yaml has no such identification: name others"):
            identify_fleet(["m09"], [], lines.append)


@pytest.mark.proof
def test_twenty_machines_on_two_workers_one_of_which_dies_have_the_bits_of_dvc(
    tmp_path: Path, record_property: Any
) -> None:
    names = [f"m{number:02}" for number in range(1, 21)]
    serial = project(tmp_path / "serial", names)
    by_dvc, at_once, killed = (
        shutil.copytree(serial, tmp_path / name) for name in ("by_dvc", "at_once", "killed")
    )
    identify = ("-m", "pipeline.app", "identify")
    seconds = {"one process": command(serial, *identify, **{PLACE: "serial"})[0]}
    assert len(models(serial)) == 40
    # DVC's own run of a stage: the same files, the same entry in its lock
    seconds["dvc repro of one"], _ = command(by_dvc, "-m", "dvc", "repro", "identify_spindle@m07")
    own = models(by_dvc)
    assert own and own.items() <= models(serial).items(), "DVC's own stage gives other bits"
    assert lock(by_dvc)["stages"].items() <= lock(serial)["stages"].items()
    with cluster(at_once) as address:
        seconds["two workers"], _ = command(at_once, *identify, **{PLACE: address})
    assert models(at_once) == models(serial), "other bits on the cluster"
    assert lock(at_once) == lock(serial)
    assert "up to date" in command(at_once, "-m", "dvc", "repro")[1]
    died: list[int] = []
    with cluster(killed) as address:
        killer = Thread(target=kill_one, args=(address, died))
        killer.start()
        seconds["two workers, one killed"], _ = command(killed, *identify, **{PLACE: address})
        killer.join()
    assert died, "no worker was killed while it worked"
    assert models(killed) == models(serial), "other bits after a worker died"
    record_property("seconds", seconds)
    ratio = seconds["one process"] / seconds["two workers"]
    sys.stdout.write(f"\n20 identifications, s: {seconds}; {ratio:.2f} times as fast\n")


def kill_one(address: str, died: list[int]) -> None:
    """Kill a worker that has done some tasks and is at another, as a power cut does."""
    client = _client(address)
    for _ in range(6000):
        time.sleep(0.2)
        for worker, tasks in client.processing().items():
            if tasks and len(client.has_what()[worker]) >= 3:
                pid = client.run(os.getpid, workers=[worker])[worker]
                os.kill(pid, signal.SIGKILL)
                died.append(pid)
                return
