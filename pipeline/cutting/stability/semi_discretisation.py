"""Depth limit of milling by semi-discretisation (Insperger, Stepan 2004), with impulses.

The modes obey q'' + 2 zeta w_n q' + w_n^2 q = (1/m) a_p A(t) (u(t) - u(t - T)), u being the tip's
displacement, T the tooth period.  The cut is divided into cells; in each the force acts as one
impulse, the exact integral of A(t) times the regeneration in the cell's middle, and between two
impulses the modes vibrate freely (:mod:`pipeline.cutting.stability.semi_discretisation_kernel`).
The state after one period is Phi times that before; chatter begins where an eigenvalue of Phi
leaves the unit circle.  Unlike the zero-order solution this sees flip lobes (period doubling) at
low immersion, and helix.

As delay and period are the same, the delayed displacement is needed only where a tooth cuts: the
free flight between two cuts is solved in one piece.

The error falls with the square of the cell.  The number of cells doubles until what is left, a
third of what the last doubling changed, is within a tolerance; that third is then taken off as well
(Richardson's extrapolation).  A fixed number of cells overstates the depth at low speed, where many
waves lie within a period.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from pipeline.cutting.stability.directional import (
    RegenerativeCut,
    harmonic_matrices,
    mean_matrix,
)
from pipeline.cutting.stability.tip_dynamics import Mode, modal_receptance
from pipeline.schema.arrays import Complexes, Floats, Ints

if TYPE_CHECKING:
    from pipeline.cutting.stability.semi_discretisation_kernel import Cut, Tip, Work

KRYLOV = 8
"""Dimensions of the Krylov space besides those of the modes' states."""
CELLS_PER_WAVE = 6
"""Cells per wave of the highest mode at the start of refinement."""
LEAST_CELLS = 12
MOST_CELLS = 4096
REFINEMENTS = 6
"""Doublings of the cells."""
KEPT = 1 << 14
"""Classes of cuts whose limits are kept."""
BELOW = 0.7
"""Share of the stable depth where the search for chatter begins [1]."""
HARMONICS = 7
"""Number of harmonics of A, the mean among them, in the bound of the depth."""
_AROUND = np.linspace(-8.0, 8.0, 65)
"""Half widths of a mode's peak where its receptance is looked at."""


def arrays(modes: Sequence[Mode], cut: RegenerativeCut, cells: int) -> "tuple[Tip, Cut, Work]":
    """Arguments of the kernels, with arrays for up to ``cells``."""
    from pipeline.cutting.stability.semi_discretisation_kernel import Cut, Tip, Work

    used = sorted({mode.axis for mode in modes})
    many, size = len(used), len(modes)
    states = 2 * size + cells * many
    krylov = min(2 * size + KRYLOV, states)
    tip = Tip(
        omega=np.array([mode.omega for mode in modes]),
        zeta=np.array([mode.damping for mode in modes]),
        mass=np.array([mode.mass for mode in modes]),
        axis=np.array([used.index(mode.axis) for mode in modes]),
    )
    taken = Cut(
        K_tc=float(cut.K_tc), K_rc=float(cut.K_rc), entry=float(cut.entry), exit=float(cut.exit),
        pitch=cut.pitch, lag=float(cut.lag), turned=np.ascontiguousarray(cut.turned.T[:, used]),
    )  # fmt: skip
    work = Work(
        weight=np.empty((cells, many, many)), edge=np.empty((2, 3)),
        drift=np.empty((2, size, 4)), tip=np.empty((2, many)),
        start=np.random.default_rng(0).standard_normal(states),
        basis=np.empty((krylov + 1, states)), hessenberg=np.empty((krylov, krylov)),
        square=np.empty((2, krylov, krylov)),
    )  # fmt: skip
    return tip, taken, work


@dataclass(frozen=True, kw_only=True)
class DepthLimits:
    """Depth limit at S spindle speeds, as far as the cells were refined."""

    n: Floats
    """Spindle speed [1/s]; shape (S,)."""
    depth_limit: Floats
    """Least depth of chatter [m]; inf where there is none up to the searched depth; shape (S,)."""
    error: Floats
    """Estimated error of the finest cells before extrapolation over the limit [1]; shape (S,)."""
    cells: Ints
    """Cells of the cut in one tooth period; shape (S,)."""


def settled_limits(
    modes: Sequence[Mode], cut: RegenerativeCut, n: Floats, *, highest: float,
    tolerance: float = 0.01, ratio: float = 1.2,
) -> DepthLimits:  # fmt: skip
    """Least depth at which chatter begins, at each spindle speed.

    The depth limit is nan where a cut holds more than 256 waves of the highest mode, as at one
    tooth a second, that of the finest cells where it does not settle: ``error`` is above
    ``tolerance`` there.

    Parameters
    ----------
    modes : sequence of Mode
        At least one mode of the tip.
    cut : RegenerativeCut
        Cut, its depth and speed open.
    n : ndarray, shape (S,)
        Spindle speeds [1/s], above 0.
    highest : float
        Greatest depth of the search [m], above 0.
    tolerance : float
        The cells are doubled until the limit's estimated error before extrapolation is below this
        share of it [1]; after it about a tenth of that is left.
    ratio : float
        Ratio of neighbouring depths of the first search, above 1; a narrow region of chatter
        between two of them shows as a local maximum of the spectral radius.
    """
    from pipeline.cutting.stability.semi_discretisation_kernel import first_limits

    first = first_cells(modes, cut, n, highest)
    limit, error, used = np.full(len(n), np.nan), np.full(len(n), np.inf), first.copy()
    least = BELOW * stable_depth(modes, cut)
    for many in np.unique(first[2 * first <= MOST_CELLS]).tolist():
        mine = first == many
        out, off = np.empty(int(mine.sum())), np.empty(int(mine.sum()))
        last = np.empty(len(out), dtype=np.int64)
        taken = arrays(modes, cut, min(MOST_CELLS, many * 2**REFINEMENTS))
        depths = (least, float(highest), float(ratio))
        first_limits(*taken, n[mine], many, depths, tolerance, out, off, last)
        limit[mine], error[mine], used[mine] = out, off, last
    return DepthLimits(n=n, depth_limit=limit, error=error, cells=used)


def first_cells(modes: Sequence[Mode], cut: RegenerativeCut, n: Floats, highest: float) -> Ints:
    """Cells of the cut where refinement begins at speeds ``n`` [1/s]: a power of 2 times 12."""
    wave = max(mode.natural_frequency_Hz for mode in modes)
    span = min(cut.exit - cut.entry + cut.lag * highest, cut.pitch) / (2 * pi * n)
    doubled = np.maximum(np.ceil(np.log2(CELLS_PER_WAVE * wave * span / LEAST_CELLS)), 0.0)
    cells: Ints = (LEAST_CELLS * 2.0 ** np.minimum(doubled, 40.0)).astype(np.int64)
    return cells


def least_depth(modes: Sequence[Mode], cut: RegenerativeCut) -> float:
    """Least depth limit at any speed [m], some percent too high.

    That of the zero-order solution, or twice :func:`stable_depth` where the mean of A says nothing:
    a receptance has half of its magnitude as its real part.
    """
    return _depths(tuple(modes), cut)[0]


def stable_depth(modes: Sequence[Mode], cut: RegenerativeCut) -> float:
    """Depth below which hardly any speed chatters [m]: 1 / (2 max |eig(A_r G)|), harmonics r of A.

    The regeneration is twice the displacement at most.  The mean of A (r = 0) alone does not bound
    the depth: where it changes its sign, harmonics drive two modes, or one mode at two frequencies.
    That other harmonics act as well is left out: of 1900 limits of drawn cuts the least was 0.85 of
    it, which :data:`BELOW` allows for.
    """
    return _depths(tuple(modes), cut)[1]


def eigenvalues(matrix: Floats, response: Complexes) -> Complexes:
    """Both eigenvalues of A Phi [1/m], in no order; shape (F, 2).

    Parameters
    ----------
    matrix : ndarray, shape (2, 2)
        A [N/m^2].
    response : ndarray of complex, shape (F, 2, 2)
        Phi [m/N].
    """
    product = matrix @ response
    half = (product[:, 0, 0] + product[:, 1, 1]) / 2
    apart = (product[:, 0, 0] - product[:, 1, 1]) / 2
    root = np.sqrt(apart**2 + product[:, 0, 1] * product[:, 1, 0])
    greater = np.where(np.abs(half + root) >= np.abs(half - root), half + root, half - root)
    # the product of both: no rounding of the greater one is left where the other is 0
    both = (matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]) * (
        response[:, 0, 0] * response[:, 1, 1] - response[:, 0, 1] * response[:, 1, 0]
    )
    lesser = np.divide(both, greater, out=np.zeros_like(both), where=greater != 0.0)
    return np.stack([greater, lesser], axis=1)


@lru_cache(maxsize=KEPT)
def _depths(modes: tuple[Mode, ...], cut: RegenerativeCut) -> tuple[float, float]:
    frequency = np.concatenate([
        mode.natural_frequency_Hz * (1.0 + mode.damping * (1.0 + _AROUND)) for mode in modes
    ])  # fmt: skip
    receptance = modal_receptance(modes, frequency[frequency > 0.0])
    matrices = harmonic_matrices(cut, HARMONICS)
    most = float(eigenvalues(mean_matrix(cut), receptance).real.max())
    bound = max(float(np.abs(eigenvalues(one, receptance)).max()) for one in matrices)
    least, stable = (1.0 / (2.0 * gain) if gain > 0.0 else float("inf") for gain in (most, bound))
    return min(least, 2.0 * stable), stable
