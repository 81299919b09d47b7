"""Objectives of a population are those that ``kerf simulate`` tells of one plan."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.machine.control.planner import plan
from pipeline.optimisation.methods.feeds import BlockModel
from pipeline.schema.limits import CutLimit
from pipeline.twin.cut.blocks import cut_blocks, station_arcs
from pipeline.twin.cut.document import document_of
from pipeline.twin.cut.tables import cost_of, electricity, tool_life
from tests.optimisation.problem_parts import (
    MATERIAL,
    NO_MARGINS,
    RATES,
    ROOMY,
    TWO_TOOLS,
    basis_of,
    cut_on,
    own,
    problem_on,
    waiting_control,
)
from tests.twin.cut_parts import CONTROL, SLOT, pocket

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
def cut(request):
    text, control = PROGRAMS[request.param]
    return cut_on(text, control=control)


def stretches(cut, seed: int, many: int):
    """F of rows as chance has it; S as the program changes it, by other amounts."""
    moves, rng = cut.plan.path.moves, np.random.default_rng(seed)
    feeds = moves.feed * rng.uniform(0.3, 3.0, (many, len(moves)))
    of_row = np.cumsum(np.diff(moves.speed, prepend=0.0) != 0)
    speeds = moves.speed * rng.uniform(0.7, 1.4, (many, of_row.max() + 1))[:, of_row]
    return feeds, speeds


def told(cut, basis):
    """The four objectives of a cut's own plan, as its document sums them, unrounded."""
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    life = tool_life(cut, blocks, arcs, basis.material)
    used = electricity(cut, blocks, basis.energy, basis.drive)
    cost = cost_of(cut, basis.rates, life.wear, used)
    return cut.plan.total, cost.total, used.total, life.wear.sum()


def test_a_population_costs_what_its_plans_cost(cut):
    problem, basis = problem_on(cut), basis_of(cut)
    feeds, speeds = stretches(cut, 1, 4)
    found = problem.evaluate_rows(feeds, speeds).objectives
    for objectives, feed, speed in zip(found, feeds, speeds, strict=True):
        other = replace(cut, plan=plan(cut.plan.path, feeds=feed, speeds=speed))
        np.testing.assert_allclose(objectives, told(other, basis), rtol=1e-9)


def test_the_program_itself_costs_what_its_document_says(cut):
    """Documents have six digits."""
    feeds, speeds = own(problem := problem_on(cut))
    objectives = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis]).objectives[0]
    summary = document_of(cut, basis_of(cut)).summary
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
