"""The map of one tooth period of milling, by first-order semi-discretisation.

The modes obey q'' + 2 zeta w_n q' + w_n^2 q = (1/m) a_p A(t) (u(t) - u(t - T)), u being the tip's
displacement, T the tooth period (Insperger and Stepan 2004).  In each step A(t) is its exact mean
and the delayed displacement a straight line between the step's ends (Insperger, Stepan, Turi 2008),
so that each step is solved by a matrix exponential; the state after one period is Phi times that
before, and the cut is stable while all eigenvalues of Phi are within the unit circle.

As delay and period are the same, the delayed displacement is asked for only where a tooth cuts:
steps divide the cut, with a step's end where a tooth enters or leaves, and the free flight between
two cuts is solved in one piece.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.directional import RegenerativeCut, step_means
from pipeline.cutting.modes import Mode

Floats = NDArray[np.float64]
KRYLOV = (12, 16, 20, 24, 32, 48, 64, 96)
"""Dimensions of the Krylov space, one after the other; where the last fails, all states count."""
_RESIDUAL = 1e-7
"""Of the leading eigenvalue in the Krylov space."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Period:
    """Steps of one tooth period at a depth; what the kernels take."""

    here: Floats
    ago: Floats
    now: Floats
    free: Floats
    axis: NDArray[np.int64]
    room: Floats

    @property
    def states(self) -> int:
        return self.here.shape[1] + (len(self.here) + 1) * self.ago.shape[2]

    @property
    def parts(self) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.int64], Floats]:
        return self.here, self.ago, self.now, self.free, self.axis, self.room


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
    from pipeline.cutting.monodromy_kernel import pass_period

    period = _period(modes, cut, n, depth, steps)
    phi = np.empty((period.states, period.states))
    for state, out in zip(np.eye(period.states), phi, strict=True):
        pass_period(*period.parts, state, out)
    return phi.T


def spectral_radius(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, depth: float, steps: int
) -> float:
    """Greatest modulus of Phi's eigenvalues [1]; the cut is stable below 1.

    Parameters as in :func:`monodromy`.  The leading eigenvalue comes from Krylov's space, which
    costs a few dozen periods, not the cube of the number of states.
    """
    from pipeline.cutting.monodromy_kernel import extend_krylov

    period = _period(modes, cut, n, depth, steps)
    basis = np.empty((KRYLOV[-1] + 1, period.states))
    start = np.random.default_rng(0).standard_normal(period.states)
    basis[0] = start / np.linalg.norm(start)
    hessenberg = np.zeros((len(basis), len(basis) - 1))
    reached = 0
    for last in KRYLOV:
        reached = extend_krylov(*period.parts, reached, last, basis, hessenberg)
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
    from pipeline.cutting.monodromy_kernel import fill_steps

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
    return _Period(here=here, ago=ago, now=now, free=free[0], axis=axis, room=np.empty(size))


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
