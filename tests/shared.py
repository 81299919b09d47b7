"""What takes long to make and is only read: made once in a run, whichever process asks first."""

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Folder ``name`` that ``make`` filled, the same for all workers of a run.

    Parameters
    ----------
    factory : pytest.TempPathFactory
        Of the session; the workers' folders stand in one folder.
    name : str
        Of the folder, one in the run.
    make : callable
        Fills an empty folder; where it raises, the next that asks begins anew.
    """
    base = factory.getbasetemp()
    root = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = root / f"made-{name}"
    with (root / f"made-{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / DONE).exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            (folder / DONE).touch()
    return folder


DONE = ".done"
