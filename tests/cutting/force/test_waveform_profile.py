"""Forces with runout, of heights for bins of angle, on slopes, and of many draws."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import load_table
from pipeline.cutting.force.waveform import profile_basis, profile_waveform
from pipeline.cutting.tool import Kind, Tool
from tests.cutting.closed_forms import basis, plain_forces, torque_basis
from tests.cutting.tool_paths import BINS, arc, random_profile, stations

STRAIGHT = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=0.0)
TURN = 2 * np.pi
SLOT = {"a_p": 2e-3, "phi_st": 0.0, "phi_ex": np.pi}


def turn(samples: int) -> np.ndarray:
    return (np.arange(samples) + 0.5) * (TURN / samples)


def test_one_tooth_has_no_runout() -> None:
    tool = replace(STRAIGHT, flutes=1, helix_deg=30.0)
    one = basis(tool, f_z=5e-5, angles=turn(40), **SLOT)
    other = basis(replace(tool, runout_um=50.0, runout_deg=33.0), f_z=5e-5, angles=turn(40), **SLOT)
    assert np.array_equal(one, other)


@settings(max_examples=60, deadline=None)
@given(
    runout=st.floats(0.0, 300.0), angle=st.floats(-180.0, 180.0),
    helix=st.floats(-50.0, 50.0), flutes=st.integers(2, 6),
)  # fmt: skip
def test_a_turn_cuts_what_a_turn_is_fed(runout, angle, helix, flutes) -> None:
    """Sum of all chips is N f_z sin(phi), whichever teeth cut: none of it is lost or cut twice."""
    tool = replace(STRAIGHT, flutes=flutes, runout_um=runout, runout_deg=angle, helix_deg=helix)
    # mean torque over R for K_tc: the chips' area of a turn
    torque = torque_basis(tool, f_z=5e-5, angles=turn(1440), slices=32, **SLOT)[:, 0].mean()
    expected = flutes * 5e-5 * 2e-3 * 2 / TURN * tool.radius
    assert torque == pytest.approx(expected, rel=2e-3)  # ends of chips within slices


def test_a_tooth_that_stands_out_far_does_all_the_work() -> None:
    """A chip of N f_z on one tooth, and nothing on the others, helix or not."""
    tool = replace(STRAIGHT, runout_um=1000.0, runout_deg=0.0)
    found = basis(tool, f_z=5e-5, angles=turn(360), **SLOT)
    alone = basis(replace(STRAIGHT, flutes=1), f_z=4 * 5e-5, angles=turn(360), **SLOT)
    assert np.allclose(found, alone, rtol=0, atol=1e-12 * np.abs(alone).max(axis=(0, 1)))


def test_small_runout_changes_chips_by_the_difference_of_radii() -> None:
    """Tooth 0 at phi = 90 deg, offset towards it: h = f_z + runout (1 - cos 90 deg)."""
    tool = replace(STRAIGHT, runout_um=3.0, runout_deg=0.0)
    found = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi / 2])
    assert found[0, 1, 0] / 1e-3 == pytest.approx(5e-5 + 3e-6, rel=1e-12)
    # the tooth behind is a quarter turn from the offset, tooth 0 one farther out before it
    after = basis(tool, f_z=5e-5, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi])
    assert after[0, 1, 0] / 1e-3 == pytest.approx(5e-5 - 3e-6, rel=1e-12)


def test_what_a_tooth_misses_the_next_takes() -> None:
    """N = 4, offset towards tooth 0 by more than the feed: 1 and 2 miss, 3 takes what they left.

    Radii are 1, 0, -1, 0 of the runout.  Tooth 3 would cut f_z + runout over tooth 2, but 1 stood
    as far out two pitches before, and 0 three pitches: min(f_z + r, 2 f_z, 3 f_z - r).
    """
    f_z, r = 5e-5, 60e-6
    tool = replace(STRAIGHT, runout_um=r * 1e6)
    chips = [
        basis(tool, f_z=f_z, a_p=1e-3, phi_st=1.4, phi_ex=1.7, angles=[np.pi / 2 * (1 + j)])
        for j in range(4)
    ]
    h = [chip[0, 1, 0] / 1e-3 for chip in chips]
    third = min(f_z + r, 2 * f_z, 3 * f_z - r)
    assert np.allclose(h, [4 * f_z - third, 0.0, 0.0, third], rtol=1e-9, atol=1e-15)
    edges = [chip[0, 1, 3] / 1e-3 for chip in chips]
    assert np.allclose(edges, [1, 0, 0, 1], rtol=1e-9, atol=1e-15)


def test_forces_change_without_jumps_over_runout() -> None:
    """Fits need it: steps of a nanometre change no edge force by more than a few parts in 1000."""
    tool = replace(STRAIGHT, helix_deg=30.0, runout_deg=40.0)
    values = [
        basis(replace(tool, runout_um=20.0 + 1e-3 * k), f_z=3e-5, angles=turn(30), **SLOT)
        for k in range(40)
    ]
    steps = np.abs(np.diff(values, axis=0))[..., 3:].max()
    assert steps <= 5e-3 * np.abs(values[0][..., 3:]).max()


@pytest.mark.parametrize("runout", [3.0, 10.0, 40.0])
@pytest.mark.parametrize("m_c", [0.0, 0.25])
def test_error_of_the_slices(runout: float, m_c: float) -> None:
    """What the docstring of `basis` says of 16 slices over 1.7 rad."""
    tool = replace(STRAIGHT, helix_deg=30.0, runout_um=runout, runout_deg=20.0)
    cut = {**SLOT, "f_z": 5e-5, "a_p": 15e-3, "angles": turn(500), "m_c": m_c}
    exact, found = basis(tool, slices=2000, **cut), basis(tool, **cut)
    scale = np.abs(exact).max(axis=(0, 1))
    error = np.abs(found - exact) / scale
    assert error[..., :3].max() < 7e-4
    assert error[..., 3:].max() < 7e-3
    assert np.sqrt((error[..., 3:] ** 2).mean()) < 1e-3


LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
HELICAL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0)
WIDE = 2 * np.pi / BINS


@pytest.mark.parametrize("kind", ["flat", "bull_nose", "ball"])
@pytest.mark.parametrize("helix", [-20.0, 0.0, 40.0])
@pytest.mark.parametrize("runout", [0.0, 10.0, 60.0])
def test_constant_profile_is_constant_engagement(kind, helix, runout) -> None:
    """Of an arc from bin to bin; pieces are as long as a bin, and err by its square over 24.

    That is 3e-4.  At 60 um of runout edge parts begin and end within pieces, which count or not:
    1.3 % measured.
    """
    tool = replace(
        HELICAL, kind=kind, helix_deg=helix, runout_um=runout, runout_deg=50.0,
        corner_radius_mm=2.0 if kind == "bull_nose" else 0.0,
    )  # fmt: skip
    phi_st, phi_ex = 7 * WIDE, 29 * WIDE
    lower, upper = arc(phi_st, phi_ex, 6e-3)
    theta = turn(101)
    found = profile_basis(tool, f_z=5e-5, lower=lower, upper=upper, angles=theta)
    cut = {"f_z": 5e-5, "a_p": 6e-3, "phi_st": phi_st, "phi_ex": phi_ex, "angles": theta}
    scale = np.abs(found).max(axis=(0, 1))
    near = np.array([3.5e-4] * 3 + [2e-2 if runout == 60.0 else 3.5e-4] * 3)
    assert (np.abs(found[:, :3] - basis(tool, slices=64, **cut)) <= near * scale).all()
    assert (np.abs(found[:, 3] - torque_basis(tool, slices=64, **cut)) <= near * scale).all()


def test_plain_restatement_of_an_uneven_profile() -> None:
    rng = np.random.default_rng(4)
    for _ in range(5):
        lower, upper = random_profile(rng)
        found = profile_waveform(LAW, HELICAL, f_z=5e-5, lower=lower, upper=upper, angles=turn(40))

        def inside(phi, z, lower=lower, upper=upper):
            k = (phi / WIDE).astype(int) % BINS
            return (z >= lower[k]) & (z < upper[k])

        plain = plain_forces(LAW, HELICAL, 5e-5, 0.0, upper.max(), inside, turn(40))
        size = np.abs(plain[:, :3]).max()
        assert np.abs(found - plain)[:, :3].max() <= 2e-3 * size  # discs on borders
        assert np.abs(found - plain)[:, 3].max() <= 2e-3 * np.abs(plain[:, 3]).max()


def test_plunge_of_a_flat_end_in_full() -> None:
    """Torque N (K_tc f_z D^2 / 8 + K_te D^2 / 8 over R), thrust N R (K_rc f_z + K_re)."""
    lower, upper = arc(0.0, 7.0, 1e-4)
    given = {"f_z": 5e-5, "lower": lower, "upper": upper, "angles": turn(24)}
    found = profile_waveform(LAW, HELICAL, slope=-1.0, **given)
    assert np.allclose(found[:, 3], 4 * (8e8 * 5e-5 + 2e4) * 0.005**2 / 2, rtol=1e-9)
    assert np.allclose(found[:, 2], -4 * 0.005 * (3e8 * 5e-5 + 1.5e4), rtol=1e-9)
    assert np.abs(found[:, :2]).max() < 1e-9 * np.abs(found[:, 2]).max()  # teeth face each other
    half = np.where(np.arange(BINS) < BINS // 2, upper, 0.0)
    found = profile_waveform(LAW, HELICAL, slope=-1.0, **given | {"upper": half})
    assert found[:, 3].mean() == pytest.approx(2 * (8e8 * 5e-5 + 2e4) * 0.005**2 / 2, rel=1e-9)


def test_drill_that_enters() -> None:
    """Half of the point's height in the material: half of the lips, a quarter of the torque."""
    drill = Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0)
    height = 4e-3 / np.tan(np.radians(59))
    lower, upper = arc(0.0, 7.0, height / 2)
    given = {"f_z": 1e-4, "lower": lower, "angles": turn(7), "slope": -1.0}
    torque = profile_basis(drill, upper=upper, **given)[:, 3, 0]
    assert np.allclose(torque, 2 * 1e-4 * 8e-3**2 / 8 / 4, rtol=1e-6)  # heights are 7 digits
    torque = profile_basis(drill, upper=20 * upper, **given)[:, 3, 0]
    assert np.allclose(torque, 2 * 1e-4 * 8e-3**2 / 8, rtol=1e-6)


F_Z = 5e-5
BARS = [0.02, 0.03, 0.02, 0.02]
"""Of :func:`errors` [1]; draws have teeth 7.5 degrees apart."""
UPWARDS = [0.05, 0.06, 0.04, 0.04]
"""A corner cuts with little of its length there, and with runout chips end within its pieces."""
LINEAR = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
BENT = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4, axial=0.1)
ANGLES = 144
"""Of a turn, every 2.5 degrees: a peak of the load between them is 0.1 % higher."""


def tool(kind: Kind, flutes: int, runout: float) -> Tool:
    return Tool(
        kind=kind, diameter_mm=10.0, flutes=flutes, helix_deg=30.0, point_angle_deg=118.0,
        runout_um=runout, runout_deg=25.0, corner_radius_mm=2.0 if kind == "bull_nose" else 0.0,
    )  # fmt: skip


def profile(down: float) -> tuple[np.ndarray, np.ndarray]:
    """In front of a tool 4 mm deep; on its way down its end lies on half of what is behind, too."""
    if down == 90.0:
        return arc(0, 7, 4e-3)
    lower, upper = arc(0, np.pi, 4e-3)
    return lower, np.maximum(upper, arc(np.pi, 1.5 * np.pi, 3e-4 if down > 0 else 0.0)[1])


def discs(law: ForceLaw, one: Tool, down: float, many: int = 300) -> np.ndarray:
    lower, upper = profile(down)

    def inside(phi: np.ndarray, z: np.ndarray) -> np.ndarray:
        k = (phi * BINS / (2 * np.pi)).astype(int) % BINS
        return np.asarray((z >= lower[k]) & (z < upper[k]))

    angles = (np.arange(ANGLES) + 0.5) * (2 * np.pi / ANGLES)
    slope = -float(np.sin(np.radians(down)))
    return plain_forces(law, one, F_Z, 0.0, upper.max(), inside, angles, many, slope=slope)


def errors(law: ForceLaw, kind: Kind, flutes: int, runout: float, down: float) -> np.ndarray:
    """Of the peak, of a draw's, of mean load and torque, over the greatest force there is.

    A draw's is as :mod:`pipeline.optimisation.reliability.part_loads` takes it: what runout adds.
    """
    one, plain = tool(kind, flutes, runout), tool(kind, flutes, 0.0)
    true = discs(law, one, down)
    load, force = np.hypot(true[:, 0], true[:, 1]), np.linalg.norm(true[:, :3], axis=1).max()
    slope, heights = -float(np.sin(np.radians(down))), profile(down)
    cut = stations([heights], [0], 1, slope=slope)
    tables = [load_table(cut, [of], [law], F_Z).loads([F_Z]) for of in (one, plain)]
    angle = np.array([np.cos(one.runout_angle), np.sin(one.runout_angle)])
    with_runout, without = drawn_loads(
        edge_turn(one, *heights, slope=slope), [law.constants] * 2,
        [one.runout * angle, 0 * angle], [F_Z], m_c=law.m_c,
    )[0]  # fmt: skip
    found = np.array([
        tables[0].peak[0], tables[1].peak[0] + with_runout - without, tables[0].mean[0],
        tables[0].torque[0] / one.radius,
    ])  # fmt: skip
    torque = true[:, 3].mean() / one.radius
    return np.abs(found - [load.max(), load.max(), load.mean(), torque]) / force


@pytest.mark.parametrize(
    ("law", "kind", "flutes", "runout", "down"),
    [
        (LINEAR, "flat", 3, 10.0, 3.0),
        (LINEAR, "flat", 6, 0.0, 30.0),
        (BENT, "flat", 4, 5.0, 60.0),
        (LINEAR, "flat", 2, 10.0, 90.0),
        (LINEAR, "bull_nose", 4, 10.0, 10.0),
        (BENT, "bull_nose", 2, 0.0, -20.0),
        (LINEAR, "ball", 3, 0.0, -30.0),
        (LINEAR, "ball", 2, 10.0, 20.0),
        (LINEAR, "ball", 3, 10.0, 90.0),
        (BENT, "drill", 2, 10.0, 90.0),
        (LINEAR, "drill", 3, 10.0, 45.0),
    ],
)
def test_a_slope_has_the_forces_of_its_discs(law, kind, flutes, runout, down) -> None:
    assert (errors(law, kind, flutes, runout, down) < BARS).all()


@pytest.mark.proof
@pytest.mark.parametrize("kind", ["flat", "bull_nose", "ball", "drill"])
@pytest.mark.parametrize("law", [LINEAR, BENT], ids=["linear", "bent"])
def test_all_slopes_have_the_forces_of_their_discs(kind: Kind, law: ForceLaw) -> None:
    """0 to 90 degrees down and, but for drills, up; 2 to 6 flutes; runout 0 to 10 um."""
    downs = [*range(0, 91, 10), 3, *([] if kind == "drill" else (-5, -30, -60))]
    for flutes, runout, down in product(range(2, 7), (0.0, 3.0, 10.0), downs):
        found = errors(law, kind, flutes, runout, float(down))
        assert (found < (BARS if down >= 0 else UPWARDS)).all(), (flutes, runout, down, found)


COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
MEAN = np.array([8e8, 3e8, 1.2e8, 2e4, 1.5e4, 3e3])
FEEDS = np.array([1e-5, 4e-5, 1e-4])


def waveform_peak(law, offset, tool, f_z, profile, m_c=0.0, slope=0.0) -> float:
    turned = replace(
        tool, runout_um=float(np.hypot(*offset)) * 1e6,
        runout_deg=float(np.degrees(np.arctan2(offset[1], offset[0]))),
    )  # fmt: skip
    forces = profile_waveform(
        ForceLaw(**dict(zip(COEFFICIENTS, law.tolist(), strict=True)), m_c=m_c), turned, f_z=f_z,
        lower=profile[0], upper=profile[1], angles=np.arange(1440) * np.pi / 720, slope=slope,
    )  # fmt: skip
    return float(np.hypot(forces[:, 0], forces[:, 1]).max())


@given(
    seed=st.integers(0, 2**31), flutes=st.integers(1, 5),
    helix=st.sampled_from([0.0, 30.0, 45.0]), m_c=st.sampled_from([0.0, 0.25]),
)  # fmt: skip
@settings(max_examples=12, deadline=None)
def test_a_draw_is_the_peak_of_its_waveform(seed: int, flutes: int, helix: float, m_c: float):
    rng = np.random.default_rng(seed)
    tool = Tool(kind="flat", diameter_mm=10.0, flutes=flutes, helix_deg=helix)
    profile = random_profile(rng, least=0.5)
    laws = MEAN * (1 + 0.2 * rng.standard_normal((3, 6))) * np.where(np.arange(6) < 3, 0.1**m_c, 1)
    offsets = 5e-6 * rng.standard_normal((3, 2)) * (flutes > 1)
    found = drawn_loads(edge_turn(tool, *profile), laws, offsets, FEEDS, m_c=m_c)
    true = np.array([
        [waveform_peak(law, offset, tool, f_z, profile, m_c)
         for law, offset in zip(laws, offsets, strict=True)] for f_z in FEEDS
    ])  # fmt: skip
    # teeth stand up to 7.5 degrees apart, and bins where one begins to cut count or do not
    assert (found / true > 0.9).all() and (found / true < 1.1).all()
    assert abs(np.median(found / true) - 1) < 0.05


def test_a_mean_is_that_of_its_waveform():
    tool = Tool(kind="ball", diameter_mm=10.0, flutes=3, helix_deg=30.0, runout_um=8.0)
    profile = arc(0.4, 2.6, 3e-3)
    offset, law = np.array([[8e-6, 0.0]]), ForceLaw(**dict(zip(COEFFICIENTS, MEAN, strict=True)))
    turn = edge_turn(tool, *profile, slope=-0.2)
    forces = profile_waveform(
        law, tool, f_z=4e-5, lower=profile[0], upper=profile[1], slope=-0.2,
        angles=np.arange(720) * np.pi / 360,
    )  # fmt: skip
    mean = np.hypot(forces[:, 0], forces[:, 1]).mean()
    # pieces of the corner where a tooth begins to miss its chip
    assert drawn_loads(turn, MEAN[None], offset, [4e-5], mean=True)[0, 0] == pytest.approx(
        mean, rel=0.01
    )


def test_a_slot_without_runout_is_the_closed_form():
    """K_tc a_p f_z sqrt(1 + K_rc^2 / K_tc^2) and as much of edge, when a tooth is across."""
    tool = Tool(kind="flat", diameter_mm=6.0, flutes=2)
    law = np.array([[1.2e9, 0.6e9, 0.0, 2e4, 1e4, 0.0], [1.0e9, 0.0, 0.0, 0.0, 3e4, 0.0]])
    found = drawn_loads(edge_turn(tool, *arc(0, np.pi, 5e-4)), law, np.zeros((2, 2)), FEEDS)
    force = 5e-4 * (law[:, None, :2] * FEEDS[:, None] + law[:, None, 3:5])
    # a tooth stands within 3.75 degrees of it: cos is 0.9979
    assert found == pytest.approx(np.hypot(force[..., 0], force[..., 1]).T, rel=2.5e-3)


def test_without_material_there_is_no_load():
    tool = Tool(kind="ball", diameter_mm=6.0, flutes=2, helix_deg=30.0)
    turn = edge_turn(tool, np.zeros(72), np.zeros(72))
    assert drawn_loads(turn, MEAN[None], np.zeros((1, 2)), FEEDS).tolist() == [[0.0]] * 3
