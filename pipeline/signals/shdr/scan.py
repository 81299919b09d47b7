"""Compiled scanner for the ordinary lines of an SHDR log: ISO time, items, numbers, plain words."""

from typing import Any

import numpy as np

from pipeline.kernels import compiled
from pipeline.signals.literals import AWAY, COPIED, NONE, inlined, number_at, time_at

NOTHING, NUMBER, TEXT = 0, 1, 2
"""Content of a row."""

LINES, NEW_KEY, FULL = 0, 1, 2
"""Results of :func:`scan`: all lines are read, a name is met first, a table is full."""

ANY, SAMPLE, EVENT, WORD, OTHER = 0, 1, 2, 3, 4
"""Forms of an item's value; a line with an OTHER is for the reference path."""

POSITION, LINE, ROWS, SLOW, TEXTS, TEXT_BYTES, HARD, HARD_BYTES = range(8)
KEY_START, KEY_END = range(8, 10)
"""Places in the scanner's state."""

LONGEST_KEY = 256
"""Bytes of the longest item's name that is scanned."""

_FNV, _PRIME = np.uint64(14695981039346656037), np.uint64(1099511628211)


@inlined
def _hash(buf: Any, start: Any, end: Any) -> Any:
    h = _FNV
    for i in range(start, end):
        h = (h ^ np.uint64(buf[i])) * _PRIME
    return h ^ (h >> np.uint64(29))


@compiled
def find(buf: Any, start: Any, end: Any, slots: Any, offsets: Any, words: Any) -> Any:
    """Code of a word in a table, or -1, and the slot where it is or belongs."""
    mask = np.uint64(len(slots) - 1)
    slot = _hash(buf, start, end) & mask
    while slots[slot]:
        code = np.int64(slots[slot]) - 1
        begin = offsets[code]
        if offsets[code + 1] - begin == end - start:
            i = 0
            while i < end - start and words[begin + i] == buf[start + i]:
                i += 1
            if i == end - start:
                return code, np.int64(slot)
        slot = (slot + np.uint64(1)) & mask
    return -1, np.int64(slot)


@compiled
def add(buf: Any, start: Any, end: Any, code: Any, slot: Any,
        slots: Any, offsets: Any, words: Any) -> None:  # fmt: skip
    """Put a word into a table as number ``code``."""
    begin = offsets[code]
    for i in range(end - start):
        words[begin + i] = buf[start + i]
    offsets[code + 1] = begin + end - start
    slots[slot] = code + 1


@compiled
def is_word(buf: Any, start: Any, end: Any, word: Any) -> Any:
    """Whether the letters are ``word`` (upper case), whatever their case."""
    if end - start != len(word):
        return False
    for i in range(len(word)):
        c = buf[start + i]
        if (c - 32 if 97 <= c <= 122 else c) != word[i]:
            return False
    return True


_UNAVAILABLE = np.frombuffer(b"UNAVAILABLE", np.uint8)
_NORMAL = np.frombuffer(b"NORMAL", np.uint8)
_WARNING = np.frombuffer(b"WARNING", np.uint8)
_FAULT = np.frombuffer(b"FAULT", np.uint8)

_READ, _ODD, _NEW, _FULL = 0, 1, 2, 3
"""Results of a line."""


@compiled
def _leave(buf: Any, start: int, before: int, state: Any, slow: Any) -> int:
    """Leave a line to the reference path, unless it is empty; the place after it."""
    at = start
    while buf[at] != 10:
        at += 1
    if at > start + (buf[start] == 13):
        n = state[SLOW]
        slow[n, 0], slow[n, 1], slow[n, 2], slow[n, 3] = before, state[LINE], start, at
        state[SLOW] += 1
    return at + 1


@inlined
def _line(buf: Any, at: Any, time: Any, state: Any, times: Any, items: Any, numbers: Any,
          codes: Any, holds: Any, key_slots: Any, key_offsets: Any, key_words: Any,
          text_slots: Any, text_offsets: Any, text_words: Any, shapes: Any, factors: Any,
          offsets: Any, hard_rows: Any, hard_offsets: Any, hard_copies: Any) -> Any:  # fmt: skip
    """Read ``item|value`` pairs to the end of the line and write their rows."""
    first = True
    while True:
        start, at = at, _key_end(buf, at, first)
        first = False
        if at < 0:
            return _ODD, at
        item = find(buf, start, at, key_slots, key_offsets, key_words)[0]
        if item < 0:
            state[KEY_START], state[KEY_END] = start, at
            return _NEW, at
        row, shape = state[ROWS], shapes[item]
        if row == len(times):
            return _FULL, at
        at = _past_blanks(buf, at + 1)
        how, number, stop, after = _number(buf, at, shape)
        code, hold = -1, NUMBER
        if how == NONE:
            stop, after = _text(buf, at, shape)
            hold = NOTHING if is_word(buf, at, stop, _UNAVAILABLE) else TEXT
        if after < 0 or (hold == TEXT and shape == SAMPLE):
            return _ODD, at
        if hold == TEXT:
            code = _code(buf, at, stop, state, text_slots, text_offsets, text_words)
        elif how == COPIED:
            code = _copy(buf, at, stop, row, state, hard_rows, hard_offsets, hard_copies)
        elif factors[item] != 1.0 or offsets[item] != 0.0:
            number = number * factors[item] + offsets[item]
        if code == -2:
            return _FULL, at
        times[row], items[row], numbers[row] = time, item, number
        codes[row], holds[row] = code, hold
        state[ROWS] = row + 1
        at = after
        if buf[after - 1] == 10:
            return _READ, at


@inlined
def _key_end(buf: Any, at: Any, first: Any) -> Any:
    """End of the item's name at ``at``, -1 when it is not ordinary."""
    start = at
    c = buf[at]
    # After a count a number or nothing may be the rate of a time series.
    if c == 124 or c == 34 or c == 64 or c == 32 or (not first and _numeric(c)):
        return -1
    while buf[at] != 124:
        if buf[at] < 32 or buf[at] > 126 or buf[at] == 92:
            return -1
        at += 1
    return at if buf[at - 1] != 32 and at - start <= LONGEST_KEY else -1


@inlined
def _past_blanks(buf: Any, at: Any) -> Any:
    while buf[at] == 32:
        at += 1
    return at


@inlined
def _numeric(c: Any) -> Any:
    return 48 <= c <= 57 or c == 45 or c == 43 or c == 46


@inlined
def _number(buf: Any, at: Any, shape: Any) -> Any:
    """Form of a number at ``at``, the number, its end, and the place behind it (-1: undecided)."""
    if shape == OTHER:
        return AWAY, 0.0, at, -1
    if shape == WORD or not _numeric(buf[at]):
        return NONE, 0.0, at, -1
    how, number, stop = number_at(buf, at)
    if how == NONE:
        return NONE, 0.0, at, -1
    after = stop
    while buf[after] == 32 or buf[after] == 9:
        after += 1
    if buf[after] == 13 and buf[after + 1] == 10:
        after += 1
    if buf[after] != 124 and buf[after] != 10:
        return NONE, 0.0, at, -1
    return how, number, stop, (after + 1 if how != AWAY else -1)


@compiled
def _copy(buf: Any, start: int, stop: int, row: int, state: Any, rows: Any, offsets: Any,
          copies: Any) -> int:  # fmt: skip
    """Copy a number's digits out; -1, or -2 when the table is full."""
    start += buf[start] == 43
    n, at = state[HARD], state[HARD_BYTES]
    if n == len(rows) or at + stop - start > len(copies):
        return -2
    for i in range(start, stop):
        copies[at] = buf[i]
        at += 1
    rows[n], offsets[n + 1] = row, at
    state[HARD], state[HARD_BYTES] = n + 1, at
    return -1


@compiled
def _code(buf: Any, start: int, stop: int, state: Any, slots: Any, offsets: Any,
          words: Any) -> int:  # fmt: skip
    """Code of a text, taken in when it is new, or -2 when the table is full."""
    code, slot = find(buf, start, stop, slots, offsets, words)
    if code < 0:
        code = state[TEXTS]
        if code + 2 > len(offsets) or state[TEXT_BYTES] + stop - start > len(words):
            return -2
        add(buf, start, stop, code, slot, slots, offsets, words)
        state[TEXTS] += 1
        state[TEXT_BYTES] += stop - start
    return code


@compiled
def _text(buf: Any, start: int, shape: int) -> Any:
    """End of a text, and the place after its ``|`` or line end, -1 when it is not ordinary."""
    at = start
    c = buf[at]
    if c == 34:
        return at, -1
    may_be_position = shape == ANY and _numeric(c)
    while c != 124 and c != 10 and not (c == 13 and buf[at + 1] == 10):
        odd = c < 32 or c > 126 or (c == 92 and buf[at + 1] == 124)
        if odd or (c == 32 and may_be_position):
            return at, -1
        at += 1
        c = buf[at]
    stop = at
    while stop > start and buf[stop - 1] == 32:
        stop -= 1
    if c == 124 and ((shape == ANY and _is_level(buf, start, stop)) or _holds_time(buf, start, at)):
        return at, -1
    return stop, at + 1 + (c == 13)


@compiled
def _holds_time(buf: Any, start: int, stop: int) -> Any:
    """Whether an ISO time may begin inside a text: the next line's, where a line lost its end."""
    for i in range(start, stop - 14):  # "-MM-DDThh:mm:ss" is the shortest form
        if buf[i] == 45 and buf[i + 3] == 45 and buf[i + 6] == 84 and buf[i + 9] == 58:
            return True
    return False


@compiled
def _is_level(buf: Any, start: int, stop: int) -> Any:
    return (
        is_word(buf, start, stop, _NORMAL)
        or is_word(buf, start, stop, _WARNING)
        or is_word(buf, start, stop, _FAULT)
        or is_word(buf, start, stop, _UNAVAILABLE)
    )


@compiled
def scan(buf: Any, closed: bool, longest: int, state: Any, rows: Any, slow: Any,
         keys: Any, plans: Any, texts: Any, hard: Any) -> int:  # fmt: skip
    """Read lines from ``state[POSITION]`` to the end of ``buf``, and say why that ended.

    ``buf``: (N,) uint8, lines each with its line feed.  ``closed``: no more names are taken in,
    lines with new ones are left over.  ``longest``: bytes of the longest line that is read.
    ``state``: (10,) int64, where reading stands and how full the tables are.  ``rows``: (R,) arrays
    of time [ns], item, number, text code, what the row holds.  ``slow``: (S, 4) int64, lines left
    over: rows before it, number of the line, start, end.  ``keys``, ``texts``: tables of words:
    slots, offsets, bytes.  ``plans``: (K,) arrays of form, factor and offset of each key.
    ``hard``: rows of numbers that are not converted here, offsets of their copies, copies.

    Returns ``LINES``, ``NEW_KEY`` or ``FULL``.
    """
    times, items, numbers, codes, holds = rows
    key_slots, key_offsets, key_words = keys
    text_slots, text_offsets, text_words = texts
    shapes, factors, offsets = plans
    hard_rows, hard_offsets, hard_copies = hard
    date, days = -1, 0
    while state[POSITION] < len(buf):
        start = state[POSITION]
        before, hard_before, bytes_before = state[ROWS], state[HARD], state[HARD_BYTES]
        if state[SLOW] == len(slow):
            return FULL
        time, at, date, days = time_at(buf, start, len(buf), 124, date, days)
        result = _ODD
        if at >= 0:
            result, at = _line(
                buf, at, time, state, times, items, numbers, codes, holds,
                key_slots, key_offsets, key_words, text_slots, text_offsets, text_words,
                shapes, factors, offsets, hard_rows, hard_offsets, hard_copies,
            )  # fmt: skip
        if result != _READ or at - start > longest:
            state[ROWS], state[HARD], state[HARD_BYTES] = before, hard_before, bytes_before
            if result == _NEW and not closed:
                return NEW_KEY
            if result == _FULL and before > 0:
                return FULL
            at = _leave(buf, start, before, state, slow)
        state[POSITION] = at
        state[LINE] += 1
    return LINES
