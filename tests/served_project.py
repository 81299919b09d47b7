"""A project of the machine ``rig`` with one sub-model that serves, and commands run in it."""

import shutil
from pathlib import Path
from typing import Any

import yaml
from typer.testing import CliRunner

from pipeline.app import commands
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from tests.small_project import ROOT

MACHINE = "rig"
IDENTITY = {"name": MACHINE, "origin": "simulated", "description": "made", "credit": "made"}


def served_project(
    folder: Path, model: Path, verdict: Verdict, signals: Path | None = None, **sections: Any
) -> Path:
    """A project whose champion and latest model of one kind, the folder's name, are ``model``."""
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    text = yaml.safe_dump({"identity": IDENTITY} | sections)
    (folder / f"conf/machine/{MACHINE}.yaml").write_text(text)
    if signals is not None:
        shutil.copytree(signals, folder / f"data/signals/{MACHINE}")
    for home in ("champion", "models"):
        target = folder / f"data/{home}/{MACHINE}/{verdict.submodel}"
        shutil.copytree(model, target)
        write_json(verdict, target / "verdict.json")
    return folder


def run(command: str, *words: str | Path) -> tuple[int, str]:
    """Exit status and words of a command on the machine."""
    given = [command, "--machine", MACHINE, *map(str, words)]
    done = CliRunner().invoke(commands.app, given)
    return done.exit_code, done.output
