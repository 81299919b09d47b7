"""Array types of the whole project, by what an element is."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""Real numbers, double precision."""
Ints = NDArray[np.int64]
"""Whole numbers: row indices, counts, labels."""
Bools = NDArray[np.bool_]
"""Masks."""
