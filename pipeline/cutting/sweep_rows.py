"""Which cells of a row a moving disc may touch, compiled."""

from math import floor, inf, sqrt

from pipeline.kernels import compiled


@compiled
def angle_of(cosines, starts, cosine):  # type: ignore[no-untyped-def]
    """Which angle of the front half a cosine belongs to; both tables: :class:`sweep_room.Tally`."""
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
    """From where to where along x a disc reaches that moves ``length`` along (fx, fy) from 0 [m].

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
    begin, end = _between(-fy, dy * fx, -radius, radius)
    first, last = _between(fx, dy * fy, 0.0, length)
    begin, end = max(begin, first), min(end, last)
    if begin <= end:
        low, high = min(low, begin), max(high, end)
    return low, high


@compiled
def _between(factor, offset, low, high):  # type: ignore[no-untyped-def]
    """Where along x low <= factor x + offset <= high holds."""
    if abs(factor) < 1e-12:
        return (-inf, inf) if low <= offset <= high else (inf, -inf)
    a, b = (low - offset) / factor, (high - offset) / factor
    return min(a, b), max(a, b)
