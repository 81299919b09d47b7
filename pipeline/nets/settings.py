"""Settings of the networks and of their training, which need no torch to be read."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.schema.ranges import Count, Positive, Range, Ranged

Whole = Annotated[int, Range(least=0)]


class NetworkSettings(Ranged):
    """Base of the three kinds of network; ``kind`` names one in files."""

    kind: ClassVar[str]


@dataclass(frozen=True, kw_only=True)
class FuzzyFilteredSettings(NetworkSettings, section="fuzzy_filtered"):
    """Settings of the improved fuzzy-filtered network (FFNN2015)."""

    kind: ClassVar[str] = "fuzzy_filtered"
    bands: Count = 3
    """Gaussian pass-bands J over the sensors, each with a rule of its own."""
    offset: Annotated[float, Range(least=0.01, most=1000.0)] = 1.0
    """Temperature that is added before the bands' shares are taken, as a multiple of the range of
    the temperatures that were learnt [1]; the smaller, the more the shares vary."""


@dataclass(frozen=True, kw_only=True)
class ClassicFuzzySettings(NetworkSettings, section="classic_fuzzy"):
    """Settings of the classic fuzzy-filtered network: J bell-shaped bands."""

    kind: ClassVar[str] = "classic_fuzzy"
    bands: Count = 3


@dataclass(frozen=True, kw_only=True)
class BackPropagationSettings(NetworkSettings, section="back_propagation"):
    """Settings of the network with one sigmoid layer."""

    kind: ClassVar[str] = "back_propagation"
    hidden: Count = 7
    """Nodes of the sigmoid layer: 7 as published (9-7-1), 16 beside it."""
    consequent_inputs: bool = False
    """Whether the consequent inputs enter beside the temperatures; the published network has the
    temperatures alone."""


KINDS: dict[str, type[NetworkSettings]] = {
    one.kind: one for one in (FuzzyFilteredSettings, ClassicFuzzySettings, BackPropagationSettings)
}
"""Kind of network by its name in files -> its settings."""


@dataclass(frozen=True, kw_only=True)
class TrainingSettings(Ranged, section="training"):
    """Budget of a training and its settings, the same for every network and method."""

    passes: Count = 400
    """Passes over the training samples at most.  A pass is an epoch of a gradient method, one
    evaluation of all samples with its least squares in variable projection, and one individual of
    the genetic search."""
    patience: Count = 100
    """Passes without a lower error on the validation groups after which a training ends."""
    learning_rate: Positive = 0.01
    """Learning rate of gradient descent (0.01 as published) and of Adam; bands move at this share
    of their bounds' distance."""
    batch: Count = 64
    """Samples of each of Adam's steps; back-propagation goes sample by sample."""
    ridge: Annotated[float, Range(least=1e-12)] = 1e-8
    """Penalty on the squares of the scaled consequents, as a share of the variance of the scaled
    output [1].  Shares of bands differ by a few per cent, so that consequents of a hundred are at
    work: it bounds the condition and no more."""
    validation: Annotated[float, Range(least=0.0, below=1.0)] = 0.2
    """Share of the groups that are kept for early stopping, whole, at least one; with 0 all groups
    are learnt from, and the state with the least training error is kept."""
    population: Annotated[int, Range(least=2)] = 20
    """Individuals of a generation of the genetic search."""
    breadth: Positive = 1.0
    """c of its fitness exp(-(f - f_min) / (c sigma)) [1]."""
    seed: Whole = 0
    """Seed of initial weights, order of samples, validation groups, genetic search."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.passes < self.population:
            raise ValueError(
                f"training.passes = {self.passes} must be at least training.population = "
                f"{self.population}: each individual is a pass"
            )
