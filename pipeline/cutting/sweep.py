"""Sweeping tools through a stock: what the compiled kernels write, gathered in tables."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.cutting.height_map import HeightMap
from pipeline.cutting.sweep_room import (
    STEPS,
    Stations,
    forms_of,
    grid_of,
    open_room,
    station_room,
    tally_room,
)
from pipeline.cutting.tool import Tool
from pipeline.cutting.tool_path import ToolPath

_ROWS = 64 * STEPS
"""Stations that are written between two looks at the buffer."""


def swept(
    path: ToolPath, tools: Sequence[Tool], stock: HeightMap, bins: int
) -> tuple[Stations, HeightMap]:
    """Stations of a path at ``bins`` angles, and the stock that it leaves."""
    from pipeline.cutting.sweep_path import PIECE, STATE, sweep_path
    from pipeline.cutting.sweep_stations import SCALARS

    grid, forms = grid_of(stock, tools), forms_of(tools)
    tally, room, out = tally_room(bins), open_room(bins, SCALARS), station_room(_ROWS, bins)
    state = np.zeros(STATE, np.int64)
    # one layout, one compiled kernel
    start, end = (np.ascontiguousarray(ends, np.float64) for ends in (path.start, path.end))
    tool = np.ascontiguousarray(path.tool, np.int32)
    direction = np.ascontiguousarray(path.direction, np.int8)
    found = []
    while True:
        many = sweep_path(
            start, end, tool, direction, forms, grid, tally, room, out, state, bins,
        )  # fmt: skip
        found.append([column[:many].copy() for column in out])
        if state[PIECE] == len(path):
            break
    whole = [np.concatenate(columns) for columns in zip(*found, strict=True)]
    stations = Stations(*whole)
    return stations, replace(stock, heights=grid.heights)
