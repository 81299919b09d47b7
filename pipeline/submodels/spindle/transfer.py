"""Transfer of a spindle's network to a sibling: partial pooling from its first minutes of warm-up.

The parameters of a golden machine, and of further ones of its type, say where those of a sibling
are expected (maximum a posteriori): the logarithm of each rate and heating coefficient is normal
about their pooled mean, its variance that of the mean plus that between machines
(:mod:`pipeline.submodels.pooling`).  So a short record moves what it shows and leaves the rest
where the others are (Gelman and Hill 2007, ch. 12).  Beside it stand a network fitted on that short
record alone and the golden one as it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Ranged
from pipeline.signals.windows import StateSegment
from pipeline.submodels.pooling import expected, standard_error
from pipeline.submodels.spindle.days import heated
from pipeline.submodels.spindle.fit import (
    BOUNDS,
    LOGARITHMIC,
    Given,
    Problem,
    SpindleFitSettings,
    excited,
    solve,
    structure_of,
)
from pipeline.thermal.network import SOURCES, SpindleThermalParameters, temperatures
from pipeline.twin.spindle import (
    TARGET,
    SpindleModelFile,
    SpindleRecords,
    ambient_of,
    coolant_of,
    free_run,
    heat_of,
)

UNKNOWN_WIDTH = float(np.log(3))
"""Standard deviation of the logarithm of a golden parameter that its records do not determine."""
UNKNOWN_WIDTH_K = 5.0
"""Standard deviation of a golden surround that its records do not determine [K]."""
FARTHEST = float(np.log(30))
"""Greatest logarithm of a sibling's parameter over the golden one's."""
METHODS = ("pooled", "own", "golden")
"""Parameters from both machines, from the sibling's short record alone, from the golden machine."""


@dataclass(frozen=True, kw_only=True)
class TransferSettings(Ranged, section="spindle_transfer"):
    """Pooling of parameters, and the record lengths of its trial."""

    minutes: tuple[Positive, ...] = (15.0, 30.0, 60.0, 120.0, 240.0, 480.0)
    """Lengths of the sibling's record, from its first start [min]."""
    between_machines: Positive = 0.3
    """Standard deviation of log rates and coefficients between machines of a type, as expected
    before their models are seen [1]."""
    between_machines_K: Positive = 2.0
    """Standard deviation of the surround's temperature between machines [K]."""


@dataclass(frozen=True, kw_only=True)
class TransferPoint:
    """Free-run RMSE [K] after ``minutes`` [min]; ``own`` is None without a network."""

    minutes: float
    pooled: float
    own: float | None
    golden: float


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """The curve of minutes of warm-up against error, as it is stored."""

    machine: str
    golden: str
    origin: str
    """Sibling, machine of the prior, and kind of the sibling's records."""
    days_judged: tuple[str, ...]
    """Days of the sibling that no parameter saw."""
    resolution_K: float
    """Step of the sibling's temperature sensor [K]."""
    points: tuple[TransferPoint, ...]
    """Points by rising length of the record."""
    pooled: Mapping[str, float]
    """Parameters from both machines with the longest record, by name, in the model's units."""
    siblings: tuple[str, ...] = ()
    """Further machines of the golden one's type whose parameters are pooled with its own."""
    not_transferred: tuple[str, ...]
    """Heat sources of the sibling that the golden machine does not have."""
    sentence: str
    """Leading parameters, and the range in which they lead."""


def transfer(
    golden: SpindleModelFile,
    machine: str,
    origin: str,
    pieces: Sequence[StateSegment],
    judged: Sequence[StateSegment],
    *,
    own: SpindleRecords,
    resolution_K: float,
    fitting: SpindleFitSettings,
    settings: TransferSettings,
    siblings: Sequence[SpindleModelFile] = (),
) -> Transfer:
    """Error on days not used against minutes of the sibling's own record.

    ``pieces`` are the sibling's training days in the order of time, ``judged`` the days that are
    not used, ``own`` the signals that it records, ``resolution_K`` the step of its temperature
    sensor [K], ``siblings`` further models of the golden machine's type. ValueError when no day can
    be judged, or the spindle never starts on the training days.
    """
    if not judged:
        raise ValueError(
            f"{machine} has no day beside its training days to judge the transfer by: record one"
        )
    records = golden.records
    points, pooled = [], golden.network
    for minutes in sorted(settings.minutes):
        short = first_minutes(pieces, minutes)
        pooled = pooled_network(
            golden, short, settings, correlation_s=fitting.window_s, siblings=siblings
        )
        alone = own_network(Given(short, records, fitting), golden.network)
        points.append(TransferPoint(
            minutes=minutes, pooled=_rmse(judged, records, pooled),
            own=None if alone is None else _rmse(judged, records, alone),
            golden=_rmse(judged, records, golden.network),
        ))  # fmt: skip
    return Transfer(
        machine=machine, golden=golden.machine, origin=origin,
        days_judged=tuple(sorted({piece.day for piece in judged})), resolution_K=resolution_K,
        points=tuple(points), pooled=_values(pooled),
        siblings=tuple(one.machine for one in siblings),
        not_transferred=tuple(s for s in own.sources if s not in records.sources),
        sentence=leader(points, resolution_K),
    )  # fmt: skip


def first_minutes(pieces: Sequence[StateSegment], minutes: float) -> list[StateSegment]:
    """Record up to ``minutes`` after the first start; ValueError when the spindle never starts."""
    left = 0
    for number, piece in enumerate(pieces):
        turns = np.flatnonzero(heated(piece.frame))
        if len(turns):
            left = int(turns[0]) + max(round(60 * minutes / piece.step), 1)
            pieces = pieces[number:]
            break
    if left == 0:
        raise ValueError("the spindle never starts on the training days: record a warm-up")
    found = []
    for piece in pieces:
        if left <= 0:
            break
        found.append(replace(piece, frame=piece.frame.iloc[:left]))
        left -= len(piece.frame)
    return found


def pooled_network(
    golden: SpindleModelFile,
    pieces: Sequence[StateSegment],
    settings: TransferSettings,
    *,
    correlation_s: float,
    siblings: Sequence[SpindleModelFile] = (),
) -> SpindleThermalParameters:
    """The network of maximum posterior: the golden machine's, moved by the sibling's record.

    Parameters and intervals of the golden machine and of its ``siblings`` are the prior.  Residuals
    hang together over ``correlation_s`` [s]: so much of a record counts as one measurement.
    """
    from scipy.optimize import least_squares

    records, start = golden.records, golden.network
    surround = "ambient_offset" if records.ambient else "ambient"
    rates = [name for name in LOGARITHMIC if getattr(start, name) > 0]
    names = [*rates, *(name for name, value in start.heating.items() if value > 0), surround]
    values = {name: getattr(start, name) for name in (*rates, surround)} | dict(start.heating)
    centre, width = np.array([
        _prior(name, values[name], [golden, *siblings], settings, logarithmic=name != surround)
        for name in names
    ]).T  # fmt: skip
    noise = max(golden.fit.rmse_K, 0.1)
    given = [
        (heat_of(p.frame), p.frame[TARGET].to_numpy(float), p.step,
         ambient_of(p.frame, records), coolant_of(p.frame, records))
        for p in pieces
    ]  # fmt: skip

    def network(z: Floats) -> SpindleThermalParameters:
        moved = dict(zip(names, z.tolist(), strict=True))
        factors = {name: float(np.exp(moved[name])) for name in names if name != surround}
        changed = {name: getattr(start, name) * factors[name] for name in rates}
        heating = {name: value * factors.get(name, 1.0) for name, value in start.heating.items()}
        changed[surround] = getattr(start, surround) + moved[surround]
        return replace(start, heating=heating, **changed)

    def residuals(z: Floats) -> Floats:
        one, parts = network(z), [(z - centre) / width]
        for heat, measured, step, ambient, coolant in given:
            found = temperatures(heat, measured[0], one, step, ambient=ambient, coolant=coolant)[0]
            error = (found - measured)[np.isfinite(measured)]
            parts.append(error / noise * np.sqrt(min(step / correlation_s, 1.0)))
        return np.concatenate(parts)

    reach = np.where(np.array(names) == surround, np.ptp(BOUNDS[surround]), FARTHEST)
    best = least_squares(
        residuals, np.clip(centre, -0.9 * reach, 0.9 * reach), bounds=(-reach, reach), x_scale=width
    )
    return network(best.x)


def _prior(
    name: str, value: float, models: Sequence[SpindleModelFile], settings: TransferSettings,
    *, logarithmic: bool,
) -> tuple[float, float]:  # fmt: skip
    """Mean and standard deviation of a sibling's parameter against the golden ``value``.

    That is the logarithm of their ratio [1], or their difference [K].  The first of the ``models``
    is the golden machine's; a parameter that it does not determine has the value of its network.
    """
    unknown = UNKNOWN_WIDTH if logarithmic else UNKNOWN_WIDTH_K
    estimates, errors = list[float](), list[float]()
    for number, model in enumerate(models):
        p = model.parameters.get("", {}).get(name)
        error = None if p is None else standard_error(p, logarithmic=logarithmic)
        its = value if number == 0 or p is None or p.value is None else p.value
        if number and (error is None or (logarithmic and its <= 0)):
            continue
        estimates.append(float(np.log(its / value)) if logarithmic else its - value)
        errors.append(unknown if error is None else min(error, unknown))
    scale = settings.between_machines if logarithmic else settings.between_machines_K
    return expected(estimates, errors, scale)


def own_network(given: Given, golden: SpindleThermalParameters) -> SpindleThermalParameters | None:
    """Golden network of a short record alone, None where it excites no source."""
    sources = excited(given.pieces, [name for name in given.records.sources if name in SOURCES])
    if not sources:
        return None
    problem = Problem(given, sources, structure_of(golden))
    starts = [problem.start(t) for t in given.settings.time_constants_s]
    return solve(problem, starts).parameters


def _rmse(
    pieces: Sequence[StateSegment], records: SpindleRecords, network: SpindleThermalParameters
) -> float:
    """RMSE of free runs of the test days [K]."""
    error = np.concatenate([
        free_run(piece, records, network)[0] - piece.frame[TARGET].to_numpy(float)
        for piece in pieces
    ])  # fmt: skip
    return float(f"{np.sqrt(np.nanmean(error**2)):.4g}")


def _values(network: SpindleThermalParameters) -> dict[str, float]:
    rates = {name: float(getattr(network, name)) for name in LOGARITHMIC}
    found = {**rates, **network.heating, "ambient": network.ambient}
    found["ambient_offset"] = network.ambient_offset
    return {name: float(f"{value:.5g}") for name, value in found.items() if value}


def leader(points: Sequence[TransferPoint], resolution_K: float) -> str:
    """Parameters that lead by more than the sensor's resolution, there and at all longer records.

    One record length shows nothing: a lead needs a longer record that confirms it.
    """
    for number, point in enumerate(points[:-1]):
        for name in METHODS:
            if all(_leads(one, name, resolution_K) for one in points[number:]):
                return (
                    f"From {point.minutes:g} minutes of warm-up on, {_words(name)} lead the "
                    f"others by more than the sensor's step of {resolution_K:g} K."
                )
    return (
        f"None of the three leads by more than the sensor's step of {resolution_K:g} K at one "
        "length of the record and at all longer ones."
    )


def _leads(point: TransferPoint, name: str, resolution_K: float) -> bool:
    errors = {one: getattr(point, one) for one in METHODS}
    mine = errors.pop(name)
    others = [error for error in errors.values() if error is not None]
    return mine is not None and mine + resolution_K < min(others)


def _words(name: str) -> str:
    return {
        "pooled": "parameters pooled with the golden machine's",
        "own": "parameters of the own record alone",
        "golden": "the golden machine's parameters as they are",
    }[name]
