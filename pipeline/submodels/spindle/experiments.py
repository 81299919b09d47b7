"""Twenty minutes of a spindle that would tell more of its network: duties, and what they excite.

The log runs on for forty minutes with the spindle at rest, so that the recording is an hour, the
block within which residuals hang together, and cooling is in it.  Sensitivities are those of the
free run by finite differences, at the network that was identified.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.signals.windows import StateSegment
from pipeline.submodels.next_recording import Candidate, Design
from pipeline.submodels.spindle.days import SpindleLimits
from pipeline.submodels.spindle.fit import (
    LOGARITHMIC,
    Given,
    Problem,
    SpindleFitSettings,
    excited,
    structure_of,
)
from pipeline.thermal.network import SOURCES, heat_sources
from pipeline.twin.spindle import TARGET, SpindleModelFile

WORK_S, REST_S = 1200.0, 2400.0
"""Time of a duty, and of the rest after it [s]."""
PLAUSIBLE_K = 5.0
"""Steady warming by a source that nothing determines, at its greatest in a recording [K]."""
LOGGED = (
    "log speed, load and temperature of the spindle once a second, and leave the log on for 40 "
    "minutes with the spindle at rest after it"
)
INTERVAL = "free run of the spindle's temperature over the judged days, by its parameters"


def spindle_design(
    model: SpindleModelFile, training: Sequence[StateSegment], judged: Sequence[StateSegment],
    limits: SpindleLimits,
) -> Iterator[Design]:  # fmt: skip
    """Design of the network; none without stretches to learn and judge by, or intervals."""
    if not training or not judged:
        return
    duties = dict(_duties(training, model))
    named = excited([*training, *duties.values()], model.records.sources)
    stated = model.parameters.get("", {})
    sources = [
        name for name in named
        if name in stated and (stated[name].determined or not excited(training, [name]))
    ]  # fmt: skip

    def problem(pieces: Sequence[StateSegment]) -> Problem:
        settings = SpindleFitSettings(step_s=model.fit.step_s)
        found = Problem(
            Given(pieces, model.records, settings), sources, structure_of(model.network)
        )
        found.scale = dict.fromkeys(sources, 1.0)  # one scale in all
        return found

    def rows(pieces: Sequence[StateSegment]) -> Floats:
        return _sensitivities(problem(pieces), model)

    first = problem(training)
    if not set(first.names) <= set(stated):
        return
    half, size = [], []
    for name in first.names:
        one = stated[name]
        low, high = one.interval_95 or (np.nan, np.nan)
        log = name in LOGARITHMIC
        half.append(np.log(high / max(low, 1e-12)) / 2 if log else (high - low) / 2)
        known = one.value if one.value else _plausible(name, duties, model)
        size.append(1.0 if log else max(abs(known), 1e-300))
    yield Design(
        names=tuple(first.names), units=tuple(stated[name].unit for name in first.names),
        half_widths=np.array(half), floors=np.zeros(len(half)), sizes=np.array(size),
        rows=rows(training), judged=rows(judged), interval=INTERVAL, unit="K", limit=limits.mae_K,
        candidates=[
            Candidate(record=f"{words}; {LOGGED}", minutes=WORK_S / 60, rows=rows([piece]))
            for words, piece in duties.items()
        ],
    )  # fmt: skip


def _sensitivities(problem: Problem, model: SpindleModelFile) -> Floats:
    """Derivatives of the temperature by the unknowns where it was measured; shape (N, D)."""
    at = problem.position(model.network)
    own = np.array([_step(name, model) for name in problem.names])
    here = problem.residuals(at)
    columns = [
        (problem.residuals(at + np.where(np.arange(len(at)) == k, own, 0.0)) - here) / own[k]
        for k in range(len(at))
    ]
    return np.column_stack(columns)


def _step(name: str, model: SpindleModelFile) -> float:
    """Step of a finite difference; the temperature is linear in a source."""
    return max(model.network.heating.get(name, 0.0), 1e-8) if name in SOURCES else 1e-4


def _plausible(name: str, duties: dict[str, StateSegment], model: SpindleModelFile) -> float:
    """Coefficient of a source at which it warms a spindle by :data:`PLAUSIBLE_K` in the end."""
    if name not in SOURCES:
        return 1.0
    most = max(float(piece.frame[name].max()) for piece in duties.values())
    rate = float(-np.linalg.eigvals(model.network.rates).real.max())
    return PLAUSIBLE_K * rate / max(most, 1e-300)


def _duties(
    training: Sequence[StateSegment], model: SpindleModelFile
) -> Iterator[tuple[str, StateSegment]]:
    """What the spindle can do for twenty minutes, in words, at speeds and loads of its records."""
    table = pd.concat([piece.frame for piece in training])
    turning = table[table["bearing_friction"] > 0]
    if turning.empty:
        return
    speeds = turning["bearing_friction"].to_numpy(float) ** 0.6
    loads = np.sqrt(turning["copper"].to_numpy(float))
    top, (idle, most) = float(np.percentile(speeds, 99)), np.percentile(loads, [10, 90]).tolist()
    usual, heavy = (float(np.median(each[loads >= most])) for each in (speeds, loads))
    measured = table[TARGET].dropna()
    cold = float(measured.quantile(0.02))
    steps, half = round(WORK_S / model.fit.step_s), 0.5 * top
    ramp = np.repeat([top / 3, 2 * top / 3, top], -(-steps // 3))[:steps]

    def duty(speed: Floats | float, load: float, hold: float, start: float) -> StateSegment:
        heat = np.zeros((steps + round(REST_S / model.fit.step_s), len(SOURCES)))
        heat[:steps] = heat_sources(speed, load, hold)
        frame = pd.DataFrame(heat, columns=list(SOURCES))
        for name in model.records.inputs[len(SOURCES) :]:
            frame[name] = float(table[name].median())
        frame[TARGET] = start
        return replace(training[0], frame=frame, step=model.fit.step_s, bridged=0)

    def rpm(speed: float) -> str:
        return f"{speed / RPM:.0f} rev/min"

    yield f"turn the cold spindle at {rpm(top)} without a cut", duty(top, idle, 0.0, cold)
    yield f"turn the cold spindle at {rpm(half)} without a cut", duty(half, idle, 0.0, cold)
    yield (
        f"turn the cold spindle at {rpm(top / 3)}, {rpm(2 * top / 3)} and {rpm(top)} for a third "
        "of the time each, without a cut", duty(ramp, idle, 0.0, cold)
    )  # fmt: skip
    yield (
        f"cut at {100 * heavy:.0f} % load and {rpm(usual)} from cold",
        duty(usual, heavy, 0.0, cold),
    )
    if model.records.position_control:
        yield "hold the cold spindle in position (C axis)", duty(0.0, 0.0, 1.0, cold)
    warm = duty(0.0, 0.0, 0.0, float(measured.quantile(0.98)))
    yield "stop the spindle when it is warm from work and let it stand", warm
