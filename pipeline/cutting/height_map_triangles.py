"""The highest of many triangles over each column of a grid, compiled."""

from math import ceil, floor

from pipeline.kernels import compiled

_EDGE = 1e-9
"""Share of a triangle by which a column may lie outside: one on an edge belongs to both sides."""


@compiled
def raise_to_triangles(corners, heights, x_shifts, y_shifts, x0, y0, cell):  # type: ignore[no-untyped-def]
    """Raise each column to the highest of ``corners``, shape (triangles, 3, 3) [m]."""
    rows, columns = heights.shape
    for k in range(corners.shape[0]):
        a, b, c = corners[k, 0], corners[k, 1], corners[k, 2]
        double = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        # seen from above a wall has no area
        if double == 0.0:
            continue
        low, high = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        first, last = _cells(low - y0, high - y0, cell, rows)
        low, high = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        one, end = _cells(low - x0, high - x0, cell, columns)
        for row in range(first, last):
            for column in range(one, end):
                x = x0 + (column + x_shifts[row]) * cell
                y = y0 + (row + y_shifts[column]) * cell
                v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / double
                w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / double
                if v >= -_EDGE and w >= -_EDGE and v + w <= 1.0 + _EDGE:
                    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
                    heights[row, column] = max(heights[row, column], z)


@compiled
def _cells(low, high, cell, many):  # type: ignore[no-untyped-def]
    """First cell and cell after the last whose columns may lie within ``low`` to ``high``."""
    first = floor(min(max(low / cell, 0.0), float(many)))
    return first, ceil(min(max(high / cell + 1.0, 0.0), float(many)))
