"""Identified drives are read back as they were written, and another form is refused."""

import json
from dataclasses import asdict

import pytest

from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.machine.axis.friction import DirectionFriction, FrictionParameters
from pipeline.machine.axis.servo import ServoParameters
from pipeline.twin.drive_file import drives_of, read_drives

SERVO = ServoParameters(
    position_gain=40.0, velocity_gain=500.0, integral_gain=9e3, position_scale=0.82,
    velocity_lag=1e-3, current_limit=30.0,
)  # fmt: skip
SCREW = FeedDriveParameters(
    mass=95.0, force_constant=35.0, offset=-3.0,
    friction=FrictionParameters(
        positive=DirectionFriction(coulomb=20.0, static=25.0, viscous=200.0),
        negative=DirectionFriction(coulomb=22.0, static=22.0, stribeck_velocity=0.01),
    ),
)  # fmt: skip


def document(**changes):
    axis = {
        "command_unit": "V",
        "force_unit": "N",
        "drive": {"servo": asdict(SERVO), "feed_drive": asdict(SCREW), "servo_reason": ""},
        "fit": {"bandwidth_Hz": 40.0, "delay_s": 2e-4},
    }
    return {"axes": {"X": axis | changes}}


def test_what_was_written_is_read(tmp_path):
    path = tmp_path / "drive.json"
    path.write_text(json.dumps(document()))
    [(letter, found)] = read_drives(path).items()
    assert letter == "X"
    assert (found.servo, found.feed_drive) == (SERVO, SCREW)
    assert (found.command_unit, found.force_unit) == ("V", "N")
    assert (found.bandwidth_Hz, found.delay) == (40.0, 2e-4)


def test_a_limit_that_is_left_out_is_infinite():
    servo = asdict(SERVO)
    del servo["current_limit"]
    drive = {"servo": servo, "feed_drive": asdict(SCREW)}
    found = drives_of(document(drive=drive))["X"].servo
    assert found is not None and found.current_limit == float("inf")


def test_without_servo_its_reason_is_kept():
    drive = {"servo": None, "servo_reason": "no reference", "feed_drive": asdict(SCREW)}
    found = drives_of(document(drive=drive, fit={"bandwidth_Hz": None}))["X"]
    assert found.servo is None
    assert found.servo_reason == "no reference"
    assert found.bandwidth_Hz is None and found.delay == 0


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"axes": 3}', '{"axes": {"X": {}}}', '{"axes": {"X": null}}',
     json.dumps(document(drive={"servo": None, "feed_drive": {"mass": 1}})),
     json.dumps(document(drive={"servo": None, "feed_drive": asdict(SCREW) | {"weight": 1}})),
     json.dumps(document(drive={"servo": None, "feed_drive": asdict(SCREW) | {"mass": -1}})),
     json.dumps(document(fit={"bandwidth_Hz": 4, "delay_s": "soon"})), "\x00", "{\"axes\": "],
    ids=range(12),
)  # fmt: skip
def test_another_form_is_one_sentence(tmp_path, text):
    path = tmp_path / "drive.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"drive\.json holds no identified drives .* `dvc repro`"):
        read_drives(path)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(ValueError, match="holds no identified drives"):
        read_drives(tmp_path / "none.json")
