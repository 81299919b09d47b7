"""Correction of spindle growth for a control: sums of lagged inputs, with its range.

Growth [um] is a sum of terms: a coefficient times an input since the start, low-passed by no, one
or two first-order lags.  Beside them stand terms of the start alone, a coefficient times a
temperature at the start times 1 - exp(-t / lag): what a machine that starts warm does by itself.
The offset that takes growth off is +growth along +Z: Z points away from the workpiece (ISO 841), a
spindle grows towards it.

A ridge regression is such a sum already, also where it leaves sensors out and reads others in their
place: the correction equals it but for rounding.  Any other method is linearised: the ridge
regression on every sensor that comes closest to its predictions over the training recordings stands
for it, and the difference is stated.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.submodels.conformal import Band
from pipeline.submodels.deformation.features import AT_TOP_SPEED
from pipeline.submodels.deformation.methods import Ridge, ridge
from pipeline.submodels.deformation.model import GrowthModel, Learnt
from pipeline.submodels.deformation.records import AMBIENT, GROWTH, SPEED, State
from pipeline.thermal.sensors import lag

ONE = "1"
"""Name of the input that is always 1."""
SPEED_UNIT = 1000.0
"""Speed whose square is the unit of the squared speed [rev/min]."""
DIGITS = 9
"""Significant digits of a coefficient [1]."""
EACH = "each_sensor"
"""Inputs of the regression that stands for a method that is not linear."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """A coefficient times an input since the start, low-passed."""

    input: str
    """A sensor or the ambient temperature, above its value at the start [K]; the square of the
    speed in 1000 rev/min less that at the start."""
    lags_s: tuple[float, ...]
    """Time constants of the lags, one after the other [s]; none, one or two."""
    um: float
    """Coefficient [um per unit of the input]."""


@dataclass(frozen=True, kw_only=True)
class StartTerm:
    """A coefficient times an input at the start times 1 - exp(-t / lag)."""

    input: str
    """A temperature at the start [degC], or ``1``."""
    lag_s: float
    """Time constant [s]."""
    um: float
    """Coefficient [um per degC], [um] of the input 1."""


@dataclass(frozen=True, kw_only=True)
class Correction:
    """Growth as a sum of terms, what it was compared with, and where it holds."""

    inputs: tuple[str, ...]
    """Input channels: sensors from front to rear, the ambient temperature, the speed."""
    period_s: float
    """Time between two rows [s]."""
    terms: tuple[Term, ...]
    starts: tuple[StartTerm, ...]
    """Start terms of the sum."""
    exact: bool
    """Whether the method that serves is such a sum."""
    largest_um: float
    rmse_um: float
    """Difference to the method that serves, over ``recordings`` training recordings [um]."""
    recordings: int
    """Recordings [1]."""
    growth_um: tuple[float, float]
    """Least and greatest growth of these recordings [um]."""
    ranges: Mapping[str, Learnt]
    """Training range of each input and of growth, and the accepted share beyond its ends."""
    bands: Mapping[str, Band]
    """90 % intervals of the method by regime [um]."""

    @property
    def chains(self) -> tuple[tuple[float, ...], ...]:
        """Lags of the terms, each chain once, the shortest first."""
        found = {one.lags_s for one in self.terms}
        return tuple(sorted(found, key=lambda lags: (len(lags), lags)))

    @property
    def interval_um(self) -> tuple[float, float]:
        """Farthest below and above growth of any regime's 90 % interval, with the difference."""
        below = max((one.lower for one in self.bands.values()), default=0.0)
        above = max((one.upper for one in self.bands.values()), default=0.0)
        return below + self.largest_um, above + self.largest_um

    def growth(self, values: Mapping[str, Floats]) -> Floats:
        """Growth since the first row [um], (T,), from temperatures [degC] and speed [rev/min]."""
        many = len(values[self.inputs[0]])
        time = self.period_s * np.arange(many)
        since = {name: since_start(name, values[name]) for name in self.inputs}
        total = np.zeros(many)
        for chain in self.chains:
            summed = np.zeros(many)
            for one in self.terms:
                if one.lags_s == chain:
                    summed += one.um * since[one.input]
            for constant in chain:
                summed = lag(time, summed, constant)
            total += summed
        for start in self.starts:
            first = 1.0 if start.input == ONE else float(values[start.input][0])
            total += start.um * first * (1 - np.exp(-time / start.lag_s))
        return total


def since_start(name: str, values: Floats) -> Floats:
    """An input above its first value: [K], of the speed its square in (1000 rev/min)^2."""
    one = (values / SPEED_UNIT) ** 2 if name == SPEED else values
    return one - one[0]


@dataclass(eq=False)
class _Sums:
    terms: dict[tuple[str, tuple[float, ...]], float] = field(
        default_factory=lambda: defaultdict(float)
    )
    starts: dict[tuple[str, float], float] = field(default_factory=lambda: defaultdict(float))


def correction(model: GrowthModel, states: Sequence[State]) -> Correction:
    """The champion as a sum of terms; ValueError without a recording, or with zero growth."""
    file = model.file
    checked = [model.checked(one) for one in states]
    sound = [one for one in checked if not one.faults] or checked
    if not sound:
        raise ValueError(
            "none of the recordings that the growth model learnt from is there: run `dvc repro`"
        )
    inputs = [file.inputs.of(one.states[-1]) for one in sound]
    growth = [model.champion.predict(one) for one in inputs]
    if not any(np.abs(one).max() > 0 for one in growth):
        raise ValueError(
            f"{file.compared[file.champion].label} serves, which predicts no growth: there is "
            "nothing to correct; record more speed profiles"
        )
    members = model.champion.members
    exact = all(isinstance(one, Ridge) for one in members)
    regressions = [one for one in members if isinstance(one, Ridge)] if exact else [
        ridge([getattr(one, EACH) for one in inputs], growth, EACH)
    ]  # fmt: skip
    sums = _Sums()
    coldest = int(np.argmin(np.mean([_starts(model, one.state) for one in inputs], axis=0)))
    for one in regressions:
        _take_apart(one, model, coldest, 1 / len(regressions), sums)
    _replace_ignored(model, sums)
    names = tuple(name for name in file.channels if name not in file.treatment.ignored)
    found = Correction(
        inputs=names, period_s=file.sensors.period_s, terms=_terms(sums), starts=_start_terms(sums),
        exact=exact, largest_um=0.0, rmse_um=0.0, recordings=len(sound),
        growth_um=(float(min(g.min() for g in growth)), float(max(g.max() for g in growth))),
        ranges={name: _accepted(file.learnt[name], file.widening)
                for name in (*names, GROWTH) if name in file.learnt},
        bands=file.bands,
    )  # fmt: skip
    apart = [found.growth(file.values(one.state)) - g
             for one, g in zip(inputs, growth, strict=True)]  # fmt: skip
    off = np.concatenate(apart)
    largest, rmse = float(np.abs(off).max()), float(np.sqrt(np.mean(off**2)))
    return replace(found, largest_um=float(f"{largest:.3g}"), rmse_um=float(f"{rmse:.3g}"))


def _accepted(learnt: Learnt, widening: float) -> Learnt:
    """Accepted range of an input; that of a speed begins at 0 or above."""
    low, high = learnt.accepted(widening)
    low = max(low, 0.0) if learnt.unit == "rev/min" else low
    return replace(learnt, low=float(f"{low:.5g}"), high=float(f"{high:.5g}"))


def _starts(model: GrowthModel, state: State) -> Floats:
    """Temperature of each group at the start [degC]; shape (C,)."""
    return np.array(model.file.inputs.weights) @ state.temperatures[0]


def _take_apart(one: Ridge, model: GrowthModel, coldest: int, share: float, into: _Sums) -> None:
    """Add the weights of a regression, in the order in which its inputs are made."""
    file, weights = model.file, iter((share * one.weights).tolist())
    sensors, groups = file.sensors.sensors, np.array(file.inputs.weights)
    lags = file.inputs.lags_s
    # rises stand for themselves, groups for the sensors that they are made of
    made = groups if one.inputs == "linear" else np.eye(len(sensors))
    for chain in ((),) if one.inputs == "rises" else ((), *((constant,) for constant in lags)):
        for row in made:
            weight = next(weights)
            for name, part in zip(sensors, row.tolist(), strict=True):
                into.terms[name, chain] += weight * part
    if one.inputs == "rises":
        return
    top = file.inputs.top_speed or 1.0
    into.terms[SPEED, ()] += next(weights) * AT_TOP_SPEED * (SPEED_UNIT / top) ** 2
    if file.uses_ambient:
        for chain in ((), *((constant,) for constant in lags)):
            into.terms[AMBIENT, chain] += next(weights)
    for constant in lags:
        for row in groups:
            weight = next(weights)
            for name, part in zip(sensors, row.tolist(), strict=True):
                into.starts[name, constant] += weight * part
            if file.uses_ambient:
                into.starts[AMBIENT, constant] -= weight
            else:  # the coldest group stands for the air
                for name, part in zip(sensors, groups[coldest].tolist(), strict=True):
                    into.starts[name, constant] -= weight * part


def _replace_ignored(model: GrowthModel, sums: _Sums) -> None:
    """Put the other sensors in the place of those that are not read."""
    check = model.file.sensors
    gone = frozenset(check.sensors.index(name) for name in model.file.treatment.ignored)
    channels = (*check.sensors, AMBIENT)[: check.channels]
    blocks = ((), *((constant,) for constant in check.settings.lags_s))
    mean = np.array(check.mean)
    for sensor in sorted(gone):
        used, weights, _ = check.regression(sensor, gone)
        constant = mean[sensor] - float(mean[used] @ weights)
        each = list(zip(used.tolist(), weights.tolist(), strict=True))
        name = check.sensors[sensor]
        for (_, chain), um in _taken(sums.terms, name):
            for column, weight in each:
                block, channel = divmod(column, check.channels)
                sums.terms[channels[channel], (*blocks[block], *chain)] += um * weight
        for (_, lag_s), um in _taken(sums.starts, name):
            for column, weight in each:
                sums.starts[channels[column % check.channels], lag_s] += um * weight
            sums.starts[ONE, lag_s] += um * constant


Lags = TypeVar("Lags")


def _taken(sums: dict[tuple[str, Lags], float], name: str) -> list[tuple[tuple[str, Lags], float]]:
    keys = [key for key in sums if key[0] == name]
    return [(key, sums.pop(key)) for key in keys]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _terms(sums: _Sums) -> tuple[Term, ...]:
    every = sorted(sums.terms.items(), key=lambda one: (len(one[0][1]), one[0][1], one[0][0]))
    found = (Term(input=name, lags_s=chain, um=_rounded(um)) for (name, chain), um in every)
    return tuple(one for one in found if one.um != 0)


def _start_terms(sums: _Sums) -> tuple[StartTerm, ...]:
    every = sorted(sums.starts.items(), key=lambda one: (one[0][1], one[0][0]))
    found = (
        StartTerm(input=name, lag_s=constant, um=_rounded(um)) for (name, constant), um in every
    )
    return tuple(one for one in found if one.um != 0)
