"""Compiled loops of a chance constraint: feeds that keep a load limit, draws that pass it."""

from pipeline.kernels import compiled
from pipeline.optimisation.problem.kernels import looked_up

HALVINGS = 40
LEAST = 1e-9
"""Least feed as a share of the greatest one, below which it counts as none [1]."""


@compiled
def feeds_within(  # type: ignore[no-untyped-def]
    limit, most, curve, scale, exponent, weight, group, nodes, changes, out
):
    """Fill ``out`` (Q,): feed up to which each load and its change stay within ``limit``.

    ``most`` (Q,) bounds it, ``changes`` (C, K) are those of the classes at ``nodes``.
    """
    for q in range(group.shape[0]):
        c, low, high = group[q], 0.0, most[q]
        for k in range(nodes.shape[1]):
            feed = min(nodes[c, k], most[q])
            high = feed
            load = looked_up(feed, curve[q], scale[q], exponent[q])
            if load + weight[q] * _between(feed, nodes[c], changes[c]) > limit:
                break
            low = feed
        for _ in range(HALVINGS if high > low else 0):
            middle = 0.5 * (low + high)
            load = looked_up(middle, curve[q], scale[q], exponent[q])
            if load + weight[q] * _between(middle, nodes[c], changes[c]) > limit:
                high = middle
            else:
                low = middle
        out[q] = low if low > LEAST * most[q] else 0.0


@compiled
def peak_loads(  # type: ignore[no-untyped-def]
    f_z, curve, scale, exponent, weight, group, nodes, expected, values, first, out
):
    """Fill ``out`` of shape (D,), the part's greatest load in each draw [N].

    ``expected`` of shape (C, K) and ``values`` of (C, K, first + D or more) are the loads of the
    classes at ``nodes``; ``first`` is the first draw that counts.
    """
    for q in range(group.shape[0]):
        feed, c = f_z[q], group[q]
        if feed <= 0.0:
            continue
        k = _node(feed, nodes[c])
        share = _share(feed, nodes[c], k)
        here, after = values[c, k], values[c, k + 1]
        rest = looked_up(feed, curve[q], scale[q], exponent[q])
        rest -= weight[q] * _between(feed, nodes[c], expected[c])
        for d in range(out.shape[0]):
            drawn = here[first + d] + share * (after[first + d] - here[first + d])
            out[d] = max(out[d], rest + weight[q] * drawn)


@compiled
def _between(feed, nodes, values):  # type: ignore[no-untyped-def]
    k = _node(feed, nodes)
    return values[k] + _share(feed, nodes, k) * (values[k + 1] - values[k])


@compiled
def _node(feed, nodes):  # type: ignore[no-untyped-def]
    k = 0
    while k < nodes.shape[0] - 2 and nodes[k + 1] < feed:
        k += 1
    return k


@compiled
def _share(feed, nodes, k):  # type: ignore[no-untyped-def]
    """Interpolation share between two nodes; what is outside of them takes the nearest."""
    gap = nodes[k + 1] - nodes[k]
    return min(max((feed - nodes[k]) / gap, 0.0), 1.0) if gap > 0.0 else 0.0
