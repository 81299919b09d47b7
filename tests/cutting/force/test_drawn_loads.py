"""Peaks of many draws against the waveform of each."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.waveform import profile_waveform
from pipeline.cutting.tool import Tool
from tests.cutting.tool_paths import arc, random_profile

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


def test_a_runout_turned_by_a_pitch_is_the_same_load():
    """Teeth are alike: which of them stands out changes nothing over a turn."""
    tool = Tool(kind="flat", diameter_mm=10.0, flutes=3, helix_deg=30.0)
    angle = 0.7 + 2 * np.pi / 3 * np.arange(3)
    offsets = 6e-6 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    turn = edge_turn(tool, *arc(np.pi / 2, np.pi, 2e-3))
    found = drawn_loads(turn, np.tile(MEAN, (3, 1)), offsets, FEEDS)
    assert found == pytest.approx(np.repeat(found[:, :1], 3, axis=1), rel=1e-9)


def test_shapes_that_do_not_go_together_are_named():
    turn = edge_turn(Tool(kind="flat", diameter_mm=6.0, flutes=2), *arc(0, np.pi, 5e-4))
    with pytest.raises(ValueError, match=r"\(2, 6\), offsets \(3, 2\)"):
        drawn_loads(turn, np.zeros((2, 6)), np.zeros((3, 2)), FEEDS)
