"""Work in other processes gives what it gives here, bit for bit, and fails with the same words."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pipeline.gcode.errors import GcodeError
from pipeline.parallel import Compute, mapped, workers_for

PLACES: list[Compute] = ["serial", "threads", "processes"]


def spectrum(size: int, seed: int) -> np.ndarray:
    """Eigenvalues of a random matrix: linear algebra whose last bits depend on its threads."""
    matrix = np.random.default_rng(seed).normal(size=(size, size))
    return np.linalg.eigvalsh(matrix + matrix.T)


def refuse(task: int) -> int:
    if task >= 2:
        raise GcodeError(file="O1.nc", line=task, column=3, word="X", reason="give a number")
    return task


def absent(task: int) -> bytes:
    return Path(f"no-such-file-{task}").read_bytes()


def process_of(task: int) -> int:
    return os.getpid()


def test_processes_give_the_bits_of_serial_in_the_order_of_the_tasks() -> None:
    work = partial(spectrum, 120)
    serial = mapped(work, range(5), compute="serial")
    for compute in ("threads", "processes"):
        found = mapped(work, range(5), compute=compute, workers=2)
        assert [a.tobytes() for a in found] == [a.tobytes() for a in serial]


def test_processes_are_others_and_one_task_needs_none() -> None:
    assert os.getpid() not in mapped(process_of, range(2), compute="processes", workers=2)
    assert mapped(process_of, [0], compute="processes", workers=2) == [os.getpid()]
    assert (workers_for(5, 3), workers_for(2, 3), workers_for(0)) == (3, 2, 1)
    assert mapped(process_of, [], compute="processes") == []


@pytest.mark.parametrize("compute", PLACES)
def test_the_first_error_keeps_type_sentence_and_fields(compute: Compute) -> None:
    with pytest.raises(GcodeError, match=r"^O1\.nc:2:3: X: give a number$") as caught:
        mapped(refuse, range(5), compute=compute, workers=2)
    assert caught.value.line == 2
    with pytest.raises(FileNotFoundError, match=r"No such file.*'no-such-file-7'"):
        mapped(absent, [7, 8], compute=compute, workers=2)


def test_a_place_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match=r"compute = 'clusters': give serial"):
        mapped(abs, [1, 2], compute="clusters")  # type: ignore[arg-type]
