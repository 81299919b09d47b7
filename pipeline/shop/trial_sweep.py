"""A disc goes along its way over layers of cells and leaves in each when it first came (numba)."""

import numpy as np
from numba import njit

FRACTION = 0.5
"""Of a cell, that the disc goes between two looks at what is new under it [1]."""
OVER = 0.5
"""Of a cell, by which the disc is wider than the tool, so that one that goes the same way again
finds no cells at the walls that its last pass had touched but not swept [1]."""


@njit(cache=True, nogil=True)
def sweep(
    first: np.ndarray, middles: np.ndarray, corner: tuple[float, float], cell: float,
    tip: np.ndarray, way: np.ndarray, radius: np.ndarray, new: np.ndarray,
) -> None:  # fmt: skip
    """Fill ``first`` (L, rows, columns) and say in ``new`` (T,) in which cycles there was any.

    Parameters
    ----------
    first : (L, rows, columns) array
        Infinite where nothing was swept.
    middles : (L,) array
        Heights of the layers' middles [mm].
    corner, cell : tuple, float
        x, y of the first cell's corner, side of a cell [mm].
    tip, way, radius : (T, 3), (T,), (T,) arrays
        Of the tool in each cycle [mm]; a radius of 0 sweeps nothing.
    new : (T,) array of bool
        False before.
    """
    layers = middles.size
    was = np.zeros(layers, dtype=np.bool_)  # whether the disc at ``back`` was in the layer
    back_x, back_y, back_r = 0.0, 0.0, 0.0
    top = middles[-1] if layers else -np.inf
    for k in range(1, way.size):
        if radius[k] == 0.0 or (tip[k, 2] > top and tip[k - 1, 2] > top):
            was[:] = False
            continue
        moved = way[k] - way[k - 1]
        looks = max(int(np.ceil(moved / (FRACTION * cell))), 1)
        for look in range(1, looks + 1):
            share = look / looks
            x = tip[k - 1, 0] + (tip[k, 0] - tip[k - 1, 0]) * share
            y = tip[k - 1, 1] + (tip[k, 1] - tip[k - 1, 1]) * share
            z = tip[k - 1, 2] + (tip[k, 2] - tip[k - 1, 2]) * share
            near = np.hypot(x - back_x, y - back_y) < FRACTION * cell and back_r == radius[k]
            same = True
            for layer in range(layers):
                same = same and was[layer] == (z <= middles[layer])
            if near and same:
                continue
            r = radius[k] + OVER * cell
            for layer in range(layers):
                if z > middles[layer]:
                    was[layer] = False
                    continue
                old = r if was[layer] and back_r == radius[k] else -1.0
                if _disc(
                    first[layer], x - corner[0], y - corner[1], r,
                    back_x - corner[0], back_y - corner[1], old, cell,
                    way[k - 1] + moved * share,
                ):  # fmt: skip
                    new[k] = True
                was[layer] = True
            back_x, back_y, back_r = x, y, radius[k]


@njit(cache=True, nogil=True)
def _disc(
    first: np.ndarray, x: float, y: float, r: float, old_x: float, old_y: float, old_r: float,
    cell: float, way: float,
) -> bool:  # fmt: skip
    """Mark what a disc covers and one before (of ``old_r`` < 0: none) did not; whether any was."""
    rows, columns = first.shape
    found = False
    low = max(int(np.ceil((y - r) / cell - 0.5)), 0)
    high = min(int(np.floor((y + r) / cell - 0.5)), rows - 1)
    for row in range(low, high + 1):
        up = (row + 0.5) * cell
        half = np.sqrt(max(r * r - (up - y) ** 2, 0.0))
        a = max(int(np.ceil((x - half) / cell - 0.5)), 0)
        b = min(int(np.floor((x + half) / cell - 0.5)), columns - 1)
        rest = old_r * old_r - (up - old_y) ** 2
        if old_r <= 0.0 or rest <= 0.0:
            found |= _span(first, row, a, b, way)
            continue
        half = np.sqrt(rest)
        c = int(np.ceil((old_x - half) / cell - 0.5))
        d = int(np.floor((old_x + half) / cell - 0.5))
        found |= _span(first, row, a, min(b, c - 1), way)
        found |= _span(first, row, max(a, d + 1), b, way)
    return found


@njit(cache=True, nogil=True)
def _span(first: np.ndarray, row: int, a: int, b: int, way: float) -> bool:
    found = False
    for column in range(a, b + 1):
        if first[row, column] == np.inf:
            first[row, column] = way
            found = True
    return found
