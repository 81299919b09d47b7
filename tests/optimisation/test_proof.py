"""The proof: what it takes for the same, and that it finds every other change, of ten thousand."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.setup import Setup, Tool
from pipeline.optimisation.proof.prove import Proof, prove, with_proof_comment
from tests.optimisation.modal_programs import modal_program

BEFORE = (
    "%\nO1 (PART)\nN1 G21 G90\nN2 T1 M6\nN3 S3000 M3\nN4 G0 X0 Y0 Z5\nN5 G4 P500\n"
    "N6 G1 Z0 F100 (F)\nN7 X10 Y5\nN8 G84 X1 Y1 Z-1 R1 F300\nN9 X5\nN10 G80\nN11 G96 S120\n"
    "N12 G1 X1 F50\nN13 G97 S900\n"
    "N14 G93 G1 X5 F3\nN15 G94 G1 F80 X6\nN16 #1=50\nN17 X#1 F#1\nN18 X[#1+1] F90\nN19 M30\n%\n"
)


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


@pytest.mark.parametrize("case", [*BOUND, *NO_RUN])
def test_what_f_and_s_do_elsewhere_and_words_without_a_move_are_differences(case: str) -> None:
    before, pair, line, said = (BOUND | NO_RUN)[case]
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


@settings(max_examples=80)
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
}


@pytest.mark.parametrize("said", EDITS)
def test_each_edit_by_hand_is_told_in_its_own_words(said: str) -> None:
    old, new = EDITS[said]
    proof = proof_of(PART.replace(old, new), PART)
    assert proof.first is not None and proof.first.reason == said


def test_the_line_end_of_a_line_whose_feed_changed_too() -> None:
    proof = proof_of(PART.replace("\n", "\r\n").replace("F100", "F90"), PART)
    assert proof.first is not None
    assert proof.first.reason == "its line end differs: LF became CRLF"


CHANGES, PROOF = 500, pytest.param(10_000, marks=[pytest.mark.proof, pytest.mark.slow])
"""How many are tried: in the ordinary suite, and as proof."""
FANUC = Setup()
LINUXCNC = Setup(dialect="linuxcnc", tools={1: Tool(length=10.0, diameter=6.0)})

NUMBERED = b"""%\r
O0001(BOX OP2)\r
N10G20G90G94G17\r
N20T1M6\r
N30S5000M3\r
N40G0G90G54X7.25Y-1.5\r
N50G43H1Z2.\r
N60G1Z0.F120.\r
N70X5.\r
N80G3X5.375Y-1.125I0.J.375F60.5\r
N90G1X-2.25(FINISH F1 S2)\r
N100G0Z2.M9\r
N110M30\r
%\r
"""
SPACED = b"""%
O1234 (SPACED, G21)
N1 G21 G90 G17 G40
N2 T1 M6
N3 S8000 M3
N4 G0 X0 Y0
N5 G1 Z-2.5 F300
N6 G2 X10.5 Y10.5 R10.5 F 450
N7 G1 X20 ; end of slot F9
N8 G4 P500
N9 S6000
N10 /G1 X30 F250 S5500
N10 G95 G1 X40 F0.12
N11 M5
N12 M30
%
"""
SPACED = SPACED.replace(b"N10 /G1", b"/N9 G1")
CYCLES = b"""G21 G90
S1200 M3
G0 X0 Y0 Z20
G98 G83 X10 Y10 Z-20 R2 Q5 F90
X20
Y20 F80
G80
M29 S400
G84 X0 Y0 Z-10 R3 F400
X30
G80
S1500
G1 Z0 F200 M8
G33 Z-5 F1.5
G4 X1.5
G96 S120
G1 X9 F100
G97 S2000
G93 G1 X1 F4
G94 G1 X2 F300
G65 P100 A1 F5 S7
M98 P100 L2
M30
O100
G91 G1 X1 F77
Y#1
G90
M99
"""
EXPRESSIONS = b"""G21 S3000 M3
#1 = 0
#2 = 100.5
WHILE [#1 LT 3] DO1
G1 X[#1 * 10 + SIN[30]] F#2
Y#1 F200
#1 = #1 + 1
END1
IF [#1 GT 2] GOTO 9
G1 X50 F100
N9 G1 X60 F[50 + 2 * 3] S2500
Z[1.5]F80
M30
"""
LINUX = b"""; LinuxCNC f1 s2
g21 g90 g64 p0.01
t1 m6 g43
s4000 m3
f250
g0 x0 y0 z5
g1 z-1 f 120.5
g2 x5 y5 i5 j0 p2
o<hole> sub
g1 x#1 f180
y[#1 + #<_x>]
o<hole> endsub
o<hole> call [3] (call f1)
o1 repeat [2]
g91 g1 x0.5
o1 endrepeat
g90 g33 z-3 k1.5
g95 g1 x0 f0.1
g94 f100
g1 y0
m2
"""
PROGRAMS = [
    (NUMBERED, FANUC), (SPACED, FANUC), (CYCLES, FANUC), (EXPRESSIONS, FANUC), (LINUX, LINUXCNC),
]  # fmt: skip
_COMMENT = re.compile(rb"\([^)\r\n]*\)|;[^\r\n]*")
_WORD = re.compile(rb"(?i)(?<![A-Z#<_])([FS]) *[0-9][0-9. ]*(?<! )|(?<![A-Z#<_])[FS]\.[0-9]+")


def _words(text: bytes) -> list[tuple[int, int]]:
    """Where F and S words with a number stand, comments left out."""
    masked = _COMMENT.sub(lambda found: b"_" * len(found[0]), text)
    return [found.span() for found in _WORD.finditer(masked)]


def _byte_changes(text: bytes, rng: np.random.Generator, count: int) -> Iterator[bytes]:
    """One byte outside of F and S words: another in its place, one more, one less."""
    words = _words(text)
    inside = np.zeros(len(text) + 1, dtype=bool)
    beside = inside.copy()
    for start, end in words:
        inside[start:end] = True
        beside[start + 1 : end + 1] = True  # a digit put there is one of the word
    alphabet = b"0123456789.-+XYZFSGMNTPQRIJK #[]()/%;\r\n \t\x00\x7f\xffabfs"
    for _ in range(count):
        way = rng.integers(3)
        if way == 2:
            at = int(rng.choice(np.flatnonzero(~beside)))
            byte = alphabet[rng.integers(len(alphabet))]
            yield text[:at] + bytes([byte]) + text[at:]
            continue
        at = int(rng.choice(np.flatnonzero(~inside[:-1])))
        if way == 1:
            yield text[:at] + text[at + 1 :]
            continue
        byte = int(rng.integers(256))
        while byte == text[at]:
            byte = int(rng.integers(256))
        yield text[:at] + bytes([byte]) + text[at + 1 :]


def _word_changes(text: bytes, rng: np.random.Generator, count: int) -> Iterator[bytes]:
    """F and S words that become something else: another letter, place, sign, line, twice, gone."""
    words = _words(text)
    lines = [found.start() for found in re.finditer(rb"\r?\n", text)]
    for _ in range(count):
        start, end = words[rng.integers(len(words))]
        word = text[start:end]
        without = text[:start] + text[end:]
        way = rng.integers(6)
        if way == 0:
            letter = b"ABCDEGHIJKLMNOPQRTUVWXYZ"[rng.integers(24)]
            yield text[:start] + bytes([letter]) + text[start + 1 :]
        elif way == 1:
            yield without
        elif way == 2:
            yield text[:end] + word + text[end:]
        elif way == 3:
            yield text[: start + 1] + b"-" + text[start + 1 :]
        elif way == 4:  # into another line, out of its own
            at = lines[rng.integers(len(lines))]
            other = text[:at] + b" " + word + text[at:]
            own = start + (len(word) + 1 if at <= start else 0)
            yield other[:own] + other[own + len(word) :]
        else:
            yield text[:start] + b"#" + text[start:]


@pytest.mark.parametrize("changes", [CHANGES, PROOF])
@pytest.mark.parametrize("which", range(len(PROGRAMS)))
def test_every_change_is_found(which: int, changes: int) -> None:
    text, setup = PROGRAMS[which]
    assert prove(text, text, "B.nc", "A.nc", setup).same
    rng = np.random.default_rng(which)
    each = changes // len(PROGRAMS)
    mutants = [
        *_byte_changes(text, rng, each * 3 // 4),
        *_word_changes(text, rng, each - each * 3 // 4),
    ]
    assert len(mutants) == each
    for mutant in mutants:
        if mutant == text:
            continue  # a word that was moved to where it stood
        proof = prove(text, mutant, "B.nc", "A.nc", setup)
        assert not proof.same and proof.first is not None, mutant.decode("latin-1")


BOUND_LINES = {
    "G4": b"N8 G4 P500", "G10": b"G10 L2 P1 X0", "G50": b"G50 S3000", "G65": b"G65 P100 A1",
    "G92": b"G92 X0 Y0", "G33": b"G33 Z-5 F1.5", "G84": b"G84 X0 Y0 Z-10 R3 F400", "M19": b"M19",
    "G96": b"G96 S120", "G31": b"G31 X5 F100", "G93": b"G93 G1 X1 F4", "M29": b"M29 S400",
    "assignment": b"#1 = 5", "jump": b"GOTO 9", "label": b"O7", "comment": b"(F S)", "tape": b"% x",
    "nothing": b"",
}  # fmt: skip


@pytest.mark.parametrize("line", BOUND_LINES)
@pytest.mark.parametrize("word", [b" F5", b"F5", b" S500", b" F5 S500"])
def test_no_word_is_added_where_it_means_something_else(line: str, word: bytes) -> None:
    before = b"G21\n" + BOUND_LINES[line] + b"\nG1 X1 F100\nM30\n"
    after = before.replace(BOUND_LINES[line] + b"\nG1 X1", BOUND_LINES[line] + word + b"\nG1 X1")
    proof = prove(before, after, "B.nc", "A.nc", FANUC)
    assert not proof.same and proof.first is not None and proof.first.line == 2


@pytest.mark.parametrize(
    "line", [b"G4 F5", b"G10 F5", b"G65 P1 F5", b"G33 Z1 F5", b"G74 F5", b"G76 F5", b"G96 S5",
             b"G92 S5", b"G50 S5", b"M19 S5", b"M29 S5", b"G01X1F#5", b"X1(F5)", b"X1;F5",
             b"G04S5"],
)  # fmt: skip
def test_no_word_is_changed_where_it_means_something_else(line: bytes) -> None:
    before, after = b"G21\n" + line + b"\n", b"G21\n" + line.replace(b"5", b"6") + b"\n"
    assert not prove(before, after, "B.nc", "A.nc", FANUC).same
