"""docs/extend.md does what it says: a new sub-model from nothing, at most five files elsewhere."""

import json
import re
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from tests.small_project import leave

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs/extend.md").read_text()
DAYS = ["2026-01-05", "2026-01-06", "2026-01-07", "2026-01-26", "2026-01-27"]


def files() -> dict[str, str]:
    """Whole files that the page shows, by path."""
    found = re.findall(r"`([\w/.]+)`[^\n]*:\n\n```(?:python|yaml)\n(.*?)```", TEXT, re.DOTALL)
    return {path: text for path, text in found if path != "dvc.yaml"}


def changed(text: str, path: str) -> str:
    """A file after the lines that the page adds to it, or puts in the place of others."""
    (diff,) = re.findall(rf"`{re.escape(path)}`:\n\n```diff\n(.*?)```", TEXT, re.DOTALL)
    before = "".join(line[1:] + "\n" for line in diff.splitlines() if line[0] in " -")
    after = "".join(line[1:] + "\n" for line in diff.splitlines() if line[0] in " +")
    assert before in text, f"{path} no longer holds what docs/extend.md changes"
    return text.replace(before, after)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project after step 1 and 2 of the page, with days of records."""
    for folder in ("conf", "pipeline"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    for path, text in files().items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    for path in ("conf/config.yaml", "conf/fleet/simulated.yaml"):
        (tmp_path / path).write_text(changed((ROOT / path).read_text(), path))
    shutil.copy(tmp_path / "conf/fleet/simulated.yaml", tmp_path / "conf/fleet/active.yaml")
    leave(tmp_path, "active", "mill01")
    clean, manifest = tmp_path / "data/clean/mill01/state", {}
    clean.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number, day in enumerate(DAYS):
        time = pd.date_range(day, periods=7200, freq="s", tz="UTC")
        air = 20 + number + np.sin(np.arange(7200) / 900)
        winding = air + 3 + rng.normal(0, 0.3, 7200)
        table = {"time": time, "ambient_temperature": air, "spindle_temperature": winding}
        pd.DataFrame(table).to_parquet(clean / f"{day}.parquet")
        manifest[f"{day}.txt"] = {
            "sha256": sha256(day.encode()).hexdigest(), "last": f"{day}T02:00:00Z"
        }  # fmt: skip
    signals = tmp_path / "data/signals/mill01"
    signals.mkdir(parents=True)
    (signals / "manifest.json").write_text(json.dumps({"files": manifest}))
    return tmp_path


def test_the_page_makes_a_sub_model_that_is_identified_and_judged(project: Path) -> None:
    reads = ["data/signals/mill01/manifest.json", "data/clean/mill01"]
    folder = project / "data/models/mill01/winding"
    stages = [
        ["compose", "conf", "params.yaml", "data/settings"],
        ["identify_winding@mill01", *reads, str(folder), "data/golden"],
        ["judge_winding@mill01", *reads, str(folder), "data/golden", "metrics.json", "plots"],
    ]
    code = f"from pipeline.stages.__main__ import run\nfor words in {stages}: run(*words)"
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=project, text=True, capture_output=True, check=False,
        env={"PYTHONPATH": str(project), "PATH": ""},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    found = read_json(folder / "verdict.json", Verdict)
    assert (found.status, found.judged_role) == ("passed", "held_out")
    (total,) = found.of("spindle_temperature", group="all", role="held_out")
    assert total.rmse == pytest.approx(0.3, rel=0.1)
    assert total.baselines["air"].rmse == pytest.approx(3.0, rel=0.05)
    assert {one.case for one in found.cases if one.role == "held_out"} == set(DAYS[3:])


def test_its_files_pass_the_house_rules(project: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", project)
    folder = "pipeline/submodels/winding"
    for words in (["check"], ["format", "--check"]):
        answer = subprocess.run(
            [sys.executable, "-m", "ruff", *words, "--no-cache", folder], cwd=project, text=True,
            capture_output=True, check=False,
        )  # fmt: skip
        assert answer.returncode == 0, answer.stdout + answer.stderr


def test_its_columns_are_mapped_by_the_machines_of_the_page() -> None:
    for name in ("mill01", "mill02"):
        machine = yaml.safe_load((ROOT / f"conf/machine/{name}.yaml").read_text())
        assert {"ambient_temperature", "spindle_temperature"} <= set(machine["mapping"]["signals"])


def test_its_stages_are_those_of_the_page() -> None:
    (stages,) = re.findall(r"Its two stages in `dvc\.yaml`:\n\n```yaml\n(.*?)```", TEXT, re.DOTALL)
    added = yaml.safe_load("stages:\n" + stages)["stages"]
    known = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    assert set(added) == {"identify_winding", "judge_winding"}
    for name, stage in added.items():  # the same words as the spindle's, but for the name
        like = known[name.replace("winding", "spindle")]["do"]
        assert stage["do"]["cmd"] == like["cmd"].replace("spindle", "winding")


def test_at_most_five_files_lie_outside_of_its_folder() -> None:
    outside = [path for path in files() if not path.startswith("pipeline/submodels/winding/")]
    touched = {*outside, "conf/config.yaml", "conf/fleet/simulated.yaml", "dvc.yaml",
               "conf/fleet/active.yaml"}  # fmt: skip
    assert len(touched) <= 5
