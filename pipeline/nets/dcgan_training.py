"""Adversarial training of the conditional DCGAN: one loop, running mean of the weights, distances.

Beside the discriminator, the generator may be held to two proper scores.  The energy distance
E = d(x, y) + d(x, y') - d(y, y') of a recorded window x and two generated ones y, y' at its
conditions, whose expectation is least where the windows have the recorded distribution; d looks at
magnitudes of short spectra, so that phases do not count.  And the same between readings of one
condition by auxiliary networks, which saw recorded windows of the training alone and are fixed
before the generator's first step; their inputs are level, spread and power in bands of each
channel, and the other conditions.

Sources: DCGAN2019; hinge loss: Lim and Ye 2017; R1, lazily: Mescheder, Geiger and Nowozin 2018,
Karras et al. 2020; running mean of the weights: Yazici et al. 2019; spectral energy
distance: Gritsenko et al. 2020; auxiliary classifier: Odena, Olah and Shlens 2017; regression
labels: Ding et al. 2021.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import cos, pi
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn
from torch.nn.functional import relu, softplus

from pipeline.nets.dcgan import (
    ChannelScaling,
    Discriminator,
    Generator,
    TrainedGan,
    averaged,
    encoded,
)
from pipeline.nets.dcgan_settings import ConditionSpace, GanSettings, GanTraining
from pipeline.nets.descent import (
    Adam,
    Diverged,
    autocast,
    cooled,
    flat,
    training_loop,
    usable_precision,
)
from pipeline.nets.diversity import band_edges
from pipeline.nets.stored import reproducible, samples

FLOOR = 1e-3
"""Magnitude below which a line counts as silence, of a window inside -1..1 [1]."""
SHARES = (1, 4, 16)
"""The short spectra are of the whole window, and of these parts of it or less, each half over the
next and of a power of two."""
SHORTEST = 16
"""Samples of the shortest spectrum."""


def short_spectra(x: Tensor) -> list[Tensor]:
    """Magnitudes of windows (N, C, L) in short spectra, one tensor (N, F, C, B) a length."""
    length = x.shape[2]
    found = []
    for part in sorted({_part(length, share) for share in SHARES}):
        frames = x.unfold(2, part, max(part // 2, 1)).transpose(1, 2)  # (N, F, C, part)
        if part < length:  # so short that a product with the waves is faster
            real, imaginary = (frames @ _waves(part, x.device)).chunk(2, dim=-1)
        else:
            real, imaginary = torch.view_as_real(torch.fft.rfft(frames, norm="forward")).unbind(-1)
        found.append(2.0 * torch.sqrt(real * real + imaginary * imaginary + FLOOR**2))
    return found


@cache
def _waves(part: int, device: torch.device) -> Tensor:
    """Cosines, then sines, of the lines of a spectrum under a Hann window, (part, 2 lines)."""
    t = torch.arange(part, dtype=torch.float64)[:, None]
    angle = 2.0 * torch.pi / part * t * torch.arange(part // 2 + 1)
    shape = torch.hann_window(part, dtype=torch.float64)[:, None] / part
    return (shape * torch.cat([angle.cos(), angle.sin()], dim=1)).to(torch.float32).to(device)


def _part(length: int, share: int) -> int:
    if share == 1 or length <= SHORTEST:
        return length
    return max(2 ** ((length // share).bit_length() - 1), SHORTEST)


def distances(a: list[Tensor], b: list[Tensor]) -> Tensor:
    """Distance of each window of ``a`` from that of ``b`` by their short spectra, shape (N,)."""
    total = a[0].new_zeros(len(a[0]))
    for one, other in zip(a, b, strict=True):
        plain = (one - other).abs().sum(dim=(2, 3)) / one.shape[2]
        apart = one.log() - other.log()
        level = (apart * apart).mean(dim=(2, 3))
        total = total + (plain + torch.sqrt(level + 1e-12)).mean(dim=1)
    return total / len(a)


def energy_distance(real: Tensor, one: Tensor, other: Tensor) -> Tensor:
    """Mean energy distance of windows (N, C, L) from two generated ones at the same conditions."""
    x, y, z = short_spectra(real), short_spectra(one), short_spectra(other)
    means = [part.mean(dim=2) for part in (real, one, other)]
    level = _apart(means[0], means[1]) + _apart(means[0], means[2]) - _apart(means[1], means[2])
    return (distances(x, y) + distances(x, z) - distances(y, z) + level).mean()


def _apart(a: Tensor, b: Tensor) -> Tensor:
    """Distance of means (N, C)."""
    return torch.sqrt((a - b).square().sum(dim=1) + 1e-12)


READERS, HIDDEN = 4, 32
"""Networks, and units of each of their hidden layers."""
PASSES = 300
"""Steps of their training, over all windows at once."""
NOISE = 0.3
"""Added to the features in training, in standard deviations of the training windows [1]."""
DECAY = 1e-2
"""Decay of the weights in AdamW."""
RATE = 1e-2
"""Learning rate of AdamW."""
BAND_FLOOR = 1e-4
"""Magnitude below which a band is silence, of windows inside -1..1 [1]."""
FINE = 16
"""Bands of a spectrum: twice as fine as what the judgement looks at."""


def window_features(x: Tensor) -> Tensor:
    """Level, logarithm of spread and of the power in bands of windows (N, C, L), shape (N, K)."""
    length = x.shape[2]
    lines = torch.view_as_real(torch.fft.rfft(x, norm="forward"))
    power = (lines * lines).sum(dim=-1)
    edges = torch.as_tensor(band_edges(length, FINE), device=x.device)
    line = torch.arange(power.shape[2], device=x.device)[:, None]
    band = ((line >= edges[:-1]) & (line < edges[1:])).to(x.dtype)
    bands = torch.log(2.0 * power @ band + BAND_FLOOR**2)
    spread = torch.log(2.0 * power[:, :, 1:].sum(dim=2) + BAND_FLOOR**2)
    return torch.cat([x.mean(dim=2), spread, bands.flatten(1)], dim=1)


class Readers(nn.Module):
    """Fixed networks that read column ``read`` of the conditions' numbers from windows.

    x (N, C, L) are recorded windows, scaled to -1..1, ``numbers`` (N, K) and ``words`` (N, D)
    encoded conditions, word 0 unknown; a share ``unknown`` of the words is hidden in training [1].
    """

    def __init__(
        self, x: Tensor, numbers: Tensor, words: Tensor, read: int, unknown: float = 0.0
    ) -> None:
        super().__init__()
        self.read, self.many = read, [int(one) + 1 for one in words.amax(dim=0)]
        found = torch.cat([window_features(part) for part in x.split(256)])
        self.shift, self.scale = found.mean(dim=0), found.std(dim=0).clamp_min(1e-3)
        entering = found.shape[1] + numbers.shape[1] - 1 + sum(self.many)
        self.networks = nn.ModuleList(
            nn.Sequential(
                nn.Linear(entering, HIDDEN), nn.SiLU(), nn.Linear(HIDDEN, HIDDEN), nn.SiLU(),
                nn.Linear(HIDDEN, 1),
            )
            for _ in range(READERS)
        )  # fmt: skip
        self.to(x.device)
        self._train((found - self.shift) / self.scale, numbers, words, unknown)
        self.requires_grad_(False)

    def _train(self, found: Tensor, numbers: Tensor, words: Tensor, unknown: float) -> None:
        adam = Adam(list(self.networks.parameters()), RATE, decay=DECAY)
        for done in range(PASSES):
            adam.rate = 0.5 * RATE * (1.0 + cos(pi * done / PASSES))
            noisy = found + NOISE * torch.randn(found.shape).to(found.device)
            known = (torch.rand(words.shape) >= unknown).to(words.device)
            error = self._read(noisy, numbers, words * known) - numbers[:, self.read, None]
            adam.step(error.square().mean())

    def _read(self, found: Tensor, numbers: Tensor, words: Tensor) -> Tensor:
        others = [numbers[:, : self.read], numbers[:, self.read + 1 :]]
        told = [
            nn.functional.one_hot(words[:, k], many).to(found.dtype)
            for k, many in enumerate(self.many)
        ]
        entering = torch.cat([found, *others, *told], dim=1)
        return torch.cat([one(entering) for one in self.networks], dim=1)

    def forward(self, x: Tensor, numbers: Tensor, words: Tensor) -> Tensor:
        """Readings of windows (N, C, L), shape (N, readers)."""
        return self._read((window_features(x) - self.shift) / self.scale, numbers, words)

    def distance(self, windows: Sequence[Tensor], numbers: Tensor, words: Tensor) -> Tensor:
        """Mean energy distance between readings of recorded windows and of two generated each."""
        read = self(torch.cat(list(windows)), numbers.repeat(3, 1), words.repeat(3, 1))
        x, y, z = read.chunk(3)
        return ((x - y).abs() + (x - z).abs() - (y - z).abs()).mean()


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
        sums = torch.zeros(2)

        def stopped(done: int) -> bool:
            losses = (sums / (done % self.training.every or self.training.every)).tolist()
            sums.zero_()
            if not np.isfinite(losses).all():
                raise Diverged(
                    f"adversarial training diverged within {done} steps: lower "
                    f"gan_training.learning_rate from {self.training.learning_rate:g}"
                )
            self.history.append((float(done), losses[0], losses[1]))
            return watch is not None and bool(watch(done, so_far))

        for done in training_loop(self.training.steps, stopped, self.training.every):
            sums += self._step(data, done)

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
