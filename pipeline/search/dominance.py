"""Pareto dominance, crowding distance and the knee of a front of several objectives.

An answer dominates another that is nowhere better than it and somewhere worse.  Limits come first:
what keeps them dominates what does not, and of two that do not, the one that passes them by less
(constrained domination, Deb, Pratap, Agarwal and Meyarivan 2002).  The less of an objective, the
better.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.schema.arrays import Bools, Floats

Ranks = NDArray[np.intp]


def dominates(one: Floats, other: Floats, mine: Floats, theirs: Floats) -> Bools:
    """Whether individuals dominate others; the leading axes broadcast.

    Objectives ``one`` and ``other`` (..., O), none NaN; ``mine`` and ``theirs`` (...) by how much
    each passes its limits, 0 inside all of them.
    """
    shape = np.broadcast_shapes(one.shape, other.shape)[:-1]
    nowhere_worse, somewhere_better = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)
    # one objective at a time: the widest array has no axis of objectives
    for k in range(one.shape[-1]):
        nowhere_worse &= one[..., k] <= other[..., k]
        somewhere_better |= one[..., k] < other[..., k]
    inside = (mine <= 0) & (theirs <= 0)
    dominating: Bools = np.where(inside, nowhere_worse & somewhere_better, mine < theirs)
    return dominating


def ranks(objectives: Floats, violation: Floats) -> Ranks:
    """Front of each individual, 0 for those that none dominates; shape (P,).

    Front k + 1 is what none dominates once fronts 0 to k are taken away.  Those of one front keep
    all limits, or pass them by the same.

    Objectives (P, O), none NaN; ``violation`` (P,) is 0 inside all limits.
    """
    above = dominates(objectives[:, None], objectives, violation[:, None], violation)
    dominated_by = above.sum(axis=0)
    fronts = np.zeros(len(objectives), dtype=np.intp)
    rank = 0
    while (front := (dominated_by == 0).nonzero()[0]).size:
        fronts[front] = rank
        dominated_by -= above[front].sum(axis=0)
        dominated_by[front] = -1
        rank += 1
    return fronts


def crowding(objectives: Floats) -> Floats:
    """Crowding distance of the members of one front, shape (F,); infinite at the extremes.

    Sum over the objectives (F, O) of the distance between both neighbours over the front's range.
    """
    many = len(objectives)
    distance = np.zeros(many)
    for column in objectives.T:
        order = column.argsort(kind="stable")
        ordered = column[order]
        distance[order[[0, -1]]] = np.inf
        # among those that failed an objective has no range
        span = ordered[-1] - ordered[0] if np.isfinite(ordered[-1]) else 0.0
        if span > 0:
            distance[order[1:-1]] += (ordered[2:] - ordered[:-2]) / span
    return distance


def survivors(objectives: Floats, violation: Floats, many: int) -> tuple[Ranks, Floats]:
    """The ``many`` best, shape (many,), by front, then crowding distance, and that distance."""
    front = ranks(objectives, violation)
    distance = np.empty(len(front))
    for rank in range(int(front.max(initial=-1)) + 1):
        members = (front == rank).nonzero()[0]
        distance[members] = crowding(objectives[members])
    order = np.lexsort((-distance, front))[:many]
    return order, distance[order]


def crowded_tournament(
    objectives: Floats, violation: Floats, distance: Floats, draws: int, rng: np.random.Generator
) -> Ranks:
    """Winners of ``draws`` pairs: who dominates, else who has the greater distance; shape (draws,).

    Everyone meets another as often as others do, but for one.  The front itself is not compared, as
    in Deb's own program: what stands alone on a worse front, and is not dominated by whom it meets,
    keeps its chance, and a front that begins in a corner still spreads.

    Objectives and violation as in :func:`ranks`; ``distance`` (P,) is the crowding distance of
    each.
    """
    rounds = -(-2 * draws // len(distance))
    drawn = np.concatenate([rng.permutation(len(distance)) for _ in range(rounds)])[: 2 * draws]
    a, b = drawn.reshape(draws, 2).T
    better = dominates(objectives[a], objectives[b], violation[a], violation[b])
    worse = dominates(objectives[b], objectives[a], violation[b], violation[a])
    freer = np.where(distance[a] == distance[b], rng.random(draws) < 0.5, distance[a] > distance[b])
    return np.where(better | (~worse & freer), a, b)


_SAME = 1e-12  # of scaled objectives


def knee(objectives: ArrayLike) -> int:
    """Knee of a front, where a small gain in one objective costs most of another.

    Objectives (F, O) are scaled to 0 and 1 over the front; the knee lies farthest from the plane
    through the least of each objective, on the side of the ideal (Das 1999; Branke, Deb, Dierolf
    and Osswald 2004).  Where fewer points than objectives make the plane, the side of the ideal is
    the part of -(1, ..., 1) at right angles to them.  Raises ValueError when the front is empty or
    an objective is not finite.

    >>> knee([[0.0, 4.0], [1.0, 1.0], [4.0, 0.0]])
    1
    """
    front = np.array(objectives, dtype=np.float64)
    if front.ndim != 2 or front.size == 0 or not np.isfinite(front).all():
        raise ValueError(
            f"front of shape {front.shape} has no knee: give at least one member, "
            "all its objectives finite"
        )
    least, span = front.min(axis=0), np.ptp(front, axis=0)
    scaled = ((front - least) / np.where(span > 0, span, 1.0))[:, span > 0]
    if not scaled.size:
        return 0
    total = scaled.sum(axis=1)
    ends = scaled[[np.lexsort((total, column))[0] for column in scaled.T]]
    toward = _toward_ideal(ends[1:] - ends[0])
    depth = (scaled - ends[0]) @ toward
    # rounding may not choose between members that are as far
    return int((depth >= depth.max() - _SAME).argmax())


def _toward_ideal(edges: Floats) -> Floats:
    """Unit vector to the ideal's side, shape (O,), at right angles to edges of shape (O - 1, O)."""
    down = -np.ones(edges.shape[1])
    if len(edges):
        _, strengths, directions = np.linalg.svd(edges, full_matrices=False)
        along = directions[strengths > _SAME]
        across = down - along.T @ (along @ down)
        if np.linalg.norm(across) > 1e-6:
            down = across
    unit: Floats = down / np.linalg.norm(down)
    return unit
