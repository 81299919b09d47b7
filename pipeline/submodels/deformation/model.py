"""Stored model of spindle growth, its settings, and its prediction for one recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pipeline.nets.settings import TrainingSettings
from pipeline.parallel import Compute
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Model
from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged
from pipeline.schema.store import read_json
from pipeline.submodels.conformal import Band
from pipeline.submodels.deformation.features import InputMaker, Inputs, rates
from pipeline.submodels.deformation.methods import Ensemble, restored
from pipeline.submodels.deformation.records import AMBIENT, GROWTH, SPEED, State
from pipeline.submodels.deformation.sensors import Checked, Fault, SensorModel, SensorSettings

WARMING, COOLING, STEADY = "warming", "cooling", "steady"
REGIMES = (WARMING, COOLING, STEADY)
"""Regimes by the rate of the groups' mean temperature over the past."""
AGREED = 0.5
"""Difference of two methods, as a share of the growth, up to which there is a correction [1]."""
MAPE_FLOOR_UM = 5.0
"""Growth below which an error is taken as a share of this value [um]: at zero growth a relative
error has no meaning."""


@dataclass(frozen=True, kw_only=True)
class DeformationFitSettings(Ranged, section="deformation_fit"):
    """Fit and comparison of the methods."""

    lags_s: tuple[Annotated[float, Range(above=0.0)], ...] = (600.0, 2400.0, 7200.0)
    """Time constants of the lags among the inputs [s]."""
    folds: Annotated[int, Range(least=2)] = 7
    """Groups of whole training recordings that are left out in turn."""
    seeds: Count = 5
    """Fits of each method that depends on a seed; what is served is their mean."""
    seeds_left_out: Count = 2
    """Fits of such a method on each fold."""
    later_starts: tuple[Annotated[int, Range(least=0)], ...] = (0, 2, 5)
    """Each training recording is also learnt from with its start moved to so many later times: a
    machine that is warm when the probe is set to zero.  Of these numbers the one with which the
    linear regression errs least on recordings left out."""
    methods: tuple[str, ...] = ()
    """Methods that are compared; by default all that the recorded channels allow."""
    training: TrainingSettings = field(default_factory=TrainingSettings)
    """Budget of each network, the same for all."""
    every_s: Positive = 360.0
    """Time between two samples that networks and physical models learn from [s]; neighbours say
    nearly the same."""
    sensors: SensorSettings = field(default_factory=SensorSettings)
    """Settings of the plausibility check of the temperature sensors."""
    rate_s: Positive = 600.0
    """Time constant of the detection of warming and cooling [s]."""
    steady_K_h: Positive = 2.0
    """Rate below which the spindle counts as steady [K/h]."""
    widening: NotNegative = 0.25
    """Accepted share of the training range of temperatures and speeds beyond its ends [1]."""
    probe_delay_s: NotNegative = 600.0
    """Delay of a probe reading in the adaptive interval [s]."""
    adaptive_steps: tuple[Annotated[float, Range(least=0.0)], ...] = (0.0, 0.03, 0.1, 0.3, 1.0)
    """Steps of the adaptive interval to choose from on training recordings; 0 keeps it fixed."""
    compute: Compute = "processes"
    """Place of computation of the fits."""


@dataclass(frozen=True, kw_only=True)
class MethodScore:
    """Errors of a method on training recordings left out of its fit."""

    label: str
    """Label for readers."""
    seeds: int
    """Fits on each fold [1]."""
    rmse_um: float
    max_um: float
    """Greatest error of the mean prediction over the seeds [um]."""
    r: float | None
    """Correlation with what was measured [1]; None where the prediction is constant."""
    mape_percent: float
    """Mean relative error, growth below 5 um counting as 5 um [%]."""
    seed_rmse_um: tuple[float, float]
    """Least and greatest RMSE of a single seed [um]."""


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """Range of an input over the training recordings, in its unit."""

    low: float
    high: float
    unit: str

    def accepted(self, widening: float) -> tuple[float, float]:
        """Ends beyond which nothing is predicted, ``widening`` of the range beyond the learnt."""
        beyond = widening * (self.high - self.low)
        return self.low - beyond, self.high + beyond


@dataclass(frozen=True, kw_only=True)
class TrainingFault:
    """A faulty sensor in a training recording."""

    case: str
    fault: Fault


REPLACED, LEFT_OUT, KEPT = "replaced", "left out", "kept"
"""Treatments: a faulty sensor is replaced once it is noticed; sensors that were faulty in training
are not read at all, others replaced; all are kept as they are."""


@dataclass(frozen=True, kw_only=True)
class Treatment:
    """Treatment of faulty sensors, and its reason."""

    chosen: str
    """Chosen treatment."""
    ignored: tuple[str, ...] = ()
    """Sensors that are not read."""
    rmse_um: Mapping[str, float] = field(default_factory=dict)
    """Rmse of the linear regression on training recordings left out, by treatment [um]; empty where
    no training recording has a faulty sensor.  That with all kept is shown and never chosen."""


@dataclass(frozen=True, kw_only=True)
class DeformationModel(Model):
    """The content of ``model.json``; the fits of all methods stand in ``methods.json``."""

    sensors: SensorModel
    """Check and replacement of the temperature sensors."""
    inputs: InputMaker
    """Inputs of the methods."""
    uses_speed: bool
    """Whether the spindle speed is among the inputs."""
    uses_ambient: bool
    """Whether the ambient temperature is."""
    champion: str
    """Method that serves: the one with the least RMSE on recordings left out."""
    compared: Mapping[str, MethodScore]
    """All methods, on training recordings left out."""
    treatment: Treatment
    """Treatment of faulty sensors."""
    training_faults: tuple[TrainingFault, ...]
    """Found in the training recordings."""
    later_starts: int
    """Later starts of each training recording that were learnt from as well [1]."""
    learnt: Mapping[str, Learnt]
    """Range of each input, and of growth since any start."""
    widening: float
    """Share of a range by which an input may lie beyond it [1]."""
    rate_s: float
    steady_K_h: float
    """Limits of the regimes [s], [K/h]."""
    bands: Mapping[str, Band]
    """90 % intervals by regime [um]."""
    adaptive_step: float
    """Step of the interval that follows the probe [1]."""
    probe_delay_s: float
    """Delay of a probe reading in it [s]."""
    second: str = ""
    """Method that the one which serves has to agree with; empty where there is no other."""
    agreement_um: float = 0.0
    """Difference between the two from which there is no correction [um]."""
    places: Mapping[str, str] = field(default_factory=dict)
    """Places of sensors, in words, by their names, as far as the machine's file has them."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Input channels: sensors from front to rear, the ambient temperature, the speed."""
        used = {AMBIENT: self.uses_ambient, SPEED: self.uses_speed}
        return (*self.sensors.sensors, *(name for name in used if used[name]))

    def values(self, state: State) -> dict[str, Floats]:
        """Values of a state's channels that are read, by name [degC], [rev/min]; shape (T,)."""
        columns = (*state.temperatures.T, state.ambient, state.speed)
        named = dict(zip((*self.sensors.sensors, AMBIENT, SPEED), columns, strict=True))
        return {name: named[name] for name in self.channels}


@dataclass(frozen=True, kw_only=True)
class MethodsFile:
    """The content of ``methods.json``: documents of each method, one a seed."""

    documents: Mapping[str, tuple[dict[str, Any], ...]]


def regimes_of(inputs: Inputs, rate_s: float, steady: float) -> np.ndarray:
    """Regime of each sample as a word, from its past alone; shape (T,)."""
    rate = rates(inputs, rate_s)
    return np.select([rate > steady, rate < -steady], [WARMING, COOLING], STEADY)


@dataclass(frozen=True, eq=False)
class GrowthModel:
    """A stored model with its methods, ready to predict."""

    file: DeformationModel
    ensembles: Mapping[str, Ensemble]

    @cached_property
    def champion(self) -> Ensemble:
        """The method that serves."""
        return self.ensembles[self.file.champion]

    def checked(self, state: State) -> Checked:
        """The state with its faulty sensors treated as the model does."""
        return treated(self.file.sensors, state, self.file.treatment)

    def pieces(self, checked: Checked) -> list[tuple[int, Inputs]]:
        """First sample and inputs of each state of a recording, in the order of time."""
        states = zip(checked.since, checked.states, strict=True)
        return [(first, self.file.inputs.of(state)) for first, state in states]

    def stitched(self, pieces: Sequence[tuple[int, Inputs]], name: str = "") -> Floats:
        """Growth by a method [um], by each of its seeds in the first axis; shape (seeds, T).

        Each stretch of time is predicted from the state of the sensors in it.
        """
        ensemble = self.ensembles[name] if name else self.champion
        result = ensemble.each(pieces[0][1])
        for first, inputs in pieces[1:]:
            result[:, first:] = ensemble.each(inputs)[:, first:]
        return result

    def withheld(self, pieces: Sequence[tuple[int, Inputs]], growth: Floats) -> np.ndarray:
        """Reason for no correction by sample, "" where there is one; ``growth`` [um]; (T,) each."""
        file, found = self.file, np.full(len(growth), "", dtype=object)
        if file.second:
            apart = np.abs(growth - self.stitched(pieces, file.second).mean(axis=0))
            # within a share of the growth either of them leaves less than no correction does
            limit = np.maximum(file.agreement_um, AGREED * np.abs(growth))
            found[apart > limit] = f"two methods differ by more than {file.agreement_um:.3g} um"
        if GROWTH in file.learnt:
            low, high = file.learnt[GROWTH].accepted(file.widening)
            found[(growth < low) | (growth > high)] = (
                f"growth beyond {low:.3g} to {high:.3g} um was not learnt"
            )
        return found

    def regimes(self, pieces: Sequence[tuple[int, Inputs]]) -> np.ndarray:
        """Regime of each sample, from the state of the sensors then; shape (T,)."""
        file = self.file
        result = regimes_of(pieces[0][1], file.rate_s, file.steady_K_h)
        for first, inputs in pieces[1:]:
            result[first:] = regimes_of(inputs, file.rate_s, file.steady_K_h)[first:]
        return result


def treated(sensors: SensorModel, state: State, treatment: Treatment) -> Checked:
    """A state whose faulty sensors are treated; single missing samples are always replaced."""
    if treatment.chosen != KEPT:
        return sensors.check(state, treatment.ignored)
    found = sensors.check(state)
    one = sensors.replaced(state, frozenset(), ~np.isfinite(state.temperatures))
    return Checked(states=(one,), since=(0,), faults=found.faults)


def load_growth_model(folder: Path) -> GrowthModel:
    """The stored model of a machine; StoreError when a file is missing or of another version."""
    file = read_json(folder / "model.json", DeformationModel)
    methods = read_json(folder / "methods.json", MethodsFile)
    return GrowthModel(
        file, {name: restored(name, documents) for name, documents in methods.documents.items()}
    )
