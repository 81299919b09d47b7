"""What was swept of late, for pieces so short that few columns lie before them, compiled.

The counts of earlier pieces fade over the way of two cells, as long as the path goes on smoothly.
"""

from math import exp, sqrt

from pipeline.kernels import compiled

CELLS = 2.0
"""Way in cells over which earlier counts fade; a longer piece needs none."""
_ENOUGH = 3.0
"""Columns that tell that a piece is in air, whatever was before it."""
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
def add_recent(tally, room, slices, length, cell):  # type: ignore[no-untyped-def]
    """Add to the one step of a short piece what was swept before it, unless it is in air."""
    swept, met = 0.0, 0.0
    for k in range(slices):
        for a in range(tally.swept.shape[2]):
            swept += tally.swept[0, k, a]
            met += tally.met[0, k, a]
    if met == 0.0 and swept >= _ENOUGH:
        return
    left = exp(-length / (CELLS * cell))
    for k in range(slices):
        for a in range(tally.swept.shape[2]):
            tally.swept[0, k, a] += left * room.recent_swept[k, a]
            tally.met[0, k, a] += left * room.recent_met[k, a]


@compiled
def keep_recent(tally, room, slices, step, share):  # type: ignore[no-untyped-def]
    """Keep a share of the counts of a step for the pieces that follow."""
    for k in range(slices):
        for a in range(tally.swept.shape[2]):
            room.recent_swept[k, a] = share * tally.swept[step, k, a]
            room.recent_met[k, a] = share * tally.met[step, k, a]
