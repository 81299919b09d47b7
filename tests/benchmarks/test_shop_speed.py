"""Seconds that the simulated shop floor takes for its records and trial cuts.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest

from pipeline.shop.cutting.records import write_cutting
from pipeline.shop.drives.records import write_drives
from pipeline.shop.trial.trials import prepare, trial
from tests.shop.conftest import run, shop_parameters
from tests.shop.test_trial import JOB, MACHINE, SLOT

MACHINES = ["mill01", "mill02"]
Write = Callable[[Path, str], object]


def week(folder: Path, machine: str) -> object:
    """One week without the servo tool and the cutting tests, which come once for all weeks."""
    once = {"drives": {"recorded": False}, "cutting": {"recorded": False}}
    return run(folder, machine, weeks=1, **once)


def drives(folder: Path, machine: str) -> object:
    return write_drives(folder, shop_parameters(machine))


def cutting(folder: Path, machine: str) -> object:
    return write_cutting(folder, shop_parameters(machine))


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize(
    ("write", "limit"), [(week, 20 / 3), (drives, 6.0), (cutting, 5.0)],
    ids=["a third of three weeks", "servo records", "dynamometer records"],
)  # fmt: skip
def test_records_of_a_machine(
    write: Write, limit: float, machine: str, tmp_path: Path, benchmark
) -> None:
    """Three weeks of one machine in 20 s; servo and dynamometer have limits of their own."""
    folders = (tmp_path / str(turn) for turn in range(3))
    benchmark.pedantic(lambda: write(next(folders), machine), rounds=2, warmup_rounds=1)
    assert benchmark.stats["min"] < limit


@pytest.mark.benchmark(timer=process_time)
def test_trial_cut(benchmark) -> None:
    """Half a second for 30 s of cutting; the slot's 6.6 s take their share."""
    its = prepare(SLOT, "P", JOB, MACHINE)
    benchmark.pedantic(lambda: trial(its, JOB, MACHINE, 1), rounds=3, warmup_rounds=1)
    assert benchmark.stats["min"] < 0.5 * 6.6 / 30
