"""The drives' model file: parameters, curves and provenance of all axes, read as written."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.schema.drive import DriveModel
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import json_text, parsed
from pipeline.search.genetic import GeneticSettings
from pipeline.submodels.cases import Cases, Roles
from pipeline.submodels.drive.model import identify_drives, left_out
from pipeline.submodels.drive.records import (
    AxisChannels,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
    Recording,
)
from pipeline.submodels.drive.submodel import SUBMODEL, Fitting, drive_case
from tests.submodels.drive.simulated_axis import SPEEDS, SimulatedAxis, recording

AXIS = SimulatedAxis()
FAST = SPEEDS[SPEEDS > 0.02]
RECORDS = DriveRecords(
    recordings="*.csv",
    axes={letter: AxisChannels(command=f"{letter}_cur", position=f"{letter}_act")
          for letter in "XZ"},
)  # fmt: skip
SETTINGS = DriveFitSettings(genetic=GeneticSettings(population=20, generations=10))


def fitted(recordings, folder) -> DriveModel:
    settings = Fitting(
        identity=MachineIdentity(name="mill", origin="simulated"), roles=Roles(),
        drive=DrivePrior(), drive_records=RECORDS, drive_fit=SETTINGS,
    )  # fmt: skip
    cases = Cases(cases=tuple(drive_case(one, "training") for one in recordings))
    return SUBMODEL.fit(cases, settings, folder)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    one = replace(recording(AXIS, 0, speeds=FAST), lacking={"Z": "'z_cur' is 0 throughout"})
    empty = Recording(name="broken.csv", trained=True, lacking={"X": "it has no time", "Z": "no"})
    return fitted([one, empty], tmp_path_factory.mktemp("drive"))


def test_it_is_read_as_it_was_written(model):
    assert parsed(json_text(model).encode(), DriveModel, "model.json") == model
    assert (model.submodel, model.machine, model.origin) == ("drive", "mill", "simulated")


def test_parameters_are_determined_or_open_with_a_remedy(model):
    parameters = model.parameters["X"]
    mass = parameters["mass"]
    low, high = mass.interval_95
    assert mass.determined and low <= mass.value <= high
    assert (mass.unit, mass.remedy) == ("kg", "")
    static = parameters["static_positive"]
    assert not static.determined and static.value is static.interval_95 is None
    assert static.remedy.startswith("record strokes")
    assert {"position_scale", "velocity_scale"} <= set(parameters)


def test_points_and_curve_agree_and_are_in_the_reports_units(model):
    axis = model.axes["X"]
    curve = {row.velocity_mm_s: row.force for row in axis.friction_curve}
    speeds = np.array(sorted(curve))
    assert len(axis.friction_points) == 10 and speeds.max() == pytest.approx(400, rel=0.01)
    for point in axis.friction_points:
        force = np.interp(point.velocity_mm_s, speeds, [curve[v] for v in speeds])
        assert point.force == pytest.approx(force, abs=point.half_width + 6)


def test_the_fit_and_its_methods_are_stored(model):
    axis = model.axes["X"]
    names, values = axis.fit.correlation.names, np.array(axis.fit.correlation.values)
    assert values.shape == (len(names), len(names)) and np.diag(values) == pytest.approx(1.0)
    assert axis.fit.rank == len(names) and axis.fit.samples > 100
    tasks = {(row.task, row.method) for row in axis.methods}
    assert {("inverse_dynamics", "genetic"), ("friction", "least_squares")} <= tasks


def test_the_mass_over_time_comes_to_that_of_the_fit(model):
    trace = model.axes["X"].recursive_mass
    assert trace.recording == "reciprocation.csv" and len(trace.value) <= 200
    assert len(trace.value) == len(trace.time_s) == len(trace.half_width)
    late = np.array(trace.value)[len(trace.value) // 2 :]
    # its memory is a hundred updates, in which rumble of 2 N and cogs of 4 N stand
    assert np.median(late) == pytest.approx(model.parameters["X"]["mass"].value, rel=0.03)


def test_what_was_left_out_is_said(model):
    assert [row.recording for row in model.recordings] == ["reciprocation.csv"]
    left = {row.case: row.reason for row in model.left_out}
    assert "it has no time" in left["broken.csv"]
    assert "axis Z" in left["all of them"] and "0 throughout" in left["all of them"]
    assert model.training_files == {"0" * 64: "reciprocation.csv"}
    assert model.motor is None
    speed = model.conditions["highest speed X"]
    # the twin's strokes go up to 400 mm/s; slower ones are no other condition
    assert speed.unit == "mm/s" and speed.low == 0 and speed.high == pytest.approx(400, rel=0.02)


def test_a_servo_with_other_gains_is_left_out_and_that_is_said():
    recordings = [recording(AXIS, 0, speeds=FAST)]
    found = identify_drives(recordings, RECORDS, DrivePrior(), replace(SETTINGS, compare=False))
    axis = found.axes["X"]
    axis = replace(axis, servo=replace(axis.servo, left_out=("other.csv",)))
    rows = left_out(replace(found, axes={"X": axis}), recordings)
    said = [row.reason for row in rows if row.case == "other.csv"]
    assert len(said) == 1 and "servo of axis X: taken with other gains" in said[0]


def test_recordings_of_no_use_are_an_error_with_the_reasons(tmp_path):
    empty = Recording(name="a.csv", trained=True, lacking={"X": "no current", "Z": "no motion"})
    with pytest.raises(ValueError, match="X: no current; Z: no motion"):
        fitted([empty], tmp_path)
