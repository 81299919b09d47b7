"""Two clones of a project share records and results by a DVC remote, as docs/team.md says."""

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest
import yaml

from tests.bundled_project import MACHINE, project
from tests.small_project import ROOT
from tests.team_servers import BUCKET, CREDENTIALS, s3
from tests.test_experiments import run

FOREST = f"data/models/{MACHINE}/spindle/residual"
OWN = (f"machine.{MACHINE}.identity", f"machine.{MACHINE}.roles", f"machine.{MACHINE}.spindle")
SECTIONS = {
    "identify_spindle": [*OWN, "spindle_fit", "residual_forest", "spindle_interval"],
    "judge_spindle": [*OWN, "spindle_limits"],
}
"""Stages of dvc.yaml, and the sections that each depends on."""


@pytest.fixture
def remote(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Address of a DVC remote, and that of the S3 server where it is one."""
    if request.param == "folder":
        yield str(tmp_path / "share"), ""
        return
    with s3() as server, mock.patch.dict(os.environ, CREDENTIALS):
        yield f"s3://{BUCKET}/dvc", server


@pytest.fixture
def one(tmp_path: Path, remote: tuple[str, str]) -> Path:
    """The first clone: records in DVC, two stages of dvc.yaml, and the remote ``team``."""
    root = project(tmp_path / "one")
    known = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    stages = {name: known[name] for name in SECTIONS}
    for name, sections in SECTIONS.items():
        stages[name]["do"]["params"] = sections
    pipeline = {"vars": [{"submodels": {"spindle": [MACHINE]}}], "stages": stages}
    (root / "dvc.yaml").write_text(yaml.safe_dump(pipeline))
    address, server = remote
    run(root, "git", "init", "-q")
    run(root, "dvc", "init", "-q")
    run(root, "dvc", "remote", "add", "-d", "team", address)
    if server:
        run(root, "dvc", "remote", "modify", "team", "endpointurl", server)
    run(root, "dvc", "add", f"data/clean/{MACHINE}")
    return root


def fit(root: Path, trees: int) -> None:
    """Set how the spindle is fitted."""
    path = root / "params.yaml"
    values = yaml.safe_load(path.read_text())
    values["spindle_fit"] = {"nodes": [1], "time_constants_s": [1500.0]}
    values["residual_forest"] = {"trees": trees, "every_s": 3600.0}
    values["spindle_interval"] = {"folds": 2}
    path.write_text(yaml.safe_dump(values))


def repro(root: Path, log: pytest.LogCaptureFixture, *options: str) -> tuple[list[str], bytes]:
    """Stages that `dvc repro` runs, and the forest after it."""
    log.clear()
    run(root, "dvc", "repro", *options)
    ran = re.findall(rf"Running stage '(\w+)@{MACHINE}'", log.text)
    files = sorted(path for path in (root / FOREST).rglob("*") if path.is_file())
    return ran, b"".join(path.read_bytes() for path in files)


@pytest.mark.proof
@pytest.mark.parametrize("remote", ["folder", "s3"], indirect=True)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_what_one_clone_computed_the_other_does_not(
    one: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    fit(one, 5)
    ran, tried = repro(one, caplog)
    assert ran == ["identify_spindle", "judge_spindle"]
    run(one, "git", "add", "-A")
    run(one, "git", "commit", "-qm", "tried")
    fit(one, 6)
    ran, kept = repro(one, caplog)
    assert ran == ["identify_spindle", "judge_spindle"] and kept != tried
    run(one, "git", "commit", "-qam", "kept")
    run(one, "dvc", "push", "-q", "--run-cache", "--all-commits")
    shutil.rmtree(one / ".dvc/cache")

    other = tmp_path / "other"
    run(tmp_path, "git", "clone", "-q", "one", "other")
    run(other, "dvc", "pull", "-q", "--run-cache")
    assert repro(other, caplog) == ([], kept)
    third = tmp_path / "third"
    run(tmp_path, "git", "clone", "-q", "one", "third")
    assert repro(third, caplog, "--pull") == ([], kept)
    # settings that the first tried: what git holds of a stage, its metrics, is made again
    fit(other, 5)
    ran, forest = repro(other, caplog, "--pull")
    assert (ran, forest) == (["judge_spindle"], tried)
    fit(other, 7)  # nobody has tried these
    assert repro(other, caplog)[0] == ["identify_spindle", "judge_spindle"]
