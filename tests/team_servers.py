"""Servers of a team, real ones: PostgreSQL, an S3 store, and MLflow's server upon both.

A test that needs PostgreSQL skips where it is not installed (``apt-get install postgresql``).
"""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import pytest

BUCKET = "kerf"
DEBIAN = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
"""Where Debian keeps initdb and postgres, which are on nobody's path."""
CREDENTIALS = {"AWS_ACCESS_KEY_ID": "team", "AWS_SECRET_ACCESS_KEY": "secret",
               "AWS_DEFAULT_REGION": "us-east-1"}  # fmt: skip
PATIENCE_S = 120.0
"""Longest start of a server [s]."""


@dataclass(frozen=True, kw_only=True)
class Team:
    """Addresses of a team's servers."""

    tracking: str
    s3: str


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def program(name: str) -> str:
    """Path of one of PostgreSQL's programs; the test skips where there is none."""
    path = os.pathsep.join([os.environ.get("PATH", ""), *map(str, DEBIAN)])
    found = shutil.which(name, path=path)
    if found is None:
        pytest.skip(f"PostgreSQL's {name} is not installed")
    return found


@contextmanager
def serving(
    *words: str, port: int, answers: str = "", environment: Mapping[str, str] | None = None,
    user: str | None = None,
) -> Iterator[None]:  # fmt: skip
    """Run a server until the block ends; it is up when the port, or a page of it, answers."""
    with tempfile.TemporaryFile("w+") as said:
        server = subprocess.Popen(
            words, env={**os.environ, **(environment or {})}, user=user, cwd="/",
            stdout=said, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            until = time.monotonic() + PATIENCE_S
            while not _up(port, answers):
                if server.poll() is not None or time.monotonic() > until:
                    said.seek(0)
                    raise RuntimeError(f"{words[0]} did not start: {said.read()[-2000:]}")
                time.sleep(0.1)
            yield
        finally:
            server.terminate()
            server.wait(timeout=PATIENCE_S)


def _up(port: int, page: str) -> bool:
    try:
        if page:
            with urlopen(f"http://127.0.0.1:{port}{page}", timeout=5.0):
                return True
        with socket.create_connection(("127.0.0.1", port), timeout=5.0):
            return True
    except (URLError, OSError):
        return False


@contextmanager
def postgres() -> Iterator[str]:
    """Address of the empty database of a new cluster, as SQLAlchemy takes it."""
    initdb, server = program("initdb"), program("postgres")
    user = "postgres" if os.geteuid() == 0 else None  # it refuses root
    with tempfile.TemporaryDirectory(prefix="kerf-postgres-") as name:
        folder, port = Path(name), free_port()
        if user:
            shutil.chown(folder, user)
        subprocess.run(
            [initdb, "-D", str(folder / "data"), "-U", "team", "-A", "trust", "--no-sync"],
            user=user, cwd="/", check=True, capture_output=True,
        )  # fmt: skip
        words = (server, "-D", str(folder / "data"), "-p", str(port), "-k", str(folder),
                 "-h", "127.0.0.1", "-F")  # fmt: skip
        with serving(*words, port=port, user=user):
            yield f"postgresql+pg8000://team@127.0.0.1:{port}/postgres"


def s3_client(address: str) -> Any:
    """Client of the S3 store."""
    import boto3

    return boto3.client(
        "s3", endpoint_url=address, aws_access_key_id="team", aws_secret_access_key="secret",
        region_name="us-east-1",
    )  # fmt: skip


@contextmanager
def s3() -> Iterator[str]:
    """Address of an S3 store with one empty bucket."""
    port = free_port()
    address = f"http://127.0.0.1:{port}"
    with serving(
        sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port), port=port
    ):
        s3_client(address).create_bucket(Bucket=BUCKET)
        yield address


@contextmanager
def mlflow_server(database: str, store: str) -> Iterator[str]:
    """Address of MLflow's server with its records in a database and its files in an S3 store."""
    port = free_port()
    words = (
        sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port),
        "--workers", "1", "--backend-store-uri", database,
        "--artifacts-destination", f"s3://{BUCKET}/mlflow",
    )  # fmt: skip
    environment = {**CREDENTIALS, "MLFLOW_S3_ENDPOINT_URL": store,
                   "MLFLOW_DISABLE_TELEMETRY": "true"}  # fmt: skip
    with serving(*words, port=port, answers="/health", environment=environment):
        yield f"http://127.0.0.1:{port}"


@pytest.fixture(scope="session")
def team() -> Iterator[Team]:
    """All three servers."""
    with ExitStack() as stack:
        database = stack.enter_context(postgres())
        store = stack.enter_context(s3())
        yield Team(tracking=stack.enter_context(mlflow_server(database, store)), s3=store)
