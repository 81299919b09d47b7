"""drive.json: what was found of all drives, as numbers that load again."""

import json
from dataclasses import replace

import cattrs
import numpy as np
import pytest

from pipeline.identification.drive.document import drive_document
from pipeline.identification.drive.identify import identify_drives
from pipeline.identification.drive.records import (
    AxisChannels,
    DriveFitSettings,
    DriveKnown,
    DriveRecords,
    Recording,
)
from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.search.genetic import GeneticSettings
from pipeline.signals.ingest import MachineIdentity
from tests.identification.drive.simulated_axis import SimulatedAxis
from tests.identification.drive.simulated_records import SPEEDS, recording

AXIS = SimulatedAxis()
FAST = SPEEDS[SPEEDS > 0.02]
IDENTITY = MachineIdentity(name="mill", origin="simulated")
RECORDS = DriveRecords(
    recordings="*.csv", training=("*",),
    axes={letter: AxisChannels(command=f"{letter}_cur", position=f"{letter}_act")
          for letter in "XZ"},
)  # fmt: skip
SETTINGS = DriveFitSettings(genetic=GeneticSettings(population=20, generations=10))


def found_on(recordings):
    found = identify_drives(recordings, RECORDS, DriveKnown(), SETTINGS)
    return drive_document(IDENTITY, found)


@pytest.fixture(scope="module")
def document():
    one = replace(recording(AXIS, 0, speeds=FAST), lacking={"Z": "'z_cur' is 0 throughout"})
    empty = Recording(name="broken.csv", trained=True, lacking={"X": "it has no time", "Z": "no"})
    return found_on([one, empty])


def test_it_is_json_without_numbers_that_json_has_not(document):
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert (document["model"], document["machine"], document["origin"]) == (
        "drive", "mill", "simulated"
    )  # fmt: skip


def test_parameters_are_told_or_open_with_a_remedy(document):
    parameters = document["axes"]["X"]["parameters"]
    mass = parameters["mass"]
    assert mass["determined"] and mass["low"] <= mass["value"] <= mass["high"]
    assert (mass["unit"], mass["remedy"]) == ("kg", None)
    static = parameters["static_positive"]
    assert not static["determined"] and static["value"] is static["low"] is None
    assert static["remedy"].startswith("record strokes")
    assert {"position_scale", "velocity_scale"} <= set(parameters)


def test_the_drive_loads_again(document):
    stored = document["axes"]["X"]["drive"]["feed_drive"]
    drive = cattrs.Converter(forbid_extra_keys=True).structure(stored, FeedDriveParameters)
    assert drive.mass == pytest.approx(AXIS.mass, rel=0.02)


def test_points_and_curve_agree_and_are_in_the_reports_units(document):
    axis = document["axes"]["X"]
    curve = {row["velocity_mm_s"]: row["force"] for row in axis["friction_curve"]}
    speeds = np.array(sorted(curve))
    assert len(axis["friction_points"]) == 10 and speeds.max() == pytest.approx(400, rel=0.01)
    for point in axis["friction_points"]:
        model = np.interp(point["velocity_mm_s"], speeds, [curve[v] for v in speeds])
        assert point["force"] == pytest.approx(model, abs=point["half_width"] + 6)


def test_the_fit_and_its_methods_are_told(document):
    axis = document["axes"]["X"]
    names = axis["fit"]["correlation"]["names"]
    values = np.array(axis["fit"]["correlation"]["values"])
    assert values.shape == (len(names), len(names)) and np.diag(values) == pytest.approx(1.0)
    assert axis["fit"]["rank"] == len(names) and axis["fit"]["samples"] > 100
    tasks = {(row["task"], row["method"]) for row in axis["methods"]}
    assert {("inverse_dynamics", "genetic"), ("friction", "least_squares")} <= tasks


def test_the_mass_over_time_comes_to_that_of_the_fit(document):
    axis = document["axes"]["X"]
    trace = axis["recursive"]
    assert trace["recording"] == "reciprocation.csv" and len(trace["value"]) <= 200
    assert len(trace["value"]) == len(trace["time_s"]) == len(trace["half_width"])
    late = np.array(trace["value"])[len(trace["value"]) // 2 :]
    # its memory is a hundred updates, in which rumble of 2 N and cogs of 4 N stand
    assert np.median(late) == pytest.approx(axis["parameters"]["mass"]["value"], rel=0.03)


def test_what_was_left_out_is_said(document):
    rows = document["recordings"]
    assert [row["recording"] for row in rows["training"]] == ["reciprocation.csv"]
    left = {row["recording"]: row["reason"] for row in rows["left_out"]}
    assert "it has no time" in left["broken.csv"]
    assert "axis Z" in left["all of them"] and "0 throughout" in left["all of them"]
    assert document["found_from"] == {"reciprocation.csv": "0" * 64}
    assert document["motor"] is None


def test_a_servo_with_other_gains_is_left_out_and_that_is_said():
    found = identify_drives(
        [recording(AXIS, 0, speeds=FAST)], RECORDS, DriveKnown(), replace(SETTINGS, compare=False)
    )
    servo = replace(found.servos["X"], left_out=("other.csv",))
    told = drive_document(IDENTITY, replace(found, servos={"X": servo}))
    rows = [row for row in told["recordings"]["left_out"] if row["recording"] == "other.csv"]
    assert ["servo of axis X: taken with other gains" in row["reason"] for row in rows] == [True]


def test_recordings_that_tell_nothing_are_an_error_with_the_reasons():
    empty = Recording(name="a.csv", trained=True, lacking={"X": "no current", "Z": "no motion"})
    with pytest.raises(ValueError, match="X: no current; Z: no motion"):
        found_on([empty])
