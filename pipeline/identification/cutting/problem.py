"""The weighted least-squares problem of a waveform: residuals, slopes, and what is linear in it.

Unknowns that shape the forces (phases, runout, helix, the channels' modes) are few and nonlinear;
the coefficients follow from them by linear least squares (variable projection, Golub and Pereyra
1973, with Kaufman's slopes).  Weights know three things: the scatter of each harmonic over the
revolutions, the zero of each recording, and what the model leaves out of the harmonics of a
channel, a variance that is found from the residuals.  The mean of a force thus counts as much as it
is worth: modes do not touch it, and where the zero is known the coefficients obey the means first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.conditions import Conditions
from pipeline.identification.cutting.spectrum import (
    COEFFICIENTS,
    LIMIT_DEG,
    Geometry,
    columns,
    orders,
    tooth_columns,
    transfer,
    turned,
)

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PRIOR = (1e11, 1e11, 1e11, 1e7, 1e7, 1e7)
"""Standard deviations of coefficients about 0 [N/m^2], [N/m]: no material comes near, so that they
matter only where the records say nothing."""
SLOWEST = 0.5
"""Natural frequencies are at least that share of the first harmonic of the teeth..."""
FASTEST = 4.0
"""...and at most that multiple of the highest harmonic."""
DAMPING = (0.005, 1.0)
STEP = 0.02
"""Of the nonlinear unknowns in slopes, as a share of their scale."""


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Which terms the model has.

    Parameters
    ----------
    runout, helix, modes, teeth : bool
        Runout and helix of the tool, modes of the channels, edges of single teeth.
    """

    runout: bool = True
    helix: bool = False
    modes: bool = False
    teeth: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """What the problem knows of one recording.

    Parameters
    ----------
    conditions : Conditions
        With the speed that was found.
    lines : ndarray of complex, shape (H + 1, 3)
        Harmonics of the force on the tool along feed, normal, axis [N].
    variance : ndarray, shape (H + 1, 3)
        Of their real and imaginary parts each, scatter and zero [N^2].
    """

    conditions: Conditions
    lines: Complexes
    variance: Floats

    @property
    def harmonics(self) -> int:
        """H."""
        return len(self.lines) - 1


@dataclass(eq=False)
class Problem:
    """Residuals of R recordings under some terms.

    Parameters
    ----------
    tool : Tool
        Its form, and its helix when that is not sought.
    cuts : sequence of Cut
        The recordings.
    terms : Terms
        Of the model.
    left_out : ndarray, shape (3,)
        Variance of what the model leaves out of each direction's harmonics [N^2].
    zero : float
        Variance of a zero beyond what the recordings say of theirs [N^2].
    """

    tool: Tool
    cuts: Sequence[Cut]
    terms: Terms
    left_out: Floats
    zero: float = 0.0
    _spectra: dict[tuple[float, float, float], list[Complexes]] = field(default_factory=dict)
    _teeth: dict[float, list[Complexes]] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Of the nonlinear unknowns, in their order."""
        found = [f"phase{k}" for k in range(len(self.cuts))]
        if self.terms.runout and self.tool.flutes > 1:
            found += ["along"] if self.tool.flutes == 2 else ["along", "across"]
        found += ["tan_helix"] * self.terms.helix
        if self.terms.modes:
            found += [f"log_{what}{k}" for what in ("natural", "damping") for k in range(3)]
        return found

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Of the nonlinear unknowns."""
        feed = max(cut.conditions.f_z for cut in self.cuts)
        tips = [cut.conditions.speed * self.tool.flutes for cut in self.cuts]
        highest = max(cut.conditions.speed * cut.harmonics for cut in self.cuts)
        steepest = float(np.tan(np.radians(LIMIT_DEG)))
        hand = (-steepest, 0.0) if self.tool.helix < 0 else (0.0, steepest)
        limits = {
            "phase": (-1e3, 1e3), "along": (-4 * feed, 4 * feed), "across": (-4 * feed, 4 * feed),
            "tan_helix": hand, "log_damping": tuple(np.log(DAMPING)),
            "log_natural": (np.log(SLOWEST * min(tips)), np.log(FASTEST * highest)),
        }  # fmt: skip
        low, high = np.array([limits[name.rstrip("0123456789")] for name in self.names]).T
        return low, high

    @property
    def scale(self) -> Floats:
        """Changes of the nonlinear unknowns that matter alike."""
        feed = float(np.mean([cut.conditions.f_z for cut in self.cuts]))
        sizes = {
            "phase": 0.1, "along": 0.1 * feed, "across": 0.1 * feed, "tan_helix": 0.1,
            "log_natural": 0.1, "log_damping": 0.5,
        }  # fmt: skip
        return np.array([sizes[name.rstrip("0123456789")] for name in self.names])

    def geometry(self, x: Floats) -> Geometry:
        """Of the tool at ``x``."""
        values = dict(zip(self.names, x.tolist(), strict=True))
        helix = float(np.arctan(values["tan_helix"])) if self.terms.helix else self.tool.helix
        return Geometry(
            along=values.get("along", 0.0), across=values.get("across", 0.0), helix=helix
        )

    def modes(self, x: Floats) -> tuple[Floats, Floats] | None:
        """Natural frequencies [Hz] and damping [1] of the three directions, shape (3,) each."""
        if not self.terms.modes:
            return None
        return np.exp(x[-6:-3]), np.exp(x[-3:])

    def spectra(self, geometry: Geometry) -> list[Complexes]:
        """Columns of each recording before modes and phases; the last few are remembered."""
        key = (geometry.along, geometry.across, geometry.helix)
        if key not in self._spectra:
            if len(self._spectra) > 8:
                self._spectra.clear()
            each = [columns(self.tool, geometry, c.conditions, c.harmonics) for c in self.cuts]
            if self.linear > COEFFICIENTS:
                single = self._single(geometry)
                each = [np.concatenate(pair, axis=2) for pair in zip(each, single, strict=True)]
            self._spectra[key] = each
        return self._spectra[key]

    def _single(self, geometry: Geometry) -> list[Complexes]:
        """Columns of single teeth's edges, which runout does not change."""
        if geometry.helix not in self._teeth:
            self._teeth.clear()
            self._teeth[geometry.helix] = [
                tooth_columns(self.tool, geometry, c.conditions, c.harmonics) for c in self.cuts
            ]
        return self._teeth[geometry.helix]

    def designs(self, x: Floats) -> list[Complexes]:
        """Columns of each recording as it shows them, shape (H + 1, 3, D) each."""
        modes = self.modes(x)
        found = []
        for k, (one, raw) in enumerate(zip(self.cuts, self.spectra(self.geometry(x)), strict=True)):
            shown = turned(raw, float(x[k]))
            if modes is not None:
                frequencies = orders(one.harmonics) * one.conditions.speed
                shown = shown * transfer(frequencies, *modes)[:, :, None]
            found.append(shown)
        return found

    def weights(self) -> list[Floats]:
        """One over the standard deviation of each harmonic, by recording."""
        found = []
        for one in self.cuts:
            variance = one.variance.copy()
            variance[0] += self.zero
            variance[1:] += self.left_out
            found.append(1 / np.sqrt(variance))
        return found

    def rows(self, parts: Sequence[Complexes], weights: Sequence[Floats]) -> Floats:
        """Weighted real and imaginary parts of all recordings, one under the other; (N, ...)."""
        found = []
        for part, weight in zip(parts, weights, strict=True):
            scaled = part * weight.reshape(weight.shape + (1,) * (part.ndim - 2))
            flat = scaled.reshape((-1,) + part.shape[2:])
            found += [flat.real, flat.imag[3:]]  # a mean has no imaginary part
        return np.concatenate(found)

    @property
    def linear(self) -> int:
        """D, of the unknowns that the forces are linear in."""
        return COEFFICIENTS + 3 * (self.tool.flutes - 1) * self.terms.teeth

    def solved(self, x: Floats) -> "Solved":
        """The best coefficients at ``x``."""
        weights = self.weights()
        table = self.rows(self.designs(x), weights)
        measured = self.rows([one.lines for one in self.cuts], weights)
        prior = np.array(PRIOR + PRIOR[3:] * (self.linear // 3 - 2))
        table = np.concatenate([table, np.diag(1 / prior)])
        measured = np.concatenate([measured, np.zeros(self.linear)])
        length = np.linalg.norm(table, axis=0)
        base, triangle = np.linalg.qr(table / length)
        values = np.linalg.lstsq(triangle, base.T @ measured, rcond=1e-13)[0] / length
        return Solved(values=values, residuals=measured - table @ values, base=base, table=table)

    def slopes(self, x: Floats, values: Floats, first: int | None = None) -> Floats:
        """Of the modelled rows over the nonlinear unknowns, coefficients held; shape (N, P).

        With ``first`` over that many of them only.
        """
        weights, step = self.weights(), STEP * self.scale
        here = [one @ values for one in self.designs(x)]
        found = []
        for k, name in enumerate(self.names[:first]):
            if name.startswith("phase"):
                change = [np.zeros_like(one) for one in here]
                change[k] = 1j * np.arange(len(here[k]))[:, None] * here[k]
            else:
                beside = x.copy()
                beside[k] += step[k]
                change = [
                    (there @ values - one) / step[k]
                    for there, one in zip(self.designs(beside), here, strict=True)
                ]
            found.append(self.rows(change, weights))
        slopes = np.stack(found, axis=1)
        return np.concatenate([slopes, np.zeros((self.linear, slopes.shape[1]))])


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """Linear unknowns at a place of the nonlinear ones.

    Parameters
    ----------
    values : ndarray, shape (D,)
        Coefficients [N/m^2], [N/m].
    residuals : ndarray, shape (N + D,)
        Measured less modelled, weighted; the last D belong to the prior.
    base, table : ndarray, shape (N + D, D)
        Orthonormal base of the columns, and the columns.
    """

    values: Floats
    residuals: Floats
    base: Floats
    table: Floats

    @property
    def cost(self) -> float:
        """Half of the sum of squares."""
        return 0.5 * float(self.residuals @ self.residuals)
