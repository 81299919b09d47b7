"""Rows of the long table of observations, gathered into batches.

Plain samples are converted many at a time, all other observations one by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import OBSERVATIONS, TIME
from pipeline.signals.formats import EXCERPT, Batch, Rejection, observations_of
from pipeline.signals.mtconnect.observations import (
    MalformedError,
    Shape,
    json_of,
    nanoseconds,
    sequence_of,
    values_of,
)


@dataclass
class SampleBatch:
    """Samples to be read together: timestamp, sequence, value, shape, place, and again.

    One flat list of plain values: with many objects alive, the garbage collector would take longer
    than the reading.
    """

    flat: list[Any] = field(default_factory=list)
    known: list[Shape] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.flat) // 5

    def each(self) -> Iterator[tuple[str, str, str, int, int]]:
        """Timestamp, sequence, value, number of the shape and place of each sample."""
        flat = self.flat
        return zip(flat[::5], flat[1::5], flat[2::5], flat[3::5], flat[4::5], strict=True)

    def table(self, instance: int | None) -> pa.Table | None:
        """The samples as rows; None when one of them is not as agents write it."""
        stamps, sequences, values = (pa.array(self.flat[i::5], pa.string()) for i in range(3))
        within = pc.min_max(stamps)
        if not (within["min"].as_py() >= "1678" and within["max"].as_py() < "2262"):
            return None
        known = pc.not_equal(values, "UNAVAILABLE")
        try:
            time = stamps.cast(TIME)
            number = pc.if_else(known, values, None).cast(pa.float64())
            sequence = sequences.cast(pa.uint64())
        except pa.ArrowInvalid:
            return None
        finite = pc.all(pc.is_finite(number), min_count=0).as_py()
        if not finite or not pc.all(pc.utf8_is_decimal(sequences)).as_py():
            return None
        n, code = len(time), pa.array(self.flat[3::5], pa.int32())
        columns = {
            "time": time,
            "data_item": _words([s.data_item for s in self.known]).dictionary_encode().take(code),
            "number": number,
            "text": pa.nulls(n, OBSERVATIONS.field("text").type),
            "sequence": sequence,
            "kind": _words([s.kind for s in self.known]).dictionary_encode().take(code),
            "key": _words([s.key for s in self.known]).dictionary_encode().take(code),
            "attributes": _words([s.attributes for s in self.known]).take(code),
            "instance": pa.array([instance], pa.uint64()).take(pa.nulls(n, pa.int8()).fill_null(0)),
        }
        return pa.table([columns[name] for name in OBSERVATIONS.names], schema=OBSERVATIONS)


def _words(words: list[str | None]) -> pa.Array:
    return pa.array(words, pa.string())


RECORDS = 200_000
"""Records after which a batch is handed over."""


Row = tuple[int, float | None, str | None, int, str | None, str | None, int | None, Shape]
"""Time, number, text, sequence, key, attributes, instance, shape."""


def _table(rows: list[Row]) -> pa.Table:
    time, number, text, sequence, key, attributes, instance, shapes = (
        zip(*rows, strict=True) if rows else ((),) * 8
    )
    columns = {
        "time": time, "number": number, "text": text, "sequence": sequence, "key": key,
        "attributes": attributes, "instance": instance,
        "data_item": [shape.data_item for shape in shapes], "kind": [s.kind for s in shapes],
    }  # fmt: skip
    return observations_of(columns, len(rows))


@dataclass
class Rows:
    """Rows that grow, and the count of what was read, kept and rejected."""

    rows: list[Row] = field(default_factory=list)
    tables: list[pa.Table] = field(default_factory=list)  # what stood before them
    read: int = 0
    rejected: list[Rejection] = field(default_factory=list)

    def table(self) -> pa.Table:
        """Table of the rows so far."""
        if not self.rows and self.tables:
            return pa.concat_tables(self.tables)
        return pa.concat_tables([*self.tables, _table(self.rows)])

    def reject(self, line: int | None, reason: str, excerpt: str = "") -> None:
        """Count one record as read and not kept."""
        self.read += 1
        self.rejected.append(Rejection(line=line, reason=reason, excerpt=excerpt[:EXCERPT]))

    def add(self, shape: Shape, time: int, sequence: int, instance: int | None, value: Any) -> None:
        """Keep one record: all its rows, or none where the value does not fit the shape.

        ``time`` is in nanoseconds since 1970, ``value`` the text or a list of the entries inside
        it.
        """
        for at, (key, number, text, removed) in values_of(shape, time, value):
            attributes = shape.attributes
            if removed:
                attributes = json_of({**shape.rest, "removed": True})
            elif shape.manner == "condition" and value:
                attributes = json_of({**shape.rest, "message": value})
            self.rows.append((at, number, text, sequence, key, attributes, instance, shape))
        self.read += 1

    def record(
        self,
        shape: Shape,
        timestamp: str | None,
        sequence: str | None,
        instance: int | None,
        place: int,
        value: Any,
    ) -> None:
        """Keep one record whose time and sequence are still text."""
        if timestamp is None:
            raise MalformedError("the observation has no timestamp")
        number = place if sequence is None else sequence_of(sequence)
        time = nanoseconds(timestamp)
        self.add(shape, time, number, instance, value)

    def samples(self, waiting: SampleBatch, instance: int | None) -> bool:
        """Keep plain samples together, if each of them is one; else none of them.

        Many at once are read in a tenth of the time that one by one takes.
        """
        table = waiting.table(instance)
        if table is None:
            return False
        if self.rows:
            self.tables.append(_table(self.rows))
            self.rows = []
        self.tables.append(table)
        self.read += len(waiting)
        return True

    def batch(self) -> Batch:
        """Batch of all that was read so far."""
        kept = self.read - len(self.rejected)
        return Batch(observations=self.table(), read=self.read, kept=kept, rejected=self.rejected)
