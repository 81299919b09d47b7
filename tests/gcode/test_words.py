"""Each byte belongs to one token of the right kind, and numbers are Python's, bit for bit."""

import re
from itertools import pairwise

import numpy as np
import pytest
from gcode_texts import BYTES, MANY, PROGRAM
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.words import Kind, tokens

B = rb"[ \t\v\f\x00\x7f]"
NUMBER = rb"(?:[+-]%(b)s*)?(?:\d(?:%(b)s*\d)*(?:%(b)s*\.(?:%(b)s*\d)*)?|\.(?:%(b)s*\d)+)" % {
    b"b": B
}
LETTER = rb"(?:,%(b)s*[RrCc]|[A-Za-z@^$])" % {b"b": B}
PATTERNS = (
    (Kind.LINE_END, rb"\r\n|\r|\n"),
    (Kind.BLANK, B + rb"+"),
    (Kind.COMMENT, rb"\([^)\r\n]*\)"),
    (Kind.OTHER, rb"\([^\r\n]*"),
    (Kind.REMARK, rb";[^\r\n]*"),
    (Kind.WORD, LETTER + B + rb"*" + NUMBER),
)
"""What tokens look like that end where a regular expression ends, in the order of trial."""


def read(data: bytes) -> list[tuple[Kind, bytes]]:
    made = tokens(data, "test")
    spans = pairwise(made.start.tolist())
    return [(Kind(k), data[a:b]) for k, (a, b) in zip(made.kind.tolist(), spans, strict=True)]


@MANY
@given(st.one_of(BYTES, PROGRAM))
def test_regular_tokens_equal_their_regular_expressions(data: bytes) -> None:
    at, line_starts = 0, [0] if data else []
    for kind, text in read(data):
        assert text
        found = [(k, m) for k, p in PATTERNS if (m := re.compile(p).match(data, at))]
        if found and not (kind == Kind.BLANK and text == b"\xef\xbb\xbf"):
            assert (kind, text) == (found[0][0], found[0][1].group())
        else:
            assert kind not in (Kind.LINE_END, Kind.COMMENT, Kind.REMARK, Kind.WORD)
            assert b"\n" not in text and b"\r" not in text
        at += len(text)
        if kind == Kind.LINE_END and at < len(data):
            line_starts.append(at)
    assert at == len(data)
    made = tokens(data, "test")
    assert made.start[made.first[:-1]].tolist() == line_starts


@settings(max_examples=2000, deadline=None)
@given(
    st.one_of(
        st.floats(allow_nan=False, allow_infinity=False, width=32).map(lambda x: f"{x:f}"),
        st.floats(allow_nan=False, allow_infinity=False).map(lambda x: f"{x:.20f}"),
        st.from_regex(r"[+-]?([0-9]{1,25}\.?[0-9]{0,30}|\.[0-9]{1,30})", fullmatch=True),
        st.integers(2**53 - 20, 2**53 + 20).map(str),
        st.tuples(st.integers(2**52, 2**54), st.integers(0, 25)).map(
            lambda p: f"{p[0]}.{p[1]:025}"
        ),
    )
)
def test_numbers_equal_pythons_bit_for_bit(text: str) -> None:
    made = tokens(f"X{text}".encode(), "test")
    assert made.kind.tolist() == [Kind.WORD]
    assert made.value.tolist()[0].hex() == float(text).hex()


def test_a_number_of_many_digits_is_infinite_as_in_python() -> None:
    assert tokens(b"X" + b"9" * 400, "test").value.tolist() == [np.inf]


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ("N10G0X1.5Y-.5", [Kind.WORD] * 4),
        ("X 1 0 . 5", [Kind.WORD]),
        ("X[#1+[2]]", [Kind.VALUED]),
        ("F#<my feed>", [Kind.VALUED]),
        ("X--5", [Kind.VALUED]),
        ("Xsin[30]Y1", [Kind.VALUED, Kind.WORD]),
        ("XATAN[1] / [2]Y1", [Kind.VALUED, Kind.WORD]),
        ("X##5Y1", [Kind.VALUED, Kind.WORD]),
        ("X#[1+1]Y1", [Kind.VALUED, Kind.WORD]),
        ("X[1", [Kind.LONE, Kind.MACRO]),
        ("X-", [Kind.LONE, Kind.OTHER]),
        ("X.", [Kind.LONE, Kind.OTHER]),
        ("X1.2.3", [Kind.WORD, Kind.OTHER]),
        ("#1=2+3 (c)", [Kind.MACRO, Kind.COMMENT]),
        ("IF[#1EQ2]GOTO5;c", [Kind.MACRO, Kind.REMARK]),
        ("O<sub> call [1]", [Kind.MACRO]),
        ("O100 sub", [Kind.WORD, Kind.BLANK, Kind.MACRO]),
        ("CYCLE800()", [Kind.MACRO, Kind.COMMENT]),
        ("/2G1", [Kind.SKIP, Kind.WORD]),
        (" /G1/2", [Kind.BLANK, Kind.SKIP, Kind.WORD, Kind.OTHER]),
        ("% tape", [Kind.PERCENT]),
        ("G1%", [Kind.WORD, Kind.OTHER]),
        ("X1,R2,C.5", [Kind.WORD] * 3),
        ("X1, r2", [Kind.WORD] * 2),
        ("X1,", [Kind.WORD, Kind.OTHER]),
    ],
)
def test_kinds(text: str, kinds: list[Kind]) -> None:
    assert [kind for kind, _ in read(text.encode())] == kinds
