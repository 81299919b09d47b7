"""A project of one simulated machine and one week, small enough to be built by a test."""

import json
import os
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from pipeline.parameters import SETTINGS, read_params
from pipeline.stages.__main__ import run
from pipeline.stages.compose import write_settings

ROOT = Path(__file__).parents[1]
MACHINE = "mill01"
MONDAY, WEDNESDAY, THURSDAY = "2026-01-05", "2026-01-07", "2026-01-08"
SUBMODELS = ("spindle", "control", "drive", "cutting")
PATHS = ("data/raw", "data/signals", "data/clean", "data/truth", "data/golden", "data/models",
         "data/champion", "data/history", "data/ledger", "data/twin_state", "data/condition",
         "data/incidents", "data/programs", "data/parts", "data/trials",
         "data/metrics")  # fmt: skip


@contextmanager
def inside(project: Path) -> Iterator[Path]:
    """Work in ``project``, as ``dvc repro`` and a person do."""
    before = Path.cwd()
    os.chdir(project)
    try:
        yield project
    finally:
        os.chdir(before)


def new_project(folder: Path) -> Path:
    """Parameters of one machine for one week, and nothing built yet."""
    with_conf(folder)
    for path in PATHS:
        (folder / path).mkdir(parents=True)
    for name, content in _settings_of_one_week().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


@cache
def _settings_of_one_week() -> dict[str, bytes]:
    """Files of the project's parameters, composed once: that takes longer than most tests."""
    with TemporaryDirectory() as name:
        folder = with_conf(Path(name))
        leave(folder, "active", MACHINE)
        with inside(folder):
            run("compose", "conf", "params.yaml", "data/settings")
        change(folder, "fleet", machines=[MACHINE], simulated=[MACHINE],
               submodels={name: [MACHINE] for name in SUBMODELS}, optimised=[MACHINE],
               trials=[MACHINE])  # fmt: skip
        change(folder, f"machine.{MACHINE}.shop", weeks=1, wear={"recorded": False})
        days = {"first": MONDAY, "last": WEDNESDAY}
        change(folder, f"machine.{MACHINE}.roles", training_days=days)
        change(folder, "spindle_fit", nodes=[1], time_constants_s=[1500.0])
        change(folder, "residual_forest", trees=5, every_s=3600.0)
        change(folder, "spindle_interval", folds=2)
        files = [folder / "params.yaml", *(folder / SETTINGS).rglob("*.json")]
        return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def with_conf(folder: Path, fleet: str = "simulated") -> Path:
    """A copy of conf/ with ``fleet`` as the active one, whichever is active here."""
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True, copy_function=shutil.copyfile)
    fleets = folder / "conf/fleet"
    (fleets / "active.yaml").write_text((fleets / f"{fleet}.yaml").read_text())
    return folder


def leave(folder: Path, fleet: str, *machines: str) -> None:
    """Take all but ``machines`` out of a fleet of ``folder``: Hydra takes seconds for seven."""
    path = folder / f"conf/fleet/{fleet}.yaml"
    found = yaml.safe_load(path.read_text())
    under = found["drives_under"]
    found["drives_under"] = {one: under[one] for one in machines if one in under}
    for section in (found, found["submodels"]):
        for key, entry in section.items():
            if isinstance(entry, list):
                section[key] = [one for one in entry if one in machines]
    path.write_text(yaml.safe_dump(found, sort_keys=False))


def change(project: Path, section: str, **values: Any) -> None:
    """Set keys of a section of the parameters."""
    every = params(project)
    found = every
    for key in section.split("."):
        found = found[key]
    found.update(values)
    store(project, every)


def store(project: Path, values: dict[str, Any]) -> None:
    """Write a project's parameters as the stage ``compose`` does."""
    write_settings(values, project / "params.yaml", project / SETTINGS)


def build(project: Path, *stages: str) -> None:
    """Run stages by the commands that dvc.yaml gives them."""
    known = yaml.load((ROOT / "dvc.yaml").read_text(), Loader=yaml.CSafeLoader)["stages"]
    with inside(project):
        for stage in stages:
            command = known[stage].get("do", known[stage])["cmd"].replace("${item}", MACHINE)
            words = shlex.split(command)
            for path in words[4:]:
                Path(path).parent.mkdir(parents=True, exist_ok=True)
            run(*words[3:])


def params(project: Path) -> dict[str, Any]:
    """All parameters of a project."""
    return read_params(project / "params.yaml")


def files_of(folder: Path) -> dict[str, Any]:
    """The ``files`` section of a manifest."""
    found: dict[str, Any] = json.loads((folder / "manifest.json").read_text())["files"]
    return found
