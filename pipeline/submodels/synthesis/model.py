"""Stored generator of signals, its settings, training windows as features, and their learners.

``model.json`` says what was trained and how far the judge follows the wear; ``generator.json``
holds the network, and features of training and generated windows.  Learners are fitted anew from
the latter, in seconds and to the same numbers.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from pipeline.nets.dcgan_settings import ConditionSpace, GanSettings, GanTraining
from pipeline.nets.diversity import FeatureScaling, features
from pipeline.nets.settings import Whole
from pipeline.schema.arrays import Floats, unpacked
from pipeline.schema.model import Model
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.schema.store import read_json
from pipeline.signals.wear_windows import WearWindows

if TYPE_CHECKING:
    from pipeline.nets.dcgan import TrainedGan
    from pipeline.nets.wear import WearJudge


@dataclass(frozen=True, kw_only=True)
class SynthesisFitSettings(Ranged, section="synthesis_fit"):
    """Training of the generator, and of the learners that look at its windows."""

    network: GanSettings = field(default_factory=GanSettings)
    """Sizes of generator and discriminator."""
    training: GanTraining = field(default_factory=GanTraining)
    """Its budget."""
    trainings: Count = 1
    """Generators of as many seeds, trained side by side: the first serves, and from all of them, at
    the last look and at the end, it is known how far trainings differ."""
    by_tool: bool = True
    """Whether the tool is a condition too; of one that was not learnt the mean of those that were
    takes its place."""
    left_out: tuple[str, ...] = ()
    """Conditions of the windows that are none of the generator's, beside the tool's use, which
    would tell the wear."""
    windows: Annotated[int, Range(least=20)] = 20_000
    """Training windows at most, evenly over each tool's life."""
    trees: Count = 100
    """Trees of each random forest."""
    wears: Annotated[int, Range(least=3)] = 20
    """Wears, evenly over what was learnt, at which the judge's curve is read."""
    looks: Count = 4
    """Steps, evenly over the training, at which the first judge's curve is read."""
    each: Annotated[int, Range(least=2)] = 40
    """Generated windows of each of these wears."""
    judged: Annotated[int, Range(least=5)] = 200
    """Windows of a case that are compared at most, evenly over the tool's life."""
    neighbours: Count = 5
    """Nearest windows that span the neighbourhood of one, for density and coverage."""
    seed: Whole = 0
    """Seed of noise and forests."""


@dataclass(frozen=True, kw_only=True)
class SynthesisLimits(Ranged, section="synthesis_limits"):
    """Limits on tools that the generator was not trained on."""

    rmse_um: Positive = 60.0
    """Greatest RMSE of the judge's wear of generated windows against the wear that was asked for
    [um]: a fifth of the usual criterion of 300 um (ISO 8688-2)."""
    rmse_class: Positive = 0.5
    """Greatest RMSE of the share of worn tools that the judge gives generated windows, where wear
    is a class [1]; a coin has 0.5."""
    spread_percent: Positive = 70.0
    """Greatest difference of the distance between generated windows of the same conditions from
    that between recorded ones [%]; a collapsed generator has 100."""
    copy_percent: Positive = 80.0
    """Greatest difference of the distance between a generated window and the nearest training
    window from that of a recorded one of a tool that was held out [%]; a copy has 100."""


WEAR, TOOL = "wear", "tool"
"""Conditions of every generator."""
FOREST, NETWORK = "forest of features", "residual network"
"""Names of the judges."""
SYNTHETIC = "synthetic"
"""Origin of generated windows, wherever they are shown or written."""


@dataclass(frozen=True, kw_only=True)
class WearCurve:
    """Wear read from generated windows over the requested wear."""

    asked: tuple[float, ...]
    mean: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Requested wear; mean, 5 % and 95 % quantile of the read wear; in the wear's unit."""
    mae: float
    mse: float
    """Errors of the mean against the requested wear, in the unit and its square."""
    slope: float
    """Slope of a straight line through the means [1]; 1 for a sound generator."""
    rank_correlation: float
    """Spearman's, of single windows [1]."""
    rank_of_means: float = 0.0
    """Spearman's, of the mean reading at each wear [1]."""
    false_intervals: tuple[tuple[float, float], ...] = ()
    """Thirds of the range of wear in which the reading falls while the wear grows."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """Agreement of the first wear reader with the generator at a training step."""

    step: int
    """Step of the training."""
    mae: float
    """Mean error of the wear that is read over the range of wear, in its unit."""
    slope: float
    """Slope of a straight line through the means [1]."""


@dataclass(frozen=True, kw_only=True)
class SynthesisModel(Model):
    """``model.json`` of the synthesis of signals."""

    channels: tuple[str, ...]
    units: tuple[str, ...]
    """Channels of a window, with their units."""
    rate_Hz: float
    """Rate of its samples [Hz]."""
    length: int
    """Its samples."""
    wear_unit: str
    """``"um"``, or ``"1"`` where wear is a class."""
    windows: int
    """Windows that were trained on."""
    steps: int
    """Steps of the training."""
    curves: Mapping[str, WearCurve]
    """Curves by name of the wear reader."""
    judges: tuple[str, ...]
    """Their names, the one whose figures go first before the others."""
    within: float
    between: float
    """Distance of generated windows at the same conditions, and over all, by that of training
    windows [1]."""
    looks: tuple[Look, ...] = ()
    """Looks of the first judge, from early in the training to its end."""
    faults: tuple[str, ...] = ()
    """Faults of the training: collapse, a loss that vanished."""
    clipped: float = 0.0
    """Share of training samples that are cut to the range of the generator's output [1]."""
    judged: int = 200
    neighbours: int = 5
    trees: int = 100
    seed: int = 0
    """Windows that are judged, neighbours, trees and seed of the settings."""

    @property
    def is_class(self) -> bool:
        """Whether wear is worn or not, no number."""
        return self.wear_unit == "1"


@dataclass(frozen=True, kw_only=True)
class GeneratorFile:
    """``generator.json``: document of the network, features as packed arrays, networks that judge.

    The latter are those of the wear model, which saw recorded windows of training tools alone.
    ``others`` are generators of other seeds, and states before the end, which do not serve, with
    features of their windows.
    """

    document: Mapping[str, Any]
    reference: Mapping[str, Any]
    judges: tuple[Mapping[str, Any], ...] = ()
    others: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Life:
    """Windows of a tool, and the folder of the machine's wear model; None where it has none."""

    windows: WearWindows
    wear: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Training windows, and generated ones at the same conditions."""

    recorded: Floats
    generated: Floats
    """Features; shape (N, K)."""
    conditions: Floats
    """Encoded, without the wear and the tool; shape (N, D)."""
    wear: Floats
    """Wear in its unit; shape (N,)."""
    shown: Floats
    like: Floats
    """Recorded windows over the wear, and generated ones at their conditions; (S, C, L)."""
    shown_wear: Floats
    """Wear of both; shape (S,)."""


Judge = Callable[[Floats, Mapping[str, Any]], Floats]
Learner = Callable[[Floats, Floats], Floats]
"""Wear (N,) from features (N, K) and conditions (N, D)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Synthesis:
    """A stored generator with the learners that judge it."""

    file: SynthesisModel
    gan: "TrainedGan"
    reference: Reference
    networks: "tuple[WearJudge, ...]" = ()
    stored: tuple[Mapping[str, Any], ...] = ()

    @cached_property
    def trainings(self) -> "tuple[tuple[TrainedGan, Learner], ...]":
        """Generators of all seeds, the one that serves first, each with what learns from it."""
        from pipeline.nets.dcgan import restore_gan

        others = [
            (restore_gan(one["document"]), self._learner(unpacked(one["generated"]).astype(float)))
            for one in self.stored
        ]
        return (self.gan, self.from_generated), *others

    @cached_property
    def judges(self) -> Mapping[str, Judge]:
        """Wear (N,) from windows (N, C, L) and conditions, by independent wear readers."""
        found: dict[str, Judge] = {FOREST: self._by_features}
        if self.networks:
            found[NETWORK] = self._by_networks
        return found

    def _by_features(self, values: Floats, conditions: Mapping[str, Any]) -> Floats:
        return self.judge(features(values), beside(self.gan.space, conditions))

    def _by_networks(self, values: Floats, conditions: Mapping[str, Any]) -> Floats:
        """Mean of the networks; a word is a column of 0 and 1 to them."""
        found = []
        for one in self.networks:
            columns = {name: _column(name, conditions) for name in one.conditions}
            found.append(one.predict(values, columns))
        return np.maximum(np.mean(found, axis=0), 0.0)

    @cached_property
    def scaling(self) -> FeatureScaling:
        """Scaling of features, by recorded training windows."""
        return FeatureScaling.of(self.reference.recorded)

    @cached_property
    def judge(self) -> Learner:
        """Learnt from recorded training windows."""
        return self._learner(self.reference.recorded)

    @cached_property
    def from_generated(self) -> Learner:
        """Learnt from generated windows alone."""
        return self._learner(self.reference.generated)

    @cached_property
    def augmented(self) -> Learner:
        """Learnt from both."""
        return self._learner(self.reference.recorded, self.reference.generated)

    def _learner(self, *parts: Floats) -> Learner:
        from sklearn.ensemble import RandomForestRegressor

        mine = self.reference
        x = np.concatenate([np.hstack([self.scaling(p), mine.conditions]) for p in parts])
        forest = RandomForestRegressor(
            n_estimators=self.file.trees, min_samples_leaf=3, max_features=0.33, n_jobs=1,
            random_state=self.file.seed,
        ).fit(x, np.tile(mine.wear, len(parts)))  # fmt: skip

        def learner(found: Floats, conditions: Floats) -> Floats:
            return forest.predict(np.hstack([self.scaling(found), conditions]))

        return learner

    def known(self, windows: WearWindows) -> dict[str, Any]:
        """Conditions of windows as the generator takes them; words not learnt are empty."""
        found = conditions_of_windows(windows)
        space = self.gan.space
        kept: dict[str, Any] = {one.name: found[one.name] for one in space.continuous}
        for one in space.discrete:
            given = [str(word) for word in found[one.name]]
            kept[one.name] = np.array([w if w in one.words else "" for w in given])
        return kept

    def inside(self, conditions: Mapping[str, Any]) -> "np.ndarray[Any, Any]":
        """Flags of windows within the training ranges, shape (N,)."""
        many = len(next(iter(conditions.values())))
        found = np.ones(many, bool)
        for one in self.gan.space.continuous:
            given, slack = np.asarray(conditions[one.name], float), 1e-6 * (one.high - one.low)
            found &= (given >= one.low - slack) & (given <= one.high + slack)
        return found


def _column(name: str, conditions: Mapping[str, Any]) -> Floats:
    """A condition, or whether it is a word: ``cut_type slot``."""
    if name in conditions:
        return np.asarray(conditions[name], float)
    of, _, word = name.partition(" ")
    return (np.asarray(conditions[of]) == word).astype(float)


def conditions_of_windows(windows: WearWindows) -> dict[str, Any]:
    """Wear, conditions and tool of windows by name, shape (N,) each."""
    return {WEAR: windows.wear, **windows.conditions, TOOL: windows.tool.astype(str)}


def beside(space: ConditionSpace, conditions: Mapping[str, Any]) -> Floats:
    """Encoded conditions that a learner may know, shape (N, D): all but wear and tool."""
    numbers, words = space.encoded(conditions)
    kept = [k for k, one in enumerate(space.continuous) if one.name != WEAR]
    parts = [numbers[:, kept]]
    for k, one in enumerate(space.discrete):
        if one.name != TOOL:
            parts.append(np.eye(len(one.words) + 1)[words[:, k]])
    return np.hstack(parts)


def reference_of(stored: GeneratorFile) -> Reference:
    """Stored features and windows of a generator; ValueError when they are incomplete."""
    try:
        found = {name: unpacked(one).astype(np.float64) for name, one in stored.reference.items()}
        return Reference(**found)
    except (KeyError, TypeError) as error:
        raise ValueError(f"generator.json does not fit together ({error}): run `dvc repro`") from (
            error
        )


def load_synthesis(folder: Path) -> Synthesis:
    """Generator and its wear readers; StoreError when a file is missing, broken or outdated."""
    from pipeline.nets.dcgan import restore_gan
    from pipeline.nets.wear import restore_judge

    stored = read_json(folder / "generator.json", GeneratorFile)
    return Synthesis(
        file=read_json(folder / "model.json", SynthesisModel),
        gan=restore_gan(stored.document),
        reference=reference_of(stored),
        networks=tuple(restore_judge(one) for one in stored.judges),
        stored=stored.others,
    )
