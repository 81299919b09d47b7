"""The member of a front that gives most for what it takes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_SAME = 1e-12  # of scaled objectives


def knee(objectives: ArrayLike) -> int:
    """The member of a front where giving up a little of one objective costs most of another.

    Objectives are scaled to 0 and 1 over the front; the knee is the member that lies farthest from
    the plane through the least of each objective, on the side of the ideal (Das 1999; Branke, Deb,
    Dierolf and Osswald 2004).  Where fewer points than objectives make the plane, the side of the
    ideal is what of -(1, ..., 1) is at right angles to them.  A front that bulges away from the
    ideal has its knee at one of its ends; of equal ones it is the first.

    Parameters
    ----------
    objectives : array_like, shape (F, O)
        Of the front's members, at least one.

    Raises
    ------
    ValueError
        When the front is empty or an objective is not finite.

    Examples
    --------
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
