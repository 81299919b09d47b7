"""The steady part of a recorded cut: from the full engagement of the tool to its way out."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AIR = 0.12
"""Share of the cut's fluctuation below which a revolution is one in air."""
ALIKE = 0.1
"""Revolutions of the steady part have the RMS force of their middle one within this share."""
SMOOTH = 9
"""Revolutions over whose median a revolution is judged."""
FEWEST_IN_AIR = 3


@dataclass(frozen=True, kw_only=True)
class Steady:
    """Which samples are steady, and the zero of the channels.

    Parameters
    ----------
    first, last : int
        Samples from ``first`` up to and without ``last``.
    zero : ndarray, shape (T, 3)
        What the channels show without force [N].
    zero_known : bool
        Whether the recording shows air on which to take it.
    """

    first: int
    last: int
    zero: Floats
    zero_known: bool


def steady_part(force: Floats, revolution: float, way_in: float) -> Steady:
    """The steady part of a recording.

    Parameters
    ----------
    force : ndarray, shape (T, 3)
        [N].
    revolution : float
        Its length in samples.
    way_in : float
        Length of the way from the first contact to full engagement, in samples; as long is the
        way out.

    Raises
    ------
    ValueError
        When there is no cut in it.
    """
    many = int(len(force) / revolution)
    if many < 1:
        raise ValueError("it is shorter than one revolution of the spindle: record more")
    starts = (np.arange(many + 1) * revolution).astype(np.int64)
    fluctuation = _by_revolution(force, starts)
    strong = float(np.percentile(fluctuation, 90))
    if strong == 0.0:
        raise ValueError("its forces do not change: there is no cut in it")
    air = fluctuation < AIR * strong
    zero, known = _zero(force, starts, air)
    level = np.sqrt(np.add.reduceat((force - zero) ** 2, starts[:-1], axis=0).sum(axis=1))
    level /= np.sqrt(np.diff(np.append(starts[:-1], len(force))))
    cut = ~air
    inside = _inside(cut, way_in / revolution)
    plateau = _plateau(level, inside)
    return Steady(
        first=int(starts[plateau[0]]), last=int(starts[plateau[1]]), zero=zero, zero_known=known
    )


def _by_revolution(force: Floats, starts: NDArray[np.int64]) -> Floats:
    """Standard deviation within each revolution, all channels together; shape (R,)."""
    found = [np.sqrt(force[a:b].var(axis=0).sum()) for a, b in pairwise(starts)]
    return np.array(found)


def _zero(force: Floats, starts: NDArray[np.int64], air: Flags) -> tuple[Floats, bool]:
    """A straight line through the revolutions in air; 0 where there are none."""
    where = np.flatnonzero(air)
    if len(where) < FEWEST_IN_AIR:
        return np.zeros_like(force), False
    middle = (starts[where] + starts[where + 1]) / 2
    level = np.array([force[starts[k] : starts[k + 1]].mean(axis=0) for k in where])
    both = where[0] < len(air) / 2 < where[-1]
    if not both:
        return np.broadcast_to(np.median(level, axis=0), force.shape), True
    slope, base = np.polyfit(middle, level, 1)
    zero: Floats = np.arange(len(force))[:, None] * slope + base
    return zero, True


def _inside(cut: Flags, way: float) -> Flags:
    """Revolutions in the cut, those on the ways in and out of the material taken off."""
    where = np.flatnonzero(cut)
    inside = cut.copy()
    margin = int(np.ceil(way)) + 1
    if where[0] > 0:
        inside[: where[0] + margin] = False
    if where[-1] < len(cut) - 1:
        inside[where[-1] + 1 - margin :] = False
    if not inside.any():
        raise ValueError("the tool is nowhere fully in the material: record a longer cut")
    return inside


def _plateau(level: Floats, inside: Flags) -> tuple[int, int]:
    """The longest run of revolutions whose force is that of their middle."""
    from scipy.ndimage import median_filter

    smooth = median_filter(level, size=min(SMOOTH, len(level)), mode="nearest")
    middle = float(np.median(smooth[inside]))
    run = (0, 0)
    for _ in range(3):
        alike = inside & (np.abs(smooth / middle - 1) < ALIKE)
        edges = np.diff(alike.astype(np.int8), prepend=0, append=0)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        if not len(begins):
            raise ValueError("its force never stays the same over revolutions: record a longer cut")
        longest = int(np.argmax(ends - begins))
        run = (int(begins[longest]), int(ends[longest]))
        middle = float(np.median(smooth[run[0] : run[1]]))
    return run
