"""What no feed and speed can keep is said in one sentence; what is not computed stays as it is."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.problem.feasible import passed_limit, with_load
from pipeline.schema.limits import CutLimit
from tests.optimisation.problem_parts import (
    DRIVE,
    DYNAMICS,
    NO_MARGINS,
    TEN,
    TOOLS,
    all_editable,
    cut_on,
    own,
    problem_on,
)
from tests.twin.cut_parts import AXIS, SLOT

EDGES = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_te=20.0, K_re=15.0)
SLOTTED = 5  # line of the slot
LOAD = CutLimit(load_N=100.0, margins=NO_MARGINS)


@pytest.fixture(scope="module")
def slot():
    return cut_on(SLOT)


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


def test_edges_that_take_more_than_the_limit_at_any_feed():
    cut = cut_on(SLOT, laws=dict.fromkeys(TOOLS, EDGES))
    with pytest.raises(ValueError, match=r"no feed of T1 keeps the load limit of 40 N: the edges"):
        problem_on(cut, CutLimit(load_N=40.0))


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
    cut = cut_on(SLOT, laws=dict.fromkeys(TOOLS, EDGES))
    least = cut.table.peaks(np.full(len(cut.tool), 1e-12)).max()
    with pytest.raises(ValueError, match=f"the edges alone take more, {least:.4g} N: raise"):
        problem_on(cut, CutLimit(load_N=40.0))
    reach = CutLimit(load_N=20.0, margins=NO_MARGINS, feed_mm_min=(500.0, 600.0))
    with pytest.raises(ValueError, match=r"takes 25 um at least, 68\.\d+ N: widen limits"):
        problem_on(slot, reach)
