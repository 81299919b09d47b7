"""A bundle served in an environment of its own requirements answers as its sub-models do here.

It is served as ``docs/promote.md`` says, ``mlflow models serve --env-manager virtualenv``, and
asked over HTTP.  The bundles are those of a built project, this one or that of ``KERF_BUILT``.
"""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError

import numpy as np
import pandas as pd
import pytest

from pipeline.registry.loading import place_of
from pipeline.registry.store import DATABASE, versions
from pipeline.schema.bundle import BUNDLE, Bundle
from pipeline.schema.store import read_json
from pipeline.submodels.contract import submodel

BUILT = Path(os.environ.get("KERF_BUILT", Path(__file__).parents[1]))
CHAMPIONS = sorted(one.name for one in (BUILT / "data/champion").glob("*") if one.is_dir())
STARTED_S = 1200.0
"""Longest time in which an environment is made and a server answers [s]; torch is downloaded."""
AGREEMENT = 1e-9
"""Greatest difference of an answer, relative or in its unit: JSON keeps doubles, sums may not."""


@contextmanager
def served(machine: str, scratch: Path) -> Iterator[str]:
    """Address of a server of the champion of ``machine``, away from any copy of the package."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = str(one.getsockname()[1])
    place = place_of(champion_of(machine), BUILT)
    hidden = ("PYTHONPATH", "VIRTUAL_ENV", "MLFLOW_TRACKING_URI")
    own = {key: value for key, value in os.environ.items() if key not in hidden}
    with (scratch / "server.log").open("w") as log:
        server = subprocess.Popen(
            [sys.executable, "-m", "mlflow", "models", "serve", "-m", str(place),
             "--env-manager", "virtualenv", "-p", port],
            cwd=scratch, stdout=log, stderr=log, start_new_session=True,
            env={"MLFLOW_ENV_ROOT": str(scratch / "environments")} | own,
        )  # fmt: skip
        try:
            address = f"http://127.0.0.1:{port}"
            _wait(server, address, scratch / "server.log")
            yield address
        finally:
            os.killpg(server.pid, 15)
            server.wait(60)


def _wait(server: subprocess.Popen[bytes], address: str, log: Path) -> None:
    ends = time.monotonic() + STARTED_S
    while time.monotonic() < ends:
        assert server.poll() is None, log.read_text()[-3000:]
        try:
            urllib.request.urlopen(f"{address}/ping", timeout=5).close()
        except (URLError, OSError):
            time.sleep(1.0)
        else:
            return
    raise AssertionError(log.read_text()[-3000:])


def champion_of(machine: str) -> Any:
    bundle = read_json(BUILT / "data/champion" / machine / BUNDLE, Bundle).sha256
    return next(one for one in versions(machine, BUILT) if one.bundle == bundle)


def asked(address: str, name: str, table: pd.DataFrame, *, anyway: bool = True) -> pd.DataFrame:
    """Answer of a sub-model over HTTP, also of one that did not pass."""
    for column in table.select_dtypes("datetimetz"):
        table[column] = table[column].dt.tz_convert(None)
        table[column] = table[column].map(pd.Timestamp.isoformat)
    # every digit: a standstill that is none in the last one has another interval
    data = table.astype(object).where(table.notna(), None).to_numpy().tolist()
    body = {"params": {"submodel": name, "anyway": anyway},
            "dataframe_split": {"columns": list(table), "data": data}}  # fmt: skip
    request = urllib.request.Request(
        f"{address}/invocations", json.dumps(body).encode(), {"Content-Type": "application/json"}
    )
    with urllib.request.urlopen(request, timeout=300) as answer:
        return pd.DataFrame(json.load(answer)["predictions"])


@pytest.mark.proof
@pytest.mark.skipif(
    shutil.which("pyenv") is None or not (BUILT / DATABASE).exists(),
    reason="needs pyenv, and a project that is built (`make repro`; KERF_BUILT names another)",
)
@pytest.mark.parametrize("machine", CHAMPIONS)
def test_a_bundle_serves_in_an_environment_of_its_own_requirements(machine: str, tmp_path: Path):
    folder = BUILT / "data/champion" / machine
    names = read_json(folder / BUNDLE, Bundle).submodels
    described = (place_of(champion_of(machine), BUILT) / "MLmodel").read_text()
    refuses = '"anyway"' in described  # versions of before answer for all
    with served(machine, tmp_path) as address:
        for name, one in names.items():
            table = submodel(name).example(folder / name)
            expected = submodel(name).answer(folder / name)(table)
            answer = asked(address, name, table.copy())
            if refuses and one.status != "passed":
                with pytest.raises(HTTPError):
                    asked(address, name, table.copy(), anyway=False)
            assert list(answer) == list(expected), name
            numbers = expected.select_dtypes("number").columns
            assert len(numbers), name
            np.testing.assert_allclose(
                answer[numbers].astype(float), expected[numbers].astype(float),
                rtol=AGREEMENT, atol=AGREEMENT, err_msg=name,
            )  # fmt: skip
