"""Which of several answers are the better ones when there is more than one objective.

An answer dominates another that is nowhere better than it and somewhere worse.  Limits come first:
what keeps them dominates what does not, and of two that do not, the one that passes them by less
(constrained domination, Deb, Pratap, Agarwal and Meyarivan 2002).  The less of an objective, the
better.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ranks = NDArray[np.intp]


def dominates(one: Floats, other: Floats, mine: Floats, theirs: Floats) -> Flags:
    """Whether individuals dominate others; the leading axes broadcast.

    Parameters
    ----------
    one, other : ndarray, shape (..., O)
        Objectives of both, none NaN.
    mine, theirs : ndarray, shape (...)
        By how much each passes its limits; 0 inside all of them.
    """
    shape = np.broadcast_shapes(one.shape, other.shape)[:-1]
    nowhere_worse, somewhere_better = np.ones(shape, dtype=bool), np.zeros(shape, dtype=bool)
    # one objective at a time: the widest array has no axis of objectives
    for k in range(one.shape[-1]):
        nowhere_worse &= one[..., k] <= other[..., k]
        somewhere_better |= one[..., k] < other[..., k]
    inside = (mine <= 0) & (theirs <= 0)
    found: Flags = np.where(inside, nowhere_worse & somewhere_better, mine < theirs)
    return found


def ranks(objectives: Floats, violation: Floats) -> Ranks:
    """Front of each individual, 0 for those that none dominates; shape (P,).

    Front k + 1 is what none dominates once fronts 0 to k are taken away.  Those of one front keep
    all limits, or pass them by the same.

    Parameters
    ----------
    objectives, violation : ndarray, shapes (P, O) and (P,)
        Of each individual, no objective NaN; violation is 0 inside all limits.
    """
    above = dominates(objectives[:, None], objectives, violation[:, None], violation)
    dominated_by = above.sum(axis=0)
    found = np.zeros(len(objectives), dtype=np.intp)
    rank = 0
    while (front := (dominated_by == 0).nonzero()[0]).size:
        found[front] = rank
        dominated_by -= above[front].sum(axis=0)
        dominated_by[front] = -1
        rank += 1
    return found


def crowding(objectives: Floats) -> Floats:
    """Crowding distance of the members of one front, shape (F,); infinite at the extremes.

    Sum over the objectives of the distance between both neighbours as a share of the front's range.

    Parameters
    ----------
    objectives : ndarray, shape (F, O)
        Of the front's members, none NaN.
    """
    many = len(objectives)
    found = np.zeros(many)
    for column in objectives.T:
        order = column.argsort(kind="stable")
        ordered = column[order]
        found[order[[0, -1]]] = np.inf
        # among those that failed an objective has no range
        span = ordered[-1] - ordered[0] if np.isfinite(ordered[-1]) else 0.0
        if span > 0:
            found[order[1:-1]] += (ordered[2:] - ordered[:-2]) / span
    return found


def survivors(objectives: Floats, violation: Floats, many: int) -> tuple[Ranks, Floats]:
    """The ``many`` best from the best on, shape (many,), and how free each stands among all.

    The lower front comes first; within one, who stands freer (:func:`crowding`).

    Parameters
    ----------
    objectives, violation : ndarray, shapes (P, O) and (P,)
        As in :func:`ranks`.
    many : int
        Up to P.
    """
    front = ranks(objectives, violation)
    room = np.empty(len(front))
    for rank in range(int(front.max(initial=-1)) + 1):
        members = (front == rank).nonzero()[0]
        room[members] = crowding(objectives[members])
    order = np.lexsort((-room, front))[:many]
    return order, room[order]


def crowded_tournament(
    objectives: Floats, violation: Floats, room: Floats, draws: int, rng: np.random.Generator
) -> Ranks:
    """Winners of ``draws`` pairs: who dominates, else who stands freer; shape (draws,).

    Everyone meets another as often as others do, but for one.  That the front itself is not asked
    for is how Deb's own program has it: what stands alone on a worse front, and is not dominated by
    whom it meets, keeps its chance, and a front that begins in a corner still spreads.

    Parameters
    ----------
    objectives, violation : ndarray, shapes (P, O) and (P,)
        As in :func:`ranks`.
    room : ndarray, shape (P,)
        How free each stands.
    draws : int
        Parents.
    rng : numpy.random.Generator
        Source of chance.
    """
    rounds = -(-2 * draws // len(room))
    drawn = np.concatenate([rng.permutation(len(room)) for _ in range(rounds)])[: 2 * draws]
    a, b = drawn.reshape(draws, 2).T
    better = dominates(objectives[a], objectives[b], violation[a], violation[b])
    worse = dominates(objectives[b], objectives[a], violation[b], violation[a])
    freer = np.where(room[a] == room[b], rng.random(draws) < 0.5, room[a] > room[b])
    return np.where(better | (~worse & freer), a, b)
