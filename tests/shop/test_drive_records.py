"""What the servo tool writes can be read as the machine's file says, and the truth fits it."""

import json
import shutil
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cattrs
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.machine.axis.drive_parameters import ServoParameters, friction_force
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.schema.identity import MachineIdentity
from pipeline.shop.drives.records import write_drives
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest

from .conftest import Simulated, digests

CONF = Path(__file__).parents[2] / "conf" / "machine"
SINGLE = {f"servo/reciprocation-{a}.csv": a for a in "XYZ"} | {
    "servo/load-step-X.csv": "X", "servo/load-step-Z.csv": "Z", "servo/inertia-step-X.csv": "X",
}  # fmt: skip


@dataclass(frozen=True)
class Read:
    """A machine's traces by raw file, its manifest, its file in conf/, the truth."""

    traces: dict[str, dict[str, np.ndarray]]
    units: dict[str, dict[str, str]]
    manifest: dict[str, dict[str, Any]]
    conf: dict[str, Any]
    truth: dict[str, Any]
    week: Simulated

    def told(self, file: str) -> dict[str, Any]:
        return next(f for f in self.truth["more"]["files"] if f["file"] == file)


@pytest.fixture(scope="module")
def read(week: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Read:
    root = tmp_path_factory.mktemp("servo")
    for name in ("servo", "motor"):
        shutil.copytree(week.folder / name, root / "raw" / name)
    conf = yaml.safe_load((CONF / f"{week.parameters.machine}.yaml").read_text())
    converter = cattrs.Converter(forbid_extra_keys=True)
    sources = [
        converter.structure(r, RecordSource)
        for r in conf["records"]
        if r["files"].startswith(("servo/", "motor/"))
    ]
    identity = MachineIdentity(**conf["identity"])
    ingest(root / "raw", root / "signals", sources, identity)
    manifest = json.loads((root / "signals/manifest.json").read_text())["files"]
    tables = {
        name: pq.read_table(root / "signals" / entry["output"]) for name, entry in manifest.items()
    }
    return Read(
        traces={n: {c: t[c].to_numpy() for c in t.column_names} for n, t in tables.items()},
        units={n: {f.name: f.metadata[b"unit"].decode() for f in t.schema}
               for n, t in tables.items()},
        manifest=manifest, conf=conf, truth=week.truth["drives"], week=week,
    )  # fmt: skip


def test_every_file_is_read_and_only_the_torn_row_is_lost(read: Read) -> None:
    told = {f["file"]: f for f in read.truth["more"]["files"]}
    assert told.keys() == read.manifest.keys()
    assert set(SINGLE) < set(told) and len(told) == 13
    for name, entry in read.manifest.items():
        assert entry["reason"] is None
        assert entry["rejected"] == int(told[name]["torn"])
        assert entry["kept"] == told[name]["rows"] - entry["rejected"]
    assert sum(f["torn"] for f in told.values()) == 1
    total = sum(p.stat().st_size for p in read.week.folder.glob("[sm]*o*/*.csv"))
    assert 5e6 < total < 25e6


def test_channels_are_those_of_the_drive_records_in_their_units(read: Read) -> None:
    units = {"reference": "MILLIMETER", "position": "MILLIMETER", "command": "AMPERE",
             "load": "NEWTON"}  # fmt: skip
    axes = read.conf["drive_records"]["axes"]
    for file, letter in SINGLE.items():
        for quantity, channel in axes[letter].items():
            if quantity != "load" or "load-step" in file:
                assert read.units[file][channel] == units[quantity]
    program = next(f for f in read.units if "program" in f)
    assert {axes[a][q] for a in "XYZ" for q in axes[a] if q != "load"} < set(read.units[program])
    motor = read.conf["drive_records"]["motor"]["channels"]
    found = {k: read.units["motor/speed-steps-X.csv"][c] for k, c in motor.items()}
    assert found == {"u_d": "VOLT", "u_q": "VOLT", "i_d": "AMPERE", "i_q": "AMPERE",
                     "speed": "REVOLUTION/MINUTE"}  # fmt: skip


def test_gaps_and_repeated_stamps_are_where_the_truth_says(read: Read) -> None:
    """The tool's clock is off by parts in a million; its stamps tell the rows that are missing."""
    rate = 1 + read.truth["more"]["tool"]["clock_error"] * 1e-6
    assert abs(rate - 1) >= 30e-6
    for name, trace in read.traces.items():
        if name.startswith("motor"):
            continue
        told = read.told(name)
        t = trace["t"]
        row = np.round(t / rate * 1e3).astype(int)
        assert np.abs(t - row / 1e3 * rate).max() < 1.1e-6  # of stamps in microseconds
        lost = {g["row"] + k for g in told["gaps"] for k in range(g["lost"])}
        torn = {round(told["seconds"] * 1e3) - 1} if told["torn"] else set()
        assert set(range(round(told["seconds"] * 1e3))) - set(row.tolist()) == (
            lost | set(told["repeated"]) | torn
        )
        again = np.flatnonzero(np.diff(row) == 0)
        assert (row[again] + 1).tolist() == told["repeated"]


def drive(found: dict[str, float]) -> FeedDriveParameters:
    sides = {
        side: DirectionFriction(
            **{f.name: found[f"{f.name}_{side}"] for f in fields(DirectionFriction)}
        )
        for side in ("positive", "negative")
    }
    names = ("mass", "force_constant", "offset", "backlash")
    return FeedDriveParameters(friction=FrictionParameters(**sides), **{n: found[n] for n in names})


def test_the_truth_is_a_drive_of_the_twin(read: Read) -> None:
    """Each axis' truth makes parameters of the twin, with the gains that the conf names."""
    for letter, found in read.truth["axes"].items():
        known = read.conf["drive"]["axes"][letter]
        drive(found)
        names = ("position_gain", "velocity_gain", "integral_gain", "current_limit")
        loops = ("position_scale", "velocity_scale", "integral_scale", "velocity_feedforward",
                 "acceleration_feedforward")  # fmt: skip
        servo = ServoParameters(**{n: known[n] for n in names}, **{n: found[n] for n in loops})
        assert servo.loop_gain == pytest.approx(
            read.week.parameters.control.position_gain, rel=1e-3
        )
        assert all(0.7 <= found[n] <= 1.4 for n in loops[:3])
        constant = 2 * np.pi * known["torque_constant"] / known["lead"] * 1e3
        assert found["force_constant"] == pytest.approx(constant, rel=1e-12)
    assert {"R", "L_d", "L_q", "flux"} <= read.truth["motor"].keys()
    assert read.truth["motor"]["pole_pairs"] == read.conf["drive_records"]["motor"]["pole_pairs"]


def motion(read: Read, file: str) -> tuple[np.ndarray, ...]:
    """Speed [m/s], acceleration [m/s2] and force [N] of a record, as means over 21 rows."""
    letter = SINGLE[file]
    trace, channels = read.traces[file], read.conf["drive_records"]["axes"][letter]
    row = np.arange(trace["t"].size)
    kernel = np.ones(21) / 21
    x = np.convolve(trace[channels["position"]] * 1e-3, kernel, "same")
    current = np.convolve(np.convolve(trace[channels["command"]], kernel, "same"), kernel, "same")
    v = np.gradient(np.convolve(x, kernel, "same"), 1e-3)
    force = current * read.truth["axes"][letter]["force_constant"]
    clean = np.ones(row.size, bool)
    for bad in np.flatnonzero(np.abs(np.diff(trace["t"]) - 1e-3) > 1e-4):
        clean[max(bad - 60, 0) : bad + 60] = False
    clean[:100] = clean[-100:] = False
    return v, np.gradient(v, 1e-3), force, clean


@pytest.mark.parametrize("letter", ["X", "Y", "Z"])
def test_mass_and_friction_of_the_truth_carry_the_record(read: Read, letter: str) -> None:
    """Strokes: M a + F(v) + F_g with the truth leaves 4 % of the force; the best mass is M.

    4 %: cogging, ripple of screw and torque, and presliding, which the twin does not have.
    """
    v, a, force, clean = motion(read, f"servo/reciprocation-{letter}.csv")
    truth = drive(read.truth["axes"][letter])
    moving = clean & (np.abs(v) > 0.02)
    rest = force - friction_force(v, truth.friction) - truth.offset
    mass = np.sum(rest[moving] * a[moving]) / np.sum(a[moving] ** 2)
    assert mass == pytest.approx(truth.mass, rel=0.01)
    left = (rest - truth.mass * a)[moving]
    assert np.sqrt(np.mean(left**2)) < 0.04 * np.sqrt(np.mean(force[moving] ** 2))
    slow = clean & (np.abs(a) < 0.02) & (np.abs(v) > 1e-4)
    mean = np.abs(np.mean((rest - truth.mass * a)[slow]))
    assert mean < 0.03 * truth.friction.positive.coulomb


@pytest.mark.parametrize("letter", ["X", "Z"])
def test_a_push_shows_in_the_current_as_the_load_cell_says(read: Read, letter: str) -> None:
    """At constant feed, k A less friction goes with the load one to one."""
    file = f"servo/load-step-{letter}.csv"
    v, _, force, clean = motion(read, file)
    truth = drive(read.truth["axes"][letter])
    load = read.traces[file][read.conf["drive_records"]["axes"][letter]["load"]]
    load = np.convolve(load, np.ones(41) / 41, "same")
    steady = clean & (np.abs(np.abs(v) - 0.015) < 1e-4) & (np.abs(np.gradient(load)) < 0.5)
    rest = (force - friction_force(v, truth.friction) - truth.offset)[steady]
    slope, level = np.polyfit(load[steady], rest, 1)
    assert steady.sum() > 5000 and np.ptp(load[steady]) > 500
    assert slope == pytest.approx(1.0, abs=0.01)
    offset = read.truth["more"]["tool"]["load_cell_offset"]
    assert abs(level + slope * offset) < 0.02 * truth.friction.positive.coulomb
    pushes = read.told(file)["pushes"]
    t = read.traces[file]["t"]
    for push in pushes:
        inside = (t > push["start_s"] + 0.1) & (t < push["end_s"] - 0.05)
        assert load[inside].mean() - offset == pytest.approx(push["force_N"], abs=3.0)


def test_the_workpiece_adds_its_mass(read: Read) -> None:
    file = "servo/inertia-step-X.csv"
    v, a, force, clean = motion(read, file)
    truth, told = drive(read.truth["axes"]["X"]), read.told(file)
    rest = force - friction_force(v, truth.friction) - truth.offset
    later = np.arange(v.size) > told["set_down_s"] * 1e3
    found = []
    for half in (~later, later):
        rows = half & clean & (np.abs(v) > 0.02)
        found.append(np.sum(rest[rows] * a[rows]) / np.sum(a[rows] ** 2))
    assert found[0] == pytest.approx(truth.mass, rel=0.01)
    assert found[1] - found[0] == pytest.approx(told["mass_kg"], rel=0.05)


def test_the_tool_has_chances_of_its_own(week: Simulated, tmp_path: Path) -> None:
    """The same bytes as among all other records."""
    told = write_drives(tmp_path, week.parameters)
    whole = digests(week.folder)
    assert {n: whole[n] for n in digests(tmp_path)} == digests(tmp_path)
    assert json.loads(json.dumps(told)) == week.truth["drives"]


def test_the_siblings_have_two_makers_drives() -> None:
    first, second = (yaml.safe_load((CONF / f"{m}.yaml").read_text()) for m in ("mill01", "mill02"))
    columns = [
        {
            source["column"]
            for record in conf["records"]
            if record["files"].startswith("servo/")
            for source in record["table"]["columns"].values()
        }
        for conf in (first, second)
    ]
    assert not columns[0] & columns[1]
    assert first["drive"] != second["drive"]
