"""The committed dvc.lock is that of the committed code and parameters."""

import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]


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


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not on the PATH")
def test_git_holds_nothing_that_a_build_computes() -> None:
    """What is computed may differ in its last digits; what ``compose`` puts together may not."""
    answer = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if answer.returncode:
        pytest.skip("not a clone")
    held = answer.stdout.splitlines()
    stages = yaml.safe_load((ROOT / "dvc.lock").read_text())["stages"]
    outs = {out["path"] for name, stage in stages.items() if name != "compose"
            for out in stage.get("outs", [])}  # fmt: skip
    found = [file for file in held if outs & {file, *map(str, Path(file).parents)}]
    assert not found
    ignored = subprocess.run(
        ["git", "check-ignore", "--no-index", "--stdin"], cwd=ROOT, input="\n".join(sorted(outs)),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert set(ignored.stdout.split()) == outs
