"""Settings of the conditional DCGAN and of its training, and its conditions.

Sources: DCGAN2019; projection: Miyato and Koyama 2018; FiLM: Perez et al. 2018; R1: Mescheder,
Geiger and Nowozin 2018; spectral norm: Miyato et al. 2018.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from pipeline.nets.settings import PRECISIONS, Whole
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged, Share

CONDITIONING = ("film", "multiply")
LOSSES = ("hinge", "cross_entropy")
SLACK = 1e-6
"""Share of a range by which a continuous condition may lie outside of it: rounding [1]."""


@dataclass(frozen=True, kw_only=True)
class GanSettings(Ranged, section="gan"):
    """Size of a conditional DCGAN; the defaults are those of DCGAN2019."""

    latent: Count = 3500
    """Numbers of the noise."""
    generator: tuple[Count, ...] = (64, 64, 64, 32, 32)
    """Channels after each block of upsampling by two and convolution."""
    discriminator: tuple[Count, ...] = (128, 128, 64, 64)
    """Channels of its convolutions, each with stride 2."""
    kernel: Annotated[int, Range(least=1, most=31)] = 3
    """Samples of every convolution, odd."""
    dropout: Annotated[float, Range(least=0.0, below=1.0)] = 0.5
    """Share of the discriminator's activations that are dropped [1]."""
    condition: str = "film"
    """Conditioning; ``film``: feature-wise linear modulation in the generator and projection in the
    discriminator; ``multiply``, as published: noise and window multiplied by the embedded
    conditions, which scales an amplitude and no more."""
    embedding: Count = 32
    """Numbers that stand for the conditions inside the networks."""
    unknown: Share = 0.1
    """Share of the training windows whose discrete conditions are hidden [1], so that a word that
    was never seen has a learnt mean to fall back on."""
    spectral_norm: bool = True
    """Whether the discriminator's layers are divided by their largest singular value."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernel % 2 == 0:
            raise ValueError(f"gan.kernel = {self.kernel} is even: give an odd number of samples")
        if not self.generator or not self.discriminator:
            raise ValueError("gan.generator and gan.discriminator need a layer each: name channels")
        _one_of("gan.condition", self.condition, CONDITIONING)


@dataclass(frozen=True, kw_only=True)
class GanTraining(Ranged, section="gan_training"):
    """Budget of an adversarial training and its settings; the defaults are those of DCGAN2019."""

    steps: Count = 148_000
    batch: Annotated[int, Range(least=2)] = 32
    """Steps of both networks, and windows of each."""
    learning_rate: Positive = 1e-4
    discriminator_rate: Positive | None = None
    """Learning rates of Adam for the generator and for the discriminator; None for the same."""
    cooling: Share = 0.0
    """Share of the steps, the last ones, over which both rates fall to zero [1]."""
    beta1: Annotated[float, Range(least=0.0, below=1.0)] = 0.5
    beta2: Annotated[float, Range(least=0.0, below=1.0)] = 0.999
    """Shares of the mean gradient and of its mean square that a step of Adam keeps [1]."""
    loss: str = "hinge"
    """Loss: ``hinge`` or ``cross_entropy`` (as published)."""
    r1: NotNegative = 0.0
    """Factor of the mean squared gradient of the score with respect to recorded windows [1]; 0 for
    none."""
    r1_every: Count = 16
    """Steps from one such penalty, which then counts as often, to the next."""
    spectrum: NotNegative = 0.0
    """Weight of the energy distance of spectra in the generator's loss [1]; 0, as published, for
    the discriminator's word alone."""
    warm: Whole = 0
    """First steps in which such distances alone are learnt from."""
    reading: NotNegative = 0.0
    """Weight of the energy distance between readings of one condition (``read`` of the training)
    from recorded and from generated windows, by small networks that saw the former [1]."""
    mismatched: NotNegative = 0.0
    """Weight of recorded windows at the conditions of others, which the discriminator is to refuse
    [1]: it then has to look at the conditions from the first steps on (Reed et al. 2016)."""
    average: Annotated[float, Range(least=0.0, below=1.0)] = 0.999
    """Share of the generator's running mean that a step keeps [1]; 0 for the last weights."""
    every: Count = 200
    """Steps of which one row of the history is the mean, and after which a watch is called."""
    precision: str = "float32"
    """Precision: ``float32``, or ``bfloat16`` where the processor has such products."""
    seed: Whole = 0
    """Seed of weights, noise, order of windows."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.warm and not self.spectrum and not self.reading:
            raise ValueError(
                f"gan_training.warm = {self.warm} steps have nothing to learn from: set "
                "gan_training.spectrum or gan_training.reading above 0"
            )
        _one_of("gan_training.loss", self.loss, LOSSES)
        _one_of("gan_training.precision", self.precision, PRECISIONS)


def _one_of(name: str, given: str, known: Sequence[str]) -> None:
    if given not in known:
        raise ValueError(f"{name} = {given!r} must be one of {', '.join(known)}")


@dataclass(frozen=True, kw_only=True)
class Continuous:
    """A condition that is a number: the range that was learnt, rescaled linearly to -1..1."""

    name: str
    unit: str
    low: float
    high: float

    def scaled(self, values: Any) -> Floats:
        """Values from -1 to 1, shape as given.

        Raises ValueError when one is not finite or lies outside of the range that was learnt.

        >>> Continuous(name="wear", unit="um", low=0.0, high=200.0).scaled([0.0, 150.0]).tolist()
        [-1.0, 0.5]
        """
        given = np.asarray(values, dtype=np.float64)
        slack = SLACK * max(self.high - self.low, abs(self.high), abs(self.low))
        wrong = ~((given >= self.low - slack) & (given <= self.high + slack))
        if wrong.any():
            raise ValueError(
                f"{self.name} = {given[wrong].flat[0]:g} {self.unit} lies outside of what was "
                f"learnt, {self.low:g} to {self.high:g} {self.unit}: choose a value inside"
            )
        width = self.high - self.low
        return 2.0 * (given - self.low) / width - 1.0 if width > 0 else np.zeros(given.shape)


@dataclass(frozen=True, kw_only=True)
class Discrete:
    """A condition that is a word; number 0 stands for one that is not known."""

    name: str
    words: tuple[str, ...]

    def numbered(self, values: Any) -> "np.ndarray[Any, Any]":
        """Numbers of words from 1, 0 for the empty word.

        Raises ValueError when a word was not learnt.
        """
        known = {"": 0, **{word: k for k, word in enumerate(self.words, start=1)}}
        given = [str(one) for one in np.ravel(values)]
        for one in given:
            if one not in known:
                raise ValueError(
                    f"{self.name} = {one!r} was not learnt: choose one of {', '.join(self.words)}, "
                    "or leave it empty for the mean of them"
                )
        return np.array([known[one] for one in given], dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class ConditionSpace:
    """Conditions that a network knows, with their ranges and words."""

    continuous: tuple[Continuous, ...] = ()
    discrete: tuple[Discrete, ...] = ()
    """Discrete conditions in the order in which the network takes them."""

    @staticmethod
    def of(conditions: Mapping[str, Any], units: Mapping[str, str]) -> "ConditionSpace":
        """Ranges and words of the conditions of training windows, by name, each of shape (N,).

        Raises ValueError when a number is not finite.
        """
        continuous, discrete = [], []
        for name, values in conditions.items():
            array = np.asarray(values)
            if array.dtype.kind in "fiu":
                if not np.isfinite(array).all():
                    raise ValueError(
                        f"condition {name} has values that are not finite: leave these windows out"
                    )
                low, high = float(array.min()), float(array.max())
                unit = units.get(name, "")
                continuous.append(Continuous(name=name, unit=unit, low=low, high=high))
            else:
                words = tuple(sorted({str(one) for one in array.tolist()} - {""}))
                discrete.append(Discrete(name=name, words=words))
        return ConditionSpace(continuous=tuple(continuous), discrete=tuple(discrete))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all conditions."""
        return (*(one.name for one in self.continuous), *(one.name for one in self.discrete))

    def encoded(
        self, conditions: Mapping[str, Any]
    ) -> tuple["np.ndarray[Any, Any]", "np.ndarray[Any, Any]"]:
        """Numbers from -1 to 1, shape (N, K), and numbers of words, shape (N, D).

        A discrete condition that is not given is not known; a continuous one has to be given.
        Raises ValueError when a condition is missing, was not learnt, or lies outside of what was.
        """
        strange = sorted(set(conditions) - set(self.names))
        if strange:
            raise ValueError(
                f"{strange[0]} is no condition of this model: it has {', '.join(self.names)}"
            )
        for one in self.continuous:
            if one.name not in conditions:
                raise ValueError(
                    f"condition {one.name} is missing: give a value from {one.low:g} to "
                    f"{one.high:g} {one.unit}".rstrip()
                )
        many = max((np.size(values) for values in conditions.values()), default=1)
        numbers = [
            np.broadcast_to(np.ravel(one.scaled(conditions[one.name])), many)
            for one in self.continuous
        ]
        words = [
            np.broadcast_to(one.numbered(conditions.get(one.name, "")), many)
            for one in self.discrete
        ]
        return (
            np.stack(numbers, axis=1) if numbers else np.zeros((many, 0)),
            np.stack(words, axis=1) if words else np.zeros((many, 0), np.int64),
        )
