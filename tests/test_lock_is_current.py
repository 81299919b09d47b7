"""The committed dvc.lock is that of the committed code and parameters."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from ruamel.yaml import YAML

from pipeline.parameters import parted
from pipeline.stages.code import fingerprints
from pipeline.stages.compose import composed

ROOT = Path(__file__).parents[1]
HELD = ("data/code.json", "data/index/", "data/metrics/")
"""Small, the same on every processor, and needed by a dry run in a fresh clone."""
ACTIVE = yaml.safe_load((ROOT / "conf/fleet/active.yaml").read_text())["name"]
FLEETS = [
    pytest.param(name, marks=[pytest.mark.proof] if name == ACTIVE else [])  # a dry run tells it
    for name in sorted(p.stem for p in (ROOT / "conf/fleet").glob("*.yaml") if p.stem != "active")
]


@pytest.mark.skipif(shutil.which("dvc") is None, reason="dvc is not on the PATH")
def test_dvc_repro_has_nothing_to_do() -> None:
    answer = subprocess.run(
        ["dvc", "repro", "--dry", "--allow-missing"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    said = answer.stdout + answer.stderr
    assert answer.returncode == 0, said
    to_run = [line for line in said.splitlines() if line.startswith("Running stage")]
    assert not to_run, f"{to_run}: run `make repro` and commit dvc.lock"


LOCKS = {ACTIVE: ROOT / "dvc.lock", **{p.stem: p for p in (ROOT / "data/locks").glob("*.lock")}}
"""Of each fleet."""


@pytest.fixture(scope="module")
def locked() -> dict[str, dict[str, Any]]:
    """Stages by fleet."""
    read = YAML(typ="safe").load  # 1e-6 is a number, as for DVC
    return {fleet: read(path)["stages"] for fleet, path in LOCKS.items()}


def test_every_fleet_was_built_by_this_code(locked: dict[str, dict[str, Any]]) -> None:
    """Also those that are not active, whose stages DVC does not look at."""
    known = fingerprints(ROOT / "pipeline")
    stale = {
        (fleet, name) for fleet, stages in locked.items() for name, stage in stages.items()
        for stage_name, digest in stage.get("params", {}).get("data/code.json", {}).items()
        if known.get(stage_name) != digest
    }  # fmt: skip
    assert not stale, "build their fleet: make repro FLEET=…"


@pytest.mark.parametrize("fleet", FLEETS)
def test_every_fleet_was_built_with_these_settings(
    locked: dict[str, dict[str, Any]], fleet: str
) -> None:
    own, parts = parted(yaml.safe_load(composed(ROOT / "conf", (f"fleet={fleet}",))))
    files = {f"data/settings/{name}": json.loads(text) for name, text in parts.items()}
    machines = {Path(name).stem for name in parts if name.startswith("machine/")}
    found = set()
    for name, stage in locked[fleet].items():
        found.add(name.partition("@")[2])
        for file, values in stage.get("params", {}).items():
            there = own if file == "params.yaml" else files.get(file)
            if there is not None:
                now = json.loads(json.dumps({key: there.get(key) for key in values}))
                assert now == json.loads(json.dumps(values)), f"{name}: {file} has changed"
    assert found == {"", *machines}


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not on the PATH")
def test_git_holds_nothing_that_a_build_computes(locked: dict[str, dict[str, Any]]) -> None:
    """But for what is small and read by people: metrics, and what ``compose`` puts together."""
    answer = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if answer.returncode:
        pytest.skip("not a clone")
    held = answer.stdout.splitlines()
    outs = {
        out["path"]
        for stages in locked.values() for name, stage in stages.items() if name != "compose"
        for out in stage.get("outs", []) if not out["path"].startswith(HELD)
    }  # fmt: skip
    found = [file for file in held if outs & {file, *map(str, Path(file).parents)}]
    assert not found
    ignored = subprocess.run(
        ["git", "check-ignore", "--no-index", "--stdin"], cwd=ROOT, input="\n".join(sorted(outs)),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert set(ignored.stdout.split()) == outs
