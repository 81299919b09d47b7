"""The first fleet: mill01's machine with chosen records, some to learn from, others to judge by."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.fleet import Fleet
from pipeline.parameters import structure
from pipeline.schema.golden import read_golden
from pipeline.shop.growth.records import KINDS
from pipeline.shop.parameters import ShopParameters
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Roles

ROOT = Path(__file__).parents[2]
MILL, SIBLING = "mill00", "mill01"
RECORDED = {"machine", "seed", "weeks", "log", "drives", "cutting", "growth", "wear",
            "trial_cuts", "trial_drives"}  # fmt: skip
"""What the mill's own file chooses; all else is its sibling's."""


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    both = ("fleet=demo", f"fleet.machines=[{MILL},{SIBLING}]")
    read: dict[str, Any] = yaml.load(composed(ROOT / "conf", both), Loader=yaml.CSafeLoader)
    return read


def test_the_fleet_is_one_mill_with_every_sub_model_at_the_quick_budget(values):
    written = yaml.safe_load((ROOT / "conf/fleet/demo.yaml").read_text())
    fleet = structure({"fleet": written}, "fleet", Fleet)
    simulated = yaml.safe_load((ROOT / "conf/fleet/simulated.yaml").read_text())
    assert set(fleet.submodels_of(MILL)) == set(simulated["submodels"])
    assert fleet.machines == fleet.simulated == fleet.optimised == fleet.trials == (MILL,)
    assert values["budget"] == "quick"


def test_the_mill_is_its_sibling_but_for_what_is_recorded(values):
    own, other = (values["machine"][name]["shop"] for name in (MILL, SIBLING))
    assert {key for key in own.keys() | other.keys() if own.get(key) != other.get(key)} <= RECORDED
    own_drives, other_drives = (
        structure(values, f"machine.{name}.shop", ShopParameters).drives for name in (MILL, SIBLING)
    )
    assert own_drives.axes == other_drives.axes and own_drives.shaft == other_drives.shaft


def test_nothing_of_the_golden_set_is_learnt_from(values):
    roles = structure(values, f"machine.{MILL}.roles", Roles)
    golden = read_golden(ROOT / f"data/golden/{MILL}.json").golden
    assert golden is not None and golden.days is not None and roles.training_days is not None
    assert roles.training_days.last < golden.days.first
    assert not [one.file for one in golden.files if roles.is_training(one.file)]


def test_growth_is_learnt_from_each_kind_of_record_and_judged_on_others(values):
    roles = structure(values, f"machine.{MILL}.roles", Roles)
    numbers = structure(values, f"machine.{MILL}.shop", ShopParameters).growth.numbers
    learnt = [n for n in numbers if roles.is_training(f"growth/profile-{n:02d}-x.csv")]
    assert {KINDS[n - 1] for n in learnt} == set(KINDS)
    assert len(numbers) - len(learnt) >= 3


def test_four_tools_are_learnt_from_and_others_are_judged(values):
    """Folds of two leave two tools to learn from and to stop by."""
    roles = structure(values, f"machine.{MILL}.roles", Roles)
    lives = structure(values, f"machine.{MILL}.shop", ShopParameters).wear.lives
    learnt = [one.tool for one in lives if roles.is_training(f"wear/{one.tool}_001.parquet")]
    assert len(learnt) == 4 and len(lives) - len(learnt) == 3
    assert set(values["machine"][MILL]["wear_life"]["in_use"]) <= {one.tool for one in lives}
