"""Forces at a station of an engagement."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.cutting.waveform import basis, profile_basis, profile_waveform, torque_basis
from tests.cutting.plain_forces import plain_forces
from tests.cutting.stations import BINS, arc, random_profile

LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0)
WIDE = 2 * np.pi / BINS


def turn(samples: int) -> np.ndarray:
    return (np.arange(samples) + 0.5) * (2 * np.pi / samples)


@pytest.mark.parametrize("kind", ["flat", "bull_nose", "ball"])
@pytest.mark.parametrize("helix", [-20.0, 0.0, 40.0])
@pytest.mark.parametrize("runout", [0.0, 10.0, 60.0])
def test_constant_profile_is_constant_engagement(kind, helix, runout) -> None:
    """Of an arc from bin to bin; pieces are as long as a bin, and err by its square over 24.

    That is 3e-4.  At 60 um of runout edge parts begin and end within pieces, which count or not:
    1.3 % measured.
    """
    tool = replace(
        MILL, kind=kind, helix_deg=helix, runout_um=runout, runout_deg=50.0,
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
        found = profile_waveform(LAW, MILL, f_z=5e-5, lower=lower, upper=upper, angles=turn(40))

        def inside(phi, z, lower=lower, upper=upper):
            k = (phi / WIDE).astype(int) % BINS
            return (z >= lower[k]) & (z < upper[k])

        plain = plain_forces(LAW, MILL, 5e-5, 0.0, upper.max(), inside, turn(40))
        size = np.abs(plain[:, :3]).max()
        assert np.abs(found - plain)[:, :3].max() <= 2e-3 * size  # discs on borders
        assert np.abs(found - plain)[:, 3].max() <= 2e-3 * np.abs(plain[:, 3]).max()


def test_material_above_the_tip_only() -> None:
    """The side between two heights is the whole depth less what lies below."""
    theta = turn(60)
    given = {"f_z": 5e-5, "angles": theta}
    both, below = arc(0.5, 2.0, 5e-3), arc(0.5, 2.0, 2e-3)
    above = arc(0.5, 2.0, 5e-3, low=2e-3)
    parts = [
        profile_basis(MILL, lower=lower, upper=upper, **given) for lower, upper in (below, above)
    ]
    whole = profile_basis(MILL, lower=both[0], upper=both[1], **given)
    assert np.allclose(sum(parts), whole, rtol=0, atol=1e-3 * np.abs(whole).max(axis=(0, 1)))


def test_plunge_of_a_flat_end_in_full() -> None:
    """Torque N (K_tc f_z D^2 / 8 + K_te D^2 / 8 over R), thrust N R (K_rc f_z + K_re)."""
    lower, upper = arc(0.0, 7.0, 1e-4)
    given = {"f_z": 5e-5, "lower": lower, "upper": upper, "angles": turn(24)}
    found = profile_waveform(LAW, MILL, slope=-1.0, **given)
    assert np.allclose(found[:, 3], 4 * (8e8 * 5e-5 + 2e4) * 0.005**2 / 2, rtol=1e-9)
    assert np.allclose(found[:, 2], -4 * 0.005 * (3e8 * 5e-5 + 1.5e4), rtol=1e-9)
    assert np.abs(found[:, :2]).max() < 1e-9 * np.abs(found[:, 2]).max()  # teeth face each other
    half = np.where(np.arange(BINS) < BINS // 2, upper, 0.0)
    found = profile_waveform(LAW, MILL, slope=-1.0, **given | {"upper": half})
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


def test_nothing_engaged_is_no_force() -> None:
    none = np.zeros(BINS)
    assert not profile_basis(MILL, f_z=5e-5, lower=none, upper=none, angles=turn(9)).any()


def test_bad_profiles_are_named() -> None:
    with pytest.raises(ValueError, match=r"lower has shape \(3,\), upper \(4,\)"):
        profile_basis(MILL, f_z=1e-5, lower=np.zeros(3), upper=np.zeros(4), angles=[0.0])
    with pytest.raises(ValueError, match="height of the profile is not finite"):
        profile_basis(MILL, f_z=1e-5, lower=[0.0], upper=[np.nan], angles=[0.0])
    good = {"f_z": 0.0, "lower": [0.0], "upper": [0.0], "angles": [0.0]}  # nothing is cut
    for change, words in [
        ({"f_z": np.nan}, "f_z = nan must be finite"),
        ({"slope": 9.0}, r"slope = 9\.0 must be from -1 to 1"),
        ({"slope": np.nan}, "slope = nan"),
        ({"m_c": 2.0}, r"m_c = 2\.0 is out of its range"),
        ({"m_c": np.nan}, "m_c = nan"),
        ({"slices": 0}, "slices = 0"),
    ]:
        with pytest.raises(ValueError, match=words):
            profile_basis(MILL, **good | change)
