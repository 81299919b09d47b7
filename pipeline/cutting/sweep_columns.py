"""Columns that a straight motion sweeps: what it cuts of them, and at which angle, compiled.

A disc that moves straight first touches a column at the distance ``left`` from its path when it
has come to along - sqrt(r^2 - left^2), with the point of its rim at phi, cos(phi) = left / r,
whatever the distance.  So each column that is newly swept is a sample of one angle, also those
that hold no material: the part that is engaged is material over columns, not over an area that a
few columns fill only by and large.  A rounded or pointed end is a stack of discs.

The path is straight and the tool convex, so that what a motion will cut has not been touched by
it before; the samples need no order.
"""

from math import sqrt

import numpy as np

from pipeline.cutting.sweep_formed import SKIN, cut_row, highest_slice, meet_row, reach
from pipeline.cutting.sweep_room import FLAT
from pipeline.cutting.sweep_rows import angle_of, cell_range, chord, swept_row
from pipeline.kernels import compiled


@compiled
def sweep(grid, forms, tool, stretch, tally, bins):  # type: ignore[no-untyped-def]
    """Cut what the stretch sweeps and add what it meets to ``tally``."""
    highest = highest_slice(grid, forms, tool, stretch)
    radius, cell, margin = reach(grid, forms, tool, stretch, highest), grid.cell, grid.margin
    rows, columns = grid.heights.shape
    x, y, span = stretch.x, stretch.y, max(stretch.length, stretch.window)
    far = stretch.fy * span
    low, high = y + min(0.0, far) - radius, y + max(0.0, far) + radius
    first, after = cell_range(grid.y0, cell, low, high, rows, margin)
    flat = forms.kind[tool] == FLAT and stretch.length > 0.0
    # what the tool's end has cut where it stood is behind it, unless it goes down
    skip = flat and stretch.joined and stretch.height >= 0.0
    for row in range(first, after):
        dy = grid.y0 + (row + 0.5) * cell - y
        begin, end = swept_row(dy, stretch.fx, stretch.fy, span, radius + 0.5 * cell)
        if begin > end:
            continue
        one, end_one = cell_range(grid.x0, cell, x + begin, x + end, columns, margin)
        if not flat:
            if stretch.length > 0.0:
                meet_row(grid, forms, tool, stretch, tally, highest, row, one, end_one)
            cut_row(grid, forms, tool, stretch, tally, bins, radius, row, one, end_one)
            continue
        two, end_two = end_one, end_one
        half = chord(dy, radius - 0.5 * cell) if skip else -1.0
        if half > 0.0:
            # without the cells that lie wholly in the circle
            hole, after_hole = cell_range(
                grid.x0, cell, x - half + cell, x + half - cell, columns, margin
            )
            if hole < after_hole:
                end_one, two = min(max(hole, one), end_two), max(min(after_hole, end_two), one)
        _sweep_flat(grid, radius, stretch, tally, row, one, end_one)
        _sweep_flat(grid, radius, stretch, tally, row, two, end_two)


@compiled
def _sweep_flat(grid, radius, stretch, tally, row, first, after):  # type: ignore[no-untyped-def]
    """Cells ``first`` to ``after`` of a row under a flat end that moves in the plane or ramps."""
    heights, cell, bottom, margin = grid.heights, grid.cell, grid.floor, grid.margin
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - stretch.x
    y0 = grid.y0 + row * cell - stretch.y
    fx, fy, length, slope = stretch.fx, stretch.fy, stretch.length, stretch.slope
    last_step, steps_per_length = stretch.steps - 1, stretch.steps / stretch.window
    row_inside, to_cosine = 0 <= row < rows, stretch.mirror / radius
    for column in range(first, after):
        dx, dy = x0 + column * cell, y0 + grid.y_shifts[column + margin] * cell
        along, left = dx * fx + dy * fy, dy * fx - dx * fy
        half = radius * radius - left * left
        if half <= 0.0:
            continue
        half = sqrt(half)
        touch, leave = along - half, along + half
        if touch > stretch.window or leave < 0.0:
            continue
        inside = row_inside and 0 <= column < columns
        top = float(heights[row, column]) if inside else bottom
        step = min(int(max(touch, 0.0) * steps_per_length), last_step)
        z = max(stretch.z + slope * min(max(touch, 0.0), length), bottom)
        met = max(top - z, 0.0)
        if touch >= 0.0:
            angle = angle_of(tally.cosines, tally.starts, left * to_cosine)
            tally.swept[step, 0, angle] += 1.0
            if met > SKIN:
                tally.met[step, 0, angle] += met
                tally.deepest[step] = max(tally.deepest[step], top - stretch.z - slope * touch)
        if touch > length or top <= bottom:
            continue
        t = min(leave, length) if slope < 0.0 else max(touch, 0.0)
        new = float(np.float32(max(stretch.z + slope * t, bottom)))
        if new < top:
            heights[row, column] = new
            # the rim takes what it meets at once, the end the rest as it goes down
            rim = min(met, top - new)
            tally.volume[step] += rim * cell * cell
            step = min(int((t + max(touch, 0.0)) * 0.5 * steps_per_length), last_step)
            tally.volume[step] += (top - new - rim) * cell * cell
