"""Stability lobes, zero-order solution (Altintas and Budak 1995; Altintas 2012, section 3.8.1).

With the directional matrix A at its mean over a turn, chatter at w has
F = a_p (1 - e^(-i w T)) A Phi(i w) F; for each eigenvalue lambda of A Phi the depth is
a_p = 1 / (2 Re lambda), where Re lambda > 0, and the tooth period T follows from
w T = 2 psi + 2 pi k, psi = atan2(Re lambda, -Im lambda), for each whole number of waves k >= 0.
The depth limit at a speed is the least of all lobes, eigenvalues and modes.

Lobes beyond four times the highest mode, or the range that was measured, lie far above the minimum
and are left out.  The mean of A is good where teeth are in the cut most of the time; at low
immersion flip lobes appear that only semi-discretisation shows.
"""

from collections.abc import Sequence
from math import ceil, floor, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.stability.semi_discretisation import RegenerativeCut, eigenvalues, mean_matrix
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, Mode, modal_receptance
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats

Complex = NDArray[np.complex128]
Dynamics = Sequence[Mode] | FrequencyResponse
"""Dynamics of one tip: modes, or a measured response."""


def lobes(dynamics: Dynamics, cut: RegenerativeCut, n: ArrayLike) -> Floats:
    """Depth limit at each spindle speed [1/s], inf where no lobe is [m]; shape (S,)."""
    speeds = np.asarray(n, dtype=np.float64)
    frequency = _frequencies(dynamics, cut, speeds)
    response = (
        dynamics.at(frequency) if isinstance(dynamics, FrequencyResponse)
        else modal_receptance(dynamics, frequency)
    )  # fmt: skip
    values = _tracked(eigenvalues(mean_matrix(cut), response))
    branches = [_segments(2 * np.pi * frequency, branch) for branch in values.T]
    edge = (np.concatenate(part) for part in zip(*branches, strict=True))
    inverse = np.zeros_like(speeds)
    _highest_lobes(*edge, 1.0 / (cut.flutes * speeds), inverse)
    with np.errstate(divide="ignore"):
        return 1.0 / inverse


def _frequencies(dynamics: Dynamics, cut: RegenerativeCut, speeds: Floats) -> Floats:
    """Frequencies [Hz], dense about the modes, so that eigenvalues are straight between them."""
    if isinstance(dynamics, FrequencyResponse):
        measured = dynamics.frequency_Hz
        return np.interp(np.arange(0, len(measured) - 1, 0.2), np.arange(len(measured)), measured)
    natural = np.array([mode.natural_frequency_Hz for mode in dynamics])
    width = natural * np.array([mode.damping for mode in dynamics])
    low = min(natural.min() / 20, cut.flutes * speeds.min() / 4)
    high = max(4 * natural.max(), 1.2 * cut.flutes * speeds.max())
    peaks = natural[:, None] + width[:, None] * np.sinh(np.linspace(-6.0, 6.0, 2001))
    every = np.concatenate([np.geomspace(low, high, 2000), peaks.ravel()])
    return np.unique(every[(every >= low) & (every <= high)])


def _tracked(values: Complex) -> Complex:
    """Eigenvalues as two continuous branches; shape (F, 2)."""
    same = np.abs(np.diff(values, axis=0)).sum(axis=1)
    crossed = np.abs(values[1:, ::-1] - values[:-1]).sum(axis=1)
    swapped = np.concatenate([[False], np.cumsum(crossed < same) % 2 == 1])
    return np.where(swapped[:, None], values[:, ::-1], values)


def _segments(omega: Floats, branch: Complex) -> tuple[Floats, Floats, Floats]:
    """Segments of one branch where Re lambda > 0: omega, psi / pi and 1 / a_p at both ends."""
    kept = (branch.real[:-1] > 0.0) & (branch.real[1:] > 0.0)
    share = np.arctan2(branch.real, -branch.imag) / np.pi
    return tuple(  # type: ignore[return-value]
        np.stack([one[:-1], one[1:]], axis=1)[kept] for one in (omega, share, 2.0 * branch.real)
    )


@compiled
def _highest_lobes(omega, share, inverse, period, out):  # type: ignore[no-untyped-def]
    """Raise ``out`` to the greatest 1 / depth of all lobes at each tooth period [s]."""
    for s in range(period.shape[0]):
        for g in range(omega.shape[0]):
            if inverse[g, 0] <= out[s] and inverse[g, 1] <= out[s]:
                continue
            first = omega[g, 0] * period[s] / (2.0 * pi) - share[g, 0]
            last = omega[g, 1] * period[s] / (2.0 * pi) - share[g, 1]
            for k in range(max(ceil(min(first, last)), 0), floor(max(first, last)) + 1):
                along = (k - first) / (last - first) if last != first else 0.0
                out[s] = max(out[s], inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0]))
