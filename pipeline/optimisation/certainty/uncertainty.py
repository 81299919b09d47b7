"""What is not certain of a part's loads: coefficients, runout, axial depth, and the model itself.

A coefficient of a tool is

    K = K_mean max(0, 1 + s z_source) + L z,

with z standard normal, z_source common to all tools whose coefficients come from one source.

- Identified coefficients have the intervals and correlations of the fit, and no common part.  One
  that the records did not determine has the value that the fit took and a standard deviation as
  great as that, or as a tenth of the tangential one: zero, which nominal loads take, is among it.
- Others' measurements and catalogues err in the material and the edge above all, which moves all
  coefficients together: of the variance 4 / 5 is common, 1 / 5 each coefficient's own.

Runout belongs to a mounting.  A tool table speaks of the mounting that is to cut, so that its size
stands; which tooth stands out nobody knows.  What was identified is of the mounting that was
recorded: the next one has its size, within its interval, at any angle, and an offset of its own of
``certainty.runout_um`` on top.  Without either there is that offset alone; its size is Rayleigh's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.force_law import N_MM, N_MM2, ForceLaw
from pipeline.cutting.tool import UM, Tool
from pipeline.optimisation.certainty.identified_spread import (
    correlation,
    fitted_coefficients,
    interval,
    model_spread,
    root,
)
from pipeline.optimisation.settings import Certainty
from pipeline.twin.cut_coefficients import COEFFICIENTS, ToolCoefficients

Floats = NDArray[np.float64]

NORMAL = 1.959963984540054
"""Standard deviations of half a 95 % interval."""
COMMON, OWN = np.sqrt(0.8), np.sqrt(0.2)
"""Parts of the standard deviation that coefficients of one source share, and each one's own."""
BESIDE = 0.1
"""Standard deviation of what was not determined, at least, over the tangential coefficient."""
CHIP = 5e-5
"""Thickness by which edge coefficients are beside cutting ones [m]."""
SCALES = np.array([N_MM2] * 3 + [N_MM] * 3)


@dataclass(frozen=True, kw_only=True)
class Uncertain:
    """One quantity that is not certain, for people: what, its value, its spread, where from."""

    what: str
    value: str
    spread: str
    source: str


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolUncertainty:
    """What is drawn of one tool.

    Parameters
    ----------
    mean : ndarray, shape (6,)
        Of the coefficients, SI.
    own : ndarray, shape (6, 6)
        L, root of their own covariance.
    source : int
        Which common scale they have, -1 for none.
    common : float
        s, its standard deviation [1].
    runout, runout_sd : float
        Size of the offset that is known of [m]; its angle is not.
    mounting : float
        Standard deviation of each component of what another mounting adds [m].
    told : tuple of Uncertain
        For people.
    """

    mean: Floats = field(repr=False)
    own: Floats = field(repr=False)
    source: int = -1
    common: float = 0.0
    runout: float = 0.0
    runout_sd: float = 0.0
    mounting: float = 0.0
    told: tuple[Uncertain, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """What is drawn of a part.

    Parameters
    ----------
    tools : mapping of int to ToolUncertainty
        By number.
    sources : tuple of str
        Of the common scales.
    depth : float
        Standard deviation of each tool's axial depth [m].
    model : float
        Of the model's peaks, common to the part [1].
    told : tuple of Uncertain
        Of the last two, for people.
    """

    tools: Mapping[int, ToolUncertainty]
    sources: tuple[str, ...]
    depth: float
    model: float
    told: tuple[Uncertain, ...] = ()

    def rows(self) -> list[dict[str, str]]:
        """What is uncertain, its value, spread and source; what tools share is said once."""
        found: dict[tuple[str, str, str, str], list[int]] = {}
        for number, tool in sorted(self.tools.items()):
            for one in tool.told:
                found.setdefault((one.what, one.value, one.spread, one.source), []).append(number)
        listed = [
            (f"{what} ({', '.join(f'T{n}' for n in numbers)})", value, spread, source)
            for (what, value, spread, source), numbers in found.items()
        ]
        listed += [(one.what, one.value, one.spread, one.source) for one in self.told]
        keys = ("what", "value", "spread", "source")
        return [dict(zip(keys, one, strict=True)) for one in listed]


def uncertainty(
    laws: Mapping[int, ToolCoefficients],
    tools: Mapping[int, Tool],
    cutting_document: Mapping[str, Any] | None,
    validation_document: Mapping[str, Any] | None,
    certainty: Certainty,
) -> Uncertainty:
    """What is to be drawn of a part.

    Parameters
    ----------
    laws : mapping of int to ToolLaw
        Force law of each tool that cuts, by number, and where it is from.
    tools : mapping of int to Tool
        The tools.
    cutting_document, validation_document : mapping, optional
        Contents of cutting.json and cutting_validation.json of the machine.
    certainty : Certainty
        What is not in them.

    Raises
    ------
    ValueError
        When a law has no tool.
    """
    document = cutting_document or {}
    sources = tuple(sorted({one.source for one in laws.values() if one.kind != "identified"}))
    found = {}
    for number, law in laws.items():
        if number not in tools:
            raise ValueError(f"uncertainty: T{number} has a force law and is no tool: add it")
        if law.kind == "identified":
            drawn = _identified(law, document)
        else:
            drawn = _taken_over(law, sources.index(law.source), certainty)
        found[number] = _with_runout(drawn, tools[number], law.kind, document, certainty)
    model, judged = model_spread(validation_document or {}, certainty.model)
    depth = Uncertain(
        what="axial depth", value="as in the blank", spread=f"{certainty.depth_um:g} um",
        source="certainty.depth_um: tool length and blank, of each tool",
    )  # fmt: skip
    return Uncertainty(
        tools=found, sources=sources, depth=certainty.depth_um * UM, model=model,
        told=(depth, Uncertain(what="model's peak loads", value="1", spread=f"{100 * model:.2g} %",
                               source=judged)),
    )  # fmt: skip


def _values(law: ForceLaw) -> Floats:
    return np.concatenate([law.cutting, law.edge])


def _taken_over(law: ToolCoefficients, source: int, certainty: Certainty) -> ToolUncertainty:
    """Coefficients that others measured, or a catalogue has."""
    measured = law.kind == "measured"
    spread = certainty.measured_elsewhere if measured else certainty.catalogue
    mean = _values(law.law)
    told = Uncertain(
        what="coefficients", value=f"K_tc {mean[0] * 1e-6:.4g} N/mm^2" if law.law.m_c == 0 else
        f"k_c1.1 {mean[0] * 1e-6 * 1e-3**-law.law.m_c:.4g} N/mm^2",
        spread=f"{100 * spread:.3g} %, 4/5 of the variance common to all", source=law.source,
    )  # fmt: skip
    return ToolUncertainty(
        mean=mean, own=np.diag(OWN * spread * np.abs(mean)), source=source,
        common=float(COMMON * spread), told=(told,),
    )  # fmt: skip


def _identified(law: ToolCoefficients, document: Mapping[str, Any]) -> ToolUncertainty:
    """Coefficients that this machine's recordings say, with the covariance of the fit."""
    mean, spread = _values(law.law), np.zeros(6)
    fitted = fitted_coefficients(document)
    told = []
    for k, name in enumerate(COEFFICIENTS):
        value, half = interval(document, name)
        if value is not None and half is not None:
            spread[k], how = half / NORMAL * SCALES[k], law.source
        else:
            mean[k] = fitted[k]
            beside = mean[0] if k < 3 else max(mean[3], mean[0] * CHIP)
            spread[k], how = max(abs(mean[k]), BESIDE * beside), "not determined by the records"
        unit = "N/mm^2" if k < 3 else "N/mm"
        told.append(Uncertain(
            what=name, value=f"{mean[k] / SCALES[k]:.4g} {unit}",
            spread=f"{spread[k] / SCALES[k]:.3g} {unit}", source=how,
        ))  # fmt: skip
    known = [name for k, name in enumerate(COEFFICIENTS) if mean[k] == _values(law.law)[k]]
    own = spread[:, None] * root(correlation(document, known))
    return ToolUncertainty(mean=mean, own=own, told=tuple(told))


def _with_runout(
    drawn: ToolUncertainty, tool: Tool, kind: str, document: Mapping[str, Any],
    certainty: Certainty,
) -> ToolUncertainty:  # fmt: skip
    """The same with what is known of the tool's runout."""
    if tool.flutes < 2:
        return drawn
    value, half = None, None
    if kind == "identified":
        value, half = interval(document, "runout", upper=True)
    if tool.runout > 0:
        told = Uncertain(
            what="runout", value=f"{tool.runout_um:g} um", spread="at any angle",
            source="tool table",
        )  # fmt: skip
        return replace(drawn, runout=tool.runout, told=(*drawn.told, told))
    own = f"Rayleigh's scale {certainty.runout_um:g} um"
    if value is None or half is None:
        told = Uncertain(
            what="runout", value="not known", spread=own, source="certainty.runout_um",
        )  # fmt: skip
        return replace(drawn, mounting=certainty.runout_um * UM, told=(*drawn.told, told))
    told = Uncertain(
        what="runout", value=f"{value:.3g} um",
        spread=f"{half / NORMAL:.2g} um, at any angle; another mounting: {own}",
        source="identified in another mounting",
    )  # fmt: skip
    return replace(
        drawn, runout=value * UM, runout_sd=half / NORMAL * UM,
        mounting=certainty.runout_um * UM, told=(*drawn.told, told),
    )  # fmt: skip
