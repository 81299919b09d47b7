"""The spindle's thermal network from the clean records of a training week.

Bounded least squares on the temperature simulated over whole stretches of a day, each started from
its first measured temperature (an output error, not an equation error: a sensor of whole degrees
has no slope).  A source whose 95 % interval holds zero is left out and the rest fitted again, so
that no number is reported that the records do not determine.  Whether the spindle needs a second
node is decided by days left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.identification.spindle_problem import (
    AMBIENT_BOUNDS,
    OFFSET_BOUNDS,
    RATE_BOUNDS,
    RATIO_BOUNDS,
    Problem,
    SpindleFitSettings,
)
from pipeline.signals.windows import Stretch
from pipeline.submodels.gains import gains
from pipeline.submodels.least_squares import Certainty, Floats, certainty
from pipeline.thermal.network import SOURCES, SpindleThermalParameters
from pipeline.twin.spindle import TARGET, SpindleRecords, free_run, from_measured
from pipeline.twin.spindle_model import window_starts

__all__ = [
    "SpindleFit",
    "SpindleFitSettings",
    "days_left_out",
    "fit_network",
    "identify_spindle_network",
    "is_determined",
    "solve",
    "window_errors",
]


@dataclass(frozen=True, kw_only=True)
class SpindleFit:
    """The network found, and how sure it is.

    ``names``, ``values`` and ``half_width`` are in the order of the fit, in the units of
    the fit: the logarithm of rates and of the capacity ratio, a source's heating [K/s] at its root
    mean square over the records.  ``left_out`` says for each source why it is not determined.
    """

    parameters: SpindleThermalParameters
    names: tuple[str, ...]
    values: Floats
    sure: Certainty
    cost: float
    rmse_K: float
    evaluations: int
    left_out: dict[str, str] = field(default_factory=dict)


def excited(pieces: Sequence[Stretch], sources: Sequence[str]) -> list[str]:
    """Those of ``sources`` that are ever above 0 in ``pieces``."""
    return [name for name in sources if any((p.frame[name] > 0).any() for p in pieces)]


def solve(problem: Problem, starts: Sequence[Floats]) -> SpindleFit:
    """Best end of several starts, with its certainty."""
    from scipy.optimize import approx_fprime, least_squares

    settings = problem.settings
    ends = [
        least_squares(
            problem.residuals,
            start,
            bounds=problem.bounds(),
            x_scale="jac",
            loss="soft_l1",
            f_scale=settings.outlier_K,
        )
        for start in starts
    ]
    best = min(ends, key=lambda end: end.cost)
    r = problem.residuals(best.x)
    # An M-estimator's sandwich (Huber 1964): scores J' psi with psi = r (1 + z)^(-1/2) for soft
    # L1, curvature J' diag(psi') J with psi' = (1 + z)^(-3/2); split so that both come out.
    z = (r / settings.outlier_K) ** 2
    jacobian = approx_fprime(best.x, problem.residuals, 1e-6) * ((1 + z) ** -0.75)[:, None]
    return SpindleFit(
        parameters=problem.parameters(best.x),
        names=tuple(problem.names),
        values=best.x,
        sure=certainty(jacobian, r * (1 + z) ** 0.25, problem.blocks),
        cost=float(best.cost),
        rmse_K=float(np.sqrt(np.mean(r**2))),
        evaluations=sum(end.nfev for end in ends) * (len(problem.names) + 1),
    )


def fit_network(
    pieces: Sequence[Stretch], records: SpindleRecords, settings: SpindleFitSettings, nodes: int
) -> SpindleFit:
    """The network of ``nodes`` nodes, with the sources that ``pieces`` determine.

    Raises
    ------
    ValueError
        When there is no stretch to fit.
    """
    if not pieces:
        raise ValueError(
            f"no stretch of at least {settings.shortest_s:g} s with speed, load and temperature "
            f"from {records.training_from} to {records.training_to}: record a working day, "
            "or name other training days in the machine's spindle section"
        )
    left_out: dict[str, str] = {}
    sources = excited(pieces, records.sources)
    for name in records.sources:
        if name not in sources:
            left_out[name] = "the records never excite it"
    while True:
        problem = Problem(pieces, records, settings, sources, nodes)
        fit = solve(problem, [problem.start(t) for t in settings.time_constants_s])
        weakest, ratio = _weakest(fit, sources)
        if weakest is None or ratio > 1:
            return replace(fit, left_out=left_out)
        i = fit.names.index(weakest)
        width = fit.sure.half_width[i] / problem.scale[weakest]
        value = max(fit.parameters.heating[weakest], 0.0)
        shown = 0.0 if value < 1e-3 * width else value  # a value at its bound is 0, not 1e-20
        left_out[weakest] = (
            f"its 95 % interval {shown:.2g} ± {width:.2g} {SOURCES[weakest]} holds 0"
        )
        sources.remove(weakest)


def _weakest(fit: SpindleFit, sources: Sequence[str]) -> tuple[str | None, float]:
    """The source whose coefficient is smallest against its half width, and that ratio."""
    ratios = {}
    for name in sources:
        i = fit.names.index(name)
        width = fit.sure.half_width[i]
        at_bound = fit.values[i] < 1e-9
        unknown = at_bound or not np.isfinite(width)
        ratios[name] = 0.0 if unknown else fit.values[i] / max(width, 1e-300)
    if not ratios:
        return None, np.inf
    weakest = min(ratios, key=lambda name: ratios[name])
    return weakest, ratios[weakest]


def window_errors(
    pieces: Sequence[Stretch],
    records: SpindleRecords,
    settings: SpindleFitSettings,
    parameters: SpindleThermalParameters,
) -> Floats:
    """Errors [K] over windows that start from a measured temperature, shape (samples,)."""
    errors = []
    for piece in pieces:
        length = max(round(settings.window_s / piece.step), 1)
        nodes = free_run(piece, records, parameters)
        body = nodes[1] if len(nodes) == 2 else None
        measured = piece.frame[TARGET].to_numpy(float)
        for start in window_starts(measured, length):
            found = from_measured(piece, start, length, records, parameters, body)
            errors.append(found - measured[start : start + length])
    joined = np.concatenate(errors) if errors else np.array([np.nan])
    known: Floats = joined[np.isfinite(joined)]
    return known


def days_left_out(
    pieces: Sequence[Stretch],
    records: SpindleRecords,
    settings: SpindleFitSettings,
    whole: SpindleFit,
) -> Floats:
    """Mean squared error [K^2] over windows of each day under a network fitted on the others.

    The sources and the start are those of ``whole``, the fit on all days; a source that only the
    day left out excites is not known to the others and stays 0.  Shape (days,), empty when there is
    one day only.
    """
    days = sorted({p.day for p in pieces})
    if len(days) < 2:
        return np.array([])
    errors = []
    for day in days:
        others = [p for p in pieces if p.day != day]
        sources = excited(others, list(whole.parameters.heating))
        problem = Problem(others, records, settings, sources, whole.parameters.nodes)
        fit = solve(problem, [problem.position(whole.parameters)])
        judged = [p for p in pieces if p.day == day]
        errors.append(window_errors(judged, records, settings, fit.parameters))
    return np.array([np.mean(e**2) for e in errors if len(e)])


def identify_spindle_network(
    pieces: Sequence[Stretch], records: SpindleRecords, settings: SpindleFitSettings
) -> tuple[SpindleFit, dict[int, float]]:
    """The network with as many nodes as days left out ask for.

    One node is kept unless the records determine all of the second's parameters and it lowers the
    squared error of days left out, significantly over the days (:func:`gains`).

    Returns
    -------
    fit : SpindleFit
        On all ``pieces``.
    scores : dict of int to float
        RMSE [K] on days left out, by number of nodes; empty when there was nothing to choose.
    """
    fits = {n: fit_network(pieces, records, settings, n) for n in sorted(set(settings.nodes))}
    if len(fits) == 1:
        return next(iter(fits.values())), {}
    errors = {n: days_left_out(pieces, records, settings, fit) for n, fit in fits.items()}
    scores = {n: float(np.sqrt(e.mean())) for n, e in errors.items() if len(e)}
    enough = gains(errors[1], errors[2])
    sure = all(is_determined(fits[2], name) for name in fits[2].names)
    return fits[2 if enough and sure else 1], scores


def is_determined(fit: SpindleFit, name: str) -> bool:
    """Whether the records determine a parameter: its interval is bounded and it is off its bounds.

    A rate or ratio is determined when its 95 % interval spans less than a factor of nine, the
    surround when it is known within 5 K.  Heat sources that are not determined were left out.
    """
    i = fit.names.index(name)
    width, value = fit.sure.half_width[i], fit.values[i]
    if name in SOURCES:
        return True
    if name in ("ambient", "ambient_offset"):
        low, high = AMBIENT_BOUNDS if name == "ambient" else OFFSET_BOUNDS
        return bool(width < 5.0 and low + 1e-3 < value < high - 1e-3)
    low, high = np.log(RATIO_BOUNDS if name == "capacity_ratio" else RATE_BOUNDS)
    return bool(width < np.log(3) and low + 1e-3 < value < high - 1e-3)
