"""The words of one plain line, compiled: from tokens to a row of numbers.

``words`` has a place for each letter, NaN where the line lacks it, and behind them one for each
modal group.  Plain are lines of words with numbers, each letter once, one code a group, and
comments.
"""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.gcode.characters import (
    LETTER_A,
    OPEN,
    POINT,
    Bytes,
    after_blanks,
    holds,
    is_letter,
)
from pipeline.gcode.plain_expressions import STACKS, Floats, Table, value_of
from pipeline.gcode.scanner import BLANK, COMMENT, LINE_END, REMARK, VALUED, WORD
from pipeline.gcode.statements import LARGEST
from pipeline.kernels import compiled

Words: TypeAlias = npt.NDArray[np.float64]
TokenArrays: TypeAlias = tuple[
    npt.NDArray[np.uint8], npt.NDArray[np.int32], Floats, npt.NDArray[np.int32]
]
"""``kind``, ``start``, ``value`` and ``first`` of :class:`~pipeline.gcode.words.Tokens`."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
A, C, F, G, N, R, X, Z = (LETTERS.index(letter) for letter in "ACFGNRXZ")
AXES = tuple(LETTERS.index(letter) for letter in "XYZABC")
CENTRES = tuple(LETTERS.index(letter) for letter in "IJK")
MOTION, PLANE, UNIT, DISTANCE, FEED_MODE, COUNT = range(26, 32)
"""Places of the codes: G0 to G3, G17 to G19, G20 and G21, G90 and G91, G94; number of words."""
ROOM = 32
WIDTH = ROOM + STACKS
"""Of ``words``, behind which expressions are worked out."""
ALLOWED = np.zeros(26, dtype=np.bool_)
ALLOWED[[*AXES, *CENTRES, F, N, R]] = True
PLACES = np.full(100, -1, dtype=np.int64)
for _place, _codes in (
    (MOTION, (0, 1, 2, 3)),
    (PLANE, (17, 18, 19)),
    (UNIT, (20, 21)),
    (DISTANCE, (90, 91)),
    (FEED_MODE, (94,)),
):
    PLACES[list(_codes)] = _place
INCREMENTS = np.zeros(26, dtype=np.bool_)
INCREMENTS[[*AXES, *CENTRES, R]] = True
"""Letters of lengths and angles, which some controls read in input increments."""


@compiled
def read_words(
    data: Bytes,
    tokens: TokenArrays,
    line: int,
    linuxcnc: bool,
    expressions: bool,
    table: Table,
    words: Words,
) -> bool:
    """Whether a line is plain, with expressions or without; then ``words`` holds it."""
    kind, start, value, first = tokens
    words[:ROOM] = np.nan
    words[COUNT] = 0
    for index in range(first[line - 1], first[line]):
        begin, end = start[index], start[index + 1]
        what = kind[index]
        if what in (WORD, VALUED):
            number = value[index]
            if what == VALUED and expressions:
                number = value_of(data, begin + 1, end, table, words[ROOM:])
            if not _keep(data[begin], number, words):
                return False
        elif what in (COMMENT, REMARK):
            if linuxcnc and _acts(data, begin, end):
                return False
        elif what not in (BLANK, LINE_END):
            return False
    return True


@compiled
def _acts(data: Bytes, start: int, end: int) -> bool:
    """Whether a comment is more to LinuxCNC: ``(abort, …)``, or an error, ``(`` in a comment."""
    first = after_blanks(data, start + 1)
    named = first < end and data[first] & 0xDF == LETTER_A
    return named or (data[start] == OPEN and holds(data, start + 1, end, OPEN))


@compiled
def given(words: Words, first: int, last: int) -> bool:
    """Whether one of the letters from ``first`` to ``last`` is in the line."""
    while first <= last and np.isnan(words[first]):
        first += 1
    return first <= last


@compiled
def _keep(letter: int, value: float, words: Words) -> bool:
    """Put a word into its place; whether it is plain and the place was free."""
    if not is_letter(letter) or not abs(value) <= LARGEST:
        return False
    place = (letter & 0xDF) - LETTER_A
    if place == G:
        if not 0 <= value < len(PLACES) or value != int(value):
            return False
        place = PLACES[int(value)]
        if place < 0:
            return False
    elif not ALLOWED[place] or (place == N and words[COUNT] > 0):
        return False
    if not np.isnan(words[place]):
        return False
    words[place] = value
    words[COUNT] += 1
    return True


@compiled
def scale_increments(data: Bytes, tokens: TokenArrays, line: int, inch: bool, words: Words) -> None:
    """Numbers without a decimal point count least input increments (IS-B)."""
    _, start, _, first = tokens
    for index in range(first[line - 1], first[line]):
        letter = data[start[index]]
        if not is_letter(letter):
            continue
        place = (letter & 0xDF) - LETTER_A
        if INCREMENTS[place] and not holds(data, start[index], start[index + 1], POINT):
            rotary = A <= place <= C
            words[place] *= 1e-4 if inch and not rotary else 1e-3
