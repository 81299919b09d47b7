"""Commands of the recorded drives, and the servo tool's files read by the machine's file."""

import shutil
from dataclasses import fields
from itertools import pairwise
from math import hypot, inf

import numpy as np
import pytest

from pipeline.machine.axis.drive_parameters import ServoParameters, friction_force
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.drives.parameters import Drives
from pipeline.shop.drives.records import (
    circles,
    commanded,
    reciprocation,
    smoothed,
    travel,
)

from .conftest import Read, Simulated, read_back, shop_parameters

HERTZ = 2000
SOON = 300
"""Samples until most next points."""
AHEAD = 8 * HERTZ
"""Samples until the next point at the latest: a tool change and the way after it."""
EXACT = 1e-6  # of differences of ways in mm, twice divided by half a millisecond


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
@pytest.mark.parametrize("letter", ["X", "Y", "Z"])
def test_strokes_hold_twelve_speeds_and_keep_the_limits_of_the_axis(machine, letter):
    """Each speed both ways for 0.3 s at least; neither speed, acceleration nor travel is passed."""
    shop = shop_parameters(machine)
    limits, axis = getattr(shop.control, letter.lower()), shop.drives.axes[letter]
    own = limits.bounds
    moves = reciprocation(shop.drives.tool.speeds, limits.rapid / 60, own, axis.lead)
    way = travel(moves, own, HERTZ)
    v = np.diff(way) * HERTZ
    a = np.diff(v) * HERTZ
    assert np.abs(v).max() == pytest.approx(limits.rapid / 60, rel=EXACT)
    assert np.abs(a).max() <= own[0] * (1 + EXACT)
    assert np.ptp(way) < 400  # mm, the shortest travel of a mill of this size
    steady = np.abs(a) < 1e-3
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(int)))
    held: dict[float, float] = {}
    for first, last in edges.reshape(-1, 2):
        speed = round(float(v[first : last + 1].mean()), 3)
        held[speed] = max(held.get(speed, 0), (last - first) / HERTZ)
    wanted = [s * way for s in (*shop.drives.tool.speeds, limits.rapid / 60) for way in (1, -1)]
    assert len(wanted) >= 2 * 12 and min(np.abs(wanted)) == 0.2
    for speed in wanted:
        assert held[round(speed, 3)] >= 0.3


def test_smoothing_delays_by_half_its_windows_and_keeps_the_ends():
    """A ramp comes out as the same ramp, later by the middles of both windows."""
    time = np.arange(4000) / HERTZ
    ramp = 120.0 + 50.0 * np.clip(time - 0.5, 0, 1)
    out = smoothed(ramp, HERTZ)
    assert out[0] == 120.0 and out[-1] == pytest.approx(170.0, abs=1e-9)
    inside = slice(int(0.6 * HERTZ), int(1.4 * HERTZ))
    delay = (16 - 1) / 2 + (8 - 1) / 2  # of means over 16 and 8 samples
    expected = 120.0 + 50.0 * (time[inside] - delay / HERTZ - 0.5)
    assert out[inside] == pytest.approx(expected, abs=1e-9)


def test_circles_are_round_and_as_fast_as_told():
    """Radius in every sample; both feeds both ways within the path's acceleration."""
    limits = shop_parameters("mill01").control.path_bounds
    x, y = circles(80.0, (50.0, 150.0), 1.25, limits, HERTZ)
    assert np.hypot(x, y) == pytest.approx(np.full(x.size, 40.0), abs=1e-12)
    turn = np.unwrap(np.arctan2(y, x))
    speed = np.diff(turn) * 40 * HERTZ
    for feed in (50.0, 150.0):
        for sign in (1, -1):
            assert np.mean(np.abs(speed - sign * feed) < 1e-3) > 0.05
    assert np.ptp(turn) == pytest.approx(2.5 * np.pi, abs=1e-9)
    assert turn[-1] == pytest.approx(turn[0], abs=1e-9)


@pytest.fixture(scope="module", params=["mill01", pytest.param("mill02", marks=pytest.mark.proof)])
def cam(request: pytest.FixtureRequest) -> tuple[PartProgram, np.ndarray, tuple[float, ...]]:
    shop = shop_parameters(request.param)
    program = part_programs(shop.control, shop.generator("part programs"))[0][2]
    way = commanded(program, shop, HERTZ, (-400.0, 0.0, 0.0))
    return program, way, shop.control.work_offset


def test_the_axes_pass_all_points_of_the_program_in_turn(cam):
    """Every programmed end, moved by work offset and tool length, lies at the way.

    0.05 mm: what the smoothing cuts off a corner, v T / 8 with 24 mm/s in the short chords, and
    the way between two samples.
    """
    program, way, offset = cam
    lengths = {t.number: t.length for t in program.tools}
    tool, at, seen = 0, 0, 0
    for step in program.steps:
        tool = step.number if step.kind == "tool" else tool
        if step.kind not in ("rapid", "line", "arc") or step.end[2] == inf:
            continue
        goal = np.array(step.end) + np.array(offset) + [0, 0, lengths[tool]]
        ahead = way[at : at + AHEAD]
        near = np.abs(ahead[:SOON] - goal).max(axis=1) < 0.05
        if not near.any():
            near = np.abs(ahead - goal).max(axis=1) < 0.05
        assert near.any(), f"line {step.line}: {goal} is not passed after sample {at}"
        at += int(np.argmax(near))
        seen += 1
    assert seen > 500


def test_arcs_of_the_program_keep_their_radius(cam):
    """Samples in the middle of full circles stand at the radius, but for the smoothing.

    Two means of 8 and 4 ms take v^2 (T1^2 + T2^2) / (24 r) off a radius: 3 um at 40 mm/s and 2 mm.
    """
    program, way, offset = cam
    tried = 0
    for before, step in pairwise(program.steps):
        if step.kind != "arc" or abs(step.turn) < 6:
            continue
        centre = np.array(step.centre) + offset[:2]
        radius = hypot(*(np.array(before.end[:2]) - np.array(step.centre)))
        away = np.hypot(*(way[:, :2] - centre).T)
        on = np.abs(away - radius) < 4e-3
        assert on.mean() * len(way) > 2 * np.pi * radius / (step.feed / 60) * HERTZ * 0.5
        tried += 1
    assert tried > 0


def test_the_axes_keep_their_rapids(cam):
    _, way, _ = cam
    speed = np.abs(np.diff(way, axis=0)).max(axis=0) * HERTZ * 60
    assert np.all(speed <= [36000.1, 36000.1, 30000.1])
    assert Drives().x.cascade.position_frequency == HERTZ


SINGLE = {f"servo/reciprocation-{a}.csv": a for a in "XYZ"} | {
    "servo/load-step-X.csv": "X", "servo/load-step-Z.csv": "Z", "servo/inertia-step-X.csv": "X",
}  # fmt: skip


@pytest.fixture(scope="module")
def read(week: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Read:
    root = tmp_path_factory.mktemp("servo")
    for name in ("servo", "motor"):
        shutil.copytree(week.folder / name, root / "raw" / name)
    told = week.truth["drives"]["more"]["files"]
    return read_back(week, root / "raw", root / "signals", told)


def test_every_file_is_read_and_only_the_torn_row_is_lost(read):
    told = read.told
    assert told.keys() == read.manifest.keys()
    assert set(SINGLE) < set(told) and len(told) == 13
    for name, entry in read.manifest.items():
        assert entry["reason"] is None
        assert entry["rejected"] == int(told[name]["torn"])
        assert entry["kept"] == told[name]["rows"] - entry["rejected"]
    assert sum(f["torn"] for f in told.values()) == 1
    total = sum(p.stat().st_size for p in read.made.folder.glob("[sm]*o*/*.csv"))
    assert 5e6 < total < 25e6


def test_gaps_and_repeated_stamps_are_where_the_truth_says(read):
    """The tool's clock is off by parts in a million; its stamps tell the rows that are missing."""
    rate = 1 + read.made.truth["drives"]["more"]["tool"]["clock_error"] * 1e-6
    assert abs(rate - 1) >= 30e-6
    for name, trace in read.traces.items():
        if name.startswith("motor"):
            continue
        told = read.told[name]
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


def test_the_truth_is_a_drive_of_the_twin(read):
    """Each axis' truth makes parameters of the twin, with the gains that the conf names."""
    for letter, found in read.made.truth["drives"]["axes"].items():
        known = read.conf["drive"]["axes"][letter]
        drive(found)
        names = ("position_gain", "velocity_gain", "integral_gain", "current_limit")
        loops = ("position_scale", "velocity_scale", "integral_scale", "velocity_feedforward",
                 "acceleration_feedforward")  # fmt: skip
        servo = ServoParameters(**{n: known[n] for n in names}, **{n: found[n] for n in loops})
        assert servo.loop_gain == pytest.approx(
            read.made.parameters.control.position_gain, rel=1e-3
        )
        assert all(0.7 <= found[n] <= 1.4 for n in loops[:3])
        constant = 2 * np.pi * known["torque_constant"] / known["lead"] * 1e3
        assert found["force_constant"] == pytest.approx(constant, rel=1e-12)
    assert {"R", "L_d", "L_q", "flux"} <= read.made.truth["drives"]["motor"].keys()
    assert (
        read.made.truth["drives"]["motor"]["pole_pairs"]
        == read.conf["drive_records"]["motor"]["pole_pairs"]
    )


def motion(read: Read, file: str) -> tuple[np.ndarray, ...]:
    """Speed [m/s], acceleration [m/s2] and force [N] of a record, as means over 21 rows."""
    letter = SINGLE[file]
    trace, channels = read.traces[file], read.conf["drive_records"]["axes"][letter]
    row = np.arange(trace["t"].size)
    kernel = np.ones(21) / 21
    x = np.convolve(trace[channels["position"]] * 1e-3, kernel, "same")
    current = np.convolve(np.convolve(trace[channels["command"]], kernel, "same"), kernel, "same")
    v = np.gradient(np.convolve(x, kernel, "same"), 1e-3)
    force = current * read.made.truth["drives"]["axes"][letter]["force_constant"]
    clean = np.ones(row.size, bool)
    for bad in np.flatnonzero(np.abs(np.diff(trace["t"]) - 1e-3) > 1e-4):
        clean[max(bad - 60, 0) : bad + 60] = False
    clean[:100] = clean[-100:] = False
    return v, np.gradient(v, 1e-3), force, clean


@pytest.mark.parametrize("letter", ["X", "Y", "Z"])
def test_mass_and_friction_of_the_truth_carry_the_record(read, letter):
    """Strokes: M a + F(v) + F_g with the truth leaves 4 % of the force; the best mass is M.

    4 %: cogging, ripple of screw and torque, and presliding, which the twin does not have.
    """
    v, a, force, clean = motion(read, f"servo/reciprocation-{letter}.csv")
    truth = drive(read.made.truth["drives"]["axes"][letter])
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
def test_a_push_shows_in_the_current_as_the_load_cell_says(read, letter):
    """At constant feed, k A less friction goes with the load one to one."""
    file = f"servo/load-step-{letter}.csv"
    v, _, force, clean = motion(read, file)
    truth = drive(read.made.truth["drives"]["axes"][letter])
    load = read.traces[file][read.conf["drive_records"]["axes"][letter]["load"]]
    load = np.convolve(load, np.ones(41) / 41, "same")
    steady = clean & (np.abs(np.abs(v) - 0.015) < 1e-4) & (np.abs(np.gradient(load)) < 0.5)
    rest = (force - friction_force(v, truth.friction) - truth.offset)[steady]
    slope, level = np.polyfit(load[steady], rest, 1)
    assert steady.sum() > 5000 and np.ptp(load[steady]) > 500
    assert slope == pytest.approx(1.0, abs=0.01)
    offset = read.made.truth["drives"]["more"]["tool"]["load_cell_offset"]
    assert abs(level + slope * offset) < 0.02 * truth.friction.positive.coulomb
    pushes = read.told[file]["pushes"]
    t = read.traces[file]["t"]
    for push in pushes:
        inside = (t > push["start_s"] + 0.1) & (t < push["end_s"] - 0.05)
        assert load[inside].mean() - offset == pytest.approx(push["force_N"], abs=3.0)


def test_the_workpiece_adds_its_mass(read):
    file = "servo/inertia-step-X.csv"
    v, a, force, clean = motion(read, file)
    truth, told = drive(read.made.truth["drives"]["axes"]["X"]), read.told[file]
    rest = force - friction_force(v, truth.friction) - truth.offset
    later = np.arange(v.size) > told["set_down_s"] * 1e3
    found = []
    for half in (~later, later):
        rows = half & clean & (np.abs(v) > 0.02)
        found.append(np.sum(rest[rows] * a[rows]) / np.sum(a[rows] ** 2))
    assert found[0] == pytest.approx(truth.mass, rel=0.01)
    assert found[1] - found[0] == pytest.approx(told["mass_kg"], rel=0.05)
