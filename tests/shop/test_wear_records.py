"""Tool lives: the wear of their teeth, what a land does to forces, and the records of both."""

import csv
from dataclasses import replace
from math import pi

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.shop.cutting.force import Motion, X, Y
from pipeline.shop.parameters import ShopParameters, Wear
from pipeline.shop.wear.parameters import PlannedLife
from pipeline.shop.wear.records import BLOCK, course, write_wear
from pipeline.shop.wear.teeth import (
    WornTool,
    chip_loads,
    conditions,
    cut_forces,
    flank_wear,
    new_tool,
    workpiece,
)

from .conftest import MACHINES, Simulated, machine_conf, read_back, shop_parameters

each_machine = pytest.mark.parametrize("machine", ["mill01", "mill02"])


def generator() -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(5))


def short(machine: str) -> ShopParameters:
    """The machine with six records of its first two tools."""
    p = shop_parameters(machine)
    lost = replace(p.wear.sensors, lost_from=2)
    wear = replace(p.wear, lives=p.wear.lives[:2], most=6, sensors=lost)
    return replace(p, wear=wear)


@pytest.fixture(scope="module", params=MACHINES)
def lives(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    folder = tmp_path_factory.mktemp(f"{request.param}-wear")
    parameters = short(request.param)
    return Simulated(folder, write_wear(folder, parameters), parameters)


def listed(found: Simulated) -> list[dict[str, str]]:
    """Rows of the list, by a plain reader, decimals with a point."""
    wear = found.parameters.wear
    text = (found.folder / "wear" / "lives.csv").read_text("ascii").splitlines()
    rows = list(csv.DictReader([text[0], *text[2:]], delimiter=wear.delimiter))
    return [{k: v.replace(wear.decimal, ".") for k, v in row.items()} for row in rows]


def even(tool: WornTool) -> WornTool:
    """The tool without runout, tilt and differences between its teeth."""
    mill = replace(tool.mill, runout=0.0, tilt=0.0, sharpness=(1.0,) * tool.mill.flutes)
    return WornTool(mill=mill, teeth=np.ones(tool.mill.flutes))


@each_machine
def test_a_life_has_a_break_in_a_steady_stretch_and_a_steep_end(machine):
    """Rates of the mean land in the first minutes, in the middle and from 180 um on."""
    wear = shop_parameters(machine).wear
    plan = wear.lives[0]
    tool = even(new_tool(wear.cutter(plan), wear.rate, generator()))
    cuts = [conditions(one, wear.cutter(plan), 1.0) for one in wear.planned(plan)]
    times = np.arange(1.0, 150.0)
    land = flank_wear(wear.rate, tool, cuts, times, np.ones(times.size)).mean(axis=1)
    rate = np.diff(land, prepend=0.0)
    middle, end = rate[np.searchsorted(land, 80.0)], rate[np.searchsorted(land, 180.0)]
    assert rate[0] > 2 * middle and end > 1.3 * middle and (rate > 0).all()


@each_machine
def test_speed_shortens_life_as_a_taylor_exponent_of_carbide(machine):
    """Life over speed in a log-log line: 1/n of 2 to 6 (ISO 3685, carbide: n of 0.15 to 0.5)."""
    wear = shop_parameters(machine).wear
    plan = wear.lives[0]
    tool = even(new_tool(wear.cutter(plan), wear.rate, generator()))
    times = np.arange(1.0, 400.0)
    lasting = []
    for speed in (0.9, 1.2):
        cuts = [conditions(one, wear.cutter(plan), speed) for one in wear.planned(plan)]
        land = flank_wear(wear.rate, tool, cuts, times, np.ones(times.size)).mean(axis=1)
        lasting.append(float(np.interp(200.0, land, times)))
    assert 2.0 < np.log(lasting[0] / lasting[1]) / np.log(1.2 / 0.9) < 6.0


def test_teeth_wear_apart_and_the_one_that_carries_more_wears_more():
    wear = shop_parameters("mill01").wear
    cutter = wear.cutter(wear.lives[0])
    tool = new_tool(cutter, wear.rate, generator())
    tool = WornTool(mill=replace(tool.mill, runout=12.0), teeth=np.ones(cutter.flutes))
    cut = conditions(wear.planned(wear.lives[0])[0], cutter, 1.0)
    land = flank_wear(wear.rate, tool, [cut], np.array([40.0]), np.ones(1))[0]
    loads = chip_loads(tool.mill, cut)
    assert np.argsort(land).tolist() == np.argsort(loads).tolist() and np.ptp(land) > 10
    assert loads.mean() == pytest.approx(1.0, abs=1e-9)  # radii close round the circle


def test_a_land_adds_pressure_and_friction_to_the_mean_force_of_a_slot():
    """By hand: over a slot N a / pi times the radial edge force along -x, the tangential along y.

    Ploughing is whole under all but the thinnest chips, hence 4 % of tolerance.
    """
    wear = shop_parameters("mill01").wear
    tool = even(new_tool(wear.cutter(wear.lives[0]), wear.rate, generator()))
    slot = next(c for c in wear.cuts if c.immersion == "slot")
    c = conditions(slot, wear.cutter(wear.lives[0]), 1.0)
    angle = np.arange(720) / 720 * 2 * pi
    x = 0.05 + angle * c.feed / 60e3 / (c.speed * pi / 30)
    flutes, land, steel = tool.mill.flutes, 150.0, workpiece(wear.workpiece, 1.0)
    sharp, worn = (
        cut_forces(c, tool.mill, steel, np.full(flutes, v), Motion(angle=angle, x=x), BLOCK)
        for v in (0.0, land)
    )
    more = (worn - sharp).mean(axis=0)
    pressure = wear.workpiece.flank_pressure * land * 1e-3 * c.depth * flutes / pi
    assert -more[X] == pytest.approx(pressure, rel=0.04)
    assert more[Y] == pytest.approx(pressure * wear.workpiece.flank_friction, rel=0.04)


def test_the_list_has_a_row_a_record_and_the_reading_where_there_is_one(lives):
    rows = listed(lives)
    told = [f for tool in lives.truth["tools"] for f in tool["files"]]
    assert [r["File"] for r in rows] == [f["file"] for f in told]
    read = [float(r["VB"]) if r["VB"] else None for r in rows]
    assert read == [f["measured_um"] for f in told]
    assert None in read and any(read)
    for tool in {r["Tool"] for r in rows}:
        minutes = [float(r["Time in cut"]) for r in rows if r["Tool"] == tool]
        assert minutes == sorted(minutes) and minutes[0] > 0


def test_a_channel_without_its_plug_shows_next_to_nothing(lives):
    sensors = lives.parameters.wear.sensors
    files = lives.truth["tools"][0]["files"]
    level = []
    for told in files:
        values = pq.read_table(lives.folder / told["file"])[sensors.columns[sensors.lost - 1]]
        level.append(float(np.std(values.to_numpy())))
        assert told["lost"] == (sensors.columns[sensors.lost - 1] if len(level) in (2, 3) else "")
    sound = [v for k, v in enumerate(level) if k not in (1, 2)]
    assert max(level[1:3]) < 0.05 * min(sound)


@each_machine
def test_readings_err_as_the_microscope_does_and_the_last_one_ends_the_life(machine):
    parameters = shop_parameters(machine)
    wear, errors, counts = parameters.wear, [], []
    for plan in wear.lives:
        life = course(wear, plan, parameters.generator(f"wear {plan.tool}"))
        there = np.isfinite(life.measured)
        errors += (life.measured - life.land.mean(axis=1))[there].tolist()
        counts.append(life.times.size)
        ended = life.measured[-1] >= wear.microscope.changed_at
        assert ended or life.times.size == (plan.records or wear.most)
        assert not ended or life.worn_after < life.times[-1] + 2 * plan.interval
        assert np.nanmax(life.measured[:-1]) < wear.microscope.changed_at
        assert (np.diff(life.land, axis=0) > 0).all()
    assert abs(np.mean(errors)) < 1.5  # some 60 readings of 2.5 to 3 um: 0.4 um of the mean
    assert np.std(errors) == pytest.approx(wear.microscope.error, rel=0.4)
    assert len(wear.lives) == 10 and min(counts) >= 8 and 160 <= sum(counts) <= 300


@each_machine
def test_roles_part_tools_and_both_sides_hold_every_type_and_cut(machine):
    from fnmatch import fnmatchcase

    patterns = [p for p in machine_conf(machine)["roles"]["training"] if p.startswith("wear/")]
    wear = shop_parameters(machine).wear
    sides: dict[bool, list[PlannedLife]] = {True: [], False: []}
    for plan in wear.lives:
        named = {any(fnmatchcase(f"wear/{plan.tool}_{k:03d}.parquet", p) for p in patterns)
                 for k in range(1, wear.most + 1)}  # fmt: skip
        assert len(named) == 1  # all records of a tool, or none
        sides[named.pop()].append(plan)
    assert {k: len(v) for k, v in sides.items()} == {True: 5, False: 5}
    for side in sides.values():
        assert {p.cutter for p in side} == {c.name for c in wear.cutters}
        assert {c for p in side for c in p.cuts} == {c.name for c in wear.cuts}


def test_ingest_keeps_every_row_with_its_unit_and_the_list(lives, tmp_path):
    files = [f for tool in lives.truth["tools"] for f in tool["files"]]
    found = read_back(lives, lives.folder, tmp_path, files)
    assert not pq.read_table(tmp_path / "rejected.parquet").num_rows
    raw = pq.read_table(lives.folder / files[0]["file"])
    read = found.traces[files[0]["file"]]
    assert list(read)[1:] == [
        "force_x", "force_y", "force_z", "vibration_x", "vibration_y", "vibration_z",
        "acoustic_emission",
    ]  # fmt: skip
    # MTConnect's accelerations are in mm/s^2, one g is 9.80665 m/s^2
    per = 9806.65 if lives.parameters.wear.sensors.units[3] == "g" else 1e3
    np.testing.assert_allclose(
        read["vibration_x"], raw.column(3).to_numpy().astype(float) * per, rtol=1e-9
    )
    table = found.traces["wear/lives.csv"]
    assert table["recording"].tolist() == [r["File"] for r in listed(lives)]
    read_um = [None if np.isnan(v) else round(v * 1e3, 6) for v in table["flank_wear"]]
    assert read_um == [f["measured_um"] for f in files]


def test_a_life_with_an_unknown_cut_is_refused():
    wear = Wear()
    strange = replace(wear.lives[0], cuts=("boring",))
    with pytest.raises(ValueError, match="T21 has 'boring', which is none of slot roughing"):
        Wear(lives=(strange,))
    with pytest.raises(ValueError, match="two tools have one name"):
        Wear(lives=(wear.lives[0], wear.lives[0]))
