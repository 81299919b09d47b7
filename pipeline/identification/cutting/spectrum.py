"""What the model of a cut says of the harmonics of a revolution.

Forces on the tool are linear in the six coefficients (:mod:`pipeline.cutting.force.waveform`) and in what
single teeth take more or less at their edges than the mean of all, as worn or differently ground
teeth do.  Runout and helix shape them, and what a dynamometer shows of them is each channel's own
mode, 1 / (1 - r^2 + 2 i zeta r) at r = f / f_n (Girardin, Remond and Rigal 2010).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.waveform import basis
from pipeline.cutting.tool import DEGREE, UM, Tool
from pipeline.identification.cutting.conditions import Conditions

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

COEFFICIENTS = 6
ANGLES, MORE_ANGLES = 256, 512
"""Of a revolution, at which the model is evaluated; more where edges enter at once."""
AT_ONCE = 0.1
"""Lag of an edge over the depth of cut below which it enters at once [rad]."""
SLICE = 0.04
"""Of the edge, in lag [rad], at most; what runout makes of it then errs by 1e-4."""
MOST_SLICES = 48
LIMIT_DEG = 60.0
"""Of the helix angle."""


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """What of the tool shapes the forces and may be sought.

    Parameters
    ----------
    along, across : float
        Runout, of the tool's axis towards the first tooth and a quarter turn after it [m].
    helix : float
        Helix angle [rad].
    """

    along: float = 0.0
    across: float = 0.0
    helix: float = 0.0

    def of(self, tool: Tool) -> Tool:
        """The tool with this geometry."""
        offset = complex(self.along, self.across)
        return replace(
            tool, runout_um=min(abs(offset) / UM, 2000.0),
            runout_deg=float(np.degrees(np.angle(offset))), helix_deg=self.helix / DEGREE,
        )  # fmt: skip


def columns(tool: Tool, geometry: Geometry, conditions: Conditions, harmonics: int) -> Complexes:
    """Harmonics of the forces on the tool for each coefficient.

    Parameters
    ----------
    tool : Tool
        Its form.
    geometry : Geometry
        Its runout and helix.
    conditions : Conditions
        Of the cut.
    harmonics : int
        H.

    Returns
    -------
    ndarray of complex, shape (H + 1, 3, 6)
        [m^2] for cutting, [m] for edge coefficients.
    """
    return _lines(_forces(geometry.of(tool), conditions), harmonics)


def tooth_columns(
    tool: Tool, geometry: Geometry, conditions: Conditions, harmonics: int
) -> Complexes:
    """Harmonics for what single teeth take at their edges beyond the mean of all.

    A tooth's edge acts over the whole arc here, whether runout leaves it a chip or not.

    Parameters are those of :func:`columns`.

    Returns
    -------
    ndarray of complex, shape (H + 1, 3, 3 (N - 1))
        K_te, K_re, K_ae [m] of each tooth but the first, tooth by tooth; the first has what makes
        their sum zero.
    """
    single = replace(geometry.of(tool), flutes=1, runout_um=0.0)
    edge = _lines(_forces(single, conditions)[..., 3:], harmonics)
    late = 2 * np.pi / tool.flutes * np.arange(tool.flutes)
    wheel = np.exp(-1j * np.arange(harmonics + 1)[:, None] * late)
    others = wheel[:, 1:] - wheel[:, :1]
    each = edge[:, :, None, :] * others[:, None, :, None]
    return each.reshape(harmonics + 1, 3, -1)


def _forces(tool: Tool, conditions: Conditions) -> Floats:
    """Forces over a revolution for each coefficient; shape (T, 3, 6)."""
    lag = abs(np.tan(tool.helix)) * conditions.a_p / tool.radius
    many = ANGLES if lag > AT_ONCE else MORE_ANGLES
    return basis(
        tool, f_z=conditions.f_z, a_p=conditions.a_p, phi_st=conditions.phi_st,
        phi_ex=conditions.phi_ex, angles=(np.arange(many) + 0.5) * (2 * np.pi / many),
        slices=min(2 + int(lag / SLICE), MOST_SLICES),
    )  # fmt: skip


def _lines(values: Floats, harmonics: int) -> Complexes:
    """Harmonics of values on the middles of a revolution's steps; shape (H + 1, ...).

    On the middles no angle of the grid is one where a tooth enters as another leaves.
    """
    spectrum = np.fft.rfft(values, axis=0)[: harmonics + 1] * (2 / len(values))
    spectrum[0] /= 2
    return turned(spectrum, -np.pi / len(values))


def orders(harmonics: int) -> Floats:
    """0, 1, ... H."""
    return np.arange(harmonics + 1, dtype=np.float64)


def turned(spectrum: Complexes, phase: float) -> Complexes:
    """Harmonics of a revolution in which the first tooth is ``phase`` [rad] ahead."""
    wheel = np.exp(1j * phase * np.arange(len(spectrum)))
    return spectrum * wheel.reshape((-1,) + (1,) * (spectrum.ndim - 1))


def transfer(frequencies: Floats, natural: Floats, damping: Floats) -> Complexes:
    """What each channel shows of a force; shape (H + 1, 3).

    Parameters
    ----------
    frequencies : ndarray, shape (H + 1,)
        [Hz].
    natural, damping : ndarray, shape (3,)
        Of the channels' modes [Hz], [1].
    """
    r = frequencies[:, None] / natural
    return np.asarray(1 / (1 - r**2 + 2j * damping * r))
