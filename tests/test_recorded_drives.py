"""Two real machines: a positioning system of a benchmark, and a mill at ten samples a second.

EMPS: A. Janot, M. Gautier, M. Brunot, nonlinearbenchmark.org, 2019.  The mill: University of
Michigan SMART lab.
"""

import os
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import yaml

from pipeline.app.fleet import collect, use_fleet
from pipeline.schema.drive import DriveModel
from pipeline.schema.store import read_json
from pipeline.stages.__main__ import run
from tests.small_project import ROOT, change, inside, leave, with_conf

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = [
    pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"),
    pytest.mark.slow,
]
MACHINES = ("emps", "umich_mill")


@pytest.fixture(scope="module")
def documents(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded-drives")
    with_conf(folder, "recorded")
    leave(folder, "recorded", *MACHINES)
    with inside(folder):
        fleet = replace(use_fleet("recorded"), machines=MACHINES, submodels={}, optimised=())
        assert [files for _, _, files in collect(fleet, Path(RECORDINGS or ""))] >= [1, 1]
        run("compose", "conf", "params.yaml", "data/settings")
        change(folder, "drive_fit", compare=False, folds=2)  # no test asks for the intervals' folds
        found = {}
        for machine in MACHINES:
            signals, model = f"data/signals/{machine}", f"data/models/{machine}/drive"
            run(f"ingest@{machine}", f"data/raw/{machine}", signals)
            run(f"identify_drive@{machine}", signals, model, "data/golden")
            found[machine] = read_json(Path(model) / "model.json", DriveModel)
    return found


def interval(parameter):
    assert parameter.determined, parameter.method
    low, high = parameter.interval_95
    return low, parameter.value, high


def test_the_positioning_systems_mass_is_that_of_the_benchmark(documents):
    low, value, high = interval(documents["emps"].parameters["X"]["mass"])
    # published: 95.1 kg; a control of the result, nothing was fitted to it
    assert low < 95.1 < high and high - low < 0.05 * value


def test_its_friction_and_offset_have_intervals(documents):
    parameters = documents["emps"].parameters["X"]
    low, _, high = interval(parameters["coulomb_positive"])
    assert low < 20.4 < high  # published, one for both directions
    ways = [interval(parameters[f"viscous_{way}"]) for way in ("positive", "negative")]
    # published is 203 N s/m for both; the two directions differ by more than their intervals
    assert ways[0][2] < 203 < ways[1][0]
    assert (ways[0][1] + ways[1][1]) / 2 == pytest.approx(203, rel=0.05)
    low, _, high = interval(parameters["offset"])
    assert -3.2 < low < high < 3.2


def test_its_slow_speeds_are_missing_and_that_is_said(documents):
    parameters = documents["emps"].parameters["X"]
    for name in ("static_positive", "stribeck_velocity_negative"):
        assert not parameters[name].determined
        assert "0.1 to 1 mm/s" in parameters[name].remedy
    friction = documents["emps"].axes["X"].feed_drive.friction.positive
    assert friction.static == friction.coulomb


def test_its_force_is_rebuilt(documents):
    fit = documents["emps"].axes["X"].fit
    assert fit.relative_error_percent < 4.2
    assert fit.rank == len(fit.correlation.names) and fit.condition < 30


def test_the_mills_coulomb_friction_is_in_ampere(documents):
    assert documents["umich_mill"].axes["X"].force_unit == "A"
    for way in ("positive", "negative"):
        coulomb = documents["umich_mill"].parameters["X"][f"coulomb_{way}"]
        low, value, high = interval(coulomb)
        assert coulomb.unit == "A"
        assert 3.5 < low < value < high < 5.0 and high - low < 0.25 * value


def test_ten_samples_a_second_tell_no_mass_and_no_following_error(documents):
    for axis in ("X", "Y"):
        found = documents["umich_mill"].axes[axis]
        assert not documents["umich_mill"].parameters[axis]["mass"].determined
        assert found.recursive_mass is None
        assert found.servo is None and found.servo_reason


def test_the_mills_third_axis_has_no_current_and_that_is_said(documents):
    found = documents["umich_mill"]
    assert set(found.axes) == {"X", "Y"}
    reasons = [row.reason for row in found.left_out]
    assert any("axis Z" in why and "'z_current' is 0 throughout" in why for why in reasons)


def test_experiments_that_are_not_named_are_judged():
    roles = yaml.safe_load((ROOT / "conf/machine/umich_mill.yaml").read_text())["roles"]
    trained = [
        number
        for number in range(1, 30)
        if any(fnmatchcase(f"experiment_{number:02d}.csv", p) for p in roles["training"])
    ]
    assert trained == [1, 3, 6, 9, 11, 15, 18]
