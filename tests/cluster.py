"""A scheduler and workers of a cluster as processes of their own, as a shop starts them."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from pipeline.parallel import PLACE, _client

ROOT = Path(__file__).parents[1]


@contextmanager
def cluster(folder: Path, workers: int = 2, *, bare: bool = False) -> Iterator[str]:
    """The address of a scheduler whose workers run in ``folder``; tasks for processes go there.

    ``bare``: one worker by Dask's own command, without the variables of ``kerf worker``.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1",
                 "--port", str(port), "--no-dashboard"]  # fmt: skip
    worker = [sys.executable, "-m", "pipeline.app", "worker", address, "--workers", str(workers)]
    if bare:
        workers = 1
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard"]
    with (folder / "scheduler.log").open("w") as log, (folder / "worker.log").open("w") as own:
        started = [
            subprocess.Popen(scheduler, cwd=folder, env=around, stdout=log, stderr=log),
            subprocess.Popen(worker, cwd=folder, env=around, stdout=own, stderr=own),
        ]
    try:
        with mock.patch.dict(os.environ, {PLACE: address}):
            _client(address).wait_for_workers(workers)
            yield address
    finally:
        _client(address).close()
        _client.cache_clear()
        for one in reversed(started):
            one.terminate()
            one.wait(30)
