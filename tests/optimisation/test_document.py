"""The document of an optimisation and its tables: restated from its cuts, F, S, tool and depths."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.app.optimise import optimise_lines
from pipeline.cutting.engagement.stock import stock_of
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.optimisation.comparison import Side, exceeded_limits, load_trace
from pipeline.optimisation.document import optimised_text
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.methods.feeds import feed_bounds
from pipeline.optimisation.methods.genes import Method
from pipeline.optimisation.optimise import ANSWER, DIRECT, optimise
from pipeline.optimisation.part_sheet import path_trace
from pipeline.optimisation.problem.arrays import Decision
from pipeline.optimisation.proof.prove import prove
from pipeline.optimisation.settings import OptimisationSettings, SearchSettings
from pipeline.report.optimised.changes import feeds_table, loads_table
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.store import structured
from pipeline.twin.cut.document import assessed
from pipeline.twin.cut.tables import block_rows
from tests.optimisation.paper_part import PROGRAM, STOCK, paper_job
from tests.optimisation.several_tools import QUICK as SMALL
from tests.optimisation.several_tools import document as part_of

QUICK = replace(SMALL, proof_comment=True)


@pytest.fixture(scope="module")
def result() -> Result:
    return optimise(paper_job("time", settings=QUICK))


@pytest.fixture(scope="module")
def part(result: Result) -> OptimisedPart:
    return part_of(result)


@pytest.fixture(scope="module")
def document(part: OptimisedPart) -> dict:
    return part_values(part)


def test_what_is_stored_is_read_as_the_same_part(part: OptimisedPart, document: dict) -> None:
    text = json.dumps(document, allow_nan=False)
    assert structured(json.loads(text), OptimisedPart, "$") == part
    assert "deflection_um" not in document["limits"]  # not given


def test_the_unit_of_a_machine_is_named_where_there_are_several(document: dict) -> None:
    assert "machine_unit" not in document
    part = structured({**document, "machine_unit": "hurco04"}, OptimisedPart, "$")
    assert part_values(part)["machine_unit"] == "hurco04"
    assert "  on unit hurco04; --unit names another one" in list(optimise_lines(part))


def test_the_answer_among_the_methods_is_what_is_written(document: dict) -> None:
    """The search's own evaluation against the plan of the text, on another way."""
    answer = next(one for one in document["methods"] if one["method"] == "answer")
    for key in ("time_s", "cost", "energy_kWh", "tool_life_share"):
        told = document["after"][key]  # six digits
        assert answer[key] == (None if told is None else pytest.approx(told, rel=1e-5))
    assert answer["time_s"] is not None and answer["cost"] is not None


def test_rows_that_were_added_count_to_the_row_they_stand_before(result: Result) -> None:
    cut = result.answer.cut
    side = Side.of_rows(cut, assessed(cut, result.job.basis), result.answer.rows)
    assert len(cut.plan.time) >= len(side.time) == len(result.moves)
    assert side.time.sum() == pytest.approx(cut.plan.total, rel=1e-12)
    for row, own in enumerate(result.answer.rows.tolist()):
        first = 0 if row == 0 else int(result.answer.rows[row - 1]) + 1
        last = own if row < len(side.time) - 1 else len(cut.plan.time) - 1
        assert side.time[row] == pytest.approx(cut.plan.time[first : last + 1].sum(), rel=1e-12)


def test_groups_hold_every_block_once_in_order(result: Result, document: dict) -> None:
    groups, problem = document["groups"], result.problem
    decision = result.answer.decision
    held = np.flatnonzero((decision.groups.feed >= 0) | problem.cuts)
    spent = sum(g["time_before_s"] for g in groups)
    assert spent == pytest.approx(result.before.plan.time[held].sum(), rel=1e-4)  # six digits
    lines = [(g["first_line"], g["last_line"]) for g in groups]
    assert all(a <= b for a, b in lines)
    assert [a for a, _ in lines] == sorted(a for a, _ in lines)
    inside = {line for a, b in lines for line in range(a, b + 1)}
    assert set(result.moves.line[held].tolist()) <= inside
    changed = [g for g in groups if g["feed_before"] != g["feed_after"]]
    assert changed  # else this proves nothing
    feeds = result.answer.cut.plan.path.moves.feed[result.answer.rows]
    for g in groups:
        rows = held[(result.moves.line[held] >= g["first_line"])
                    & (result.moves.line[held] <= g["last_line"])]  # fmt: skip
        assert feeds[rows].min() <= g["feed_after"] * (1 + 1e-5)
        assert feeds[rows].max() >= g["feed_after"] * (1 - 1e-5)


def test_what_binds_is_counted_over_the_blocks_that_cut(result: Result, document: dict) -> None:
    binding = document["binding"]
    assert sum(row["blocks"] for row in binding) == int(result.problem.cuts.sum())
    cutting = result.before.plan.time[result.problem.cuts].sum()
    assert 0 < sum(row["time_s"] for row in binding) <= document["after"]["time_s"]
    assert cutting > 0


@pytest.mark.parametrize("columns", [7, 60, 900])
def test_columns_of_the_way_hold_the_peak_of_each_station(result: Result, columns: int) -> None:
    """Restated station by station with numbers of Python."""
    cut, found = result.before, result.before.engagement
    pieces = cut.path.pieces
    begin, way = [], 0.0
    for length, fed in zip(pieces.length.tolist(), pieces.feed.tolist(), strict=True):
        begin.append(way)
        way += length if fed else 0.0
    trace = load_trace(cut, columns)
    assert trace.total_mm == pytest.approx(way * 1e3, abs=1e-3)
    peak = cut.station_loads.peak
    for k, load in enumerate(trace.load_N):
        a, b = k * way / columns, (k + 1) * way / columns
        # a station that ends within rounding of a column's edge may count there or not
        sure = [
            peak[s] for s in np.flatnonzero(found.feed).tolist()
            if (start := begin[found.piece[s]] + found.along[s]) < b - 1e-9
            and start + found.length[s] > a + 1e-9
        ]  # fmt: skip
        maybe = [
            peak[s] for s in np.flatnonzero(found.feed).tolist()
            if (start := begin[found.piece[s]] + found.along[s]) < b + 1e-9
            and start + found.length[s] > a - 1e-9
        ]  # fmt: skip
        assert load is not None or not sure
        if load is not None:
            assert max(sure, default=0) * (1 - 1e-3) <= load <= max(maybe) * (1 + 1e-3)


LIMITED = {
    "load_N": lambda b, k: b.peak[k],
    "chip_um": lambda b, k: b.thickness[k] * 1e6,
    "torque_Nm": lambda b, k: b.torque[k],
    "cutting_speed_m_min": lambda b, k: np.pi * 6e-3 * b.spindle_speed[k],
    "speed_rpm": lambda b, k: b.spindle_speed[k],
    "feed_mm_min": lambda b, k: b.feed[k],
    "roughness_um": lambda b, k: b.feed_per_tooth[k] ** 2 / (8 * 3e-3) * 1e6,
}
"""What each limit is of, for a flat end mill of 6 mm without runout."""


@pytest.mark.parametrize("name", sorted(LIMITED))
def test_a_block_passes_what_lies_below_its_value_and_not_what_lies_above(
    result: Result, name: str
) -> None:
    of = assessed(result.before, result.job.basis)

    def exceeded(limit: object) -> np.ndarray:
        limits = replace(CutLimit(), **{name: limit})
        return np.logical_or.reduce([*exceeded_limits(of, limits).values()])

    values = np.array([LIMITED[name](of.results.blocks, k) for k in range(len(of.results.blocks))])
    middle = 0.5 * (values.min() + values.max()) or 1.0
    ranged = name in ("chip_um", "cutting_speed_m_min", "speed_rpm", "feed_mm_min")
    for limit in (0.5 * values.min(), middle, 2 * values.max()):
        if limit <= 0:
            continue
        given = (0.0, float(limit)) if ranged else float(limit)
        found = exceeded(given)
        clear = np.abs(values / limit - 1) > 2e-3  # rounding is none of these
        assert (found[clear] == (values > limit)[clear]).all()
    if ranged and name != "feed_mm_min":
        assert exceeded((2 * float(values.max()), 1e9)).all()


def test_the_proof_stands_in_the_comment_and_the_hash_is_that_of_the_file(
    result: Result, document: dict
) -> None:
    text = optimised_text(result)
    assert document["proof"]["sha256"].upper().encode() in text.upper()
    assert text != result.answer.text
    job = result.job
    again = prove(job.program.data, text, "a", "b", job.setup)
    assert again.same and again.sha256 == document["proof"]["sha256"]
    assert again.after_sha256 == document["proof"]["after_sha256"]
    assert again.before_sha256 == document["proof"]["before_sha256"]


def test_words_are_those_of_the_proof(result: Result, document: dict) -> None:
    """The writer's count against that of the check, which shares no code with it."""
    found = result.proof.differences
    for letter in "FS":
        mine = [one for one in found if one.letter == letter]
        added = sum(one.before is None for one in mine)
        assert document["words"][f"{letter}_added"] == added
        assert document["words"][f"{letter}_changed"] == len(mine) - added


LEAST = replace(QUICK, search=SearchSettings(
    population=4, generations=1, baseline=0, paper_generations=1, front=4
))  # fmt: skip
DIAMETER, FLUTES = 6.0, 2  # mm, of the paper's end mill


def briefly(settings: OptimisationSettings, text: str, **limits: Any) -> Result:
    """The part with another program."""
    job = paper_job("time", settings=settings)
    program = parse_program(text.encode(), "O2023.nc")
    return optimise(replace(
        job, program=program, moves=interpret(program, job.setup),
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
    part = part_of(found)
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
    part = part_of(found)
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
        course, "improve", lambda _, start, *__: SimpleNamespace(decision=start, evaluations=1)
    )

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
