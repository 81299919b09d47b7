"""Repeated points, as CAM systems write them: they take no part in an optimisation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.proof.prove import prove
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from pipeline.schema.limits import CutLimit
from tests.optimisation.direct_parts import SIX, problem

LIMITS = CutLimit(load_N=60.0, feed_mm_min=(50, 1000), speed_rpm=(1000, 8000))
FREE = Grouping(least_block_s=0.0, least_gain=0.0, least_speed_gain=0.0)
HEAD = ["T1 M6", "S3000 M3", "G0 X20 Y20 Z5"]
SLOT = [
    ("G1 Z-0.5 F50", (20.0, 20.0, -0.5)),
    ("G1 Z-1", (20.0, 20.0, -1.0)),
    ("G1 X60 F120", (60.0, 20.0, -1.0)),
    ("G3 X70 Y30 I0 J10", (70.0, 30.0, -1.0)),
    ("G1 Y40", (70.0, 40.0, -1.0)),
]
BALL_FINISH = [("G1 Z-0.3 F200", (20.0, 20.0, -0.3))] + [
    (f"G1 X{20 + 2 * k} Z{-0.3 - 0.05 * (k % 3):.2f}", (20.0 + 2 * k, 20.0, -0.3 - 0.05 * (k % 3)))
    for k in range(1, 8)
]
PARTS = {"slot": (SLOT, SIX), "ball finish": (BALL_FINISH, replace(SIX, kind="ball"))}

AGAIN = {
    "absolute": "G1 X{0:g} Y{1:g} Z{2:g}",
    "one axis": "G1 X{0:g}",
    "incremental": "G91 G1 X0 Y0 Z0\nG90",
    "there and back by a thousandth": "G91 G1 X0.001\nG1 X-0.001\nG90",
    "an arc of a thousandth": "G91 G2 X0.001 Y0.001 R0.001\nG1 X-0.001 Y-0.001\nG90",
    "less than what is computed": "G91 G1 X0.0000000001\nG90",
}  # fmt: skip
STILL = ("absolute", "one axis", "incremental")
SHORT = "an arc of a thousandth"


def text(blocks, repeats=()) -> str:
    """The part with a point said again, in some spelling, after some of its blocks."""
    lines = list(HEAD)
    for index, (block, point) in enumerate(blocks):
        lines.append(block)
        lines += [AGAIN[how].format(*point) for at, how in repeats if at == index]
    return "\n".join([*lines, "G0 Z5", "M30", ""])


def best(part: str, tool) -> tuple[float, float]:
    """Violation and time of the blockwise optimum."""
    found = problem(part, LIMITS, tool=tool)
    one = blockwise_optimum(found, "time", FREE)
    made = found.evaluate(one.groups, one.feeds[None], one.speeds[None])
    return float(made.violation[0]), float(made.objectives[0, 0])


@pytest.fixture(scope="module")
def without() -> dict[str, float]:
    """Least time of the parts without a repeated point [s]."""
    return {name: best(text(blocks), tool)[1] for name, (blocks, tool) in PARTS.items()}


@pytest.mark.parametrize(("part", "how"), [
    pytest.param(part, how, marks=() if part == "slot" or how == SHORT else pytest.mark.proof)
    for part in PARTS for how in AGAIN
])  # fmt: skip
def test_a_repeated_point_after_any_block_costs_nothing(part, how, without):
    """A hundredth: a block of a thousandth of a millimetre does stop, and blocks share words."""
    blocks, tool = PARTS[part]
    repeats = [(index, how) for index in range(len(blocks))]
    violation, time = best(text(blocks, repeats), tool)
    assert violation == 0.0
    assert time == pytest.approx(without[part], rel=1e-9 if how in STILL else 1e-2)


@given(
    st.sampled_from(sorted(PARTS)),
    st.lists(st.tuples(st.integers(0, 7), st.sampled_from(STILL)), min_size=1, max_size=6),
)
@settings(max_examples=6, deadline=None)
def test_repeated_points_anywhere_change_no_optimum_and_get_no_word(part, repeats):
    blocks, tool = PARTS[part]
    plain, doubled = (problem(text(blocks, some), LIMITS, tool=tool) for some in ((), repeats))
    decisions = [blockwise_optimum(one, "time", FREE) for one in (plain, doubled)]
    feeds = [
        one.row_feeds[found.cut.plan.path.moving]
        for one, found in zip(decisions, (plain, doubled), strict=True)
    ]
    np.testing.assert_allclose(*feeds, rtol=1e-9)
    program = Program(text(blocks, repeats).encode(), "P.nc")
    moves = interpret(program, Setup())
    editable = editable_blocks(program, moves)
    made = rewrite(
        program, moves, editable, decisions[1].row_feeds, decisions[1].row_speeds, Setup()
    )
    assert prove(program.data, made.text, "P.nc", "Q.nc", Setup()).same
    still = set(moves.line[(moves.end == moves.start).all(axis=1)].tolist())
    assert not {change.line for change in made.changes if change.letter == "F"} & still


def test_a_repeated_point_is_neither_a_block_nor_held() -> None:
    program = Program(b"G21 S3000 M3\nG1 X1 F100\nX1\nX2\n", "P.nc")
    made = editable_blocks(program, interpret(program, Setup()))
    assert made.line.tolist() == [2, 4] and made.held == ()


def test_a_full_circle_ends_where_it_begins_and_is_a_block() -> None:
    program = Program(b"G21 S3000 M3\nG1 X1 F100\nG2 I5\n", "P.nc")
    assert editable_blocks(program, interpret(program, Setup())).line.tolist() == [2, 3]
