"""Columns of a height map that a straight motion of the tool sweeps, compiled.

A disc that moves straight first touches a column at the distance ``left`` from its path when it
has come to along - sqrt(r^2 - left^2), with the point of its rim at phi, cos(phi) = left / r,
whatever the distance.  So each column that is newly swept is a sample of one angle, also those
that hold no material: the part that is engaged is material over columns, not over an area that a
few columns fill only roughly.  A rounded or pointed end is a stack of discs.

The path is straight and the tool convex, so that what a motion will cut has not been touched by
it before; the samples need no order.

The tool's end is a surface e(r) over its axis.  After a length t of the motion its surface above a
place at (along, left) of the start is at slope t + e(r), r^2 = left^2 + (along - t)^2, convex in t.
"""

from math import acos, ceil, floor, inf, pi, sqrt

import numpy as np

from pipeline.cutting.engagement.sweep_workspace import CONE, FLAT
from pipeline.kernels import compiled


@compiled
def angle_of(cosines, starts, cosine):  # type: ignore[no-untyped-def]
    """Angle of the front half that a cosine belongs to, by the tables of `SweepCounts`."""
    angle = starts[min(int((1.0 - cosine) * (0.5 * starts.shape[0])), starts.shape[0] - 1)]
    while cosine < cosines[angle + 1]:
        angle += 1
    return angle


@compiled
def cell_range(origin, cell, low, high, many, margin):  # type: ignore[no-untyped-def]
    """First cell and cell after the last that reach into ``low`` to ``high`` [m].

    Of ``many`` that begin at ``origin``, and ``margin`` before and after them.
    """
    least, most = -float(margin), float(many + margin)
    first = floor(min(max((low - origin) / cell, least), most))
    after = floor(min(max((high - origin) / cell + 1.0, least), most))
    return first, after


@compiled
def chord(distance, radius):  # type: ignore[no-untyped-def]
    """Half of the chord of a circle at a distance from its centre, below 0 where it has none."""
    square = radius * radius - distance * distance
    return sqrt(square) if square >= 0.0 else -1.0


@compiled
def swept_row(dy, fx, fy, length, radius):  # type: ignore[no-untyped-def]
    """Least and greatest x that a disc reaches that moves ``length`` along (fx, fy) from 0 [m].

    At ``dy`` from the start of its centre; the first is greater than the second where it does not.
    """
    low, high = inf, -inf
    half = chord(dy, radius)
    if half >= 0.0:
        low, high = -half, half
    half = chord(dy - length * fy, radius)
    if half >= 0.0:
        low, high = min(low, length * fx - half), max(high, length * fx + half)
    # between the circles: |left| <= radius and 0 <= along <= length
    begin, end = between(-fy, dy * fx, -radius, radius)
    first, last = between(fx, dy * fy, 0.0, length)
    begin, end = max(begin, first), min(end, last)
    if begin <= end:
        low, high = min(low, begin), max(high, end)
    return low, high


@compiled
def between(factor, offset, low, high):  # type: ignore[no-untyped-def]
    """Least and greatest x at which low <= factor x + offset <= high."""
    if abs(factor) < 1e-12:
        return (-inf, inf) if low <= offset <= high else (inf, -inf)
    a, b = (low - offset) / factor, (high - offset) / factor
    return min(a, b), max(a, b)


_HALVINGS = 16


@compiled
def end_height(kind, flat, corner, cone, r):  # type: ignore[no-untyped-def]
    """e(r): height of the end's surface above the tip at radius ``r`` within the tool's [m]."""
    if kind == FLAT or r <= flat:
        return 0.0
    if kind == CONE:
        return cone * r
    return corner - sqrt(max(0.0, corner * corner - (r - flat) * (r - flat)))


@compiled
def radius_at(kind, radius, flat, corner, cone, height):  # type: ignore[no-untyped-def]
    """Radius of the tool at a height above its tip [m]."""
    if kind == CONE:
        return min(height / cone, radius)
    if kind == FLAT or height >= corner:
        return radius
    return flat + sqrt(max(0.0, height * (2.0 * corner - height)))


@compiled
def lowest_at(kind, flat, corner, cone, along, left, slope, begin, end):  # type: ignore[no-untyped-def]
    """Length of the motion, within ``begin`` to ``end``, at which the surface is lowest [m]."""
    if slope == 0.0:
        return min(max(along, begin), end)
    steep = abs(slope)
    if kind == FLAT or (kind == CONE and steep >= cone):
        return end if slope < 0.0 else begin
    if kind == CONE:
        lag = steep * abs(left) / sqrt(cone * cone - steep * steep)
    elif flat == 0.0:
        lag = steep * sqrt(max(0.0, corner * corner - left * left)) / sqrt(1.0 + steep * steep)
    else:
        lag = _lag_of_torus(flat, corner, abs(left), steep)
    t = along + lag if slope < 0.0 else along - lag
    return min(max(t, begin), end)


@compiled
def _lag_of_torus(flat, corner, left, steep):  # type: ignore[no-untyped-def]
    """Distance along the motion from a place to where a corner is lowest: e'(r) u / r = steep."""
    low, high = max(flat, left), flat + corner
    for _ in range(_HALVINGS):
        r = 0.5 * (low + high)
        out = r - flat
        rise = out * out * (r * r - left * left)
        if rise > steep * steep * r * r * (corner * corner - out * out):
            high = r
        else:
            low = r
    r = 0.5 * (low + high)
    return sqrt(max(0.0, r * r - left * left))


SKIN = 1e-7
"""Material thinner than this is rounding: heights are kept to 7 digits [m]."""


@compiled
def highest_slice(grid, profiles, tool, segment):  # type: ignore[no-untyped-def]
    """Highest slice that can meet material: none begins above the top of the stock."""
    least = min(segment.z, segment.z + segment.height)
    highest = profiles.many[tool]
    while highest > 0 and least + profiles.bottom[tool, highest] > grid.top:
        highest -= 1
    return highest


@compiled
def reach(grid, profiles, tool, segment, highest):  # type: ignore[no-untyped-def]
    """Radius within which the tool can meet material [m]."""
    if profiles.many[tool] == 0:
        return profiles.radius[tool]
    high = grid.top - min(segment.z, segment.z + segment.height)
    widest = radius_at(
        profiles.kind[tool], profiles.radius[tool], profiles.flat[tool], profiles.corner[tool],
        profiles.cone[tool], max(high, 0.0),
    )  # fmt: skip
    return max(widest, profiles.across[tool, highest])


@compiled
def meet_row(grid, profiles, tool, segment, counts, highest, row, first, after):  # type: ignore[no-untyped-def]
    """Count cells ``first`` to ``after`` of a row where the front of each slice first touches them.

    Material above the tool where the segment begins was cut there, whatever it was: a column
    that reaches up to there is taken to have reached on, and weighs as much as is seen of it.
    """
    heights, cell, margin, floor = grid.heights, grid.cell, grid.margin, grid.floor - segment.z
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - segment.x
    y0 = grid.y0 + row * cell - segment.y
    fx, fy, z, slope, length = segment.fx, segment.fy, segment.z, segment.slope, segment.length
    window, steps, mirror = segment.window, segment.steps, segment.mirror
    steps_per_length = steps / window
    bottom, across, rise = profiles.bottom[tool], profiles.across[tool], profiles.rise[tool]
    inverse, thick, many = profiles.inverse[tool], profiles.thick[tool], profiles.many[tool]
    kind, radius, flat = profiles.kind[tool], profiles.radius[tool], profiles.flat[tool]
    corner, cone = profiles.corner[tool], profiles.cone[tool]
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
            angle = angle_of(counts.cosines, counts.starts, cosine)
            counts.swept[step, k, angle] += (stop - bottom[k]) / thick[k] if k < many else 1.0
            # uphill, the lower part of the surface moves away from the material
            away = slope > 0.0 and rise[k] * sqrt(1.0 - cosine * cosine) <= slope
            if top <= lift + start + SKIN or away:
                continue
            met = min(top if known else inf, lift + stop) - max(floor, lift + bottom[k])
            if met > 0.0:
                counts.met[step, k, angle] += met
                counts.deepest[step] = max(counts.deepest[step], top - lift)


@compiled
def cut_row(grid, profiles, tool, segment, counts, bins, radius, row, first, after):  # type: ignore[no-untyped-def]
    """Cut cells ``first`` to ``after`` of a row; ``radius``: see :func:`reach`."""
    heights, cell, margin = grid.heights, grid.cell, grid.margin
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - segment.x
    y0 = grid.y0 + row * cell - segment.y
    fx, fy, slope, length = segment.fx, segment.fy, segment.slope, segment.length
    kind, flat, full = profiles.kind[tool], profiles.flat[tool], profiles.radius[tool]
    corner, cone = profiles.corner[tool], profiles.cone[tool]
    z = segment.z + min(segment.height, 0.0) if length == 0.0 else segment.z
    least = max(min(segment.z, segment.z + segment.height), grid.floor)
    # behind the tool all is cut already, unless it goes down
    ahead = segment.joined and length > 0.0 and segment.height >= 0.0
    pressed = segment.steps == 1 and segment.height < 0.0
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
            step = min(int(when * segment.steps / segment.window), segment.steps - 1)
            counts.volume[step] += cut * cell * cell
        if pressed and (length == 0.0 or along < 0.0):
            _press(grid, profiles, tool, segment, counts, bins, along, left, cut)


@compiled
def _press(grid, profiles, tool, segment, counts, bins, along, left, cut):  # type: ignore[no-untyped-def]
    """Count a column that the end presses on from above: all of a plunge, the rear of a ramp."""
    r, many, across = sqrt(along * along + left * left), profiles.many[tool], profiles.across[tool]
    if r == 0.0 or r >= profiles.radius[tool]:
        return
    slice_ = 0
    while slice_ < many - 1 and 0.5 * (across[slice_] + across[slice_ + 1]) < r:
        slice_ += 1
    angle = acos(min(max(segment.mirror * left / r, -1.0), 1.0))
    if along < 0.0:
        angle = 2.0 * pi - angle
    place = min(int(angle * bins / (2.0 * pi)), bins - 1)
    counts.swept[0, slice_, place] += 1.0
    if segment.length == 0.0 and r < profiles.flat[tool]:
        counts.pressed[0, place] += 1.0
        if cut > SKIN:
            counts.pressed[1, place] += 1.0
            counts.pressed[2, place] += grid.cell / r
    if cut > SKIN:
        # a flat end has no height: as thick as the map resolves
        counts.met[0, slice_, place] += profiles.thick[tool, slice_] if many > 0 else grid.cell


@compiled
def sweep(grid, profiles, tool, segment, counts, bins):  # type: ignore[no-untyped-def]
    """Cut what the segment sweeps and add what it meets to ``counts``."""
    highest = highest_slice(grid, profiles, tool, segment)
    radius, cell, margin = reach(grid, profiles, tool, segment, highest), grid.cell, grid.margin
    rows, columns = grid.heights.shape
    x, y, span = segment.x, segment.y, max(segment.length, segment.window)
    far = segment.fy * span
    low, high = y + min(0.0, far) - radius, y + max(0.0, far) + radius
    first, after = cell_range(grid.y0, cell, low, high, rows, margin)
    flat = profiles.kind[tool] == FLAT and segment.length > 0.0
    # what the tool's end has cut where it stood is behind it, unless it goes down
    skip = flat and segment.joined and segment.height >= 0.0
    for row in range(first, after):
        dy = grid.y0 + (row + 0.5) * cell - y
        begin, end = swept_row(dy, segment.fx, segment.fy, span, radius + 0.5 * cell)
        if begin > end:
            continue
        one, end_one = cell_range(grid.x0, cell, x + begin, x + end, columns, margin)
        if not flat:
            if segment.length > 0.0:
                meet_row(grid, profiles, tool, segment, counts, highest, row, one, end_one)
            cut_row(grid, profiles, tool, segment, counts, bins, radius, row, one, end_one)
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
        _sweep_flat(grid, radius, segment, counts, row, one, end_one)
        _sweep_flat(grid, radius, segment, counts, row, two, end_two)


@compiled
def _sweep_flat(grid, radius, segment, counts, row, first, after):  # type: ignore[no-untyped-def]
    """Cells ``first`` to ``after`` of a row under a flat end that moves in the plane or ramps."""
    heights, cell, bottom, margin = grid.heights, grid.cell, grid.floor, grid.margin
    rows, columns = heights.shape
    x0 = grid.x0 + grid.x_shifts[row + margin] * cell - segment.x
    y0 = grid.y0 + row * cell - segment.y
    fx, fy, length, slope = segment.fx, segment.fy, segment.length, segment.slope
    last_step, steps_per_length = segment.steps - 1, segment.steps / segment.window
    row_inside, to_cosine = 0 <= row < rows, segment.mirror / radius
    for column in range(first, after):
        dx, dy = x0 + column * cell, y0 + grid.y_shifts[column + margin] * cell
        along, left = dx * fx + dy * fy, dy * fx - dx * fy
        half = radius * radius - left * left
        if half <= 0.0:
            continue
        half = sqrt(half)
        touch, leave = along - half, along + half
        if touch > segment.window or leave < 0.0:
            continue
        inside = row_inside and 0 <= column < columns
        top = float(heights[row, column]) if inside else bottom
        step = min(int(max(touch, 0.0) * steps_per_length), last_step)
        z = max(segment.z + slope * min(max(touch, 0.0), length), bottom)
        met = max(top - z, 0.0)
        if touch >= 0.0:
            angle = angle_of(counts.cosines, counts.starts, left * to_cosine)
            counts.swept[step, 0, angle] += 1.0
            if met > SKIN:
                counts.met[step, 0, angle] += met
                counts.deepest[step] = max(counts.deepest[step], top - segment.z - slope * touch)
        if touch > length or top <= bottom:
            continue
        t = min(leave, length) if slope < 0.0 else max(touch, 0.0)
        new = float(np.float32(max(segment.z + slope * t, bottom)))
        if new < top:
            heights[row, column] = new
            # the rim takes what it meets at once, the end the rest as it goes down
            rim = min(met, top - new)
            counts.volume[step] += rim * cell * cell
            step = min(int((t + max(touch, 0.0)) * 0.5 * steps_per_length), last_step)
            counts.volume[step] += (top - new - rim) * cell * cell


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
