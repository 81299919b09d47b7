"""The blank of a trial cut: along which way of the tool each cell of each layer was first swept.

Layers lie between the heights at which the program mills, finer where it ramps; their cells are
squares of about a three-hundredth of the tool's diameter.  A map belongs to a program: every seed
cuts along the same ways.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np

from pipeline.shop.post import Step
from pipeline.shop.s_curve import Floats
from pipeline.shop.trial_job import Box, TrialJob
from pipeline.shop.trial_motion import Track

CELL = 1 / 300
"""Of the smallest tool's diameter [1]."""
MOST = 48_000_000
"""Cells of all layers: 192 MiB."""
RAMP = 0.25
"""Greatest height of a layer through which the tool goes down on its way [mm]."""
SLICE = 0.25
"""Greatest height of a slice of the edges, as the forces are summed [mm]."""
SAME = 1e-4
"""Heights that are closer are one [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Swept:
    """What of the blank the tool has swept, in L layers of cells.

    Parameters
    ----------
    blank : Box
        [mm].
    cell : float
        [mm].
    heights : (L + 1,) array
        Between the layers, from below [mm].
    first : (L, rows, columns) array
        Way of the tool's tip at which each cell was first swept [mm]; infinite where it never was.
    corner : tuple of 2 floats
        x, y of the first cell's corner [mm].
    way : (T,) array
        Of the tip in each cycle [mm].
    cuts : (T,) array of bool
        Cycles in which the tool cuts.
    """

    blank: Box
    cell: float
    heights: Floats
    first: np.ndarray
    corner: tuple[float, float]
    way: Floats
    cuts: np.ndarray


def swept(track: Track, steps: tuple[Step, ...], job: TrialJob) -> Swept:
    """Sweep the blank of ``job`` once along ``track``, whose program has ``steps``."""
    from pipeline.shop.trial_sweep import sweep

    widest = max(tool.diameter for tool in job.tools.values()) / 2
    x_0, x_1, y_0, y_1 = _touched(track, job.blank, widest)
    heights = _heights(steps, job.blank)
    cell = min(tool.diameter for tool in job.tools.values()) * CELL
    area = (x_1 - x_0) * (y_1 - y_0) * (heights.size - 1)
    cell = max(cell, float(np.sqrt(area / MOST)))
    shape = (heights.size - 1, ceil((y_1 - y_0) / cell) or 1, ceil((x_1 - x_0) / cell) or 1)
    first = np.full(shape, np.inf, dtype=np.float32)
    step = np.diff(track.tip, axis=0, prepend=track.tip[:1])
    way = np.cumsum(np.sqrt((step**2).sum(axis=1)))
    radius = np.zeros(int(track.tool.max()) + 1)
    for number, tool in job.tools.items():
        if number < radius.size:
            radius[number] = tool.diameter / 2
    middles = (heights[1:] + heights[:-1]) / 2
    new = np.zeros(way.size, dtype=np.bool_)
    sweep(first, middles, (x_0, y_0), cell, track.tip, way, radius[track.tool], new)
    return Swept(
        blank=job.blank, cell=cell, heights=heights, first=first, corner=(x_0, y_0), way=way,
        cuts=new,
    )  # fmt: skip


def _touched(track: Track, blank: Box, radius: float) -> tuple[float, float, float, float]:
    """The part of the blank that the tool reaches: x, y from and to [mm]."""
    low = track.tip[track.tip[:, 2] < blank[5]]
    if not len(low):
        return blank[0], blank[0], blank[2], blank[2]
    reach = [low[:, 0].min(), low[:, 0].max(), low[:, 1].min(), low[:, 1].max()]
    reach = [r + side * (radius + 0.1) for r, side in zip(reach, (-1, 1, -1, 1), strict=True)]
    x = np.clip(reach[:2], blank[0], blank[1]).tolist()
    y = np.clip(reach[2:], blank[2], blank[3]).tolist()
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
    found = np.unique(np.round(levels, 6))
    found = found[np.concatenate([[True], np.diff(found) > SAME])]
    finer = [found[:1]]
    for low, high in pairwise(found):
        ramped = any(z_0 < high - SAME and z_1 > low + SAME for z_0, z_1 in ramps)
        count = ceil((high - low) / RAMP - 1e-9) if ramped else 1
        finer.append(low + (high - low) * np.arange(1, count + 1) / count)
    return np.concatenate(finer)
