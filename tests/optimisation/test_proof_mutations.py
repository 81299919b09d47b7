"""Changes that are none of F and S: the proof finds every one, of ten thousand too."""

import re
from collections.abc import Iterator

import numpy as np
import pytest

from pipeline.gcode.setup import Setup, Tool
from pipeline.optimisation.proof.prove import prove

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
