"""Identified cutting-force model: mechanics plus a waveform residual learnt over spindle angle.

Under the same tool, speed, depth and immersion the mechanics leave the same residual, whatever its
cause: a mode that the channels do not have, an edge force that is not linear, a chip that is no
sine.  It is affine in the feed per tooth, R(theta) = A(theta) f_z + B(theta), where the training
recordings have two feeds or more under such conditions, and B(theta) where they have one.  For
other conditions there is none.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats
from pipeline.schema.cutting import (
    CutConditions,
    ForceSpread,
    Harmonics,
    StoredCutModel,
    StoredResidual,
    ToolGeometry,
)
from pipeline.schema.store import structured
from pipeline.submodels.cutting.waveform import (
    STRAIGHT,
    ChipShape,
    CutHarmonics,
    columns,
    phase_shift,
    rotated,
    tooth_columns,
    transfer,
)

SPEED = 0.01
"""Share by which equal speeds differ at most [1]: their harmonics meet the same modes."""
ALIKE = 0.01
"""Difference of equal depths of cut, as a share [1], and of equal angles [rad], at most."""
FEEDS = 1.1
"""Ratio from which two feeds count as different [1]."""
BEYOND = 2.0
"""Factor beyond the trained feeds, up and down, up to which the residual applies [1]."""
KEPT = 64
"""Greatest number of conditions whose departures of the draws are kept."""
FURTHER = 0.5
"""Extrapolation of the straight line over the feed, as a share of the trained range [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveformResidual:
    """Residual of the mechanics under one set of conditions."""

    conditions: CutConditions
    """Conditions of the first of its recordings."""
    feeds: tuple[float, ...]
    """Feeds per tooth f_z of its recordings [m]."""
    constant: Complexes
    slope: Complexes
    """Harmonics B [N] and A [N/m], the first tooth at the angle 0; shape (H + 1, 3)."""

    def covers(self, other: CutConditions) -> bool:
        """Whether it holds for ``other`` conditions."""
        near = min(self.feeds) / BEYOND <= other.f_z <= max(self.feeds) * BEYOND
        return near and same_but_feed(self.conditions, other)

    def at(self, f_z: float, harmonics: int) -> Complexes:
        """Harmonics of the residual at a feed per tooth [m]; shape (H + 1, 3) [N]."""
        residual = np.zeros((harmonics + 1, 3), dtype=np.complex128)
        least, most = min(self.feeds), max(self.feeds)
        margin = FURTHER * (most - least)
        feed = min(max(f_z, least - margin), most + margin)
        here = (self.constant + self.slope * feed)[: harmonics + 1]
        residual[: len(here)] = here
        return residual


def same_but_feed(one: CutConditions, other: CutConditions) -> bool:
    """Whether conditions differ in the feed alone."""
    return (
        one.flutes == other.flutes
        and abs(one.speed / other.speed - 1) < SPEED
        and abs(one.a_p / other.a_p - 1) < ALIKE
        and abs(one.phi_st - other.phi_st) < ALIKE
        and abs(one.phi_ex - other.phi_ex) < ALIKE
    )


def waveform_residuals(
    cuts: Sequence[CutHarmonics],
    modelled: Sequence[Complexes],
    phases: Sequence[float],
    zero: float,
) -> list[WaveformResidual]:
    """Residuals of a model on recordings, one for each set of conditions.

    ``modelled`` are the harmonics of each recording at its phase, shape (H + 1, 3) [N], ``phases``
    the angle of the first tooth in each [rad], ``zero`` the variance of the zeros beyond that
    stated with the recordings [N^2].
    """
    groups: list[list[int]] = []
    for k, cut in enumerate(cuts):
        alike = (g for g in groups if same_but_feed(cuts[g[0]].conditions, cut.conditions))
        home = next(alike, None)
        if home is None:
            groups.append(home := [])
        home.append(k)
    residuals = [
        rotated(_clear(cut, cut.lines - model, zero), -phase)
        for cut, model, phase in zip(cuts, modelled, phases, strict=True)
    ]
    return [_residual_of([cuts[k] for k in g], [residuals[k] for k in g]) for g in groups]


def _clear(cut: CutHarmonics, residual: Complexes, zero: float) -> Complexes:
    """``residual`` shrunk towards 0 by the share of scatter in it (James and Stein 1961)."""
    square, variance = np.abs(residual) ** 2, cut.variance.copy()
    variance[0] += zero
    variance[1:] *= 2  # of real and imaginary part together
    share = 1 - variance / np.maximum(square, 1e-300)
    return np.asarray(residual * np.maximum(share, 0.0))


def _residual_of(cuts: Sequence[CutHarmonics], residuals: Sequence[Complexes]) -> WaveformResidual:
    """Affine regression of residuals under the same conditions over their feeds."""
    size = min(len(one) for one in residuals)
    feeds = np.array([cut.conditions.f_z for cut in cuts])
    table = np.stack([one[:size] for one in residuals]).reshape(len(residuals), -1)
    if feeds.max() < FEEDS * feeds.min():
        constant, slope = table.mean(axis=0), np.zeros(table.shape[1], dtype=np.complex128)
    else:
        design = np.stack([np.ones_like(feeds), feeds], axis=1)
        constant, slope = np.linalg.pinv(design) @ table
    return WaveformResidual(
        conditions=cuts[0].conditions, feeds=tuple(feeds.tolist()),
        constant=constant.reshape(size, 3), slope=slope.reshape(size, 3),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class CutModel:
    """Cutting-force model of a tool in a material."""

    tool: Tool
    """Shape of the tool."""
    geometry: ToolGeometry
    """Its runout and helix."""
    values: Floats
    """Six constants of the law [N/m^2], [N/m], and edge forces of single teeth, as
    :func:`pipeline.submodels.cutting.waveform.columns` has them; shape (D,)."""
    natural: Floats | None
    damping: Floats | None
    """Natural frequency [Hz] and damping [1] of the channels for feed, normal and axis; (3,)."""
    left_out: Floats
    """Variance of the model error of each direction's harmonics [N^2]; shape (3,)."""
    residuals: Sequence[WaveformResidual] = ()
    """Residuals under trained conditions; none where they were not kept."""
    spread: ForceSpread | None = None
    """Laws of the chip that the records allow, and what intervals are made of; none without."""
    chip: ChipShape = STRAIGHT
    """Chip shape of the force law."""
    line: Floats | None = None
    """Its line over the recorded cuts [N/m^2], [N/m]; that of ``values`` by default; (6,)."""
    _departures: dict[tuple[CutConditions, int], Complexes] = field(
        default_factory=dict, repr=False
    )

    def law_departures(self, conditions: CutConditions, harmonics: int) -> Complexes:
        """Harmonics of the forces by each law beyond those of the model's; (D, H + 1, 3) [N].

        A straight line is one through the recorded cuts, and stands for the mean of the laws' lines
        there.  One of zeros without a spread.  The last few are kept.
        """
        key = (conditions, harmonics)
        found = self._departures.get(key)
        if found is None:
            found = self._departed(conditions, harmonics)
            if len(self._departures) >= KEPT:
                self._departures.clear()
            self._departures[key] = found
        return found

    def _departed(self, conditions: CutConditions, harmonics: int) -> Complexes:
        if self.spread is None:
            return np.zeros((1, harmonics + 1, 3), dtype=np.complex128)

        def table(growth: float, exponent: float) -> Complexes:
            chip = ChipShape(growth=growth, exponent=exponent)
            return columns(self.tool, self.geometry, conditions, harmonics, chip)

        laws = self.spread.laws
        cutting = {m: table(0.0, m) for m in {m for law in laws for m in law.exponent}}
        edge = {growth: table(growth, 0.0)[..., 3:] for growth in {law.growth for law in laws}}
        own = self.values[:6] if self.chip != STRAIGHT else np.array(self.spread.line)
        here = table(*self.chip) @ own
        forces = [
            sum(cutting[m][..., k] * law.cutting[k] for k, m in enumerate(law.exponent))
            + edge[law.growth] @ np.array(law.edge) - here
            for law in laws
        ]  # fmt: skip
        return np.asarray(forces) * self.shown(conditions, harmonics)

    def mechanics(self, conditions: CutConditions, harmonics: int) -> Complexes:
        """Harmonics of the forces on the tool by mechanics alone; shape (H + 1, 3) [N]."""
        forces = self.coefficient_columns(conditions, harmonics) @ self.values[:6]
        if len(self.values) == 6:  # no edge forces of single teeth
            return np.asarray(forces)
        table = tooth_columns(self.tool, self.geometry, conditions, harmonics, self.chip)
        teeth = table @ self.values[6:]
        return np.asarray(forces + teeth * self.shown(conditions, harmonics))

    def coefficient_columns(self, conditions: CutConditions, harmonics: int) -> Complexes:
        """Harmonics of the forces for each of the six constants; shape (H + 1, 3, 6)."""
        table = columns(self.tool, self.geometry, conditions, harmonics, self.chip)
        return np.asarray(table * self.shown(conditions, harmonics)[:, :, None])

    def shown(self, conditions: CutConditions, harmonics: int) -> Complexes:
        """Channel response to a force at each harmonic; shape (H + 1, 3) [1]."""
        if self.natural is None or self.damping is None:
            return np.ones((harmonics + 1, 3), dtype=np.complex128)
        frequencies = np.arange(harmonics + 1, dtype=np.float64) * conditions.speed
        return transfer(frequencies, self.natural, self.damping)

    def residual(self, conditions: CutConditions) -> WaveformResidual | None:
        """Waveform residual that applies under these conditions, if any."""
        return next((one for one in self.residuals if one.covers(conditions)), None)

    def predicted(
        self, conditions: CutConditions, harmonics: int, *, mechanics_only: bool = False
    ) -> Complexes:
        """Harmonics of the forces on the tool; shape (H + 1, 3) [N]."""
        forces = self.mechanics(conditions, harmonics)
        residual = None if mechanics_only else self.residual(conditions)
        return forces if residual is None else forces + residual.at(conditions.f_z, harmonics)

    def beside(self, cut: CutHarmonics, *, mechanics_only: bool = False) -> Complexes:
        """Predicted harmonics of a recording, rotated to its phase; shape (H + 1, 3) [N]."""
        model = self.predicted(cut.conditions, cut.harmonics, mechanics_only=mechanics_only)
        return rotated(model, phase_shift(model, cut.lines, self.weight(cut)))

    def weight(self, cut: CutHarmonics) -> Floats:
        """Inverse standard deviation of a recording's harmonics about the model [1/N]."""
        variance = cut.variance.copy()
        variance[1:] += self.left_out
        return np.asarray(1 / np.sqrt(variance))


def plain_model(tool: Tool, coefficients: Floats) -> CutModel:
    """Mechanics of a sharp, round, straight-edged tool: no helix, runout or mode of a channel.

    ``coefficients`` are those of the linear-edge model [N/m^2], [N/m]; shape (6,).
    """
    return CutModel(
        tool=replace(tool, helix_deg=0.0), geometry=ToolGeometry(), values=coefficients,
        natural=None, damping=None, left_out=np.zeros(3),
    )  # fmt: skip


def stored(model: CutModel) -> StoredCutModel:
    """The model as it is stored, in full precision."""
    return StoredCutModel(
        tool=asdict(model.tool), geometry=model.geometry, values=tuple(model.values.tolist()),
        natural_Hz=None if model.natural is None else tuple(model.natural.tolist()),
        damping=None if model.damping is None else tuple(model.damping.tolist()),
        left_out_N2=tuple(model.left_out.tolist()), spread=model.spread,
        growth_m=model.chip.growth, exponent=model.chip.exponent,
        line=() if model.line is None else tuple(model.line.tolist()),
        residuals=tuple(
            StoredResidual(conditions=one.conditions, feeds_m=one.feeds,
                           constant_N=_pairs(one.constant), slope_N_m=_pairs(one.slope))
            for one in model.residuals
        ),
    )  # fmt: skip


def restored(document: StoredCutModel) -> CutModel:
    """The model that :func:`stored` wrote; ValueError when its tool is none."""
    natural, damping = document.natural_Hz, document.damping
    return CutModel(
        tool=structured(document.tool, Tool, "prediction.tool"), geometry=document.geometry,
        values=np.array(document.values),
        natural=None if natural is None else np.array(natural),
        damping=None if damping is None else np.array(damping),
        left_out=np.array(document.left_out_N2), spread=document.spread,
        chip=ChipShape(growth=document.growth_m, exponent=document.exponent),
        line=np.array(document.line) if document.line else None,
        residuals=[
            WaveformResidual(conditions=one.conditions, feeds=one.feeds_m,
                             constant=_complex(one.constant_N), slope=_complex(one.slope_N_m))
            for one in document.residuals
        ],
    )  # fmt: skip


def _pairs(values: Complexes) -> Harmonics:
    return tuple(tuple((one.real, one.imag) for one in row) for row in values.tolist())


def _complex(pairs: Harmonics) -> Complexes:
    values = np.array(pairs)
    return np.asarray(values[..., 0] + 1j * values[..., 1])
