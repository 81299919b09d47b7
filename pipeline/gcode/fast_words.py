"""Words of one line, compiled: from tokens to an array of numbers, simple expressions evaluated.

``words`` has a place for each letter, NaN where the line lacks it, and behind them one for each
modal group.  Simple expressions are numbers, ``#5``, ``#<name>``, signs, ``+ - * /`` and brackets;
any other gives NaN and is left to the interpreter.  Operators are taken in the order of
:mod:`pipeline.gcode.dialects.expression_parser`, so that the bits are the same.
"""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from pipeline.gcode import scanner
from pipeline.gcode.scanner import Bytes, after_blanks, is_letter
from pipeline.gcode.statements import LARGEST
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats, Ints

Table: TypeAlias = tuple[Bytes, Ints, Ints, Floats]
"""Names one after the other, where each ends, numbers, and the values of names, then of numbers."""

DEEPEST = 16
"""Operators and brackets that wait for their right side; more are left to the interpreter."""
ADD, SUBTRACT, MULTIPLY, DIVIDE, BRACKET, NEGATIVE_BRACKET = (float(n) for n in range(6))
"""Operators and brackets on the stack."""
STACKS = 2 * DEEPEST
"""Floats to work in: values, then operators."""


def table_of(variables: Mapping[int | str, float]) -> Table:
    """Variables as :func:`value_of` looks them up."""
    names = {
        key: value for key, value in variables.items() if isinstance(key, str) and key.isascii()
    }
    numbers = {key: value for key, value in variables.items() if isinstance(key, int)}
    texts = [name.encode("ascii") for name in names]
    return (
        np.frombuffer(b"".join(texts), dtype=np.uint8),
        np.cumsum([len(text) for text in texts], dtype=np.int64),
        np.array(list(numbers), dtype=np.int64),
        np.array([*names.values(), *numbers.values()], dtype=np.float64),
    )


@compiled
def value_of(data: Bytes, at: int, end: int, table: Table, stacks: Floats) -> float:
    """Value of the expression in the bytes from ``at`` to before ``end``."""
    values, waiting = 0, 0
    expects_value = True
    while True:
        at = after_blanks(data, at)
        if at >= end:
            break
        if expects_value:
            at, value, opens = operand(data, at, end, table)
            if opens >= 0:
                if waiting == DEEPEST:
                    return np.nan
                stacks[DEEPEST + waiting] = opens
                waiting += 1
                continue
            if np.isnan(value) or values == DEEPEST:
                return np.nan
            stacks[values] = value
            values += 1
            expects_value = False
            continue
        operator = operator_of(data, at, end)
        values, waiting = reduced(stacks, values, waiting, operator)
        if operator < 0 or waiting < 0 or waiting == DEEPEST:
            return np.nan
        at += 1
        if operator != BRACKET:
            stacks[DEEPEST + waiting] = operator
            waiting += 1
            expects_value = True
    if expects_value or waiting > 0 or values != 1:
        return np.nan
    return stacks[0]


@compiled
def operator_of(data: Bytes, at: int, end: int) -> float:
    """The operator at ``at``, ``BRACKET`` for ``]``, -1 for anything else."""
    c = data[at]
    if c == scanner.PLUS:
        return ADD
    if c == scanner.MINUS:
        return SUBTRACT
    if c == scanner.SLASH:
        return DIVIDE
    if c == scanner.CLOSE_BRACKET:
        return BRACKET
    after = after_blanks(data, at + 1)
    if c == scanner.STAR and not (after < end and data[after] == scanner.STAR):
        return MULTIPLY
    return -1.0


@compiled
def reduced(stacks: Floats, values: int, waiting: int, operator: float) -> tuple[int, int]:
    """Carry out what binds at least as tightly as ``operator``, a bracket all that waits in it.

    Numbers of values and of operators that are left; the latter is -1 where there is no value.
    """
    while waiting > 0:
        last = stacks[DEEPEST + waiting - 1]
        if last >= BRACKET:
            if operator == BRACKET:
                if last == NEGATIVE_BRACKET:
                    stacks[values - 1] = -stacks[values - 1]
                return values, waiting - 1
            return values, waiting
        if operator in (MULTIPLY, DIVIDE) and last in (ADD, SUBTRACT):
            return values, waiting
        result = combined(stacks[values - 2], stacks[values - 1], last)
        if not abs(result) <= LARGEST:
            return values, -1
        stacks[values - 2] = result
        values, waiting = values - 1, waiting - 1
    return values, -1 if operator == BRACKET else 0


@compiled
def combined(left: float, right: float, operator: float) -> float:
    """One operation; NaN where there is no result."""
    if operator == ADD:
        return left + right
    if operator == SUBTRACT:
        return left - right
    if operator == MULTIPLY:
        return left * right
    return left / right if right != 0 else np.nan


@compiled
def operand(data: Bytes, at: int, end: int, table: Table) -> tuple[int, float, float]:
    """End of the operand at ``at``, its value, and the bracket that it opens or -1."""
    negative = data[at] == scanner.MINUS
    if negative or data[at] == scanner.PLUS:
        at = after_blanks(data, at + 1)
    if at >= end or data[at] in (scanner.PLUS, scanner.MINUS):
        return at, np.nan, -1.0  # two signs: some controls stop there
    c = data[at]
    if c == scanner.OPEN_BRACKET:
        return at + 1, np.nan, NEGATIVE_BRACKET if negative else BRACKET
    value = np.nan
    if scanner.is_digit(c) or c == scanner.POINT:
        at, value = scanner.number(data, at)
    elif c == scanner.HASH:
        at, value = variable(data, after_blanks(data, at + 1), end, table)
    if not abs(value) <= LARGEST:
        value = np.nan
    return at, -value if negative else value, -1.0


@compiled
def variable(data: Bytes, at: int, end: int, table: Table) -> tuple[int, float]:
    """End of the name or number of a variable, and the variable's value or NaN."""
    texts, ends, numbers, values = table
    if at < end and data[at] == scanner.LESS:
        close = at + 1
        while close < end and data[close] != scanner.GREATER:
            close += 1
        begin = 0
        for index in range(len(ends)):
            if same_name(data, at + 1, close, texts, begin, ends[index]):
                return close + 1, values[index]
            begin = ends[index]
    elif at < end and scanner.is_digit(data[at]):
        close, key = scanner.number(data, at)
        for index in range(len(numbers)):
            if numbers[index] == key:
                return close, values[len(ends) + index]
    return end, np.nan


@compiled
def same_name(data: Bytes, at: int, end: int, texts: Bytes, begin: int, stop: int) -> bool:
    """Whether a name as written is the name ``texts[begin:stop]``."""
    while at < end:
        if not scanner.is_blank(data[at]):
            if begin == stop or scanner.lower(data[at]) != texts[begin]:
                return False
            begin += 1
        at += 1
    return begin == stop


Words: TypeAlias = npt.NDArray[np.float64]
TokenArrays: TypeAlias = tuple[npt.NDArray[np.uint8], npt.NDArray[np.int32], npt.NDArray[np.int32]]
"""``kind``, ``start`` and ``first`` of :class:`~pipeline.gcode.program.Tokens`."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
A, C, F, G, N, R, X, Z = (LETTERS.index(letter) for letter in "ACFGNRXZ")
AXES = tuple(LETTERS.index(letter) for letter in "XYZABC")
CENTRES = tuple(LETTERS.index(letter) for letter in "IJK")
MOTION, PLANE, UNIT, DISTANCE, FEED_MODE, COUNT = range(26, 32)
"""Places of the codes: G0 to G3, G17 to G19, G20 and G21, G90 and G91, G94; number of words."""
STACK_START = 32
WIDTH = STACK_START + STACKS
"""Width of ``words`` with the stacks of the expressions behind it."""
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
    data: Bytes, tokens: TokenArrays, line: int, linuxcnc: bool, expressions: bool, table: Table,
    words: Words,
) -> bool:  # fmt: skip
    """Whether a line is a fast one, with expressions or without; then ``words`` holds it."""
    kind, start, first = tokens
    words[:STACK_START] = np.nan
    words[COUNT] = 0
    for index in range(first[line - 1], first[line]):
        begin, end = start[index], start[index + 1]
        what = kind[index]
        if what in (scanner.WORD, scanner.VALUED):
            number = np.nan
            if what == scanner.WORD:
                number = scanner.number_of(data, begin)
            elif expressions:
                number = value_of(data, begin + 1, end, table, words[STACK_START:])
            if not _keep(data[begin], number, words):
                return False
        elif what in (scanner.COMMENT, scanner.REMARK):
            if linuxcnc and _acts(data, begin, end):
                return False
            if not linuxcnc and what == scanner.REMARK and scanner.remarks_block(data, begin):
                return False
        elif what not in (scanner.BLANK, scanner.LINE_END):
            return False
    return True


@compiled
def _acts(data: Bytes, start: int, end: int) -> bool:
    """Whether a comment is more to LinuxCNC: ``(abort, …)``, or an error, ``(`` in a comment."""
    first = after_blanks(data, start + 1)
    named = first < end and data[first] & 0xDF == scanner.LETTER_A
    return named or (
        data[start] == scanner.OPEN and scanner.holds(data, start + 1, end, scanner.OPEN)
    )


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
    place = (letter & 0xDF) - scanner.LETTER_A
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
    _, start, first = tokens
    for index in range(first[line - 1], first[line]):
        letter = data[start[index]]
        if not is_letter(letter):
            continue
        place = (letter & 0xDF) - scanner.LETTER_A
        if INCREMENTS[place] and not scanner.holds(
            data, start[index], start[index + 1], scanner.POINT
        ):
            rotary = A <= place <= C
            words[place] *= 1e-4 if inch and not rotary else 1e-3
