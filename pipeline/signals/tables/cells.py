"""Cells of a table: numbers, words or times, or null where the file says nothing.

A cell that is blank, not a number by IEEE 754 or by a program's word for it is null.  A cell that
holds anything else but a finite number is bad, and its row is rejected.  Times are whole
nanoseconds since 1970 in UTC, or seconds since the start; text is read digit by digit into
integers, so that no nanosecond is lost to a float.
"""

import re
from datetime import datetime
from decimal import Decimal
from fractions import Fraction
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.schema.arrays import Bools, Ints
from pipeline.signals.formats import TableLayout, UnreadableFile

Cells = Any
"""An Arrow array, chunked or not; Arrow has no types for the type checker."""

NOTHING = (
    "", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "-1.#qnan", "1.#ind",
     "na", "n/a", "#n/a", "null", "none", "nil", "unavailable", "-", "--", "---", "missing",
)  # fmt: skip
"""Text of programs, in lower case, for a missing number."""

NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"
"""A number in text, with a decimal point."""


_GROUPED = (
    r"^[+-]?[0-9]{1,3}(?:(?:['\x{a0}\x{202f} ][0-9]{3})+(?:\.[0-9]+)?|(?:,[0-9]{3})+\.[0-9]+"
    r"|(?:,[0-9]{3}){2,})$"
)
"""Groups of three digits; a single comma may be a decimal mark and is no number."""


def numbers(cells: Cells, decimal: str = ".") -> tuple[pa.Array, Bools]:
    """Cells as float64, null without a value, and where one is no finite number; (T,) each."""
    cells = one_array(cells)
    bad = np.zeros(len(cells), bool)
    if pa.types.is_string(cells.type):
        values = _cast(cells) if decimal == "." else None
        if values is None:
            values, bad = _parsed(cells, decimal)
    elif _is_numeric(cells.type):
        values = pc.cast(cells, pa.float64(), safe=False)
    else:
        raise UnreadableFile(f"a column of type {cells.type} holds no numbers; name another column")
    plain_values = values.to_numpy(zero_copy_only=False)
    infinite = np.isinf(plain_values)
    return pa.array(plain_values, mask=~np.isfinite(plain_values)), bad | infinite


def words(cells: Cells) -> pa.Array:
    """Cells as words without the blanks around them; null where blank or ``UNAVAILABLE``."""
    cells = one_array(cells)
    if pa.types.is_floating(cells.type):
        whole = pc.equal(pc.floor(cells), cells).fill_null(False)
        as_integer = pc.cast(pc.if_else(whole, cells, None), pa.int64(), safe=False)
        text = pc.coalesce(pc.cast(as_integer, pa.string()), pc.cast(cells, pa.string()))
        cells = pc.if_else(pc.is_nan(cells), None, text)
    elif not pa.types.is_string(cells.type):
        try:
            cells = pc.cast(cells, pa.string())
        except (pa.ArrowNotImplementedError, pa.ArrowInvalid) as error:
            raise UnreadableFile(
                f"a column of type {cells.type} holds no words; name another column"
            ) from error
    text = pc.utf8_trim_whitespace(cells)
    nothing = pc.or_(pc.equal(text, ""), pc.equal(text, "UNAVAILABLE"))
    return pc.if_else(nothing, pa.scalar(None, pa.string()), text)


def one_array(cells: Cells) -> pa.Array:
    """One array, without dictionary; any kind of text as ``string``."""
    if isinstance(cells, pa.ChunkedArray):
        cells = cells.combine_chunks()
        if isinstance(cells, pa.ChunkedArray):  # more text than one array can hold
            raise UnreadableFile("a column holds more than 2 GB of text; split the file")
    if pa.types.is_dictionary(cells.type):
        cells = cells.dictionary_decode()
    kind = cells.type
    if pa.types.is_large_string(kind) or pa.types.is_binary(kind) or pa.types.is_string_view(kind):
        try:
            return pc.cast(cells, pa.string())
        except pa.ArrowInvalid as error:
            raise UnreadableFile("a column holds bytes that are no text") from error
    return cells


def _is_numeric(kind: pa.DataType) -> bool:
    types = pa.types
    return (
        types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
        or types.is_decimal(kind) or types.is_null(kind)
    )  # fmt: skip


def _cast(cells: pa.Array) -> pa.Array | None:
    """Arrow's own fast parser; None when it meets a cell that it does not know."""
    try:
        return pc.cast(cells, pa.float64())
    except pa.ArrowInvalid:
        return None


def _parsed(cells: pa.Array, decimal: str) -> tuple[pa.Array, Bools]:
    text = pc.utf8_trim_whitespace(cells)
    silent = pc.is_in(pc.utf8_lower(text), value_set=pa.array(NOTHING))
    nothing = pc.or_kleene(silent, pc.is_null(text))
    if decimal != ".":
        # A point in a file with decimal commas is a mark of thousands.
        text = pc.replace_substring(pc.replace_substring(text, ".", "\0"), decimal, ".")
        text = pc.replace_substring(text, "\0", ",")
    grouped = pc.match_substring_regex(text, _GROUPED).fill_null(False)
    text = pc.if_else(grouped, pc.replace_substring_regex(text, "[,'\u00a0\u202f ]", ""), text)
    good = pc.match_substring_regex(text, NUMBER).fill_null(False)
    digits = pc.if_else(good, pc.utf8_ltrim(text, "+"), pa.scalar(None, pa.string()))
    known = pc.or_(good, nothing.fill_null(True)).to_numpy(zero_copy_only=False)
    return pc.cast(digits, pa.float64()), ~known


Instants = tuple[Ints, Bools]

NANOSECONDS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9}
TIME_UNITS = ("iso", *NANOSECONDS, *(f"unix_{unit}" for unit in ("s", "ms", "us", "ns")))

_ISO = (
    r"^(?P<Y>[0-9]{4})[-/.](?P<M>[0-9]{1,2})[-/.](?P<D>[0-9]{1,2})"
    r"(?:(?:[Tt]|[ ]+)(?P<h>[0-9]{1,2}):(?P<m>[0-9]{2})(?::(?P<s>[0-9]{2})"
    r"(?:[.,:](?P<f>[0-9]+))?)?)?[ ]*(?P<z>[Zz]|[+-][0-9]{2}:?[0-9]{2})?$"
)
_LONGEST = 9_223_000_000  # seconds that int64 nanoseconds hold, less a day for time zones


def instants(cells: Cells, layout: TableLayout) -> Instants:
    """Instants [ns since 1970 UTC] of a time column, and rows without one; shape (T,) each."""
    cells = one_array(cells)
    if pa.types.is_timestamp(cells.type):
        return _timestamps(cells, layout.time_zone)
    if layout.time_unit == "iso":
        if not pa.types.is_string(cells.type):
            raise UnreadableFile(
                f"the time column holds {cells.type}, not dates: give its time_unit"
            )
        return _formatted(cells, layout) if layout.time_format else _iso(cells, layout.time_zone)
    unit = NANOSECONDS[layout.time_unit.removeprefix("unix_")]
    time, bad = _counted(cells, unit, layout.decimal)
    if not layout.time_unit.startswith("unix_"):
        start = start_of(layout)
        bad = bad | (np.abs(time) > _LONGEST * 10**9 - abs(start))
        time = np.where(bad, 0, time) + start
    return time, bad


def seconds(cells: Cells, layout: TableLayout) -> tuple[pa.Array, Bools]:
    """Time since the start [s] as float64, and where a cell holds none."""
    values, bad = numbers(cells, layout.decimal)
    scale = Fraction(NANOSECONDS[layout.time_unit], 10**9)
    # Dividing by a whole number keeps what multiplying by 0.001 would round.
    scaled = pc.divide(pc.multiply(values, float(scale.numerator)), float(scale.denominator))
    return scaled, bad | values.is_null().to_numpy(zero_copy_only=False)


def regular(place: Ints, rate: float, start: int) -> Ints:
    """Instants [ns] of the samples at ``place`` (from 0) of a recording with a fixed rate [Hz]."""
    period = Fraction(10**9) / Fraction(str(rate))
    top, bottom = period.numerator, period.denominator
    if len(place) and int(place[-1]) * top * 2 < 2**62:
        return start + (place * top * 2 + bottom) // (2 * bottom)
    return start + np.array([(int(k) * top * 2 + bottom) // (2 * bottom) for k in place], np.int64)


def start_of(layout: TableLayout) -> int:
    """``layout.start`` [ns since 1970]."""
    time, bad = _iso(pa.array([layout.start or ""]), layout.time_zone)
    if bad[0]:
        raise ValueError(
            f"start {layout.start!r} of the table's layout is no instant: write it as "
            "'2024-05-17T08:00:00Z'"
        )
    return int(time[0])


def _timestamps(cells: pa.Array, zone: str) -> Instants:
    bad = cells.is_null().to_numpy(zero_copy_only=False).copy()
    try:
        time = pc.cast(cells, pa.timestamp("ns", cells.type.tz))
    except pa.ArrowInvalid as error:
        raise UnreadableFile(
            "the time column holds instants before 1678 or after 2262; correct its dates"
        ) from error
    time = pc.cast(time, pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
    return (time, bad) if cells.type.tz else _localised(time, bad, zone)


def _iso(cells: pa.Array, zone: str) -> Instants:
    """Dates and times as in ISO 8601, with ``/`` or ``.`` in the date, or American, month first."""
    cells = _from_american(pc.utf8_trim_whitespace(cells))
    parts = pc.extract_regex(cells, _ISO)
    bad = parts.is_null().to_numpy(zero_copy_only=False).copy()

    def part(name: str) -> Ints:
        text = pc.struct_field(parts, name)
        text = pc.if_else(pc.equal(text, ""), "0", text)
        return pc.cast(text.fill_null("0"), pa.int64()).to_numpy(zero_copy_only=False)

    year, month, day, hour = (part(name) for name in "YMDh")
    month_start = (year - 1970).astype("M8[Y]").astype("M8[M]") + np.clip(month - 1, 0, 11)
    date = month_start.astype("M8[D]") + (day - 1)
    bad |= (month < 1) | (month > 12) | (day < 1) | (date.astype("M8[M]") != month_start)
    bad |= (hour > 23) | (part("m") > 59) | (part("s") > 59)
    fraction = pc.struct_field(parts, "f").fill_null("")
    fraction = pc.utf8_slice_codeunits(pc.utf8_rpad(fraction, 9, "0"), 0, 9)
    nano = pc.cast(fraction, pa.int64()).to_numpy(zero_copy_only=False)
    second = date.astype(np.int64) * 86400 + hour * 3600 + part("m") * 60 + part("s")
    zoned = pc.struct_field(parts, "z").fill_null("")
    second = second - _offsets(zoned)
    bad |= np.abs(second) > _LONGEST
    time = np.where(bad, 0, second) * 10**9 + nano
    naive = pc.equal(zoned, "").to_numpy(zero_copy_only=False)
    local, lost = _localised(time, bad, zone)
    return np.where(naive, local, time), np.where(naive, lost, bad)


_AMERICAN = (
    r"^(?P<M>[0-9]{1,2})/(?P<D>[0-9]{1,2})/(?P<Y>[0-9]{4}),?[ ]+(?P<h>1[0-2]|0?[1-9])"
    r"(?P<rest>:[0-9]{2}(?::[0-9]{2}(?:[.,:][0-9]+)?)?)[ \x{a0}\x{202f}]*(?P<p>[AaPp])[.]?[Mm][.]?$"
)


def _from_american(cells: pa.Array) -> pa.Array:
    """Month/day/year and hours of AM and PM as ISO 8601; left as they are where a month is none."""
    parts = pc.extract_regex(cells, _AMERICAN)
    if parts.null_count == len(parts):
        return cells
    month, day, year, hour, rest, half = (pc.struct_field(parts, n) for n in
                                          ("M", "D", "Y", "h", "rest", "p"))  # fmt: skip
    if pc.max(pc.cast(month, pa.int64())).as_py() > 12:  # days stand first
        return cells
    hours = pc.if_else(pc.equal(hour.cast(pa.int64()), 12), 0, hour.cast(pa.int64()))
    hours = pc.add(hours, pc.if_else(pc.equal(pc.utf8_lower(half), "p"), 12, 0)).cast(pa.string())
    date = pc.binary_join_element_wise(year, month, day, "-")
    iso = pc.binary_join_element_wise(date, pc.binary_join_element_wise(hours, rest, ""), " ")
    return pc.coalesce(iso, cells)


def _offsets(zoned: pa.Array) -> Ints:
    """Seconds east of Greenwich of ``Z``, ``+hh:mm`` and ``-hhmm``."""
    words = zoned.unique().to_pylist()
    known = {}
    for word in words:
        digits = word[1:].replace(":", "")
        value = int(digits[:2]) * 3600 + int(digits[2:]) * 60 if digits else 0
        known[word] = -value if word.startswith("-") else value
    codes = pc.index_in(zoned, value_set=pa.array(words, pa.string()))
    table = np.array([known[word] for word in words] or [0], np.int64)
    return table[codes.to_numpy(zero_copy_only=False)]


def _formatted(cells: pa.Array, layout: TableLayout) -> Instants:
    import pandas as pd

    text = pd.Series(pc.utf8_trim_whitespace(cells).to_pylist(), dtype=object)
    zoned = "%z" in str(layout.time_format)
    found = pd.to_datetime(text, format=layout.time_format, errors="coerce", utc=zoned)
    bad = found.isna().to_numpy().copy()
    time = found.dt.as_unit("ns").to_numpy().astype("M8[ns]").astype(np.int64)
    time = np.where(bad, 0, time)
    return (time, bad) if zoned else _localised(time, bad, layout.time_zone)


def _localised(time: Ints, bad: Bools, zone: str) -> Instants:
    """UTC of wall-clock times in the order of the file; skipped or ambiguous ones are bad."""
    bad = bad | (np.abs(time) > _LONGEST * 10**9)
    time = np.where(bad, 0, time)
    if zone == "UTC":
        return time, bad
    import pandas as pd

    try:
        ZoneInfo(zone)
    except (ZoneInfoNotFoundError, ValueError) as error:
        raise ValueError(
            f"time_zone {zone!r} of the table's layout is not known: write it as in 'Europe/Berlin'"
        ) from error
    wall = pd.DatetimeIndex(time.astype("M8[ns]"))
    utc = wall.tz_localize(zone, ambiguous="NaT", nonexistent="NaT")
    if utc.isna().any():
        first = wall.tz_localize(zone, ambiguous=np.ones(len(wall), bool), nonexistent="NaT")
        missing = np.asarray(utc.isna())
        second, known = _second_hour(time, missing & ~np.asarray(first.isna()))
        decided = wall.tz_localize(zone, ambiguous=~second, nonexistent="NaT")
        utc = pd.DatetimeIndex(decided.where(known | ~missing))
    utc = utc.tz_convert("UTC")
    bad = bad | np.asarray(utc.isna())
    return np.where(bad, 0, utc.tz_localize(None).to_numpy().astype("M8[ns]").astype(np.int64)), bad


_HOUR = 3600 * 10**9


def _second_hour(wall: Ints, twice: Bools) -> tuple[Bools, Bools]:
    """Which of the repeated wall-clock times [ns] are of the second hour, and which are decided.

    The second hour begins where the clock goes back; in hourly records it stands still.
    """
    second, known = np.zeros(len(wall), bool), np.zeros(len(wall), bool)
    hourly = len(wall) > 1 and np.median(np.diff(wall)) == _HOUR
    rows = np.flatnonzero(twice)
    for night in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        step = np.diff(wall[night])
        back = np.flatnonzero((step < 0) | ((step == 0) & hourly))
        if len(back) == 1:
            second[night[back[0] + 1 :]] = known[night] = True
    return second, known


def clocks_said(wall: str, zone: str) -> str:
    """Effect of a change of clocks on a wall-clock time of ISO 8601; ``""`` where there is none."""
    try:
        at = datetime.fromisoformat(wall).replace(tzinfo=ZoneInfo(zone))
    except (ValueError, ZoneInfoNotFoundError):
        return ""
    early, late = at.utcoffset(), at.replace(fold=1).utcoffset()
    if early is None or late is None or early == late:
        return ""
    what = "is two instants of" if early > late else "does not exist in"
    return f"{what} {zone} time, as the clocks change: write UTC, or each time with its offset"


def _counted(cells: pa.Array, unit: int, decimal: str) -> Instants:
    """Numbers of a unit of time as whole nanoseconds, exact for integers and text."""
    if pa.types.is_integer(cells.type) or pa.types.is_string(cells.type):
        exact = [_nanoseconds(cell, unit, decimal) for cell in cells.to_pylist()]
        bad = np.array([value is None for value in exact], bool)
        return np.array([value or 0 for value in exact], np.int64), bad
    values, bad = numbers(cells)
    bad = bad | values.is_null().to_numpy(zero_copy_only=False)
    number = np.where(bad, 0.0, values.fill_null(0.0).to_numpy(zero_copy_only=False))
    bad |= np.abs(number) >= 2**63 / unit
    number = np.where(bad, 0.0, number)
    whole = np.floor(number)
    return whole.astype(np.int64) * unit + np.rint((number - whole) * unit).astype(np.int64), bad


def _nanoseconds(cell: str | int | None, unit: int, decimal: str) -> int | None:
    """One cell in nanoseconds; None when it is no time that 64 bits hold."""
    text = str(cell).strip().replace(decimal, ".")
    if not re.match(NUMBER, text):
        return None
    number = Decimal(text)
    if number.adjusted() > 30 or number.adjusted() < -30:  # too large to hold, too small to count
        return None if number.adjusted() > 30 else 0
    value = round(Fraction(number) * unit)
    return value if abs(value) < 2**63 else None
