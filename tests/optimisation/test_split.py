"""Straight blocks in parts: where, and that the whole is proved to be the same way."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.app.tables import read_tools
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.job import Job, job_of
from pipeline.optimisation.optimise import optimise
from pipeline.optimisation.proof.prove import Proof, prove
from pipeline.optimisation.settings import (
    Grouping,
    OptimisationSettings,
    ReliabilitySettings,
    SearchSettings,
)
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from pipeline.optimisation.text.split import split_at, split_blocks, splittable
from pipeline.schema.limits import CutLimit
from pipeline.twin.control import planned_program
from pipeline.twin.cut.loads import CutJob, cut_program
from tests.optimisation.modal_programs import any_answer, modal_program, seeds
from tests.optimisation.several_tools import request_of
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
    split = split_at(program, moves, {2: [1 / 3, 0.6], 3: [0.25]})
    after = split.program.data
    assert after.decode("ascii") == (
        "N1G20G90S3000M3\nN2G1Z-.1F9.\nG1X1.Y-0.4115F12.\nG1X1.8Y-0.7407F12.\nN3X3.Y-1.2345F12.\n"
        "G1Y-0.9259\nN4Y0.\n"
    )
    proof = proof_of(program.data, after)
    assert proof.same and proof.points == 3
    assert proof.sha256 == proof_of(program.data, program.data).sha256
    assert not proof_of(program.data, after, splits=False).same
    assert split.added == (3, 4, 6)
    parts = interpret(split.program, SETUP)
    kept = moves.line[split.whole_rows(parts)] == np.array([1, 1, 2, 3, 3, 3, 4, 4])[-len(parts) :]
    assert kept.all()
    fewer = split.without([3, 6])
    assert fewer.added == (3,)
    assert fewer.program.data == after.replace(b"G1X1.Y-0.4115F12.\n", b"").replace(
        b"G1Y-0.9259\n", b""
    )


def test_points_with_nearly_the_same_feed_on_both_sides_are_none() -> None:
    """F 100 104 108 | 300 | 290 400: what is joined counts from its least to its greatest F."""
    program, moves = read("G21G90S3000M3\nF100.\nG1X60.\n")
    split = split_at(program, moves, {len(moves) - 1: [0.1, 0.3, 0.5, 0.7, 0.9]})
    parts = interpret(split.program, SETUP)
    feeds = np.array([1.0, *([1.0] * (len(parts) - 7)), 100.0, 104.0, 108.0, 300.0, 290.0, 400.0])
    assert split.alike(parts, feeds, 0.05) == [3, 6]
    assert split.alike(parts, feeds, 0.0) == []


@pytest.mark.parametrize("seed", seeds(6, 60))
def test_any_split_with_any_answer_is_proved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program, moves = read(modal_program(rng))
    rows = splittable(program, moves)
    shares = {row: np.sort(rng.uniform(0.05, 0.95, rng.integers(0, 4))).tolist() for row in rows}
    text = split_at(program, moves, shares).program.data
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
}


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


def split_text(text: str, *, in_air: bool = True, **grouping: float) -> list[str]:
    """Lines that are put into a program of the tool of 6 mm."""
    program, moves = read(text)
    job = CutJob(stock=BLOCK, tools={1: SIX}, force_laws={1: LAW}, resolution=0.25e-3)
    cut = cut_program(planned_program(moves, CONTROL), job)
    every = np.ones(len(moves), dtype=np.bool_)
    settings = Grouping(split=True, **grouping)
    split = split_blocks(program, moves, cut, settings, every, every & in_air)
    assert proof_of(text, split.program.data).same
    return [split.program.line(number).text.decode("ascii") for number in split.added]


STEP = (
    "T1 M6\nG0 X17 Y-10 S6000 M3\nZ-2\nG1 Y50 F300\nG0 Z5\nX23 Y-10\nZ-2\nG1 Y50\nG0 Z5\nX-10 Y20\n"
    "Z-4\nG1 X50 F300\nG0 Z5\nM30\n"
)
"""A slot across takes 2 of the 4 mm away between x = 14 and 26, then one goes through it."""


def test_a_step_in_the_blank_is_where_the_block_is_split() -> None:
    """The cutter's front meets the slot, and the wall behind it, a radius before its centre does.

    Stations are as fine as three cells of the blank; until the next one that is lighter by a whole
    step the cut counts as the heavier.
    """
    way = [float(line.split()[1][1:]) for line in split_text(STEP) if "X" in line]
    assert way == pytest.approx([-3.0, 14.0 - 3.0 + 0.5, 26.0 - 3.0], abs=0.75)
    # parts that take less than 5 s (25 mm) are none, the 12 mm of the step among them
    assert split_text(STEP, least_block_s=5.0) == []


def test_an_entry_is_no_part_and_air_only_where_it_may_be() -> None:
    """What is shorter than the tool is wide, as where it enters a block, counts as the heavier."""
    way = [float(line.split()[1][1:]) for line in split_text(STEP, in_air=False) if "X" in line]
    assert way == pytest.approx([14.0 - 3.0 + 0.5, 26.0 - 3.0], abs=0.75)


def job_on(text: str, *, split: bool, **limits: float) -> Job:
    """A program of end mills in C45 with the limits that hold by default."""
    grouping, search = Grouping(split=split), SearchSettings(generations=1, baseline=0)
    settings = OptimisationSettings(
        certainty=ReliabilitySettings(epsilon=0.5, draws=16), grouping=grouping, search=search
    )
    return job_of(request_of(
        text, read_tools("shop").tools, stock="box:-4,104,-4,64,-20,0", settings=settings,
        limits=CutLimit(**limits),
    ))  # fmt: skip


def rows_at(depth: int, length: int, tool: int = 5) -> str:
    """Five slots beside each other from the edge, each a stroke."""
    strokes = "".join(
        f"G0 X-12 Y{y}\nG0 Z-{depth}\nG1 X{length} F500\nG0 Z10\n" for y in (4, 16, 28)
    )
    return f"T{tool} M6\nS4000 M3\nG0 X-12 Y4\nG0 Z10\n{strokes}"


STAIRS = f"G21 G90\n{rows_at(2, 50)}{rows_at(4, 112)}M30\n"
FINISHING = (
    f"G21 G90\n{rows_at(4, 40)}(FINISH)\nG0 X-12 Y-8.8\nG0 Z-4\nG1 X112 F500\nG1 Y60\nG0 Z10\nM30\n"
)
CASES = {
    "stairs at a load limit": (STAIRS, {"load_N": 500.0}, True),
    "stairs by the table alone": (STAIRS, {}, False),
    "a finishing contour": (FINISHING, {}, False),
}


@pytest.mark.parametrize("case", [
    "stairs at a load limit", "a finishing contour",
    pytest.param("stairs by the table alone", marks=pytest.mark.proof),
])  # fmt: skip
def test_splitting_is_never_slower_and_each_point_earns_its_place(case: str) -> None:
    text, limits, gains = CASES[case]
    whole, split = (optimise(job_on(text, split=on, **limits)) for on in (False, True))
    times = [float(one.answer.objectives[0]) for one in (whole, split)]
    points = split.proof.points
    assert whole.split is None and split.split is not None
    assert (points > 0) is gains
    if gains:
        least = Grouping().least_gain * points * times[0]
        assert times[1] < times[0] - least
        assert f"long blocks are split at {points} points, which gains" in split.split
        written = [f.split() for f in split.answer.text.decode().splitlines() if f.startswith("G1")]
        for here, after in pairwise(written):
            if here[1] not in ("X50", "X112"):
                low, high = sorted((float(here[2][1:]), float(after[2][1:])))
                assert high >= 1.05 * low
    else:
        assert times[1] == times[0] and split.answer.text == whole.answer.text
        assert split.split == "splitting long blocks gains nothing: none is split"


@pytest.mark.parametrize(("line", "splits"), [("/X20 Y5", False), ("/G91", False), ("/M8", True)])
def test_no_path_is_split_that_begins_elsewhere_where_a_line_is_left_out(
    line: str, splits: bool
) -> None:
    text = f"G21 G90\nS3000 M3\nG0 X0 Y0\n{line}\nG1 X50 Y30 F100\nM30\n"
    program, moves = read(text.encode("ascii"))
    assert (len(splittable(program, moves)) > 0) is splits
