"""One pass of fuzzy c-means over blocks of points, in compiled form.

Points lie in blocks of ``BLOCK``, one coordinate after another, so that the loops over the points
of a block become SIMD vectors; a block, its distances and the sums stay in the first cache.  Each
place of a block has its own sums, so that the result does not depend on the width of the vectors.
"""

from pipeline.kernels import compiled

BLOCK = 64
"""Points that lie beside each other [1]."""


@compiled
def fuzzy_pass(  # type: ignore[no-untyped-def]
    blocks, last, centres, exponent, fuzzifier, lanes, distance, nearest, total, sums
):
    """Add up u^m and u^m x of all points for given centres.

    ``blocks`` has shape (K, D, BLOCK), of which the last block holds ``last`` points, ``centres``
    (C, D), ``sums`` (C, D + 1, BLOCK) with the weights' own sum in the last row; ``distance`` (C,
    BLOCK), ``nearest`` and ``total`` (BLOCK,) are work arrays.  ``exponent`` is 1 / (m - 1) of
    squared distances; ``lanes`` is BLOCK: were it known to the compiler, that would unroll.
    """
    many, dimensions = centres.shape
    sums[:] = 0.0
    for k in range(blocks.shape[0]):
        squared_distances(blocks[k], centres, lanes, distance, nearest)
        memberships_of(distance, nearest, total, many, exponent, lanes)
        count = last if k == blocks.shape[0] - 1 else lanes
        for c in range(many):
            if fuzzifier == 2.0:
                for i in range(lanes):
                    u = distance[c, i] * total[i]
                    distance[c, i] = u * u
            else:
                for i in range(lanes):
                    distance[c, i] = (distance[c, i] * total[i]) ** fuzzifier
            for i in range(count, lanes):  # places of the last block that hold no point
                distance[c, i] = 0.0
            for i in range(lanes):
                sums[c, dimensions, i] += distance[c, i]
            for d in range(dimensions):
                for i in range(lanes):
                    sums[c, d, i] += distance[c, i] * blocks[k, d, i]


@compiled
def squared_distances(block, centres, lanes, distance, nearest):  # type: ignore[no-untyped-def]
    """Fill the squared distances of a block's points to the centres, and the least of each."""
    for c in range(centres.shape[0]):
        for i in range(lanes):
            distance[c, i] = 0.0
        for d in range(centres.shape[1]):
            at = centres[c, d]
            for i in range(lanes):
                gap = block[d, i] - at
                distance[c, i] += gap * gap
    for i in range(lanes):
        nearest[i] = distance[0, i]
    for c in range(1, centres.shape[0]):
        for i in range(lanes):
            nearest[i] = min(nearest[i], distance[c, i])


@compiled
def memberships_of(distance, nearest, total, many, exponent, lanes):  # type: ignore[no-untyped-def]
    """Turn distances into (d_nearest / d)^(2 / (m - 1)), and ``total`` into one over their sum.

    At a centre the ratio is one, elsewhere zero for a point that lies on a centre.
    """
    for i in range(lanes):
        total[i] = 0.0
    for c in range(many):
        if exponent == 1.0:
            for i in range(lanes):
                away = distance[c, i]
                ratio = nearest[i] / (away if away > 0.0 else 1.0)
                ratio = ratio if away > 0.0 else 1.0
                distance[c, i] = ratio
                total[i] += ratio
        else:
            for i in range(lanes):
                away = distance[c, i]
                ratio = 1.0
                if away > 0.0:
                    ratio = (nearest[i] / away) ** exponent
                distance[c, i] = ratio
                total[i] += ratio
    for i in range(lanes):
        total[i] = 1.0 / max(total[i], 1.0)  # the nearest centre's ratio is one


@compiled
def fuzzy_memberships(blocks, centres, exponent, lanes, nearest, total, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (K, C, BLOCK) with the memberships for given centres."""
    for k in range(blocks.shape[0]):
        squared_distances(blocks[k], centres, lanes, out[k], nearest)
        memberships_of(out[k], nearest, total, centres.shape[0], exponent, lanes)
        for c in range(centres.shape[0]):
            for i in range(lanes):
                out[k, c, i] *= total[i]
