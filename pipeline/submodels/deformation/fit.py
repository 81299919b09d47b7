"""Fit of spindle growth: sensors, inputs, every method cross-validated, and the champion.

Methods are compared by RMSE, largest error, correlation and relative error with a floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Model, Parameter
from pipeline.schema.predictions import BASELINE
from pipeline.submodels.conformal import Band, Residuals, bands, chosen_step, splits
from pipeline.submodels.deformation.features import InputMaker, input_maker
from pipeline.submodels.deformation.methods import (
    METHODS,
    PERSISTENCE,
    Budget,
    Ensemble,
    Example,
    restored,
    ridge,
)
from pipeline.submodels.deformation.model import (
    KEPT,
    LEFT_OUT,
    MAPE_FLOOR_UM,
    REPLACED,
    DeformationFitSettings,
    DeformationModel,
    GrowthModel,
    Learnt,
    MethodScore,
    TrainingFault,
    Treatment,
    regimes_of,
    treated,
)
from pipeline.submodels.deformation.records import (
    AMBIENT,
    FEWEST_SAMPLES,
    FEWEST_SENSORS,
    GROWTH,
    SPEED,
    DeformationRecords,
    Profile,
    State,
)
from pipeline.submodels.deformation.sensors import SensorModel, fit_sensors
from pipeline.submodels.statistics import jackknife_half_width


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of one prediction."""

    rmse: float
    largest: float
    """[um]."""
    r: float | None
    """Correlation [1]."""
    mape: float
    """Relative error [%], growth below the floor counting as the floor."""


def errors_of(predicted: Floats, measured: Floats) -> Errors:
    """Errors where both have a value.

    ValueError without samples.

    Examples
    --------
    >>> found = errors_of(np.array([11.0, 20.0]), np.array([10.0, 20.0]))
    >>> found.largest, found.mape
    (1.0, 5.0)
    """
    known = np.isfinite(predicted) & np.isfinite(measured)
    if not known.any():
        raise ValueError("no sample of growth is measured and predicted: record growth")
    predicted, measured = predicted[known], measured[known]
    error = predicted - measured
    varies = min(np.ptp(predicted), np.ptp(measured)) > 0
    share = np.abs(error) / np.maximum(np.abs(measured), MAPE_FLOOR_UM)
    return Errors(
        rmse=_rounded(np.sqrt(np.mean(error**2))),
        largest=_rounded(np.abs(error).max()),
        r=_rounded(np.corrcoef(predicted, measured)[0, 1]) if varies else None,
        mape=_rounded(100 * share.mean()),
    )


def _rounded(value: Any) -> float:
    return float(f"{float(value):.4g}")


def method_score(name: str, by_seed: Floats, measured: Floats) -> MethodScore:
    """Score of a method from the predictions of its seeds, shape (seeds, N)."""
    whole = errors_of(by_seed.mean(axis=0), measured)
    single = [errors_of(one, measured).rmse for one in by_seed]
    return MethodScore(
        label=METHODS[name].label, seeds=len(by_seed), rmse_um=whole.rmse, max_um=whole.largest,
        r=whole.r, mape_percent=whole.mape, seed_rmse_um=(min(single), max(single)),
    )  # fmt: skip


def columns_of(name: str, by_seed: Floats) -> dict[str, Floats]:
    """Columns of the predictions of a method: its mean, and each seed where there are several."""
    found = {f"{BASELINE}{name}": by_seed.mean(axis=0)}
    if len(by_seed) > 1:
        found |= {f"{BASELINE}{name} {k + 1}": one for k, one in enumerate(by_seed)}
    return found


PLACES = ("front", "middle", "rear")
"""Groups of sensors in their order."""
STARTS_CHOSEN_BY = "linear_sensors"
"""Method by whose error the number of later starts is chosen: fitted in no time."""
SECONDS = ("linear", "linear_sensors")
"""Methods that the one which serves is held against while it serves, the first that is another."""
FEWEST_PROFILES = 4
"""Training recordings below which nothing can be left out and compared [1]."""


def fit_growth(
    head: Model, profiles: Sequence[Profile], records: DeformationRecords,
    settings: DeformationFitSettings,
) -> GrowthModel:  # fmt: skip
    """Fit and compare all methods on training recordings.

    ``head`` is what every model holds; its parameters are filled in. ValueError with fewer than
    four recordings, or when a method is named that does not exist.
    """
    if len(profiles) < FEWEST_PROFILES:
        raise ValueError(
            f"{len(profiles)} training recordings of growth are of use, {FEWEST_PROFILES} are the "
            "least: record more, or name more in roles.training"
        )
    names, sensors = _methods(profiles, settings.methods), list(records.temperatures)
    model = fit_sensors(profiles, sensors, settings.sensors)
    checked = [model.check(one.state) for one in profiles]
    faults = tuple(
        TrainingFault(case=profile.name, fault=fault)
        for profile, one in zip(profiles, checked, strict=True)
        for fault in one.faults
    )
    treatment = _treatment(profiles, model, faults, settings.lags_s)
    states = [treated(model, one.state, treatment).states[-1] for one in profiles]
    maker = input_maker(states, settings.lags_s)
    examples = [
        Example(name=one.name, inputs=maker.of(state), growth=one.growth)
        for one, state in zip(profiles, states, strict=True)
    ]
    later_starts, learnt_from = _with_best_later_starts(examples, maker, settings)
    left_out = _left_out(examples, learnt_from, names, settings)
    measured = np.concatenate([one.growth for one in examples])
    compared = {
        name: method_score(name, np.concatenate(parts, axis=1), measured)
        for name, parts in left_out.items()
    }
    champion = min(compared, key=lambda name: compared[name].rmse_um)
    residuals = _residuals(examples, left_out[champion], settings)
    intervals = bands(residuals)
    second = _second(compared, champion)
    file = DeformationModel(
        **vars(replace(head, parameters={"": growth_per_kelvin(examples)})),
        sensors=model,
        inputs=maker,
        uses_speed=records.speed is not None,
        uses_ambient=records.ambient is not None,
        champion=champion,
        compared=compared,
        treatment=treatment,
        training_faults=faults,
        later_starts=later_starts,
        learnt=_learnt(sensors, states, learnt_from),
        widening=settings.widening,
        rate_s=settings.rate_s,
        steady_K_h=settings.steady_K_h,
        bands=intervals,
        adaptive_step=chosen_step(
            residuals, intervals, settings.adaptive_steps, settings.probe_delay_s
        ),
        probe_delay_s=settings.probe_delay_s,
        second=second,
        agreement_um=_agreement(left_out, champion, second, intervals, settings),
        places=records.places,
    )
    return GrowthModel(file, _fitted(learnt_from, names, settings))


def _second(compared: Mapping[str, MethodScore], champion: str) -> str:
    """A regression that is not the champion, else the next best method; empty without any."""
    ranked = sorted(compared, key=lambda name: compared[name].rmse_um)
    wanted = [name for name in (*SECONDS, *ranked) if name in compared]
    return next((name for name in wanted if name not in (champion, PERSISTENCE)), "")


def _agreement(
    left_out: Mapping[str, Sequence[Floats]], champion: str, second: str,
    intervals: Mapping[str, Band], settings: DeformationFitSettings,
) -> float:  # fmt: skip
    """Largest usual difference of two methods [um], several times as much as for a sensor.

    Usual is the median over recordings left out of both, and never less than the 90 % interval is
    wide.
    """
    if not second:
        return 0.0
    largest = [
        float(np.abs(one.mean(axis=0) - other.mean(axis=0)).max())
        for one, other in zip(left_out[champion], left_out[second], strict=True)
    ]
    width = max(one.lower + one.upper for one in intervals.values())
    return float(f"{max(settings.sensors.times * float(np.median(largest)), width):.4g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    method: str
    seed: int
    budget: Budget
    examples: tuple[Example, ...]
    others: tuple[Example, ...] = ()


def _done(task: _Task) -> tuple[dict[str, Any], list[Floats]]:
    fitted = METHODS[task.method].fit(task.examples, task.budget, task.seed)
    return fitted.document(), [fitted.predict(one.inputs) for one in task.others]


def _seeds(name: str, many: int) -> range:
    return range(many if METHODS[name].seeded else 1)


def _methods(profiles: Sequence[Profile], named: Sequence[str]) -> tuple[str, ...]:
    """Methods to compare; ValueError for an unknown one or one without its channel."""
    turning = any(one.state.speed.any() for one in profiles)
    air = all(np.isfinite(one.state.ambient).all() for one in profiles)
    able = [
        name for name, method in METHODS.items()
        if (turning or not method.needs_speed) and (air or not method.needs_ambient)
    ]  # fmt: skip
    if strange := [name for name in named if name not in able]:
        raise ValueError(
            f"deformation_fit.methods names {strange[0]!r}: with the channels recorded choose "
            f"among {', '.join(able)}"
        )
    # what no model may be worse than is always there
    return tuple(dict.fromkeys((PERSISTENCE, *named))) if named else tuple(able)


def with_later_starts(one: Example, maker: InputMaker, starts: int) -> list[Example]:
    """A recording, and its parts as if the probe had been set to zero later, evenly spread.

    A part begins with a machine in whatever state it was, so that a few recordings show many
    warm starts.  It begins at the next sample with growth.
    """
    found, state = [one], one.inputs.state
    known = np.flatnonzero(np.isfinite(one.growth))
    for k in range(1, starts + 1):
        later = known[known >= k * len(state) // (starts + 1)]
        if len(later) > FEWEST_SAMPLES:
            first = int(later[0])
            growth = one.growth[first:] - one.growth[first]
            found.append(
                Example(
                    name=one.name, inputs=maker.of(state.within(slice(first, None))), growth=growth
                )
            )
    return found


def _with_best_later_starts(
    examples: Sequence[Example], maker: InputMaker, settings: DeformationFitSettings
) -> tuple[int, list[Example]]:
    """Number of later starts with the least error on recordings left out, and all the parts."""
    choices = {
        many: [part for one in examples for part in with_later_starts(one, maker, many)]
        for many in settings.later_starts
    }
    measured = np.concatenate([one.growth for one in examples])

    def error(many: int) -> float:
        name, alone = STARTS_CHOSEN_BY, replace(settings, compute="serial")
        parts = _left_out(examples, choices[many], [name], alone)[name]
        return method_score(name, np.concatenate(parts, axis=1), measured).rmse_um

    best = settings.later_starts[0]
    if len(choices) > 1:
        best = min(choices, key=error)
    return best, choices[best]


def _left_out(
    examples: Sequence[Example], learnt_from: Sequence[Example], names: Sequence[str],
    settings: DeformationFitSettings,
) -> dict[str, list[Floats]]:  # fmt: skip
    """Predictions of each recording by fits of the others, shape (seeds, T) each, by method."""
    budget = Budget(training=settings.training, every_s=settings.every_s)
    by_name = {one.name: one for one in examples}
    pairs = list(splits(spread(list(by_name), settings.folds), settings.folds))
    tasks = [
        _Task(
            method=name, seed=seed, budget=budget,
            examples=tuple(one for one in learnt_from if one.name in fitted),
            others=tuple(by_name[n] for n in out),
        )
        for name in names
        for fitted, out in pairs
        for seed in _seeds(name, settings.seeds_left_out)
    ]  # fmt: skip
    found: dict[str, dict[str, list[Floats]]] = {name: {} for name in names}
    for task, (_, growth) in zip(
        tasks, mapped(_done, tasks, compute=settings.compute), strict=True
    ):
        for one, values in zip(task.others, growth, strict=True):
            found[task.method].setdefault(one.name, []).append(values)
    return {name: [np.array(parts[one.name]) for one in examples] for name, parts in found.items()}


def spread(names: list[str], folds: int) -> list[str]:
    """Names in an order whose neighbouring folds are spread over the recordings.

    Recordings of a kind are often made one after another; a fold takes every so-many-th one.

    Examples
    --------
    >>> spread(["a", "b", "c", "d"], 2)
    ['a', 'c', 'b', 'd']
    """
    return [name for k in range(folds) for name in names[k::folds]]


def _fitted(
    examples: Sequence[Example], names: Sequence[str], settings: DeformationFitSettings
) -> dict[str, Ensemble]:
    budget = Budget(training=settings.training, every_s=settings.every_s)
    tasks = [
        _Task(method=name, seed=seed, budget=budget, examples=tuple(examples))
        for name in names
        for seed in _seeds(name, settings.seeds)
    ]
    documents: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    for task, (document, _) in zip(
        tasks, mapped(_done, tasks, compute=settings.compute), strict=True
    ):
        documents[task.method].append(document)
    return {name: restored(name, parts) for name, parts in documents.items()}


def _treatment(
    profiles: Sequence[Profile], sensors: SensorModel, faults: Sequence[TrainingFault],
    lags_s: Sequence[float],
) -> Treatment:  # fmt: skip
    """Treatment of faulty sensors with the least error of a linear regression, cross-validated."""
    if not faults:
        return Treatment(chosen=REPLACED)
    lost = tuple(name for name in sensors.sensors if name in {f.fault.sensor for f in faults})
    choices = [Treatment(chosen=REPLACED), Treatment(chosen=KEPT)]
    if len(sensors.sensors) - len(lost) >= FEWEST_SENSORS:
        choices.insert(1, Treatment(chosen=LEFT_OUT, ignored=lost))
    errors = {}
    for choice in choices:
        states = [treated(sensors, one.state, choice).states[-1] for one in profiles]
        maker = input_maker(states, lags_s)
        x = [maker.of(state).linear for state in states]
        errors[choice.chosen] = _linear_left_out(x, [one.growth for one in profiles])
    # a fault that was noticed teaches by chance alone: as it is, it never serves
    best = min((c for c in choices if c.chosen != KEPT), key=lambda one: errors[one.chosen])
    return replace(best, rmse_um=errors)


def _linear_left_out(x: Sequence[Floats], growth: Sequence[Floats]) -> float:
    """RMSE of the linear regression over recordings left out one by one [um]."""
    errors = []
    for out in range(len(x)):
        rest = [k for k in range(len(x)) if k != out]
        fitted = ridge([x[k] for k in rest], [growth[k] for k in rest], "linear")
        errors.append(x[out] @ fitted.weights - growth[out])
    return float(f"{float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2))):.4g}")


def _residuals(
    examples: Sequence[Example], predicted: Sequence[Floats], settings: DeformationFitSettings
) -> Residuals:
    return Residuals.joined(
        Residuals(
            error=one.growth - growth.mean(axis=0),
            regime=regimes_of(one.inputs, settings.rate_s, settings.steady_K_h),
            group=np.full(len(one.growth), one.name),
            t=one.inputs.time,
        )
        for one, growth in zip(examples, predicted, strict=True)
    )


def _learnt(
    sensors: Sequence[str], states: Sequence[State], examples: Sequence[Example]
) -> dict[str, Learnt]:
    """Range of each input over the training recordings, and of growth since all their starts."""

    def over(values: Sequence[Floats], unit: str) -> Learnt:
        every = np.concatenate([np.ravel(v) for v in values])
        return Learnt(low=float(f"{every.min():.5g}"), high=float(f"{every.max():.5g}"), unit=unit)

    found = {
        name: over([s.temperatures[:, k] for s in states], "degC") for k, name in enumerate(sensors)
    }
    found[GROWTH] = over([e.growth[np.isfinite(e.growth)] for e in examples], "um")
    found[SPEED] = over([s.speed for s in states], "rev/min")
    if all(np.isfinite(s.ambient).all() for s in states):
        found[AMBIENT] = over([s.ambient for s in states], "degC")
    return found


def growth_per_kelvin(examples: Sequence[Example]) -> dict[str, Parameter]:
    """Growth for a kelvin of each group, front, middle and rear, all else being equal [um/K].

    Ridge regression on the groups' temperatures; the interval is that of a jackknife over whole
    recordings, whose samples hang together.
    """
    x, y = [one.inputs.groups for one in examples], [one.growth for one in examples]

    def fitted(out: int) -> Floats:
        rest = [k for k in range(len(x)) if k != out]
        return ridge([x[k] for k in rest], [y[k] for k in rest], "groups").weights

    weights, half = fitted(-1), jackknife_half_width(np.array([fitted(k) for k in range(len(x))]))
    found = {}
    for name, value, width in zip(PLACES, weights.tolist(), half.tolist(), strict=True):
        known = width < abs(value)
        found[f"{name}_growth_per_kelvin"] = Parameter(
            value=float(f"{value:.4g}") if known else None,
            unit="um/K",
            interval_95=_interval(value, width) if known else None,
            determined=known,
            method="regression of growth on the temperatures of the groups of sensors, jackknife "
            "over recordings" if known else "its 95 % interval holds zero",
            remedy="" if known else "record profiles in which front and rear warm differently",
        )  # fmt: skip
    return found


def _interval(value: float, half: float) -> tuple[float, float]:
    return float(f"{value - half:.4g}"), float(f"{value + half:.4g}")
