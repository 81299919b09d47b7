"""Programs for the tests of this room: recorded, written by Hypothesis, and their moves."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup

MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)


def follow(text: str, **choices) -> Moves:
    """Moves of a program; ``choices`` are those of Setup.  Line by line, without compiled code."""
    program = parse_program(text.encode(), "P")
    return Interpreter(program, Setup(**choices), compiled=False).moves()


def refusal(text: str, **choices) -> str:
    """What is said of a program that cannot be followed."""
    try:
        follow(text, **choices)
    except GcodeError as error:
        return str(error)
    raise AssertionError("the program was followed")


def ends(moves: Moves, axes: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Where the moving rows end, and which of them are rapid."""
    rows = np.isin(moves.kind, MOVING)
    return moves.end[rows, :axes], moves.kind[rows] == Kind.RAPID


def points(moves: Moves, axes: int = 3) -> list[list[float]]:
    """Where the moving rows end, without those that stay where they are."""
    here, found = moves.origin[:axes], []
    for row in np.flatnonzero(np.isin(moves.kind, MOVING)):
        end = moves.end[row, :axes]
        if not np.allclose(end, here, atol=1e-9, rtol=0):
            found.append(end.round(9).tolist())
        here = end
    return found


def kinds(moves: Moves) -> list[str]:
    """Names of the rows' kinds."""
    return [Kind(kind).name for kind in moves.kind]


RECORDINGS = os.environ.get("KERF_RECORDINGS")
FEW = 60
"""Texts a property is tried on in the ordinary suite."""
EXAMPLES = int(os.environ.get("KERF_GCODE_EXAMPLES", "1000"))
"""Texts a property is tried on in the proof; 100 000 in the long run."""


def fuzzed(*strategies: st.SearchStrategy, more: int = 1) -> Callable[[Callable], Callable]:
    """A property tried on few texts in the ordinary suite, on many in the proof."""

    def prepared(test: Callable) -> Callable:
        proof = pytest.param(more * EXAMPLES, marks=pytest.mark.proof)

        @pytest.mark.parametrize("examples", [FEW, proof])
        def tried(examples: int) -> None:
            settings(max_examples=examples, deadline=None)(given(*strategies)(test))()

        tried.__doc__ = test.__doc__
        return tried

    return prepared


def recorded(*patterns: str) -> list[Path]:
    """Recorded programs by pattern; none where there are no recordings."""
    if RECORDINGS is None:
        return []
    found = {path for pattern in patterns for path in Path(RECORDINGS).glob(pattern)}
    return sorted(path for path in found if path.is_file())


LONG = 60_000
"""Bytes above which a recorded program belongs to the proof."""


def long_in_proof(paths: list[Path]) -> list:
    """Parameters of a test: the recorded programs, those that run long marked as proof."""
    proof = pytest.mark.proof
    long = {path for path in paths if path.stat().st_size > LONG or path.stem == "flowsnake"}
    return [pytest.param(path, marks=proof) if path in long else path for path in paths]


def short(path: Path) -> str:
    return path.name


ENDS = ["\n", "\r\n", "\r", "\r\r\n"]
SIGNS = list("%/()[]#<>=;,+-.*: \t\0")
NUMBERS = ["0", "1", "-1.5", "+.25", "10.", "007", "1 2 . 5", "-", ".", "1.2.3", "--2",
           "12345678901234567890.5", "0.00000000000000000000000001", "+-3"]  # fmt: skip
VALUES = ["#1", "##2", "#[1+2]", "#<a b>", "[#1*-2]", "-[3]", "[1", "]", "sin[30]", "Atan[1]/[2]",
          "ABS[-#3]", "[ROUND[2.5]+1]", "foo[1]", "[1 EQ 2]", "[2**-1 mod 3]", "#"]  # fmt: skip
LETTERS = [*"NGXYZIJKRFSTMDHOPQLABCUVWxyzgmfno@^$", ",R", ",c"]
LINES = ["(text [1] #2 %)", "(a(b)", "; rest (x)", "(open", "IF[#1 EQ 0]GOTO 10", "WHILE[1]DO1",
         "END1", "GOTO#5", "#1=2+3", "#<b> = [#2]", "IF[#1]THEN#2=3", "o<name> call [1] [2]",
         "O100 sub", "O1", "o1 endwhile", "o2 if [#1 gt 2]", "DEF REAL _A", "X=_A", 'MSG("x")',
         "CYCLE800()", "/2", "%", "N10 ", " / ", "é", "GOTO", "o<a> return [1]"]  # fmt: skip
WORDS = [letter + value for letter in LETTERS for value in NUMBERS + VALUES + [""]]
PIECE = st.sampled_from(WORDS) | st.sampled_from(LINES) | st.sampled_from(SIGNS + ENDS * 3)
ENCODING = st.sampled_from(["utf-8", "latin-1", "utf-8-sig", "utf-16"])
PROGRAM = st.builds(lambda text, code: "".join(text).encode(code), st.lists(PIECE), ENCODING)
"""Bytes of a program, mostly sensible."""
BYTES = st.one_of(
    st.binary(max_size=60),
    st.lists(st.sampled_from(list(b"GXYN01.-+[]#<>()%/;=, \t\r\n\0\xef\xbb\xbf")), max_size=40).map(
        bytes
    ),
)
"""Bytes of anything, often with signs of G-code."""
