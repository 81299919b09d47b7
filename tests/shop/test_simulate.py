"""The same bytes each time, other bytes for another seed, and its parameters are checked."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.shop.parameters import (
    LoggerParameters,
    ShiftParameters,
    ShopParameters,
    SpindleParameters,
)
from pipeline.shop.simulate import simulate

from .conftest import Simulated, run, shop_parameters


def _digests(folder: Path) -> dict[str, str]:
    return {
        str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest()
        for f in sorted(folder.rglob("*"))
        if f.is_file()
    }


def test_the_same_bytes_every_time(week: Simulated, tmp_path: Path) -> None:
    again = run(tmp_path, week.parameters.machine, weeks=1)
    assert _digests(again.folder) == _digests(week.folder)
    assert again.truth == week.truth


def test_another_seed_is_another_week(week: Simulated, tmp_path: Path) -> None:
    other = run(tmp_path, week.parameters.machine, weeks=1, seed=3)
    ours, theirs = _digests(week.folder), _digests(other.folder)
    assert ours.keys() == theirs.keys()
    same = {name for name in ours if ours[name] == theirs[name]}
    # an adapter has the same to say of every weekend
    assert same <= {"Devices.xml", "agent/2026-01-10.txt", "agent/2026-01-11.txt"}


def test_truth_does_not_stand_among_the_records(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must not stand among the records"):
        simulate(tmp_path, tmp_path / "truth.json", shop_parameters("mill01"))


def test_the_truth_carries_the_parameters_and_the_label(week: Simulated) -> None:
    assert week.truth["simulated"] is True
    assert week.truth["machine"] == week.parameters.machine
    told = week.truth["parameters"]["spindle"]["motor"]["copper_loss"]
    assert told == week.parameters.spindle.motor.copper_loss


def test_the_siblings_are_two_machines() -> None:
    first, second = shop_parameters("mill01"), shop_parameters("mill02")
    assert first.c_axis and not second.c_axis
    assert (first.log.kind, second.log.kind) == ("agent", "adapter")
    assert first.spindle != second.spindle


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: ShopParameters(machine="m", weeks=0),
            "ShopParameters.weeks = 0 must lie from 1 to 104",
        ),
        (lambda: ShopParameters(machine="m", first_day="2026-01-06"), "must be a Monday"),
        (lambda: ShopParameters(machine="m", programs=()), "at least one part program"),
        (
            lambda: LoggerParameters(interval=0),
            "LoggerParameters.interval = 0 s must lie from 1 to 3600",
        ),
        (lambda: ShiftParameters(start_earliest=8.0), "start_latest"),
        (lambda: SpindleParameters(viscosity_100=30.0), "oil gets thinner"),
    ],
)
def test_values_out_of_range_are_named(make, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match=words):
        make()


def test_unknown_programs_are_named(tmp_path: Path) -> None:
    p = shop_parameters("mill01", programs=["O7777"], weeks=1)
    with pytest.raises(ValueError, match="O7777"):
        simulate(tmp_path / "raw", tmp_path / "truth.json", p)


def test_only_c_axis_programs_and_no_c_axis_is_an_error(tmp_path: Path) -> None:
    p = shop_parameters("mill02", programs=["O4410"], weeks=1)
    with pytest.raises(ValueError, match="without a C axis"):
        simulate(tmp_path / "raw", tmp_path / "truth.json", p)


def test_the_room_starts_without_numba() -> None:
    code = "import sys, pipeline.shop.parameters; print('numba' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"
