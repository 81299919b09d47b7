"""Each byte belongs to one token of the right kind; text to tree to text gives the same bytes."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from pipeline.gcode.program import TokenKind as Kind
from pipeline.gcode.program import parse_program, read_program, tokens
from tests.gcode.following import BYTES, PROGRAM, RECORDINGS, fuzzed, long_in_proof, recorded, short

FILES = recorded("gcode/**/*", "nist_box/programs/*")


def assert_lossless(data: bytes) -> None:
    program = parse_program(data, "test")
    assert program.text() == data
    # of bytes, splitlines cuts at \n, \r\n and \r, nowhere else
    assert [line.text + line.end for line in program.lines] == data.splitlines(keepends=True)
    for number, line in enumerate(program.lines, start=1):
        assert line.number == number
        assert b"".join(piece.text for piece in line.pieces) == line.text + line.end
        assert line.text.strip(b"\r\n") == line.text


@fuzzed(st.one_of(BYTES, PROGRAM))
def test_any_bytes_come_back(data: bytes) -> None:
    assert_lossless(data)


@pytest.mark.skipif(RECORDINGS is None, reason="KERF_RECORDINGS names no folder")
@pytest.mark.parametrize("path", long_in_proof(FILES), ids=short)
def test_recorded_programs_come_back(path: Path) -> None:
    assert_lossless(path.read_bytes())


@fuzzed(PROGRAM, st.data())
def test_words_are_rewritten_and_nothing_else(data: bytes, draws: st.DataObject) -> None:
    program = parse_program(data, "test")
    words = [word for line in program.lines for word in line.words]
    chosen = draws.draw(st.sets(st.sampled_from(words), max_size=5)) if words else set()
    text = program.text({word: b"F<%d>" % word.start for word in chosen})
    expected = bytearray(data)
    for word in sorted(chosen, key=lambda word: -word.start):
        assert data[word.start : word.end] == word.text
        assert word.start == program.line(word.line).start + word.column - 1
        expected[word.start : word.end] = b"F<%d>" % word.start
    assert text == bytes(expected)


def test_words_of_a_line() -> None:
    program = parse_program(b"%\r\n/2 N10 G1 x1.50(in)f[#1*2] F#<a>,r2;out\r\n", "test")
    line = program.line(2)
    assert [(w.letter, w.value, w.expression, w.text, w.column) for w in line.words] == [
        ("N", 10.0, None, b"N10", 4),
        ("G", 1.0, None, b"G1", 8),
        ("X", 1.5, None, b"x1.50", 11),
        ("F", None, "[#1*2]", b"f[#1*2]", 20),
        ("F", None, "#<a>", b"F#<a>", 28),
        (",R", 2.0, None, b",r2", 33),
    ]
    assert line.comments == (b"in", b"out")
    assert (line.skip, line.code_start, line.end) == (2, 2, b"\r\n")
    assert next(program.line(1).pieces).kind == Kind.PERCENT


def test_letters_with_a_comma() -> None:
    line = parse_program(b"X1,r 2 , c[#1]", "test").line(1)
    assert [(w.letter, w.value, w.expression, w.text) for w in line.words] == [
        ("X", 1.0, None, b"X1"),
        (",R", 2.0, None, b",r 2"),
        (",C", None, "[#1]", b", c[#1]"),
    ]


def test_a_byte_order_mark_is_no_code() -> None:
    line = parse_program(b"\xef\xbb\xbf/G1", "test").line(1)
    assert (line.skip, line.code_start) == (1, 4)
    assert [piece.kind for piece in line.pieces] == [
        Kind.BLANK,
        Kind.SKIP,
        Kind.WORD,
    ]


@pytest.mark.parametrize(("text", "body"), [
    ("", range(1, 1)),
    ("G1\nM30", range(1, 3)),
    ("%\nG1\n%\nnot code", range(2, 3)),
    ("\n(head)\n % O1\nG1\nG2", range(4, 6)),
    ("O1\nG1\n%\nnot code", range(1, 3)),
    ("%\n%\nnot code", range(2, 2)),
])  # fmt: skip
def test_percent_lines_hold_what_is_executed(text: str, body: range) -> None:
    assert parse_program(text.encode(), "test").body == body


def test_heads_are_the_first_words_of_lines() -> None:
    program = parse_program(b"O1(A)\n N10 G1\n/N20X1\nG0 N30\nO0002\n(N1) N5\nn10\n", "test")
    assert program.heads("N") == [(10.0, 2), (20.0, 3), (10.0, 7)]
    assert program.heads("O") == [(1.0, 1), (2.0, 5)]


def test_a_line_that_is_not_there() -> None:
    with pytest.raises(IndexError, match=r"p\.nc has lines 1 to 1, not 0"):
        parse_program(b"G1", "p.nc").line(0)


def test_a_file_is_named_after_itself(tmp_path: Path) -> None:
    (tmp_path / "part 1.nc").write_bytes(b"G0\rG1")
    program = read_program(tmp_path / "part 1.nc")
    assert (program.name, len(program)) == ("part 1.nc", 2)


def test_content_tells_what_a_line_holds() -> None:
    text = b"G1 X1 (c) ; r\n\nX[1]\n#1=2\n/X1\nX\n%\nF#1 O<a> sub"
    assert parse_program(text, "test").content.tolist() == [0, 0, 1, 2, 2, 2, 2, 2]
    assert parse_program(b"", "test").content.tolist() == []


# tokens, and numbers that are Python's bit for bit

B = rb"[ \t\v\f\x00\x11-\x14\x1a\x7f]"
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


@fuzzed(st.one_of(BYTES, PROGRAM))
def test_regular_tokens_equal_their_regular_expressions(data: bytes) -> None:
    at, line_starts = 0, [0] if data else []
    for kind, text in read(data):
        assert text
        found = [(k, m) for k, p in PATTERNS if (m := re.compile(p).match(data, at))]
        if found and not (kind == Kind.BLANK and text == b"\xef\xbb\xbf"):
            assert (kind, text) == (found[0][0], found[0][1].group())
        else:
            assert kind not in (
                Kind.LINE_END,
                Kind.COMMENT,
                Kind.REMARK,
                Kind.WORD,
            )
            assert b"\n" not in text and b"\r" not in text
        at += len(text)
        if kind == Kind.LINE_END and at < len(data):
            line_starts.append(at)
    assert at == len(data)
    made = tokens(data, "test")
    assert made.start[made.first[:-1]].tolist() == line_starts


@fuzzed(
    st.one_of(
        st.floats(allow_nan=False, allow_infinity=False, width=32).map(lambda x: f"{x:f}"),
        st.floats(allow_nan=False, allow_infinity=False).map(lambda x: f"{x:.20f}"),
        st.from_regex(r"[+-]?([0-9]{1,25}\.?[0-9]{0,30}|\.[0-9]{1,30})", fullmatch=True),
        st.integers(2**53 - 20, 2**53 + 20).map(str),
        st.tuples(st.integers(2**52, 2**54), st.integers(0, 25)).map(
            lambda p: f"{p[0]}.{p[1]:025}"
        ),
    ),
    more=2,
)
def test_numbers_equal_pythons_bit_for_bit(text: str) -> None:
    program = parse_program(f"X{text}".encode(), "test")
    assert program.tokens.kind.tolist() == [Kind.WORD]
    assert program.numbers(np.array([0])).tolist()[0].hex() == float(text).hex()


def test_a_number_of_many_digits_is_infinite_as_in_python() -> None:
    assert parse_program(b"X" + b"9" * 400, "test").numbers(np.array([0])).tolist() == [np.inf]


@pytest.mark.parametrize(("text", "kinds"), [
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
])  # fmt: skip
def test_kinds(text: str, kinds: list[Kind]) -> None:
    assert [kind for kind, _ in read(text.encode())] == kinds
