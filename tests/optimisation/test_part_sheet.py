"""Tables of an optimised program: restated by hand from F, S, the tool and the depths."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.cutting.engagement.stock import stock_of
from pipeline.gcode.program import parse_program
from pipeline.optimisation.document import optimised_part
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.methods.feeds import feed_bounds
from pipeline.optimisation.methods.genes import Method
from pipeline.optimisation.optimise import ANSWER, DIRECT, optimise
from pipeline.optimisation.part_sheet import path_trace
from pipeline.optimisation.problem.arrays import Decision
from pipeline.optimisation.settings import OptimisationSettings, ReliabilitySettings, SearchSettings
from pipeline.report.optimised.changes import feeds_table, loads_table
from pipeline.schema.part import OptimisedPart
from pipeline.schema.store import structured
from pipeline.twin.cut.document import assessed
from pipeline.twin.cut.tables import block_rows
from tests.optimisation.paper_part import PROGRAM, STOCK, paper_job

QUICK = OptimisationSettings(
    certainty=ReliabilitySettings(draws=64),
    search=SearchSettings(population=8, generations=3, baseline=50, paper_generations=2, front=8),
)
LEAST = replace(QUICK, search=SearchSettings(
    population=4, generations=1, baseline=0, paper_generations=1, front=4
))  # fmt: skip
DIAMETER, FLUTES = 6.0, 2  # mm, of the paper's end mill


@pytest.fixture(scope="module")
def result() -> Result:
    return optimise(paper_job("time", settings=QUICK))


@pytest.fixture(scope="module")
def part(result: Result) -> OptimisedPart:
    return optimised_part(result, machine="mill", origin="simulated", control="identified")


def briefly(settings: OptimisationSettings, text: str, **limits: Any) -> Result:
    """The part with another program."""
    job = paper_job("time", settings=settings)
    return optimise(replace(
        job, program=parse_program(text.encode(), "O2023.nc"),
        limits=replace(job.limits, **limits),
    ))  # fmt: skip


def words(text: str) -> dict[int, tuple[float, float]]:
    """F and S in force in each line, read with nothing but the letters."""
    feed = speed = 0.0
    found = {}
    for number, line in enumerate(text.splitlines(), 1):
        for letter in "FS":
            _, there, rest = line.partition("(")[0].partition(letter)
            if there:
                value = float(rest.split()[0])
                feed, speed = (value, speed) if letter == "F" else (feed, value)
        found[number] = feed, speed
    return found


@pytest.mark.parametrize(
    ("line", "width", "depth"),
    [
        (12, 6.0, 1.0),  # X6. F300.: a slot as wide as the tool, 1 mm deep
        (28, 6.0, 1.2),  # Y18.5: a slot, 1.2 mm deep
    ],
)
def test_two_blocks_by_hand(result: Result, line: int, width: float, depth: float) -> None:
    """f_z = F / (N S), v_c = pi D S, Q = a_e a_p F, before and after."""
    texts = PROGRAM, result.answer.text.decode()
    for text, cut in zip(texts, (result.before, result.answer.cut), strict=True):
        feed, speed = words(text)[line]
        block = next(
            b for b in block_rows(assessed(cut, result.job.basis).results) if b.line == line
        )
        assert block.reached_feed_mm_min == pytest.approx(feed, rel=1e-6)
        assert block.feed_per_tooth_mm == pytest.approx(feed / (FLUTES * speed), rel=1e-5)
        assert block.cutting_speed_m_min == pytest.approx(
            math.pi * DIAMETER * speed / 1000, rel=1e-5
        )
        assert block.axial_depth_mm == pytest.approx(depth, abs=1e-3)
        assert block.radial_depth_mm == pytest.approx(width, rel=0.01)  # of the height map
        # the block is in the material along its whole length but where axes speed up
        rate = width * depth * feed / 1000  # cm3/min
        assert block.removal_rate_cm3_min == pytest.approx(rate, rel=0.06)


def test_the_lists_hold_the_same_figures_as_the_program(
    part: OptimisedPart, result: Result
) -> None:
    before, after = words(PROGRAM), words(result.answer.text.decode())
    assert part.changes
    for one in part.changes:
        for line in (one.first_line, one.last_line):
            assert (one.feed_before, one.speed_before) == before[line]
            assert (one.feed_after, one.speed_after) == after[line]
        if one.feed_per_tooth_after_mm is not None:
            f_z = one.feed_after / (FLUTES * one.speed_after)
            assert one.feed_per_tooth_after_mm == pytest.approx(f_z, rel=1e-5)
    changed = {n for n in before if before[n] != after[n]}
    listed = {n for one in part.changes for n in range(one.first_line, one.last_line + 1)}
    fed = set(result.moves.line[np.isin(result.moves.kind, (1, 2, 3))].tolist())
    assert changed & fed <= listed <= changed


def test_lines_are_those_of_the_two_texts_and_every_difference_is_among_them(
    part: OptimisedPart, result: Result
) -> None:
    before, after = PROGRAM.split("\n"), result.answer.text.decode().split("\n")
    shown = {line.line: line for line in part.lines}
    for number, (then, now) in enumerate(zip(before, after, strict=True), 1):
        if then != now:
            assert (shown[number].before, shown[number].after) == (then, now)
        elif number in shown:
            assert (shown[number].before, shown[number].after) == (then, None)
    assert len(shown) < len(before)


def test_split_blocks_are_lines_that_were_not_there() -> None:
    settings = replace(LEAST, grouping=replace(LEAST.grouping, split=True, split_gain=0.01))
    out = PROGRAM.replace("G1 X2.\nX-4.\n", "G1 X-30.\n")  # far out of the blank
    found = briefly(settings, out, speed_rpm=(5000.0, 5000.0))
    part = optimised_part(found, machine="mill", origin="simulated", control="identified")
    many = len(found.answer.text.splitlines()) - len(out.splitlines())
    assert part.proof.points == many > 0  # else this proves nothing
    assert sum(line.before is None for line in part.lines) >= many
    text = found.answer.text.decode().split("\n")
    assert all(
        text[line.line - 1] == (line.before if line.after is None else line.after)
        for line in part.lines
    )


def test_a_tool_stands_beside_its_ranges(part: OptimisedPart) -> None:
    use = part.tools[0]
    assert (use.tool, use.kept, use.range_source) == (1, None, "")
    assert use.before.feed_per_tooth_mm == pytest.approx(0.03)  # F300 of 2 teeth at S5000
    assert use.before.cutting_speed_m_min == pytest.approx(94.2478)  # pi 6 mm 5000/min
    assert len(feeds_table(part, []).rows) == len(loads_table(part, []).rows) == 1


def test_a_fast_return_move_does_not_hide_what_rose() -> None:
    """A slot at F150, and a way back along its wall at the F500 that is the greatest allowed."""
    head = PROGRAM[: PROGRAM.index("X6. F300.")]
    text = f"{head}X35. F150.\nG0 Z2.\nY4.1\nG1 Z-1. F400.\nX-4. F500.\nG0 Z2.\nM30\n"
    found = briefly(LEAST, text, load_N=600.0, speed_rpm=(5000.0, 5000.0))
    part = optimised_part(found, machine="mill", origin="simulated", control="identified")
    use = part.tools[0]
    assert use.before.feed_per_tooth_mm == pytest.approx(150 / (2 * 5000), rel=1e-4)
    assert use.after.feed_per_tooth_mm == pytest.approx(500 / (2 * 5000), rel=1e-4)
    assert use.before.peak_load_N == part.before.peak_load_N  # of all its blocks


def test_the_path_is_as_long_as_the_moves_and_lies_in_the_blank(result: Result) -> None:
    cut = result.before
    path = path_trace(cut, stock_of(STOCK))
    points = np.array([path.x_mm, path.y_mm, path.z_mm]).T
    joined = np.ones(len(points), dtype=bool)
    joined[list(path.starts)] = False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)[joined[1:]]
    fed = cut.path.pieces.feed
    assert steps.sum() == pytest.approx(cut.path.pieces.length[fed].sum() * 1e3, rel=2e-3)
    assert (path.blank_low_mm, path.blank_high_mm) == ((0.0, 0.0, -10.0), (31.0, 24.0, 0.0))
    assert tuple(points[0]) == (-4.0, 4.0, 2.0)  # where G1 Z-1. begins
    assert points[:, 2].min() == pytest.approx(-1.2)
    assert sorted(path.column) == list(path.column) and max(path.column) < 900


def test_the_set_up_sheet_is_that_of_the_program(part: OptimisedPart, result: Result) -> None:
    (tool,), (offset,) = part.setup.tools, part.setup.offsets
    assert (tool.tool, tool.diameter_mm, tool.flutes, tool.length_mm) == (1, 6.0, 2, 100.0)
    assert (offset.name, offset.position_mm) == ("G54", (-410.0, -235.0, -470.0))
    with_tool = result.answer.cut.plan.path.moves.tool == 1
    assert tool.time_s == pytest.approx(result.answer.cut.plan.time[with_tool].sum(), rel=1e-5)
    assert 0 < tool.in_material_s < tool.time_s


# methods


def test_no_method_that_passes_the_same_test_is_faster_than_the_answer(part: OptimisedPart) -> None:
    for limits in ("certain", "nominal"):
        rows = [one for one in part.methods if one.limits == limits]
        answer = next(one for one in rows if one.method == ANSWER)
        assert len(rows) == 5 and answer.feasible
        assert all(one.time_s >= answer.time_s for one in rows if one.feasible), limits


def test_the_price_of_certainty_is_a_difference_of_the_table(part: OptimisedPart) -> None:
    sure, nominal = (
        next(one for one in part.methods if (one.method, one.limits) == (DIRECT, limits))
        for limits in ("certain", "nominal")
    )
    assert part.certainty.price.time_s == pytest.approx(sure.time_s - nominal.time_s, abs=1e-3)
    assert part.certainty.price.time_s >= 0


def test_a_baseline_that_passes_the_same_test_faster_becomes_the_answer(
    monkeypatch: pytest.MonkeyPatch, result: Result
) -> None:
    """A search made worse on purpose: its answer has to give way to the better baseline."""
    import pipeline.optimisation.optimise as course

    slow = replace(result.blockwise, feeds=0.7 * result.blockwise.feeds)
    monkeypatch.setattr(course, "blockwise_optimum", lambda *_: slow)
    monkeypatch.setattr(
        course, "improve",
        lambda problem, start, *_: course_improved(problem, start),
    )  # fmt: skip

    def course_improved(problem, start):

        return SimpleNamespace(decision=start, evaluations=1)

    def better(problem, groups, *_):
        found = Method(
            name="better", decision=result.blockwise, violation=0.0, evaluations=1,
            objectives=problem.evaluate_rows(
                result.blockwise.row_feeds[None], result.blockwise.row_speeds[None]
            ).objectives[0],
        )  # fmt: skip
        return [found]

    monkeypatch.setattr(course, "baselines", better)
    found = optimise(paper_job("time", settings=QUICK))
    assert found.answer.kept and found.answer.text == result.answer.text
    assert {one.name: one.kept for one in found.methods if one.limits == "certain"} == {
        "better": True, DIRECT: True, ANSWER: True,
    }  # fmt: skip


def test_what_violates_nothing_lies_within_the_bounds_of_the_blockwise_optimum(
    result: Result,
) -> None:
    """The test of a baseline is that of the answer: no rule of F stands in one of them alone."""
    problem, groups = result.problem, result.blockwise.groups
    rng = np.random.default_rng(7)
    found = 0
    for _ in range(400):
        decision = Decision(
            groups=groups, feeds=result.blockwise.feeds * rng.uniform(0.4, 1.6, groups.feeds),
            speeds=result.blockwise.speeds,
        )  # fmt: skip
        feeds, speeds = decision.row_feeds, decision.row_speeds
        if problem.evaluate_rows(feeds[None], speeds[None]).violation[0] > 0:
            continue
        _, high = feed_bounds(problem, speeds[None])
        free = groups.feed >= 0
        fast = problem.speed(feeds, problem.spindle_speed(speeds))
        most = problem.speed(
            np.minimum(high[0], 1e9), problem.spindle_speed(speeds)
        )  # as fast as axes and arcs allow
        assert (fast[free] <= most[free] * (1 + 1e-6)).all()
        found += 1
    assert found > 3  # else this proves nothing


def test_a_descent_in_air_never_gets_faster(result: Result) -> None:
    """G1 Z-1. F400. from Z2., beside the blank."""
    problem = result.problem
    row = int(np.flatnonzero(result.moves.line == 11)[0])
    assert problem.cut.tool[row] < 0 and problem.ranges.feed_high[row] == 400.0
    feeds, speeds = result.blockwise.row_feeds.copy(), result.blockwise.row_speeds
    assert problem.evaluate_rows(feeds[None], speeds[None]).violation[0] == 0
    feeds[row] = 440.0
    assert problem.evaluate_rows(feeds[None], speeds[None]).violation[0] == pytest.approx(0.1)


def test_the_document_can_be_stored(part: OptimisedPart) -> None:
    from pipeline.schema.part import part_values

    assert (
        structured(json.loads(json.dumps(part_values(part), allow_nan=False)), OptimisedPart, "$")
        == part
    )
