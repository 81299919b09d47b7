"""Settings of the networks and of their training, which need no torch to be read."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pipeline.parallel import Compute
from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged, Share
from pipeline.search.methods import METHODS

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


PRECISIONS = ("float32", "bfloat16")
"""Precisions of a training; a trained network always predicts in float32."""
FEWEST_STEPS = 1500
"""Steps of trainings that take longer than processes to train them in take to import torch [1]."""


def place(steps: int) -> Compute:
    """Place of trainings by their total number of steps."""
    return "processes" if steps >= FEWEST_STEPS else "serial"


class SequenceSettings(Ranged):
    """Base of the kinds of network on windows; ``kind`` names one in files."""

    kind: ClassVar[str]


@dataclass(frozen=True, kw_only=True)
class LstmSettings(SequenceSettings, section="lstm"):
    """Settings of a plain LSTM whose last state gives the output."""

    kind: ClassVar[str] = "lstm"
    units: Count = 50
    """Units of the LSTM: 50 to 100 in Feed2025."""


@dataclass(frozen=True, kw_only=True)
class CnnLstmSettings(SequenceSettings, section="cnn_lstm"):
    """Settings of a convolution over time before an LSTM."""

    kind: ClassVar[str] = "cnn_lstm"
    filters: Count = 16
    kernel: Count = 3
    """Filters of the convolution, and samples that each of them sees."""
    pool: Count = 1
    """Samples of which the greatest is passed on; 1 as published, which does nothing."""
    units: Count = 50
    """Units of the LSTM."""


@dataclass(frozen=True, kw_only=True)
class CnnLstmAttentionSettings(CnnLstmSettings, section="cnn_lstm_attention"):
    """Settings of convolution, LSTM and additive attention over time (Feed2025)."""

    kind: ClassVar[str] = "cnn_lstm_attention"
    attention: Count | None = None
    """Rows of W in e_t = v' tanh(W h_t + b); None for as many as the LSTM has units."""


@dataclass(frozen=True, kw_only=True)
class TcnSettings(SequenceSettings, section="tcn"):
    """Settings of a temporal convolutional network (Bai, Kolter and Koltun 2018)."""

    kind: ClassVar[str] = "tcn"
    filters: Count = 16
    kernel: Count = 3
    """Filters of each convolution, and rows that each of them sees."""
    blocks: Annotated[int, Range(least=1, most=12)] = 4
    """Residual blocks of two convolutions with dilation 1, 2, 4, ...; an output sees 1 + 2 (kernel
    - 1) (2^blocks - 1) samples."""


@dataclass(frozen=True, kw_only=True)
class ResNetSettings(SequenceSettings, section="resnet"):
    """Settings of a residual network of strided convolutions over whole windows.

    Residual blocks of He, Zhang, Ren and Sun 2016 over time as in Wang, Yan and Oates 2017, without
    batch normalisation, which would take a window's amplitude away or need the statistics of
    others.
    """

    kind: ClassVar[str] = "resnet"
    filters: Count = 16
    """Filters of the first block; each later one has twice as many at half the rate."""
    kernel: Count = 7
    """Rows that each convolution sees, an odd number."""
    blocks: Annotated[int, Range(least=1, most=6)] = 3
    """Residual blocks of two convolutions."""
    rows: Count = 128
    """Rows of the first block at most: the stride of the convolution before it brings a longer
    window down to them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernel % 2 == 0:
            raise ValueError(
                f"resnet.kernel = {self.kernel} is even: give an odd number, so that a sample has "
                "as many on either side"
            )


@dataclass(frozen=True, kw_only=True)
class ArxSettings(SequenceSettings, section="arx"):
    """Settings of the linear model with lagged inputs, solved by ridge least squares."""

    kind: ClassVar[str] = "arx"
    lags: Count | None = None
    """Last rows of a window that it sees; None for all of them."""
    ridge: Annotated[float, Range(least=1e-12)] = 1e-6
    """Penalty on the squares of the scaled coefficients, as a share of the variance of the scaled
    output [1]."""


WINDOW_KINDS: dict[str, type[SequenceSettings]] = {
    one.kind: one
    for one in (
        ArxSettings, LstmSettings, CnnLstmSettings, CnnLstmAttentionSettings, TcnSettings,
        ResNetSettings,
    )
}  # fmt: skip
"""Kind of network by its name in files -> its settings."""


@dataclass(frozen=True, kw_only=True)
class WindowTraining(Ranged, section="window_training"):
    """Budget of a training on windows and its settings, the same for every network."""

    epochs: Count = 100
    """Passes over the training windows at most."""
    patience: Count = 20
    """Epochs without a lower error on the validation recordings after which a training ends."""
    learning_rate: Positive = 0.003
    """Learning rate of Adam: 0.001 to 0.01 in Feed2025."""
    cooling: Share = 0.0
    """Share of the epochs, the last ones, over which the rate falls to zero [1]."""
    l2: NotNegative = 0.0
    """Penalty on the squares of the weights, biases left out [1]: 0.0001 to 0.1 in Feed2025."""
    batch: Count = 64
    """Windows of a step."""
    validation: Annotated[float, Range(least=0.0, below=1.0)] = 0.2
    """Share of the recordings that are kept for early stopping, whole, at least one; with 0 all are
    learnt from, and the state with the least training error is kept."""
    precision: str = "float32"
    """Precision of a training: ``float32``, or ``bfloat16`` where the processor has it."""
    seed: Whole = 0
    """Seed of initial weights, order of windows, choice of validation recordings."""
    validation_seed: Whole | None = None
    """Seed of the choice of validation recordings, so that trainings with other weights stop by the
    same ones; None for ``seed``."""

    def steps(self, windows: int) -> int:
        """Steps of a training on so many windows at most [1]."""
        return self.epochs * -(-windows // self.batch)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.precision not in PRECISIONS:
            raise ValueError(
                f"window_training.precision = {self.precision!r} must be one of "
                f"{', '.join(PRECISIONS)}"
            )


@dataclass(frozen=True, kw_only=True)
class TuningSettings(Ranged, section="tuning"):
    """Budget of a search for the settings of a network on windows, and where it searches."""

    method: str = "genetic"
    """Name of the search in :data:`pipeline.search.methods.METHODS`."""
    population: Annotated[int, Range(least=2)] = 4
    generations: Count = 3
    """Candidates of a generation, and generations: 8 and 20 in Feed2025."""
    epochs: Count = 30
    patience: Count = 10
    """Epochs and patience of a candidate, as in :class:`WindowTraining`."""
    windows: Count = 1500
    """Windows of a candidate at most, spread evenly over each recording; at least one of each."""
    milestones: tuple[Count, ...] = (10, 20, 40)
    """Epochs after which a candidate is stopped when its least validation error so far is above the
    median of the ``population`` least ones that candidates of earlier generations had by then;
    empty for never."""
    fewest: Count = 4
    """Candidates of earlier generations whose median may stop one."""
    retrained: Count = 3
    """Best settings that are trained again, in full."""
    seed: Whole = 0
    """Seed of the search."""
    learning_rate: tuple[Positive, Positive] = (1e-3, 1e-2)
    units: tuple[Count, Count] = (50, 100)
    l2: tuple[NotNegative, NotNegative] = (1e-4, 1e-1)
    """Lower and upper bound of each: those of Feed2025.  The learning rate and ``l2`` are searched
    on a logarithmic scale, ``l2`` evenly where its lower bound is 0; equal bounds hold one."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.method not in METHODS:
            raise ValueError(f"tuning.method = {self.method!r} is not one of {', '.join(METHODS)}")
        for name in ("learning_rate", "units", "l2"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(
                    f"tuning.{name} = {low:g} to {high:g} is an empty range: give the lower bound "
                    "first"
                )
