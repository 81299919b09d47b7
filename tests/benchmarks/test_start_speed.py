"""Seconds that commands of kerf take, warm and where no compiled loop is kept yet.

A process each, since what is measured is what a person waits: imports, settings, compiled loops.
"""

import os
import resource
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PART = "G21 G90 G17\nG54\nT1 M6\nS5000 M3\nG0 X0 Y0 Z5\nG1 Z-2 F500\nX50 F1200\nY40\nX0\nY0\nM30\n"
CUT = ("--stock", "box:-20,70,-20,60,-20,0", "--tool-table", "shop", "--material", "A6061")
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
ENVIRONMENT["PYTHONPATH"] = str(ROOT)
"""That of a person, whose Python keeps its bytecode."""
TWICE = """
import sys
from time import process_time
from pipeline.app import commands, program_commands
from pipeline.app.kerf import app
for _ in range(2):
    began = process_time()
    try:
        app(sys.argv[1:])
    except SystemExit as end:
        assert not end.code
    took = process_time() - began
print(took, file=sys.stderr)
"""
COMMANDS = {
    "help": ("--help",),
    "status": ("status",),
    "interpret": ("interpret", "part.nc", "--out", "moves.csv"),
    "check": ("check", "part.nc", "part.nc"),
    "simulate": ("simulate", "part.nc", "--machine", "hurco"),
    "simulate-cut": ("simulate", "part.nc", "--machine", "mill01", *CUT),
    "optimise": (
        "optimise", "part.nc", "--machine", "mill01", *CUT, "--limit-load", "400",
        "--feed", "50", "8000", "--speed", "1000", "12000", "--out", "faster.nc",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("start")
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    shutil.copy(ROOT / "params.yaml", folder)
    shutil.copytree(ROOT / "data/settings", folder / "data/settings")
    shutil.copy(ROOT / "champions.json", folder)
    (folder / "part.nc").write_text(PART)
    return folder


def kerf(project: Path, words: tuple[str, ...], **variables: str) -> float:
    """Seconds of processor time that a command took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "pipeline.app", *words], cwd=project, capture_output=True, text=True,
        env={**ENVIRONMENT, **variables}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def own_work(project: Path, words: tuple[str, ...]) -> float:
    """Processor seconds of a command whose imports, settings and loops are there: run again."""
    done = subprocess.run(
        [sys.executable, "-c", TWICE, *words], cwd=project, capture_output=True, text=True,
        env=ENVIRONMENT, check=True,
    )  # fmt: skip
    return float(done.stderr.split()[-1])


@pytest.mark.parametrize("name", COMMANDS)
def test_warm_start(benchmark, project: Path, name: str) -> None:
    kerf(project, COMMANDS[name])
    seconds: list[float] = []
    benchmark.pedantic(
        lambda: seconds.append(kerf(project, COMMANDS[name])), rounds=3, warmup_rounds=0
    )
    benchmark.extra_info["processor_s"] = min(seconds)
    benchmark.extra_info["own_s"] = min(own_work(project, COMMANDS[name]) for _ in range(2))


@pytest.mark.parametrize("name", ["interpret", "simulate", "simulate-cut", "optimise"])
def test_first_start(benchmark, project: Path, name: str, tmp_path: Path) -> None:
    """With no compiled loop and no composed settings kept."""
    package = tmp_path / "pipeline"
    shutil.copytree(ROOT / "pipeline", package, ignore=shutil.ignore_patterns("__pycache__"))
    variables = {"PYTHONPATH": str(tmp_path), "KERF_CACHE": str(tmp_path / "cache")}
    run = partial(kerf, project, COMMANDS[name], **variables)
    benchmark.extra_info["processor_s"] = benchmark.pedantic(run, rounds=1)
