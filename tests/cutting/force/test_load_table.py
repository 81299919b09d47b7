"""Tables of loads against forces computed at one feed, and what they promise."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.economics.material import Material
from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engage
from pipeline.cutting.engagement.stock import Box, height_map
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import (
    BlockLoads,
    chisel_engaged,
    chisel_length,
    chisel_rake,
    chisel_thrust,
    load_table,
)
from pipeline.cutting.force.waveform import profile_waveform
from pipeline.cutting.tool import Tool
from pipeline.parameters import structure
from tests.cutting.closed_forms import immersion, mean_forces, mean_torque, slot_peak_load, waveform
from tests.cutting.tool_paths import arc, random_profile, stations

LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0)
MOST = 1e-4
NAMES = ("peak", "mean", "rms", "axial", "torque", "peak_torque")


def turn(samples: int) -> np.ndarray:
    return (np.arange(samples) + 0.5) * (2 * np.pi / samples)


def direct(law: ForceLaw, tool: Tool, f_z: float, profile, slope: float = 0.0) -> np.ndarray:
    """The six loads from the forces at 2880 angles."""
    forces = profile_waveform(
        law, tool, f_z=f_z, lower=profile[0], upper=profile[1], angles=turn(2880), slope=slope
    )
    load, torque = np.hypot(forces[:, 0], forces[:, 1]), forces[:, 3]
    rms = np.sqrt((load**2).mean())
    return np.array([load.max(), load.mean(), rms, np.abs(forces[:, 2]).max(), torque.mean(),
                     torque.max()])  # fmt: skip


def rows(loads: BlockLoads) -> np.ndarray:
    return np.stack([getattr(loads, name) for name in NAMES])


def blocks(profiles, **columns) -> Engagement:
    """One station a block."""
    return stations(profiles, np.arange(len(profiles)), len(profiles), **columns)


def test_peak_in_a_slot() -> None:
    tool = Tool(kind="flat", diameter_mm=6.0, flutes=2)
    law = ForceLaw.linear(K_tc=1230.0, K_rc=615.0)
    table = load_table(blocks([arc(0, np.pi, 5e-4)]), [tool], [law], MOST)
    # a tooth stands within 0.63 degrees of where its chip is thickest: 6e-5
    assert table.peaks([5e-5])[0] == pytest.approx(float(slot_peak_load(1.23e9, 0.5, 5e-4, 5e-5)),
                                                   rel=1e-4)  # fmt: skip


@pytest.mark.parametrize("m_c", [0.0, 0.3])
@pytest.mark.parametrize("helix", [0.0, 30.0])
def test_nodes_are_the_loads_of_the_forces(helix: float, m_c: float) -> None:
    rng = np.random.default_rng(2)
    profiles = [random_profile(rng) for _ in range(12)]
    law = replace(LAW, m_c=m_c, K_tc=8e8 * MOST**m_c)
    tool = replace(MILL, helix_deg=helix)
    table = load_table(blocks(profiles), [tool], [law], MOST, nodes=5)
    u = np.linspace(0, 1, 5)[1:] ** 2 * MOST ** (1 - m_c)
    for f_z in u ** (1 / (1 - m_c)):
        found = rows(table.loads(np.full(12, f_z)))
        true = np.stack([direct(law, tool, f_z, one) for one in profiles], axis=1)
        ratio = found / true
        # angles 1.25 degrees apart miss a little of peaks; pieces as long as a bin blur h^0.7
        assert (ratio[[0, 3, 5]] > 0.97).all() and (ratio[[0, 3, 5]] < 1.01).all()
        assert np.abs(np.median(ratio, axis=1) - 1).max() < 4e-3
        assert np.abs(ratio[[1, 2, 4]] - 1).max() < 8e-3


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), f_z=st.floats(1e-9, 3 * MOST), helix=st.floats(0.0, 50.0))
def test_between_and_beyond_the_nodes_it_lies_above(seed: int, f_z: float, helix: float) -> None:
    """Chords of what is convex in the feed, and a bound beyond; a fine table has the true ones."""
    profile = random_profile(np.random.default_rng(seed))
    tool = replace(MILL, helix_deg=helix)
    given_ = (blocks([profile]), [tool], [LAW])
    coarse = rows(load_table(*given_, MOST, nodes=3).loads([f_z]))
    fine = rows(load_table(*given_, 3 * MOST, nodes=200).loads([f_z]))
    assert (coarse >= fine * (1 - 1e-3)).all()  # the fine one is itself above, by a part in 1000
    table = load_table(*given_, f_z, nodes=3)
    assert (coarse >= rows(table.loads([f_z])) * (1 - 1e-9)).all()


@pytest.mark.parametrize("helix", [0.0, 30.0])
@pytest.mark.parametrize("runout", [0.0, 15.0, 40.0])
def test_error_of_the_default_nodes(runout: float, helix: float) -> None:
    """As the module says, over feeds from a twentieth of the greatest."""
    rng = np.random.default_rng(7)
    profiles = [random_profile(rng) for _ in range(20)]
    tool = replace(MILL, runout_um=runout, runout_deg=25.0, helix_deg=helix)
    table = load_table(blocks(profiles), [tool], [LAW], MOST)
    errors = []
    for f_z in np.linspace(0.05, 1.0, 20) * MOST:
        exact = load_table(blocks(profiles), [tool], [LAW], f_z, nodes=3)
        feeds = np.full(20, f_z)
        errors.append(rows(table.loads(feeds)) / rows(exact.loads(feeds)) - 1)
    error = np.array(errors)
    if runout:
        assert np.sqrt((error**2).mean(axis=(0, 2))).max() < 0.03
        assert error[:, 0].min() > -0.11 and error[:, 0].max() < 0.09
        assert np.abs(error).max() < 0.31
    else:
        assert error.min() > -1e-9
        assert error.max() < 6e-3


def test_runout_is_in_the_nodes() -> None:
    rng = np.random.default_rng(3)
    tool = replace(MILL, runout_um=15.0, runout_deg=25.0)
    profiles = [random_profile(rng, least=0.6) for _ in range(8)]
    found = rows(load_table(blocks(profiles), [tool], [LAW], MOST).loads(np.full(8, MOST)))
    true = np.stack([direct(LAW, tool, MOST, one) for one in profiles], axis=1)
    assert np.abs(found / true - 1).max() < 0.03
    still = rows(load_table(blocks(profiles), [MILL], [LAW], MOST).loads(np.full(8, MOST)))
    assert (found[0] > still[0] * 1.02).all()  # one tooth takes more than its share


@pytest.mark.parametrize("runout", [0.0, 15.0])
def test_nothing_is_read_before_it_is_written(runout: float, monkeypatch) -> None:
    """Whatever new arrays hold: not a number anywhere would spread to the loads."""
    rng = np.random.default_rng(9)
    profiles = [random_profile(rng) for _ in range(3)] + [arc(0.2, 0.5, 2e-3), arc(0, 0, 0)]
    tools = [replace(MILL, runout_um=runout), Tool(kind="drill", diameter_mm=8.0, flutes=2)]
    given_ = (blocks(profiles, tool=[0, 0, 1, 0, 0], slope=[0, -0.3, -1, 0, 0]), tools, [LAW, LAW])
    clean = load_table(*given_, MOST)
    fresh = np.empty

    def poisoned(shape, dtype=np.float64, **how):
        out = fresh(shape, dtype, **how)
        if out.dtype.kind == "f":
            out[...] = np.nan
        return out

    monkeypatch.setattr(np, "empty", poisoned)
    found = load_table(*given_, MOST)
    assert np.array_equal(found.values, clean.values)
    assert np.isfinite(found.values).all() and found.values.any()


def test_population_is_its_individuals() -> None:
    rng = np.random.default_rng(5)
    profiles = [random_profile(rng) for _ in range(6)]
    law = replace(LAW, m_c=0.2)
    table = load_table(blocks(profiles), [MILL], [law], MOST)
    feeds = rng.uniform(0, 1.5 * MOST, (7, 6))
    together = rows(table.loads(feeds))
    for p in range(7):
        assert np.array_equal(together[:, p], rows(table.loads(feeds[p])))
    out = np.empty((7, 6))
    assert table.peaks(feeds, out) is out
    assert np.array_equal(out, together[0])


def test_blocks_gather_their_stations() -> None:
    """Greatest peak; means by the way that stations stand for; air has none."""
    rng = np.random.default_rng(6)
    profiles = [random_profile(rng) for _ in range(3)]
    lengths = np.array([1e-3, 3e-3, 2e-3])
    engagement = stations(profiles, [1, 1, 3], 5, length=lengths)
    table = load_table(engagement, [MILL], [LAW], MOST)
    feeds = np.full(5, MOST)
    each, found = rows(table.station_loads(feeds)), rows(table.loads(feeds))
    weights = lengths[:2] / lengths[:2].sum()
    expected = [
        each[0, :2].max(), each[1, :2] @ weights, np.sqrt(each[2, :2] ** 2 @ weights),
        each[3, :2].max(), each[4, :2] @ weights, each[5, :2].max(),
    ]  # fmt: skip
    assert np.allclose(found[:, 1], expected, rtol=1e-12)
    assert np.allclose(found[:, 3], each[:, 2], rtol=1e-12)
    assert not found[:, [0, 2, 4]].any()
    assert np.allclose(table.length, [0, 4e-3, 0, 2e-3, 0], rtol=1e-12)


def test_stations_without_material_weigh_nothing() -> None:
    profile = arc(0.2, 2.0, 2e-3)
    engagement = stations([profile, arc(0, 0, 0)], [0, 0], 1, length=[1e-3, 9e-3])
    alone = load_table(blocks([profile]), [MILL], [LAW], MOST)
    both = load_table(engagement, [MILL], [LAW], MOST)
    assert np.array_equal(rows(both.loads([MOST])), rows(alone.loads([MOST])))


@pytest.mark.parametrize("side", ["slot", "up", "down"])
def test_loads_of_an_engagement_with_stock(side: str) -> None:
    """A straight pass through a box, M3: torque and peak of the arc that its depths say.

    Cells of 0.1 mm leave the arc open by half a degree or so.
    """
    # along x, 3 mm into the box: down-milling has it on the tool's right
    y = {"slot": 20e-3, "up": -2e-3, "down": 42e-3}[side]
    path = ToolPath(
        start=np.array([[-8e-3, y, -2e-3]]),
        end=np.array([[30e-3, y, -2e-3]]),
        block=np.zeros(1, np.int32),
        tool=np.zeros(1, np.int32),
        feed=np.ones(1, bool),
        direction=np.ones(1, np.int8),
    )
    box = height_map(Box(x_mm=(0, 60), y_mm=(0, 40), z_mm=(-20, 0)), 1e-4)
    engagement, _ = engage(path, [MILL], box)
    whole = int(np.argmax(engagement.length))
    table = load_table(engagement, [MILL], [LAW], MOST)
    phi_st, phi_ex = immersion(10e-3 if side == "slot" else 3e-3, 10e-3, side)
    cut = {"f_z": 5e-5, "a_p": 2e-3, "phi_st": float(phi_st), "phi_ex": float(phi_ex)}
    found = table.station_loads([5e-5])
    torque = mean_torque(LAW, flutes=4, radius=MILL.radius, **cut)
    assert found.torque[whole] == pytest.approx(float(torque), rel=0.02)
    peak = np.hypot(*waveform(LAW, MILL, angles=turn(720), **cut)[:, :2].T).max()
    assert found.peak[whole] == pytest.approx(peak, rel=0.03)
    profile = engagement.lower[whole], engagement.upper[whole]
    forces = profile_waveform(
        LAW, MILL, f_z=5e-5, lower=profile[0], upper=profile[1], angles=turn(2880)
    )
    means = mean_forces(LAW, flutes=4, **cut)
    assert np.allclose(forces.mean(axis=0)[:3], means, rtol=0, atol=0.02 * np.abs(means).max())


def test_tools_and_laws_go_by_the_stations() -> None:
    profile = arc(0.2, 2.0, 2e-3)
    drill = Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0)
    other = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4)
    hole = arc(0.0, 7.0, 9e-3)
    engagement = blocks([profile, hole], tool=[0, 1], slope=[0.0, -1.0])
    table = load_table(engagement, [MILL, drill], [LAW, other], [MOST, 2e-4])
    found = rows(table.loads([5e-5, 1.5e-4]))
    one = load_table(blocks([profile]), [MILL], [LAW], MOST)
    assert np.array_equal(found[:, :1], rows(one.loads([5e-5])))
    # lips of a drill: k_c1.1 h^(1 - m_c) b R / 2 with h = f_z sin(59 deg), b = R / sin(59 deg)
    sine = np.sin(np.radians(59))
    torque = 2 * other.K_tc * (1.5e-4 * sine) ** 0.75 * (4e-3 / sine) * 2e-3
    assert np.allclose(found[4:, 1], torque, rtol=2e-3)  # a chord of u over the nodes


def test_without_feed_nothing_is_cut() -> None:
    table = load_table(blocks([arc(0.2, 2.0, 2e-3)] * 3), [MILL], [LAW], MOST)
    assert not rows(table.loads([0.0, -1e-5, -np.inf])).any()
    rubbing = table.peaks([1e-12] * 3)
    assert (rubbing > 10.0).all()  # edges rub however thin the chip is
    assert np.isnan(table.peaks([np.nan, 1e-5, 1e-5])).tolist() == [True, False, False]


def test_a_program_that_cuts_nothing() -> None:
    none = stations([], [], 3)
    for tools, laws in (([], []), ([MILL], [LAW])):
        table = load_table(none, tools, laws, MOST)
        for feeds in (np.full(3, MOST), np.full((2, 3), MOST)):
            loads = table.loads(feeds)
            assert not any(getattr(loads, name).any() for name in NAMES)
    table = load_table(stations([], [], 0), [MILL], [LAW], MOST)
    assert table.loads([]).peak.shape == table.peaks([]).shape == (0,)
    assert table.loads(np.empty((4, 0))).peak.shape == (4, 0)


@pytest.mark.parametrize("tools", [(0, 1), (0, 2), (2, 0), (1, 2), (1, 3)])
def test_a_block_has_one_tool(tools) -> None:
    """Whatever the bits of their numbers, and with another block's stations between them or not."""
    profile = arc(0.2, 2.0, 2e-3)
    for block, tool in (([0, 1, 1], [0, *tools]), ([1, 0, 1], [tools[0], 0, tools[1]])):
        engagement = stations([profile] * 3, block, 2, tool=tool)
        with pytest.raises(ValueError, match="block 1 cuts with two tools"):
            load_table(engagement, [MILL] * 4, [LAW] * 4, MOST)
    same = stations([profile] * 3, [0, 1, 1], 2, tool=[tools[0], tools[1], tools[1]])
    assert load_table(same, [MILL] * 4, [LAW] * 4, MOST).peaks([MOST, MOST]).all()


def test_what_does_not_go_together_is_named() -> None:
    engagement = stations([arc(0.2, 2.0, 2e-3)], [0], 1)
    two = stations([arc(0.2, 2.0, 2e-3)] * 2, [0, 0], 1, tool=[0, 1])
    for arguments, words in [
        ((engagement, [MILL], [LAW], 0.0), r"f_z_max = \[0\.\] must be finite and positive"),
        ((two, [MILL, MILL], [LAW, LAW], MOST), "block 0 cuts with two tools"),
    ]:
        with pytest.raises(ValueError, match=words):
            load_table(*arguments)
    table = load_table(engagement, [MILL], [LAW], MOST)
    with pytest.raises(ValueError, match=r"f_z has shape \(2,\): give one feed for each of the 1"):
        table.loads([1e-5, 1e-5])
    with pytest.raises(ValueError, match=r"out has shape \(2,\), f_z has \(1,\)"):
        table.peaks([1e-5], np.empty(2))


ROOT = Path(__file__).parents[3]
MATERIALS = sorted((ROOT / "conf/material").glob("*.yaml"))


def drill(diameter: float, point: float, **values: Any) -> Tool:
    return Tool(kind="drill", diameter_mm=diameter, flutes=2, point_angle_deg=point, **values)


def thrust(tool: Tool, law: ForceLaw, f_z: float, lower: float = 0.0) -> float:
    lows, highs = arc(0.0, 7.0, 2 * tool.diameter)
    profile = (np.maximum(lows, lower), highs)
    table = load_table(blocks([profile], slope=[-1.0]), [tool], [law], 2 * f_z)
    return float(table.loads([f_z]).axial[0])


@pytest.mark.parametrize("path", MATERIALS, ids=lambda path: path.stem)
def test_thrust_is_near_that_of_the_tool_makers_formula(path: Path) -> None:
    """F_f = 0.5 k_c (D / 2) f_n sin(p / 2), k_c = k_c1.1 h^-m_c; 15 % cover its rounded factor."""
    values = yaml.safe_load(path.read_text()) | {"radial": 0.3, "axial": 0.0, "coefficients": None}
    material = structure({"file": values}, "file", Material)
    law = material.force_law(measured=False)
    for diameter, point in ((3.0, 118.0), (8.0, 140.0), (16.0, 118.0)):
        tool, sine = drill(diameter, point), float(np.sin(np.radians(point / 2)))
        feed = 0.015 * diameter  # [mm/rev]
        k_c = material.k_c11 * (feed / 2 * sine) ** -material.m_c
        formula = 0.5 * k_c * diameter / 2 * feed * sine
        assert thrust(tool, law, feed / 2e3) == pytest.approx(formula, rel=0.15)


def test_the_share_of_the_chisel_edge_is_as_published() -> None:
    tool, law = drill(8.0, 118.0), ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.3)
    lips = law.K_rc * (6e-5 * np.sin(np.radians(59))) ** 0.75 * 2 * tool.radius
    chisel = chisel_thrust(tool, law) * 6e-5**0.75
    whole = thrust(tool, law, 6e-5)
    assert whole == pytest.approx(float(lips) + chisel, rel=5e-3)  # a chord of u over the nodes
    below = lips * chisel_length(tool) / tool.diameter
    assert 0.4 < (chisel + below) / whole < 0.7


def test_over_a_hole_the_chisel_edge_cuts_nothing() -> None:
    tool = drill(8.0, 118.0)
    height = chisel_length(tool) / 2 / np.tan(np.radians(59))
    highs = np.full((1, 8), 0.02)
    assert chisel_engaged(tool, np.full((1, 8), 1.01 * height), highs)[0] == 0.0
    assert chisel_engaged(tool, np.zeros((1, 8)), highs)[0] == 1.0
    assert chisel_engaged(tool, np.full((1, 8), height / 2), highs)[0] == pytest.approx(0.5)


def test_a_pointed_drill_has_a_steeper_chisel_edge_than_lips() -> None:
    assert -90 < chisel_rake(drill(8.0, 140.0)) < chisel_rake(drill(8.0, 90.0)) < -30
    assert chisel_length(drill(8.0, 118.0, role="tap")) == 0.0
    assert chisel_length(Tool(kind="flat", diameter_mm=8.0, flutes=4)) == 0.0


def test_torque_of_an_arc_is_that_of_altintas() -> None:
    """Of an arc from bin to bin: mean forces do not ask how the teeth's angles are chosen."""
    wide = 2 * np.pi / 72
    table = load_table(blocks([arc(5 * wide, 20 * wide, 3e-3)]), [MILL], [LAW], MOST)
    expected = mean_torque(
        LAW, flutes=4, f_z=4e-5, a_p=3e-3, phi_st=5 * wide, phi_ex=20 * wide, radius=MILL.radius
    )
    # pieces err by 0.03 %
    assert table.loads([4e-5]).torque[0] == pytest.approx(float(expected), rel=5e-4)
