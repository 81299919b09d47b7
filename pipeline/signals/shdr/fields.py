"""Words of an SHDR log: the fields of a line, times, numbers, data sets.

SHDR (simple hierarchical data representation) is what adapters send and agents log:
``time|item|value|item|value``.  Everything here is a plain function of text.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

import json
import math
import re
from datetime import date
from decimal import Decimal

BLANK = " \t\r"
"""Characters around a field that are not part of it."""

FIRST_YEAR, LAST_YEAR = 1678, 2261
"""Whole years that fit 64 bits of nanoseconds since 1970."""

_QUOTED = re.compile(r'[ \t]*"((?:[^"\\|]|\\.|\\$|"(?![ \t\r]*(?:\||$)))*+)"[ \t\r]*(?=\||$)', re.S)
_PLAIN = re.compile(r"(?:[^|\\]|\\\||\\(?!\|))*+", re.S)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_MILLISECONDS = re.compile(r"[+-]?\d{1,15}(?:\.\d{0,9})?", re.ASCII)
_ISO = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[Tt ](\d\d):(\d\d):(\d\d)(?:[.,](\d+))?"
    r"(?:[Zz]|([+-])(\d\d)(?::?(\d\d))?)?",
    re.ASCII,
)
_KEY = re.compile(r"[^\s={}]+")
_BRACE = re.compile(r"\\.|[{}]", re.S)


def fields_of(line: str) -> list[str]:
    r"""Fields of a line, blanks around them removed.

    A field in double quotes ends at the quote before ``|`` or the end, and ``\`` in it takes the
    next character as it is.  Outside quotes only ``\|`` is special: a pipe that does not separate.
    """
    if '"' not in line and "\\|" not in line:
        return [field.strip(BLANK) for field in line.split("|")]
    fields = []
    at = 0
    while at <= len(line):
        quoted = _QUOTED.match(line, at)
        if quoted:
            fields.append(re.sub(r"\\(.)", r"\1", quoted[1], flags=re.S))
            at = quoted.end() + 1
            continue
        plain = _PLAIN.match(line, at)
        end = plain.end() if plain else at
        fields.append(line[at:end].replace("\\|", "|").strip(BLANK))
        at = end + 1
    return fields


def number_of(text: str) -> float | None:
    """The finite decimal number that ``text`` is, None for others (``nan``, ``1_0``, ``""``)."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def iso_ns(text: str) -> int | None:
    """Nanoseconds since 1970 of an ISO 8601 time; UTC when it names no zone.

    Digits past the ninth of the fraction are cut off.  Second 60 is the first of the next minute.

    Returns
    -------
    int or None
        None when ``text`` is no such time or its year is outside 1678 to 2261.
    """
    found = _ISO.fullmatch(text)
    if not found:
        return None
    year, month, day, hour, minute, second = (int(found[i]) for i in range(1, 7))
    if not FIRST_YEAR <= year <= LAST_YEAR or hour > 23 or minute > 59 or second > 60:
        return None
    try:
        days = date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None
    seconds = days * 86400 + hour * 3600 + minute * 60 + second
    if found[8]:
        east = int(found[9]) * 3600 + int(found[10] or 0) * 60
        if int(found[9]) > 23 or int(found[10] or 0) > 59:
            return None
        seconds -= east if found[8] == "+" else -east
    return seconds * 10**9 + int((found[7] or "")[:9].ljust(9, "0"))


def milliseconds_ns(text: str) -> int | None:
    """Nanoseconds of a counter of milliseconds, None when ``text`` is no such number."""
    if not _MILLISECONDS.fullmatch(text):
        return None
    ns = int(Decimal(text) * 10**6)
    return ns if abs(ns) < 2**63 else None


def entries_of(text: str) -> list[tuple[str, str | None]]:
    """Entries ``key=value`` of a data set, value None where the entry is removed.

    A value with blanks stands in braces or quotes.

    Raises
    ------
    ValueError
        When a brace or quote is not closed, or a value has no key.
    """
    entries: list[tuple[str, str | None]] = []
    at = 0
    while True:
        while at < len(text) and text[at].isspace():
            at += 1
        if at == len(text):
            return entries
        key = _KEY.match(text, at)
        if not key:
            raise ValueError(f"the data set has no key at character {at + 1}")
        at = key.end()
        value = None
        if text[at : at + 1] == "=":
            value, at = _entry_value(text, at + 1)
        entries.append((key[0], value or None))


def _entry_value(text: str, at: int) -> tuple[str, int]:
    opening = text[at : at + 1]
    if opening == "{":
        end = _closing_brace(text, at)
        return text[at + 1 : end], end + 1
    if opening and opening in "\"'":
        found = re.compile(rf"{opening}((?:[^{opening}\\]|\\.)*+){opening}", re.S).match(text, at)
        if not found:
            raise ValueError(f"the quote at character {at + 1} of the data set is not closed")
        return re.sub(r"\\(.)", r"\1", found[1], flags=re.S), found.end()
    end = at
    while end < len(text) and not text[end].isspace():
        end += 1
    return text[at:end], end


def _closing_brace(text: str, at: int) -> int:
    depth = 0
    for mark in _BRACE.finditer(text, at):
        depth += {"{": 1, "}": -1}.get(mark[0], 0)
        if depth == 0:
            return mark.start()
    raise ValueError(f"the brace at character {at + 1} of the data set is not closed")


def json_of(said: dict[str, object]) -> str | None:
    """JSON of what else was said, without what is empty; None when nothing is left."""
    kept = {name: value for name, value in said.items() if value not in ("", None)}
    return json.dumps(kept, ensure_ascii=False, sort_keys=True) if kept else None
