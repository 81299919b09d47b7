"""Weighted least-squares problem of a force waveform over the spindle's revolution.

Forces on the tool are linear in the six coefficients (:mod:`pipeline.cutting.force.waveform`) and
in the deviation of single teeth's edge forces from the mean of all, as worn or differently ground
teeth show it.  Runout and helix shape the forces; each channel of the dynamometer shows them
through its own mode, 1 / (1 - r^2 + 2 i zeta r) at r = f / f_n (Girardin, Remond and Rigal 2010).

The unknowns that shape the forces (phases, runout, helix, modes of the channels) are few and
nonlinear; the coefficients follow from them by linear least squares (variable projection, Golub and
Pereyra 1973, with Kaufman's Jacobian).  The weights hold three variances: the scatter of each
harmonic over the revolutions, the zero of each recording, and the model error of each channel's
harmonics, which is estimated from the residuals.  A mean force thus counts for what it is worth:
modes do not change it, and where the zero was measured the coefficients follow the means first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from pipeline.cutting.force.force_law import REFERENCE
from pipeline.cutting.force.waveform import basis
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.cutting import CutConditions, ToolGeometry
from pipeline.schema.si import DEGREE, UM

COEFFICIENTS = 6
"""Cutting-force coefficients of the linear-edge model."""
ANGLES, MORE_ANGLES = 256, 512
"""Angles of a revolution at which the model is evaluated; more where an edge enters at once."""
AT_ONCE = 0.1
"""Lag of an edge over the axial depth below which the whole edge enters at once [rad]."""
SLICE = 0.04
"""Lag over one slice of the edge, at most [rad]; the effect of runout then errs by 1e-4."""
MOST_SLICES = 48
"""Slices of the edge, at most."""
LIMIT_DEG = 60.0
"""Greatest helix angle [deg]."""


class ChipShape(NamedTuple):
    """Shape of a chip law (:mod:`pipeline.cutting.force.force_law`), as waveforms show it."""

    growth: float = 0.0
    """Thickness h_0 over which the edge's force grows [m]; 0: it is there at once, below 0: along
    a straight line up to -h_0."""
    exponent: float = 0.0
    """Exponent m of the size effect, of all directions [1]."""


STRAIGHT = ChipShape()
"""K_c h + K_e."""


def shaped(tool: Tool, geometry: ToolGeometry) -> Tool:
    """The tool with an identified runout and helix."""
    offset = complex(geometry.along, geometry.across)
    return replace(
        tool, runout_um=min(abs(offset) / UM, 2000.0),
        runout_deg=float(np.degrees(np.angle(offset))), helix_deg=geometry.helix / DEGREE,
    )  # fmt: skip


def columns(
    tool: Tool, geometry: ToolGeometry, conditions: CutConditions, harmonics: int,
    chip: ChipShape = STRAIGHT,
) -> Complexes:  # fmt: skip
    """Harmonics of the forces on the tool for each coefficient.

    ``harmonics`` is the highest one H.  Shape (H + 1, 3, 6): [m^2] for cutting, [m] for edge
    coefficients.
    """
    return _lines(_forces(shaped(tool, geometry), conditions, chip), harmonics)


def tooth_columns(
    tool: Tool, geometry: ToolGeometry, conditions: CutConditions, harmonics: int,
    chip: ChipShape = STRAIGHT,
) -> Complexes:  # fmt: skip
    """Harmonics of single teeth's edge forces beyond the mean of all teeth.

    A tooth's edge acts over the whole arc here, even where runout leaves it no chip.

    Parameters are those of :func:`columns`.

    Shape (H + 1, 3, 3 (N - 1)): K_te, K_re, K_ae [m] of each tooth but the first, tooth by tooth;
    those of the first make their sum zero.
    """
    single = replace(shaped(tool, geometry), flutes=1, runout_um=0.0)
    edge = _lines(_forces(single, conditions, chip)[..., 3:], harmonics)
    lags = 2 * np.pi / tool.flutes * np.arange(tool.flutes)
    phasors = np.exp(-1j * np.arange(harmonics + 1)[:, None] * lags)
    others = phasors[:, 1:] - phasors[:, :1]
    teeth = edge[:, :, None, :] * others[:, None, :, None]
    return teeth.reshape(harmonics + 1, 3, -1)


def _forces(tool: Tool, conditions: CutConditions, chip: ChipShape) -> Floats:
    """Forces over a revolution for each coefficient; shape (T, 3, 6)."""
    lag = abs(np.tan(tool.helix)) * conditions.a_p / tool.radius
    count = ANGLES if lag > AT_ONCE else MORE_ANGLES
    forces = basis(
        tool, f_z=conditions.f_z, a_p=conditions.a_p, phi_st=conditions.phi_st,
        phi_ex=conditions.phi_ex, angles=(np.arange(count) + 0.5) * (2 * np.pi / count),
        slices=min(2 + int(lag / SLICE), MOST_SLICES), m_c=chip.exponent, growth=chip.growth,
    )[:, :3]  # fmt: skip
    if chip.exponent > 0.0:
        forces[..., :3] *= REFERENCE**chip.exponent
    return forces


def _lines(values: Floats, harmonics: int) -> Complexes:
    """Harmonics of values at mid-steps, where no tooth both enters and leaves; (H + 1, ...)."""
    spectrum = np.fft.rfft(values, axis=0)[: harmonics + 1] * (2 / len(values))
    spectrum[0] /= 2
    return rotated(spectrum, -np.pi / len(values))


def mean_squares(lines: Complexes) -> Floats:
    """Mean square over a revolution by direction [N^2]; shape (3,)."""
    power = np.abs(lines) ** 2
    power[1:] /= 2
    return np.asarray(power.sum(axis=0))


def rotated(spectrum: Complexes, phase: float) -> Complexes:
    """Harmonics of a revolution in which the first tooth is ``phase`` [rad] ahead."""
    phasors = np.exp(1j * phase * np.arange(len(spectrum)))
    return spectrum * phasors.reshape((-1,) + (1,) * (spectrum.ndim - 1))


def transfer(frequencies: Floats, natural: Floats, damping: Floats) -> Complexes:
    """Frequency response of each channel to a force; shape (H + 1, 3).

    ``frequencies`` (H + 1,) of the harmonics [Hz]; ``natural`` [Hz] and ``damping`` [1] (3,) of the
    channels' modes.
    """
    r = frequencies[:, None] / natural
    return np.asarray(1 / (1 - r**2 + 2j * damping * r))


PRIOR = (1e11, 1e11, 1e11, 1e7, 1e7, 1e7)
"""Prior standard deviations of the coefficients about 0 [N/m^2], [N/m]: far above those of any
material, so that they matter only where the recordings are silent."""
SLOWEST = 0.5
"""Least natural frequency of a channel, over the tooth passing frequency [1]."""
FASTEST = 4.0
"""Greatest natural frequency of a channel, over the highest harmonic [1]."""
ROUNDEST = 3e-5
"""Greatest thickness over which an edge's force grows [m]: edges of milling are honed to less."""
STEEPEST = 0.4
"""Greatest exponent of the size effect [1]: Kienzle's, with the edge force in it."""
DAMPING = (0.005, 1.0)
"""Bounds of a channel's damping ratio [1]."""
STEP = 0.02
"""Step of the nonlinear unknowns in difference quotients, as a share of their scale [1]."""


EdgeGrowth = Literal["at once", "exponential", "ramp"]


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Terms of the model beyond the six coefficients."""

    runout: bool = True
    helix: bool = False
    modes: bool = False
    teeth: bool = False
    """Runout and helix of the tool, modes of the channels, edges of single teeth."""
    edge: EdgeGrowth = "at once"
    """Growth of the edge force with the chip; with one, the cutting force has a size effect."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CutHarmonics:
    """Harmonics of one recording's mean revolution, with their variance."""

    conditions: CutConditions
    """Conditions with the measured spindle speed."""
    lines: Complexes
    """Harmonics of the force on the tool along feed, normal, axis [N]; shape (H + 1, 3)."""
    variance: Floats
    """Variance of their real and imaginary parts each, scatter and zero [N^2]; shape (H + 1, 3)."""

    @property
    def harmonics(self) -> int:
        """Highest harmonic H."""
        return len(self.lines) - 1


@dataclass(eq=False)
class Problem:
    """Residuals of R recordings under some terms."""

    tool: Tool
    """Shape of the tool, and its helix where that is given."""
    cuts: Sequence[CutHarmonics]
    """The recordings."""
    terms: Terms
    """Terms of the model."""
    left_out: Floats
    """Variance of the model error of each direction's harmonics [N^2]; shape (3,)."""
    zero: float = 0.0
    """Variance of the zeros beyond that stated with the recordings [N^2]."""
    _spectra: dict[tuple[float, ...], list[Complexes]] = field(default_factory=dict)
    _teeth: dict[tuple[float, ...], list[Complexes]] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the nonlinear unknowns, in their order."""
        names = [f"phase{k}" for k in range(len(self.cuts))]
        if self.terms.runout and self.tool.flutes > 1:
            names += ["along"] if self.tool.flutes == 2 else ["along", "across"]
        names += ["tan_helix"] * self.terms.helix
        names += ["growth", "exponent"] * (self.terms.edge != "at once")
        if self.terms.modes:
            names += [f"log_{what}{k}" for what in ("natural", "damping") for k in range(3)]
        return names

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of the nonlinear unknowns."""
        feed = max(cut.conditions.f_z for cut in self.cuts)
        tips = [cut.conditions.speed * self.tool.flutes for cut in self.cuts]
        highest = max(cut.conditions.speed * cut.harmonics for cut in self.cuts)
        steepest = float(np.tan(np.radians(LIMIT_DEG)))
        hand = (-steepest, 0.0) if self.tool.helix < 0 else (0.0, steepest)
        limits = {
            "phase": (-1e3, 1e3), "along": (-4 * feed, 4 * feed), "across": (-4 * feed, 4 * feed),
            "tan_helix": hand, "log_damping": tuple(np.log(DAMPING)),
            "growth": (0.0, ROUNDEST), "exponent": (0.0, STEEPEST),
            "log_natural": (np.log(SLOWEST * min(tips)), np.log(FASTEST * highest)),
        }  # fmt: skip
        low, high = np.array([limits[name.rstrip("0123456789")] for name in self.names]).T
        return low, high

    @property
    def scale(self) -> Floats:
        """Changes of the nonlinear unknowns that matter equally."""
        feed = float(np.mean([cut.conditions.f_z for cut in self.cuts]))
        sizes = {
            "phase": 0.1, "along": 0.1 * feed, "across": 0.1 * feed, "tan_helix": 0.1,
            "log_natural": 0.1, "log_damping": 0.5, "growth": 1e-6, "exponent": 0.05,
        }  # fmt: skip
        return np.array([sizes[name.rstrip("0123456789")] for name in self.names])

    def geometry(self, x: Floats) -> ToolGeometry:
        """Runout and helix at ``x``."""
        values = dict(zip(self.names, x.tolist(), strict=True))
        helix = float(np.arctan(values["tan_helix"])) if self.terms.helix else self.tool.helix
        return ToolGeometry(
            along=values.get("along", 0.0), across=values.get("across", 0.0), helix=helix
        )

    def chip(self, x: Floats) -> ChipShape:
        """Shape of the law of the chip at ``x``."""
        if self.terms.edge == "at once":
            return STRAIGHT
        first = self.names.index("growth")
        # along a straight line up to 2 h_0 as much force is missing as where it grows over h_0
        sign = -2.0 if self.terms.edge == "ramp" else 1.0
        return ChipShape(growth=sign * float(x[first]), exponent=float(x[first + 1]))

    def modes(self, x: Floats) -> tuple[Floats, Floats] | None:
        """Natural frequencies [Hz] and damping [1] of the three directions, shape (3,) each."""
        if not self.terms.modes:
            return None
        return np.exp(x[-6:-3]), np.exp(x[-3:])

    def spectra(self, geometry: ToolGeometry, chip: ChipShape) -> list[Complexes]:
        """Columns of each recording before modes and phases; the last few are kept."""
        key = (geometry.along, geometry.across, geometry.helix, *chip)
        if key not in self._spectra:
            if len(self._spectra) > 8:
                self._spectra.clear()
            spectra = [
                columns(self.tool, geometry, c.conditions, c.harmonics, chip) for c in self.cuts
            ]
            if self.linear > COEFFICIENTS:
                single = self._single(geometry, chip)
                both = zip(spectra, single, strict=True)
                spectra = [np.concatenate(pair, axis=2) for pair in both]
            self._spectra[key] = spectra
        return self._spectra[key]

    def _single(self, geometry: ToolGeometry, chip: ChipShape) -> list[Complexes]:
        """Columns of single teeth's edges, which runout does not change."""
        key = (geometry.helix, chip.growth)
        if key not in self._teeth:
            self._teeth.clear()
            self._teeth[key] = [
                tooth_columns(self.tool, geometry, c.conditions, c.harmonics, chip)
                for c in self.cuts
            ]
        return self._teeth[key]

    def designs(self, x: Floats, chip: ChipShape | None = None) -> list[Complexes]:
        """Columns of each recording in its channels, (H + 1, 3, D), by the law of ``chip`` at x."""
        modes = self.modes(x)
        designs = []
        spectra = self.spectra(self.geometry(x), self.chip(x) if chip is None else chip)
        pairs = zip(self.cuts, spectra, strict=True)
        for k, (cut, spectrum) in enumerate(pairs):
            shown = rotated(spectrum, float(x[k]))
            if modes is not None:
                frequencies = np.arange(cut.harmonics + 1, dtype=np.float64) * cut.conditions.speed
                shown = shown * transfer(frequencies, *modes)[:, :, None]
            designs.append(shown)
        return designs

    def weights(self) -> list[Floats]:
        """Inverse standard deviation of each harmonic, by recording."""
        weights = []
        for cut in self.cuts:
            variance = cut.variance.copy()
            variance[0] += self.zero
            variance[1:] += self.left_out
            weights.append(1 / np.sqrt(variance))
        return weights

    def rows(self, parts: Sequence[Complexes], weights: Sequence[Floats]) -> Floats:
        """Weighted real and imaginary parts of all recordings, one under the other; (N, ...)."""
        rows = []
        for part, weight in zip(parts, weights, strict=True):
            scaled = part * weight.reshape(weight.shape + (1,) * (part.ndim - 2))
            flat = scaled.reshape((-1,) + part.shape[2:])
            rows += [flat.real, flat.imag[3:]]  # a mean has no imaginary part
        return np.concatenate(rows)

    @property
    def linear(self) -> int:
        """Number D of unknowns that the forces are linear in."""
        return COEFFICIENTS + 3 * (self.tool.flutes - 1) * self.terms.teeth

    def solved(self, x: Floats) -> "Solved":
        """The best coefficients at ``x``."""
        weights = self.weights()
        table = self.rows(self.designs(x), weights)
        measured = self.rows([cut.lines for cut in self.cuts], weights)
        prior = np.array(PRIOR + PRIOR[3:] * (self.linear // 3 - 2))
        table = np.concatenate([table, np.diag(1 / prior)])
        measured = np.concatenate([measured, np.zeros(self.linear)])
        length = np.linalg.norm(table, axis=0)
        base, triangle = np.linalg.qr(table / length)
        values = np.linalg.lstsq(triangle, base.T @ measured, rcond=1e-13)[0] / length
        return Solved(values=values, residuals=measured - table @ values, base=base, table=table)

    def slopes(self, x: Floats, values: Floats, first: int | None = None) -> Floats:
        """Derivatives of the modelled rows at fixed coefficients, (N, P), by ``first`` unknowns."""
        weights, step = self.weights(), STEP * self.scale
        here = [one @ values for one in self.designs(x)]
        changes = []
        for k, name in enumerate(self.names[:first]):
            if name.startswith("phase"):
                change = [np.zeros_like(one) for one in here]
                change[k] = 1j * np.arange(len(here[k]))[:, None] * here[k]
            else:
                shifted = x.copy()
                shifted[k] += step[k]
                change = [
                    (design_there @ values - one) / step[k]
                    for design_there, one in zip(self.designs(shifted), here, strict=True)
                ]
            changes.append(self.rows(change, weights))
        slopes = np.stack(changes, axis=1)
        return np.concatenate([slopes, np.zeros((self.linear, slopes.shape[1]))])


@dataclass(frozen=True, kw_only=True, eq=False)
class Solved:
    """Linear unknowns at given nonlinear ones."""

    values: Floats
    """Coefficients [N/m^2], [N/m]; shape (D,)."""
    residuals: Floats
    """Measured less modelled, weighted; the last D belong to the prior; shape (N + D,)."""
    base: Floats
    table: Floats
    """Orthonormal base of the columns, and the columns; shape (N + D, D)."""

    @property
    def cost(self) -> float:
        """Half of the sum of squares."""
        return 0.5 * float(self.residuals @ self.residuals)


PHASES = 720
"""Angles of a revolution that are tried as a phase."""


def phase_shift(model: Complexes, lines: Complexes, weight: Floats) -> float:
    """Phase [rad] by which ``model`` must be rotated to come nearest to ``lines``."""
    cross = ((weight**2) * np.conj(model) * lines).sum(axis=1)
    count = min(len(cross), PHASES // 2)
    padded = np.zeros(PHASES, dtype=np.complex128)
    padded[:count] = cross[:count]
    # sum of Re(p_h exp(-i h phase)) over a grid of phases
    similarity = np.real(np.fft.fft(padded))
    best = 2 * np.pi * float(np.argmax(similarity)) / PHASES
    order = np.arange(count)
    for _ in range(4):
        phasors = padded[:count] * np.exp(-1j * order * best)
        slope, bend = (order * phasors.imag).sum(), -((order**2) * phasors.real).sum()
        if bend >= 0:
            break
        best -= float(np.clip(slope / bend, -np.pi / PHASES, np.pi / PHASES))
    return best
