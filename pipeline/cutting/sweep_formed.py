"""Columns under a rounded or pointed end, and under any end that goes straight down, compiled."""

from math import acos, inf, pi, sqrt

import numpy as np

from pipeline.cutting.sweep_rows import angle_of, chord
from pipeline.cutting.sweep_surface import end_height, lowest_at, radius_at
from pipeline.kernels import compiled

SKIN = 1e-7
"""Material thinner than this is rounding: heights are kept to 7 digits [m]."""


@compiled
def highest_slice(grid, forms, tool, stretch):  # type: ignore[no-untyped-def]
    """The highest slice that can meet material: none is higher than the highest of the stock."""
    least = min(stretch.z, stretch.z + stretch.height)
    highest = forms.many[tool]
    while highest > 0 and least + forms.bottom[tool, highest] > grid.top:
        highest -= 1
    return highest


@compiled
def reach(grid, forms, tool, stretch, highest):  # type: ignore[no-untyped-def]
    """Radius within which the tool can meet material [m]."""
    if forms.many[tool] == 0:
        return forms.radius[tool]
    high = grid.top - min(stretch.z, stretch.z + stretch.height)
    widest = radius_at(
        forms.kind[tool], forms.radius[tool], forms.flat[tool], forms.corner[tool],
        forms.cone[tool], max(high, 0.0),
    )  # fmt: skip
    return max(widest, forms.across[tool, highest])


@compiled
def meet_row(grid, forms, tool, stretch, tally, highest, row, first, after):  # type: ignore[no-untyped-def]
    """Count cells ``first`` to ``after`` of a row where the front of each slice first touches them.

    What stood above the tool where the stretch begins was cut there, whatever it was: a column
    that reaches up to there is taken to have reached on, and weighs as much as it tells.
    """
    heights, cell, margin, floor = grid.heights, grid.cell, grid.margin, grid.floor - stretch.z
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - stretch.x
    y0 = grid.y0 + row * cell - stretch.y
    fx, fy, z, slope, length = stretch.fx, stretch.fy, stretch.z, stretch.slope, stretch.length
    window, steps, mirror = stretch.window, stretch.steps, stretch.mirror
    steps_per_length = steps / window
    bottom, across, rise = forms.bottom[tool], forms.across[tool], forms.rise[tool]
    inverse, thick, many = forms.inverse[tool], forms.thick[tool], forms.many[tool]
    kind, radius, flat = forms.kind[tool], forms.radius[tool], forms.flat[tool]
    corner, cone = forms.corner[tool], forms.cone[tool]
    row_inside = 0 <= row < rows
    for column in range(first, after):
        dx, dy = x0 + column * cell, y0 + grid.y_shifts[column + margin] * cell
        along, left = dx * fx + dy * fy, dy * fx - dx * fy
        beyond = max(along - window, 0.0)
        square, nearest = along * along + left * left, beyond * beyond + left * left
        if along <= 0.0 or nearest >= across[highest] * across[highest]:
            continue
        inside = row_inside and 0 <= column < columns
        top = (float(heights[row, column]) if inside else grid.floor) - z
        above = inf
        if square < radius * radius:
            above = end_height(kind, flat, corner, cone, sqrt(square))
        known = top < above - SKIN
        for k in range(highest, -1, -1):
            if across[k] * across[k] > square:
                continue
            if across[k] * across[k] <= nearest:
                break
            t = along - sqrt(across[k] * across[k] - left * left)
            lift, start, stop = slope * min(t, length), bottom[k], bottom[k + 1]
            if k < many and (k == 0 or abs(left) > across[k - 1]):
                # at no level does the surface pass lower over the column
                start = max(start, end_height(kind, flat, corner, cone, abs(left)))
            if not known:
                stop = min(stop, above - lift)
            if stop - start <= SKIN:
                continue
            step = min(int(t * steps_per_length), steps - 1)
            cosine = mirror * left * inverse[k]
            angle = angle_of(tally.cosines, tally.starts, cosine)
            tally.swept[step, k, angle] += (stop - bottom[k]) / thick[k] if k < many else 1.0
            # uphill, the lower part of the surface moves away from the material
            away = slope > 0.0 and rise[k] * sqrt(1.0 - cosine * cosine) <= slope
            if top <= lift + start + SKIN or away:
                continue
            met = min(top if known else inf, lift + stop) - max(floor, lift + bottom[k])
            if met > 0.0:
                tally.met[step, k, angle] += met
                tally.deepest[step] = max(tally.deepest[step], top - lift)


@compiled
def cut_row(grid, forms, tool, stretch, tally, bins, radius, row, first, after):  # type: ignore[no-untyped-def]
    """Cut cells ``first`` to ``after`` of a row; ``radius``: see :func:`reach`."""
    heights, cell, margin = grid.heights, grid.cell, grid.margin
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - stretch.x
    y0 = grid.y0 + row * cell - stretch.y
    fx, fy, slope, length = stretch.fx, stretch.fy, stretch.slope, stretch.length
    kind, flat, full = forms.kind[tool], forms.flat[tool], forms.radius[tool]
    corner, cone = forms.corner[tool], forms.cone[tool]
    z = stretch.z + min(stretch.height, 0.0) if length == 0.0 else stretch.z
    least = max(min(stretch.z, stretch.z + stretch.height), grid.floor)
    # behind the tool all is cut already, unless it goes down
    ahead = stretch.joined and length > 0.0 and stretch.height >= 0.0
    pressed = stretch.steps == 1 and stretch.height < 0.0
    row_inside = 0 <= row < rows
    for column in range(first, after):
        inside = row_inside and 0 <= column < columns
        top = float(heights[row, column]) if inside else grid.floor
        dx, dy = x0 + column * cell, y0 + grid.y_shifts[column + margin] * cell
        along, left = dx * fx + dy * fy, dy * fx - dx * fy
        off = along - min(max(along, 0.0), length)
        if (top <= least and not pressed) or (along < 0.0 and ahead):
            continue
        if off * off + left * left >= radius * radius:
            continue
        half = sqrt(radius * radius - left * left)
        begin, end = max(along - half, 0.0), min(along + half, length)
        t = lowest_at(kind, flat, corner, cone, along, left, slope, begin, end)
        over = sqrt(left * left + (along - t) * (along - t))
        low = z + slope * t + end_height(kind, flat, corner, cone, over)
        new = float(np.float32(max(low, grid.floor)))
        cut = max(top - new, 0.0)
        if cut > 0.0:
            heights[row, column] = new
            # from where the surface meets it until it is lowest, most of it early
            widest = radius_at(kind, full, flat, corner, cone, top - z - slope * t)
            when = max(t - max(chord(left, widest), 0.0) * 2.0 / 3.0, 0.0)
            step = min(int(when * stretch.steps / stretch.window), stretch.steps - 1)
            tally.volume[step] += cut * cell * cell
        if pressed and (length == 0.0 or along < 0.0):
            _press(grid, forms, tool, stretch, tally, bins, along, left, cut)


@compiled
def _press(grid, forms, tool, stretch, tally, bins, along, left, cut):  # type: ignore[no-untyped-def]
    """Count a column that the end presses on from above: all of a plunge, the rear of a ramp."""
    r, many, across = sqrt(along * along + left * left), forms.many[tool], forms.across[tool]
    if r == 0.0 or r >= forms.radius[tool]:
        return
    slice_ = 0
    while slice_ < many - 1 and 0.5 * (across[slice_] + across[slice_ + 1]) < r:
        slice_ += 1
    angle = acos(min(max(stretch.mirror * left / r, -1.0), 1.0))
    if along < 0.0:
        angle = 2.0 * pi - angle
    place = min(int(angle * bins / (2.0 * pi)), bins - 1)
    tally.swept[0, slice_, place] += 1.0
    if cut > SKIN:
        # a flat end has no height: as thick as the map resolves
        tally.met[0, slice_, place] += forms.thick[tool, slice_] if many > 0 else grid.cell
