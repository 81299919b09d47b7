"""Samples that are read many at a time."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import OBSERVATIONS
from pipeline.signals.mtconnect.words import Shape

TIME = OBSERVATIONS.field("time").type


@dataclass
class Waiting:
    """Samples that are to be read together: timestamp, sequence, value, shape, place, and again.

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
