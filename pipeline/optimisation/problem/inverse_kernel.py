"""Feeds for each tooth at which a load of a table first passes a limit, compiled.

Between its nodes, at u = 0, 1, 4, 9, ... with u = scale f_z^exponent, a table is straight, so that
it is inverted exactly; see :mod:`pipeline.cutting.force.profile_kernel`.
"""

from math import inf

from pipeline.kernels import compiled


@compiled
def first_crossings(limit, values, scale, exponent, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P, M), the greatest f_z [m] up to which loads stay within ``limit``.

    ``limit`` has shape (P, M), ``values`` (M, K + 1), ``scale`` and ``exponent`` (M,).  It is 0
    where any feed passes the limit and infinite where none does.
    """
    for p in range(limit.shape[0]):
        for m in range(limit.shape[1]):
            u = _first_crossing(limit[p, m], values[m])
            out[p, m] = (u / scale[m]) ** (1.0 / exponent[m]) if u < inf else inf


@compiled
def _first_crossing(limit, values):  # type: ignore[no-untyped-def]
    if not values[0] <= limit:
        return 0.0
    last = values.shape[0] - 2
    for k in range(last + 1):
        if values[k + 1] > limit:
            share = (limit - values[k]) / (values[k + 1] - values[k])
            return k * k + share * (2 * k + 1)
    rise = values[last + 1] - values[last]
    if not rise > 0.0:
        return inf
    return last * last + (limit - values[last]) / rise * (2 * last + 1)
