"""Compiled scanner for the ordinary lines of an SHDR log: ISO time, items, numbers, plain words.

A number is computed here only where one rounding gives the nearest float64 (at most 2^53 times or
over a power of ten up to 10^22: W. D. Clinger, "How to read floating point numbers accurately",
1990); other numbers are copied out to be converted exactly.
"""

from typing import Any

import numpy as np

from pipeline.kernels import compiled, compiled_with
from pipeline.signals.shdr.lines import (
    ANY,
    FULL,
    HARD,
    HARD_BYTES,
    KEY_END,
    KEY_START,
    LINE,
    LINES,
    LONGEST_KEY,
    NEW_KEY,
    NOTHING,
    NUMBER,
    OTHER,
    POSITION,
    ROWS,
    SAMPLE,
    SLOW,
    TEXT,
    TEXT_BYTES,
    TEXTS,
    WORD,
)

# as pipeline.kernels.compiled, but woven into what calls it
inlined = compiled_with(nogil=True, _nrt=False, inline="always")

NONE, EXACT, COPIED, AWAY = 0, 1, 2, 3
"""Results of :func:`number_at`: no number, one, one to convert exactly, one out of its range."""

NO_DAY = -(1 << 31)

_TENS = 10.0 ** np.arange(23)
_WHOLE_TENS = 10 ** np.arange(10)
_MOST = np.uint64(1 << 53)


@compiled
def _days(year: Any, month: Any, day: Any) -> Any:
    """Days since 1970 in the Gregorian calendar, :data:`NO_DAY` for a day that is none."""
    if year < 1678 or year > 2261 or month < 1 or month > 12 or day < 1:
        return NO_DAY
    leap = year % 4 == 0 and (year % 100 != 0 or year % 400 == 0)
    length = 30 + ((month + (month > 7)) & 1)
    if month == 2:
        length = 29 if leap else 28
    if day > length:
        return NO_DAY
    from_march = year - (month <= 2)
    era = from_march // 400
    of_era = from_march - era * 400
    of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146097 + of_era * 365 + of_era // 4 - of_era // 100 + of_year - 719468


@inlined
def _digits(buf: Any, at: Any, n: Any) -> Any:
    """Number written by ``n`` digits, negative when one is none."""
    value: Any = 0
    worst: Any = 0
    for i in range(at, at + n):
        d = np.int64(buf[i]) - 48
        worst |= d | (9 - d)
        value = value * 10 + d
    return value if worst >= 0 else -1


@inlined
def _fraction(buf: Any, at: Any) -> Any:
    """Nanoseconds of the fraction at ``at``, and the place after it, -1 when it has no digit."""
    if buf[at] != 46:
        return 0, at
    first = at + 1
    at = first
    value: Any = 0
    while 48 <= buf[at] <= 57:
        if at - first < 9:
            value = value * 10 + np.int64(buf[at]) - 48
        at += 1
    if at == first:
        return 0, -1
    return value * _WHOLE_TENS[9 - min(at - first, 9)], at


@compiled
def _zone(buf: Any, at: Any, end: Any, mark: Any) -> Any:
    """Seconds east of UTC, and the place after the zone, -1 when it is not ordinary."""
    if buf[at] == 90:
        return 0, at + 1
    if buf[at] == mark:
        return 0, at
    if (buf[at] != 43 and buf[at] != 45) or at + 6 > end or buf[at + 3] != 58:
        return 0, -1
    hour, minute = _digits(buf, at + 1, 2), _digits(buf, at + 4, 2)
    if hour < 0 or hour > 23 or minute < 0 or minute > 59:
        return 0, -1
    east = hour * 3600 + minute * 60
    return (east if buf[at] == 43 else -east), at + 6


@inlined
def time_at(buf: Any, at: Any, end: Any, mark: Any, date: Any, days: Any) -> Any:
    """Nanoseconds since 1970, the place after the ISO time and its ``mark``, date and its days.

    The place is -1 when the time is not ordinary.  ``date`` and ``days`` come from the time before.
    """
    if at + 21 > end or buf[at + 4] != 45 or buf[at + 7] != 45 or buf[at + 10] != 84:
        return 0, -1, date, days
    year, month, day = _digits(buf, at, 4), _digits(buf, at + 5, 2), _digits(buf, at + 8, 2)
    if (year * 100 + month) * 100 + day != date:
        date, days = (year * 100 + month) * 100 + day, _days(year, month, day)
    hour, minute = _digits(buf, at + 11, 2), _digits(buf, at + 14, 2)
    second = _digits(buf, at + 17, 2)
    ordinary = buf[at + 13] == 58 and buf[at + 16] == 58 and days != NO_DAY
    ordinary &= 0 <= hour <= 23 and 0 <= minute <= 59 and 0 <= second <= 60
    if not ordinary:
        return 0, -1, -1, 0
    fraction, at = _fraction(buf, at + 19)
    if at < 0:
        return 0, -1, date, days
    east, at = _zone(buf, at, end, mark)
    if at < 0 or buf[at] != mark:
        return 0, -1, date, days
    seconds = days * 86400 + hour * 3600 + minute * 60 + second - east
    return seconds * 1_000_000_000 + fraction, at + 1, date, days


@inlined
def _exponent(buf: Any, at: Any) -> Any:
    """Exponent written at ``at`` (0 without one), and the place after it, -1 when it is broken."""
    if buf[at] != 101 and buf[at] != 69:
        return 0, at
    at += 1
    less = buf[at] == 45
    at += less or buf[at] == 43
    first = at
    exponent: Any = 0
    while 48 <= buf[at] <= 57:
        exponent = min(exponent * 10 + np.int64(buf[at]) - 48, 10_000)
        at += 1
    return (-exponent if less else exponent), (at if at > first else -1)


@compiled
def number_at(buf: Any, at: Any) -> Any:
    """Whether a number stands at ``at``, the number, and the place after it."""
    negative = buf[at] == 45
    at += negative or buf[at] == 43
    mantissa: Any = np.uint64(0)
    taken, power = 0, 0
    any_digit = cut = after_point = False
    while True:
        c = buf[at]
        if 48 <= c <= 57:
            any_digit = True
            cut |= taken >= 19
            if taken < 19:
                mantissa = mantissa * np.uint64(10) + np.uint64(c - 48)
                taken += mantissa > 0
                power -= after_point
            else:
                power += not after_point
        elif c == 46 and not after_point:
            after_point = True
        else:
            break
        at += 1
    exponent, at = _exponent(buf, at)
    if not any_digit or at < 0:
        return NONE, 0.0, at
    power += exponent
    if mantissa == 0:
        return EXACT, -0.0 if negative else 0.0, at
    if cut or mantissa > _MOST or power < -22 or power > 22:
        return (COPIED if -290 < power < 280 else AWAY), 0.0, at
    value = float(mantissa)
    value = value / _TENS[-power] if power < 0 else value * _TENS[power]
    return EXACT, -value if negative else value, at


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
def _code(buf: Any, start: int, stop: int, state: Any, slots: Any, offsets: Any, words: Any) -> int:
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
