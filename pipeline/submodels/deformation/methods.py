"""Methods that predict growth, each fitted, stored and restored alike.

Baselines of FFNN2015 (BP 9-7-1 and 9-16-1, the classic fuzzy-filtered network), its improved
network trained in three ways, and beside them persistence, ridge regressions, physical models and
a hybrid.  Networks have the inputs of the ridge regression; the paper's own inputs (temperatures
of sensors and groups, without lags or speed) are kept as variants.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
    TrainingSettings,
)
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.si import UM
from pipeline.schema.store import structured
from pipeline.submodels.deformation.features import Inputs
from pipeline.submodels.deformation.records import RAD_S
from pipeline.thermal.deformation import (
    DeformationNetwork,
    GrowthRecord,
    LaggedExpansion,
    fit_expansion,
)
from pipeline.thermal.growth_fit import fit_network

PENALTIES = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Ridge penalties to choose from, as shares of the mean square of all inputs [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Example:
    """A training recording or a later part of one: its name, inputs and growth since its start.

    Growth is in um, NaN where it is unknown; parts of a recording have its name.
    """

    name: str
    inputs: Inputs
    growth: Floats


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Budget of a fit, the same for all networks."""

    training: TrainingSettings
    """Passes and the like."""
    every_s: float
    """Time between two samples that networks and physical models learn from [s]."""


class Fitted(ABC):
    """A fitted method."""

    @abstractmethod
    def predict(self, inputs: Inputs) -> Floats:
        """Growth of each sample [um], shape (T,)."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words."""


class Method(ABC):
    """Method of predicting growth."""

    label: str
    """Name on pages."""
    seeded: ClassVar[bool] = False
    """Whether its fit depends on a seed."""
    needs_speed: ClassVar[bool] = False
    needs_ambient: ClassVar[bool] = False
    """Whether it needs the spindle speed and the ambient temperature."""

    @abstractmethod
    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """The method fitted on training recordings."""

    @abstractmethod
    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """The fitted method of a document."""


@dataclass(frozen=True)
class _Still(Fitted):
    def predict(self, inputs: Inputs) -> Floats:
        return np.zeros(len(inputs))

    def document(self) -> dict[str, Any]:
        return {}


@dataclass(frozen=True)
class Persistence(Method):
    """Growth stays what it was at the start: zero."""

    label: str = "persistence"

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """Nothing is fitted."""
        return _Still()

    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """Nothing is restored."""
        return _Still()


@dataclass(frozen=True, eq=False)
class Ridge(Fitted):
    """Linear in one of the inputs, without a constant: growth is zero at the start."""

    inputs: str
    weights: Floats
    penalty: float

    def predict(self, inputs: Inputs) -> Floats:
        """Growth of each sample [um], shape (T,)."""
        return getattr(inputs, self.inputs) @ self.weights

    def document(self) -> dict[str, Any]:
        """Weights [um per unit of the input] and the penalty."""
        return {"weights": self.weights.tolist(), "penalty": self.penalty}


@dataclass(frozen=True, kw_only=True)
class Linear(Method):
    """Ridge regression whose penalty has the least error on recordings left out in turn."""

    label: str
    """Label for readers."""
    inputs: str
    """Field of :class:`~pipeline.submodels.deformation.features.Inputs`."""

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Ridge:
        """Weights at the best penalty."""
        return ridge(*by_recording(examples, self.inputs), self.inputs)

    def restore(self, document: Mapping[str, Any]) -> Ridge:
        """The regression of a document."""
        return Ridge(self.inputs, np.array(document["weights"]), document["penalty"])


def by_recording(examples: Sequence[Example], inputs: str) -> tuple[list[Floats], list[Floats]]:
    """Inputs and growth of each recording, its parts one after the other."""
    names = list(dict.fromkeys(one.name for one in examples))
    parts = [[one for one in examples if one.name == name] for name in names]
    x = [np.vstack([getattr(one.inputs, inputs) for one in some]) for some in parts]
    return x, [np.concatenate([one.growth for one in some]) for some in parts]


def ridge(x: Sequence[Floats], y: Sequence[Floats], name: str) -> Ridge:
    """Ridge regression over recordings, its penalty chosen by leaving each out in turn.

    ``x`` (T, K) and growth ``y`` (T,) [um] of each recording; samples without growth do not count.
    """
    known = [np.isfinite(one) for one in y]
    x = [one[rows] for one, rows in zip(x, known, strict=True)]
    y = [one[rows] for one, rows in zip(y, known, strict=True)]
    grams = [one.T @ one for one in x]
    moments = [one.T @ other for one, other in zip(x, y, strict=True)]
    gram, moment = np.sum(grams, axis=0), np.sum(moments, axis=0)
    # one scale for all: an input that hardly varied has a small weight, not a wild one
    unit = np.eye(len(gram)) * float(np.trace(gram)) / len(gram)

    def left_out(penalty: float) -> float:
        """Sum of squared errors of recordings, each by a fit of the others [um^2]."""
        total = 0.0
        for xs, ys, g, m in zip(x, y, grams, moments, strict=True):
            weights = np.linalg.solve(gram - g + penalty * unit, moment - m)
            total += float(np.sum((xs @ weights - ys) ** 2))
        return total

    penalty = min(PENALTIES, key=left_out) if len(x) > 1 else PENALTIES[-3]
    weights = np.linalg.solve(gram + penalty * unit, moment)
    return Ridge(name, weights, penalty)


def growth_record(inputs: Inputs, growth: Floats | None = None) -> GrowthRecord:
    """Inputs of the thermal models in SI; the coldest group replaces a missing ambient."""
    state = inputs.state
    known = bool(np.isfinite(state.ambient).all())
    coldest = np.full(len(inputs), np.min(inputs.group_temperatures[:1], initial=np.inf))
    return GrowthRecord(
        time_s=inputs.time,
        speed_rad_s=state.speed / RAD_S,
        ambient_C=state.ambient if known else coldest,
        temperatures_C=inputs.group_temperatures,
        growth_m=np.full(len(inputs), np.nan) if growth is None else growth * UM,
    )


def whole_records(examples: Sequence[Example], budget: Budget) -> list[GrowthRecord]:
    """Whole recordings for the physical models, a sample every so often."""
    whole = {one.name: one for one in reversed(examples)}  # the first of a name is the whole
    found = []
    for one in whole.values():
        record = growth_record(one.inputs, one.growth)
        rows = slice(None, None, max(1, round(budget.every_s / record.step)))
        found.append(GrowthRecord(**{name: part[rows] for name, part in vars(record).items()}))
    return found


@dataclass(frozen=True, eq=False)
class _TwoNodes(Fitted):
    network: DeformationNetwork

    def predict(self, inputs: Inputs) -> Floats:
        one = growth_record(inputs)
        return self.network.predict(
            one.speed_rad_s, one.ambient_C, one.temperatures_C[0], one.step
        ) / UM  # fmt: skip

    def document(self) -> dict[str, Any]:
        return asdict(self.network)


@dataclass(frozen=True)
class TwoNodes(Method):
    """Two nodes of heat from speed and ambient alone; the sensors say how they start."""

    label: str = "two thermal nodes, from the speed"
    needs_speed: ClassVar[bool] = True
    needs_ambient: ClassVar[bool] = True

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """The network of :func:`pipeline.thermal.growth_fit.fit_network`."""
        return _TwoNodes(fit_network(whole_records(examples, budget)))

    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """The network of a document."""
        return _TwoNodes(structured(document, DeformationNetwork, "methods"))


@dataclass(frozen=True, eq=False)
class _Expansion(Fitted):
    expansion: LaggedExpansion

    def predict(self, inputs: Inputs) -> Floats:
        return self.expansion.predict(
            inputs.time, inputs.state.speed / RAD_S, inputs.group_temperatures
        ) / UM  # fmt: skip

    def document(self) -> dict[str, Any]:
        return asdict(self.expansion)


@dataclass(frozen=True)
class Expansion(Method):
    """Each group of sensors expands its length with a lag of its own."""

    label: str = "lagged expansion of three groups"

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """The expansion of :func:`pipeline.thermal.deformation.fit_expansion`."""
        return _Expansion(fit_expansion(whole_records(examples, budget)))

    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """The expansion of a document."""
        return _Expansion(structured(document, LaggedExpansion, "methods"))


@dataclass(frozen=True, eq=False)
class _Sum(Fitted):
    first: Fitted
    second: Ridge

    def predict(self, inputs: Inputs) -> Floats:
        return self.first.predict(inputs) + self.second.predict(inputs)

    def document(self) -> dict[str, Any]:
        return {"first": self.first.document(), "second": self.second.document()}


@dataclass(frozen=True)
class Hybrid(Method):
    """A physical model, and a ridge regression on what it leaves over."""

    label: str
    physics: Method
    inputs: str

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """The physical model, then the regression on its errors."""
        first = self.physics.fit(examples, budget, seed)
        left = [replace(one, growth=one.growth - first.predict(one.inputs)) for one in examples]
        return _Sum(first, ridge(*by_recording(left, self.inputs), self.inputs))

    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """Both of a document."""
        regression = Linear(label=self.label, inputs=self.inputs)
        second = regression.restore(document["second"])
        return _Sum(self.physics.restore(document["first"]), second)


@dataclass(frozen=True, eq=False)
class _Network(Fitted):
    trained: Any
    inputs: str

    def predict(self, inputs: Inputs) -> Floats:
        return self.trained.predict(inputs.rises, getattr(inputs, self.inputs))

    def document(self) -> dict[str, Any]:
        found: dict[str, Any] = self.trained.document()
        return {**found, "history": found["history"][-1:]}


@dataclass(frozen=True, kw_only=True)
class Network(Method):
    """A network of :mod:`pipeline.nets` and its training method."""

    label: str
    """Label for readers."""
    kind: NetworkSettings
    """Settings of the network."""
    method: str
    """Training method."""
    inputs: str = "linear"
    """Field of the inputs that its rules are linear in."""
    seeded: ClassVar[bool] = True

    def fit(self, examples: Sequence[Example], budget: Budget, seed: int) -> Fitted:
        """Network trained on the labelled samples, whole recordings kept for early stopping."""
        from pipeline.nets.training import train

        known = [_learnt_from(one, budget.every_s) for one in examples]

        def stacked(name: str) -> Floats:
            parts = [getattr(e.inputs, name)[k] for e, k in zip(examples, known, strict=True)]
            return np.vstack(parts)

        growth = np.concatenate([e.growth[k] for e, k in zip(examples, known, strict=True)])
        names = np.repeat([e.name for e in examples], [int(k.sum()) for k in known])
        found = train(
            self.kind, self.method, stacked("rises"), stacked(self.inputs), growth, names,
            settings=replace(budget.training, seed=seed),
        )  # fmt: skip
        return _Network(found, self.inputs)

    def restore(self, document: Mapping[str, Any]) -> Fitted:
        """The network of a document."""
        from pipeline.nets.training import restore

        return _Network(restore(document), self.inputs)


def _learnt_from(one: Example, every_s: float) -> Bools:
    """Samples that a network learns from; shape (T,)."""
    every = max(1, round(every_s / one.inputs.state.period))
    return np.isfinite(one.growth) & (np.arange(len(one.growth)) % every == 0)


def _sigmoid(label: str, hidden: int, *, paper: bool = False) -> Network:
    kind = BackPropagationSettings(hidden=hidden, consequent_inputs=not paper)
    return Network(
        label=label, kind=kind, method="back_propagation", inputs="groups" if paper else "linear"
    )


METHODS: Mapping[str, Method] = {
    "persistence": Persistence(),
    "linear_static": Linear(label="linear regression, temperatures only", inputs="rises"),
    "linear": Linear(label="linear regression, groups with lags", inputs="linear"),
    "linear_sensors": Linear(label="linear regression, every sensor with lags",
                             inputs="each_sensor"),
    "two_nodes": TwoNodes(),
    "expansion": Expansion(),
    "hybrid": Hybrid("lagged expansion and linear regression of the rest", Expansion(),
                     "each_sensor"),
    "bp_7_paper": _sigmoid("BP 9-7-1, the paper's inputs", 7, paper=True),
    "bp_7": _sigmoid("BP 9-7-1", 7),
    "bp_16": _sigmoid("BP 9-16-1", 16),
    "ffnn_classic": Network(label="classic FFNN", kind=ClassicFuzzySettings(),
                            method="projection"),
    "ffnn_paper": Network(label="improved FFNN, genetic, the paper's inputs",
                          kind=FuzzyFilteredSettings(), method="genetic", inputs="groups"),
    "ffnn_genetic": Network(label="improved FFNN, genetic", kind=FuzzyFilteredSettings(),
                            method="genetic"),
    "ffnn_adam": Network(label="improved FFNN, Adam", kind=FuzzyFilteredSettings(),
                         method="gradient"),
    "ffnn_projection": Network(label="improved FFNN, least squares and Adam",
                               kind=FuzzyFilteredSettings(), method="projection"),
}  # fmt: skip
"""Every method by its name in files."""
PERSISTENCE = "persistence"
"""Growth stays what it was: what no model may be worse than."""
SIMPLE = (PERSISTENCE, "linear")
"""Methods that the one which serves has to beat, unless it is one of them."""


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Method as it is served: the mean of its fits, one a seed."""

    name: str
    members: tuple[Fitted, ...] = field(default_factory=tuple)

    def each(self, inputs: Inputs) -> Floats:
        """Growth by each member [um]; shape (seeds, T)."""
        return np.array([one.predict(inputs) for one in self.members])

    def predict(self, inputs: Inputs) -> Floats:
        """Mean growth over the members [um]; shape (T,)."""
        return self.each(inputs).mean(axis=0)


def restored(name: str, documents: Sequence[Mapping[str, Any]]) -> Ensemble:
    """The ensemble of stored documents; ValueError when there is no method of that name."""
    if name not in METHODS:
        raise ValueError(f"there is no method {name!r}; there are {', '.join(METHODS)}")
    return Ensemble(name, tuple(METHODS[name].restore(one) for one in documents))
