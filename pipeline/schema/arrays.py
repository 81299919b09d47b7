"""Array types of the whole project, by what an element is."""

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
