"""Worn edges of a cut: what a land adds by hand, which wear a tool has, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.optimisation.reliability.uncertainty import NORMAL, uncertainty
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.twin.cut.blocks import station_arcs
from pipeline.twin.cut.coefficients import (
    KnownWear,
    LandGrowth,
    MachineWear,
    ToolCoefficients,
    ToolWear,
    tool_edges,
    worn_coefficients,
)
from pipeline.twin.cut.loads import with_force_laws
from tests.twin.cut_parts import DEPTH, LAW, SIX, SLOT, TEN, cut_of

GROWTH = LandGrowth(
    K_te=125e6, K_re=430e6, half_te=40e6, half_re=80e6, learnt_um=(9.0, 241.0), material="A6061",
    basis="119 cuts with 5 tools",
)  # fmt: skip
KNOWN = MachineWear(
    growth=GROWTH, criterion_um=215.0, in_use={2: KnownWear(wear_um=90.0, source="as last read")}
)
SHARP = ToolCoefficients(law=LAW, kind="measured", source="made up")
DRILL = Tool(kind="drill", diameter_mm=5.0, flutes=2)
TOOLS = {1: TEN, 2: SIX, 3: replace(TEN, flank_wear_um=60.0), 4: DRILL}
HERE, ELSEWHERE = ("A6061", "Aluminium A6061-T6"), ("A7075", "Aluminium A7075-T6")


def worn(wear: ToolWear, material=HERE):
    return worn_coefficients(dict.fromkeys(TOOLS, SHARP), TOOLS, wear, material)


def widths(wear: ToolWear, material=HERE) -> list[float]:
    """Wear that counts of each tool [um]."""
    found = worn(wear, material).values()
    return [0.0 if one.sharp is None or one.land is None else one.land.wear_um for one in found]


@pytest.mark.parametrize("law", [LAW, ForceLaw.kienzle(k_c11=700.0, m_c=0.25, radial=0.3)])
def test_a_slot_takes_the_force_of_the_land_that_one_writes_down(law: ForceLaw) -> None:
    """Mean of N teeth on half a turn: F_x = -N a_p K_re / pi, F_y = N a_p K_te / pi."""
    sharp = cut_of(SLOT, laws=dict.fromkeys((1, 2), law))
    one = worn_coefficients(
        {1: replace(SHARP, law=law)}, {1: TEN}, ToolWear(machine=KNOWN, given={1: 120.0}), HERE
    )[1]
    blunt = with_force_laws(sharp, (one.law, law))
    K_te, K_re = 125e6 * 120e-6, 430e6 * 120e-6
    engagement = sharp.engagement
    inside = ((engagement.upper > engagement.lower) & engagement.feed[:, None]).sum(axis=1)
    middle, f_z = np.array([np.argmax(inside)]), np.array([50e-6])  # the whole slot
    added = (blunt.table.mean_forces(middle, f_z) - sharp.table.mean_forces(middle, f_z))[0, :3]
    teeth = TEN.flutes * DEPTH * 1e-3 / np.pi
    np.testing.assert_allclose(added, [-teeth * K_re, teeth * K_te, 0.0], rtol=2e-3, atol=1e-6)
    torque = (blunt.station_loads.torque - sharp.station_loads.torque)[middle[0]]
    by_hand = TEN.flutes * DEPTH * 1e-3 * TEN.radius * K_te / 2
    assert torque == pytest.approx(by_hand, rel=6e-3)  # teeth stand at angles 1.25 degrees apart


def test_tools_have_the_wear_that_is_given_known_or_the_criterion() -> None:
    assert widths(ToolWear(machine=KNOWN)) == [0.0, 90.0, 60.0, 0.0]
    assert widths(ToolWear(machine=KNOWN, given={1: 120.0, 2: 0.0})) == [120.0, 0.0, 60.0, 0.0]
    assert widths(ToolWear(machine=KNOWN, rule="sharp", requested=True)) == [0.0] * 4
    assert widths(ToolWear(machine=KNOWN, rule="criterion")) == [215.0, 215.0, 215.0, 0.0]
    half = ToolWear(machine=KNOWN, rule="criterion", share=0.2)
    assert widths(half) == pytest.approx([43.0, 43.0, 60.0, 0.0])
    assert worn(ToolWear(machine=KNOWN))[1].edge == "sharp: nothing is said of its wear"
    assert "fitted on end mills" in worn(ToolWear(machine=KNOWN))[4].edge


def test_in_another_material_the_criterion_counts_only_where_it_is_asked_for() -> None:
    rule = ToolWear(machine=KNOWN, rule="criterion")
    one = worn(rule, ELSEWHERE)[1]
    assert one.law == LAW and "fitted in A6061, not in A7075" in one.edge
    for wear in (replace(rule, requested=True), replace(rule, given={1: 215.0})):
        one = worn(wear, ELSEWHERE)[1]
        assert one.law != LAW and one.land is not None
        assert "fitted in A6061, not in A7075" in one.land.caution
    assert worn(rule)[1].land.caution == ""  # type: ignore[union-attr]


def test_wear_beyond_what_was_fitted_is_said_or_refused() -> None:
    far = replace(KNOWN, criterion_um=300.0)
    one = worn(ToolWear(machine=far, rule="criterion"))[1]
    assert one.land is not None and "beyond the 241 um" in one.land.caution
    for given, said in (
        ({1: 300.0}, r"--wear T1=300 um is beyond the 9 to 241 um .*: give at most 241"),
        ({9: 50.0}, r"--wear T9=50: the tool table has no T9, it has T1, T2, T3, T4"),
        ({4: 50.0}, r"T4 is a drill"),
    ):
        with pytest.raises(ValueError, match=said):
            worn(ToolWear(machine=KNOWN, given=given))
    with pytest.raises(ValueError, match=r"--wear T1=50: .*was not identified on this machine"):
        worn(ToolWear(given={1: 50.0}))
    assert widths(ToolWear(given={1: 0.0}, rule="criterion")) == [0.0] * 4


def test_the_interval_of_the_growth_is_part_of_the_force() -> None:
    cut = cut_of(SLOT)
    arcs = station_arcs(cut.engagement, cut.tools)
    found = worn(ToolWear(machine=KNOWN, given={1: 200.0}))
    (edge,) = tool_edges(cut, arcs, found)
    of = edge.forces
    assert edge.wear_um == of.wear_um == 200.0
    assert of.peak_load_sharp_N < of.peak_load_low_N < of.peak_load_N < of.peak_load_high_N
    assert of.power_kW > of.power_sharp_kW
    # as a sharp tool it is compared at the criterion, and the figures of the cut stay sharp
    (bare,) = tool_edges(cut, arcs, worn(ToolWear(machine=KNOWN)))
    assert bare.wear_um == 0.0 and bare.forces.wear_um == 215.0
    assert bare.forces.peak_load_sharp_N == of.peak_load_sharp_N
    assert bare.forces.peak_load_N > of.peak_load_N


def test_what_is_drawn_of_a_worn_edge_has_its_interval_too() -> None:
    def spread(given: ToolCoefficients):
        tool = uncertainty({1: given}, {1: TEN}, None, None, ReliabilitySettings()).tools[1]
        return tool.mean, tool.own @ tool.own.T

    given = worn(ToolWear(machine=KNOWN, given={1: 200.0}))[1]
    (mean, own), (bare, before) = spread(given), spread(SHARP)
    np.testing.assert_allclose(mean - bare, [0, 0, 0, 125e6 * 2e-4, 430e6 * 2e-4, 0], rtol=1e-9)
    wide = np.diag([0, 0, 0, 40e6 * 2e-4 / NORMAL, 80e6 * 2e-4 / NORMAL, 0]) ** 2
    np.testing.assert_allclose(own, before + wide, rtol=1e-6, atol=1e-3)
