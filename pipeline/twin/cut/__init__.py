"""Cut of a program on its machine: engagement, loads, limits, stability, wear, cost, axes.

The blank is in the coordinates of one work offset; SI inside (m, N, W), documents in the units of
their names.  Rows are the program's moves, blocks those that cut, stations the places along the
path at which the engagement is known.
"""

__all__ = [
    "axes", "blocks", "coefficients", "document", "loads", "path", "stability", "tables",
    "warnings",
]  # fmt: skip
