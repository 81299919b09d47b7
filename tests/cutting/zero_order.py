"""Stability lobes, zero-order solution (Altintas and Budak 1995; Altintas 2012, section 3.8.1).

With the directional matrix A at its mean over a turn, chatter at w has
F = a_p (1 - e^(-i w T)) A Phi(i w) F; for each eigenvalue lambda of A Phi the depth is
a_p = 1 / (2 Re lambda), where Re lambda > 0, and the tooth period T follows from
w T = 2 psi + 2 pi k, psi = atan2(Re lambda, -Im lambda), for each whole number of waves k >= 0.
The depth limit at a speed is the least of all lobes, eigenvalues and modes.

Frequencies are dense where lambda bends: an interval is halved until lambda in its middle is what a
straight line says, so that depth and phase are within a tolerance, lobe minima included.  Lobes
beyond the range of frequencies (four times the highest mode, or the range that was measured) lie
far above the minimum and are left out.  The mean of A is good where teeth are in the cut most of
the time; at low immersion flip lobes appear that only semi-discretisation shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, nan, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.stability.directional import RegenerativeCut, mean_matrix
from pipeline.cutting.stability.semi_discretisation import eigenvalues
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, Mode, modal_receptance
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats

Complex = NDArray[np.complex128]
Dynamics = Sequence[Mode] | FrequencyResponse
"""Dynamics of one tip: modes, or a measured response."""
_TURN = 2.0 * pi
TOLERANCE = 2e-4
"""Of the depth (over it) and the phase (over a radian) where none is said."""
_SHALLOW = 0.05
"""Share of |lambda| below which its real part need not be that exact: far above a minimum."""
_NOTHING = 1e-4
"""Share of the greatest |lambda| below which nothing is refined."""
_HALVINGS = 24
_AROUND = np.array([-100.0, -30.0, -10.0, -3.0, -1.0, 0.0, 1.0, 3.0, 10.0, 30.0, 100.0])
"""Half widths of a mode's peak where its first frequencies lie."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lobes:
    """Depth limit at S spindle speeds.

    Parameters
    ----------
    n : ndarray, shape (S,)
        Spindle speed [1/s].
    depth_limit : ndarray, shape (S,)
        Where chatter begins [m]; inf where no lobe is.
    chatter_frequency : ndarray, shape (S,)
        [Hz]; nan where no lobe is.
    """

    n: Floats
    depth_limit: Floats
    chatter_frequency: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityBoundary:
    """The stability boundary as G straight segments over the chatter frequency; shapes (G, 2).

    Parameters
    ----------
    omega : ndarray
        Chatter frequency at both ends [rad/s].
    share : ndarray
        psi / pi there [1].
    inverse : ndarray
        1 / a_p there [1/m], not negative.
    """

    omega: Floats
    share: Floats
    inverse: Floats

    @property
    def least_depth(self) -> float:
        """Depth below which there is no chatter at any speed [m]."""
        most = float(self.inverse.max(initial=0.0))
        return 1.0 / most if most > 0.0 else float("inf")


def lobes(
    dynamics: Dynamics, cut: RegenerativeCut, n: ArrayLike, *, tolerance: float = TOLERANCE
) -> Lobes:
    """Depth limit at each spindle speed.

    Parameters
    ----------
    dynamics : sequence of Mode, or FrequencyResponse
        Of the tool's tip, in the machine's frame.
    cut : RegenerativeCut
        Force, teeth, angles and direction of feed.
    n : array_like, shape (S,)
        Spindle speeds [1/s], above 0.
    tolerance : float
        Of the depth and of the phase [1].
    """
    speeds = checked_speeds(n)
    if not len(speeds):
        return Lobes(n=speeds, depth_limit=speeds.copy(), chatter_frequency=speeds.copy())
    edge = stability_boundary(
        dynamics, cut, float(speeds.min()), float(speeds.max()), tolerance=tolerance
    )
    inverse, chatter = np.empty_like(speeds), np.empty_like(speeds)
    period = 1.0 / (cut.flutes * speeds)
    lowest_lobes(edge.omega, edge.share, edge.inverse, period, inverse, chatter)
    limit = np.full_like(speeds, np.inf)
    np.divide(1.0, inverse, out=limit, where=inverse > 0.0)
    return Lobes(n=speeds, depth_limit=limit, chatter_frequency=chatter / (2 * np.pi))


def checked_speeds(n: ArrayLike) -> Floats:
    """Spindle speeds [1/s] as an array of shape (S,), each above 0."""
    speeds = np.atleast_1d(np.asarray(n, dtype=np.float64))
    if speeds.ndim != 1:
        raise ValueError(f"n has shape {speeds.shape}: give spindle speeds in one row")
    if not (np.isfinite(speeds).all() and (speeds > 0.0).all()):
        raise ValueError(f"n: spindle speeds must be above 0 1/s, the least is {speeds.min():g}")
    return speeds


def stability_boundary(
    dynamics: Dynamics, cut: RegenerativeCut, slowest: float, fastest: float, *,
    tolerance: float = TOLERANCE,
) -> StabilityBoundary:  # fmt: skip
    """The stability boundary for spindle speeds from ``slowest`` to ``fastest`` [1/s].

    Raises
    ------
    ValueError
        When a speed or the tolerance is not above 0, or there is neither mode nor measured
        receptance.
    """
    if not 0.0 < slowest <= fastest < np.inf:
        raise ValueError(
            f"slowest = {slowest}, fastest = {fastest}: spindle speeds must be above 0 1/s, the "
            "slowest first"
        )
    if not tolerance > 0.0:
        raise ValueError(f"tolerance = {tolerance} must be above 0")
    if not isinstance(dynamics, FrequencyResponse) and not dynamics:
        raise ValueError("modes: there is none, and what does not give way does not chatter")
    matrix = mean_matrix(cut)
    frequency, values = _refined(
        dynamics, matrix, _first_frequencies(dynamics, cut, slowest, fastest), tolerance
    )
    branches = [_segments(2 * np.pi * frequency, branch) for branch in _tracked(values).T]
    omega, share, inverse = (np.concatenate(part) for part in zip(*branches, strict=True))
    return StabilityBoundary(omega=omega, share=share, inverse=inverse)


def _first_frequencies(
    dynamics: Dynamics, cut: RegenerativeCut, slowest: float, fastest: float
) -> Floats:
    """Where refinement begins [Hz]."""
    if isinstance(dynamics, FrequencyResponse):
        return dynamics.frequency_Hz
    natural = np.array([mode.natural_frequency_Hz for mode in dynamics])
    width = natural * np.array([mode.damping for mode in dynamics])
    low = min(natural.min() / 20, cut.flutes * slowest / 4)
    high = max(4 * natural.max(), 1.2 * cut.flutes * fastest)
    peaks = (natural[:, None] + width[:, None] * _AROUND).ravel()
    every = np.concatenate([np.geomspace(low, high, 48), peaks])
    return np.unique(every[(every >= low) & (every <= high)])


def _refined(
    dynamics: Dynamics, matrix: Floats, frequency: Floats, tolerance: float
) -> tuple[Floats, Complex]:
    """Frequencies so dense that the eigenvalues are straight between them, and these."""
    values = eigenvalues(matrix, receptance(dynamics, frequency))
    bent = np.ones(len(frequency) - 1, dtype=np.bool_)
    for _ in range(_HALVINGS):
        # exact eigenvalues in the middle of each bent interval, and those of a straight line
        at = np.flatnonzero(bent)
        middle = (frequency[at] + frequency[at + 1]) / 2
        exact = eigenvalues(matrix, receptance(dynamics, middle))
        straight = (values[at] + _matched(values[at], values[at + 1])) / 2
        off = np.abs(exact - _matched(exact, straight))
        # deviation that is allowed, and intervals that can hold chatter
        size = np.abs(exact)
        ends = np.maximum(values[at].real.max(axis=1), values[at + 1].real.max(axis=1))
        counts = np.maximum(ends, exact.real.max(axis=1)) > 0.0
        allowed = tolerance * np.maximum(
            np.maximum(exact.real, _SHALLOW * size), _NOTHING * np.abs(values).max()
        )
        more = (off > allowed).any(axis=1) & counts
        # insert the middles; both halves of an interval that deviates are bent
        frequency = np.insert(frequency, at + 1, middle)
        values = np.insert(values, at + 1, exact, axis=0)
        left = at + np.arange(len(at))
        bent = np.zeros(len(frequency) - 1, dtype=np.bool_)
        bent[left[more]] = bent[left[more] + 1] = True
        if not more.any():
            break
    return frequency, values


def _matched(values: Complex, others: Complex) -> Complex:
    """``others`` with the two of each row in the order in which they are closer to ``values``."""
    same = np.abs(values - others).sum(axis=1)
    crossed = np.abs(values - others[:, ::-1]).sum(axis=1)
    return np.where((crossed < same)[:, None], others[:, ::-1], others)


def _tracked(values: Complex) -> Complex:
    """Eigenvalues as two continuous branches; shape (F, 2)."""
    same = np.abs(np.diff(values, axis=0)).sum(axis=1)
    crossed = np.abs(values[1:, ::-1] - values[:-1]).sum(axis=1)
    swapped = np.concatenate([[False], np.cumsum(crossed < same) % 2 == 1])
    return np.where(swapped[:, None], values[:, ::-1], values)


def _segments(omega: Floats, branch: Complex) -> tuple[Floats, Floats, Floats]:
    """Segments of one branch where Re lambda > 0; cut where it crosses 0."""
    first, last = branch[:-1], branch[1:]
    crosses = (first.real > 0.0) != (last.real > 0.0)
    step = np.where(crosses, last.real - first.real, 1.0)
    where = np.where(crosses, -first.real / step, 0.0)
    zero_omega = omega[:-1] + where * np.diff(omega)
    zero = 1j * (first.imag + where * (last.imag - first.imag))
    begin, begin_at = np.where(first.real > 0.0, first, zero), omega[:-1]
    end, end_at = np.where(last.real > 0.0, last, zero), omega[1:]
    begin_at = np.where(first.real > 0.0, begin_at, zero_omega)
    end_at = np.where(last.real > 0.0, end_at, zero_omega)
    kept = (first.real > 0.0) | (last.real > 0.0)
    both = np.stack([begin, end], axis=1)[kept]
    share = np.arctan2(both.real, -both.imag) / np.pi
    return np.stack([begin_at, end_at], axis=1)[kept], share, 2.0 * both.real


def receptance(dynamics: Dynamics, frequency_Hz: Floats) -> Complex:
    """Of either kind [m/N]; shape (F, 2, 2)."""
    if isinstance(dynamics, FrequencyResponse):
        return dynamics.at(frequency_Hz)
    return modal_receptance(dynamics, frequency_Hz)


@compiled
def lowest_lobes(omega, share, inverse, period, out, chatter):  # type: ignore[no-untyped-def]
    """Fill the greatest 1 / depth of all lobes at each tooth period, and its frequency [rad/s].

    Parameters
    ----------
    omega, share, inverse : ndarray, shape (G, 2)
        Segments of the boundary.
    period : ndarray, shape (S,)
        Tooth period [s].
    out, chatter : ndarray, shape (S,)
        Filled; 0 and nan where there is no lobe.
    """
    for s in range(period.shape[0]):
        out[s] = 0.0
        chatter[s] = nan
        for g in range(omega.shape[0]):
            if inverse[g, 0] <= out[s] and inverse[g, 1] <= out[s]:
                continue
            first = omega[g, 0] * period[s] / _TURN - share[g, 0]
            last = omega[g, 1] * period[s] / _TURN - share[g, 1]
            k = max(ceil(min(first, last)), 0)
            while k <= max(first, last):
                along = (k - first) / (last - first) if last != first else 0.0
                value = inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0])
                if value > out[s]:
                    out[s] = value
                    chatter[s] = omega[g, 0] + along * (omega[g, 1] - omega[g, 0])
                k += 1
