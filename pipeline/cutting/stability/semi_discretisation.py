"""Depth limit of milling by first-order semi-discretisation (Insperger, Stepan 2004).

The modes obey q'' + 2 zeta w_n q' + w_n^2 q = (1/m) a_p A(t) (u(t) - u(t - T)), u being the tip's
displacement, T the tooth period.  In each step A(t) is its exact mean and the delayed displacement
a straight line between the step's ends (Insperger, Stepan, Turi 2008), so that each step is solved
by a matrix exponential; the state after one period is Phi times that before.  Chatter begins where
an eigenvalue of Phi leaves the unit circle.  Unlike the zero-order solution this sees flip lobes
(period doubling) at low immersion, and helix.

As delay and period are the same, the delayed displacement is needed only where a tooth cuts: steps
divide the cut, with a step's end where a tooth enters or leaves, and the free flight between two
cuts is solved in one piece.

The error falls with the square of the step.  The number of steps doubles until what is left, a
third of what the last doubling changed, is within a tolerance; that third is then taken off as well
(Richardson's extrapolation).  A fixed number of steps overstates the depth at low speed, where many
waves lie within a period.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.stability.directional import RegenerativeCut, step_means
from pipeline.cutting.stability.lobes import checked_speeds
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.schema.arrays import Floats, Ints

KRYLOV = (12, 16, 20, 24, 32, 48, 64, 96)
"""Dimensions of the Krylov space, one after the other; where the last fails, all states count."""
_RESIDUAL = 1e-7
"""Of the leading eigenvalue in the Krylov space."""


class _Period(NamedTuple):
    """Steps of one tooth period at a depth, as the kernels take them."""

    here: Floats
    ago: Floats
    now: Floats
    free: Floats
    axis: Ints
    work: Floats

    @property
    def states(self) -> int:
        return int(self.here.shape[1] + (len(self.here) + 1) * self.ago.shape[2])


def monodromy(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, depth: float, steps: int
) -> Floats:
    """Phi, which takes the state through one tooth period; shape (K, K).

    Parameters
    ----------
    modes : sequence of Mode
        Of the tip, at least one.
    cut : RegenerativeCut
        Without depth and speed.
    n : float
        Spindle speed, above 0 [1/s].
    depth : float
        a_p, 0 or more [m].
    steps : int
        Of the cut, 1 or more.

    Returns
    -------
    ndarray, shape (2 M + (R + 1) D, 2 M + (R + 1) D)
        M modes in D directions; R steps, ``steps`` or a few more.

    Raises
    ------
    ValueError
        When there is no mode, or a number is out of its range.
    """
    from pipeline.cutting.stability.stability_kernel import pass_period

    period = _period(modes, cut, n, depth, steps)
    phi = np.empty((period.states, period.states))
    for state, out in zip(np.eye(period.states), phi, strict=True):
        pass_period(*period, state, out)
    return phi.T


def spectral_radius(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, depth: float, steps: int
) -> float:
    """Greatest modulus of Phi's eigenvalues [1]; the cut is stable below 1.

    Parameters as in :func:`monodromy`.  The leading eigenvalue comes from Krylov's space, which
    costs a few dozen periods, not the cube of the number of states.
    """
    from pipeline.cutting.stability.stability_kernel import extend_krylov

    period = _period(modes, cut, n, depth, steps)
    basis = np.empty((KRYLOV[-1] + 1, period.states))
    start = np.random.default_rng(0).standard_normal(period.states)
    basis[0] = start / np.linalg.norm(start)
    hessenberg = np.zeros((len(basis), len(basis) - 1))
    reached = 0
    for last in KRYLOV:
        reached = extend_krylov(*period, reached, last, basis, hessenberg)
        values, vectors = np.linalg.eig(hessenberg[:reached, :reached])
        leading = int(np.argmax(np.abs(values)))
        left = hessenberg[reached, reached - 1] * abs(vectors[-1, leading])
        if left <= _RESIDUAL * abs(values[leading]) or reached < last:
            return float(abs(values[leading]))
    phi = monodromy(modes, cut, n, depth, steps)
    return float(np.abs(np.linalg.eigvals(phi)).max())


def _period(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, depth: float, steps: int
) -> _Period:
    from pipeline.cutting.stability.stability_kernel import fill_steps

    _check(modes, n, depth, steps)
    used = sorted({mode.axis for mode in modes})
    axis = np.array([used.index(mode.axis) for mode in modes])
    omega = np.array([mode.omega for mode in modes])
    zeta = np.array([mode.damping for mode in modes])
    mass = np.array([mode.mass for mode in modes])
    edges = _edges(cut, depth, steps)
    matrix = step_means(cut, edges, depth)[:, used][:, :, used]
    time = np.diff(edges) / (2 * pi * n)
    size, many, rows = 2 * len(modes), len(used), len(time)
    here = np.empty((rows, size, size))
    ago, now = np.empty((rows, size, many)), np.empty((rows, size, many))
    work = np.empty((4, size, size))
    # the free flight is a step without force
    rest = np.array([max((cut.pitch - edges[-1]) / (2 * pi * n), 0.0)])
    free, none = np.empty((1, size, size)), np.empty((1, size, many))
    still = np.zeros((1, many, many))
    fill_steps(omega, zeta, mass, axis, still, rest, 0.0, free, none, none.copy(), work)
    fill_steps(omega, zeta, mass, axis, np.ascontiguousarray(matrix), time, depth,
               here, ago, now, work)  # fmt: skip
    if not all(np.isfinite(part).all() for part in (here, ago, now, free)):
        raise ValueError(
            f"n = {n:g} 1/s, depth = {depth:g} m: a tooth period moves the tip beyond all numbers; "
            "ask for a higher speed or a lesser depth"
        )
    return _Period(here=here, ago=ago, now=now, free=free[0], axis=axis, work=np.empty(size))


def _check(modes: Sequence[Mode], n: float, depth: float, steps: int) -> None:
    if not modes:
        raise ValueError("modes: there is none, and what does not give way does not chatter")
    if not 0.0 < n < np.inf:
        raise ValueError(f"n = {n}: the spindle speed must be above 0 1/s and finite")
    if not 0.0 <= depth < np.inf:
        raise ValueError(f"depth = {depth} must be 0 m or more and finite")
    if steps < 1:
        raise ValueError(f"steps = {steps} must be at least 1")


def _edges(cut: RegenerativeCut, depth: float, steps: int) -> Floats:
    """Ends of the steps [rad] since a tooth's tip entered; an end where another one leaves."""
    arc = cut.exit - cut.entry
    width = arc + cut.lag * depth
    window = min(width, cut.pitch)
    leaves = arc % cut.pitch if width > cut.pitch else 0.0
    ends = [0.0, leaves, window] if 1e-9 < leaves < window - 1e-9 else [0.0, window]
    pieces = [
        np.linspace(a, b, max(2, ceil(steps * (b - a) / window)) + 1)[:-1]
        for a, b in pairwise(ends)
    ]
    return np.concatenate([*pieces, [window]])


STEPS_PER_WAVE = 16
"""Of the highest mode, where refinement begins."""
LEAST_STEPS = 24
MOST_STEPS = 4096

Radius = Callable[[float], float]
"""Spectral radius over the depth [m], at one speed and number of steps."""


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
    steps: Ints


def depth_limits(
    modes: Sequence[Mode], cut: RegenerativeCut, n: ArrayLike, *, highest: float,
    tolerance: float = 0.005, depths: int = 64,
) -> DepthLimits:  # fmt: skip
    """Least depth at which chatter begins, at each spindle speed.

    Parameters
    ----------
    modes, cut
        As in :func:`pipeline.cutting.stability.semi_discretisation.monodromy`.
    n : array_like, shape (S,)
        Spindle speeds [1/s], above 0.
    highest : float
        Depth up to which is looked [m].
    tolerance : float
        The steps are doubled until the limit's estimated error is below this share of it [1].
    depths : int
        At which stability is tried first, from ``highest`` / 256 up, each the same factor above the
        one before; between two of them a narrow region of chatter is seen when a local maximum of
        the spectral radius leads to it.

    Raises
    ------
    ValueError
        When a parameter is out of its range, or 4096 steps do not reach the tolerance at a speed:
        some 100 waves of the highest mode within a cut are too many, as at 1 tooth a second.
    """
    speeds = checked_speeds(n)
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

    def radius(depth: float) -> float:
        return spectral_radius(modes, cut, n, depth, steps)

    coarse = _first_limit(radius, grid, tolerance)
    while 2 * steps <= MOST_STEPS:
        steps *= 2
        fine = _limit_near(radius, coarse, tolerance)
        if not fine < np.inf:
            fine = _first_limit(radius, grid, tolerance)
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


def _first_limit(radius: Radius, grid: Floats, tolerance: float) -> float:
    """Least depth of chatter on the grid, and where a hump between its depths crosses 1."""
    from scipy.optimize import minimize_scalar

    depths, radii = [0.0], [0.0]
    for depth in grid:
        depths.append(float(depth))
        radii.append(radius(float(depth)))
        if radii[-1] > 1.0:
            return _crossing(radius, depths[-2], depths[-1], tolerance)
        if len(radii) > 2 and radii[-2] >= max(radii[-3], radii[-1]):
            hump = minimize_scalar(
                lambda depth: -radius(depth), bounds=(depths[-3], depths[-1]), method="bounded",
                options={"xatol": tolerance * depths[-2], "maxiter": 16},
            )  # fmt: skip
            if hump.fun < -1.0:
                return _crossing(radius, depths[-3], float(hump.x), tolerance)
    return float("inf")


def _limit_near(radius: Radius, before: float, tolerance: float) -> float:
    """Depth limit close to that of fewer steps; inf when it is not there."""
    if not before < np.inf:
        return before
    for reach in (0.01, 0.03, 0.1):
        low, high = before * (1 - reach), before * (1 + reach)
        if radius(low) < 1.0 and radius(high) > 1.0:
            return _crossing(radius, low, high, tolerance)
    return float("inf")


def _crossing(radius: Radius, low: float, high: float, tolerance: float) -> float:
    """Depth between ``low`` (stable, or 0) and ``high`` where the spectral radius is 1."""
    from scipy.optimize import brentq

    def excess(depth: float) -> float:
        return radius(depth) - 1.0 if depth else -1.0

    root: float = brentq(excess, low, high, xtol=0.01 * tolerance * high, rtol=1e-9)
    return root
