"""Identified drives are read back as they were written, and another form is refused."""

import json
from dataclasses import asdict

import pytest

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.schema.store import StoreError
from pipeline.twin.drive import read_drives

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


FIT = {"samples": 1, "relative_error_percent": 2.0, "bandwidth_Hz": 40.0, "delay_s": 2e-4,
       "condition": 3.0, "rank": 1, "correlation": {"names": [], "values": []}}  # fmt: skip


def document(**changes) -> str:
    axis = {"command_unit": "V", "force_unit": "N", "servo": asdict(SERVO),
            "feed_drive": asdict(SCREW), "fit": FIT}  # fmt: skip
    return json.dumps({
        "submodel": "drive", "machine": "m", "origin": "recorded", "parameters": {},
        "trained_on": [], "axes": {"X": axis | changes},
    })  # fmt: skip


def read(tmp_path, text):
    path = tmp_path / "model.json"
    path.write_text(text)
    return read_drives(path)


def test_what_was_written_is_read(tmp_path):
    [(letter, found)] = read(tmp_path, document()).items()
    assert letter == "X"
    assert (found.servo, found.feed_drive) == (SERVO, SCREW)
    assert (found.command_unit, found.force_unit) == ("V", "N")
    assert (found.bandwidth_Hz, found.delay) == (40.0, 2e-4)


@pytest.mark.parametrize("limit", [{}, {"current_limit": None}])
def test_a_limit_that_is_left_out_is_infinite(tmp_path, limit):
    servo = {k: v for k, v in asdict(SERVO).items() if k != "current_limit"}
    found = read(tmp_path, document(servo=servo | limit))["X"].servo
    assert found is not None and found.current_limit == float("inf")


def test_without_servo_its_reason_is_kept(tmp_path):
    fit = FIT | {"bandwidth_Hz": None, "delay_s": None}
    changed = document(servo=None, servo_reason="no reference", fit=fit)
    found = read(tmp_path, changed)["X"]
    assert found.servo is None
    assert found.servo_reason == "no reference"
    assert found.bandwidth_Hz is None and found.delay == 0


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"axes": 3}', '{"axes": {"X": {}}}', '{"axes": {"X": null}}',
     document(feed_drive={"mass": 1}), document(feed_drive=asdict(SCREW) | {"weight": 1}),
     document(feed_drive=asdict(SCREW) | {"mass": -1}),
     document(fit=FIT | {"delay_s": "soon"}), "\x00", "{\"axes\": "],
    ids=range(12),
)  # fmt: skip
def test_another_form_is_one_sentence(tmp_path, text):
    with pytest.raises(StoreError, match=r"model\.json holds no identified drives: .+ `dvc repro`"):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"holds no identified drives: .* does not exist"):
        read_drives(tmp_path / "none.json")
