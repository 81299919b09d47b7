"""From observations, as documents state them, to rows of the long table."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pyarrow as pa

from pipeline.signals.columns import OBSERVATIONS
from pipeline.signals.mtconnect_words import (
    AXES,
    BLANK,
    Malformed,
    Shape,
    json_of,
    nanoseconds,
    number_of,
    sequence_of,
)
from pipeline.signals.records import EXCERPT, Batch, Rejection

RECORDS = 200_000
"""Records after which a batch is handed over."""


EARLIEST = -(2.0**63)
"""First nanosecond since 1970 that fits a time."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a data set, or (``cells``) one row of a table."""

    key: str
    text: str = ""
    removed: bool = False
    cells: tuple[tuple[str, str], ...] | None = None


Value = tuple[str | None, float | None, str | None, bool]
"""Key, number, text and whether it was removed."""


Row = tuple[int, float | None, str | None, int, str | None, str | None, int | None, Shape]
"""Time, number, text, sequence, key, attributes, instance, shape."""


@dataclass
class Rows:
    """Rows that grow, and the count of what was read, kept and rejected."""

    rows: list[Row] = field(default_factory=list)
    read: int = 0
    rejected: list[Rejection] = field(default_factory=list)

    def table(self) -> pa.Table:
        """The rows so far as a table."""
        time, number, text, sequence, key, attributes, instance, shapes = (
            zip(*self.rows, strict=True) if self.rows else ((),) * 8
        )
        columns = {
            "time": time,
            "data_item": [shape.data_item for shape in shapes],
            "number": number,
            "text": text,
            "sequence": sequence,
            "kind": [shape.kind for shape in shapes],
            "key": key,
            "attributes": attributes,
            "instance": instance,
        }
        return pa.table([_column(f, columns[f.name]) for f in OBSERVATIONS], schema=OBSERVATIONS)

    def reject(self, line: int | None, reason: str, excerpt: str = "") -> None:
        """Count one record as read and not kept."""
        self.read += 1
        self.rejected.append(Rejection(line=line, reason=reason, excerpt=excerpt[:EXCERPT]))

    def add(
        self, shape: Shape, time: int, sequence: int, instance: int | None, value: Any
    ) -> None:
        """Keep one record: all its rows.

        Parameters
        ----------
        time : int
            Nanoseconds since 1970.
        value : str or list of Entry
            Text of the observation, or the entries inside it.

        Raises
        ------
        Malformed
            When the value does not fit the shape; no row is added then.
        """
        for at, (key, number, text, removed) in _values(shape, time, value):
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
        """Keep one record whose time and sequence are still text.

        Raises
        ------
        Malformed
            When it has no time, or one of its parts says something that cannot be.
        """
        if timestamp is None:
            raise Malformed("the observation has no timestamp")
        number = place if sequence is None else sequence_of(sequence)
        time = nanoseconds(timestamp)
        if shape.manner == "number" and isinstance(value, str) and (plain := number_of(value)) is not None:
            row = (time, plain, None, number, shape.key, shape.attributes, instance, shape)
            self.rows.append(row)
            self.read += 1
        else:
            self.add(shape, time, number, instance, value)

    def batch(self) -> Batch:
        """What was read so far, as a batch."""
        kept = self.read - len(self.rejected)
        return Batch(observations=self.table(), read=self.read, kept=kept, rejected=self.rejected)


def _column(of: pa.Field, values: Sequence[Any]) -> pa.Array:
    if pa.types.is_dictionary(of.type):
        return pa.array(values, pa.string()).dictionary_encode()
    return pa.array(values, of.type)


def _values(shape: Shape, time: int, value: Any) -> list[tuple[int, Value]]:
    """Time and value of each row that an observation gives."""
    if shape.manner == "condition":
        return [(time, (shape.key, None, shape.level, False))]
    if value == "UNAVAILABLE":
        return [(time, (shape.key, None, None, False))]
    if shape.manner == "number" and isinstance(value, str):
        return _plain(shape, time, value)
    if shape.manner == "series":
        return _series(shape, time, value)
    if isinstance(value, list):
        return [(time, v) for entry in value for v in _entry_values(entry)] or _empty(time)
    if shape.manner == "set":
        return _pairs(time, value)
    if shape.manner == "text":
        return [(time, (shape.key, None, value, False))]
    return _plain(shape, time, value)


def _plain(shape: Shape, time: int, value: str) -> list[tuple[int, Value]]:
    number = number_of(value)
    if number is not None:
        return [(time, (shape.key, number, None, False))]
    if shape.spatial:
        numbers = [number_of(word) for word in value.split()]
        if len(numbers) == len(AXES) and None not in numbers:
            return [(time, (axis, n, None, False)) for axis, n in zip(AXES, numbers, strict=True)]
    if shape.manner == "number":
        raise Malformed(f"the sample's value {value[:60]!r} is no finite number")
    return [(time, (shape.key, None, value, False))]


def _empty(time: int) -> list[tuple[int, Value]]:
    # A set without entries is empty from now on: nothing of it is available.
    return [(time, (None, None, None, False))]


def _pairs(time: int, value: str) -> list[tuple[int, Value]]:
    if value:
        raise Malformed(f"the data set holds the text {value[:60]!r} instead of entries")
    return _empty(time)


def _entry_values(entry: Entry) -> Iterator[Value]:
    if entry.removed:
        yield entry.key, None, None, True
    elif entry.cells is None:
        yield entry.key, *_either(entry.text), False
    elif not entry.cells:
        yield entry.key, None, None, False
    for key, text in entry.cells or ():
        yield f"{entry.key}/{key}", *_either(text), False


def _either(text: str) -> tuple[float | None, str | None]:
    number = number_of(text)
    if number is not None or text == "UNAVAILABLE":
        return number, None
    return None, text


def _series(shape: Shape, time: int, value: Any) -> list[tuple[int, Value]]:
    """Samples of a time series: its timestamp is that of the last (MTConnect part 3, TimeSeries)."""
    if not isinstance(value, str):
        raise Malformed("the time series holds entries instead of numbers")
    numbers = [number_of(word) for word in value.split()]
    if not numbers or None in numbers:
        raise Malformed(f"the time series {value[:60]!r} is no row of finite numbers")
    said = shape.rest.get("sampleCount")
    if said is not None and number_of(str(said)) != len(numbers):
        raise Malformed(f"the time series has {len(numbers)} values, its sampleCount is {said}")
    step = _step(shape, len(numbers))
    last = len(numbers) - 1
    if not time - last * step > EARLIEST:
        raise Malformed(f"the time series begins {last * step / 1e9:g} s before its timestamp")
    return [
        (time - round((last - i) * step), (str(i + 1), n, None, False))
        for i, n in enumerate(numbers)
    ]


def _step(shape: Shape, count: int) -> float:
    """Nanoseconds between two samples; 0 when neither rate nor duration is known."""
    if shape.rate:
        return 1e9 / shape.rate
    duration = number_of(str(shape.rest.get("duration", "")))
    return duration * 1e9 / (count - 1) if duration and count > 1 else 0.0


def stripped(text: str) -> str:
    """``text`` without the white space around it."""
    return text.strip(BLANK)


def gathered(batches: Iterator[Batch]) -> Iterator[Batch]:
    """The same records in batches of about :data:`RECORDS`, however small they came.

    ``line`` of no rejection changes; the order stays.
    """
    waiting: list[Batch] = []
    count = 0
    for batch in batches:
        waiting.append(batch)
        count += batch.read
        if count >= RECORDS:
            yield _joined(waiting)
            waiting, count = [], 0
    if waiting:
        yield _joined(waiting)


def _joined(batches: list[Batch]) -> Batch:
    if len(batches) == 1:
        return batches[0]
    return replace(
        batches[0],
        observations=pa.concat_tables([b.observations for b in batches]),
        read=sum(b.read for b in batches),
        kept=sum(b.kept for b in batches),
        rejected=[r for b in batches for r in b.rejected],
    )
