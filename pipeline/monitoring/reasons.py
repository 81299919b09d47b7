"""Causes of a night's errors, by what the residual (measured less predicted) goes with.

Each cause has a regressor: a constant for the sensor, the rise of temperature for heat, velocity or
its sign for friction, the force times the cutting time for wear.  Its part of the residual is the
root mean square of the best multiple of it.  Noise of the sensor is what differs from one sample to
the next.  Parts count by how far they lie above those of the quiet nights before.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from statistics import median

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ledger import Night, Reason
from pipeline.schema.verdict import OutsideConditions, significant, widening
from pipeline.submodels.contract import CUTTING_TIME, TEMPERATURE_RISE, VELOCITY

OFFSET, NOISE, STUCK = "offset", "noise", "stuck"
"""Parts of the residual that a sensor alone makes."""
ALL_REGRESSORS = "all"
"""Part of the residual that goes with all regressors together."""
CAUSES: Mapping[str, Reason] = {
    OFFSET: "sensor", NOISE: "sensor", STUCK: "sensor", TEMPERATURE_RISE: "heat",
    VELOCITY: "friction", CUTTING_TIME: "wear",
}  # fmt: skip
"""Reason by the part of the residual."""
REMEDIES: Mapping[str, str] = {
    OFFSET: "check the sensor and its zero first",
    NOISE: "check the sensor, its cable and its ground first",
    STUCK: "the sensor does not move: change it first",
    TEMPERATURE_RISE: "check coolant, chiller and fans first",
    VELOCITY: "check lubrication, gibs and covers of the axis first",
    CUTTING_TIME: "change the tool first",
}
"""Check at the machine before anything is fitted, by the part of the residual."""
MEANINGS: Mapping[str, str] = {
    OFFSET: "measured less predicted is the same at all times",
    NOISE: "what is measured jumps from sample to sample",
    STUCK: "what is measured stands still while the prediction moves",
    TEMPERATURE_RISE: "measured less predicted goes with the rise of the temperature",
    VELOCITY: "measured less predicted goes with the velocity of the axis and its sign",
    CUTTING_TIME: "measured less predicted grows with the cutting time of the tool",
}
"""Observation behind a reason, by the part of the residual."""
HALF = 0.5
"""Share of the samples from which on a constant reading is a stuck one [1]."""
LEAST_EXPLAINED = 0.3
"""Share of the rise of the squared residual that a cause has to explain [1]."""
CLEAR = 0.5
"""Squared residual that the best cause leaves to the other regressors, over the one that another
cause leaves, up to which the best one is clear [1]; half as much on a single night."""


def parts_of(
    measured: Floats, predicted: Floats, influences: Mapping[str, Floats]
) -> dict[str, float]:
    """Part of the residual that goes with each cause, with its sign [unit].

    All arrays (T,), in order of time; ``influences`` as of
    :meth:`~pipeline.submodels.contract.SubModel.influences`.

    Examples
    --------
    >>> rise = np.array([0.0, 1.0, 3.0, 2.0])
    >>> parts_of(20 + 1.2 * rise, 20 + rise, {"temperature_rise": rise})["temperature_rise"]
    0.374166
    """
    residual = measured - predicted
    regressors = {OFFSET: np.ones_like(residual)}
    for name, values in influences.items():
        one = np.nan_to_num(values)
        some = {VELOCITY: [np.sign(one), one], CUTTING_TIME: [one * predicted]}.get(name, [one])
        regressors[name] = max(some, key=lambda each: abs(_part(residual, each)))
    found = {name: _part(residual, one) for name, one in regressors.items()}
    every = np.column_stack(list(regressors.values()))
    fitted = every @ np.linalg.lstsq(every, residual, rcond=None)[0]
    found[ALL_REGRESSORS] = float(np.sqrt(np.mean(fitted**2)))
    jumps = np.diff(residual)
    found[NOISE] = float(np.sqrt(np.mean(jumps**2) / 2)) if len(jumps) else 0.0
    found[STUCK] = _stuck(measured, predicted)
    return {name: significant(value) for name, value in found.items()}


def _part(residual: Floats, regressor: Floats) -> float:
    """Root mean square of the best multiple of a regressor, with the multiple's sign."""
    size = float(regressor @ regressor)
    if not size:
        return 0.0
    return float(residual @ regressor) / size * float(np.sqrt(size / len(residual)))


def _stuck(measured: Floats, predicted: Floats) -> float:
    """Root mean square of the residual where one reading stands for half of the time, else 0."""
    lengths = [len(list(some)) for _, some in groupby(measured.tolist())]
    if not lengths or max(lengths) < HALF * len(measured):
        return 0.0
    start = sum(lengths[: lengths.index(max(lengths))])
    moved = predicted[start : start + max(lengths)]
    size = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    return size if float(np.std(moved)) > HALF * size else 0.0


def beyond(outside: Iterable[OutsideConditions]) -> tuple[float, str]:
    """Greatest distance beyond a learnt range over its width [1], and that condition in words."""
    far = max(outside, key=widening, default=None)
    if far is None:
        return 0.0, ""
    value = far.value if isinstance(far.value, str) else f"{far.value:.4g} {far.unit}".rstrip()
    return significant(widening(far) - 1), f"{far.condition} is {value}, learnt was {far.learnt}"


def causes(nights: Sequence[Night], quiet: Iterable[Night]) -> list[str]:
    """The part that explains most of the residuals, of those that rose over the quiet nights.

    ``nights`` are the targets of the nights of a fault, over which the explained shares are summed.
    Parts of other reasons follow where the first one is not clear: it leaves more than
    :data:`CLEAR` of what they leave, of all that the regressors explain together.  None where no
    part explains enough of a rise.
    """
    before, rose, shares = list(quiet), dict[str, float](), dict[str, float]()
    for night in nights:
        usual = [one for one in before if one.target == night.target]
        if not night.rmse:
            continue
        rise = night.rmse**2 - _median([(one.rmse or 0.0) ** 2 for one in usual])
        for name, part in night.parts.items():
            own = part**2 - _median([one.parts.get(name, 0.0) ** 2 for one in usual])
            share = part**2 / night.rmse**2
            shares[name] = shares.get(name, 0.0) + share
            if name in CAUSES and own > LEAST_EXPLAINED * rise > 0:
                rose[name] = rose.get(name, 0.0) + share
    if not rose:
        return []
    best = max(rose, key=lambda name: rose[name])
    most = max(shares.get(ALL_REGRESSORS, 0.0), shares[best])
    clear = CLEAR if len({one.night for one in nights}) > 1 else CLEAR / 2
    others = [name for name in rose if CAUSES[name] != CAUSES[best]
              and most - shares[best] > clear * (most - shares[name])]  # fmt: skip
    return [best, *others]


def _median(values: Sequence[float]) -> float:
    return median(values) if values else 0.0
