"""Directional matrix: force on the tool by a displacement of the tool.

The chip of a tooth at phi grows by sin(phi) dx + cos(phi) dy when the tool stands off by (dx, dy)
from where the tooth before it cut; with the forces of the linear law the force on the tool is
F = a_p A (dx, dy), in the frame of the cut (x along the feed, y to its left)

    A = sum over the teeth in cut of [-(K_t cos + K_r sin) sin, -(K_t cos + K_r sin) cos]
                                     [ (K_t sin - K_r cos) sin,  (K_t sin - K_r cos) cos]

(Altintas 2012, eq. 3.118, there with K_r over K_t and a factor 1/2).  Edge forces do not depend on
the thickness of the chip: they have no part in it.  The matrix is turned into the machine's frame;
with a spindle that turns anticlockwise (M4) y of the cut points to the right.

Where the edge is not parallel to the axis (ball, corner), kappa being the angle between the axis
and the edge's normal, the chip grows by sin(kappa) of that, and is dz / sin(kappa) wide: K_t stays,
and K_r is the mean over the heights of K_rc sin(kappa) + K_ac cos(kappa), what radial and axial
force have in the plane (as in :mod:`pipeline.cutting.force.waveform`).
"""

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats
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
        if self.direction not in (1, -1):
            raise ValueError(f"cut.direction = {self.direction} must be 1 (M3) or -1 (M4)")

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

    ValueError when a height ``high`` is not above its ``low`` >= 0 [m]; as :func:`stiffness`.
    """
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if not ((a >= 0.0) & (b > a) & np.isfinite(b)).all():
        raise ValueError(
            f"heights = {low!r}, {high!r}: the edge must cut from 0 m or more above the tip to more"
        )
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
    factor: float = (1.0 - law.m_c) * thickness ** (-law.m_c)
    return factor


def mean_matrix(cut: RegenerativeCut) -> Floats:
    """A of one turn's mean, in the machine's frame [N/m^2]; shape (2, 2).

    Over a turn the helix shifts the force of each height, so that the mean does not depend on it.
    """
    once = _matrices(cut, _once(cut, np.array(cut.exit)))
    mean: Floats = cut.turned @ once @ cut.turned.T / cut.pitch
    return mean


def harmonic_matrices(cut: RegenerativeCut, many: int) -> Complexes:
    """Harmonics of A at the tooth passing frequency, in the machine's frame; shape (many, 2, 2).

    The first is the mean.  Without helix, which only weakens the others.
    """
    edges = np.linspace(cut.entry, cut.exit, ARCS * many + 1)
    parts = np.diff(_matrices(cut, _once(cut, edges)), axis=0)
    middle = 0.5 * (edges[1:] + edges[:-1])
    turns = np.exp(-1j * cut.flutes * np.arange(many)[:, None] * middle)
    found: Complexes = (
        cut.turned @ np.einsum("rc,cij->rij", turns, parts) @ cut.turned.T / cut.pitch
    )
    return found


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
    once: Floats = _first(clipped) - entry
    return once


def _first(phi: ArrayLike) -> Floats:
    phi = np.asarray(phi, dtype=np.float64)
    wave = np.sin(2 * phi) / 4
    return np.stack([np.sin(phi) ** 2 / 2, phi / 2 - wave, phi / 2 + wave])
