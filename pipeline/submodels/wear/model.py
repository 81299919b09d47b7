"""Stored model of tool wear, and its predictor by every method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from pipeline.nets.settings import ResNetSettings, WindowTraining
from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.model import Bands, Model
from pipeline.schema.ranges import Count, Range, Ranged
from pipeline.schema.store import read_json
from pipeline.signals.wear_windows import CLASS_UNIT, ChannelScaling, WearWindows
from pipeline.submodels.conformal import ALL_REGIMES
from pipeline.submodels.statistics import DRAWN
from pipeline.submodels.wear.due import Lasting
from pipeline.submodels.wear.methods import (
    Curve,
    FeatureScaling,
    ForestSettings,
    KnownConditions,
    Ridge,
    features,
)

if TYPE_CHECKING:
    from pipeline.nets.wear import WearJudge
    from pipeline.schema.forest import Trees

RESNET, FOREST, RIDGE, MEDIAN = "resnet", "forest", "ridge", "median"
BLEND, GUESS, MEAN = "blend", "guess", "mean"
METHODS = (RESNET, FOREST, RIDGE)
"""Methods on the signals."""
WEAR, WORN = "flank wear", "probability of a worn tool"
"""Quantities: a number, and a class."""
NAMES = {
    RESNET: "residual network", FOREST: "forest", RIDGE: "ridge regression",
    MEDIAN: "median of the methods", BLEND: "their median with the guess",
    GUESS: "guess without sensors", MEAN: "mean wear",
}  # fmt: skip
"""Methods in words."""


@dataclass(frozen=True, kw_only=True)
class WearFitSettings(Ranged, section="wear_fit"):
    """Fit and comparison of the methods."""

    folds: Annotated[int, Range(least=2, most=50)] = 5
    """Parts of the training tools that are left out in turn, at most one a tool."""
    methods: tuple[str, ...] = METHODS
    """Selection of :data:`METHODS` that are fitted."""
    forest: ForestSettings = field(default_factory=ForestSettings)
    """Size of the forest."""
    network: ResNetSettings = field(default_factory=ResNetSettings)
    """Training of the residual network."""
    training: WindowTraining = field(default_factory=WindowTraining)
    """Its budget on each fold; what serves is the mean of the folds' networks."""
    windows: Count = 2000
    """Windows of one training of the network at most, evenly spread over each tool."""
    seed: Annotated[int, Range(least=0)] = 0
    """Seed of the forest; the network's is in ``training``."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.methods or ("",):
            if name not in METHODS:
                raise ValueError(
                    f"wear_fit.methods names {name!r}: choose one or more of {', '.join(METHODS)}"
                )


@dataclass(frozen=True, kw_only=True)
class MethodScore:
    """A method on training tools left out, each of the same weight."""

    rmse: float
    mae: float
    """MAE in the unit of wear."""
    worst: float
    """RMSE of the tool that it errs on most."""
    balanced_accuracy: float | None = None
    """Mean share of windows of either class that it tells right [1]; None for a number."""
    auc: float | None = None
    """Area under the ROC curve: chance that a worn tool gets the greater probability of two [1]."""


@dataclass(frozen=True, kw_only=True)
class WearModel(Model):
    """Content of ``model.json`` of tool wear."""

    wear_unit: str
    """``"um"``, or ``"1"`` for a class."""
    learnt: tuple[float, float]
    """Least and greatest wear of training windows."""
    channels: tuple[str, ...]
    units: tuple[str, ...]
    """Channels of a window and their units."""
    rate_Hz: float
    length: int
    """Rate of its samples [Hz], and their number."""
    scaling: ChannelScaling
    """Scaling of the channels, from training windows."""
    known: KnownConditions
    """Conditions that predictions look at."""
    condition_units: Mapping[str, str]
    """Unit of each condition that is a number."""
    progress: str
    progress_unit: str
    """Use of the tool in the baseline; the name is empty for the recording's time or number."""
    per_recording: bool
    """Whether a recording has one wear, the mean of its windows; else each window has one."""
    champion: str
    """Method that serves: the blend where the baseline has a share in it, unless ``alone`` is
    significantly better on training tools left out."""
    alone: str
    """The one that needs no use of the tool: the median, or a single method that is significantly
    better on training tools left out."""
    scores: Mapping[str, MethodScore]
    """Scores of every method."""
    weights: Mapping[str, float]
    """Weights of the median and the baseline in the blend; empty without a baseline."""
    bands: Mapping[str, Bands]
    """Half widths of the 90 % interval of ``champion`` and ``alone``; none for a class."""
    lasting: Lasting = field(default_factory=Lasting)
    """Life of tools, and what their wear adds to edge forces."""

    @property
    def is_class(self) -> bool:
        """Whether wear is worn or not, no number."""
        return self.wear_unit == CLASS_UNIT

    @property
    def quantity(self) -> str:
        """Predicted quantity."""
        return WORN if self.is_class else WEAR


@dataclass(frozen=True, kw_only=True)
class MethodsFile:
    """Content of ``methods.json``: what the methods learnt from all training tools."""

    scaling: FeatureScaling
    """Scaling of the features."""
    ridge: Ridge | None
    """Ridge regression on features."""
    forest: Mapping[str, Any] | None
    """Document of the forest."""
    networks: tuple[Mapping[str, Any], ...]
    """Documents of the folds' networks (:func:`pipeline.nets.wear.restore_judge`)."""
    guess: Curve | None
    """Wear over the use of the tool; None for a class."""
    by_conditions: Ridge | None
    """Share of worn tools by their conditions; None for a number, and without conditions, where the
    guess is the mean."""
    mean: float
    """Wear of the training tools."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """Methods that were fitted on some tools, and predict windows of others."""

    scaling: ChannelScaling
    known: KnownConditions
    feature_scaling: FeatureScaling
    """Scalings and known conditions of those tools."""
    ridge: Ridge | None
    forest: "Trees | None"
    networks: "tuple[WearJudge, ...]"
    """Methods as in :class:`MethodsFile`; of the networks the mean serves."""
    guess: Curve | None
    by_conditions: Ridge | None
    mean: float
    is_class: bool

    def predict(self, windows: WearWindows) -> dict[str, Floats]:
        """Wear of windows by every method that is fitted, (N,) each; NaN where it cannot tell."""
        each = self.by_members(windows)
        return {name: self.bounded(some.mean(axis=0)) for name, some in each.items()}

    def bounded(self, values: Floats) -> Floats:
        """No wear below zero; of a class none above one."""
        return np.clip(values, 0.0, 1.0 if self.is_class else None)

    def by_members(self, windows: WearWindows) -> dict[str, Floats]:
        """The same by each network of a fold and each tree, shape (M, N); of others M is 1."""
        x = self.feature_scaling.scaled(features(windows, self.scaling, self.known))
        columns = self.known.columns(windows)
        found: dict[str, Floats] = {}
        if self.networks:
            by_each = [one.predict(windows.values, columns) for one in self.networks]
            found[RESNET] = np.stack(by_each)
        if self.forest is not None:
            found[FOREST] = self.forest.by_tree(x)
        if self.ridge is not None:
            found[RIDGE] = self.ridge.predict(x)
        if self.guess is not None:
            found[GUESS] = self.guess.predict(np.asarray(windows.progress, float))
        found[MEAN] = np.full(len(windows), self.mean)
        if self.is_class:
            by = self.by_conditions
            found[GUESS] = found[MEAN] if by is None else by.predict(self.known.matrix(windows))
        return {name: np.atleast_2d(values) for name, values in found.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """K predicted values of wear: one a window, or one a recording."""

    of: Ints
    """Reading that each window belongs to; shape (N,)."""
    first: Ints
    """First window of each; shape (K,)."""

    @staticmethod
    def among(windows: WearWindows, *, per_recording: bool) -> "Readings":
        """Readings of windows, in their order."""
        if not per_recording:
            every = np.arange(len(windows))
            return Readings(of=every, first=every)
        _, first, place = np.unique(windows.recording, return_index=True, return_inverse=True)
        order = np.argsort(first)
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        return Readings(of=rank[place], first=first[order])

    def mean(self, values: Floats) -> Floats:
        """Mean over the windows of each reading, shape (K,)."""
        return np.bincount(self.of, weights=values) / np.bincount(self.of)


@dataclass(frozen=True, kw_only=True, eq=False)
class Wear:
    """A stored model that predicts."""

    file: WearModel
    fitted: Fitted

    def predict(self, windows: WearWindows) -> tuple[Readings, dict[str, Floats]]:
        """Readings of windows, and their wear by every method and the blend, (K,) each."""
        readings, found, _ = self.predict_again(windows, draws=0)
        return readings, found

    def predict_again(
        self, windows: WearWindows, draws: int = DRAWN
    ) -> tuple[Readings, dict[str, Floats], list[dict[str, Floats]]]:
        """Predictions as :meth:`predict`, and by networks and trees drawn with replacement."""
        readings = Readings.among(windows, per_recording=self.file.per_recording)
        each, random = self.fitted.by_members(windows), np.random.default_rng(0)

        def found(rows: Callable[[int], Any]) -> dict[str, Floats]:
            told = {n: self.fitted.bounded(m[rows(len(m))].mean(axis=0)) for n, m in each.items()}
            return self.together({name: readings.mean(one) for name, one in told.items()})

        again = [found(lambda many: random.integers(0, many, many)) for _ in range(draws)]
        return readings, found(np.arange), again

    def together(self, estimates: Mapping[str, Floats]) -> dict[str, Floats]:
        """Wear by every method, (K,) each, with their median and the blend."""
        more = {**estimates, MEDIAN: median(estimates)}
        if self.file.weights:
            more[BLEND] = blended(more, self.file.weights)
        return more

    def served(self, estimates: Mapping[str, Floats]) -> tuple[str, Floats, Floats, Floats]:
        """Method that serves, wear, 90 % interval, (K,) each; without a use one that needs none."""
        name = self.file.champion
        if not np.isfinite(estimates[name]).all():
            name = self.file.alone
        wear, bands = estimates[name], self.file.bands.get(name)
        if bands is None:
            nothing = np.full(len(wear), np.nan)
            return name, wear, nothing, nothing
        band = bands[ALL_REGIMES]
        return name, wear, np.maximum(wear - band.lower, 0.0), wear + band.upper


def median(estimates: Mapping[str, Floats]) -> Floats:
    """Median of the methods that look at signals, (K,): no single one that goes astray moves it."""
    return np.median([estimates[name] for name in METHODS if name in estimates], axis=0)


def blended(estimates: Mapping[str, Floats], weights: Mapping[str, float]) -> Floats:
    """Weighted sum of methods, (K,)."""
    return np.sum([w * estimates[name] for name, w in weights.items() if w > 0], axis=0)


def load_wear(folder: Path) -> Wear:
    """The model in ``folder`` with its methods."""
    from pipeline.nets.wear import restore_judge
    from pipeline.schema.forest import Trees

    file = read_json(folder / "model.json", WearModel)
    stored = read_json(folder / "methods.json", MethodsFile)
    try:
        forest = None if stored.forest is None else Trees.restored(stored.forest)
        networks = tuple(restore_judge(one) for one in stored.networks)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{folder}/methods.json is broken ({error}): run `dvc repro`") from error
    fitted = Fitted(
        scaling=file.scaling, known=file.known, feature_scaling=stored.scaling, ridge=stored.ridge,
        forest=forest, networks=networks, guess=stored.guess, by_conditions=stored.by_conditions,
        mean=stored.mean, is_class=file.is_class,
    )  # fmt: skip
    return Wear(file=file, fitted=fitted)
