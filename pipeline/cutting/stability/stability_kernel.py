"""Stability lobes of the zero-order solution and margins, compiled.

A segment of the stability boundary lies between two neighbouring chatter frequencies: ``omega``
[rad/s] and ``share`` (phase of the regeneration over a turn, less whole waves, 0 to 1) at its two
ends, ``inverse`` = 1 / depth [1/m] there, all of shape (G, 2) and straight between.  Lobe k has
k whole waves within a tooth period.
"""

from math import ceil, inf, isnan, nan, pi

from pipeline.kernels import compiled

_TURN = 2.0 * pi


@compiled
def lowest_lobes(omega, share, inverse, period, out, chatter):  # type: ignore[no-untyped-def]
    """Fill the greatest 1 / depth of all lobes at each tooth period, and its frequency [rad/s].

    Parameters
    ----------
    omega, share, inverse : ndarray, shape (G, 2)
        Segments of the boundary.
    period : ndarray, shape (S,)
        Tooth period [s].
    out, chatter : ndarray, shape (S,)
        Filled; 0 and nan where there is no lobe.
    """
    for s in range(period.shape[0]):
        out[s] = 0.0
        chatter[s] = nan
        for g in range(omega.shape[0]):
            if inverse[g, 0] <= out[s] and inverse[g, 1] <= out[s]:
                continue
            first = omega[g, 0] * period[s] / _TURN - share[g, 0]
            last = omega[g, 1] * period[s] / _TURN - share[g, 1]
            k = max(ceil(min(first, last)), 0)
            while k <= max(first, last):
                along = (k - first) / (last - first) if last != first else 0.0
                value = inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0])
                if value > out[s]:
                    out[s] = value
                    chatter[s] = omega[g, 0] + along * (omega[g, 1] - omega[g, 0])
                k += 1


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
