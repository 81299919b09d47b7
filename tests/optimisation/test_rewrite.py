"""Programs with other F and S words: what is written, and that nothing else is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.prove import prove
from pipeline.optimisation.proof.text import WordChange
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import Rewritten, matching_rows, rewrite
from pipeline.optimisation.text.words import (
    SLACK,
    NumberStyle,
    rounded_down,
    rounded_feeds,
    rounded_speeds,
)
from tests.optimisation.modal_programs import any_answer, modal_program, seeds

SETUP = Setup()


def changed(
    text: str, feeds: dict[int, float], speeds: dict[int, float] | None = None
) -> Rewritten:
    """A program whose lines get other F; S is that from a line on."""
    program = Program(text.encode("ascii"), "P.nc")
    moves = interpret(program, SETUP)
    wanted, turning = moves.feed.copy(), moves.speed.copy()
    for line, feed in feeds.items():
        wanted[moves.line == line] = feed
    for line, speed in (speeds or {}).items():
        turning[(moves.line >= line) & (moves.direction != 0)] = speed
    return rewrite(program, moves, editable_blocks(program, moves), wanted, turning, SETUP)


CASES = {
    "a number takes the place of another": (
        "S3000 M3\nG1 X1 F100\n", {2: 250}, "S3000 M3\nG1 X1 F250\n",
    ),
    "the next line that keeps its own gets the word again": (
        "S3000 M3\nG1 X1 F100\nX2\nX3\n", {3: 50}, "S3000 M3\nG1 X1 F100\nX2 F50\nX3 F100\n",
    ),
    "a word in force is not written": (
        "S3000 M3\nG1 X1 F100\nX2\nX3\n", {2: 50, 3: 50, 4: 50}, "S3000 M3\nG1 X1 F50\nX2\nX3\n",
    ),
    "words without blanks get none": (
        "N1S3000M3\nN2G1X1.F100.\nN3X2.\n", {3: 50.5}, "N1S3000M3\nN2G1X1.F100.\nN3X2.F50.5\n",
    ),
    "the decimal point is kept": (
        "S3000 M3\nG1 X1 F100.\nX2\n", {3: 5000}, "S3000 M3\nG1 X1 F100.\nX2 F5000.\n",
    ),
    "decimals are kept": (
        "S3000 M3\nG1 X1 F100.0\nX2\n", {3: 5000}, "S3000 M3\nG1 X1 F100.0\nX2 F5000.0\n",
    ),
    "down, and by less than a thousandth": (
        "S3000 M3\nG1 X1 F100\nX2\nX3\n", {2: 1999.99, 3: 199.99, 4: 19.999},
        "S3000 M3\nG1 X1 F1999\nX2 F199.9\nX3 F19.99\n",
    ),
    "before the comment and the blanks before it": (
        "S3000 M3\nG1 X1 F100 (a)\nX2  (b)  \nX3;c\n", {3: 50},
        "S3000 M3\nG1 X1 F100 (a)\nX2 F50  (b)  \nX3 F100;c\n",
    ),
    "letter and blanks of a word stay": (
        "s3000 m3\ng1 x1 f  100 y2\nx2\n", {2: 70, 3: 80}, "s3000 m3\ng1 x1 f  70 y2\nx2 f80\n",
    ),
    "inches": (
        "G20 S3000 M3\nG1 X1 F10.\nX2\n", {3: 25.4 * 12.5}, "G20 S3000 M3\nG1 X1 F10.\nX2 F12.5\n",
    ),
    "millimetres a turn": (
        "S3000 M3\nG95 G1 X1 F0.2\nX2\n", {3: 0.123456}, "S3000 M3\nG95 G1 X1 F0.2\nX2 F0.1234\n",
    ),
    "a rapid line's F goes on": (
        "S3000 M3\nG1 X1 F100\nG0 Z5 F80\nG1 X2\nX3\n", {2: 50, 4: 80, 5: 80},
        "S3000 M3\nG1 X1 F50\nG0 Z5 F80\nG1 X2\nX3\n",
    ),
    "the F of a repeated point goes on": (
        "S3000 M3\nG1 X1 F100\nX1 F80\nX2\nX2\nX3\n", {2: 50, 4: 60, 6: 70},
        "S3000 M3\nG1 X1 F50\nX1 F80\nX2 F60\nX2\nX3 F70\n",
    ),
    "a loop comes back to its first line": (
        "S3000 M3\nG1 X1 F100\nM98 P7 L2\nM30\nO7\nX2\nX3\nM99\n", {7: 50},
        "S3000 M3\nG1 X1 F100\nM98 P7 L2\nM30\nO7\nX2 F100\nX3 F50\nM99\n",
    ),
    "a cycle goes on with later lines": (
        "S3000 M3\nG0 Z5\nG81 X1 Z-1 R1 F100\nX2\nX3\nG80\n", {4: 50},
        "S3000 M3\nG0 Z5\nG81 X1 Z-1 R1 F100\nX2 F50\nX3 F100\nG80\n",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_what_is_written(case: str) -> None:
    before, feeds, after = CASES[case]
    assert changed(before, feeds).text.decode("ascii") == after


def test_speeds_are_written_where_stretches_begin() -> None:
    text = "T1 M6\nS3000 M3\nG1 X1 F100\nX2\nG0 Z5\nM5\nM3\nG1 X3\n"
    made = changed(text, {}, {2: 4000.4, 4: 5000, 7: 3000})
    assert made.text.decode("ascii") == (
        "T1 M6\nS4000 M3\nG1 X1 F100\nX2 S5000\nG0 Z5\nM5\nM3 S3000\nG1 X3\n"
    )
    assert made.changes == (
        WordChange(2, "S", "S3000", "S4000"),
        WordChange(4, "S", None, "S5000"),
        WordChange(7, "S", None, "S3000"),
    )


def test_nothing_to_change_gives_the_same_bytes() -> None:
    text = "%\r\nO1\r\nN1 G20 S3000.5 M3\r\nN2 G1 X1 F#1\r\n"
    assert changed(text.replace("F#1", "F1.5"), {}).text == text.replace("F#1", "F1.5").encode()


@pytest.mark.parametrize("seed", seeds(30, 150))
def test_any_answer_is_written_and_proved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = modal_program(rng)
    program = Program(data, "P.nc")
    moves = interpret(program, SETUP)
    editable = editable_blocks(program, moves)
    feeds, speeds = any_answer(editable, moves, rng)
    made = rewrite(program, moves, editable, feeds, speeds, SETUP)
    after = interpret(Program(made.text, "Q.nc"), SETUP)
    rows = matching_rows(moves, after)
    cuts = editable.block >= 0
    # what stands in the text is what was said it would hold, to the bit
    assert (after.feed[rows][cuts] == rounded_feeds(program, moves, feeds)[cuts]).all()
    turning = editable.speed & (speeds != moves.speed)
    assert (after.speed[rows][turning] == rounded_speeds(speeds)[turning]).all()
    proof = prove(data, made.text, "P.nc", "Q.nc", SETUP)
    assert proof.same and proof.differences == made.changes
    # what keeps its own answer is not touched: writing the same again changes nothing
    again = Program(made.text, "Q.nc")
    kept = rewrite(again, after, editable_blocks(again, after), after.feed, after.speed, SETUP)
    assert kept.text == made.text and kept.changes == ()


@settings(max_examples=300)
@given(st.floats(1e-3, 1e5), st.integers(0, 3))
def test_rounding_is_down_small_and_done_once(value: float, least: int) -> None:
    once = float(rounded_down(value, least))
    # a thousandth, and the slack for numbers that arithmetic left a little below what they mean
    assert value * (1 - 1e-3) < once <= value * (1 + 2 * SLACK)
    assert float(rounded_down(once, least)) == once
    style = NumberStyle(point=least > 0, least=least)
    assert float(style.text(once)) == once


@pytest.mark.parametrize(
    ("feeds", "speeds", "said"),
    [
        ({3: 0.0}, {}, "P.nc:3 is to have F0 in place of F100"),
        ({3: float("nan")}, {}, "P.nc:3 is to have Fnan"),
        ({4: 50.0}, {}, "P.nc:4 is to have F50 in place of F2"),
        ({}, {3: -5.0}, "P.nc:3 is to have S-5"),
    ],
)
def test_what_may_not_be_is_refused_with_its_line(feeds, speeds, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        changed("S3000 M3\nG1 X1 F100\nX2\nG33 Z-5 F2\nG1 X3 F9\n", feeds, speeds)


def test_rows_of_a_line_must_agree() -> None:
    program = Program(b"S3000 M3\nF100\nM98 P7 L2\nM30\nO7\nG1 X2\nX3\nM99\n", "P.nc")
    moves = interpret(program, SETUP)
    feeds = moves.feed.copy()
    feeds[1] = 50
    with pytest.raises(ValueError, match=r"P\.nc:6 is to have several feeds"):
        rewrite(program, moves, editable_blocks(program, moves), feeds, moves.speed, SETUP)


def test_an_f_that_is_read_where_nobody_looks_is_found_in_the_end() -> None:
    # the number of the variable that holds F is computed: no reading of the text can know
    text = "S3000 M3\nG1 X1 F100\n#1=#[4100+9]\nX#1\nX2\n"
    with pytest.raises(ValueError, match="match only where nothing but F and S words differ"):
        changed(text, {2: 50})


DAMAGE = b"0123456789.-+XYZFSGMNTPQRIJK #[]()/%;\r\n \tabfs=<>DOIW\x00\xff"


@pytest.mark.parametrize("seed", seeds(60, 400))
def test_damaged_programs_that_can_be_followed_are_rewritten_too(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(modal_program(rng))
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(len(data)))
        data[at : at + int(rng.integers(2))] = DAMAGE[rng.integers(len(DAMAGE)) :][:1]
    program = Program(bytes(data), "P.nc")
    setup = Setup(block_limit=1000, block_skip=(1,) if seed % 3 else ())
    try:
        moves = interpret(program, setup)
    except ValueError:
        return
    editable = editable_blocks(program, moves)
    made = rewrite(program, moves, editable, *any_answer(editable, moves, rng), setup)
    proof = prove(bytes(data), made.text, "P.nc", "Q.nc", setup)
    assert proof.same and proof.differences == made.changes


def test_a_siemens_program() -> None:
    before = (
        b"N10 G17 G90 G71\nN20 T1 M6\nN30 S3000 M3\nN40 G0 X0 Y0 Z5\nN50 G4 F2\n"
        b"N60 G1 Z-1 F100 ; F7\nN70 X=10 F=200\nN80 X20\nN90 Y5 F300\nN100 M30\n"
    )
    setup = Setup(dialect="siemens")
    program = Program(before, "P.mpf")
    moves = interpret(program, setup)
    editable = editable_blocks(program, moves)
    # line 7 is not read word by word: it might take the F of line 6, which is held for it
    assert editable.line.tolist() == [8, 9]
    feeds, speeds = any_answer(editable, moves, np.random.default_rng(0), own=0.0)
    made = rewrite(program, moves, editable, feeds, speeds, setup)
    assert made.changes and prove(before, made.text, "P.mpf", "Q.mpf", setup).same


@pytest.mark.parametrize(
    "between", ["/X3 F77\n", "/X3 F77\nX4\n", "/F77\nX4\n", "/S500 X3 F77\n"],
)  # fmt: skip
def test_tapping_takes_its_own_f_and_s_where_a_line_before_it_is_left_out(between: str) -> None:
    """What it reads with the line, and without: both stay, whatever the others get."""
    data = f"S3000 M3\nG1 X1 F90\nX2 F95\n{between}G84 X5 Z-1 R1\nG80\nG1 X9 F60 S900\n".encode()
    program = Program(data, "P.nc")
    for seed in range(5):
        for skip in ((), (1,)):
            moves = interpret(program, SETUP)
            editable = editable_blocks(program, moves)
            answer = any_answer(editable, moves, np.random.default_rng(seed))
            text = rewrite(program, moves, editable, *answer, SETUP).text
            told = [
                interpret(Program(one, "P.nc"), replace(SETUP, block_skip=skip))
                for one in (data, text)
            ]
            taps = [moves.line == data.count(b"\n", 0, data.index(b"G84")) + 1 for moves in told]
            for name in ("feed", "speed"):
                own, now = (getattr(m, name)[t] for m, t in zip(told, taps, strict=True))
                assert (own == now).all()
