"""Rows of a log as a table of observations: codes for words, quick and odd rows in one order."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.signals.columns import KINDS, OBSERVATIONS
from pipeline.signals.shdr.line import Row

NOTHING, NUMBER, TEXT = 0, 1, 2
"""What a row holds."""


class Codes:
    """Numbers words in the order in which they come."""

    def __init__(self, words: Iterable[str] = ()) -> None:
        self.codes: dict[str, int] = {}
        for word in words:
            self.code(word)

    def code(self, word: str | None) -> int:
        """The word's number, -1 for None."""
        return -1 if word is None else self.codes.setdefault(word, len(self.codes))

    def array(self) -> pa.Array:
        """The words."""
        return pa.array(self.codes, pa.string())


@dataclass(kw_only=True)
class Rows:
    """Rows column by column; words are codes, -1 for none, into the dictionaries.

    ``holds`` says whether a row has nothing, a number or a text.  ``said`` is None when nothing
    else was said in any row.
    """

    time: Any
    item: Any
    number: Any
    holds: Any
    text: Any
    sequence: Any
    kind: Any
    key: Any
    said: list[str | None] | None
    items: pa.Array
    texts: pa.Array
    keys: pa.Array

    def table(self) -> pa.Table:
        """The rows as observations."""
        n = len(self.time)
        said = pa.nulls(n, pa.string()) if self.said is None else pa.array(self.said, pa.string())
        key = pa.nulls(n, pa.int32()) if self.key is None else _indices(self.key)
        columns = [
            pa.array(self.time).cast(pa.timestamp("ns", tz="UTC")),
            pa.DictionaryArray.from_arrays(pa.array(self.item), self.items),
            pa.array(self.number, mask=self.holds != NUMBER),
            pa.DictionaryArray.from_arrays(_indices(self.text), self.texts),
            pa.array(self.sequence.astype(np.uint64)),
            pa.DictionaryArray.from_arrays(pa.array(self.kind), pa.array(KINDS)),
            pa.DictionaryArray.from_arrays(key, self.keys),
            said,
            pa.nulls(n, pa.uint64()),
        ]
        return pa.Table.from_arrays(columns, schema=OBSERVATIONS)


def _indices(codes: Any) -> pa.Array:
    return pa.array(codes, mask=codes < 0)


def rows_of(rows: Sequence[Row], items: Codes, texts: Codes) -> Rows:
    """Rows of the plain reader; words that are new are added to ``items`` and ``texts``."""
    keys = Codes()
    n = len(rows)
    held = (NUMBER if r.number is not None else NOTHING if r.text is None else TEXT for r in rows)
    numbers = (0.0 if r.number is None else r.number for r in rows)
    return Rows(
        time=np.fromiter((r.time for r in rows), np.int64, n),
        item=np.fromiter((items.code(r.item) for r in rows), np.int32, n),
        number=np.fromiter(numbers, np.float64, n),
        holds=np.fromiter(held, np.uint8, n),
        text=np.fromiter((texts.code(r.text) for r in rows), np.int32, n),
        sequence=np.fromiter((r.sequence for r in rows), np.int64, n),
        kind=np.fromiter((KINDS.index(r.kind) for r in rows), np.int32, n),
        key=np.fromiter((keys.code(r.key) for r in rows), np.int32, n),
        said=[r.said for r in rows] if any(r.said for r in rows) else None,
        items=items.array(),
        texts=texts.array(),
        keys=keys.array(),
    )


def merged(quick: Rows, odd: Rows, before: Any) -> Rows:
    """Quick rows with odd rows put between them.

    Parameters
    ----------
    quick, odd : Rows
        The odd rows' items and texts are codes into dictionaries that begin with the quick ones'.
    before : (K,) int array
        How many quick rows stand before each odd row, in rising order.
    """
    at = before + np.arange(len(before))
    total = len(quick.time) + len(before)
    is_quick = np.ones(total, bool)
    is_quick[at] = False

    def both(a: Any, b: Any) -> Any:
        column = np.empty(total, b.dtype)
        column[is_quick], column[at] = a, b
        return column

    said: list[str | None] | None = None
    if odd.said is not None:
        said = [None] * total
        for place, words in zip(at.tolist(), odd.said, strict=True):
            said[place] = words
    names = ("time", "item", "number", "holds", "text", "sequence", "kind")
    columns = {name: both(getattr(quick, name), getattr(odd, name)) for name in names}
    return Rows(
        **columns,
        key=both(np.int32(-1), odd.key),
        said=said,
        items=odd.items,
        texts=odd.texts,
        keys=odd.keys,
    )
