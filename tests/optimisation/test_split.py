"""Straight blocks in parts: where, and that the whole is proved to be the same way."""

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.prove import Proof, prove
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from pipeline.optimisation.text.split import split_at, split_blocks, splittable
from pipeline.twin.control import planned_program
from pipeline.twin.cut import CutJob, cut_program
from tests.optimisation.modal_programs import any_answer, modal_program, seeds
from tests.twin.cut_parts import BLOCK, CONTROL, LAW, SIX

SETUP = Setup()


def read(text: str | bytes) -> tuple[Program, Moves]:
    data = text if isinstance(text, bytes) else text.encode("ascii")
    program = Program(data, "P.nc")
    return program, interpret(program, SETUP)


def proof_of(before: str | bytes, after: str | bytes, *, splits: bool = True) -> Proof:
    texts = [t if isinstance(t, bytes) else t.encode("ascii") for t in (before, after)]
    return prove(texts[0], texts[1], "B.nc", "A.nc", SETUP, splits=splits)


def test_points_are_put_in_as_the_program_writes() -> None:
    program, moves = read("N1G20G90S3000M3\nN2G1Z-.1F9.\nN3X3.Y-1.2345F12.\nN4Y0.\n")
    after = split_at(program, moves, {2: [1 / 3, 0.6], 3: [0.25]})
    assert after.decode("ascii") == (
        "N1G20G90S3000M3\nN2G1Z-.1F9.\nG1X1.Y-0.4115F12.\nG1X1.8Y-0.7407F12.\nN3X3.Y-1.2345F12.\n"
        "G1Y-0.9259\nN4Y0.\n"
    )
    proof = proof_of(program.data, after)
    assert proof.same and proof.points == 3
    assert proof.sha256 == proof_of(program.data, program.data).sha256
    assert not proof_of(program.data, after, splits=False).same


@pytest.mark.parametrize("seed", seeds(6, 60))
def test_any_split_with_any_answer_is_proved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program, moves = read(modal_program(rng))
    rows = splittable(program, moves)
    shares = {row: np.sort(rng.uniform(0.05, 0.95, rng.integers(0, 4))).tolist() for row in rows}
    text = split_at(program, moves, shares)
    parts, pieces = read(text)
    assert np.count_nonzero(pieces.kind == Kind.FEED) <= np.count_nonzero(
        moves.kind == Kind.FEED
    ) + sum(map(len, shares.values()))
    editable = editable_blocks(parts, pieces)
    feeds, speeds = any_answer(editable, pieces, rng)
    after = rewrite(parts, pieces, editable, feeds, speeds, SETUP).text
    proof = proof_of(program.data, after)
    assert proof.same, proof.first
    assert proof.sha256 == proof_of(program.data, program.data).sha256
    np.testing.assert_allclose(pieces.length.sum(), moves.length.sum(), rtol=1e-6)


BEFORE = "G21 G90 S3000 M3\nG1 Z-1 F100\nG1 X30 Y10\nG91 G1 X5\nG90 G0 X0\n"
WRONG = {
    "beside the path": ("G1 X30 Y10", "G1 X15.00 Y5.02\nG1 X30 Y10", "beside the path"),
    "behind the end": ("G1 X30 Y10", "G1 X33. Y11.\nG1 X30 Y10", "lies behind"),
    "before the begin": ("G1 X30 Y10", "G1 X-3. Y-1.\nG1 X30 Y10", "lies behind"),
    "backwards": ("G1 X30 Y10", "G1 X15. Y5.\nG1 X12. Y4.\nG1 X30 Y10", "lies behind"),
    "twice the same": ("G1 X30 Y10", "G1 X15. Y5.\nG1 X15. Y5.\nG1 X30 Y10", "lies behind"),
    "under G91": ("G91 G1 X5", "G91 G1 X5\nG1 X-2.0", "not of the block"),
    "before a rapid": ("G90 G0 X0", "G1 X2.\nG90 G0 X0", "not of the block"),
    "at the end": ("G90 G0 X0\n", "G90 G0 X0\nG1 X2.\n", "not of the block"),
    "a coordinate that was changed": ("G1 X30 Y10", "G1 X15. Y5.\nG1 X30 Y11", "Y10 became Y11"),
    "without a point": ("G1 X30 Y10", "G1 X15 Y5\nG1 X30 Y10", "was put in"),
    "with another word": ("G1 X30 Y10", "G1 X15. Y5. M8\nG1 X30 Y10", "was put in"),
    "another code": ("G1 X30 Y10", "G0 X15. Y5.\nG1 X30 Y10", "was put in"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_point_of_the_path_is_found(case: str) -> None:
    old, new, said = WRONG[case]
    proof = proof_of(BEFORE, BEFORE.replace(old, new))
    assert not proof.same and proof.first is not None
    assert said in proof.first.reason


def test_half_of_the_last_decimal_is_let_pass_and_no_more() -> None:
    # y = x / 3: at x = 10.01 it is 3.33667, 3.34 is 0.00333 off
    assert proof_of(BEFORE, BEFORE.replace("G1 X30", "G1 X10.01 Y3.34\nG1 X30")).same
    assert not proof_of(BEFORE, BEFORE.replace("G1 X30", "G1 X10.01 Y3.345\nG1 X30")).same


def test_a_step_in_the_blank_is_where_the_block_is_split() -> None:
    # a slot across takes 2 of the 4 mm away between x = 17 and 23, then a slot goes through it
    text = (
        "T1 M6\nG0 X20 Y-10 S6000 M3\nZ-2\nG1 Y50 F300\nG0 Z5\nX-10 Y20\nZ-4\nG1 X50 F300\n"
        "G0 Z5\nM30\n"
    )
    program, moves = read(text)
    job = CutJob(stock=BLOCK, tools={1: SIX}, force_laws={1: LAW}, resolution=0.25e-3)
    cut = cut_program(planned_program(moves, CONTROL), job)
    after = split_blocks(program, moves, cut, Grouping(split=True))
    put_in = [line for line in after.decode("ascii").splitlines() if line not in text.splitlines()]
    assert proof_of(text, after).same and put_in
    way = [float(line.split()[1][1:]) for line in put_in if "X" in line]
    # the cutter's front meets the slot, and the wall behind it, a radius before its centre does;
    # stations are as fine as three cells of the blank
    for edge in (17.0 - 3.0, 23.0 - 3.0):
        assert min(abs(x - edge) for x in way) < 0.75
    assert all(-1.5 <= x <= 20.75 for x in way)
    # parts that take less than 5 s (25 mm) are none
    coarse = split_blocks(program, moves, cut, Grouping(split=True, least_block_s=5.0))
    assert coarse.decode("ascii") == text


@pytest.mark.parametrize(("line", "splits"), [("/X20 Y5", False), ("/G91", False), ("/M8", True)])
def test_no_path_is_split_that_begins_elsewhere_where_a_line_is_left_out(
    line: str, splits: bool
) -> None:
    text = f"G21 G90\nS3000 M3\nG0 X0 Y0\n{line}\nG1 X50 Y30 F100\nM30\n"
    program, moves = read(text.encode("ascii"))
    assert (len(splittable(program, moves)) > 0) is splits
