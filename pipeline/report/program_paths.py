"""Paths of a program as SVG path data: whole numbers, nothing that a screen cannot show."""

import numpy as np


def stroke(a: np.ndarray, b: np.ndarray) -> str:
    """Path data of straight pieces from ``a`` to ``b``, both (S, 2) of int, in their order.

    Pieces that follow one another are one stroke, straight stretches one step; what covers an
    earlier piece exactly is drawn once, and pieces of no length not at all.
    """
    keep = _first_of_kind(a, b)
    a, b = a[keep], b[keep]
    if len(a) == 0:
        return ""
    follows = np.concatenate([[False], (a[1:] == b[:-1]).all(axis=1)])
    straight = follows & np.concatenate([[False], _same_way(b[:-1] - a[:-1], b[1:] - a[1:])])
    last = np.flatnonzero(~np.concatenate([straight[1:], [False]]))  # pieces where a step ends
    first = np.flatnonzero(~straight)
    a, b, follows = a[first], b[last], follows[first]
    steps = [f"{x} {y}".replace(" -", "-") for x, y in (b - a).tolist()]
    starts = np.flatnonzero(~follows).tolist()
    parts = [
        f"M{a[i, 0]} {a[i, 1]}l" + " ".join(steps[i:j]).replace(" -", "-")
        for i, j in zip(starts, [*starts[1:], len(steps)], strict=True)
    ]
    return "".join(parts)


def _first_of_kind(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Indices of the pieces that have a length and are the first between their two points."""
    long = np.flatnonzero((a != b).any(axis=1))
    swap = (a[long, 0] > b[long, 0]) | ((a[long, 0] == b[long, 0]) & (a[long, 1] > b[long, 1]))
    ends = np.where(swap[:, None], np.hstack([b, a])[long], np.hstack([a, b])[long])
    _, first = np.unique(ends, axis=0, return_index=True)
    return long[np.sort(first)]


def _same_way(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    return (cross == 0) & ((one * two).sum(axis=1) > 0)


def dots(points: np.ndarray) -> str:
    """Path data of dots at ``points`` (N, 2) of int, each once; drawn by a round line cap."""
    return "".join(f"M{x} {y}h0" for x, y in np.unique(points, axis=0).tolist())
