"""The cut of Insperger and Stepan, and the delayed equation integrated step by step."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil, floor, pi, tan
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability import semi_discretisation_kernel
from pipeline.cutting.stability.semi_discretisation import (
    DepthLimits,
    RegenerativeCut,
    arrays,
    eigenvalues,
    in_plane,
    mean_matrix,
    settled_limits,
)
from pipeline.cutting.stability.tip_dynamics import FrequencyResponse, Mode, modal_receptance
from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats

X = Mode(direction="x", natural_frequency_Hz=922.0, damping=0.011, mass_kg=0.03993)
Y = Mode(direction="y", natural_frequency_Hz=1100.0, damping=0.02, mass_kg=0.05)
SLOT = RegenerativeCut(K_tc=6e8, K_rc=2e8, flutes=2, entry=0.0, exit=pi)
DOWN = replace(SLOT, entry=pi / 2)
UP = replace(SLOT, exit=pi / 2)
TWENTIETH = replace(SLOT, entry=pi - np.arccos(0.9))
"""Down-milling, a_e / D = 0.05."""
STEADY = replace(SLOT, flutes=4)
"""A slot with four flutes: the sum over its teeth is the same at each angle."""


def regenerative_cut(
    law: ForceLaw, tool: Tool, *, entry: float, exit: float, feed_direction: float = 0.0,
    direction: Literal[1, -1] = 1, heights: tuple[float, float] | None = None,
) -> RegenerativeCut:  # fmt: skip
    """The cut of a tool by a linear law, its edge between heights above the tip [m]."""
    tangential, radial = in_plane(law, tool, *(heights or (0.0, tool.radius)))
    return RegenerativeCut(
        K_tc=tangential, K_rc=float(radial), flutes=tool.flutes, entry=entry, exit=exit,
        feed_direction=feed_direction, direction=direction,
        lag=abs(tan(tool.helix)) / tool.radius,
    )  # fmt: skip


def forces(cut: RegenerativeCut, depth: float, steps: int, slices: int):
    """Force for each displacement in each step, and the steps' ends over a pitch [rad].

    The formulas of the force are written out for each tooth and slice: at the step's begin, middle
    and end, shape (S, 3, 2, 2), in the machine's frame.  Where the edge is straight, steps end
    where a tooth enters or leaves.
    """
    lags = (np.arange(slices) + 0.5) / slices * cut.lag * depth
    ends = np.mod([cut.entry, cut.exit], cut.pitch) if slices == 1 else []
    marks = np.unique(np.concatenate([[0.0, cut.pitch], ends]))
    marks = marks[np.diff(marks, prepend=-1.0) > 1e-9]
    marks[-1] = cut.pitch
    parts = [
        np.linspace(a, b, max(4, int(np.ceil(steps * (b - a) / cut.pitch))) + 1)[:-1]
        for a, b in pairwise(marks.tolist())
    ]
    edges = np.concatenate([*parts, [cut.pitch]])
    stages = np.stack([edges[:-1], (edges[:-1] + edges[1:]) / 2, edges[1:]], axis=1)
    total = np.zeros((len(edges) - 1, 3, 2, 2))
    along = np.array([np.cos(cut.feed_direction), np.sin(cut.feed_direction)])
    left = np.array([-along[1], along[0]]) * cut.direction
    for tooth in range(cut.flutes):
        for lag in lags:
            phi = stages + tooth * cut.pitch - lag
            inside = np.mod(phi[:, 1], 2 * pi)
            inside = (inside > cut.entry) & (inside < cut.exit)
            s, c = np.sin(phi)[..., None], np.cos(phi)[..., None]
            chip = s * along + c * left
            force = (-cut.K_tc * c - cut.K_rc * s) * along + (cut.K_tc * s - cut.K_rc * c) * left
            total += inside[:, None, None, None] * force[..., :, None] * chip[..., None, :]
    return total * depth / slices, edges


@njit(cache=True)
def _integrated(omega, zeta, mass, axis, force, time, periods):  # type: ignore[no-untyped-def]
    """Log of the vibration's size after each tooth period: Runge-Kutta of fourth order."""
    modes, steps = omega.size, time.size
    places, speeds = np.zeros((steps + 1, 2)), np.zeros((steps + 1, 2))
    q, v = np.full(modes, 1e-6), np.zeros(modes)
    a, b = np.zeros((4, modes)), np.zeros((4, modes))
    old, gap, push = np.zeros((3, 2)), np.zeros(2), np.zeros(2)
    x, f, first_place, first_speed = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    out, scale = np.zeros(periods), 0.0
    part = np.array([0.0, 0.5, 0.5, 1.0])
    at = np.array([0, 1, 1, 2])
    for period in range(periods):
        for i in range(steps):
            h = time[i]
            for d in range(2):  # Hermite's cubic between the states before
                old[0, d], old[2, d] = places[i, d], places[i + 1, d]
                old[1, d] = (places[i, d] + places[i + 1, d]) / 2
                old[1, d] += h / 8 * (speeds[i, d] - speeds[i + 1, d])
            if i > 0:
                places[i] = gap
                speeds[i] = push
            else:
                first_place[:] = 0.0
                first_speed[:] = 0.0
                for j in range(modes):
                    first_place[axis[j]] += q[j]
                    first_speed[axis[j]] += v[j]
            for stage in range(4):
                x[:] = 0.0
                for j in range(modes):
                    step = h * part[stage]
                    x[axis[j]] += q[j] + (step * a[stage - 1, j] if stage else 0.0)
                x -= old[at[stage]]
                for d in range(2):
                    f[d] = force[i, at[stage], d, 0] * x[0] + force[i, at[stage], d, 1] * x[1]
                for j in range(modes):
                    step = h * part[stage]
                    here = q[j] + (step * a[stage - 1, j] if stage else 0.0)
                    fast = v[j] + (step * b[stage - 1, j] if stage else 0.0)
                    a[stage, j] = fast
                    b[stage, j] = f[axis[j]] / mass[j] - 2 * zeta[j] * omega[j] * fast
                    b[stage, j] -= omega[j] ** 2 * here
            gap[:] = 0.0
            push[:] = 0.0
            for j in range(modes):
                q[j] += h / 6 * (a[0, j] + 2 * a[1, j] + 2 * a[2, j] + a[3, j])
                v[j] += h / 6 * (b[0, j] + 2 * b[1, j] + 2 * b[2, j] + b[3, j])
                gap[axis[j]] += q[j]
                push[axis[j]] += v[j]
        places[0], speeds[0] = first_place, first_speed
        places[steps], speeds[steps] = gap, push
        size = 0.0
        for j in range(modes):
            size += mass[j] * (omega[j] ** 2 * q[j] ** 2 + v[j] ** 2)
        size = np.sqrt(size) + 1e-300
        out[period] = np.log(size) + scale
        scale += np.log(size)
        places /= size
        speeds /= size
        q /= size
        v /= size
    return out


def growth(modes, cut, n: float, depth: float, *, periods: int = 0, steps: int = 160) -> float:
    """Factor by which vibration grows in a tooth period, by integration of the delayed equation.

    So many periods that a beat of the modes has died.
    """
    slices = 1 if cut.lag * depth < 1e-6 else max(24, int(cut.lag * depth / 0.02))
    force, edges = forces(cut, depth, steps, slices)
    omega = np.array([mode.omega for mode in modes])
    zeta = np.array([mode.damping for mode in modes])
    period = 1.0 / (n * cut.flutes)
    periods = periods or int(150 + 25 / (period * (zeta * omega).min()))
    sizes = _integrated(
        omega, zeta, np.array([mode.mass for mode in modes]),
        np.array([mode.axis for mode in modes]), force, np.diff(edges) / (2 * pi * n), periods,
    )  # fmt: skip
    third = periods // 3
    late = sizes[-third:].mean() - sizes[-2 * third : -third].mean()
    return float(np.exp(late / third))


def integrated_limit(modes, cut, n: float, guess: float, *, steps: int = 160) -> float:
    """First depth of chatter by time integration, near ``guess`` and below; within 0.3 %."""
    low = 0.3 * guess
    while growth(modes, cut, n, low, steps=steps) > 1.0:
        low *= 0.5
    high = low
    while high < 4 * guess:
        low, high = high, high * 1.09
        if growth(modes, cut, n, high, steps=steps) > 1.0:
            break
    else:
        return float("inf")
    while high - low > 0.003 * high:
        middle = (low + high) / 2
        if growth(modes, cut, n, middle, steps=steps) > 1.0:
            high = middle
        else:
            low = middle
    return (low + high) / 2


def depth_limits(modes, cut: RegenerativeCut, speeds, **options) -> DepthLimits:
    """Depth limits at the speeds [1/s], all of which settle."""
    found = settled_limits(modes, cut, np.asarray(speeds, dtype=np.float64), **options)
    assert (found.error <= options.get("tolerance", 0.01)).all()
    return found


def monodromy(modes, cut: RegenerativeCut, n: float, depth: float, cells: int) -> np.ndarray:
    """Phi, which takes the state through one tooth period, column by column; shape (K, K)."""
    tip, taken, work = arrays(modes, cut, cells)
    semi_discretisation_kernel.fill_period(tip, taken, n, depth, cells, work)
    phi = np.empty((len(work.start), len(work.start)))
    for state, out in zip(np.eye(len(phi)), phi, strict=True):
        semi_discretisation_kernel.pass_period(tip, depth / (2 * pi * n), cells, work, state, out)
    return phi.T


def spectral_radius(modes, cut: RegenerativeCut, n: float, depth: float, cells: int) -> float:
    """Greatest modulus of Phi's eigenvalues from Krylov's space; far from 1 only its side holds."""
    tip, taken, work = arrays(modes, cut, cells)
    return float(np.exp(semi_discretisation_kernel.growth(tip, taken, n, depth, cells, work)))


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
