"""Drives of any maker: mass, friction and loop gain inside their intervals, or a true refusal."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Parameter
from pipeline.signals import recordings
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.feed_drive import identify_feed_drive
from pipeline.submodels.drive.model import (
    DriveIdentification,
    IdentifiedAxis,
    axis_parameters,
    identified_axis,
    loop_gains,
)
from pipeline.submodels.drive.reading import read_file
from pipeline.submodels.drive.records import (
    AxisChannels,
    AxisPrior,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
)
from pipeline.submodels.drive.servo_fit import identify_servo
from pipeline.submodels.drive.submodel import SUBMODEL, Fitting
from tests.submodels.drive.drawn_axis import DrawnAxis, drawn_axis, recorded_table
from tests.submodels.made_pages import made, words

MECHANICS = (
    "mass", "coulomb_positive", "coulomb_negative", "viscous_positive", "viscous_negative",
)  # fmt: skip
SEEDS, FEWEST = 100, 95


def parameters(
    seed: int, folder: Path, servo: bool = True, **changes
) -> tuple[DrawnAxis, dict[str, Parameter]]:
    """What a drawn axis is, and what is found of its recording, with or without the servo's law."""
    axis = drawn_axis(seed, **changes)
    table = recorded_table(axis, seed)
    file = folder / "strokes.parquet"
    pq.write_table(table, file)
    channels = AxisChannels(
        command="torque" if axis.torque else None, reference="reference", position="position",
        reversed=axis.sign < 0 and axis.declared,
    )  # fmt: skip
    records = DriveRecords(recordings="*", axes={"X": channels})
    prior = DrivePrior(axes={"X": AxisPrior(force_constant=axis.force_constant)})
    one = recordings.Recording(name="strokes.csv", file=file)
    parts = read_file(one, records, prior, {}, trained=True)
    assert len(parts) == 2  # the gap
    settings = DriveFitSettings(compare=False)
    axes = {}
    if axis.torque and servo:
        axes["X"] = identified_axis("X", parts, prior, settings)
    elif axis.torque:
        drive = identify_feed_drive(parts, "X", prior, settings)
        axes["X"] = IdentifiedAxis(drive=drive, servo=identify_servo((), "X", settings))
    gains = loop_gains(parts, records, settings.widest)
    return axis, axis_parameters("X", DriveIdentification(axes=axes, loop_gains=gains))


def faults(axis: DrawnAxis, found: dict[str, Parameter]) -> list[str]:
    """Parameters that miss their interval, or are refused for another reason than the true one."""
    said = [name for name in MECHANICS if not _mechanics_true(axis, found, name)]
    gain = found["loop_gain"]
    if not (not gain.determined and "decays" in gain.method if axis.pid else _inside(
        gain, axis.loop_gain
    )):  # fmt: skip
        said.append("loop_gain")
    scale = found.get("position_scale")
    if scale is not None and scale.determined and (axis.pid or not _inside(scale, axis.loop_gain)):
        said.append("position_scale")
    return said


def _mechanics_true(axis: DrawnAxis, found: dict[str, Parameter], name: str) -> bool:
    if not axis.torque:
        return name not in found
    one = found[name]
    if axis.sign < 0 and not axis.declared:
        return not one.determined and "wrong sign" in one.remedy
    return _inside(one, axis.truth[name])


def _inside(one: Parameter, value: float) -> bool:
    ends = one.interval_95
    return one.determined and ends is not None and ends[0] <= value <= ends[1]


@pytest.mark.parametrize(
    "changes",
    [
        {"pid": False, "sign": -1, "declared": True, "torque": True},
        {"pid": False, "sign": -1, "declared": False, "torque": True},
        {"pid": True, "torque": False},
        {"pid": False, "torque": False},
    ],
    ids=["torque against the position", "sign not declared", "PID, no torque", "P-PI, no torque"],
)
def test_a_drive_of_another_maker_is_found_or_refused_for_the_true_reason(changes, tmp_path):
    axis, found = parameters(5, tmp_path, servo=False, every=100, **changes)
    assert faults(axis, found) == []


@pytest.mark.proof
def test_95_of_100_drives_are_found_or_refused_for_the_true_reason(tmp_path):
    wrong = {seed: said for seed in range(SEEDS) if (said := faults(*parameters(seed, tmp_path)))}
    assert SEEDS - len(wrong) >= FEWEST, wrong


def test_positions_alone_give_a_model_with_the_loop_gain_and_the_reason(tmp_path):
    axis = drawn_axis(5, every=100, pid=False, torque=False)
    (tmp_path / "traces").mkdir()
    pq.write_table(recorded_table(axis, 5), tmp_path / "traces/a.parquet")
    entry = {"sha256": "a", "output": "traces/a.parquet", "rows": 1, "notes": {}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": {"a.csv": entry}}))
    channels = AxisChannels(reference="reference", position="position")
    settings = Fitting(
        identity=MachineIdentity(name="m", origin="recorded"), roles=Roles(training=("a.csv",)),
        drive=DrivePrior(), drive_records=DriveRecords(recordings="*", axes={"X": channels}),
        drive_fit=DriveFitSettings(compare=False),
    )  # fmt: skip
    model = SUBMODEL.fit(SUBMODEL.cases(Records(signals=tmp_path), settings), settings, tmp_path)
    assert model.axes == {} and _inside(model.parameters["X"]["loop_gain"], axis.loop_gain)
    shown = Shown(machine="m", origin="recorded", model=model, verdict=None, predictions=None)
    said = words(made(SUBMODEL, shown))
    assert "record the torque command" in said and "Kv" in said
