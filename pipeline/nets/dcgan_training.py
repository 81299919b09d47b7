"""Adversarial training of the conditional DCGAN: one loop, running mean of the weights.

Sources: DCGAN2019; hinge loss: Lim and Ye 2017; R1, lazily: Mescheder, Geiger and Nowozin 2018,
Karras et al. 2020; running mean of the weights: Yazici et al. 2019.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor
from torch.nn.functional import relu, softplus

from pipeline.nets.adam import Adam, flat
from pipeline.nets.best_state import Diverged
from pipeline.nets.condition_reading import Readers
from pipeline.nets.dcgan import (
    ChannelScaling,
    Discriminator,
    Generator,
    TrainedGan,
    averaged,
    encoded,
)
from pipeline.nets.dcgan_settings import ConditionSpace, GanSettings, GanTraining
from pipeline.nets.spectral_distance import energy_distance
from pipeline.nets.stored import reproducible, samples
from pipeline.nets.window_training import autocast, cooled, usable_precision

Watch = Callable[[int, Callable[[], TrainedGan]], bool | None]
"""Called every ``GanTraining.every`` steps with their number and what gives the generator as it
stands, to sample from; true ends the training."""


def train_gan(
    kind: GanSettings, values: ArrayLike, conditions: Mapping[str, Any], *, training: GanTraining,
    channels: Sequence[str], units: Sequence[str] = (),
    condition_units: Mapping[str, str] | None = None, watch: Watch | None = None, read: str = "",
) -> TrainedGan:  # fmt: skip
    """Generator that is trained on windows and their conditions.

    ``values`` (N, C, L) in the ``units`` of the ``channels``; ``conditions`` by name, numbers or
    words, shape (N,). ``watch`` is called every ``training.every`` steps, and after the last;
    ``read`` names the condition, a number, whose readings count by ``training.reading``.  Raises
    ValueError when shapes do not fit, a value is not finite, or the training diverges
    (:class:`Diverged`).
    """
    x = samples("values", values, 3)
    if len(x) < 2 or 0 in x.shape or len(channels) != x.shape[1]:
        raise ValueError(
            f"values have shape {x.shape} and {len(channels)} channels are named: give two windows "
            "or more, shape (N, C, L), and a name for each channel"
        )
    for name, given in conditions.items():
        if np.shape(given) != (len(x),):
            raise ValueError(
                f"condition {name} has shape {np.shape(given)}: give one value for each of the "
                f"{len(x)} windows"
            )
    space = ConditionSpace.of(conditions, condition_units or {})
    if training.reading and read not in [one.name for one in space.continuous]:
        raise ValueError(
            f"gan_training.reading = {training.reading:g} needs a condition that is a number, not "
            f"{read!r}: name one, or set it to 0"
        )
    scaling = ChannelScaling.of(x)
    precision = usable_precision(training.precision)
    with reproducible(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(training.seed)
        loop = _Loop(kind, training, space, (x.shape[1], x.shape[2]), precision)
        data = (scaling.scaled(x), *encoded(space, conditions))
        if training.reading:
            at = [one.name for one in space.continuous].index(read)
            loop.readers = Readers(*data, at, kind.unknown)

        def so_far() -> TrainedGan:
            return TrainedGan(
                settings=kind, training=training, space=space, channels=tuple(channels),
                units=tuple(units) or ("",) * len(channels), length=x.shape[2], scaling=scaling,
                network=averaged(loop.average), history=np.array(loop.history).reshape(-1, 3),
            )  # fmt: skip

        loop.run(data, so_far, watch)
        return so_far()


class _Loop:
    """Adam on both networks in turn, and the running mean of the generator's weights."""

    def __init__(
        self, kind: GanSettings, training: GanTraining, space: ConditionSpace,
        shape: tuple[int, int], precision: str,
    ) -> None:  # fmt: skip
        self.kind, self.training, self.precision = kind, training, precision
        channels, length = shape
        self.generator = Generator(channels, length, space, kind)
        self.discriminator = Discriminator(channels, space, kind)
        self.average = averaged(self.generator)
        self.mean = flat(list(self.average.parameters()))
        rate, betas = training.learning_rate, (training.beta1, training.beta2)
        self.rates = {
            "generator": rate, "discriminator": training.discriminator_rate or rate,
        }  # fmt: skip
        self.adam = {
            name: Adam(list(getattr(self, name).parameters()), one, betas=betas)
            for name, one in self.rates.items()
        }
        self.readers: Readers | None = None
        self.history: list[tuple[float, float, float]] = []

    def run(
        self, data: tuple[Tensor, Tensor, Tensor], so_far: Callable[[], TrainedGan],
        watch: Watch | None,
    ) -> None:  # fmt: skip
        """Train to the last step, or until a watch ends it."""
        sums, many = torch.zeros(2), 0
        for done in range(1, self.training.steps + 1):
            sums += self._step(data, done)
            many += 1
            if done % self.training.every and done != self.training.steps:
                continue
            losses = [float(one) for one in sums / many]
            if not np.isfinite(losses).all():
                raise Diverged(
                    f"adversarial training diverged within {done} steps: lower "
                    f"gan_training.learning_rate from {self.training.learning_rate:g}"
                )
            self.history.append((float(done), losses[0], losses[1]))
            sums, many = torch.zeros_like(sums), 0
            if watch is not None and watch(done, so_far):
                break

    def _step(self, data: tuple[Tensor, Tensor, Tensor], done: int) -> Tensor:
        """One step of each network; their losses, shape (2,)."""
        told, batch = self._batch(data), self.training.batch
        left = cooled(done, self.training.steps, self.training.cooling)
        for name, one in self.adam.items():
            one.rate = left * self.rates[name]
        real, numbers, words = told
        pairs = 2 if self.training.spectrum or self.training.reading else 1
        noise = torch.randn(pairs * batch, self.kind.latent)
        with autocast(self.precision):
            made = self.generator(noise, numbers.repeat(pairs, 1), words.repeat(pairs, 1)).float()
        fake, *others = made.split(batch)
        towards = real.new_zeros(())
        refused = real.new_zeros(())
        if done > self.training.warm:
            refused = self._discriminated(told, fake.detach(), done)
            with autocast(self.precision):
                again = self.discriminator(fake, numbers, words).float()
            hinge = self.training.loss == "hinge"
            towards = -again.mean() if hinge else softplus(-again).mean()
        if self.training.spectrum:
            apart = energy_distance(real, fake, others[0])
            towards = towards + self.training.spectrum * apart
        if self.readers is not None:
            apart = self.readers.distance((real, fake, others[0]), numbers, words)
            towards = towards + self.training.reading * apart
        self.adam["generator"].step(towards)
        self._keep_mean(done)
        return torch.stack([refused.detach(), towards.detach()])

    def _discriminated(
        self, told: tuple[Tensor, Tensor, Tensor], fake: Tensor, done: int
    ) -> Tensor:
        """One step of the discriminator; its loss."""
        real, *conditions = told
        wrong = self.training.mismatched
        shown = torch.cat([real, fake, *([real] if wrong else [])])
        beside = [
            torch.cat([part, part, *([part.roll(1, 0)] if wrong else [])]) for part in conditions
        ]
        with autocast(self.precision):
            scores = self.discriminator(shown, *beside).float()
        of_real, *others = scores.split(len(real))
        hinge = self.training.loss == "hinge"
        loss = relu(1.0 - of_real).mean() if hinge else softplus(-of_real).mean()
        for share, refused in zip((1.0, wrong), others, strict=False):
            loss = loss + share * (relu(1.0 + refused) if hinge else softplus(refused)).mean()
        total = loss
        if self.training.r1 and done % self.training.r1_every == 0:
            penalty = gradient_penalty(self.discriminator, real, *conditions)
            total = loss + 0.5 * self.training.r1 * self.training.r1_every * penalty
        self.adam["discriminator"].step(total)
        return loss

    def _batch(self, data: tuple[Tensor, Tensor, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """Windows at random, the words of some of them hidden."""
        rows = torch.randint(len(data[0]), (self.training.batch,))
        real, numbers, words = (part[rows] for part in data)
        if words.shape[1] and self.kind.unknown:
            known = torch.rand(words.shape) >= self.kind.unknown
            words = words * known
        return real, numbers, words

    @torch.no_grad()
    def _keep_mean(self, done: int) -> None:
        """Move the running mean of the weights; its first steps forget faster."""
        keep = min(self.training.average, done / (done + 10.0)) if self.training.average else 0.0
        self.mean.lerp_(self.adam["generator"].values, 1.0 - keep)


def gradient_penalty(
    discriminator: Discriminator, real: Tensor, numbers: Tensor, words: Tensor
) -> Tensor:
    """R1: mean over windows of the squared gradient of the score with respect to the window [1]."""
    x = real.detach().requires_grad_(True)
    score = discriminator(x, numbers, words).sum()
    (slope,) = torch.autograd.grad(score, x, create_graph=True)
    return slope.square().sum(dim=(1, 2)).mean()
