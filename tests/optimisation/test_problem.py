"""What counts as inside all limits, what binds, and objectives that are those of one plan."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.tool import tip_deflection
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.machine.control.planner import plan
from pipeline.optimisation.methods.feeds import BlockModel
from pipeline.optimisation.problem.arrays import CONSTRAINTS, Groups
from pipeline.optimisation.problem.feasible import binding_constraints
from pipeline.optimisation.problem.spindle import COARSE, FINE, speed_nodes
from pipeline.schema.limits import CutLimit, Margins
from pipeline.twin.cut.blocks import cut_blocks, cut_limits, station_arcs
from pipeline.twin.cut.document import document_of
from pipeline.twin.cut.stability import stability, table_of
from pipeline.twin.cut.tables import cost_of, electricity, tool_life
from tests.optimisation.problem_parts import (
    DRIVE,
    DYNAMICS,
    MATERIAL,
    NO_MARGINS,
    RATES,
    ROOMY,
    TEN,
    TOOLS,
    TWO_TOOLS,
    all_editable,
    basis_of,
    cut_on,
    own,
    problem_on,
    waiting_control,
)
from tests.twin.cut_parts import CONTROL, SLOT, pocket

LIMITS = CutLimit(
    load_N=300.0, deflection_um=20.0, chip_um=(5.0, 90.0), torque_Nm=2.0, power_share=0.15,
    cutting_speed_m_min=(15.0, 250.0), feed_mm_min=(50.0, 2500.0), speed_rpm=(1000.0, 9500.0),
    margins=NO_MARGINS,
)  # fmt: skip


@pytest.fixture(scope="module")
def cut():
    return cut_on(TWO_TOOLS)


@pytest.fixture(scope="module")
def problem(cut):
    editable = all_editable(cut.plan.path.moves)
    drilled = cut.plan.path.moves.tool == 3  # what keeps F and S is judged when a problem is made
    block = np.where(drilled, -1, editable.block)
    return problem_on(cut, LIMITS, editable=replace(editable, block=block))


def plunges(moves):
    """G1 Z-… beside the blank: F of these is at most as programmed."""
    return (moves.kind == 1) & (moves.start[:, 2] > moves.end[:, 2]) & (moves.tool != 3)


def kept(cut, feeds, speeds):
    """The greatest share of LIMITS that F and S take, by what is judged of their cut."""
    turns = np.where(cut.plan.path.moves.direction == 0, 0.0, speeds)
    path = cut.plan.path
    long = replace(path, acceleration=np.full(len(path), 1e9), corner=np.full(len(path), 1e3))
    blocks = cut_blocks(replace(cut, plan=plan(long, feeds=feeds, speeds=speeds)))
    limits = cut_limits(cut, blocks, limit_load=None, drive=DRIVE, margin=None)
    bends = [tip_deflection(cut.tools[t], p) if cut.tools[t].kind != "drill" else 0.0
             for t, p in zip(blocks.tool, blocks.peak, strict=True)]  # fmt: skip
    v_c = np.pi * turns[blocks.row] * np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    fed = np.isin(path.moves.kind, (1, 2)) & (path.moves.tool != 3)
    faster = (feeds / path.moves.feed)[plunges(path.moves)]
    ratios = [
        blocks.peak / 300.0, np.array(bends) / 20e-6, blocks.thickness / 90e-6,
        5e-6 / blocks.thickness, blocks.torque / 2.0, limits.drive / 0.15, v_c / 250.0, 15.0 / v_c,
        turns[blocks.row] / 9500.0, 1000.0 / turns[blocks.row], feeds[fed] / 2500.0,
        50.0 / feeds[fed], np.where(faster > 1, faster, 0.0),
    ]  # fmt: skip
    return max(float(ratio.max()) for ratio in ratios)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.2, 2.0))
def test_there_is_no_violation_just_inside_all_limits(problem, seed, wide):
    cut, rng = problem.cut, np.random.default_rng(seed)
    moves = cut.plan.path.moves
    drilled = moves.tool == 3
    feeds = moves.feed * np.where(drilled, 1.0, np.exp(rng.uniform(-wide, wide, len(moves))))
    if rng.random() < 0.8:
        feeds = np.where(plunges(moves), np.minimum(feeds, moves.feed), feeds)
    speeds = moves.speed * np.exp(rng.uniform(-0.3, 0.3, len(moves)))
    nearest = kept(cut, feeds, speeds)
    found = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis]).violation[0]
    if abs(nearest - 1) > 5e-3:  # torque's chords lie above its stations'
        assert (found == 0.0) == (nearest < 1)


def test_the_restatement_is_kept_by_some_and_not_by_others(problem):
    """Else the property above would compare nothing."""
    feeds, speeds = own(problem)
    assert kept(problem.cut, feeds, speeds) < 0.995 < 1.005 < kept(problem.cut, 3 * feeds, speeds)


def test_a_row_at_its_greatest_feed_is_inside_and_a_little_more_is_not(cut):
    problem = problem_on(cut, CutLimit(load_N=100.0))
    feeds, speeds = own(problem)
    most = np.where(problem.cuts, problem.bounds.high, 0.0)
    at_limit = most * speeds * problem.flutes * 1e3
    for share, inside in ((1.0, True), (1 + 1e-6, False)):
        asked = np.where(problem.cuts, at_limit * share, feeds)
        violation = problem.evaluate_rows(asked[np.newaxis], speeds[np.newaxis]).violation[0]
        assert (violation == 0.0) == inside
    # every row that cuts passes its bound by a millionth
    assert violation == pytest.approx(problem.cuts.sum() * 1e-6, rel=1e-3)


def test_violation_adds_up_what_passes_limits_as_a_share():
    cut = cut_on(SLOT)
    problem = problem_on(cut, replace(ROOMY, feed_mm_min=(100.0, 400.0), speed_rpm=(1e3, 4e3)))
    feeds, speeds = own(problem)  # a plunge at F300 in air, a slot at F600, both at S6000
    violation = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis]).violation[0]
    assert violation == pytest.approx((600 / 400 - 1) + (6000 / 4000 - 1))  # air may turn so fast
    rows = np.ones((1, len(problem)))
    slow = problem.evaluate_rows(80.0 * rows, 500.0 * rows).violation[0]
    assert slow == pytest.approx(2 * (100 / 80 - 1) + (1000 / 500 - 1))


def test_groups_spread_to_rows(problem):
    moves = problem.cut.plan.path.moves
    groups = Groups(
        feed=problem.editable.block, speed=np.where(problem.editable.speed, 0, -1),
        own_feed=moves.feed, own_speed=moves.speed,
    )  # fmt: skip
    rng = np.random.default_rng(0)
    feeds, speeds = rng.uniform(100, 900, (5, groups.feeds)), rng.uniform(3e3, 9e3, (5, 1))
    by_group = problem.evaluate(groups, feeds, speeds)
    by_row = problem.evaluate_rows(groups.row_feeds(feeds), groups.row_speeds(speeds))
    np.testing.assert_array_equal(by_group.objectives, by_row.objectives)
    np.testing.assert_array_equal(by_group.violation, by_row.violation)


def test_ranges_that_nobody_gave_hold_the_program_and_what_the_machine_can(cut):
    limits = CutLimit(load_N=100.0)
    problem = problem_on(cut, limits)
    fed = problem.editable.block >= 0
    assert set(problem.ranges.feed_low[fed]) == {15.0}  # a tenth of the drill's F150
    down = plunges(cut.plan.path.moves)
    assert set(problem.ranges.feed_high[fed & ~down]) == {10000.0}  # of the axes
    assert set(problem.ranges.feed_high[down]) == {300.0}  # as programmed
    turning = problem.editable.speed
    assert set(problem.ranges.speed_low[turning]) == {100.0}  # of the drive
    assert set(problem.ranges.speed_high) == {10000.0}
    no_drive = problem_on(cut, limits, drive=None)
    assert set(no_drive.ranges.speed_low[turning]) == {1500.0}
    assert set(no_drive.ranges.speed_high[turning]) == {9000.0}
    slow = problem_on(cut_on(TWO_TOOLS, control=waiting_control(maximum_speed=9500.0)), limits)
    assert set(slow.ranges.speed_high) == {9500.0}


def test_tools_have_ranges_of_their_own():
    tools = TOOLS | {1: replace(TEN, cutting_speed_m_min=(60.0, 220.0), top_speed_rpm=6500.0)}
    margins = Margins(cutting_speed=0.1)
    problem = problem_on(cut_on(TWO_TOOLS, tools=tools), CutLimit(load_N=100.0, margins=margins))
    moves, cuts = problem.cut.plan.path.moves, problem.cuts
    mine = cuts & (moves.tool == 1)
    turns = 66.0 / (np.pi * 0.010), 198.0 / (np.pi * 0.010)
    assert problem.ranges.speed_low[mine] == pytest.approx(turns[0])
    assert problem.ranges.speed_high[mine] == pytest.approx(min(turns[1], 6500.0))
    assert set(problem.ranges.speed_high[~mine]) == {10000.0}


def test_feeds_for_each_turn_are_judged_by_the_minute():
    text = SLOT.replace("X70 F600", "G95 X70 F0.1")
    limits = replace(ROOMY, feed_mm_min=(100.0, 500.0), speed_rpm=(100.0, 9e3))
    problem = problem_on(cut_on(text), limits)
    feeds, speeds = own(problem)  # 0.1 mm/rev at S6000: 600 mm/min
    found = [problem.evaluate_rows(feeds[np.newaxis], share * speeds[np.newaxis]).violation[0]
             for share in (1.0, 0.8)]  # fmt: skip
    assert found == [pytest.approx(0.2), 0.0]
    row = problem.blocks.row[-1]
    assert problem.feed_per_tooth(feeds, speeds)[row] == pytest.approx(0.05e-3)


def test_margins_of_stability_are_those_of_the_cuts_own_table(cut):
    """At the speeds of the program and at round ones; between two of these never above both."""
    blocks = cut_blocks(cut)
    own_table = stability(cut, blocks, DYNAMICS)
    problem = problem_on(cut, CutLimit(load_N=100.0), dynamics=DYNAMICS)
    rows = np.flatnonzero(np.isfinite(own_table.margin))
    assert len(rows) == 4  # two passes of each end mill
    margins = problem.chatter.margins(own(problem)[1])
    most = problem.chatter.table.most
    np.testing.assert_allclose(margins[rows], np.minimum(own_table.margin[rows], most), atol=3e-3)
    for speed in (5000.0, 6800.0, 8300.0):
        table, _ = table_of(cut, blocks, DYNAMICS, np.array([speed, speed + 50.0]))
        found = [
            problem.chatter.margins(np.full(len(problem), speed + off))[rows]
            for off in (0.0, 25.1, 50.0)
        ]
        for at in (0, 2):
            exact = table.margins(np.full(len(problem), speed + 25.0 * at))[rows]
            np.testing.assert_allclose(found[at], np.minimum(exact, most), atol=3e-3)
        assert (found[1] <= np.maximum(found[0], found[2]) + 0.02).all()


def test_below_a_tenth_of_the_fastest_the_slowest_limit_counts(cut):
    limits = replace(ROOMY, speed_rpm=(50.0, 9000.0))
    problem = problem_on(cut, limits, dynamics=DYNAMICS)
    slow, least = problem.chatter.margins(np.array([[60.0], [900.0]]) * np.ones(len(problem)))
    np.testing.assert_array_equal(slow, least)


@pytest.mark.parametrize(("low", "high"), [(1000.0, 12_000.0), (333.3, 1471.7), (24e3, 24e3)])
def test_speeds_at_which_limits_are_computed_are_round_and_close(low: float, high: float) -> None:
    nodes = speed_nodes(low, high)
    assert nodes[0] == low and nodes[-1] == high and (np.diff(nodes) > 0).all()
    upper = nodes[:-1] >= FINE * high
    assert (np.diff(nodes)[upper] <= COARSE * nodes[:-1][upper] * 1.05).all()
    assert (np.diff(nodes) <= 2.5 * COARSE * nodes[:-1] * 1.05).all()
    round_ones = np.arange(np.ceil(max(low, 4200) / 50), np.floor(min(high, 8300) / 50) + 1) * 50
    assert np.isin(round_ones, nodes).all()


def test_speeds_that_chatter_are_no_answer(cut):
    limits = replace(ROOMY, margins=Margins(stability=0.3))
    problem = problem_on(cut, limits, dynamics=DYNAMICS)
    speeds = np.linspace(3000, 9000, 61)[:, np.newaxis] * np.ones(len(problem))
    stable = problem.stable(speeds)
    assert stable.shape == (61, len(problem)) and stable.any() and not stable.all()
    feeds = np.tile(own(problem)[0], (61, 1))
    found = problem.evaluate_rows(feeds, speeds).violation
    np.testing.assert_array_equal(found == 0.0, stable.all(axis=1))
    assert problem_on(cut, ROOMY).stable(speeds).all()  # nothing is known


def test_a_change_of_speed_is_none_or_large_enough(cut):
    problem = problem_on(cut, replace(ROOMY, least_speed_change_rpm=200.0))
    feeds, speeds = own(problem)
    line = problem.cut.plan.path.moves.line

    def found(first, then):
        """S of T1 before and from line 8 on."""
        changed = np.where(line < 8, first, np.where(line < 10, then, speeds))
        return problem.evaluate_rows(feeds[np.newaxis], changed[np.newaxis]).violation[0]

    assert found(5000.0, 5000.0) == found(5000.0, 5200.0) == found(5200.0, 5000.0) == 0.0
    assert found(5000.0, 5150.0) == pytest.approx(1 - 150 / 200)
    assert found(7900.0, 7900.0) == 0.0  # T2 turns 8000: another tool


def exact(text: str) -> str:
    """All blocks end at a standstill, so that a wait changes no motion."""
    return text.replace("T1 M6\n", "T1 M6\nG61\n", 1)


@pytest.mark.parametrize("wait", ["at_code", "next_line", "before_cutting"])
def test_an_added_word_is_waited_for_as_if_it_stood_in_the_program(wait):
    control = waiting_control(spindle_wait=wait, speed_change_waits=True)
    problem = problem_on(cut_on(exact(SLOT), control=control))
    moves = problem.cut.plan.path.moves
    speeds = np.where(moves.line >= 6, 7500.0, moves.speed)  # from X70 on
    assert moves.line[problem.blocks.row[-1]] == 6
    found = problem.evaluate_rows(moves.feed[np.newaxis], speeds[np.newaxis]).objectives[0]
    written = cut_on(exact(SLOT).replace("X70", "S7500 X70"), control=control)
    summary = document_of(written, basis_of(written)).summary
    assert found[0] == pytest.approx(written.plan.total, rel=1e-9)
    assert found[[2, 3]] == pytest.approx(
        [summary.energy_kWh, summary.tool_life_share], rel=5e-6
    )  # documents have six digits
    before = problem.evaluate_rows(moves.feed[np.newaxis], moves.speed[np.newaxis]).objectives[0, 0]
    longer = float(problem.speed_changes.time(6000.0, 7500.0))
    # the next line comes after the slot, which takes longer than the spindle
    assert found[0] - before == pytest.approx(0.0 if wait == "next_line" else longer, abs=1e-9)


@pytest.mark.parametrize("wait", ["at_code", "before_cutting"])
def test_an_added_word_stops_a_path_that_runs_on(wait):
    """The check of position and the filters, and what braking to the standstill takes."""
    control = replace(
        waiting_control(spindle_wait=wait, speed_change_waits=True), settle_time=0.2,
        cutting_filter=(0.03, 0.02),
    )  # fmt: skip
    text = SLOT.replace("X70 F600", "X30 F600\nX70")
    problem = problem_on(cut_on(text, control=control))
    moves = problem.cut.plan.path.moves
    speeds = np.where(moves.line >= 6, 7500.0, moves.speed)  # from X70 on
    found = problem.evaluate_rows(moves.feed[np.newaxis], speeds[np.newaxis]).objectives[0, 0]
    written = cut_on(text.replace("X70", "S7500 X70"), control=control).plan.total
    braking = 600 / 60 / 5000  # s, from 600 mm/min and back at 5000 mm/s^2
    assert found == pytest.approx(written - braking, abs=braking)


def test_the_time_of_a_change_has_a_closed_form():
    control = waiting_control(speed_change_waits=True)
    problem = problem_on(cut_on(SLOT, control=control))
    up = (4000 - 2000) / 3000 + (6000**2 - 4000**2) / (2 * 3000 * 4000) + 0.1
    down = (4000 - 2000) / 2500 + (6000**2 - 4000**2) / (2 * 2500 * 4000) + 0.1
    found = problem.speed_changes.time([2000.0, 6000.0, 3000.0], [6000.0, 2000.0, 3000.0])
    np.testing.assert_allclose(found, [up, down, 0.0])
    for other in (CONTROL, waiting_control(), waiting_control(spindle_wait="none",
                                                             speed_change_waits=True)):  # fmt: skip
        assert problem_on(cut_on(SLOT, control=other)).speed_changes.time(2000.0, 6000.0) == 0.0


@pytest.mark.parametrize(
    ("limits", "feed", "speed", "name"),
    [
        ({"load_N": 110.0}, 1.0, 6000.0, "load limit"),
        ({"deflection_um": 4.0}, 1.0, 6000.0, "deflection"),
        ({"roughness_um": 0.05}, 1.0, 6000.0, "roughness"),
        ({"chip_um": (0.0, 60.0)}, 1.0, 6000.0, "greatest chip"),
        ({"torque_Nm": 0.3}, 1.0, 6000.0, "spindle torque"),
        ({"chip_um": (40.0, 400.0)}, 0.0, 6000.0, "least chip"),
        ({"cutting_speed_m_min": (10.0, 250.0)}, 0.5, 250e3 / np.pi / 10, "cutting speed"),
        ({"speed_rpm": (3000.0, 7000.0)}, 0.5, 7000.0, "spindle speed"),
        ({"speed_rpm": (3000.0, 7000.0)}, 0.5, 5000.0, None),
    ],
)
def test_what_a_row_is_at(limits, feed, speed, name):
    """F between the bounds of f_z: 0 at the least, 1 at the greatest."""
    problem = problem_on(cut_on(SLOT), replace(ROOMY, **limits), drive=None)
    row = problem.blocks.row[-1]
    f_z = problem.bounds.least[row] + feed * (
        min(problem.bounds.high[row], 1e-4) - problem.bounds.least[row]
    )
    feeds = np.full(len(problem), max(f_z, 1e-6) * speed * problem.flutes[row] * 1e3)
    feeds = np.where(problem.cuts, feeds, 100.0)  # air is at no limit
    found = binding_constraints(problem, feeds, np.full(len(problem), speed))
    assert (CONSTRAINTS[found[row]] if found[row] >= 0 else None) == name
    assert (found[~problem.cuts] == -1).all()


def test_a_row_at_the_ends_of_both_f_and_s_is_at_that_of_f():
    """Another S would not make it faster."""
    limits = replace(ROOMY, speed_rpm=(3000.0, 7000.0), feed_mm_min=(1.0, 700.0))
    problem = problem_on(cut_on(SLOT), limits, drive=None)
    for speed in (3000.0, 7000.0):
        found = binding_constraints(
            problem, np.full(len(problem), 700.0), np.full(len(problem), speed)
        )
        assert CONSTRAINTS[found[problem.blocks.row[-1]]] == "feed"


def test_a_row_at_the_drives_power_or_torque():
    problem = problem_on(cut_on(SLOT), ROOMY, drive=replace(DRIVE, rated_power_kW=0.5))
    row = problem.blocks.row[-1]
    for speed, name in ((2000.0, "spindle torque"), (6000.0, "spindle power")):
        speeds = np.full(len(problem), speed)
        f_z = problem.power_f_z(speeds)[row]
        feeds = np.where(problem.cuts, f_z * speed * problem.flutes[row] * 1e3, 100.0)
        assert CONSTRAINTS[binding_constraints(problem, feeds, speeds)[row]] == name
        violation = problem.evaluate_rows(feeds[np.newaxis] * [[1.0], [1.001]],
                                          np.tile(speeds, (2, 1))).violation  # fmt: skip
        assert violation[0] == 0.0 < violation[1]


PER_TURN = SLOT.replace("X70 F600", "G95 X30 F0.1\nX70 F0.05\nG94")
S_CURVE = ControlParameters(
    profile="s_curve",
    axes={letter: replace(axis, jerk=50_000.0) for letter, axis in CONTROL.axes.items()},
)
PROGRAMS = {
    "two tools, drilling, dwell, S in between": (TWO_TOOLS, CONTROL),
    "pocket": (pocket(), CONTROL),
    "feed for each turn": (PER_TURN, CONTROL),
    "waits at the code": (TWO_TOOLS, waiting_control(speed_change_waits=True)),
    "waits before cutting": (TWO_TOOLS, waiting_control(spindle_wait="before_cutting")),
    "waits for the next line": (
        TWO_TOOLS, waiting_control(spindle_wait="next_line", speed_change_waits=True),
    ),
    "jerk limited": (TWO_TOOLS, S_CURVE),
}  # fmt: skip


@pytest.fixture(scope="module", params=PROGRAMS)
def planned(request):
    text, control = PROGRAMS[request.param]
    return cut_on(text, control=control)


def stretches(cut, seed: int, many: int):
    """F of rows as chance has it; S as the program changes it, by other amounts."""
    moves, rng = cut.plan.path.moves, np.random.default_rng(seed)
    feeds = moves.feed * rng.uniform(0.3, 3.0, (many, len(moves)))
    of_row = np.cumsum(np.diff(moves.speed, prepend=0.0) != 0)
    speeds = moves.speed * rng.uniform(0.7, 1.4, (many, of_row.max() + 1))[:, of_row]
    return feeds, speeds


def own_objectives(cut, basis):
    """The four objectives of a cut's own plan, as its document sums them, unrounded."""
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    life = tool_life(cut, blocks, arcs, basis.material)
    used = electricity(cut, blocks, basis.energy, basis.drive)
    cost = cost_of(cut, basis.rates, life.wear, used)
    return cut.plan.total, cost.total, used.total, life.wear.sum()


def test_a_population_costs_what_its_plans_cost(planned):
    problem, basis = problem_on(planned), basis_of(planned)
    feeds, speeds = stretches(planned, 1, 4)
    found = problem.evaluate_rows(feeds, speeds).objectives
    for objectives, feed, speed in zip(found, feeds, speeds, strict=True):
        other = replace(planned, plan=plan(planned.plan.path, feeds=feed, speeds=speed))
        np.testing.assert_allclose(objectives, own_objectives(other, basis), rtol=1e-9)


def test_the_program_itself_costs_what_its_document_says(planned):
    """Documents have six digits."""
    feeds, speeds = own(problem := problem_on(planned))
    objectives = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis]).objectives[0]
    summary = document_of(planned, basis_of(planned)).summary
    said = [summary.time_s, summary.cost.sum, summary.energy_kWh]
    np.testing.assert_allclose(objectives, [*said, summary.tool_life_share], rtol=5e-6)


def test_what_is_not_known_is_no_number():
    cut = cut_on(SLOT)
    feeds, speeds = (one[np.newaxis] for one in own(problem_on(cut)))
    known = problem_on(cut).evaluate_rows(feeds, speeds).objectives[0]

    def found(**basis):
        return problem_on(cut, **basis).evaluate_rows(feeds, speeds).objectives[0]

    no_drive = found(drive=None)
    assert np.isnan(no_drive[2]) and np.isfinite(no_drive[[0, 1, 3]]).all()
    assert no_drive[1] == pytest.approx(known[1] - known[2] * RATES.energy_per_kWh)
    np.testing.assert_array_equal(found(energy=None), no_drive)
    assert np.isnan(found(rates=None)).tolist() == [False, True, False, False]
    no_life = found(material=replace(MATERIAL, taylor={}))
    assert np.isnan(no_life).tolist() == [False, True, False, True]


def test_rows_alone_add_up_to_the_program_where_axes_need_no_time_to_speed_up():
    axis = AxisParameters(
        rapid_speed=20000, cutting_speed=10000, rapid_acceleration=1e12, cutting_acceleration=1e12,
        arc_acceleration=1e12, corner_jump=1e6,
    )  # fmt: skip
    cut = cut_on(TWO_TOOLS, control=ControlParameters(axes=dict.fromkeys("XYZ", axis)))
    problem = problem_on(cut)
    feeds, speeds = stretches(cut, 2, 3)
    rows = BlockModel.alone(problem, "time").demands(feeds, speeds)
    assert rows.shape == (4, 3, len(problem))
    # the dwell counts seconds, and the spindle takes none: what stands still is the same for all
    sums = rows.sum(axis=-1).T
    np.testing.assert_allclose(sums, problem.evaluate_rows(feeds, speeds).objectives, rtol=1e-6)


def test_rows_alone_are_never_slower_than_in_the_program():
    cut = cut_on(pocket())
    problem = problem_on(cut)
    feeds, speeds = stretches(cut, 3, 5)
    alone = BlockModel.alone(problem, "time").values(feeds, speeds).sum(axis=1)
    assert (alone < problem.evaluate_rows(feeds, speeds).objectives[:, 0]).all()


def test_taylor_between_two_speeds():
    """V T^n = C: in blocks at one feed for each tooth wear goes with V^(1/n - 1)."""
    cut = cut_on(SLOT)
    problem = problem_on(cut, material=replace(MATERIAL, taylor={
        "carbide": replace(MATERIAL.taylor["carbide"], f_z_exponent=0.0, f_z_ref_mm=None)
    }))  # fmt: skip
    feeds, speeds = own(problem)
    row = problem.blocks.row[-1]
    alone = BlockModel.alone(problem, "wear")
    slow, fast = (alone.values(k * feeds[None], k * speeds[None])[0, row] for k in (1.0, 1.5))
    assert fast / slow == pytest.approx(1.5**3, rel=1e-12)


def test_many_at_once_are_as_many_alone():
    """Parts of a population are worked on one after the other."""
    from pipeline.optimisation.problem.problem import AT_ONCE

    cut = cut_on(TWO_TOOLS)
    problem = problem_on(cut, CutLimit(load_N=100.0, margins=NO_MARGINS))
    many = 2 * AT_ONCE // len(problem) + 7
    feeds, speeds = stretches(cut, 4, 3)
    index = np.arange(many) % 3
    found = problem.evaluate_rows(feeds[index], speeds[index])
    few = problem.evaluate_rows(feeds, speeds)
    np.testing.assert_array_equal(found.objectives, few.objectives[index])
    np.testing.assert_array_equal(found.violation, few.violation[index])
    assert problem_on(cut, ROOMY).evaluate_rows(feeds[:0], speeds[:0]).objectives.shape == (0, 4)
