"""The commands of docs/experiments.md on a project of two stages: settings, and what is plotted."""

import io
import os
import re
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from unittest import mock

import pytest
import yaml
from dvc.cli import main as dvc
from dvc.repo import Repo

from pipeline.parameters import SETTINGS
from pipeline.stages import compose as composition
from tests.small_project import inside, with_conf

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/experiments.md").read_text()
PLOTTED = """
import json, yaml
from pathlib import Path
limit = yaml.safe_load(open("params.yaml"))["spindle_limits"]["mae_K"]
Path("predictions.csv").write_text(f"measured,predicted\\n1,{limit}\\n")
Path("metrics.json").write_text(json.dumps({"limit": limit}))
"""


def environment() -> dict[str, str]:
    return {**os.environ, "COLUMNS": "200", "PYTHONPATH": str(ROOT),
            "GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b",
            "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@b",
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}  # fmt: skip


def run(folder: Path, *words: str) -> str:
    """Output of a command; one of DVC runs in this process, which has loaded it."""
    if words[0] == "dvc":
        said = io.StringIO()
        with inside(folder), mock.patch.dict(os.environ, environment()), redirect_stdout(said):
            assert dvc([*words[1:]]) == 0, words
        return said.getvalue()
    done = subprocess.run(
        words, cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built and committed, then a comment of conf/ changed in a second commit."""
    root = with_conf(tmp_path_factory.mktemp("project"), "demo")
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    compose = {**stages["compose"], "deps": ["conf"], "params": []}
    (root / "plotted.py").write_text(PLOTTED)
    plotted = {
        "cmd": "python plotted.py", "deps": ["plotted.py"],
        "params": ["spindle_limits"], "metrics": [{"metrics.json": {"cache": False}}],
        "plots": [{"predictions.csv": stages["judge_spindle"]["do"]["plots"][0][
            "data/plots/${item}_spindle/predictions.csv"]}],
    }  # fmt: skip
    whole = {"vars": ["conf/fleet/active.yaml"], "stages": {"compose": compose, "plotted": plotted}}
    (root / "dvc.yaml").write_text(yaml.safe_dump(whole))
    run(root, "git", "init", "-q")
    with inside(root), pytest.MonkeyPatch.context() as patch:
        for name, value in environment().items():
            patch.setenv(name, value)
        Repo.init().close()
        for number in range(2):
            with (root / "conf/config.yaml").open("a") as conf:
                conf.write(f"# {number}\n")
            composition.compose(Path("conf"), Path("params.yaml"), Path(SETTINGS))
            if number == 0:
                run(root, sys.executable, "plotted.py")
            with Repo() as repo:  # as if it had run the stages
                repo.commit(force=True)
            run(root, "git", "add", ".")
            run(root, "git", "commit", "-q", "-m", str(number))
    return root


def commands(heading: str) -> list[str]:
    """Commands of the page's blocks below a heading, without their comments."""
    part = PAGE.split(heading, 1)[1].split("\n## ", 1)[0]
    lines = "\n".join(re.findall(r"```sh\n(.*?)```", part, re.DOTALL)).splitlines()
    return [line.partition("#")[0].strip() for line in lines]


def shown(table: str) -> dict[str, str]:
    """Rows of ``dvc exp show`` by the name of the experiment, ``1a2b3c4 [name]``."""
    named = [(re.search(r"\[(\w+)\]", row), row) for row in table.splitlines()]
    return {found[1]: row for found, row in named if found and found[1] not in ("main", "master")}


def test_a_clean_clone_differs_in_no_parameter(project: Path, tmp_path: Path) -> None:
    run(tmp_path, "git", "clone", "-q", str(project), "clone")
    assert run(tmp_path / "clone", "dvc", "params", "diff", "--json").strip() == "{}"
    run(project, "dvc", "gc", "--all-commits", "--dry", "-f")


def test_the_commands_that_compare_run(project: Path) -> None:
    found = commands("# Comparing and experimenting")
    assert [one.split()[1] for one in found] == ["params", "metrics", "plots"]
    for command in found:
        run(project, *command.split())


@pytest.mark.proof
def test_two_values_of_a_setting_are_shown_side_by_side(project: Path) -> None:
    found = commands("## Two values of one setting")
    soft, strict, show, plots = found
    for command in (soft, strict, show):
        said = run(project, *command.split())
    assert {name: row.split()[-1] for name, row in shown(said).items()} == {
        "soft": "4",
        "strict": "1",
    }
    place = run(project, *plots.split()).strip().splitlines()[-1]
    page = Path(place.removeprefix("file://")).read_text()
    assert "measured" in page and "soft" in page and "strict" in page
