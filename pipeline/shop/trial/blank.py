"""Blank of a trial cut: path length of the tool at which each cell of each layer was first swept.

Layers lie between the heights at which the program mills, finer where it ramps; a disc moves along
the path of the tool over their square cells (numba).
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.shop.control.postprocessor import Step
from pipeline.shop.trial.job import Box, TrialJob

FRACTION = 0.5
"""Share of a cell that the disc moves between two checks for new cells under it [1]."""
OVER = 0.5
"""Share of a cell by which the disc is wider than the tool, so that one on the same path again
meets no cells at the walls that its last pass had touched but not swept [1]."""
CELL = 1 / 300
"""Side of a cell over the smallest tool's diameter [1]."""
MOST = 12_000_000
"""Greatest number of cells in all layers: 48 MiB."""
RAMP = 0.25
"""Greatest height of a layer through which the tool ramps down [mm]."""
SLICE = 0.25
"""Greatest height of a slice of the edges, as the forces are summed [mm]."""
SAME = 1e-4
"""Heights that are closer count as one [mm]."""


@compiled_with(nogil=True)
def sweep(
    first: np.ndarray, middles: np.ndarray, corner: tuple[float, float], cell: float,
    tip: np.ndarray, path: np.ndarray, radius: np.ndarray, new: np.ndarray,
) -> None:  # fmt: skip
    """Fill ``first`` (L, rows, columns) and mark in ``new`` (T,) the cycles that sweep any cell.

    ``first`` is infinite where nothing was swept; ``middles`` (L,), ``corner`` (x, y) and ``cell``
    [mm]; ``tip`` (T, 3), ``path`` (T,) and ``radius`` (T,) of the tool [mm], 0 sweeps nothing.
    """
    layers = middles.size
    was = np.zeros(layers, dtype=np.bool_)  # whether the disc at ``back`` was in the layer
    back_x, back_y, back_r = 0.0, 0.0, 0.0
    top = middles[-1] if layers else -np.inf
    for k in range(1, path.size):
        if radius[k] == 0.0 or (tip[k, 2] > top and tip[k - 1, 2] > top):
            was[:] = False
            continue
        moved = path[k] - path[k - 1]
        checks = max(int(np.ceil(moved / (FRACTION * cell))), 1)
        for check in range(1, checks + 1):
            share = check / checks
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
                    path[k - 1] + moved * share,
                ):  # fmt: skip
                    new[k] = True
                was[layer] = True
            back_x, back_y, back_r = x, y, radius[k]


@compiled_with(nogil=True)
def _disc(
    first: np.ndarray, x: float, y: float, r: float, old_x: float, old_y: float, old_r: float,
    cell: float, path: float,
) -> bool:  # fmt: skip
    """Mark cells under a disc but not under the last one (``old_r`` < 0: none); whether any."""
    rows, columns = first.shape
    new = False
    low = max(int(np.ceil((y - r) / cell - 0.5)), 0)
    high = min(int(np.floor((y + r) / cell - 0.5)), rows - 1)
    for row in range(low, high + 1):
        up = (row + 0.5) * cell
        half = np.sqrt(max(r * r - (up - y) ** 2, 0.0))
        a = max(int(np.ceil((x - half) / cell - 0.5)), 0)
        b = min(int(np.floor((x + half) / cell - 0.5)), columns - 1)
        rest = old_r * old_r - (up - old_y) ** 2
        if old_r <= 0.0 or rest <= 0.0:
            new |= _span(first, row, a, b, path)
            continue
        half = np.sqrt(rest)
        c = int(np.ceil((old_x - half) / cell - 0.5))
        d = int(np.floor((old_x + half) / cell - 0.5))
        new |= _span(first, row, a, min(b, c - 1), path)
        new |= _span(first, row, max(a, d + 1), b, path)
    return new


@compiled_with(nogil=True)
def _span(first: np.ndarray, row: int, a: int, b: int, path: float) -> bool:
    new = False
    for column in range(a, b + 1):
        if first[row, column] == np.inf:
            first[row, column] = path
            new = True
    return new


@dataclass(frozen=True, eq=False)
class Swept:
    """Part of the blank that the tool has swept, in L layers of cells."""

    blank: Box
    """Box of the blank: x, y, z from and to [mm]."""
    cell: float
    """Side of a cell [mm]."""
    heights: Floats
    """Heights between the layers, from below [mm]."""
    first: NDArray[np.float32]
    """Path length of the tip at which each cell was first swept [mm]; infinite where never."""
    corner: tuple[float, float]
    """x, y of the first cell's corner [mm]."""
    path: Floats
    """Path length of the tip in each cycle [mm]."""
    cuts: Bools
    """Cycles in which the tool cuts."""


def swept(tip: Floats, tool: Ints, steps: tuple[Step, ...], job: TrialJob) -> Swept:
    """Sweep the blank of ``job`` along the ``tip`` (T, 3) [mm] of each ``tool`` of the program."""
    widest = max(mill.diameter for mill in job.tools.values()) / 2
    x_0, x_1, y_0, y_1 = _touched(tip, job.blank, widest)
    heights = _heights(steps, job.blank)
    cell = min(mill.diameter for mill in job.tools.values()) * CELL
    area = (x_1 - x_0) * (y_1 - y_0) * (heights.size - 1)
    cell = max(cell, float(np.sqrt(area / MOST)))
    shape = (heights.size - 1, ceil((y_1 - y_0) / cell) or 1, ceil((x_1 - x_0) / cell) or 1)
    first = np.full(shape, np.inf, dtype=np.float32)
    step = np.diff(tip, axis=0, prepend=tip[:1])
    path = np.cumsum(np.sqrt((step**2).sum(axis=1)))
    radius = np.zeros(int(tool.max()) + 1)
    for number, mill in job.tools.items():
        if number < radius.size:
            radius[number] = mill.diameter / 2
    middles = (heights[1:] + heights[:-1]) / 2
    cuts = np.zeros(path.size, dtype=np.bool_)
    sweep(first, middles, (x_0, y_0), cell, tip, path, radius[tool], cuts)
    return Swept(job.blank, cell, heights, first, (x_0, y_0), path, cuts)


def _touched(tip: Floats, blank: Box, radius: float) -> tuple[float, float, float, float]:
    """The part of the blank that the tool reaches: x, y from and to [mm]."""
    low = tip[tip[:, 2] < blank[5]]
    if not len(low):
        return blank[0], blank[0], blank[2], blank[2]
    reach = radius + 0.1
    (x_0, y_0), (x_1, y_1) = low[:, :2].min(axis=0) - reach, low[:, :2].max(axis=0) + reach
    x, y = np.clip([x_0, x_1], *blank[:2]).tolist(), np.clip([y_0, y_1], *blank[2:4]).tolist()
    return x[0], x[1], y[0], y[1]


def _heights(steps: tuple[Step, ...], blank: Box) -> Floats:
    """Heights between layers from below [mm]: where the program mills, finer where it ramps."""
    bottom, top = blank[4:]
    levels, ramps = [top], []
    for before, step in pairwise(steps):
        if step.kind not in ("line", "arc"):
            continue
        z_0, z_1 = sorted((before.end[2], step.end[2]))
        if bottom < step.end[2] < top:
            levels.append(step.end[2])
        elif step.end[2] <= bottom:
            levels.append(bottom)
        sideways = step.kind == "arc" or before.end[:2] != step.end[:2]
        if z_1 - z_0 > SAME and sideways:
            ramps.append((z_0, z_1))
    milled = np.unique(np.round(levels, 6))
    milled = milled[np.concatenate([[True], np.diff(milled) > SAME])]
    finer = [milled[:1]]
    for low, high in pairwise(milled):
        ramped = any(z_0 < high - SAME and z_1 > low + SAME for z_0, z_1 in ramps)
        count = ceil((high - low) / RAMP - 1e-9) if ramped else 1
        finer.append(low + (high - low) * np.arange(1, count + 1) / count)
    return np.concatenate(finer)
