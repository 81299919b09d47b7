"""Spindle thermal network from clean records of training days, by bounded least squares.

The residuals are those of the temperature simulated over whole stretches of a day, each started
from its first measured temperature (an output error, not an equation error: a sensor of whole
degrees has no slope).  A source whose 95 % interval holds zero is left out and the rest fitted
again, so that no number is reported that the records do not determine.  Which network it is to be
is decided in :mod:`pipeline.submodels.spindle.structure`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from pipeline.parallel import Compute
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged
from pipeline.signals.windows import StateSegment
from pipeline.submodels.statistics import Uncertainty, student_quantile, uncertainty_of
from pipeline.thermal.network import SOURCES, SpindleThermalParameters, temperatures
from pipeline.twin import spindle

_RATES = np.log((1 / (7 * 86400), 1 / 20))  # a week to 20 s covers any spindle's time constants
BOUNDS = {
    "cooling_rate": _RATES, "coupling_rate": _RATES, "body_cooling_rate": _RATES,
    "coolant_rate": _RATES,
    "capacity_ratio": np.log((1e-3, 10.0)),
    "ambient": np.array((-20.0, 60.0)), "ambient_offset": np.array((-20.0, 30.0)),
}  # fmt: skip
"""Bounds of the unknowns but the heat sources: logarithms of rates [1/s] and of the measured node's
capacity over the body's [1], then [degC] and [K]."""
MASSLESS = 1e-6
"""Capacity ratio of a winding that is nearly massless beside its body [1]."""
HEATING_BOUND = 1.0
"""Greatest heating by a source at its root mean square [K/s]: no motor heats faster."""
LOGARITHMIC = (
    "cooling_rate", "coupling_rate", "body_cooling_rate", "coolant_rate", "capacity_ratio",
)  # fmt: skip
"""Unknowns that are fitted on a logarithmic scale."""


@dataclass(frozen=True, kw_only=True)
class SpindleFitSettings(Ranged, section="spindle_fit"):
    """Settings of the fit of the thermal network."""

    step_s: Positive = 10.0
    """Step of the simulation [s]."""
    bridge_s: NotNegative = 600.0
    """Unknown inputs are held this long [s]; a longer gap ends a stretch."""
    shortest_s: Positive = 3600.0
    """Stretches and working days shorter than this are not used [s]."""
    window_s: Positive = 3600.0
    """Length of the windows that days left out are judged on, and of the blocks within which
    residuals hang together [s]."""
    outlier_K: Positive = 1.0
    """Residuals beyond this count less (soft L1)."""
    nodes: tuple[Annotated[int, Range(least=1, most=2)], ...] = (1, 2)
    """Numbers of nodes to try."""
    time_constants_s: tuple[Positive, ...] = (300.0, 1500.0, 7200.0)
    """Time constants from which the fit starts; the best end is kept."""
    compute: Compute = "processes"
    """Place of computation of networks and of the models of held-out days."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("nodes", "time_constants_s"):
            if not getattr(self, name):
                raise ValueError(f"spindle_fit.{name} is empty: name one value at least")


@dataclass(frozen=True, kw_only=True)
class Structure:
    """A network to fit: its nodes, what the bearings heat, and which limit it is of two nodes."""

    nodes: int = 1
    """1 or 2."""
    friction_in_body: bool = False
    """Whether the bearings heat the body rather than the measured node."""
    massless: bool = False
    """Whether the measured node is nearly massless, so that it does not warm the body: a body that
    stays as warm as it was, or is warmed by the bearings alone."""

    @property
    def name(self) -> str:
        """The network in words."""
        if self.nodes == 1:
            return "1 node"
        bearings = ", bearings in the body" if self.friction_in_body else ""
        return f"2 nodes{bearings}{', massless winding' if self.massless else ''}"

    def unknowns(self, records: spindle.SpindleRecords) -> list[str]:
        """Unknowns beside the sources; of a fixed body the exchange with it only."""
        if self.massless and not self.friction_in_body:
            return ["coupling_rate"]
        coolant = ["coolant_rate"] if records.coolant else []
        surround = "ambient_offset" if records.ambient else "ambient"
        if self.nodes == 1:
            return ["cooling_rate", *coolant, surround]
        ratio = [] if self.massless else ["capacity_ratio"]
        return ["coupling_rate", "body_cooling_rate", *coolant, *ratio, surround]

    @property
    def given(self) -> dict[str, float | bool]:
        """Parameters that are not fitted."""
        tiny = {"capacity_ratio": MASSLESS} if self.massless and self.friction_in_body else {}
        return {"cooling_rate": 0.0, "friction_in_body": self.friction_in_body, **tiny}


ONE, TWO = Structure(nodes=1), Structure(nodes=2)


def structure_of(parameters: SpindleThermalParameters) -> Structure:
    """The structure of a network that was fitted."""
    return Structure(
        nodes=parameters.nodes, friction_in_body=parameters.friction_in_body,
        massless=parameters.nodes == 2 and parameters.capacity_ratio <= MASSLESS,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Given:
    """Stretches of days, the signals that a fit looks at, and its settings."""

    pieces: Sequence[StateSegment]
    records: spindle.SpindleRecords
    settings: SpindleFitSettings


class Problem:
    """Least-squares problem of sources and a network over given stretches.

    ``unseen`` marks steps of each stretch whose temperature is left out; their inputs are given.
    The unknowns are the logarithm of rates and of the capacity ratio, the surround, and each
    source's heating at its root mean square over the records, so that all are of similar size.
    """

    def __init__(
        self, given: Given, sources: Sequence[str], structure: Structure, *,
        unseen: Sequence[Bools] | None = None,
    ) -> None:  # fmt: skip
        pieces, records = given.pieces, given.records
        self.pieces, self.settings = pieces, given.settings
        self.sources, self.structure = list(sources), structure
        heat = np.concatenate([spindle.heat_of(p.frame) for p in pieces])
        rms = np.sqrt(np.mean(heat**2, axis=0))
        self.scale = {name: float(rms[list(SOURCES).index(name)]) for name in self.sources}
        self.names = [*structure.unknowns(records), *self.sources]
        block = 0
        blocks, masks = [], []
        for number, piece in enumerate(pieces):
            n = len(piece.frame)
            blocks.append(block + np.arange(n) * piece.step // given.settings.window_s)
            block = int(blocks[-1][-1]) + 1
            known = piece.frame[spindle.TARGET].notna().to_numpy()
            masks.append(known if unseen is None else known & ~unseen[number])
        self.measured = [p.frame[spindle.TARGET].to_numpy(float) for p in pieces]
        self.heat = [spindle.heat_of(p.frame) for p in pieces]
        self.surrounds = [spindle.ambient_of(p.frame, records) for p in pieces]
        self.coolants = [spindle.coolant_of(p.frame, records) for p in pieces]
        self.masks = masks
        self.blocks = np.concatenate([b[m] for b, m in zip(blocks, masks, strict=True)]).astype(int)

    def widening(self) -> Floats:
        """Factor on the half width of each unknown: a source has the freedom of its own hours.

        Clusters that do not excite a source say nothing of it: with H hours that do, Student's t is
        of H - 1 degrees of freedom.
        """
        found = np.ones(len(self.names))
        freedom = max(len(np.unique(self.blocks)) - len(self.names), 1)
        for i, name in enumerate(self.names):
            if name not in self.scale:
                continue
            column = list(SOURCES).index(name)
            heat = np.concatenate(
                [h[m, column] for h, m in zip(self.heat, self.masks, strict=True)]
            )
            hours = np.bincount(self.blocks, weights=heat)
            own = int((hours > 0.1 * hours.max(initial=0.0)).sum())
            if own - 1 < freedom:
                least = max(own - 1, 1)
                found[i] = student_quantile(least) / student_quantile(freedom)
                found[i] *= np.sqrt((least + 1) / least)
        return found

    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest of every unknown."""
        low, high = np.array([BOUNDS.get(n, (0.0, HEATING_BOUND)) for n in self.names]).T
        return low, high

    def start(self, time_constant: float) -> Floats:
        """Start of the fit at about this time constant [s]."""
        first = float(np.median([np.nanmin(t) for t in self.measured]))
        guess = {
            "cooling_rate": -np.log(time_constant),
            "coupling_rate": -np.log(time_constant),
            "body_cooling_rate": -np.log(8 * time_constant),
            "coolant_rate": -np.log(8 * time_constant),
            "capacity_ratio": np.log(0.2),
            "ambient": np.clip(first, *BOUNDS["ambient"]),
            "ambient_offset": 0.0,
        }
        x = np.array([guess.get(name, 2.0 / time_constant) for name in self.names])
        return self._inside(x)

    def position(self, parameters: SpindleThermalParameters) -> Floats:
        """Point of ``parameters`` on the scale of the search, moved inside the bounds."""
        x = []
        for name in self.names:
            if name in self.scale:
                x.append(parameters.heating.get(name, 0.0) * self.scale[name])
            else:
                value = getattr(parameters, name)
                x.append(np.log(max(value, 1e-12)) if name in LOGARITHMIC else value)
        return self._inside(np.array(x))

    def _inside(self, x: Floats) -> Floats:
        low, high = self.bounds()
        return np.clip(x, low + 1e-9, high - 1e-9)

    def parameters(self, x: Floats) -> SpindleThermalParameters:
        """The network at ``x``."""
        value = dict(zip(self.names, x, strict=True))
        found = {k: float(np.exp(v) if k in LOGARITHMIC else v) for k, v in value.items()}
        heating = {s: found.pop(s) / self.scale[s] for s in self.sources}
        known: dict[str, Any] = {**self.structure.given, **found}
        return SpindleThermalParameters(heating=heating, **known)

    def by_stretch(self, x: Floats) -> list[Floats]:
        """Modelled minus measured temperature [K] of each stretch, NaN where it is missing."""
        parameters = self.parameters(x)
        return [
            temperatures(h, t[0], parameters, p.step, ambient=a, coolant=c)[0] - t
            for p, h, a, c, t in zip(
                self.pieces, self.heat, self.surrounds, self.coolants, self.measured, strict=True
            )
        ]

    def residuals(self, x: Floats) -> Floats:
        """Modelled minus measured temperature [K] where there is one, shape (N,)."""
        return np.concatenate([r[m] for r, m in zip(self.by_stretch(x), self.masks, strict=True)])


@dataclass(frozen=True, kw_only=True)
class SpindleFit:
    """Fitted network, and its uncertainty.

    ``names``, ``values`` and ``half_width`` are in the order of the fit, in the units of
    the fit: the logarithm of rates and of the capacity ratio, a source's heating [K/s] at its root
    mean square over the records.  ``left_out`` says for each source why it is not determined,
    ``intervals`` is the 95 % interval of each source that is excited, kept or not, in the unit of
    its coefficient.  Of the structure that was chosen ``in_doubt`` names further networks that the
    records bear as well; ``intervals`` are then those over all of them and over what the residuals
    say, and ``unfollowed`` names the sources with which the residuals rise or fall.
    """

    parameters: SpindleThermalParameters
    names: tuple[str, ...]
    values: Floats
    uncertainty: Uncertainty
    rmse_K: float
    evaluations: int
    left_out: dict[str, str] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    in_doubt: tuple[str, ...] = ()
    unfollowed: tuple[str, ...] = ()


def excited(pieces: Sequence[StateSegment], sources: Sequence[str]) -> list[str]:
    """Sources that are ever above 0 in ``pieces``."""
    return [name for name in sources if any((p.frame[name] > 0).any() for p in pieces)]


def solve(problem: Problem, starts: Sequence[Floats]) -> SpindleFit:
    """Best end of several starts, with its uncertainty."""
    from scipy.optimize import approx_fprime, least_squares

    settings = problem.settings
    ends = [
        least_squares(
            problem.residuals, start, bounds=problem.bounds(), x_scale="jac", loss="soft_l1",
            f_scale=settings.outlier_K,
        )
        for start in starts
    ]  # fmt: skip
    best = min(ends, key=lambda end: end.cost)
    r = problem.residuals(best.x)
    # An M-estimator's sandwich (Huber 1964): scores J' psi with psi = r (1 + z)^(-1/2) for soft
    # L1, curvature J' diag(psi') J with psi' = (1 + z)^(-3/2); split so that both come out.
    z = (r / settings.outlier_K) ** 2
    jacobian = approx_fprime(best.x, problem.residuals, 1e-6) * ((1 + z) ** -0.75)[:, None]
    uncertainty = uncertainty_of(jacobian, r * (1 + z) ** 0.25, problem.blocks)
    return SpindleFit(
        parameters=problem.parameters(best.x),
        names=tuple(problem.names),
        values=best.x,
        uncertainty=replace(uncertainty, half_width=uncertainty.half_width * problem.widening()),
        rmse_K=float(np.sqrt(np.mean(r**2))),
        evaluations=sum(end.nfev for end in ends) * (len(problem.names) + 1),
    )


def fit_network(given: Given, structure: Structure) -> SpindleFit:
    """Network with the sources that the stretches determine; ValueError without one."""
    pieces, records, settings = given.pieces, given.records, given.settings
    if not pieces:
        raise ValueError(
            f"no stretch of at least {settings.shortest_s:g} s with speed, load and temperature on "
            "the training days: record a working day, or name other days in roles.training_days"
        )
    left_out: dict[str, str] = {}
    intervals: dict[str, tuple[float, float]] = {}
    sources = excited(pieces, records.sources)
    for name in records.sources:
        if name not in sources:
            left_out[name] = "the records never excite it"
    starts: list[SpindleThermalParameters] = []
    while True:
        problem = Problem(given, sources, structure)
        fit = solve(
            problem,
            [problem.position(p) for p in starts]
            or [problem.start(t) for t in settings.time_constants_s],
        )
        starts = [fit.parameters]
        weakest, ratio = _weakest(fit, sources)
        if weakest is None or ratio > 1:
            kept = {name: _interval(fit, problem, name) for name in sources}
            return replace(fit, left_out=left_out, intervals={**intervals, **kept})
        i = fit.names.index(weakest)
        width = fit.uncertainty.half_width[i] / problem.scale[weakest]
        value = max(fit.parameters.heating[weakest], 0.0)
        shown = 0.0 if value < 1e-3 * width else value  # a value at its bound is 0, not 1e-20
        intervals[weakest] = (shown - width, shown + width)
        left_out[weakest] = (
            f"its 95 % interval {shown:.2g} ± {width:.2g} {SOURCES[weakest]} includes 0"
        )
        sources.remove(weakest)


def _interval(fit: SpindleFit, problem: Problem, name: str) -> tuple[float, float]:
    """95 % interval of a source's coefficient, in its unit."""
    i = fit.names.index(name)
    value, width = float(fit.values[i]), float(fit.uncertainty.half_width[i])
    return (value - width) / problem.scale[name], (value + width) / problem.scale[name]


def _weakest(fit: SpindleFit, sources: Sequence[str]) -> tuple[str | None, float]:
    """The source whose coefficient is smallest against its half width, and that ratio."""
    ratios = {}
    for name in sources:
        i = fit.names.index(name)
        width = fit.uncertainty.half_width[i]
        at_bound = fit.values[i] < 1e-9
        unknown = at_bound or not np.isfinite(width)
        ratios[name] = 0.0 if unknown else fit.values[i] / max(width, 1e-300)
    if not ratios:
        return None, np.inf
    weakest = min(ratios, key=lambda name: ratios[name])
    return weakest, ratios[weakest]


def window_errors(given: Given, parameters: SpindleThermalParameters) -> Floats:
    """Errors [K] over windows that start from a measured temperature, shape (samples,)."""
    errors = []
    for piece in given.pieces:
        length = max(round(given.settings.window_s / piece.step), 1)
        nodes = spindle.free_run(piece, given.records, parameters)
        measured = piece.frame[spindle.TARGET].to_numpy(float)
        starts = spindle.window_starts(measured, length)
        found = spindle.from_measured(piece, starts, length, given.records, parameters, nodes)
        for start, run in zip(starts, found, strict=True):
            errors.append(run[: len(measured) - start] - measured[start : start + length])
    joined = np.concatenate(errors) if errors else np.array([np.nan])
    return joined[np.isfinite(joined)]


def all_determined(fit: SpindleFit) -> bool:
    """Whether the records determine all parameters of a network."""
    return all(is_determined(fit, name) for name in fit.names)


def is_determined(fit: SpindleFit, name: str) -> bool:
    """Whether the records determine a parameter: its interval is bounded and it is off its bounds.

    A rate or ratio is determined when its 95 % interval spans less than a factor of nine, the
    surround when its interval is within 5 K.  Heat sources that are not determined were left out.
    """
    if name in SOURCES:
        return True
    i, (low, high) = fit.names.index(name), BOUNDS[name]
    widest = np.log(3) if name in LOGARITHMIC else 5.0
    inside = low + 1e-3 < fit.values[i] < high - 1e-3
    return bool(fit.uncertainty.half_width[i] < widest and inside)


def sensor_step(measured: Floats) -> float:
    """Step between the values that a sensor shows [K]: those it shows for 1 % of the time or more.

    Values between them are of the interpolation between two observations.

    Examples
    --------
    >>> sensor_step(np.array([20.0] * 50 + [20.3, 20.7] + [21.0] * 50))
    1.0
    """
    values, count = np.unique(np.round(measured[np.isfinite(measured)], 3), return_counts=True)
    often = values[count >= 0.01 * count.sum()]
    steps = np.diff(often if len(often) > 1 else values)
    return float(round(steps.min(), 3)) if len(steps) else 0.0
