"""Chatter margins of the blocks of a program, compiled."""

from math import inf, isnan

from pipeline.kernels import compiled


@compiled
def mark_missing(below, above, table, kind, block, missing):  # type: ignore[no-untyped-def]
    """Mark what of ``table`` (K, C), nan where it is not known, the nodes of the blocks ask for.

    ``below``, ``above`` (P, B) are the nodes of the speed beside each block's; ``kind``, ``block``
    (N,) those of the stations.
    """
    for p in range(below.shape[0]):
        for i in range(block.shape[0]):
            for c in (below[p, block[i]], above[p, block[i]]):
                if isnan(table[kind[i], c]):
                    missing[kind[i], c] = True


@compiled
def fill_margins(below, above, table, kind, depth, block, most, out):  # type: ignore[no-untyped-def]
    """Lower ``out`` (P, B) to the least margin of each block's stations, ``most`` at most.

    The lesser limit of both nodes counts; parameters as of :func:`mark_missing`, ``depth`` [m].
    """
    for p in range(below.shape[0]):
        for i in range(block.shape[0]):
            b = block[i]
            limit = min(table[kind[i], below[p, b]], table[kind[i], above[p, b]])
            margin = limit / depth[i] - 1.0
            if margin < inf:
                margin = min(margin, most)
            if margin < out[p, b]:
                out[p, b] = margin
