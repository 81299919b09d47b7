"""Lines of an SHDR log in plain Python: those that the compiled scanner leaves over.

Bytes that are not UTF-8 are read as Latin-1, which the rows say (``encoding``).  NUL bytes around a
line are left out and counted (``nulBytes``); within a line they make it unreadable.
"""

import re
from typing import NamedTuple

from pipeline.signals.formats import EXCERPT, Rejection
from pipeline.signals.mtconnect.model import number_of
from pipeline.signals.mtconnect.observations import iso_ns
from pipeline.signals.shdr.lines import (
    LONGEST,
    TOO_LONG,
    Segment,
    counted_ns,
    fields_of,
    json_of,
)
from pipeline.signals.shdr.record_forms import (
    FORMS,
    Items,
    RecordForm,
    RefusedError,
    asset,
    undeclared,
)

ASSET = "asset"
"""Item under which assets stand."""
EARLIEST = -(2**63) + 1
MOST_FIELDS = 6
"""Fields that a record of a data item looks at: five of a condition, and whether more follow."""


_GLUED = re.compile(r"\S\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[^|\s]*$", re.ASCII)
"""A field that has lost its end and is followed by the time of another line."""


class Row(NamedTuple):
    """One row of observations; ``attributes`` is JSON."""

    time: int
    data_item: str
    number: float | None
    text: str | None
    sequence: int
    kind: str
    key: str | None
    attributes: str | None


class LineResult(NamedTuple):
    """Result of one line."""

    rows: list[Row]
    records: int
    rejected: list[Rejection]


class LineReader:
    """Reader of the lines of one log in their order.

    ``previous`` is the time of the last line that had one [ns since 1970], ``formed`` whether any
    line so far had the form of a log.
    """

    def __init__(self, items: Items) -> None:
        self.items = items
        self.previous: int | None = None
        self.formed = False

    def line(self, number: int, raw: bytes, sequence: int, body: bytes | None = None) -> LineResult:
        """Read line ``number`` of the file, whose first record is its record ``sequence``.

        ``raw`` is the line without its end, ``body`` the rest of a block.
        """
        if len(raw) > LONGEST:
            return refused(number, TOO_LONG, raw)
        bare = raw.strip(b" \t\r\0")
        nul_bytes = raw.count(b"\0")
        if not bare:
            return (
                refused(number, "the line is NUL bytes", b"")
                if nul_bytes
                else LineResult([], 0, [])
            )
        if b"\0" in bare:
            return refused(number, "NUL bytes stand in the middle of the line", raw)
        attributes: dict[str, object] = {"nulBytes": nul_bytes or None}
        text = decoded(bare, attributes)
        text = text.removeprefix("\ufeff")
        if text.startswith("*"):
            return LineResult([], 1, [])
        stamp, *fields = fields_of(text)
        time, reason = self._time(stamp, attributes)
        if time is None or not fields or fields == [""]:
            reason = reason if time is None else "no item follows the time"
            return refused(number, reason, bare)
        if any(map(_GLUED.search, fields[:-1])):
            return refused(
                number, "the line breaks off, and the next one follows without a break", bare
            )
        self.previous, self.formed = time, True
        if body is not None:
            fields[-1] = decoded(body.rstrip().rpartition(b"\n")[0].strip(), attributes)
        return self._records(number, time, fields, attributes, sequence)

    def _time(self, stamp: str, attributes: dict[str, object]) -> tuple[int | None, str]:
        """Time of a line [ns] or why it has none; its oddities are added to ``attributes``."""
        stamp, at, duration = stamp.partition("@")
        if at:
            attributes["duration"] = number_of(duration)
            if attributes["duration"] is None:
                return None, f"the duration {duration[:40]!r} is no number"
        if not stamp:
            attributes["time"] = "of the line before"
            return self.previous, "the line has no time and none stands before it"
        time = iso_ns(stamp)
        if time is None:
            time, attributes["time"] = counted_ns(stamp)
        return time, (
            f"{stamp[:40]!r} is no time: ISO 8601 from 1678 to 2261, or s, ms, us or ns since 1970"
        )

    def _records(
        self, line: int, time: int, fields: list[str], attributes: dict[str, object], sequence: int
    ) -> LineResult:
        rows: list[Row] = []
        rejected: list[Rejection] = []
        at = records = 0
        # A lone empty field at the end is a pipe too many.
        while at < len(fields) - (at > 0 and not fields[-1]):
            key = fields[at]
            rest = fields[at + 1 : None if key.startswith("@") else at + 1 + MOST_FIELDS]
            try:
                name, form = self._record(key, rest, alone=at == 0)
                used = form.used
                if time - form.values[0].before < EARLIEST:
                    raise RefusedError("the time series begins before 1678", used)
            except RefusedError as why:
                used = why.used
                excerpt = "|".join((key, *rest[:used]))[:EXCERPT]
                rejected.append(Rejection(line=line, reason=str(why), excerpt=excerpt))
            else:
                place = sequence + records
                rows += _rows(form, time, name, place, attributes)
            at += 1 + used
            records += 1
        return LineResult(rows, records, rejected)

    def _record(self, key: str, rest: list[str], *, alone: bool) -> tuple[str, RecordForm]:
        if not key:
            raise RefusedError("a value stands without an item's name", min(1, len(rest)))
        if key.startswith("@"):
            return ASSET, asset(key, rest)
        if not rest:
            raise RefusedError(f"item {key[:40]!r} has no value", 0)
        plan = self.items.plan(key)
        if plan.shape == "refused":
            raise RefusedError(plan.why, undeclared(rest, alone=alone).used)
        if plan.shape != "any":
            return plan.name, FORMS[plan.shape](plan, rest)
        return plan.name, undeclared(rest, alone=alone)


def _rows(
    form: RecordForm, time: int, name: str, place: int, attributes: dict[str, object]
) -> list[Row]:
    rows = []
    last: dict[str, object] | None = None
    words: str | None = None
    for v in form.values:
        if v.attributes is not last:  # the thousands of values of a series share one
            last, words = v.attributes, json_of(attributes | v.attributes)
        rows.append(Row(time - v.before, name, v.number, v.text, place, form.kind, v.key, words))
    return rows


def decoded(raw: bytes, attributes: dict[str, object]) -> str:
    """Text of UTF-8, else of Latin-1, which is added to the attributes of the rows."""
    try:
        return raw.decode()
    except UnicodeDecodeError:
        attributes["encoding"] = "latin-1"
        return raw.decode("latin-1")


def read_segment(reader: LineReader, segment: Segment, sequence: int) -> LineResult:
    """Read one line, one block, or what was refused before."""
    if segment.kind == "refused":
        return refused(segment.line, segment.reason, segment.data)
    body = segment.body if segment.kind == "block" else None
    return reader.line(segment.line, segment.data.removesuffix(b"\n"), sequence, body)


def refused(line: int, reason: str, raw: bytes) -> LineResult:
    """A line that is rejected as one record."""
    excerpt = raw[: 4 * EXCERPT].decode("utf-8", "replace")[:EXCERPT]
    return LineResult([], 1, [Rejection(line=line, reason=reason, excerpt=excerpt)])
