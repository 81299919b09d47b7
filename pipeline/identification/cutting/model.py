"""A cut as it was identified: what it says of a recording under given conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.conditions import Conditions
from pipeline.identification.cutting.fit import Fit, phase_of
from pipeline.identification.cutting.problem import Cut
from pipeline.identification.cutting.remainder import Remainder, remainders
from pipeline.identification.cutting.spectrum import (
    Geometry,
    columns,
    orders,
    tooth_columns,
    transfer,
    turned,
)

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class CutModel:
    """Everything that a prediction needs.

    Parameters
    ----------
    tool : Tool
        Its form.
    geometry : Geometry
        Its runout and helix.
    values : ndarray, shape (D,)
        Six coefficients [N/m^2], [N/m], and edges of single teeth, as
        :func:`pipeline.identification.cutting.spectrum.columns` has them.
    natural, damping : ndarray, shape (3,), optional
        Of the modes of the channels that show feed, normal and axis [Hz], [1].
    left_out : ndarray, shape (3,)
        Variance of what the model leaves out of each direction's harmonics [N^2].
    remainders : sequence of Remainder
        What is left over under trained conditions; none where it was not kept.
    """

    tool: Tool
    geometry: Geometry
    values: Floats
    natural: Floats | None
    damping: Floats | None
    left_out: Floats
    remainders: Sequence[Remainder] = ()

    @property
    def teeth(self) -> bool:
        """Whether edges of single teeth count."""
        return len(self.values) > 6

    def mechanics(self, conditions: Conditions, harmonics: int) -> Complexes:
        """Harmonics of the forces on the tool that mechanics say; shape (H + 1, 3) [N]."""
        shown = columns(self.tool, self.geometry, conditions, harmonics) @ self.values[:6]
        if self.teeth:
            single = tooth_columns(self.tool, self.geometry, conditions, harmonics)
            shown = shown + single @ self.values[6:]
        if self.natural is None or self.damping is None:
            return shown
        frequencies = orders(harmonics) * conditions.speed
        return shown * transfer(frequencies, self.natural, self.damping)

    def remainder(self, conditions: Conditions) -> Remainder | None:
        """What is left over under these conditions; None where nothing is known of it."""
        return next((one for one in self.remainders if one.covers(conditions)), None)

    def predicted(
        self, conditions: Conditions, harmonics: int, *, mechanics_only: bool = False
    ) -> Complexes:
        """Harmonics of the forces on the tool; shape (H + 1, 3) [N]."""
        found = self.mechanics(conditions, harmonics)
        over = None if mechanics_only else self.remainder(conditions)
        return found if over is None else found + over.at(conditions.f_z, harmonics)

    def beside(self, cut: Cut, *, mechanics_only: bool = False) -> Complexes:
        """Its prediction of a recording, turned to the recording's phase; shape (H + 1, 3)."""
        model = self.predicted(cut.conditions, cut.harmonics, mechanics_only=mechanics_only)
        return turned(model, phase_of(model, cut.lines, self.weight(cut)))

    def weight(self, cut: Cut) -> Floats:
        """One over the standard deviation of a recording's harmonics beside the model."""
        variance = cut.variance.copy()
        variance[1:] += self.left_out
        return np.asarray(1 / np.sqrt(variance))


def model_of(fit: Fit, *, over: bool) -> CutModel:
    """The model that a fit gives; with ``over`` what it leaves over is part of it."""
    problem, x = fit.problem, fit.x
    modes = problem.modes(x)
    phases = x[: len(problem.cuts)].tolist()
    return CutModel(
        tool=problem.tool, geometry=problem.geometry(x), values=fit.values,
        natural=None if modes is None else modes[0], damping=None if modes is None else modes[1],
        left_out=problem.left_out,
        remainders=remainders(problem.cuts, fit.modelled, phases, problem.zero) if over else (),
    )  # fmt: skip


def plain_model(tool: Tool, coefficients: Floats) -> CutModel:
    """Mechanics of a sharp, round, straight-edged tool: no helix, runout or mode of a channel.

    Parameters
    ----------
    tool : Tool
        Its form.
    coefficients : ndarray, shape (6,)
        [N/m^2], [N/m].
    """
    return CutModel(
        tool=replace(tool, helix_deg=0.0), geometry=Geometry(), values=coefficients,
        natural=None, damping=None, left_out=np.zeros(3),
    )  # fmt: skip


def stored(model: CutModel) -> dict[str, Any]:
    """The model as JSON, in SI, in full precision."""
    return {
        "tool": asdict(model.tool),
        "geometry": asdict(model.geometry),
        "values": model.values.tolist(),
        "natural_Hz": None if model.natural is None else model.natural.tolist(),
        "damping": None if model.damping is None else model.damping.tolist(),
        "left_out_N2": model.left_out.tolist(),
        "remainders": [
            {
                "conditions": asdict(one.conditions), "feeds_m": list(one.feeds),
                "constant_N": _pairs(one.constant), "slope_N_m": _pairs(one.slope),
            }
            for one in model.remainders
        ],
    }  # fmt: skip


def restored(document: Mapping[str, Any]) -> CutModel:
    """The model that :func:`stored` wrote."""
    natural, damping = document["natural_Hz"], document["damping"]
    return CutModel(
        tool=Tool(**document["tool"]),
        geometry=Geometry(**document["geometry"]),
        values=np.array(document["values"]),
        natural=None if natural is None else np.array(natural),
        damping=None if damping is None else np.array(damping),
        left_out=np.array(document["left_out_N2"]),
        remainders=[
            Remainder(
                conditions=Conditions(**one["conditions"]), feeds=tuple(one["feeds_m"]),
                constant=_complex(one["constant_N"]), slope=_complex(one["slope_N_m"]),
            )
            for one in document["remainders"]
        ],
    )  # fmt: skip


def _pairs(values: Complexes) -> list[list[list[float]]]:
    pairs: list[list[list[float]]] = np.stack([values.real, values.imag], axis=-1).tolist()
    return pairs


def _complex(pairs: Sequence[Sequence[Sequence[float]]]) -> Complexes:
    values = np.array(pairs)
    return np.asarray(values[..., 0] + 1j * values[..., 1])
