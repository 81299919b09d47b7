"""A team's registry: MLflow's server on PostgreSQL, its files in an S3 store, two people at once."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
import pytest

from pipeline.champions import champion_of, promote, status
from pipeline.registry.loading import load
from pipeline.registry.runs import register
from pipeline.registry.store import client_of, versions
from pipeline.schema.bundle import bundle_of, read_champions
from tests.bundled_project import MACHINE, hour, project, registered, spindle
from tests.team_servers import BUCKET, CREDENTIALS, Team, free_port, team
from tests.test_registry import CHAMPION, MODELS, ROOT, aliases, direct

__all__ = ["team"]  # the fixture
PROMOTE = f"""
import sys, time
from pathlib import Path
from pipeline.champions import promote
import mlflow
root, by, ready, go = sys.argv[1:]
Path(ready).touch()
while not Path(go).exists():
    time.sleep(0.002)
try:
    print("won", promote("{MACHINE}", Path(root), why="better", by=by).version)
except ValueError as error:
    print("lost", error)
"""
"""A promotion in a process of its own, which waits until another is ready as well."""


@pytest.fixture(autouse=True)
def server(team: Team, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", team.tracking)


def clone(root: Path, name: str) -> Path:
    return shutil.copytree(root, root.parent / name)


@pytest.fixture
def root(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A project whose first bundle, with an error that no other test's has, is registered."""
    root = project(tmp_path / "project")
    error = 2.0 + 0.01 * sum(map(ord, request.node.name)) / 100
    spindle(root, error_K=error)
    return root
