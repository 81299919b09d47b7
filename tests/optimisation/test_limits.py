"""Feed for each tooth that a limit allows, and what no feed and speed can keep, in one sentence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool, tip_deflection
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.planner import plan
from pipeline.optimisation.problem.arrays import CONSTRAINTS
from pipeline.optimisation.problem.feasible import passed_limit, with_load
from pipeline.optimisation.problem.limits import at_hardest_station, feed_for_marks, inverse
from pipeline.schema.limits import CutLimit, Margins
from pipeline.twin.cut.blocks import cut_blocks, cut_limits
from tests.optimisation.problem_parts import (
    DRIVE,
    DYNAMICS,
    NO_MARGINS,
    TOOLS,
    TWO_TOOLS,
    all_editable,
    cut_on,
    own,
    problem_on,
)
from tests.twin.cut_parts import AXIS, DEPTH, K_E, K_T, LAW, SLOT, TEN, pocket

EDGES = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
KIENZLE = ForceLaw.kienzle(k_c11=800.0, m_c=0.25, radial=0.5, axial=0.1)
HELICAL = replace(TEN, helix_deg=30.0)
RUNNING_OUT = replace(TEN, runout_um=12.0, runout_deg=40.0)
KINDS = {
    "edges": (TEN, EDGES), "kienzle": (HELICAL, KIENZLE), "runout": (RUNNING_OUT, EDGES),
    "ball": (replace(TEN, kind="ball"), LAW),
}  # fmt: skip


@pytest.fixture(scope="module")
def slot():
    return cut_on(SLOT)


@pytest.fixture(scope="module")
def cuts():
    return {
        name: cut_on(pocket(), tools={1: tool}, laws={1: law})
        for name, (tool, law) in KINDS.items()
    }


def test_feed_of_a_slot_has_a_closed_form(slot):
    """K_t d f_z sqrt(1 + K_e^2) = limit; without edge forces chords of the table are exact."""
    problem = problem_on(slot, CutLimit(load_N=80.0, margins=NO_MARGINS))
    closed = 80.0 / (K_T * DEPTH * 1e-3 * np.sqrt(1 + K_E**2))
    found = problem.bounds.high[problem.blocks.row[-1]]
    # teeth stand 1.25 degrees apart: the peak between them is missed, 1 - cos(0.6 deg) at most
    assert closed * (1 - 1e-6) <= found <= closed / np.cos(np.radians(0.63))
    assert CONSTRAINTS[problem.bounds.binds[problem.blocks.row[-1]]] == "load limit"


def test_a_range_of_feeds_from_nothing_on_begins_where_none_does(slot):
    """At a tenth of the program's least F: a feed of 0 is none."""
    free, own = (
        problem_on(slot, CutLimit(load_N=80.0, feed_mm_min=(least, 1e4))).ranges.feed_low
        for least in (0.0, 0.1 * slot.plan.path.moves.feed[slot.plan.path.moves.feed > 0].min())
    )
    assert free.max() > 0 and (free == own).all()


def test_chords_of_the_table_lie_above_and_feeds_below():
    """With edge forces F = sqrt((K_t h + K_te)^2 + (K_r h + K_re)^2) d, and chords add to it."""
    problem = problem_on(cut_on(SLOT, laws=dict.fromkeys((1, 2, 3), EDGES)),
                         CutLimit(load_N=150.0, margins=NO_MARGINS))  # fmt: skip
    found = float(problem.bounds.high[problem.blocks.row[-1]])
    d, scan = DEPTH * 1e-3, np.linspace(0, 2e-4, 400_001)
    peak = d * np.hypot(800e6 * scan + 20e3, 300e6 * scan + 15e3)
    closed = scan[np.searchsorted(peak, 150.0)]
    assert 0.993 * closed <= found <= closed * 1.0005  # 0.6 % of the load; the missed peak


@pytest.mark.parametrize("kind", KINDS)
@given(share=st.floats(0.05, 2.5))
@settings(max_examples=25)
def test_the_inverse_is_the_first_feed_at_which_the_table_passes_the_limit(cuts, kind, share):
    cut = cuts[kind]
    rows = cut_blocks(cut).row
    limit = share * float(cut.block_loads.peak[rows].max())
    found = inverse(cut, cut.table.values[0], limit)[rows]
    feeds = np.linspace(0, 3e-4, 3001)[1:, np.newaxis] * np.ones(len(cut.tool))
    peaks = cut.table.peaks(feeds)[:, rows]
    below = feeds[:, rows] <= found * (1 - 1e-9)
    assert (np.where(below, peaks, 0.0) <= limit * (1 + 1e-9)).all()
    over = np.zeros(len(cut.tool))
    over[rows] = np.where(np.isfinite(found), found, 1.0) * (1 + 1e-7) + 1e-12
    passes = cut.table.peaks(over)[rows] > limit
    assert passes[np.isfinite(found)].all()


def at(problem, f_z, speed=5000.0):
    """The cut of the same program at that feed for each tooth, however high, and its blocks."""
    cut = problem.cut
    known = problem.cuts & (f_z > 0) & np.isfinite(f_z)
    feeds = np.where(known, np.where(known, f_z, 0.0) * speed * problem.flutes * 1e3, 600.0)
    path = replace(cut.plan.path, cap=np.full(len(problem), 1e3), corner=np.full(len(problem), 1e3),
                   acceleration=np.full(len(problem), 1e9))  # fmt: skip
    turns = np.full(len(problem), speed)
    other = replace(cut, plan=plan(path, feeds=feeds, speeds=turns))
    return other, cut_blocks(other)


def deflection(cut, blocks):
    found = [tip_deflection(cut.tools[tool], peak) for tool, peak in zip(blocks.tool, blocks.peak,
                                                                        strict=True)]  # fmt: skip
    return np.array(found)


@pytest.mark.parametrize(
    ("limit", "value", "name"),
    [
        ({"load_N": 90.0}, lambda _, b: b.peak / 90.0, "load limit"),
        ({"deflection_um": 4.0}, lambda c, b: deflection(c, b) / 4e-6, "deflection"),
        ({"chip_um": (0.0, 30.0)}, lambda _, b: b.thickness / 30e-6, "greatest chip"),
        ({"torque_Nm": 0.8}, lambda _, b: b.torque / 0.8, "spindle torque"),
    ],
)
def test_what_is_judged_of_a_cut_at_the_greatest_feed_is_its_limit(cuts, limit, value, name):
    problem = problem_on(cuts["edges"], CutLimit(**limit, margins=NO_MARGINS))
    level = np.flatnonzero(problem.bounds.binds == CONSTRAINTS.index(name))
    assert len(level) >= 8  # of two rounds
    cut, blocks = at(problem, problem.bounds.high)
    shares = value(cut, blocks)[np.isin(blocks.row, level)]
    # torque: stations change places between nodes, and the chord of the greatest lies above each
    assert shares == pytest.approx(1.0, abs=2e-3 if name == "spindle torque" else 1e-6)
    assert shares.max() <= 1 + 1e-9


def test_margins_lower_what_counts_as_the_limit(cuts):
    kept = Margins(load=0.2)
    with_margin = problem_on(cuts["edges"], CutLimit(load_N=100.0, margins=kept)).bounds.high
    np.testing.assert_array_equal(
        with_margin,
        problem_on(cuts["edges"], CutLimit(load_N=80.0, margins=NO_MARGINS)).bounds.high,
    )


def test_power_at_the_greatest_feed_is_all_that_the_drive_gives(slot):
    """As ``kerf simulate`` tells the drive's share; at the top speed too, nothing above it."""
    drive = replace(DRIVE, rated_power_kW=0.4)
    problem = problem_on(slot, CutLimit(load_N=1e4, margins=NO_MARGINS), drive=drive)
    row = problem.blocks.row[-1]
    for speed in (1500.0, 3000.0, 5000.0, 10000.0):
        allowed = problem.power_f_z(np.full(len(problem), speed))
        cut, blocks = at(problem, allowed, speed)
        found = cut_limits(cut, blocks, limit_load=None, drive=drive, margin=None).drive
        assert found[-1] == pytest.approx(1.0, abs=1e-6)
    assert problem.power_f_z(np.full(len(problem), 10001.0))[row] == 0.0
    air = ~problem.cuts
    assert np.isposinf(problem.power_f_z(np.full(len(problem), 1500.0))[air]).all()


def test_a_share_of_the_drives_power_and_its_margins():
    """Half of the power is that of half a motor; below the base speed torque's margin counts."""
    drive = replace(DRIVE, no_load_W=(0.0,))
    cut = cut_on(SLOT)
    speeds = np.full(len(cut.tool), 2000.0), np.full(len(cut.tool), 6000.0)

    def allowed(drive, **limits):
        problem = problem_on(cut, CutLimit(load_N=1e4, **limits), drive=drive)
        return [problem.power_f_z(speed)[problem.blocks.row] for speed in speeds]

    half = allowed(drive, power_share=0.5, margins=NO_MARGINS)
    smaller = allowed(replace(drive, rated_power_kW=2.5), margins=NO_MARGINS)
    np.testing.assert_allclose(half, smaller, rtol=1e-12)
    slow, fast = allowed(drive, margins=replace(NO_MARGINS, torque=0.5))
    np.testing.assert_allclose(slow, half[0], rtol=1e-12)
    np.testing.assert_allclose(
        fast, allowed(replace(drive, rated_power_kW=5.0), margins=NO_MARGINS)[1], rtol=1e-12
    )


@pytest.mark.parametrize("tool", [TEN, replace(TEN, kind="bull_nose", corner_radius_mm=1.0)])
@given(height_um=st.floats(0.01, 5.0))
def test_feed_marks_are_as_high_as_circles_leave_them(tool, height_um):
    """Circles a feed f apart meet rho - sqrt(rho^2 - f^2 / 4) above their lowest points."""
    rho, height = tool.corner_radius or tool.radius, height_um * 1e-6
    feed = feed_for_marks(tool, height)
    # f^2 / (8 rho) is the first term; the next is height / (2 rho) of it
    assert rho - np.sqrt(rho**2 - feed**2 / 4) == pytest.approx(height, rel=height / rho + 1e-9)


def test_of_a_tool_that_runs_out_one_tooth_leaves_the_marks():
    assert feed_for_marks(RUNNING_OUT, 1e-6) == pytest.approx(feed_for_marks(TEN, 1e-6) / 2)
    drill = Tool(kind="drill", diameter_mm=6.8, flutes=2)
    assert feed_for_marks(drill, 1e-6) == np.inf


def test_a_maker_bounds_feeds_on_both_sides():
    tools = {1: replace(TEN, feed_per_tooth_mm=(0.02, 0.05))}
    problem = problem_on(cut_on(SLOT, tools=tools), CutLimit(margins=replace(NO_MARGINS, chip=0.1)))
    row = problem.blocks.row
    assert problem.bounds.least[row] == pytest.approx(0.022e-3)
    assert problem.bounds.high[row] == pytest.approx(0.045e-3)
    assert {CONSTRAINTS[k] for k in problem.bounds.binds[row]} == {"greatest chip"}


def test_plunges_and_drills_keep_their_feed_until_chips_are_limited():
    """Their load lies along the axis, which the load limit does not see."""
    cut = cut_on(TWO_TOOLS.replace("X-10 Y20", "X10 Y20"))
    problem = problem_on(cut, CutLimit(load_N=80.0))
    kept = problem.bounds.binds == CONSTRAINTS.index("as programmed")
    lines = cut.plan.path.moves.line[kept]
    assert set(lines.tolist()) == {5, 19}  # the plunge of T1, the cycle of the drill
    np.testing.assert_array_equal(problem.bounds.high[kept], cut.commanded_feed_per_tooth()[kept])
    limited = problem_on(cut, CutLimit(load_N=80.0, chip_um=(0.0, 50.0), margins=NO_MARGINS))
    chips = {CONSTRAINTS[k] for k in limited.bounds.binds[kept]}
    assert chips == {"greatest chip"}


def test_the_least_chip_is_asked_only_where_engagement_is_resolved():
    """The pocket's second and third rounds widen it by 4 mm; a round of 0.2 mm is below a cell."""
    text = SLOT.replace("G0 Z5\nM30", "G0 Z5\nY24.8\nX-10\nG1 Z-2\nX70 F600\nG0 Z5\nM30")
    problem = problem_on(cut_on(text), CutLimit(load_N=1e3, chip_um=(5.0, 1e3), margins=NO_MARGINS))
    asked = dict(zip(problem.blocks.line.tolist(), problem.bounds.least[problem.blocks.row],
                     strict=True))  # fmt: skip
    assert asked[5] == pytest.approx(5e-6, rel=1e-3)  # bins of the arc stand 2.5 degrees off 90
    assert asked[10] == 0.0


def test_torque_at_the_hardest_station_is_that_of_the_cut(cuts):
    cut = cuts["kienzle"]
    problem = problem_on(cut)
    found = at_hardest_station(cut, problem.bounds.torque, cut.feed_per_tooth)
    blocks = cut_blocks(cut)
    assert (found[blocks.row] >= blocks.torque * (1 - 1e-12)).all()
    assert found[blocks.row] == pytest.approx(blocks.torque, rel=5e-3)  # chords of 16 nodes


EDGED = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_te=20.0, K_re=15.0)
SLOTTED = 5  # line of the slot
LOAD = CutLimit(load_N=100.0, margins=NO_MARGINS)


def held(cut, *, feed=True, speed=True):
    """Everything as programmed."""
    editable = all_editable(cut.plan.path.moves)
    return replace(
        editable,
        block=np.full(len(editable.block), -1) if feed else editable.block,
        speed=editable.speed & (not speed),
    )


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (CutLimit(), "T1: give limits.load_N or limits.chip_um, or its feed_per_tooth_mm in"),
        (CutLimit(load_N=100.0, chip_um=(50.0, 90.0)),
         "the least chip of T1 needs 50.0. um a tooth, and the load limit of 100 N allows 36.3"),
        (CutLimit(load_N=20.0, margins=NO_MARGINS, feed_mm_min=(500.0, 600.0)),
         "keep the load limit of 20 N: T1 may take 7.27. um a tooth, and takes 25 um at least"),
        (CutLimit(load_N=1e4, chip_um=(90.0, 900.0), margins=NO_MARGINS,
                  feed_mm_min=(100.0, 500.0), speed_rpm=(4e3, 8e3)),
         "make the least chip: T1 needs 90.* um a tooth, and gets 62.5 um at most"),
        (CutLimit(load_N=1e4, cutting_speed_m_min=(400.0, 500.0)),
         "at least 12732.4 rev/min by limits.cutting_speed_m_min, and at most 10000 by the top "
         "speed of the spindle"),
        (CutLimit(load_N=1e4, cutting_speed_m_min=(50.0, 60.0), speed_rpm=(5e3, 6e3)),
         "at least 5000 rev/min by limits.speed_rpm, and at most 1909.86 by limits.cutting_s"),
        (CutLimit(load_N=1e4, speed_rpm=(11e3, 12e3)), r"\[11000, 12000\] begins above the spind"),
        (CutLimit(load_N=1e4, deflection_um=50.0, speed_rpm=(1e3, 6e3), roughness_um=0.1,
                  margins=NO_MARGINS, feed_mm_min=(800.0, 900.0)),
         "keep the roughness of 0.1 um: T1 may take 63.25 um a tooth, and takes 66.67 um at least"),
    ],
)  # fmt: skip
def test_limits_that_no_feed_meets(slot, limits, words):
    with pytest.raises(ValueError, match=words) as error:
        problem_on(slot, limits)
    said = str(error.value)
    assert "\n" not in said and (said.startswith(f"P:{SLOTTED}:") or "limits.speed_rpm" in said)


def test_a_feed_that_certainty_allows_counts_as_the_load_limit(slot):
    f_z = np.full(len(slot.tool), 2e-5)
    problem = problem_on(slot, CutLimit(load_N=1.0), f_z_load=f_z)
    np.testing.assert_array_equal(problem.bounds.high[problem.cuts], 2e-5)
    assert np.isposinf(problem.bounds.high[~problem.cuts]).all()
    with pytest.raises(ValueError, match="no feed of T1 keeps the load limit of 90 N"):
        problem_on(slot, CutLimit(load_N=90.0), f_z_load=0.0 * f_z)


def test_another_load_makes_the_problem_that_would_have_been_made_with_it(slot):
    f_z = np.full(len(slot.tool), 2e-5)
    first = problem_on(slot, LOAD, dynamics=DYNAMICS)
    other, again = with_load(first, f_z), problem_on(slot, LOAD, dynamics=DYNAMICS, f_z_load=f_z)
    np.testing.assert_array_equal(other.bounds.high, again.bounds.high)
    feeds, speeds = (np.tile(one, (2, 1)) * [[1.0], [0.7]] for one in own(first))
    for name in ("objectives", "violation"):
        one, two = (getattr(p.evaluate_rows(feeds, speeds), name) for p in (other, again))
        np.testing.assert_array_equal(one, two)
    assert other.chatter is first.chatter
    with pytest.raises(ValueError, match="no feed of T1 keeps the load limit"):
        with_load(first, 0.0 * f_z)


def test_a_range_of_the_tool_table_is_limit_enough(slot):
    tools = TOOLS | {1: replace(TEN, feed_per_tooth_mm=(0.01, 0.06))}
    assert problem_on(cut_on(SLOT, tools=tools), CutLimit()).bounds.high.min() == pytest.approx(
        6e-5
    )


def test_a_tool_that_stands_still_in_the_material():
    with pytest.raises(ValueError, match="P:5: T1 goes into the material while the spindle stands"):
        problem_on(cut_on(SLOT.replace("S6000 M3", "")), LOAD)


@pytest.mark.parametrize(
    ("limits", "basis", "words"),
    [
        (LOAD, {}, "its F and S cannot be changed, and do not keep the load limit of 100 N: T1"),
        (CutLimit(load_N=1e4, chip_um=(60.0, 1e3)), {}, "do not make the least chip: .*: lower"),
        (CutLimit(load_N=1e4), {"drive": replace(DRIVE, rated_power_kW=0.2)}, "spindle power al"),
        (CutLimit(load_N=1e4, cutting_speed_m_min=(200.0, 300.0)), {}, "its S 6000 cannot be"),
        (CutLimit(load_N=1e4), {"drive": replace(DRIVE, top_speed_rpm=5e3)}, "spindle speed al"),
        (CutLimit(load_N=1e4, margins=replace(NO_MARGINS, stability=0.99)),
         {"dynamics": replace(DYNAMICS, every=tuple(
             replace(mode, stiffness_N_m=1e6) for mode in DYNAMICS.every
         ))}, "stability allows"),
    ],
)  # fmt: skip
def test_rows_that_cannot_be_changed_and_are_beyond_a_limit(slot, limits, basis, words):
    with pytest.raises(ValueError, match=words) as error:
        problem_on(slot, limits, editable=held(slot), **basis)
    assert str(error.value).startswith(f"P:{SLOTTED}:")


def test_ranges_are_those_of_what_is_changed(slot):
    """What keeps its F and S need not lie in the ranges that the others are sought in."""
    limits = CutLimit(load_N=1e4, feed_mm_min=(100.0, 200.0), speed_rpm=(1000.0, 2000.0))
    problem = problem_on(slot, limits, editable=held(slot))
    feeds, speeds = own(problem)
    assert problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis]).violation[0] == 0.0
    assert np.isposinf(problem.ranges.feed_high).all()


def test_speed_alone_may_keep_the_load_of_a_feed_that_is_held(slot):
    """F600 needs S8250 at 100 N; the drive has 10 000."""
    problem = problem_on(slot, LOAD, editable=held(slot, speed=False))
    feeds, speeds = own(problem)
    row = problem.blocks.row[-1]
    needed = 600.0 / (problem.flutes[row] * problem.bounds.high[row] * 1e3)
    assert needed == pytest.approx(8250, rel=1e-3)
    violation = problem.evaluate_rows(
        np.tile(feeds, (2, 1)), np.array([[needed * 1.0001], [needed * 0.9999]]) + 0.0 * speeds
    ).violation
    assert violation[0] == 0.0 < violation[1]


def test_what_is_not_computed_keeps_its_feed_and_speed():
    """A slot with the table turned: nobody knows what it takes."""
    control = ControlParameters(axes={letter: AXIS for letter in "XYZA"})
    text = SLOT.replace("M30", "G0 X-10 Y5\nA90\nG1 Z-2\nX70 F500\nG0 Z5\nM30")
    problem = problem_on(cut_on(text, control=control), LOAD)
    moves = problem.cut.plan.path.moves
    turned = (moves.line == 9) | (moves.line == 10)
    assert problem.cut.path.left_out and not problem.cuts[turned].any()
    for low, high, as_it_is in (
        (problem.ranges.feed_low, problem.ranges.feed_high, moves.feed),
        (problem.ranges.speed_low, problem.ranges.speed_high, moves.speed),
    ):
        np.testing.assert_array_equal(low[turned], as_it_is[turned])
        np.testing.assert_array_equal(high[turned], as_it_is[turned])
    feeds = np.where(turned, 2 * moves.feed, 0.5 * moves.feed)
    found = problem.evaluate_rows(feeds[np.newaxis], moves.speed[np.newaxis]).violation[0]
    assert found == pytest.approx(turned.sum())


def test_a_limit_that_is_passed_names_block_limit_value_and_the_least_possible(slot):
    limits = replace(LOAD, feed_mm_min=(100.0, 1000.0), speed_rpm=(1000.0, 8000.0))
    problem = problem_on(slot, limits, f_z_load=np.full(len(slot.tool), 3e-5))
    feeds, speeds = own(problem)
    assert passed_limit(problem, feeds * 0.5, speeds) is None
    said = str(passed_limit(problem, feeds * 2.0, speeds))
    row = problem.blocks.row[-1]
    here = problem.cut.table.peaks(np.full(len(slot.tool), 1e-4))[row]  # F1200 of two teeth
    assert said.startswith(
        f"P:{SLOTTED}: T1 passes the load limit of 100 N at F1200 S6000, {here:.4g} N with 100 um "
        "a tooth; "
    )
    assert "would keep it, and blocks that share its F or S cannot have that" in said
    assert said.endswith(": raise limits.load_N") and "\n" not in said


def test_a_limit_that_no_feed_of_the_ranges_keeps_says_the_least_possible(slot):
    narrow = replace(LOAD, feed_mm_min=(500.0, 900.0), speed_rpm=(4000.0, 8000.0))
    problem = problem_on(slot, narrow, f_z_load=np.full(len(slot.tool), 4e-5))
    problem = replace(problem, bounds=replace(problem.bounds, most=problem.bounds.most * 0.5))
    feeds, speeds = own(problem)
    said = str(passed_limit(problem, feeds, speeds))
    least = 500.0 / (2 * 8000.0) * 1e3  # F500 of two teeth at 8000 rev/min [um]
    assert f"{least:.4g} um a tooth is the least possible there: raise limits.load_N" in said


def test_a_refusal_of_the_load_says_the_least_load(slot):
    cut = cut_on(SLOT, laws=dict.fromkeys(TOOLS, EDGED))
    least = cut.table.peaks(np.full(len(cut.tool), 1e-12)).max()
    with pytest.raises(ValueError, match=f"the edges alone take more, {least:.4g} N: raise"):
        problem_on(cut, CutLimit(load_N=40.0))
    reach = CutLimit(load_N=20.0, margins=NO_MARGINS, feed_mm_min=(500.0, 600.0))
    with pytest.raises(ValueError, match=r"takes 25 um at least, 68\.\d+ N: widen limits"):
        problem_on(slot, reach)
