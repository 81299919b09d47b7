"""Blocks against what binds them, what tools wear, and what the part costs."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material, Taylor
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.margins import ROUNDED
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics
from pipeline.schema.model import Parameter
from pipeline.twin.cut.blocks import cut_blocks, cut_limits
from pipeline.twin.cut.coefficients import (
    ToolCoefficients,
    identified_coefficients,
    tool_coefficients,
)
from pipeline.twin.cut.document import CutBasis, document_of
from pipeline.twin.cut.stability import linearised, stability, stability_lobes
from tests.cutting.chatter import depth_limits, regenerative_cut
from tests.submodels.cutting import cutting_files
from tests.twin.cut_parts import LAW, SIX, SLOT, TEN, cut_of

DRIVE = SpindleDrive(
    rated_power_kW=0.4, base_speed_rpm=3000, top_speed_rpm=10000, efficiency=0.8,
    motor_efficiency=0.7,
    no_load_W=(20.0, 0.5),
)  # fmt: skip
RATES = CostRates(currency="EUR", labour_per_h=36.0, energy_per_kWh=0.5, tool_change_min=2.0)
ENERGY = EnergyParameters(base_load_kW=1.5, drives_kW=0.4, coolant_kW=0.8)
MATERIAL = Material(
    name="A6061", group=22, iso="N", k_c11=800, m_c=0.25, radial=0.5, source="made up",
    ratio_source="made up", taylor={"carbide": Taylor(n=0.25, C_m_min=500.0)},
)  # fmt: skip
TWO_TOOLS = SLOT.replace(
    "M30", "M8\nT2 M6\nG0 X-10 Y10 S8000 M3\nG1 Z-2 F300\nX70\nM9\nG4 P5000\nM30"
)
MODES = [
    Mode(direction="x", natural_frequency_Hz=900, damping=0.03, stiffness_N_m=12e6),
    Mode(direction="y", natural_frequency_Hz=1000, damping=0.03, stiffness_N_m=10e6),
]


@pytest.fixture(scope="module")
def cut():
    return cut_of(TWO_TOOLS)


BARE = Material(
    name="X", group=22, iso="N", k_c11=800, m_c=0.2, radial=0.3, source="-", ratio_source="-"
)


def document(cut, **changes):
    law = ToolCoefficients(law=LAW, kind="catalogue", source="made up")
    basis = {"stock": "box", "table": "made up", "material": MATERIAL,
             "coefficients": {1: law, 2: law}, "rates": RATES, "energy": ENERGY,
             "drive": DRIVE}  # fmt: skip
    return document_of(cut, CutBasis(**(basis | changes)))


def test_the_drive_is_asked_for_the_cut_and_for_turning(cut):
    blocks = cut_blocks(cut)
    limits = cut_limits(cut, blocks, limit_load=None, drive=DRIVE, margin=None)
    n = blocks.spindle_speed / 60
    asked = (blocks.torque * 2 * np.pi * n + 20 + 0.5 * n) / 0.8
    assert limits.drive == pytest.approx(asked / 400)
    assert (limits.binds == "spindle drive").all()
    warned = [w.what for w in document(cut).warnings]
    assert any("drive cannot" in what for what in warned) == (limits.drive > 1).any()


def test_a_spindle_cannot_turn_faster_than_its_top_speed(cut):
    slow = SpindleDrive(rated_power_kW=50.0, base_speed_rpm=1500, top_speed_rpm=7000)
    found = document(cut, drive=slow)
    (warning,) = [w for w in found.warnings if "drive" in w.what]
    assert warning.lines == (11,) and warning.grave  # the slot of T2 at 8000 rev/min
    assert warning.what.startswith("8000 rev/min is above the top speed 7000")


def test_deflection_is_that_of_a_cantilever(cut):
    blocks = cut_blocks(cut)
    found = cut_limits(cut, blocks, limit_load=None, drive=None, margin=None).deflection
    stiffness = 3 * 600e9 * np.pi * (0.8 * 0.01) ** 4 / 64 / 0.03**3
    assert found[0] == pytest.approx(blocks.peak[0] / stiffness)


def test_what_binds_is_what_is_used_most(cut):
    blocks = cut_blocks(cut)
    margin = np.full(len(cut.plan.path.moves), np.inf)
    margin[blocks.row] = [-0.5, 4.0]  # twice the depth that is stable, a fifth of it
    found = cut_limits(cut, blocks, limit_load=2 * blocks.peak[1], drive=None, margin=margin)
    assert found.binds.tolist() == ["stability", "load limit"]
    assert found.used == pytest.approx([2.0, 0.5])


def test_life_is_time_over_taylors(cut):
    blocks = cut_blocks(cut)
    found = document(cut).blocks
    for block, seconds, tool, turns in zip(
        found, blocks.seconds, (TEN, SIX), (6000, 8000), strict=True
    ):
        v_c = np.pi * tool.diameter_mm * 1e-3 * turns
        life = 60 * (500 / v_c) ** 4
        assert block.tool_life_share == pytest.approx(seconds / life, rel=1e-5)


def test_the_cost_of_the_part_is_the_sum_of_its_causes(cut):
    found = document(cut)
    total, plan = found.summary, cut.plan
    worn = sum(
        block.tool_life_share * (price + 2 * 60 * 36 / 3600)
        for block, price in zip(found.blocks, (10.0, 20.0), strict=True)
    )
    assert total.cost.time == pytest.approx(plan.total * 36 / 3600, rel=1e-5)
    assert total.cost.tools == pytest.approx(worn, rel=1e-5)
    assert total.cost.energy == pytest.approx(total.energy_kWh * 0.5, rel=1e-5)
    parts = total.cost.time + total.cost.tools + total.cost.energy
    assert total.cost.sum == pytest.approx(parts, rel=1e-5)
    outside = plan.time[plan.path.moves.tool < 0].sum() * 36 / 3600
    by_tool = sum(row.cost.time for row in found.by_tool)
    assert by_tool + outside == pytest.approx(total.cost.time, rel=1e-5)


def test_energy_is_that_of_spindle_drives_coolant_and_standing_by(cut):
    plan, blocks = cut.plan, cut_blocks(cut)
    moves = plan.path.moves
    turning = plan.time * (moves.direction != 0)
    spindle = (
        (blocks.mean_power * blocks.seconds).sum()
        + (turning * (20 + 0.5 * plan.spindle_speed / 60)).sum()
    ) / (0.8 * 0.7)
    coolant_on = (moves.line >= 7) & (moves.line < 12)
    joule = (
        spindle + 1500 * plan.total + 400 * plan.motion.time.sum()
        + 800 * plan.time[coolant_on].sum()
    )  # fmt: skip
    found = document(cut).summary.energy_kWh
    assert found == pytest.approx(joule / 3.6e6, rel=1e-5)


def test_what_is_not_known_is_no_number(cut):
    found = document(cut, material=BARE, drive=None, energy=None, rates=None)
    total = found.summary
    unknown = ("tool_life_share", "energy_kWh", "cost", "drive_share", "stability_margin")
    assert all(getattr(total, key) is None for key in unknown)
    words = " ".join(f"{one.what}: {one.why}" for one in found.not_known)
    for word in ("drive", "stability", "cost", "energy", "tool life of T1, T2"):
        assert word in words


def test_a_cost_without_tool_life_has_no_sum(cut):
    cost = document(cut, material=BARE).summary.cost
    assert cost.sum is None and cost.tools is None and cost.time > 0


def test_the_margin_of_a_slot_is_that_of_its_cut(cut):
    """A slot's arc lies on marks: only what rounding may cost is between them, and 0.3 %."""
    blocks = cut_blocks(cut)
    found = stability(cut, blocks, TipDynamics(source="made up", every=MODES))
    slot = regenerative_cut(LAW, TEN, entry=0.0, exit=np.pi, feed_direction=0.0)
    exact = ROUNDED * depth_limits(MODES, slot, [100.0], highest=8e-3).depth_limit[0] / 2e-3
    assert found.margin[blocks.row[0]] + 1 == pytest.approx(exact, rel=3e-3)


def test_the_axial_coefficient_of_a_law_counts_for_stability():
    """A ball's axial force has a part in the plane; all three rise with the chip alike."""
    law = ForceLaw.kienzle(k_c11=800.0, m_c=0.25, radial=0.5, axial=0.3)
    one = linearised(law, 5e-5)
    assert one.K_rc / one.K_tc == pytest.approx(0.5)
    assert one.K_ac / one.K_tc == pytest.approx(0.3)


@pytest.mark.parametrize(("frequency", "said"), [(900.0, False), (3000.0, True)])
def test_process_damping_is_named_where_waves_are_short(cut, frequency: float, said: bool):
    """10 mm at 6000 rev/min: 3.14 m/s, 3.5 mm of wave at 900 Hz and 1.05 mm at 3000 Hz."""
    soft = (Mode(direction="x", natural_frequency_Hz=frequency, damping=0.03, stiffness_N_m=1e6),)
    tips = TipDynamics(source="made up", every=soft)
    words = " ".join(one.what for one in document(cut, dynamics=tips).warnings)
    assert ("process damping" in words) == said
    assert "chatter" in words


def test_points_above_the_lobes_are_those_that_chatter(cut):
    found = stability(cut, cut_blocks(cut), TipDynamics(source="made up", every=MODES))
    found_lobes = stability_lobes(cut, found)
    assert [one.tool for one in found_lobes] == [1, 2]
    for one in found_lobes:
        limit = np.array([np.inf if v is None else v for v in one.depth_limit_mm])
        for point in one.points:
            cell = np.argmin(np.abs(np.array(one.speeds_rpm) - point.speed_rpm))
            assert (point.axial_depth_mm > limit[cell]) == (point.margin < 0)


def test_tools_without_dynamics_are_not_judged(cut):
    blocks = cut_blocks(cut)
    known = TipDynamics(source="made up", tools={2: MODES})
    found = stability(cut, blocks, known)
    assert np.isnan(found.margin[blocks.row[0]]) and np.isfinite(found.margin[blocks.row[1]])
    assert stability(cut, blocks, TipDynamics(source="-", tools={9: MODES})) is None


def test_chatter_of_dynamics_that_nobody_measured_is_no_verdict(cut):
    soft = [Mode(direction=d, natural_frequency_Hz=700, damping=0.02, stiffness_N_m=1e6)
            for d in ("x", "y")]  # fmt: skip
    for measured, what in ((True, "blocks chatter"), (False, "blocks may chatter")):
        tips = TipDynamics(source="made up", every=soft, measured=measured)
        (found,) = [w for w in document(cut, dynamics=tips).warnings if "chatter" in w.what]
        assert found.what == what and found.grave == measured


def test_lines_of_warnings_are_those_of_the_program(cut):
    peak = cut_blocks(cut).peak
    found = document(cut, limit_load=float(peak.min() + peak.max()) / 2)
    (over,) = [w for w in found.warnings if "load" in w.what]
    expected = cut_blocks(cut).line[peak > (peak.min() + peak.max()) / 2]
    assert over.lines == tuple(expected.tolist()) and over.grave


def test_cuts_below_the_blank_and_beyond_the_flutes_are_said():
    short = {1: type(TEN)(kind="flat", diameter_mm=10.0, flutes=2, flute_length_mm=8.0)}
    cut = cut_of(SLOT.replace("Z-2.0", "Z-11"), tools=short)
    words = [w.what for w in document(cut).warnings]
    assert any("underside" in what for what in words) and any("flutes" in what for what in words)


@pytest.mark.parametrize(("changes", "said"), [
    ({}, True), ({"helix_deg": 30.0}, True), ({"helix_deg": -30.0}, False),
    ({"role": "tap"}, False),
])  # fmt: skip
def test_a_right_hand_tool_that_m4_turns_is_said(changes, said: bool):
    backwards = cut_of(SLOT.replace("M3", "M4"), tools={1: replace(TEN, **changes)})
    found = [w for w in document(backwards).warnings if "M4" in w.what]
    assert [w.lines for w in found] == [(5,)] * said
    forwards = cut_of(SLOT, tools={1: replace(TEN, **changes)})
    assert not any("M4" in w.what for w in document(forwards).warnings)


def found_cut(**coefficients: Parameter):
    """An identified cut of a tool of 10 mm in A6061; values as a machinist writes them."""
    model = cutting_files.model({"": coefficients})
    return replace(model, material="A6061", tool={"kind": "flat", "diameter_mm": 10.0, "flutes": 2})


NOT_DETERMINED = replace(cutting_files.parameter(90.0, "N/mm^2"), determined=False)
FOUND = found_cut(
    K_tc=cutting_files.parameter(700.0, "N/mm^2"),
    K_rc=cutting_files.parameter(250.0, "N/mm^2"),
    K_te=cutting_files.parameter(12.0, "N/mm"),
    K_ac=NOT_DETERMINED,
)


class TestLaws:
    """Which force law a tool gets."""

    def test_an_identified_law_holds_for_its_tool_in_its_material(self):
        identified = identified_coefficients(FOUND)
        laws = tool_coefficients({1: TEN, 2: SIX}, "A6061", MATERIAL, identified)
        assert (laws[1].kind, laws[2].kind) == ("identified", "catalogue")
        assert laws[1].law.K_tc == 700e6 and laws[1].law.K_te == 12e3
        assert laws[1].law.K_ac == 0  # not determined is no number
        assert laws[2].law == MATERIAL.force_law() and "20 to 30 %" in laws[2].caution

    def test_it_does_not_hold_in_another_material(self):
        laws = tool_coefficients({1: TEN}, "steel", MATERIAL.__class__(**{
            **{f: getattr(MATERIAL, f) for f in MATERIAL.__dataclass_fields__}, "name": "steel",
        }), identified_coefficients(FOUND))  # fmt: skip
        assert laws[1].kind == "catalogue"

    @pytest.mark.parametrize("coefficients", [
        {}, {"K_rc": cutting_files.parameter(250.0, "N/mm^2")},
        {"K_tc": cutting_files.parameter(None, "N/mm^2")}, {"K_tc": NOT_DETERMINED},
    ], ids=["none", "another", "without a value", "not determined"])  # fmt: skip
    def test_what_was_not_determined_is_no_law(self, coefficients):
        assert identified_coefficients(found_cut(**coefficients)) is None

    def test_a_machine_without_an_identified_cut_has_no_law(self):
        assert identified_coefficients(None) is None
