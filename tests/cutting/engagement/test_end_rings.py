"""A tool that goes down over a hole: the ring of its end that cuts, its torque, thrust and side."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.engagement.end_rings import EndRings, whole_ends
from pipeline.cutting.engagement.engagement import Engagement, engage
from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import BlockLoads, load_table
from pipeline.cutting.force.waveform import profile_waveform
from pipeline.cutting.tool import Tool
from pipeline.twin.cut.blocks import station_arcs
from tests.cutting.tool_paths import MM, block, cleared, through

F_Z = 1e-4
LAW = ForceLaw.linear(K_tc=1700, K_rc=500, K_ac=200, K_te=20, K_re=10, K_ae=5)
CUTTING = ForceLaw.linear(K_tc=1700, K_rc=0)
EACH = LAW.K_tc * F_Z + LAW.K_te
"""Force along the cutting speed on each length of edge [N/m]."""
ANGLES = np.radians(2.5 + 5.0 * np.arange(72))
WAY = through([[0, 0, 2], [0, 0, -8]])
RESOLUTIONS = [0.1, 0.5]


def flat(diameter_mm: float, flutes: int = 2, **given) -> Tool:
    return Tool(kind="flat", diameter_mm=diameter_mm, flutes=flutes, **given)


def down(tool: Tool, where, resolution: float, path=WAY) -> Engagement:
    """The way down where ``where(x, y)`` [mm] is air."""
    half = tool.diameter_mm / 2 + 3
    stock = block((-half, half), (-half, half), (-12, 0), resolution)
    return engage(path, [tool], cleared(stock, where))[0]


def bored(tool: Tool, hole_mm: float, resolution: float, centre=(0.0, 0.0)) -> Engagement:
    """The way down over a round hole."""
    x_0, y_0 = centre
    return down(tool, lambda x, y: np.hypot(x - x_0, y - y_0) < hole_mm / 2, resolution)


def loads(found: Engagement, tool: Tool, law: ForceLaw = LAW) -> BlockLoads:
    """Of the station with the greatest length."""
    table = load_table(found, [tool], [law], 2 * F_Z)
    of = table.station_loads(np.full(found.blocks, F_Z))
    k = int(np.argmax(found.length))
    return BlockLoads(**{name: getattr(of, name)[k] for name in vars(of)})


def columns(tool: Tool, hole_mm: float, resolution: float) -> float:
    """How many columns the ring holds."""
    return np.pi * (tool.diameter_mm**2 - hole_mm**2) / 4 / resolution**2


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize(
    ("diameter", "hole", "flutes"),
    [(39.5, 38, 2), (40, 39.5, 1), (10, 9.7, 6), (20, 8, 4), (32, 20, 1), (16, 6, 3)],
)
def test_a_round_hole_leaves_a_ring(diameter, hole, flutes, resolution) -> None:
    """Torque N K f (D^2 - d^2) / 8, thrust N K f (D - d) / 2, and teeth that balance each other.

    As many columns as the ring holds tell its area to 2 / sqrt, and how it is shared around to
    9 / sqrt of its teeth's force.
    """
    tool = flat(diameter, flutes)
    found = bored(tool, hole, resolution)
    load, n = loads(found, tool), columns(tool, hole, resolution)
    width, square = (diameter - hole) / 2 * MM, (diameter**2 - hole**2) / 8 * MM**2
    thrust = flutes * (LAW.K_rc * F_Z + LAW.K_re) * width
    near = 2 / np.sqrt(n)
    assert load.torque == pytest.approx(flutes * EACH * square, rel=near)
    assert load.peak_torque == pytest.approx(load.torque, rel=1.5 / np.sqrt(n) + 0.5 * (flutes < 3))
    assert load.axial == pytest.approx(thrust, rel=6 / np.sqrt(n) + 0.01)
    if flutes > 1:
        assert load.peak <= 9 / np.sqrt(n) * EACH * width + 0.1 * EACH * width
    assert found.rings.around_the_axis.all()


@settings(deadline=None, max_examples=30)
@given(
    diameter=st.floats(6, 30), share=st.floats(0.1, 0.97), off=st.floats(0, 1),
    angle=st.floats(0, 2 * np.pi), resolution=st.floats(0.2, 0.8),
)  # fmt: skip
def test_torque_is_that_of_the_removed_material(diameter, share, off, angle, resolution) -> None:
    """Of a hole anywhere below the tool, in its middle, at its side or across its rim."""
    tool = flat(diameter)
    hole, far = share * diameter, 0.5 * off * diameter
    found = bored(tool, hole, resolution, centre=(far * np.cos(angle), far * np.sin(angle)))
    of_full = down(tool, lambda x, y: 0 * x > 1, resolution)
    if len(found) == 0:
        return
    removed = found.volume.sum() / of_full.volume.sum()
    ratio = loads(found, tool, CUTTING).torque / loads(of_full, tool, CUTTING).torque
    assert ratio == pytest.approx(removed, rel=0.05, abs=0.005)
    rings = found.rings
    assert np.all(rings.inner >= 0) and np.all(rings.outer <= np.float32(tool.radius))


@pytest.mark.parametrize(("resolution", "near"), [(0.1, 0.03), (0.5, 0.12)])
def test_a_hole_off_the_axis(resolution: float, near: float) -> None:
    """39 mm, 0.4 mm to the left of a boring bar of 40: 0.1 mm at one side, 0.9 at the other."""
    tool = flat(40.0, 1)
    found = bored(tool, 39.0, resolution, centre=(-0.4, 0.0))
    x, y = np.sin(ANGLES), np.cos(ANGLES)
    width = 20 + 0.4 * x - np.sqrt(19.5**2 - (0.4 * y) ** 2)
    error = (found.rings.outer - found.rings.inner)[0] / MM - width
    assert np.sqrt(np.mean(error**2)) < near * width.mean()
    greatest = EACH * (width * (20 - width / 2)).max() * MM**2
    assert loads(found, tool).peak_torque == pytest.approx(greatest, rel=near)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_a_sickle_stays_at_its_side(resolution: float) -> None:
    """1 mm of wall at the right side of a tool of 20 mm: nothing is spread around it."""
    found = down(flat(20.0, 1), lambda x, _: x < 9, resolution)
    width = (found.rings.outer - found.rings.inner)[0] / MM
    true = np.where(np.sin(ANGLES) > 0.9, 10 - 9 / np.maximum(np.sin(ANGLES), 0.9), 0.0)
    assert width.sum() == pytest.approx(true.sum(), rel=0.08)
    assert width.max() == pytest.approx(1.0, abs=0.25)
    assert np.all(width[np.sin(ANGLES) < 0.6] == 0)


def test_a_stepped_hole_has_a_ring_for_each_diameter() -> None:
    """14 mm 4 mm deep, then 8 mm: a counterbore of 20 cuts 3 mm and then 6 mm a side."""
    tool = flat(20.0)
    stock = block((-13, 13), (-13, 13), (-12, 0), 0.25)
    stock = cleared(stock, lambda x, y: np.hypot(x, y) < 7, -4)
    found, _ = engage(WAY, [tool], cleared(stock, lambda x, y: np.hypot(x, y) < 4))
    deep = 2 * MM + 4 * MM
    widths = found.rings.width / MM
    above = found.along + found.length < deep + 1e-9
    assert widths[above] == pytest.approx(3, rel=0.15)
    below = found.along > deep - 1e-9
    assert widths[below] == pytest.approx(6, rel=0.15)
    assert above.any() and below.any()


def test_full_material_has_no_ring() -> None:
    for tool in (flat(10.0), Tool(kind="drill", diameter_mm=10, flutes=2),
                 Tool(kind="bull_nose", diameter_mm=10, flutes=2, corner_radius_mm=1)):  # fmt: skip
        assert len(down(tool, lambda x, y: 0 * x > 1, 0.5).rings.station) == 0


def test_a_bull_nose_cuts_with_the_part_of_its_flat_over_the_material() -> None:
    """A corner of 2 mm leaves a flat of 8 mm: a hole of 6 leaves 1 mm of it, one of 9 none."""
    tool = Tool(kind="bull_nose", diameter_mm=12, flutes=2, corner_radius_mm=2)
    six = bored(tool, 6.0, 0.2)
    width = (six.rings.outer - six.rings.inner)[-1] / MM
    assert width.mean() == pytest.approx(1.0, rel=0.05)
    assert six.rings.outer.max() <= np.float32(4 * MM)
    nine = bored(tool, 9.0, 0.2)
    assert not (nine.rings.outer > nine.rings.inner).any()
    of_full = loads(down(tool, lambda x, y: 0 * x > 1, 0.2), tool, CUTTING).torque
    for found, hole in ((six, 6.0), (nine, 9.0)):
        assert loads(found, tool, CUTTING).torque / of_full == pytest.approx(
            1 - (hole / 12) ** 2, rel=0.05
        )


@pytest.mark.parametrize("hole", [9.7, 6.0])
def test_a_drill_in_a_hole_cuts_with_the_outside_of_its_lips(hole: float) -> None:
    """Its point has heights, which say where its lips cut."""
    tool = Tool(kind="drill", diameter_mm=10, flutes=2)
    of_full = loads(down(tool, lambda x, y: 0 * x > 1, 0.2), tool, CUTTING).torque
    ratio = loads(bored(tool, hole, 0.2), tool, CUTTING).torque / of_full
    assert ratio == pytest.approx(1 - (hole / 10) ** 2, rel=0.1)


def test_all_models_of_the_force_take_the_ring() -> None:
    """Load table, waveform and drawn peaks; runout alone unbalances a ring that is even."""
    tool = flat(20.0, 1)
    found = bored(tool, 18.0, 0.25, centre=(0.3, 0.2))
    k = int(np.argmax(found.length))
    ring, load = found.rings.of(k), loads(found, tool)
    profile = {"lower": found.lower[k], "upper": found.upper[k]}
    forces = profile_waveform(
        LAW, tool, f_z=F_Z, angles=np.arange(1440) * np.pi / 720, slope=-1.0, ring=ring, **profile
    )
    assert forces[:, 3].mean() == pytest.approx(load.torque, rel=1e-3)
    assert np.hypot(*forces[:, :2].T).max() == pytest.approx(load.peak, rel=1e-3)
    law = np.concatenate([LAW.cutting, LAW.edge])[None]
    turn = edge_turn(tool, *profile.values(), slope=-1.0, ring=ring)
    drawn = drawn_loads(turn, law, np.zeros((1, 2)), [F_Z])[0, 0]
    assert drawn == pytest.approx(load.peak, rel=0.02)


def test_the_radial_depth_is_what_is_taken_off_a_side() -> None:
    tool = flat(39.5)
    found = bored(tool, 38.0, 0.25)
    arcs = station_arcs(found, (tool,))
    k = int(np.argmax(found.length))
    assert arcs.radial[k] == pytest.approx(0.75 * MM, rel=0.1)
    assert arcs.exit[k] - arcs.entry[k] == pytest.approx(2 * np.pi)


def test_rings_of_stations() -> None:
    rings = EndRings(
        station=np.array([1, 4]), inner=np.zeros((2, 8), np.float32),
        outer=np.full((2, 8), 2, np.float32),
    )  # fmt: skip
    assert rings.of(0) is None and rings.of(5) is None
    assert rings.rows(6).tolist() == [0, 1, 0, 0, 2, 0]
    assert rings.width.tolist() == [2, 2] and not rings.around_the_axis.any()
    assert whole_ends().of(0) is None and whole_ends().rows(2).tolist() == [0, 0]
