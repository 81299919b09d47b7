"""Depth limit of milling by semi-discretisation (Insperger, Stepan 2004), refined till it holds.

Chatter begins where an eigenvalue of the map of one tooth period leaves the unit circle
(:mod:`pipeline.cutting.monodromy`).  Unlike the zero-order solution this sees flip lobes (period
doubling) at low immersion, and helix.

The error falls with the square of the step.  The number of steps doubles until what is left, a
third of what the last doubling changed, is within a tolerance; that third is then taken off as well
(Richardson's extrapolation).  A fixed number of steps overstates the depth at low speed, where many
waves lie within a period.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.directional import RegenerativeCut
from pipeline.cutting.lobes import speeds_of
from pipeline.cutting.modes import Mode
from pipeline.cutting.monodromy import spectral_radius

Floats = NDArray[np.float64]
STEPS_PER_WAVE = 16
"""Of the highest mode, where refinement begins."""
LEAST_STEPS = 24
MOST_STEPS = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthLimits:
    """Depth limit at S spindle speeds, as far as the steps were refined.

    Parameters
    ----------
    n : ndarray, shape (S,)
        Spindle speed [1/s].
    depth_limit : ndarray, shape (S,)
        Least depth at which chatter begins [m]; inf where none is up to the depth looked at.
    error : ndarray, shape (S,)
        Estimated error of the finest steps before extrapolation, over the depth limit [1].
    steps : ndarray of int, shape (S,)
        Of the cut in one tooth period.
    """

    n: Floats
    depth_limit: Floats
    error: Floats
    steps: NDArray[np.int64]


def depth_limits(
    modes: Sequence[Mode], cut: RegenerativeCut, n: ArrayLike, *, highest: float,
    tolerance: float = 0.005, depths: int = 64,
) -> DepthLimits:  # fmt: skip
    """Least depth at which chatter begins, at each spindle speed.

    Parameters
    ----------
    modes, cut
        As in :func:`pipeline.cutting.monodromy.monodromy`.
    n : array_like, shape (S,)
        Spindle speeds [1/s], above 0.
    highest : float
        Depth up to which is looked [m].
    tolerance : float
        The steps are doubled until the limit's estimated error is below this share of it [1].
    depths : int
        At which stability is tried first, from ``highest`` / 256 up, each the same factor above the
        one before; between two of them a narrow region of chatter is found when a local maximum of
        the spectral radius leads to it.

    Raises
    ------
    ValueError
        When a parameter is out of its range, or 4096 steps do not reach the tolerance at a speed:
        some 100 waves of the highest mode within a cut are too many, as at 1 tooth a second.
    """
    speeds = speeds_of(n)
    if not modes:
        raise ValueError("modes: there is none, and what does not give way does not chatter")
    if not 0.0 < highest < np.inf:
        raise ValueError(
            f"highest = {highest}: the depth up to which is looked must be above 0 m and finite"
        )
    if not tolerance > 0.0:
        raise ValueError(f"tolerance = {tolerance} must be above 0")
    if depths < 2:
        raise ValueError(f"depths = {depths} must be at least 2")
    grid = np.geomspace(highest / 256, highest, depths)
    rows = [_refined(modes, cut, float(speed), grid, tolerance) for speed in speeds]
    return DepthLimits(
        n=speeds,
        depth_limit=np.array([row[0] for row in rows]),
        error=np.array([row[1] for row in rows]),
        steps=np.array([row[2] for row in rows], dtype=np.int64),
    )


def _refined(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, grid: Floats, tolerance: float
) -> tuple[float, float, int]:
    """Depth limit, its estimated error over it, and the steps."""
    wave = max(mode.natural_frequency_Hz for mode in modes)
    span = min(cut.exit - cut.entry + cut.lag * grid[-1], cut.pitch) / (2 * pi * n)
    steps = max(LEAST_STEPS, ceil(STEPS_PER_WAVE * wave * span))
    if 2 * steps > MOST_STEPS:
        raise ValueError(
            f"semi-discretisation: at {60 * n:.6g} rpm {wave * span:.0f} waves of the highest mode "
            f"lie within a cut, too many for {MOST_STEPS} steps; ask for a higher speed, or for "
            "the zero-order solution"
        )
    coarse = _first_limit(modes, cut, n, grid, steps, tolerance)
    while 2 * steps <= MOST_STEPS:
        steps *= 2
        fine = _limit_near(modes, cut, n, coarse, steps, tolerance)
        if not fine < np.inf:
            fine = _first_limit(modes, cut, n, grid, steps, tolerance)
        if fine == coarse:  # both without limit
            return fine, 0.0, steps
        error = abs(fine - coarse) / (3 * fine) if max(fine, coarse) < np.inf else np.inf
        if error <= tolerance:
            return fine + (fine - coarse) / 3, error, steps
        coarse = fine
    raise ValueError(
        f"semi-discretisation: at {60 * n:.6g} rpm {steps} steps do not settle the depth limit, "
        f"now {coarse * 1e3:.4g} mm; ask for a higher speed, or a tolerance above {tolerance:g}"
    )


def _first_limit(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, grid: Floats, steps: int,
    tolerance: float,
) -> float:  # fmt: skip
    """Least depth of chatter on the grid, and where a hump between its depths crosses 1."""
    from scipy.optimize import minimize_scalar

    def below(depth: float) -> float:
        return -spectral_radius(modes, cut, n, depth, steps)

    depths, radii = [0.0], [0.0]
    for depth in grid:
        depths.append(float(depth))
        radii.append(-below(float(depth)))
        if radii[-1] > 1.0:
            return _crossing(modes, cut, n, depths[-2], depths[-1], steps, tolerance)
        if len(radii) > 2 and radii[-2] >= max(radii[-3], radii[-1]):
            hump = minimize_scalar(
                below, bounds=(depths[-3], depths[-1]), method="bounded",
                options={"xatol": tolerance * depths[-2], "maxiter": 16},
            )  # fmt: skip
            if hump.fun < -1.0:
                return _crossing(modes, cut, n, depths[-3], float(hump.x), steps, tolerance)
    return float("inf")


def _limit_near(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, before: float, steps: int,
    tolerance: float,
) -> float:  # fmt: skip
    """Depth limit close to that of fewer steps; inf when it is not there."""
    if not before < np.inf:
        return before
    for reach in (0.01, 0.03, 0.1):
        low, high = before * (1 - reach), before * (1 + reach)
        if (
            spectral_radius(modes, cut, n, low, steps) < 1.0
            and spectral_radius(modes, cut, n, high, steps) > 1.0
        ):
            return _crossing(modes, cut, n, low, high, steps, tolerance)
    return float("inf")


def _crossing(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, low: float, high: float, steps: int,
    tolerance: float,
) -> float:  # fmt: skip
    """Depth between ``low`` (stable, or 0) and ``high`` where the spectral radius is 1."""
    from scipy.optimize import brentq

    def excess(depth: float) -> float:
        return spectral_radius(modes, cut, n, depth, steps) - 1.0 if depth else -1.0

    root: float = brentq(excess, low, high, xtol=0.01 * tolerance * high, rtol=1e-9)
    return root
