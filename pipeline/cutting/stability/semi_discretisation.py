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

Directional matrix.  The chip of a tooth at phi grows by sin(phi) dx + cos(phi) dy when the tool
stands off by (dx, dy) from where the tooth before it cut; with the forces of the linear law the
force on the tool is F = a_p A (dx, dy), in the frame of the cut (x along the feed, y to its left)

    A = sum over the teeth in cut of [-(K_t cos + K_r sin) sin, -(K_t cos + K_r sin) cos]
                                     [ (K_t sin - K_r cos) sin,  (K_t sin - K_r cos) cos]

(Altintas 2012, eq. 3.118, there with K_r over K_t and a factor 1/2).  Edge forces do not depend on
the thickness of the chip: they have no part in it.  The matrix is turned into the machine's frame;
with a spindle that turns anticlockwise (M4) y of the cut points to the right.  Where the edge is
not parallel to the axis (ball, corner), kappa being the angle between the axis and the edge's
normal, the chip grows by sin(kappa) of that, and is dz / sin(kappa) wide: K_t stays, and K_r is the
mean over the heights of K_rc sin(kappa) + K_ac cos(kappa), what radial and axial force have in the
plane (as in :mod:`pipeline.cutting.force.waveform`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.semi_discretisation_kernel import Cut, Tip, Work, first_limits
from pipeline.cutting.stability.tip_dynamics import Mode, modal_receptance
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats, Ints
from pipeline.schema.ranges import Count, Finite, Positive, Ranged

ARCS = 8
"""Parts of the arc of a cut for each harmonic."""


@dataclass(frozen=True, kw_only=True)
class RegenerativeCut(Ranged, section="cut"):
    """Regenerative cut: all of a milling cut that decides on chatter, but its depth and speed."""

    K_tc: Positive
    K_rc: Finite
    """dF_t / dh and dF_r / dh for each depth of cut, in the plane [N/m^2]."""
    flutes: Count
    """Number of teeth, equally spaced."""
    entry: float
    exit: float
    """Angles between which a tooth is in the material, 0 <= entry < exit <= pi [rad]."""
    feed_direction: Finite = 0.0
    """Angle from the machine's x, anticlockwise seen from above [rad]."""
    direction: Literal[1, -1] = 1
    """Direction of the spindle: 1 clockwise seen from above (M3), -1 anticlockwise (M4)."""
    lag: Finite = 0.0
    """Lag of an edge behind its tip over the height, tan(helix) / R [rad/m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.entry < self.exit <= pi + 1e-9:
            raise ValueError(
                f"cut.entry = {self.entry:.6g}, cut.exit = {self.exit:.6g} rad must be "
                "0 <= entry < exit <= pi"
            )

    @property
    def pitch(self) -> float:
        """Angle between two teeth [rad]."""
        return 2 * pi / self.flutes

    @property
    def turned(self) -> Floats:
        """Directions of the cut's x and y in the machine's frame, as columns; shape (2, 2)."""
        c, s = cos(self.feed_direction), sin(self.feed_direction)
        return np.array([[c, -s * self.direction], [s, c * self.direction]])


def stiffness(law: ForceLaw, thickness: float | None = None) -> tuple[float, float]:
    """dF_t / dh and dF_r / dh for each depth of cut, K_c (1 - m_c) h^(-m_c) [N/m^2].

    ValueError when the law is not linear (m_c > 0) and no ``thickness`` [m] above 0 is given.
    """
    factor = _slope(law, thickness)
    return law.K_tc * factor, law.K_rc * factor


def in_plane(
    law: ForceLaw, tool: Tool, low: ArrayLike, high: ArrayLike, thickness: float | None = None
) -> tuple[float, Floats]:
    """dF_t / dh and dF_r / dh in the plane, of an edge between heights above the tip [N/m^2].

    Each height ``high`` is above its ``low`` >= 0 [m]; ValueError as :func:`stiffness`.
    """
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    factor = _slope(law, thickness)
    sine, cosine = (_height_integrals(tool, b) - _height_integrals(tool, a)) / (b - a)
    radial: Floats = (law.K_rc * sine + law.K_ac * cosine) * factor
    return law.K_tc * factor, radial


def _height_integrals(tool: Tool, z: Floats) -> Floats:
    """Integrals of sin(kappa) and cos(kappa) from the tip up to z [m]; shape (2,) + z's."""
    if tool.kind == "drill":
        half = tool.point_angle / 2
        cone = np.minimum(z, tool.radius * cos(half) / sin(half))
        return np.stack([cone * cos(half) + z - cone, cone * sin(half)])
    corner = tool.corner_radius
    if corner == 0.0:
        return np.stack([z, np.zeros_like(z)])
    w = 1.0 - np.minimum(z / corner, 1.0)  # cos(kappa)
    sine = pi / 4 - (w * np.sqrt(1.0 - w * w) + np.arcsin(w)) / 2
    rest = np.maximum(z - corner, 0.0)
    return np.stack([corner * sine + rest, corner * (1.0 - w * w) / 2])


def _slope(law: ForceLaw, thickness: float | None) -> float:
    """(1 - m_c) h^(-m_c)."""
    if law.m_c == 0.0:
        return 1.0
    if thickness is None or not thickness > 0.0:
        raise ValueError(
            f"force_law.m_c = {law.m_c}: how the force grows depends on the chip's thickness, "
            f"which is {thickness}; give the mean thickness of the chip, above 0 m"
        )
    return (1.0 - law.m_c) * thickness ** (-law.m_c)


def mean_matrix(cut: RegenerativeCut) -> Floats:
    """A of one turn's mean, in the machine's frame [N/m^2]; shape (2, 2).

    Over a turn the helix shifts the force of each height, so that the mean does not depend on it.
    """
    once = _matrices(cut, _once(cut, np.array(cut.exit)))
    return cut.turned @ once @ cut.turned.T / cut.pitch


def harmonic_matrices(cut: RegenerativeCut, many: int) -> Complexes:
    """Harmonics of A at the tooth passing frequency, in the machine's frame; shape (many, 2, 2).

    The first is the mean.  Without helix, which only weakens the others.
    """
    edges = np.linspace(cut.entry, cut.exit, ARCS * many + 1)
    parts = np.diff(_matrices(cut, _once(cut, edges)), axis=0)
    middle = 0.5 * (edges[1:] + edges[:-1])
    turns = np.exp(-1j * cut.flutes * np.arange(many)[:, None] * middle)
    return cut.turned @ np.einsum("rc,cij->rij", turns, parts) @ cut.turned.T / cut.pitch


def _matrices(cut: RegenerativeCut, products: Floats) -> Floats:
    """A from sin cos, sin^2, cos^2 in rows; shape (..., 2, 2)."""
    sc, ss, cc = products
    rows = [
        [-cut.K_tc * sc - cut.K_rc * ss, -cut.K_tc * cc - cut.K_rc * sc],
        [cut.K_tc * ss - cut.K_rc * sc, cut.K_tc * sc - cut.K_rc * cc],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _once(cut: RegenerativeCut, phi: Floats) -> Floats:
    """Integrals of sin cos, sin^2, cos^2 over a tooth's engagement up to phi; (3,) + its shape."""
    clipped = np.clip(phi, cut.entry, cut.exit)
    entry = _first(cut.entry).reshape((3,) + (1,) * clipped.ndim)
    return _first(clipped) - entry


def _first(phi: ArrayLike) -> Floats:
    phi = np.asarray(phi, dtype=np.float64)
    wave = np.sin(2 * phi) / 4
    return np.stack([np.sin(phi) ** 2 / 2, phi / 2 - wave, phi / 2 + wave])


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


def arrays(modes: Sequence[Mode], cut: RegenerativeCut, cells: int) -> tuple[Tip, Cut, Work]:
    """Arguments of the kernels, with arrays for up to ``cells``."""
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
    """Least depth at which chatter begins, at each spindle speed ``n`` (S,), above 0 [1/s].

    It is searched up to ``highest`` [m].  The depth limit is nan where a cut holds more than 256
    waves of the highest mode, as at one tooth a second, that of the finest cells where it does not
    settle: ``error`` is above ``tolerance`` there.  The cells are doubled until the limit's
    estimated error before extrapolation is below this share of it [1]; after it about a tenth of
    that is left.  ``ratio`` is that of neighbouring depths of the first search, above 1; a narrow
    region of chatter between two of them shows as a local maximum of the spectral radius.
    """
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
    return (LEAST_CELLS * 2.0 ** np.minimum(doubled, 40.0)).astype(np.int64)


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
    """Both eigenvalues of A Phi [1/m], (F, 2), in no order.

    Parameters
    ----------
    matrix : ndarray, shape (2, 2)
        A [N/m^2].
    response : ndarray, shape (F, 2, 2)
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
    frequency = np.concatenate(
        [mode.natural_frequency_Hz * (1.0 + mode.damping * (1.0 + _AROUND)) for mode in modes]
    )
    receptance = modal_receptance(modes, frequency[frequency > 0.0])
    matrices = harmonic_matrices(cut, HARMONICS)
    most = float(eigenvalues(mean_matrix(cut), receptance).real.max())
    bound = max(float(np.abs(eigenvalues(one, receptance)).max()) for one in matrices)
    least, stable = (1.0 / (2.0 * gain) if gain > 0.0 else float("inf") for gain in (most, bound))
    return min(least, 2.0 * stable), stable
