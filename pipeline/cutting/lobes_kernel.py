"""Lobes at given speeds, in cells of speed, and margins of a population, compiled.

A segment of the stability boundary lies between two neighbouring chatter frequencies: ``omega``
[rad/s] and ``share`` (phase of the regeneration over a turn, less whole waves, 0 to 1) at its two
ends, ``inverse`` = 1 / depth [1/m] there, all of shape (G, 2) and straight between.  Lobe k has
k whole waves within a tooth period.
"""

from math import ceil, floor, nan, pi

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
def lobes_in_cells(omega, share, inverse, flutes, lowest, width, out):  # type: ignore[no-untyped-def]
    """Raise ``out``, shape (C,), to the greatest 1 / depth of all lobes within each cell of speed.

    Cell c reaches from ``lowest`` + c ``width`` to the next one [1/s].
    """
    cells = out.shape[0]
    highest = lowest + cells * width
    for g in range(omega.shape[0]):
        if inverse[g, 0] <= 0.0 and inverse[g, 1] <= 0.0:
            continue
        k = 0
        while True:
            # periods at the ends, and between them as good as straight
            first = _TURN * (k + share[g, 0]) / omega[g, 0]
            last = _TURN * (k + share[g, 1]) / omega[g, 1]
            k += 1
            long, short = max(first, last) * flutes, min(first, last) * flutes
            if short * lowest > 1.0:
                break
            if long * highest < 1.0:
                continue
            begin = 0 if long * lowest >= 1.0 else int((1.0 / long - lowest) / width)
            end = cells - 1 if short * highest <= 1.0 else int((1.0 / short - lowest) / width)
            for c in range(max(begin, 0), min(end, cells - 1) + 1):
                slow = min(1.0 / (lowest + c * width), long)
                fast = max(1.0 / (lowest + (c + 1) * width), short)
                for edge in range(2):
                    period = (slow if edge == 0 else fast) / flutes
                    along = (period - first) / (last - first) if last != first else 0.0
                    along = min(max(along, 0.0), 1.0)
                    value = inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0])
                    out[c] = max(out[c], value)


@compiled
def fill_margins(speed, lowest, width, table, kind, depth, block, out):  # type: ignore[no-untyped-def]
    """Lower ``out`` (P, B) to the least margin of each block's stations; where a speed is bad.

    ``speed`` (P, B) [1/s]; ``table`` (K, C) depth limits [m] in cells of speed; ``kind``, ``depth``
    [m], ``block`` (N,) of the stations.  A speed outside of the cells ends it: p B + b; else -1.
    """
    cells = table.shape[1]
    for p in range(speed.shape[0]):
        for i in range(block.shape[0]):
            b = block[i]
            place = (speed[p, b] - lowest) / width
            if not -1e-9 <= place <= cells + 1e-9:
                return p * speed.shape[1] + b
            c = min(max(floor(place), 0), cells - 1)
            margin = table[kind[i], c] / depth[i] - 1.0
            if margin < out[p, b]:
                out[p, b] = margin
    return -1
