"""Array types of the whole project, by what an element is, and arrays in JSON documents."""

from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""Real numbers, double precision."""
Ints = NDArray[np.int64]
"""Whole numbers: row indices, counts, labels."""
Bools = NDArray[np.bool_]
"""Masks."""
Rows = NDArray[np.intp]
"""Indices of rows."""
Singles = NDArray[np.float32]
"""Real numbers, single precision."""
Complexes = NDArray[np.complex128]
"""Complex numbers, double precision."""


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """Shape, type and little-endian bytes of an array, in base64."""
    kind = values.dtype.newbyteorder("<")
    data = b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")
    return {"shape": list(values.shape), "type": values.dtype.name, "base64": data}


def unpacked(packed: Mapping[str, Any]) -> NDArray[Any]:
    """The array of a document of :func:`packed`."""
    if packed["type"] not in ("float32", "float64"):
        raise TypeError(f"an array is of type {packed['type']}, not float32 or float64")
    kind = np.dtype(packed["type"])
    values = np.frombuffer(b64decode(packed["base64"], validate=True), kind.newbyteorder("<"))
    return values.astype(kind).reshape(packed["shape"])
