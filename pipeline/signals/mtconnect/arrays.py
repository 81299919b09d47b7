"""Columns of rows from numbered words, and two tables of rows in one order."""

import numpy as np
import numpy.typing as npt
import pyarrow as pa


def encoded(code: npt.NDArray[np.integer], words: list[str]) -> pa.DictionaryArray:
    """Words by their number; null where it is negative."""
    code = code.astype(np.int32, copy=False)
    absent = code < 0
    indices = pa.array(code, mask=absent) if absent.any() else pa.array(code)
    return pa.DictionaryArray.from_arrays(indices, pa.array(words, pa.string()))


def numbers(values: npt.NDArray[np.float64]) -> pa.Array:
    """Numbers; null where there is none."""
    return pa.array(values, mask=np.isnan(values))


def merged(
    table: pa.Table, element: npt.NDArray[np.int64], careful: pa.Table, places: list[int]
) -> pa.Table:
    """Both tables in the order of the elements; rows of one element keep theirs."""
    order = np.argsort(np.concatenate([element, np.array(places, np.int64)]), kind="stable")
    return pa.concat_tables([table, careful]).unify_dictionaries().combine_chunks().take(order)
