"""Recordings come in as Parquet with units, and go out as axes in SI or with a reason."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.parameters import ParametersError, structure
from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import SourceFile
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.drive.reading import read_recordings
from pipeline.submodels.drive.records import (
    AirRows,
    AxisChannels,
    AxisPrior,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
    MotorRecords,
)
from pipeline.submodels.drive.submodel import SUBMODEL, Fitting

N = 200
UNITS = {"t": "SECOND", "x_set": "MILLIMETER", "x_act": "MILLIMETER", "x_speed": "INCH/MINUTE",
         "x_cur": "AMPERE", "x_force": "NEWTON"}  # fmt: skip
CHANNELS = AxisChannels(
    command="x_cur", reference="x_set", position="x_act", velocity="x_speed", load="x_f*"
)


MOTOR = MotorRecords(
    recordings="motor*", axis="X", pole_pairs=4,
    channels={"u_d": "ud", "u_q": "uq", "i_d": "id", "i_q": "iq", "speed": "n"},
)  # fmt: skip


def columns(**changes):
    ramp = np.arange(N, dtype=float)
    found = {
        "t": 1e-3 * ramp, "x_set": 0.1 * ramp, "x_act": 0.1 * ramp - 0.05,
        "x_speed": 600 / 25.4 * 60 * 0.1 + 0 * ramp, "x_cur": np.sin(ramp), "x_force": 2 * ramp,
    }  # fmt: skip
    return {k: v for k, v in {**found, **changes}.items() if v is not None}


@pytest.fixture
def written(tmp_path):
    entries = {}

    def write(name, values, constants=None, units=UNITS, reason=None):
        fields, arrays = [], []
        for key, one in values.items():
            kind = pa.string() if isinstance(one[0], str) else pa.float64()
            fields.append(pa.field(key, kind, metadata={"unit": units.get(key, "")}))
            arrays.append(pa.array(one, kind))
        output = f"traces/{name}.parquet"
        (tmp_path / "traces").mkdir(exist_ok=True)
        if reason is None:
            pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)),
                           tmp_path / output)  # fmt: skip
        notes = {"constants": constants} if constants else {}
        entries[name] = {"output": None if reason else output, "reason": reason, "notes": notes,
                         "sha256": f"hash of {name}"}  # fmt: skip
        (tmp_path / "manifest.json").write_text(json.dumps({"files": entries}))
        return tmp_path

    return write


def read(folder: Path, known=None, **options):
    settings = {"recordings": "*.csv", "axes": {"X": CHANNELS}, **options}
    records = DriveRecords(**settings)
    return read_recordings(folder, records, known or DrivePrior(), lambda n: n.startswith("a"))


def test_channels_come_out_in_si(written):
    (one,) = read(written("a.csv", columns()))
    axis = one.axes["X"]
    assert (one.trained, one.samples, one.sha256) == (True, N, "hash of a.csv")
    assert one.period == pytest.approx(1e-3)
    assert axis.reference == pytest.approx(1e-4 * np.arange(N))
    assert axis.position == pytest.approx(axis.reference - 5e-5)
    assert axis.velocity == pytest.approx(np.full(N, 0.06))
    assert axis.load == pytest.approx(2.0 * np.arange(N))
    assert (axis.command_unit, axis.force_unit, axis.force_constant) == ("A", "A", 1.0)
    assert axis.acceleration is None


def test_numbers_may_be_named_after_constants_of_the_recording(written):
    written("a.csv", columns(), {"gtau": 35.0, "kp": 160.0})
    folder = written("b.csv", columns(), {"kp": 170.0})
    known = DrivePrior(axes={"X": AxisPrior(force_constant="gtau", position_gain="kp")})
    a, b = read(folder, known)
    assert (a.axes["X"].force_constant, a.axes["X"].constants.position_gain) == (35.0, 160.0)
    # what one file lacks, the others agree on; its own comes first
    assert (b.axes["X"].force_constant, b.axes["X"].constants.position_gain) == (35.0, 170.0)
    assert a.notes == () and "gtau taken from the other recordings" in b.notes[0]
    assert (a.axes["X"].force_unit, a.trained, b.trained) == ("N", True, False)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"torque_constant": 1.0}, "go together"),
        ({"force_constant": 2.0, "torque_constant": 1.0, "lead": 5.0}, "give one"),
    ],
)
def test_what_contradicts_itself_is_refused(given, words):
    with pytest.raises(ValueError, match=words):
        AxisPrior(**given)


def test_a_constant_that_no_recording_holds_is_named(written):
    folder = written("a.csv", columns(), {"kp": 1.0})
    known = DrivePrior(axes={"X": AxisPrior(force_constant="gtau")})
    with pytest.raises(ValueError, match=r"axes.X names the constant 'gtau', .* hold kp: correct"):
        read(folder, known)


@pytest.mark.parametrize("value", [0.0, float("nan")])
def test_a_number_out_of_its_range_is_refused_before_anything_is_read(value):
    with pytest.raises(ValueError, match=f"drive.force_constant = {value} must be finite and pos"):
        AxisPrior(force_constant=value)


def test_a_recording_with_an_impossible_constant_is_left_out_alone(written):
    written("a.csv", columns(), {"gtau": 35.0})
    folder = written("b.csv", columns(), {"gtau": -3.0})
    a, b = read(folder, DrivePrior(axes={"X": AxisPrior(force_constant="gtau")}))
    assert set(a.axes) == {"X"} and not b.axes
    assert "force_constant = -3.0 must be" in b.lacking["X"]


def test_a_constant_that_the_others_do_not_agree_on_is_not_lent(written):
    written("a.csv", columns(), {"gtau": 35.0})
    written("a2.csv", columns(), {"gtau": 70.0})
    folder = written("b.csv", columns(), {"kp": 1.0})
    a, a2, b = read(folder, DrivePrior(axes={"X": AxisPrior(force_constant="gtau")}))
    assert (a.axes["X"].force_constant, a2.axes["X"].force_constant) == (35.0, 70.0)
    assert not b.axes and "constant 'gtau', the recording holds kp" in b.lacking["X"]


@pytest.mark.parametrize(
    ("options", "known", "words"),
    [
        ({}, {"Y": AxisPrior()}, "drive.axes names 'Y', drive_records.axes has X: correct"),
        ({"axes": {"x": CHANNELS}}, {}, "drive_records.axes names 'x', which is no letter"),
        ({"axes": {}}, {}, "drive_records.axes names no axis"),
        ({"motor": replace(MOTOR, axis="Z")}, {}, "drive_records.motor.axis is 'Z', drive_records"),
    ],
)
def test_an_axis_that_stands_in_one_section_only_is_refused(written, options, known, words):
    folder = written("a.csv", columns())
    with pytest.raises(ValueError, match=words):
        read(folder, DrivePrior(axes=known), **options)


@pytest.mark.parametrize("key", ["reference", "velocity", "acceleration_reference"])
def test_a_channel_that_no_recording_holds_is_refused(written, key):
    folder = written("a.csv", columns())
    axes = {"X": replace(CHANNELS, **{key: "x_typo"})}
    with pytest.raises(ValueError, match=f"axes.X.{key} names the channel 'x_typo'"):
        read(folder, axes=axes)


def test_a_channel_that_some_recordings_hold_is_no_mistake(written):
    written("a.csv", columns())
    a, b = read(written("b.csv", columns(x_set=None)))
    assert a.axes["X"].reference is not None and b.axes["X"].reference is None


@pytest.mark.parametrize(
    ("change", "units", "words"),
    [
        ({"x_cur": None}, {}, "no channel 'x_cur': record the torque command"),
        ({"x_cur": np.zeros(N)}, {}, "'x_cur' is 0 throughout"),
        ({"x_cur": np.full(N, np.nan)}, {}, "no channel 'x_cur'"),
        ({"x_cur": ["on"] * N}, {}, "holds words"),
        ({"x_act": None, "x_speed": None}, {}, "no channel 'x_act': record the position"),
        ({"x_act": np.ones(N)}, {}, "does not move"),
        ({"t": None}, {}, "no time"),
        ({"t": np.zeros(N)}, {}, "never goes forward"),
        ({}, {"x_cur": "MILLIMETER"}, "'x_cur' is in MILLIMETER, no unit of"),
        ({}, {"x_act": "CELSIUS"}, "'x_act' is in CELSIUS"),
    ],
)
def test_what_a_recording_lacks_is_said_and_never_raised(written, change, units, words):
    (one,) = read(written("a.csv", columns(**change), units=UNITS | units))
    assert not one.axes
    assert words in one.lacking["X"]


@pytest.mark.parametrize("unit", ["PERCENT", "NEWTON_METER", ""])
def test_command_and_load_may_be_in_any_unit_of_one(written, unit):
    (one,) = read(written("a.csv", columns(), units={**UNITS, "x_cur": unit, "x_force": ""}))
    assert one.axes["X"].load == pytest.approx(2.0 * np.arange(N))


def test_rows_of_cutting_are_not_air_and_rows_without_a_value_are_missing(written):
    words = ["Prep"] * 100 + ["Layer 1 Up"] * 100
    current = np.sin(np.arange(N, dtype=float))
    current[50] = np.nan
    folder = written("a.csv", columns(process=words, x_cur=current))
    (one,) = read(folder, air=AirRows(channel="process", values=("Prep",)))
    free = np.arange(N) < 100
    free[50] = False
    assert np.array_equal(one.air, free)
    assert one.axes["X"].command[50] == pytest.approx((current[49] + current[51]) / 2)
    assert "1 missing rows filled in" in one.notes[0]


def test_a_gap_in_time_makes_two_recordings_of_one_file(written):
    time = 1e-3 * np.arange(N)
    time[120:] += 0.05
    first, second = read(written("a.csv", columns(t=time)))
    assert [first.name, second.name] == ["a.csv (part 1)", "a.csv (part 2)"]
    assert first.file == second.file == "a.csv"
    assert (first.samples, second.samples) == (120, 80)


def test_a_command_of_the_other_sign_is_turned(written):
    channels = AxisChannels(command="x_cur", position="x_act", reversed=True)
    (one,) = read(written("a.csv", columns()), axes={"X": channels})
    assert one.axes["X"].command == pytest.approx(-np.sin(np.arange(N)))


def with_motor(written, turning):
    """The folder with a recording of a motor."""
    units = {"ud": "VOLT", "uq": "VOLT", "id": "AMPERE", "iq": "AMPERE", "n": "REVOLUTION/MINUTE"}
    return written("motor.csv", {"t": 1e-3 * np.arange(N), **dict.fromkeys(units, turning)},
                   units={"t": "SECOND", **units})  # fmt: skip


def test_a_motors_recording_stands_beside_those_of_the_axes(written):
    written("a.csv", columns())
    axes, one = read(with_motor(written, 60 + np.zeros(N)), motor=MOTOR, recordings="a*")
    assert not axes.motor and not one.axes
    assert one.motor["speed"] == pytest.approx(np.full(N, 2 * np.pi))


def test_cases_have_the_roles_of_their_raw_files(written):
    for name in ("a.csv", "b.csv", "c.csv", "d.csv"):
        written(name, columns())
    written("dead.csv", columns(x_cur=None))
    folder = with_motor(written, np.sin(1e-3 * np.arange(N)))
    settings = Fitting(
        identity=MachineIdentity(name="m", origin="recorded"), roles=Roles(training=("a*",)),
        drive=DrivePrior(), drive_fit=DriveFitSettings(),
        drive_records=DriveRecords(recordings="[abcd]*.csv", axes={"X": CHANNELS}, motor=MOTOR),
    )  # fmt: skip

    def frozen(name):
        return FrozenSet(files=(SourceFile(file=name, sha256=f"hash of {name}"),))

    sets = GoldenSets(machine="m", golden=frozen("c.csv"), sealed=frozen("d.csv"))
    found = SUBMODEL.cases(Records(signals=folder), settings, sets)
    roles = {case.name: case.role for case in found.cases}
    # nothing is predicted of a motor: its recording serves the fit
    assert roles == {"a.csv": "training", "b.csv": "held_out", "c.csv": "golden",
                     "d.csv": "sealed", "motor.csv": "training"}  # fmt: skip
    assert [one.case for one in found.left_out] == ["dead.csv"]
    assert "record the torque command" in found.left_out[0].reason
    conditions = {case.name: case.conditions for case in found.cases}
    # a ramp of 0.1 mm each millisecond; what is sealed is not looked at
    assert conditions["b.csv"]["highest speed X"].value == pytest.approx(60.0)
    assert conditions["d.csv"] == {}
    with pytest.raises(ValueError, match="name them in reads"):
        SUBMODEL.cases(Records(), settings)


def test_sections_load_and_say_what_is_wrong():
    values = {"drive": {"axes": {"X": {"force_constant": "gtau", "position_gain": 160.18}}},
              "fit": {"method": "simplex"}}  # fmt: skip
    known = structure(values, "drive", DrivePrior).axis("X")
    assert (known.force_constant, known.position_gain) == ("gtau", 160.18)
    with pytest.raises(ParametersError, match="simplex"):
        structure(values, "fit", DriveFitSettings)
    with pytest.raises(ValueError, match=r"drive_fit.widest = 0 must be finite and positive"):
        DriveFitSettings(widest=0)
    with pytest.raises(ValueError, match="neither position nor velocity"):
        AxisChannels(command="x_cur")
