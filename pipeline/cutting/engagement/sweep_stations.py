"""Stations of a tool path, from the counts of columns that its pieces sweep, compiled.

The pieces are followed one after the other in steps.  Counts of a step become a profile: which
part of the tool is engaged at each angle.  Steps with the same profile are joined to a station.
Pieces so short that few columns lie before them also count the columns of earlier pieces, which
fade over a path length of two cells as long as the path goes on smoothly.
"""

from math import ceil, exp, floor, sqrt

import numpy as np

from pipeline.cutting.engagement.end_rings import write_ring
from pipeline.cutting.engagement.sweep_columns import SKIN, between, sweep
from pipeline.cutting.engagement.sweep_workspace import STEPS, LinearSegment
from pipeline.kernels import compiled

CELLS = 2.0
"""Path length in cells over which earlier counts fade; a longer piece needs none."""
_ENOUGH = 3.0
"""Columns without material by which a piece is in air, whatever was before it."""
_STRAIGHT_ON = 0.87
"""Cosine of the greatest turn, 30 degrees, after which the same part of the tool still cuts."""


@compiled
def goes_on(start, end, piece):  # type: ignore[no-untyped-def]
    """Whether a piece goes on in about the direction of the one before."""
    if piece == 0:
        return False
    product, square, before = 0.0, 0.0, 0.0
    for axis in range(3):
        a = end[piece, axis] - start[piece, axis]
        b = end[piece - 1, axis] - start[piece - 1, axis]
        product, square, before = product + a * b, square + a * a, before + b * b
    return product > _STRAIGHT_ON * sqrt(square * before)


@compiled
def add_recent(counts, station, slices, length, cell):  # type: ignore[no-untyped-def]
    """Add the counts of earlier pieces to the one step of a short piece, unless it is in air."""
    swept, met = 0.0, 0.0
    for k in range(slices):
        for a in range(counts.swept.shape[2]):
            swept += counts.swept[0, k, a]
            met += counts.met[0, k, a]
    if met == 0.0 and swept >= _ENOUGH:
        return
    left = exp(-length / (CELLS * cell))
    for k in range(slices):
        for a in range(counts.swept.shape[2]):
            counts.swept[0, k, a] += left * station.recent_swept[k, a]
            counts.met[0, k, a] += left * station.recent_met[k, a]


@compiled
def keep_recent(counts, station, slices, step, share):  # type: ignore[no-untyped-def]
    """Keep a share of the counts of a step for the pieces that follow."""
    for k in range(slices):
        for a in range(counts.swept.shape[2]):
            station.recent_swept[k, a] = share * counts.swept[step, k, a]
            station.recent_met[k, a] = share * counts.met[step, k, a]


_SIDE_CELLS = 0.25


@compiled
def profile(profiles, tool, swept, met, cosines, plunge, floor, deepest, cell, mean, lower, depth):  # type: ignore[no-untyped-def]
    """Fill ``lower`` and ``depth`` [m] at each angle; returns the greatest depth.

    The slices that are met at an angle are taken as one piece of their height altogether, about
    their centre of gravity; ``floor`` is how far the underside of the stock is above the tip.
    """
    many, peak = profiles.many[tool], 0.0
    start = max(floor, profiles.bottom[tool, many])
    for k in range(many + 1):
        full = profiles.thick[tool, k] if k < many else deepest - start
        _means(swept[k], met[k], cosines, plunge, profiles.across[tool, k] / cell, full, mean[k])
    for a in range(depth.shape[0]):
        height = mean[many, a]
        moment = height * (start + 0.5 * height)
        for k in range(many):
            height += mean[k, a]
            moment += mean[k, a] * 0.5 * (profiles.bottom[tool, k] + profiles.bottom[tool, k + 1])
        depth[a] = height if height > SKIN else 0.0
        begin = moment / height - 0.5 * height if height > SKIN else 0.0
        lower[a] = begin if begin > SKIN else 0.0
        peak = max(peak, depth[a])
    return peak


@compiled
def _means(swept, met, cosines, plunge, radius, full, mean):  # type: ignore[no-untyped-def]
    """Material over columns at each angle; one that no column met has its neighbour's.

    Neighbours are those nearer to the direction of feed, where there are most columns.  At the
    sides of a tool of ``radius`` cells angles are far narrower than a cell, seen along the feed:
    those within a part of a cell are taken together.  ``full``: greatest depth met [m].
    """
    bins, material = swept.shape[0], 0.0
    for a in range(bins):
        material += met[a]
        mean[a] = 0.0
    if material == 0.0:
        return
    after = bins if plunge else bins // 2
    middle, start, side = after // 2, 0.0, 0
    if not plunge:
        while side < middle and radius * (1.0 - cosines[side]) < _SIDE_CELLS:
            side += 1
    for off in range(middle):
        count = swept[middle - 1 - off] + swept[middle + off]
        if count > 0.0:
            start = (met[middle - 1 - off] + met[middle + off]) / count
            break
    # from the front to both sides
    value = start
    for a in range(middle, after - side):
        value = met[a] / swept[a] if swept[a] > 0.0 else value
        mean[a] = value
    _side(swept, met, cosines, after - 1, side, value, full, mean)
    value = start
    for a in range(middle - 1, side - 1, -1):
        value = met[a] / swept[a] if swept[a] > 0.0 else value
        mean[a] = value
    _side(swept, met, cosines, np.int64(0), side, value, full, mean)
    for a in range(after, bins):
        mean[a] = met[a] / swept[a] if swept[a] > 0.0 else 0.0


@compiled
def _side(swept, met, cosines, outermost, many, neighbour, full, mean):  # type: ignore[no-untyped-def]
    """The ``many`` angles at a side together, from ``outermost`` on to the front.

    Where the angle next to them is not engaged, what is engaged of them, ``full`` deep, lies on the
    outside: how far it reaches follows from how much it is.
    """
    inward = 1 if outermost == 0 else -1
    count, total = 0.0, 0.0
    for off in range(many):
        count += swept[outermost + inward * off]
        total += met[outermost + inward * off]
    value = total / count if count > 0.0 else neighbour
    outside = neighbour < 0.5 * full and value < full
    reach = (1.0 - cosines[many]) * value / full if outside else 0.0
    for off in range(many):
        width = cosines[off] - cosines[off + 1]
        share = min(max((reach - 1.0 + cosines[off]) / width, 0.0), 1.0)
        mean[outermost + inward * off] = full * share if outside else value


SCALARS = 10
ALONG, LENGTH, VOLUME, HEIGHT, DEEPEST, SHALLOWEST, STEPS_IN, AIR, AIR_HEIGHT, AIR_STEPS = range(
    SCALARS
)
"""Columns of the open station: begin, length, volume, sum of the tip's heights over its steps,
greatest and least depth of a step, number of steps; then length, heights and number of the steps in
air since."""
_DEPTH_SHARE = 0.05
_SHIFT_CELLS = 1.0
_THIN_CELLS = 2.0
_GAP = 6
"""Steps in air that end a thin engagement, which has no column in each step."""


@compiled
def take_step(grid, profiles, tool, counts, step, plunge, along, length, z, station, out, n):  # type: ignore[no-untyped-def]
    """Join a step to the open station, or begin one with it; returns the number of stations."""
    scalars, volume, many = station.scalars, counts.volume[step], profiles.many[tool] + 1
    peak = profile(
        profiles, tool, counts.swept[step], counts.met[step], station.cosines, plunge,
        grid.floor - z, counts.deepest[step], grid.cell, station.mean, station.step_lower,
        station.step_depth,
    )  # fmt: skip
    # a step in air ends the station, but for gaps of a thin engagement
    if peak <= SKIN and volume <= 0.0:
        if scalars[STEPS_IN] == 0.0:
            return n
        scalars[AIR_STEPS] += 1.0
        if scalars[AIR_STEPS] > _GAP or not _thin(station, profiles.radius[tool], grid.cell):
            return close(grid, profiles, tool, station, out, n)
        scalars[AIR] += length
        scalars[AIR_HEIGHT] += z
        _add(station.air, counts.swept[step], many)
        return n
    if counts.deepest[step] > 0.0:
        peak = counts.deepest[step]
    if scalars[STEPS_IN] > 0.0 and not _same(station, peak, profiles.radius[tool], grid.cell):
        n = close(grid, profiles, tool, station, out, n)
    # a step in the material is added
    if scalars[STEPS_IN] == 0.0:
        scalars[ALONG], scalars[SHALLOWEST] = along, peak
    scalars[LENGTH] += length + scalars[AIR]
    scalars[VOLUME] += volume
    scalars[HEIGHT] += z + scalars[AIR_HEIGHT]
    scalars[STEPS_IN] += 1.0 + scalars[AIR_STEPS]
    scalars[DEEPEST] = max(scalars[DEEPEST], peak)
    scalars[SHALLOWEST] = min(scalars[SHALLOWEST], peak)
    if scalars[AIR_STEPS] > 0.0:
        _add(station.swept, station.air, many)
        station.air[:many] = 0.0
        scalars[AIR:] = 0.0
    _add(station.swept, counts.swept[step], many)
    _add(station.met, counts.met[step], many)
    if plunge:
        _add(station.pressed, counts.pressed, np.int64(3))
    _whole(grid, profiles, tool, plunge, station)
    return n


@compiled
def close(grid, profiles, tool, station, out, n):  # type: ignore[no-untyped-def]
    """Write the open station, when there is one; returns the number of stations."""
    scalars, many = station.scalars, profiles.many[tool] + 1
    if scalars[STEPS_IN] == 0.0:
        return n
    out.along[n], out.length[n], out.volume[n] = scalars[ALONG], scalars[LENGTH], scalars[VOLUME]
    write_ring(grid, profiles, tool, station, scalars[STEPS_IN], out, n)
    for a in range(out.lower.shape[1]):
        out.lower[n, a] = station.lower[a]
        out.upper[n, a] = station.lower[a] + station.depth[a]
    scalars[:] = 0.0
    station.swept[:many], station.met[:many], station.air[:many] = 0.0, 0.0, 0.0
    station.pressed[:] = 0.0
    return n + 1


@compiled
def _whole(grid, profiles, tool, plunge, station):  # type: ignore[no-untyped-def]
    """Profile of the open station."""
    z = station.scalars[HEIGHT] / station.scalars[STEPS_IN]
    profile(
        profiles, tool, station.swept, station.met, station.cosines, plunge,
        grid.floor - z, station.scalars[DEEPEST], grid.cell, station.mean, station.lower,
        station.depth,
    )  # fmt: skip


@compiled
def _add(counts, more, rows):  # type: ignore[no-untyped-def]
    for k in range(rows):
        for a in range(counts.shape[1]):
            counts[k, a] += more[k, a]


@compiled
def _thin(station, radius, cell):  # type: ignore[no-untyped-def]
    """Whether the open station is engaged over few cells across the feed."""
    area = 0.0
    for a in range(station.depth.shape[0]):
        area += station.depth[a] * _width(station.cosines, a, radius)
    return area < _THIN_CELLS * cell * station.scalars[DEEPEST]


@compiled
def _width(cosines, a, radius):  # type: ignore[no-untyped-def]
    """Width of an angle's bin, seen along the feed [m]."""
    half = cosines.shape[0] - 1
    front = a if a < half else 2 * half - 1 - a
    return radius * (cosines[front] - cosines[front + 1])


@compiled
def _same(station, peak, radius, cell):  # type: ignore[no-untyped-def]
    """Whether a step's profile is that of the open station: as deep, its limits where they were."""
    most = max(peak, station.scalars[DEEPEST])
    least = min(peak, station.scalars[SHALLOWEST])
    if most - least > _DEPTH_SHARE * most:
        return False
    if most <= SKIN:
        return True
    moved = 0.0
    for a in range(station.depth.shape[0]):
        moved += abs(station.step_depth[a] - station.depth[a]) * _width(station.cosines, a, radius)
    # a change of depth that is allowed must not count as a move of the limits
    return moved <= _SHIFT_CELLS * cell * most + 2.0 * radius * (most - least)


STATE = 3
PIECE, DONE, RECENT = range(STATE)
"""Columns of the state: piece; 0, or 1 more than the steps before where it stopped within the
piece; whether the counts of earlier pieces are valid."""
_STEEP = 0.7
"""Rise over path length above which a motion is followed step by step: it is short in the plane."""


@compiled
def sweep_path(start, end, tool_of, direction, profiles, grid, counts, station, out, state, bins):  # type: ignore[no-untyped-def]
    """Follow the path from ``state`` until its end or a full ``out``; number of new stations."""
    n = np.int64(0)  # a literal would have all that follows compiled a second time
    while state[PIECE] < start.shape[0]:
        piece = state[PIECE]
        tool, spindle = tool_of[piece], -1.0 if direction[piece] < 0 else 1.0
        joined = _joined(start, end, tool_of, piece)
        if state[DONE] == 0 and not (joined and goes_on(start, end, piece)):
            state[RECENT] = 0
        first = n
        n = _sweep_piece(
            start[piece], end[piece], spindle, joined, profiles, tool, grid, counts, station, out,
            n, state, bins,
        )  # fmt: skip
        out.piece[first:n] = piece
        if state[DONE] > 0:
            return n
        state[PIECE] = piece + 1
    return n


@compiled
def _sweep_piece(  # type: ignore[no-untyped-def]
    start, end, spindle, joined, profiles, tool, grid, counts, station, out, n, state, bins
):
    """Follow a piece from ``state`` on; ``state[DONE]`` is 0 when it is at its end."""
    x, y, z = start
    dx, dy, dz = end[0] - x, end[1] - y, end[2] - z
    whole, level = sqrt(dx * dx + dy * dy + dz * dz), sqrt(dx * dx + dy * dy)
    # steps within the stock
    enter, leave = _within(grid, profiles.radius[tool], x, y, z, dx, dy, dz)
    if whole == 0.0 or enter > leave:
        state[RECENT] = 0
        return n
    plunge = level < 1e-3 * grid.cell
    steps = ceil(whole / max(CELLS * grid.cell, 0.1 * profiles.radius[tool]) - 1e-9)
    last = min(ceil(leave * steps), steps)
    at_once = 1 if plunge or abs(dz) > _STEEP * whole else STEPS
    first = floor(enter * steps)
    begin = state[DONE] - 1 if state[DONE] > 0 else first
    joined = (joined and begin == 0) or begin > first
    # segment by segment: sweep, complete the counts, join the steps to stations
    while begin < last:
        if n > out.piece.shape[0] - STEPS - 2:
            state[DONE] = begin + 1
            return n
        many = min(at_once, last - begin)
        a, share = begin / steps, many / steps
        length = 0.0 if plunge else level * share
        segment = LinearSegment(
            x + dx * a, y + dy * a, z + dz * a,
            1.0 if plunge else dx / level, 0.0 if plunge else dy / level,
            length, 0.0 if plunge else dz / level, dz * share,
            max(length, CELLS * grid.cell) if at_once == 1 else length, many, spindle, joined,
        )  # fmt: skip
        _clear(counts, many, profiles.many[tool] + 1)
        if plunge:
            counts.pressed[:] = 0.0
        sweep(grid, profiles, tool, segment, counts, bins)
        _settle(grid, profiles, tool, segment, at_once == 1, counts, station, state)
        for step in range(begin, begin + many):
            n = take_step(
                grid, profiles, tool, counts, step - begin, plunge,
                whole * step / steps, whole / steps, z + dz * (step + 0.5) / steps, station, out, n,
            )  # fmt: skip
        begin, joined = begin + many, True
    state[DONE] = 0
    return close(grid, profiles, tool, station, out, n)


@compiled
def _settle(grid, profiles, tool, segment, steep, counts, station, state):  # type: ignore[no-untyped-def]
    """Complete the counts of a short segment, and keep those that the next one may need."""
    slices, near = profiles.many[tool] + 1, CELLS * grid.cell
    nothing = counts.volume[: segment.steps].sum() == 0.0
    if steep:
        if nothing:
            # what lies beside its path is not cut
            _clear(counts, segment.steps, slices)
        state[RECENT] = 0
        return
    if segment.length < near:
        if state[RECENT] == 1:
            add_recent(counts, station, slices, segment.length, grid.cell)
        keep_recent(counts, station, slices, np.int64(0), 1.0)
    else:
        # where a long segment removes nothing, what it meets is the division in slices
        if nothing:
            _clear(counts, segment.steps, slices)
        share = near * segment.steps / segment.length
        keep_recent(counts, station, slices, segment.steps - 1, share)
    state[RECENT] = 1


@compiled
def _clear(counts, steps, slices):  # type: ignore[no-untyped-def]
    counts.swept[:steps, :slices] = 0.0
    counts.met[:steps, :slices] = 0.0
    counts.volume[:steps] = 0.0
    counts.deepest[:steps] = 0.0


@compiled
def _joined(start, end, tool_of, piece):  # type: ignore[no-untyped-def]
    """Whether the same tool stood at the beginning of a piece when the one before had ended."""
    if piece == 0 or tool_of[piece - 1] != tool_of[piece]:
        return False
    moved = False
    for axis in range(3):
        if start[piece, axis] != end[piece - 1, axis]:
            return False
        moved = moved or start[piece - 1, axis] != end[piece - 1, axis]
    # a piece without length cut nothing around itself
    return moved


@compiled
def _within(grid, radius, x, y, z, dx, dy, dz):  # type: ignore[no-untyped-def]
    """First and last part of a piece at which the tool may be in the stock."""
    rows, columns = grid.heights.shape
    wide, deep = columns * grid.cell, rows * grid.cell
    enter, leave = between(dx, x, grid.x0 - radius, grid.x0 + wide + radius)
    enter_y, leave_y = between(dy, y, grid.y0 - radius, grid.y0 + deep + radius)
    enter_z, leave_z = between(dz, z, min(z, z + dz) - 1.0, grid.top)
    return max(enter, enter_y, enter_z, 0.0), min(leave, leave_y, leave_z, 1.0)
