"""Programs for the tests of this room: recorded ones, and text that Hypothesis writes."""

import os
from pathlib import Path

from hypothesis import settings
from hypothesis import strategies as st

RECORDINGS = os.environ.get("KERF_RECORDINGS")
EXAMPLES = int(os.environ.get("KERF_GCODE_EXAMPLES", "1000"))
"""Texts a property is tried on; 100 000 in the long run."""
MANY = settings(max_examples=EXAMPLES, deadline=None)


def recorded(*patterns: str) -> list[Path]:
    """Recorded programs by pattern; none where there are no recordings."""
    if RECORDINGS is None:
        return []
    found = {path for pattern in patterns for path in Path(RECORDINGS).glob(pattern)}
    return sorted(path for path in found if path.is_file())


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
