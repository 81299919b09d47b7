"""Uncertainty of a part's loads: verdicts, coefficients, runout, axial depth, the model itself.

Control, drives and cut are judged apart, on recordings that their fits did not see.  Times rest on
the control, following errors on the drives, loads on the cut.  The standard deviation of what rests
on one that

- passed is the root mean square of its errors on those recordings;
- failed is the greatest of them, at least ``certainty.failed``;
- was not judged is at least ``certainty.not_judged``.

A coefficient of a tool is

    K = K_mean max(0, 1 + s z_source) + L z,

with z standard normal, z_source common to all tools whose coefficients come from one source.

- Identified coefficients have the spread of the force laws that the records allow, each law by its
  straight line over the training feeds and those of the cut; and a share for other speeds and
  depths.  A model without such laws has the intervals and correlations of its fit.  An undetermined
  coefficient has the value of the fit, and zero is among its spread.
- The land of a worn edge adds to the edge coefficients, with the interval of its growth with wear.
- Others' measurements and catalogues err in the material and the edge above all, which moves all
  coefficients together: of the variance 4 / 5 is common, 1 / 5 each coefficient's own.

Runout of a tool table is that of the mounting to cut, at an unknown angle.  Identified runout is of
the recorded mounting: the next one has its size, within its interval, at any angle, and an offset
of its own of ``certainty.runout_um`` on top.  Without either there is that offset alone; its size
is Rayleigh's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.cutting.force.force_law import N_MM, ForceLaw, laws_lines, outside_share
from pipeline.cutting.tool import Tool
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import MAGNITUDE, CutConditions, CuttingModel
from pipeline.schema.drive import FOLLOWING
from pipeline.schema.part import UncertainQuantity
from pipeline.schema.si import UM
from pipeline.schema.verdict import UsedModel, UsedStatus, Verdict
from pipeline.twin.cut.coefficients import (
    COEFFICIENTS,
    SCALES,
    ToolCoefficients,
    fitted_coefficients,
)

FIGURES = {"control": "times", "drive": "following errors", "cutting": "peak loads"}
"""Sub-models that programs are simulated and optimised with, and the figures that rest on each."""
UNIDENTIFIED = {
    "control": "its values are those of conf/machine",
    "drive": "no following error is known",
    "cutting": "coefficients are others', with the spread of their source",
}
"""Substitutes for a sub-model that was not identified."""
GRAVITY: tuple[UsedStatus, ...] = (
    "failed", "not decided", "not judged", "not identified", "passed",
)  # fmt: skip
"""Statuses in the order in which a person has to read them."""
QUANTITY = {"control": "", "drive": FOLLOWING, "cutting": MAGNITUDE}
"""Beginning of the quantity whose errors count; of a control all that has limits."""


def used_models(
    verdicts: Mapping[str, Verdict | None], settings: ReliabilitySettings
) -> tuple[UsedModel, ...]:
    """Sub-models with their verdicts and spreads, the gravest first."""
    models = (
        _used(name, verdicts[name], settings) if name in verdicts else _without(name, settings)
        for name in FIGURES
    )
    return tuple(sorted(models, key=lambda model: GRAVITY.index(model.status)))


def _used(name: str, verdict: Verdict | None, settings: ReliabilitySettings) -> UsedModel:
    held_out = held_out_errors(name, verdict)
    errors = [error for _, error in held_out]
    status: UsedStatus = "not judged"
    missed: tuple[str, ...]
    if verdict is None:
        missed = ("no verdict.json stands beside its model: run dvc repro to its end",)
    else:
        status = verdict.status
        missed = verdict.set_aside if status == "passed" else verdict.missed
    least = settings.model if name == "cutting" else 0.0
    return UsedModel(
        submodel=name, figures=FIGURES[name], status=status,
        reason=missed[0] if missed else "", missed=len(missed),
        recordings=len({group for group, _ in held_out}),
        error_percent=float(f"{100 * rms(errors):.4g}") if errors else None,
        spread_percent=float(f"{100 * judged_spread(status, errors, least, settings)[0]:.4g}"),
    )  # fmt: skip


def _without(name: str, settings: ReliabilitySettings) -> UsedModel:
    """A sub-model that was not identified; times of an assumed control count as not judged."""
    return UsedModel(
        submodel=name, figures=FIGURES[name], status="not identified", reason=UNIDENTIFIED[name],
        spread_percent=float(f"{100 * settings.not_judged:.4g}") if name == "control" else None,
    )  # fmt: skip


def held_out_errors(name: str, verdict: Verdict | None) -> list[tuple[str, float]]:
    """Held-out recordings and the relative error [1] of each axis or channel judged in them.

    The error is that of peak loads, or else the RMSE over the RMS.
    """
    figure = "peak_percent" if name == "cutting" else "relative_percent"
    errors = [
        (score.group, getattr(score, figure))
        for score in (() if verdict is None else verdict.scores)
        if score.quantity.startswith(QUANTITY[name]) and score.group != "all"
        and score.role != "training" and not score.alone
        and (not score.regime if name == "cutting" else score.limits)
    ]  # fmt: skip
    return [(group, round(one, 2) / 100) for group, one in errors if one is not None]


def judged_spread(
    status: UsedStatus, errors: Sequence[float], least: float, settings: ReliabilitySettings
) -> tuple[float, str]:
    """Standard deviation that a verdict leaves [1], and its source.

    It is never less than ``least``, nor than the root mean square of ``errors``.
    """
    many = f"{len(errors)} recordings"
    known = [
        (least, "certainty.model"),
        (rms(errors), f"{many} that the coefficients were not found from"),
    ]
    if status == "failed":
        known += [
            (settings.failed, "certainty.failed: its verdict failed"),
            (max(map(abs, errors), default=0.0), f"its verdict failed: greatest error of {many}"),
        ]
    elif status != "passed":
        known.append((settings.not_judged, "certainty.not_judged: it was not judged"))
    return max(known, key=lambda one: one[0])


def rms(errors: Sequence[float]) -> float:
    """Root mean square; 0 without values."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else 0.0


NORMAL = 1.959963984540054
"""Standard deviations of half a 95 % interval."""
COMMON, OWN = np.sqrt(0.8), np.sqrt(0.2)
"""Parts of the standard deviation that coefficients of one source share, and each one's own."""
BESIDE = 0.1
"""Standard deviation of what was not determined, at least, over the tangential coefficient."""
CHIP = 5e-5
"""Thickness by which edge coefficients are beside cutting ones [m]."""
FEEDS = 5
"""Feeds per tooth of a range at which the force laws are compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolUncertainty:
    """Distribution of the coefficients and the runout of one tool."""

    mean: Floats = field(repr=False)
    """Mean of the coefficients, SI; shape (6,)."""
    own: Floats = field(repr=False)
    """L, root of their own covariance; shape (6, 6)."""
    source: int = -1
    """Index of their common scale, -1 for none."""
    common: float = 0.0
    """s, its standard deviation [1]."""
    runout: float = 0.0
    runout_sd: float = 0.0
    """Size of the offset that is known of [m]; its angle is not."""
    mounting: float = 0.0
    """Standard deviation of each component of what another mounting adds [m]."""
    described: tuple[UncertainQuantity, ...] = ()
    """Uncertain quantities in words."""

    @property
    def runout_words(self) -> str:
        """Value and spread of its runout; "" of a single tooth."""
        of = (one for one in self.described if one.what == "runout")
        return "".join(f"{one.value}, {one.spread}" for one in of)


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Distribution of all uncertain quantities of a part."""

    tools: Mapping[int, ToolUncertainty]
    """Uncertainty of each tool, by number."""
    sources: tuple[str, ...]
    """Sources of the common scales."""
    depth: float
    """Standard deviation of each tool's axial depth [m]."""
    model: float
    """Relative standard deviation of the model's peaks, common to the part [1]."""
    described: tuple[UncertainQuantity, ...] = ()
    """Uncertainty of depth and model in words."""

    @property
    def quantities(self) -> tuple[UncertainQuantity, ...]:
        """Uncertain quantities in words; those that tools share once, with their numbers."""
        tools_of: dict[UncertainQuantity, list[str]] = {}
        for number, tool in sorted(self.tools.items()):
            for one in tool.described:
                tools_of.setdefault(one, []).append(f"T{number}")
        of_tools = (
            replace(one, what=f"{one.what} ({', '.join(numbers)})")
            for one, numbers in tools_of.items()
        )
        return (*of_tools, *self.described)


@dataclass(frozen=True, kw_only=True)
class CutRange:
    """Least and greatest feed per tooth [m], depth [m] and spindle speed [rev/s] of a tool."""

    feeds_m: tuple[float, float]
    speeds: tuple[float, float]
    depths_m: tuple[float, float]


def uncertainty(
    coefficients: Mapping[int, ToolCoefficients],
    tools: Mapping[int, Tool],
    model: CuttingModel | None,
    verdict: Verdict | None,
    settings: ReliabilitySettings,
    *,
    ranges: Mapping[int, CutRange] | None = None,
) -> Uncertainty:
    """Distribution of the uncertain quantities of a part.

    ``coefficients``: force law of each tool that cuts, by number, and its source; ``ranges``: cuts
    of each tool; by default those of the training data.
    """
    sources = tuple(
        sorted({one.source for one in coefficients.values() if one.kind != "identified"})
    )
    drawn_tools = {}
    for number, given in coefficients.items():
        if number not in tools:
            raise ValueError(f"uncertainty: T{number} has a force law and is no tool: add it")
        sharp = given if given.sharp is None else replace(given, law=given.sharp)
        if given.kind == "identified":
            drawn = _identified(sharp, model, (ranges or {}).get(number), tools[number].flutes)
        else:
            drawn = _taken_over(sharp, sources.index(given.source), settings)
        drawn = _with_wear(drawn, given)
        drawn_tools[number] = _with_runout(drawn, tools[number], given.kind, model, settings)
    own = any(one.kind == "identified" for one in coefficients.values())
    spread, spread_source = model_spread(verdict, settings, own=own)
    depth = UncertainQuantity(
        what="axial depth", value="as in the blank", spread=f"{settings.depth_um:g} um",
        source="certainty.depth_um: tool length and blank, of each tool",
    )  # fmt: skip
    return Uncertainty(
        tools=drawn_tools, sources=sources, depth=settings.depth_um * UM, model=spread,
        described=(depth, UncertainQuantity(
            what="model's peak loads", value="1", spread=f"{100 * spread:.2g} %",
            source=spread_source,
        )),
    )  # fmt: skip


def _values(law: ForceLaw) -> Floats:
    return np.concatenate([law.cutting, law.edge])


def _taken_over(
    given: ToolCoefficients, source: int, settings: ReliabilitySettings
) -> ToolUncertainty:
    """Coefficients that others measured, or a catalogue has."""
    measured = given.kind == "measured"
    spread = settings.measured_elsewhere if measured else settings.catalogue
    mean = _values(given.law)
    described = UncertainQuantity(
        what="coefficients", value=f"K_tc {mean[0] * 1e-6:.4g} N/mm^2" if given.law.m_c == 0 else
        f"k_c1.1 {mean[0] * 1e-6 * 1e-3**-given.law.m_c:.4g} N/mm^2",
        spread=f"{100 * spread:.3g} %, 4/5 of the variance common to all", source=given.source,
    )  # fmt: skip
    return ToolUncertainty(
        mean=mean, own=np.diag(OWN * spread * np.abs(mean)), source=source,
        common=float(COMMON * spread), described=(described,),
    )  # fmt: skip


def _identified(
    given: ToolCoefficients, model: CuttingModel | None, used: CutRange | None, flutes: int
) -> ToolUncertainty:
    mean, fitted = _values(given.law), fitted_coefficients(model)
    halves = [interval(model, name)[1] for name in COEFFICIENTS]
    for k, half in enumerate(halves):
        mean[k] = mean[k] if half is not None else fitted[k]
    of_laws = law_root(model, mean, used, flutes)
    own = _fitted_root(model, mean, halves) if of_laws is None else of_laws
    spread = np.sqrt((own**2).sum(axis=1))
    described = tuple(
        UncertainQuantity(
            what=name, value=f"{mean[k] / SCALES[k]:.4g} {'N/mm^2' if k < 3 else 'N/mm'}",
            spread=f"{spread[k] / SCALES[k]:.3g} {'N/mm^2' if k < 3 else 'N/mm'}",
            source="not determined by the records" if halves[k] is None else given.source,
        )
        for k, name in enumerate(COEFFICIENTS)
    )  # fmt: skip
    return ToolUncertainty(mean=mean, own=own, described=described)


def law_root(
    model: CuttingModel | None, mean: Floats, used: CutRange | None, flutes: int
) -> Floats | None:
    """Root of the covariance of coefficients about ``mean`` by the chip's force laws; (6, 6).

    Each law counts by its straight line over the training feeds and those of the cut together.
    """
    spread = None if model is None or model.prediction is None else model.prediction.spread
    if spread is None:
        return None
    used = used or CutRange(feeds_m=spread.feeds_m, speeds=spread.speeds, depths_m=spread.depths_m)
    low = min(used.feeds_m[0], spread.feeds_m[0])
    high = max(used.feeds_m[1], spread.feeds_m[1])
    slots = [
        CutConditions(speed=used.speeds[0], f_z=f_z, a_p=used.depths_m[0], phi_st=0.0,
                      phi_ex=float(np.pi), flutes=flutes)
        for f_z in np.linspace(low, high, FEEDS).tolist()
    ]  # fmt: skip
    off = fitted_coefficients(model) - spread.line + laws_lines(spread.laws, slots) - mean
    square = off.T @ off / len(off)
    deepest = used.depths_m[1]  # chips of shallower cuts are as thick, and the tool ends in some
    share = max(outside_share(spread, speed, deepest) for speed in used.speeds)
    square += share**2 * np.outer(mean, mean)
    return root(square)


def _fitted_root(
    model: CuttingModel | None, mean: Floats, halves: Sequence[float | None]
) -> Floats:
    spread = np.zeros(6)
    for k, half in enumerate(halves):
        beside = mean[0] if k < 3 else max(mean[3], mean[0] * CHIP)
        spread[k] = (
            max(abs(mean[k]), BESIDE * beside) if half is None else half / NORMAL * SCALES[k]
        )
    determined = [name for k, name in enumerate(COEFFICIENTS) if halves[k] is not None]
    rows = root(correlation(model, determined))
    length = np.sqrt((rows**2).sum(axis=1, keepdims=True))
    return spread[:, None] * rows / np.where(length > 0, length, 1.0)


def _with_wear(drawn: ToolUncertainty, given: ToolCoefficients) -> ToolUncertainty:
    land = given.land
    if given.sharp is None or land is None:
        return drawn
    mean, spread = drawn.mean.copy(), np.zeros(len(COEFFICIENTS))
    described = []
    for name, added, half in (("K_te", land.K_te, land.half_te), ("K_re", land.K_re, land.half_re)):
        k = COEFFICIENTS.index(name)
        mean[k], spread[k] = mean[k] + added, half / NORMAL
        described.append(UncertainQuantity(
            what=f"{name} of {land.wear_um:g} um of wear", value=f"{added / N_MM:.4g} N/mm more",
            spread=f"{spread[k] / N_MM:.3g} N/mm", source=land.source,
        ))  # fmt: skip
    own = root(drawn.own @ drawn.own.T + np.diag(spread**2))
    return replace(drawn, mean=mean, own=own, described=(*drawn.described, *described))


def _with_runout(
    drawn: ToolUncertainty, tool: Tool, kind: str, model: CuttingModel | None,
    settings: ReliabilitySettings,
) -> ToolUncertainty:  # fmt: skip
    if tool.flutes < 2:
        return drawn
    value, half = interval(model, "runout", upper=True) if kind == "identified" else (None, None)
    own = f"Rayleigh's scale {settings.runout_um:g} um"
    runout = spread = mounting = 0.0
    if tool.runout > 0:
        runout = tool.runout
        words = f"{tool.runout_um:g} um", "at any angle", "tool table"
    elif value is None or half is None:
        mounting = settings.runout_um * UM
        words = "not known", own, "certainty.runout_um"
    else:
        runout, spread, mounting = value * UM, half / NORMAL * UM, settings.runout_um * UM
        words = (
            f"{value:.3g} um", f"{half / NORMAL:.2g} um, at any angle; another mounting: {own}",
            "identified in another mounting",
        )  # fmt: skip
    said, of, source = words
    described = UncertainQuantity(what="runout", value=said, spread=of, source=source)
    return replace(
        drawn, runout=runout, runout_sd=spread, mounting=mounting,
        described=(*drawn.described, described),
    )  # fmt: skip


def interval(
    model: CuttingModel | None, name: str, *, upper: bool = False
) -> tuple[float, float] | tuple[None, None]:
    """Value and half of the 95 % interval of a parameter of the cut's model, in its unit.

    None where it was not determined; ``upper`` takes the part of the interval above the value.
    """
    parameter = None if model is None else model.coefficients.get(name)
    if parameter is None or not parameter.determined or parameter.interval_95 is None:
        return None, None
    if parameter.value is None:
        return None, None
    low, high = parameter.interval_95
    return parameter.value, high - parameter.value if upper else (high - low) / 2


def correlation(model: CuttingModel | None, determined: Sequence[str]) -> Floats:
    """Correlation of the six coefficients, (6, 6); only ``determined`` ones are correlated."""
    correlations = np.eye(len(COEFFICIENTS))
    if model is None:
        return correlations
    names, values = model.correlation.names, model.correlation.values
    if not names or any(one is None for row in values for one in row):
        return correlations
    table = np.array(values, dtype=np.float64).reshape(len(names), -1)
    rows = [k for k, name in enumerate(COEFFICIENTS) if name in names and name in determined]
    place = [names.index(COEFFICIENTS[k]) for k in rows]
    correlations[np.ix_(rows, rows)] = table[np.ix_(place, place)]
    np.fill_diagonal(correlations, 1.0)
    return correlations


def root(matrix: Floats) -> Floats:
    """R with R R^T a covariance, which rounding may have made slightly indefinite."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def model_spread(
    verdict: Verdict | None, settings: ReliabilitySettings, *, own: bool
) -> tuple[float, str]:
    """Standard deviation of the model's peak loads [1], and its source.

    Coefficients of this machine (``own``) count by :func:`judged_spread`; others' have a spread of
    their own.
    """
    status: UsedStatus = "not judged" if verdict is None else verdict.status
    errors = [error for _, error in held_out_errors("cutting", verdict)]
    return judged_spread(status if own else "passed", errors, settings.model, settings)
