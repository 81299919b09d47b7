"""The proof: what it takes for the same, and what it does not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.prove import Proof, prove, with_proof_comment
from tests.optimisation.modal_programs import modal_program

BEFORE = (
    "%\nO1 (PART)\nN1 G21 G90\nN2 T1 M6\nN3 S3000 M3\nN4 G0 X0 Y0 Z5\nN5 G4 P500\n"
    "N6 G1 Z0 F100 (F)\nN7 X10 Y5\nN8 G84 X1 Y1 Z-1 R1 F300\nN9 X5\nN10 G80\nN11 G96 S120\n"
    "N12 G1 X1 F50\nN13 G97 S900\n"
    "N14 G93 G1 X5 F3\nN15 G94 G1 F80 X6\nN16 #1=50\nN17 X#1 F#1\nN18 X[#1+1] F90\nN19 M30\n%\n"
)  # fmt: skip


def proof_of(after: str, before: str = BEFORE, **setup: object) -> Proof:
    data = [text.encode("latin-1") for text in (before, after)]
    return prove(data[0], data[1], "B.nc", "A.nc", Setup(**setup))  # type: ignore[arg-type]


def changed(*pairs: tuple[str, str], before: str = BEFORE) -> str:
    for old, new in pairs:
        assert before.count(old) == 1
        before = before.replace(old, new)
    return before


SAME = {
    "nothing": (),
    "F changed": (("Z0 F100", "Z0 F81.5"),),
    "F and S changed": (("S3000", "S2000"), ("Z0 F100", "Z0 F200."), ("F80 X6", "F.5 X6")),
    "F added": (("X10 Y5", "X10 Y5 F70"),),
    "F added without a blank": (("X10 Y5", "X10 Y5F70"),),
    "F and S added": (("X10 Y5", "X10 Y5 F70 S2500"),),
    "S added before the comment": (("Z0 F100 (F)", "Z0 F100 S2500 (F)"),),
    "F of a line with an expression": (("F90", "F91"),),
    "S after G97": (("S900", "S950"),),
}
UNBOUND = BEFORE.replace("N8 G84 X1 Y1 Z-1 R1 F300\nN9 X5\nN10 G80\n", "")
"""Without the tapping cycle, which S goes on into."""


@pytest.mark.parametrize("case", SAME)
def test_other_feeds_and_speeds_are_the_same_program(case: str) -> None:
    proof = proof_of(changed(*SAME[case], before=UNBOUND), UNBOUND)
    assert proof.same and proof.first is None
    assert proof.sha256 == proof_of(UNBOUND, UNBOUND).sha256


OTHERS = {
    "F in a dwell": (("G4 P500", "G4 P500 F5"),),
    "F of tapping": (("R1 F300", "R1 F310"),),
    "F on a later hole of tapping": (("N9 X5", "N9 X5 F310"),),
    "S of G96": (("S120", "S130"),),
    "F of G93": (("F3\n", "F4\n"),),
    "an expression": (("F#1", "F#2"),),
    "a number for an expression": (("F#1", "F50"),),
    "a word that is gone": (("Z0 F100", "Z0"),),
    "a word that moved to the next line": (("Z0 F100", "Z0"), ("X10 Y5", "X10 Y5 F100")),
    "a word in front": (("N7 X10", "F5 N7 X10"),),
    "a word in the middle": (("X10 Y5", "X10 F5 Y5"),),
    "a word twice": (("Z0 F100", "Z0 F100 F50"),),
    "no feed": (("Z0 F100", "Z0 F0"),),
    "a feed backwards": (("Z0 F100", "Z0 F-100"),),
    "a sign": (("Z0 F100", "Z0 F+100"),),
    "a comment": (("(F)", "(G)"),),
    "a word in a comment": (("(PART)", "(PART F5)"),),
    "a line that holds F alone": (("N10 G80\n", "N10 G80\nF50\n"),),
    "a blank": (("X10 Y5", "X10  Y5"),),
    "a blank at the end": (("X10 Y5", "X10 Y5 "),),
    "two blanks before a new word": (("X10 Y5", "X10 Y5  F70"),),
    "a letter": (("Z0 F100", "Z0 E100"),),
    "F for S": (("S3000", "F3000"),),
    "another order": (("F80 X6", "X6 F80"),),
    "a line end": (("Y5\n", "Y5\r\n"),),
    "no last line": (("N19 M30\n%\n", "N19 M30\n"),),
    "one more line": (("N19 M30\n%\n", "N19 M30\n%\n\n"),),
    "a word on a line that has none": (("N16 #1=50", "N16 #1=50 F5"),),
    "a word on the name of the program": (("O1 (PART)", "O1 F5 (PART)"),),
    "a word on the tape's sign": (("%\nO1", "% F5\nO1"),),
}


@pytest.mark.parametrize("case", OTHERS)
def test_anything_else_is_found(case: str) -> None:
    proof = proof_of(changed(*OTHERS[case]))
    assert not proof.same and proof.first is not None and proof.sha256 == ""


BOUND = {
    "the feed that tapping takes": (
        "S300 M3\nG1 X1 F300\nG84 X2 Z-1 R1\n", ("F300", "F310"), 3, "F or S is bound",
    ),
    "the lead that a thread takes": (
        "S300 M3\nG1 X1 F2\nG33 Z-9\n", ("F2\n", "F3\n"), 3, "F or S is bound",
    ),
    "the speed of tapping": (
        "S300 M3\nG1 X1 F300\nG84 X2 Z-1 R1 F300\n", ("S300", "S400"), 3, "F or S is bound",
    ),
    "the feed of probing": (
        "S300 M3\nG1 X1 F300\nG31 Z-9\n", ("F300", "F310"), 3, "F or S is bound",
    ),
    "a place that F makes": (
        "S300 M3\nG1 X1 F300\n#1=#4109\nX#1\n", ("F300", "F310"), 4, "the moves differ: end",
    ),
    "a way that S chooses": (
        "S300 M3\n#1=#4119\nIF[#1GT350]GOTO9\nG1 X5 F100\nN9 G0 X9\n", ("S300", "S400"), 4,
        "the moves differ: kind",
    ),
    "a spindle that stands": (
        "S300 M3\nG1 X1 F300\n", ("S300", "S0.0"), 1, "no plain positive number",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BOUND)
def test_what_f_and_s_do_elsewhere_is_found_in_the_moves(case: str) -> None:
    before, pair, line, said = BOUND[case]
    proof = proof_of(changed(pair, before=before), before)
    assert not proof.same and proof.first is not None
    assert proof.first.line == line and said in proof.first.reason


NO_RUN = {
    "behind the end": ("S300 M3\nG1 X1 F90\nM30\nX2 F80\n", ("F80", "F70"), 4, "not executed"),
    "jumped over": ("G1 X1 F90\nGOTO9\nX2 F80\nN9 X3\n", ("F80", "F70"), 3, "not executed"),
    "a subprogram that nothing calls": (
        "G1 X1 F90\nM30\nO7\nX2 F80\nM99\n", ("F80", "F70"), 4, "not executed",
    ),
    "behind the tape": ("%\nG1 X1 F90\nM30\n%\nF80\n", ("F80", "F70"), 5, "not executed"),
    "a feed that a variable keeps": (
        "G1 X1 F90\n#500=#4109\nX2\n", ("F90", "F70"), 2, "it reads the F or S in force",
    ),
    "a question that is answered the same": (
        "G1 X1 F90\nIF[#4109GT200]GOTO9\nX2\nN9 X3\n", ("F90", "F70"), 2, "it reads the F",
    ),
    "the feed of tapping where a line is left out": (
        "S300 M3\nG1 X1 F90\n/F80\nG84 X2 Z-1 R1\n", ("F90", "F70"), 4, "F or S is bound",
    ),
    "the speed of tapping where a line is left out": (
        "S300 M3\nG1 X1 F90\n/ S200\nG84 X2 Z-1 R1\n", ("S300", "S400"), 4, "F or S is bound",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", NO_RUN)
def test_words_that_the_moves_do_not_speak_for_are_differences(case: str) -> None:
    before, pair, line, said = NO_RUN[case]
    assert proof_of(before, before).same
    proof = proof_of(changed(pair, before=before), before)
    assert not proof.same and proof.first is not None and proof.sha256 == ""
    assert proof.first.line == line and said in proof.first.reason


@pytest.mark.parametrize("skip", [(), (1,), (2,)])
def test_a_line_that_may_be_left_out_has_a_feed_as_any_other(skip: tuple[int, ...]) -> None:
    before = "S300 M3\nG1 X1 F90\n/X2 F80\nX3\n"
    assert proof_of(before.replace("F80", "F70"), before, block_skip=skip).same


def test_the_first_difference_is_told_with_both_texts() -> None:
    proof = proof_of(changed(("X10 Y5", "X10 Y6"), ("F80 X6", "F80 X7"), ("F100", "F90")))
    assert str(proof.first) == ("line 9: Y5 became Y6: 'N7 X10 Y5' became 'N7 X10 Y6'")
    assert [change.after for change in proof.differences] == ["F90"]


def test_the_hash_holds_the_set_up() -> None:
    offset = {"work_offsets": {"G54": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)}}
    assert proof_of(BEFORE).sha256 != proof_of(BEFORE, **offset).sha256


@pytest.mark.parametrize("end", ["", "\n", "\r\n"])
@pytest.mark.parametrize("closing", ["", "\n%", "\n%\n\n"])
def test_the_comment_is_proved_too(end: str, closing: str) -> None:
    before = ("S300 M3\nG1 X1 F300\nM30" + closing).replace("\n", end or "\n")
    before += "" if closing else end
    after = before.replace("F300", "F200")
    proof = proof_of(after, before)
    signed = with_proof_comment(after.encode("ascii"), proof).decode("ascii")
    again = proof_of(signed, before)
    assert again.same and again.sha256 == proof.sha256
    assert signed.replace(f"(KERF PROOF SHA256 {proof.sha256.upper()})", "") != signed
    assert with_proof_comment(signed.encode("ascii"), proof).decode("ascii") == signed
    assert proof_of(signed, signed).sha256 == proof.sha256
    false = signed.replace(proof.sha256.upper()[:4], "ABCD" if proof.sha256[:4] != "abcd" else "0")
    told = proof_of(false, before)
    assert not told.same and told.first is not None


def test_a_comment_of_another_program_is_found() -> None:
    signed = with_proof_comment(BEFORE.encode("ascii"), proof_of(BEFORE)).decode("ascii")
    other = changed(("X10 Y5", "X10 Y6"))
    proof = proof_of(changed(("X10 Y5", "X10 Y6"), before=signed), other)
    assert not proof.same and proof.first is not None
    assert "its proof comment has another hash" in proof.first.reason


def test_no_comment_without_a_proof() -> None:
    with pytest.raises(ValueError, match="there is no proof to write into the program: line 9"):
        with_proof_comment(b"M30", proof_of(changed(("X10 Y5", "X10 Y6"))))


def test_siemens_comments() -> None:
    before = "G90 G17\nS300 M3\nG1 X5 Y5 F100\nM30\n"
    proof = proof_of(before.replace("F100", "F90"), before, dialect="siemens")
    signed = with_proof_comment(before.encode("ascii"), proof).decode("ascii")
    assert signed.splitlines()[-1].startswith("; KERF PROOF SHA256 ")
    assert proof_of(signed, before, dialect="siemens").same


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (b"", b"M30", "B.nc is empty: name a part program"),
        (b"M30", b" \n\n", "A.nc is empty: name a part program"),
        (b"G1 X1\nM30", b"G1 X1\nM30", r"B\.nc:1:1: G1: G1 has no feed"),
        (b"\x00\x01\xff\xfe", b"\x00\x01\xff\xfe", r"B\.nc:1:"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(before: bytes, after: bytes, said: str) -> None:
    with pytest.raises(ValueError, match=said) as told:
        prove(before, after, "B.nc", "A.nc", Setup())
    assert "\n" not in str(told.value)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=80), st.binary(max_size=80), st.integers(0, 20))
def test_no_bytes_make_it_stumble(one: bytes, other: bytes, seed: int) -> None:
    program = modal_program(np.random.default_rng(seed))
    for before, after in ((one, other), (one, one), (program + one, program + other)):
        for dialect in ("fanuc", "linuxcnc", "siemens"):
            try:
                proof = prove(before, after, "B.nc", "A.nc", Setup(dialect=dialect))  # type: ignore[arg-type]
            except ValueError as error:
                assert "\n" not in str(error)
                continue
            assert proof.same == (proof.first is None)


PART = (
    "%\nO1000 (PART)\nN1 G21 G90\nN2 S3000 M3\nN3 G1 X10 F100\nN4 X20 Y5\nN5 G84 Z-9 R1 F300\n"
    "N6 G80\nN7 M30\n%\n"
)
EDITS = {
    "M0 was added": ("N4 X20 Y5", "N4 X20 Y5 M0"),
    "the line was deleted": ("N4 X20 Y5\n", ""),
    "2 lines were deleted": ("N4 X20 Y5\nN5 G84 Z-9 R1 F300\n", ""),
    "the line was put in": ("N4 X20 Y5\n", "M0\nN4 X20 Y5\n"),
    "only line ends differ: LF became CRLF in 10 of 10 lines": ("\n", "\r\n"),
    "the program number O1000 became O1001": ("O1000", "O1001"),
    "its block number N4 became N40": ("N4 ", "N40 "),
    "the block skip / was added": ("N4 X20", "/N4 X20"),
    "Y5 became Y6": ("Y5", "Y6"),
    "Y5 is gone": ("X20 Y5", "X20"),
    "G90 became G91": ("G90", "G91"),
    "M3 became M4": ("M3\n", "M4\n"),
    "the comment (PART) became (OTHER)": ("(PART)", "(OTHER)"),
    "the comment (PART) is gone": (" (PART)", " "),
    "only its blanks differ": ("X20 Y5", "X20  Y5"),
    "only its capital and small letters differ": ("X20 Y5", "x20 Y5"),
    "its words stand in another order": ("X20 Y5", "Y5 X20"),
    "X20 became X21, Y5 is gone": ("X20 Y5", "X21"),
    "F300 became F310, and with G84 in the line that is no plain feed or speed": ("F300", "F310"),
    "the line was deleted at the end of the program": ("N7 M30\n%\n", "N7 M30\n"),
    "2 lines were added at the end of the program": ("N7 M30\n%\n", "N7 M30\n%\n\n\n"),
}  # fmt: skip


@pytest.mark.parametrize("said", EDITS)
def test_each_edit_by_hand_is_told_in_its_own_words(said: str) -> None:
    old, new = EDITS[said]
    proof = proof_of(PART.replace(old, new), PART)
    assert proof.first is not None and proof.first.reason == said


def test_the_line_end_of_a_line_whose_feed_changed_too() -> None:
    proof = proof_of(PART.replace("\n", "\r\n").replace("F100", "F90"), PART)
    assert proof.first is not None
    assert proof.first.reason == "its line end differs: LF became CRLF"
