"""Cells of a table: numbers or words, or null where the file says nothing.

A cell that is blank, not a number by IEEE 754 or by a program's word for it is null.  A cell that
holds anything else but a finite number is bad, and its row is rejected.
"""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pipeline.signals.records import UnreadableFile

Cells = Any
"""An Arrow array, chunked or not; Arrow has no types for the type checker."""

NOTHING = (
    "", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind", "-1.#qnan", "1.#ind",
     "na", "n/a", "#n/a", "null", "none", "nil", "unavailable", "-", "--", "---", "missing",
)  # fmt: skip
"""What programs write, in lower case, where they have no number."""

NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"
"""A number in text, with a decimal point."""


def numbers(cells: Cells, decimal: str = ".") -> tuple[pa.Array, NDArray[np.bool_]]:
    """Cells as numbers.

    Parameters
    ----------
    cells : pyarrow array, shape (T,)
        Numbers of any type or text.
    decimal : str
        Mark of the decimals in text.

    Returns
    -------
    values : pyarrow float64 array, shape (T,)
        Null where the file has no value.
    bad : ndarray of bool, shape (T,)
        True where a cell is no finite number; null in ``values``.

    Raises
    ------
    UnreadableFile
        When the column's type holds neither numbers nor text.
    """
    cells = plain(cells)
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
    cells = plain(cells)
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


def plain(cells: Cells) -> pa.Array:
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
    """Arrow's own quick parser; None when it meets a cell that it does not know."""
    try:
        return pc.cast(cells, pa.float64())
    except pa.ArrowInvalid:
        return None


def _parsed(cells: pa.Array, decimal: str) -> tuple[pa.Array, NDArray[np.bool_]]:
    text = pc.utf8_trim_whitespace(cells)
    silent = pc.is_in(pc.utf8_lower(text), value_set=pa.array(NOTHING))
    nothing = pc.or_kleene(silent, pc.is_null(text))
    if decimal != ".":
        # A point in a file with decimal commas would be a mark of thousands: no number we know.
        text = pc.if_else(pc.match_substring(text, "."), "no number", text)
        text = pc.replace_substring(text, decimal, ".")
    good = pc.match_substring_regex(text, NUMBER).fill_null(False)
    digits = pc.if_else(good, pc.utf8_ltrim(text, "+"), pa.scalar(None, pa.string()))
    known = pc.or_(good, nothing.fill_null(True)).to_numpy(zero_copy_only=False)
    return pc.cast(digits, pa.float64()), ~known
