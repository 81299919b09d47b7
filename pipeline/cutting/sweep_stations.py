"""From the counts of steps to stations: steps that are engaged alike are joined, compiled."""

from pipeline.cutting.sweep_formed import SKIN
from pipeline.cutting.sweep_profile import profile
from pipeline.kernels import compiled

SCALARS = 10
ALONG, LENGTH, VOLUME, HEIGHT, DEEPEST, SHALLOWEST, STEPS_IN, AIR, AIR_HEIGHT, AIR_STEPS = range(
    SCALARS
)
"""Of the open station: where it begins, length, volume, sum of the tip's heights over its steps,
greatest and least depth of a step, number of steps; length, heights and number of the steps in air
since."""
_DEPTH_SHARE = 0.05
_SHIFT_CELLS = 1.0
_THIN_CELLS = 2.0
_GAP = 6
"""Steps in air after which a thin engagement is over: less than a cell wide, it has no column in
each step."""


@compiled
def take_step(grid, forms, tool, tally, step, plunge, along, length, z, room, out, n):  # type: ignore[no-untyped-def]
    """Join a step to the open station, or begin one with it; returns the number of stations."""
    scalars, volume, many = room.scalars, tally.volume[step], forms.many[tool] + 1
    peak = profile(
        forms, tool, tally.swept[step], tally.met[step], room.cosines, plunge,
        grid.floor - z, tally.deepest[step], grid.cell, room.mean, room.step_lower, room.step_depth,
    )  # fmt: skip
    if peak <= SKIN and volume <= 0.0:
        if scalars[STEPS_IN] == 0.0:
            return n
        scalars[AIR_STEPS] += 1.0
        if scalars[AIR_STEPS] > _GAP or not _thin(room, forms.radius[tool], grid.cell):
            return close(forms, tool, room, out, n)
        scalars[AIR] += length
        scalars[AIR_HEIGHT] += z
        _add(room.air, tally.swept[step], many)
        return n
    if tally.deepest[step] > 0.0:
        peak = tally.deepest[step]
    if scalars[STEPS_IN] > 0.0 and not _same(room, peak, forms.radius[tool], grid.cell):
        n = close(forms, tool, room, out, n)
    if scalars[STEPS_IN] == 0.0:
        scalars[ALONG], scalars[SHALLOWEST] = along, peak
    scalars[LENGTH] += length + scalars[AIR]
    scalars[VOLUME] += volume
    scalars[HEIGHT] += z + scalars[AIR_HEIGHT]
    scalars[STEPS_IN] += 1.0 + scalars[AIR_STEPS]
    scalars[DEEPEST] = max(scalars[DEEPEST], peak)
    scalars[SHALLOWEST] = min(scalars[SHALLOWEST], peak)
    if scalars[AIR_STEPS] > 0.0:
        _add(room.swept, room.air, many)
        room.air[:many] = 0.0
        scalars[AIR:] = 0.0
    _add(room.swept, tally.swept[step], many)
    _add(room.met, tally.met[step], many)
    _whole(grid, forms, tool, plunge, room)
    return n


@compiled
def close(forms, tool, room, out, n):  # type: ignore[no-untyped-def]
    """Write the open station, when there is one; returns the number of stations."""
    scalars, many = room.scalars, forms.many[tool] + 1
    if scalars[STEPS_IN] == 0.0:
        return n
    out.along[n], out.length[n], out.volume[n] = scalars[ALONG], scalars[LENGTH], scalars[VOLUME]
    for a in range(out.lower.shape[1]):
        out.lower[n, a] = room.lower[a]
        out.upper[n, a] = room.lower[a] + room.depth[a]
    scalars[:] = 0.0
    room.swept[:many], room.met[:many], room.air[:many] = 0.0, 0.0, 0.0
    return n + 1


@compiled
def _whole(grid, forms, tool, plunge, room):  # type: ignore[no-untyped-def]
    """Profile of the open station."""
    z = room.scalars[HEIGHT] / room.scalars[STEPS_IN]
    profile(
        forms, tool, room.swept, room.met, room.cosines, plunge,
        grid.floor - z, room.scalars[DEEPEST], grid.cell, room.mean, room.lower, room.depth,
    )  # fmt: skip


@compiled
def _add(counts, more, slices):  # type: ignore[no-untyped-def]
    for k in range(slices):
        for a in range(counts.shape[1]):
            counts[k, a] += more[k, a]


@compiled
def _thin(room, radius, cell):  # type: ignore[no-untyped-def]
    """Whether the open station is engaged over few cells across the feed."""
    area = 0.0
    for a in range(room.depth.shape[0]):
        area += room.depth[a] * _width(room.cosines, a, radius)
    return area < _THIN_CELLS * cell * room.scalars[DEEPEST]


@compiled
def _width(cosines, a, radius):  # type: ignore[no-untyped-def]
    """Of an angle, seen along the feed [m]."""
    half = cosines.shape[0] - 1
    front = a if a < half else 2 * half - 1 - a
    return radius * (cosines[front] - cosines[front + 1])


@compiled
def _same(room, peak, radius, cell):  # type: ignore[no-untyped-def]
    """Whether a step's profile is that of the open station: as deep, its limits where they were."""
    most = max(peak, room.scalars[DEEPEST])
    least = min(peak, room.scalars[SHALLOWEST])
    if most - least > _DEPTH_SHARE * most:
        return False
    if most <= SKIN:
        return True
    moved = 0.0
    for a in range(room.depth.shape[0]):
        moved += abs(room.step_depth[a] - room.depth[a]) * _width(room.cosines, a, radius)
    # a change of depth that is allowed must not count as a move of the limits
    return moved <= _SHIFT_CELLS * cell * most + 2.0 * radius * (most - least)
