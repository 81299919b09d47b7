"""The committed dvc.lock is that of the committed code and parameters."""

import shutil
import subprocess
from pathlib import Path

import pytest

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
