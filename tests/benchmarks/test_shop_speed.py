"""Seconds that the simulated shop floor takes for its records and trial cuts.

Time of the processor counts, not that of the clock: what else runs does not.
"""

from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest

from pipeline.shop.cutting.records import write_cutting
from pipeline.shop.drives.records import write_drives
from pipeline.shop.growth.records import write_growth
from pipeline.shop.trial.trials import prepare, trial
from pipeline.shop.wear.records import write_wear
from tests.shop.conftest import run, shop_parameters
from tests.shop.test_trial import JOB, MACHINE, SLOT

MACHINES = ["mill01", "mill02"]
Write = Callable[[Path, str], object]


def week(folder: Path, machine: str) -> object:
    """One week without what comes once for all weeks: servo tool, cutting tests, growth, lives."""
    once = {name: {"recorded": False} for name in ("drives", "cutting", "growth", "wear")}
    return run(folder, machine, weeks=1, **once)


def drives(folder: Path, machine: str) -> object:
    return write_drives(folder, shop_parameters(machine))


def cutting(folder: Path, machine: str) -> object:
    return write_cutting(folder, shop_parameters(machine))


def growth(folder: Path, machine: str) -> object:
    return write_growth(folder, shop_parameters(machine))


def wear(folder: Path, machine: str) -> object:
    return write_wear(folder, shop_parameters(machine))


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize(
    ("write", "limit"),
    [(week, 20 / 3), (drives, 6.0), (cutting, 5.0), (growth, 8.0), (wear, 20.0)],
    ids=["a third of three weeks", "servo records", "dynamometer records", "growth records",
         "tool lives"],
)  # fmt: skip
def test_records_of_a_machine(
    write: Write, limit: float, machine: str, tmp_path: Path, benchmark
) -> None:
    """Three weeks of one machine in 20 s; the other records have limits of their own."""
    folders = (tmp_path / str(turn) for turn in range(3))
    benchmark.pedantic(lambda: write(next(folders), machine), rounds=2, warmup_rounds=1)
    assert benchmark.stats["min"] < limit


@pytest.mark.benchmark(timer=process_time)
def test_trial_cut(benchmark) -> None:
    """Half a second for 30 s of cutting; the slot's 6.6 s take their share."""
    its = prepare(SLOT, "P", JOB, MACHINE)
    benchmark.pedantic(lambda: trial(its, JOB, MACHINE, 1), rounds=3, warmup_rounds=1)
    assert benchmark.stats["min"] < 0.5 * 6.6 / 30
