"""Conditional DCGAN of windows of several channels: the two networks and what was trained of them.

Generator: dense, reshape, blocks of upsampling by two + convolution + instance norm + LeakyReLU,
tanh.  Discriminator: convolutions with stride 2, LeakyReLU, dropout, mean over time.  Conditions
enter through feature-wise linear modulation and projection, or, as published, by multiplication.
Windows have shape (N, C, L): C channels of L samples.

Sources: DCGAN2019; Radford, Metz and Chintala 2016; Perez et al. 2018; Miyato and Koyama 2018.
Unlike in the published code every block does upsample, and noise is not merely scaled by the label.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pipeline.nets.dcgan_settings import (
    ConditionSpace,
    GanSettings,
    GanTraining,
)
from pipeline.nets.stored import (
    document_of,
    fill,
    history_of,
    reproducible,
    state_of,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.store import structured

SLOPE = 0.2
"""Slope of LeakyReLU below zero [1]."""
STYLE = 32
"""Numbers of the noise that modulate beside the conditions: instance norm takes the amplitude of a
window away, and windows of the same conditions differ in it."""
INSIDE = 0.9
"""Share of tanh's range that the scale of a channel fills [1]."""
ROWS = 256
"""Windows of one step of a sampling."""


class Conditions(nn.Module):
    """Embedded conditions, shape (N, E), from numbers (N, K) and numbers of words (N, D)."""

    def __init__(self, space: ConditionSpace, settings: GanSettings, extra: int = 0) -> None:
        super().__init__()
        size = settings.embedding
        self.words = nn.ModuleList(nn.Embedding(len(d.words) + 1, size) for d in space.discrete)
        entering = len(space.continuous) + size * len(space.discrete) + extra
        self.first, self.second = nn.Linear(max(entering, 1), size), nn.Linear(size, size)

    def forward(self, numbers: Tensor, words: Tensor, extra: Tensor | None = None) -> Tensor:
        """Embedding; ``extra`` numbers stand beside the conditions."""
        parts = [numbers, *(one(words[:, k]) for k, one in enumerate(self.words))]
        entering = torch.cat([*parts, *([] if extra is None else [extra])], dim=1)
        if entering.shape[1] == 0:  # no condition at all
            entering = numbers.new_zeros(len(numbers), 1)
        hidden = nn.functional.leaky_relu(self.first(entering), SLOPE)
        return self.second(hidden)


class Product(nn.Module):
    """Factors, shape (N, F), by which the published form multiplies: each condition's in turn."""

    def __init__(self, space: ConditionSpace, size: int) -> None:
        super().__init__()
        self.words = nn.ModuleList(nn.Embedding(len(d.words) + 1, size) for d in space.discrete)
        self.size = size

    def forward(self, numbers: Tensor, words: Tensor) -> Tensor:
        """Embeddings of words, and 1/2 to 3/2 over the range of each number, multiplied."""
        found = (1.0 + 0.5 * numbers).prod(dim=1, keepdim=True).expand(-1, self.size)
        for k, one in enumerate(self.words):
            found = found * one(words[:, k])
        return found


class Block(nn.Module):
    """Upsampling by two, convolution, instance norm, modulation, LeakyReLU."""

    folded: Tensor

    def __init__(self, entering: int, leaving: int, settings: GanSettings) -> None:
        super().__init__()
        # no bias: the norm would take it off
        self.conv = nn.Conv1d(entering, leaving, settings.kernel, bias=False)
        self.register_buffer("folded", _folded(settings.kernel), persistent=False)
        film = settings.condition == "film"
        self.film = nn.Linear(settings.embedding, 2 * leaving) if film else None
        self.norm = nn.InstanceNorm1d(leaving, affine=not film)

    def forward(self, x: Tensor, embedded: Tensor | None) -> Tensor:
        """Output (N, C', 2 T) of input (N, C, T)."""
        x = self.norm(self._twice(x))
        if self.film is not None and embedded is not None:
            gain, shift = self.film(embedded).unsqueeze(-1).chunk(2, dim=1)
            x = torch.addcmul(shift, x, 1.0 + gain)
        return nn.functional.leaky_relu(x, SLOPE)

    def _twice(self, x: Tensor) -> Tensor:
        """Convolution over each sample twice, as two convolutions over the samples themselves.

        Even and odd results see the same samples under other sums of weights: fewer products, and
        the longer signal is never written.
        """
        weight = self.conv.weight @ self.folded  # (2, C', C, width)
        weight = weight.transpose(0, 1).flatten(0, 1)
        both = nn.functional.conv1d(x, weight, padding=weight.shape[2] // 2)
        return both.unflatten(1, (-1, 2)).transpose(2, 3).flatten(2)


def _folded(kernel: int) -> Tensor:
    """Weights of the samples, shape (2, 1, kernel, width): even, then odd results."""
    half = kernel // 2
    reach = (half + 1) // 2
    found = torch.zeros(2, 1, kernel, 2 * reach + 1)
    for odd in (0, 1):
        for at in range(kernel):
            found[odd, 0, at, (odd + at - half) // 2 + reach] = 1.0
    return found


class Generator(nn.Module):
    """Windows (N, C, L) from noise (N, Z) and conditions, each channel inside -1..1."""

    def __init__(
        self, channels: int, length: int, space: ConditionSpace, settings: GanSettings
    ) -> None:
        super().__init__()
        widths = settings.generator
        self.length, self.start = length, -(-length // 2 ** len(widths))
        self.dense = nn.Linear(settings.latent, widths[0] * self.start)
        self.style = min(STYLE, settings.latent)
        film = settings.condition == "film"
        self.conditions = Conditions(space, settings, extra=self.style) if film else None
        self.product = None if film else Product(space, settings.latent)
        pairs = zip((widths[0], *widths), widths, strict=False)
        self.blocks = nn.ModuleList(Block(a, b, settings) for a, b in pairs)
        self.last = nn.Conv1d(widths[-1], channels, settings.kernel, padding=settings.kernel // 2)

    def forward(self, noise: Tensor, numbers: Tensor, words: Tensor) -> Tensor:
        """Scaled windows."""
        embedded = None
        if self.conditions is not None:
            embedded = self.conditions(numbers, words, noise[:, : self.style])
        elif self.product is not None:
            noise = noise * self.product(numbers, words)
        x = self.dense(noise).unflatten(1, (-1, self.start))  # (N, C0, T0)
        for block in self.blocks:
            x = block(x, embedded)
        return torch.tanh(self.last(x)[:, :, : self.length])


class Discriminator(nn.Module):
    """Score (N,) of windows (N, C, L) at their conditions; higher for what seems recorded."""

    def __init__(self, channels: int, space: ConditionSpace, settings: GanSettings) -> None:
        super().__init__()
        widths, kernel = settings.discriminator, settings.kernel
        bound = nn.utils.parametrizations.spectral_norm if settings.spectral_norm else _as_it_is
        self.convs = nn.ModuleList(
            bound(nn.Conv2d(a, b, (1, kernel), stride=(1, 2), padding=(0, kernel // 2)))
            for a, b in zip((channels, *widths), widths, strict=False)
        )
        film = settings.condition == "film"
        self.conditions = Conditions(space, settings) if film else None
        self.projection = bound(nn.Linear(settings.embedding, 2 * widths[-1])) if film else None
        self.product = None if film else Product(space, channels)
        self.dropout = settings.dropout
        self.score = bound(nn.Linear(2 * widths[-1], 1))

    def forward(self, x: Tensor, numbers: Tensor, words: Tensor) -> Tensor:
        """Scores of windows, one each."""
        if self.product is not None:
            x = x * self.product(numbers, words).unsqueeze(-1)
        # one row high and channels last: half the time of a convolution in one dimension on a CPU
        x = x.unsqueeze(2).contiguous(memory_format=torch.channels_last)
        for conv in self.convs:
            x = nn.functional.leaky_relu(conv(x), SLOPE)
            if self.training and self.dropout:
                x = dropped(x, self.dropout)
        spread = torch.sqrt(x.var(dim=(2, 3), correction=0) + 1e-6)
        seen = torch.cat([x.mean(dim=(2, 3)), spread], dim=1)
        score: Tensor = self.score(seen).squeeze(1)
        if self.conditions is not None and self.projection is not None:
            score = score + (self.projection(self.conditions(numbers, words)) * seen).sum(dim=1)
        return score


def dropped(x: Tensor, share: float) -> Tensor:
    """``x`` with that share of its values 0, to 1/256, and the others raised in turn.

    One random byte a value: torch's own dropout takes ten times as long.
    """
    many = x.numel()
    drawn = torch.empty(-(-many // 8), dtype=torch.int64, device=x.device).random_(-(2**63), None)
    kept = drawn.view(torch.uint8)[:many] >= round(256 * share)
    mask = torch.empty_like(x)
    mask.permute(0, 2, 3, 1).view(-1).copy_(kept)
    return x.mul_(mask.mul_(1.0 / (1.0 - round(256 * share) / 256)))


def _as_it_is(layer: Any) -> Any:
    return layer


@dataclass(frozen=True, kw_only=True, eq=False)
class ChannelScaling:
    """Shift and scale of each channel, so that windows fit tanh."""

    shift: Floats
    scale: Floats
    """Shift and scale in the units of the channels; shape (C,)."""
    clipped: float = 0.0
    """Share of the training samples that lie outside of -1..1 and are cut there [1]."""

    @staticmethod
    def of(values: Floats) -> "ChannelScaling":
        """Scaling by training windows: their median, and the distance that 0.1 % exceed."""
        shift = np.median(values, axis=(0, 2))
        away = np.abs(values - shift[:, None])
        scale = np.quantile(away, 0.999, axis=(0, 2)) / INSIDE
        scale = np.where(scale > 0, scale, np.maximum(away.max(axis=(0, 2)), 0.0))
        scale = np.where(scale > 0, scale, 1.0)
        return ChannelScaling(
            shift=shift, scale=scale, clipped=float((away > scale[:, None]).mean())
        )

    def scaled(self, values: Floats) -> Tensor:
        """Windows inside -1..1, in single precision."""
        found = (values - self.shift[:, None]) / self.scale[:, None]
        return torch.from_numpy(np.clip(found, -1.0, 1.0)).to(torch.float32)

    def restored(self, scaled: Tensor) -> Floats:
        """Windows in the units of the channels."""
        found: Floats = scaled.numpy().astype(np.float64)
        return found * self.scale[:, None] + self.shift[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedGan:
    """A trained generator: windows at conditions."""

    settings: GanSettings
    """Sizes of the networks."""
    training: GanTraining
    """Settings of its training."""
    space: ConditionSpace
    """Conditions, with the ranges that were learnt."""
    channels: tuple[str, ...]
    units: tuple[str, ...]
    """Channels of the windows, with their units."""
    length: int
    """Samples L of a window."""
    scaling: ChannelScaling
    """Scaling of the windows."""
    network: Generator
    """Running mean of its weights, or the last ones."""
    history: Floats
    """Steps up to then, mean loss of discriminator and of generator since the row before [1];
    shape (H, 3)."""

    def noise(self, many: int, seed: int) -> Tensor:
        """Noise of so many windows, shape (N, Z)."""
        generator = torch.Generator().manual_seed(seed)
        return torch.randn(many, self.settings.latent, generator=generator)

    def sample(self, conditions: Mapping[str, Any], *, seed: int = 0) -> Floats:
        """Windows at conditions, shape (N, C, L), in the units of the channels.

        ``conditions`` by name, shape (N,); the empty word, or a discrete one left out, for one that
        is not known; ``seed`` is that of the noise.  Raises ValueError when a condition is missing,
        was not learnt, or lies outside of what was.
        """
        numbers, words = encoded(self.space, conditions)
        noise = self.noise(len(numbers), seed)
        parts = [np.zeros((0, len(self.channels), self.length))]
        with reproducible(), torch.no_grad():
            for k in range(0, len(numbers), ROWS):
                rows = slice(k, k + ROWS)
                scaled = self.network(noise[rows], numbers[rows], words[rows])
                parts.append(self.scaling.restored(scaled))
        return np.concatenate(parts)

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them; weights in base64."""
        return {
            "kind": "dcgan",
            "network": asdict(self.settings),
            "training": asdict(self.training),
            "space": asdict(self.space),
            "channels": list(self.channels),
            "units": list(self.units),
            "length": self.length,
            "scaling": {
                "shift": self.scaling.shift.tolist(), "scale": self.scaling.scale.tolist(),
                "clipped": self.scaling.clipped,
            },
            "state": state_of(self.network),
            "history": self.history.tolist(),
        }  # fmt: skip


def restore_gan(document: Mapping[str, Any]) -> TrainedGan:
    """The generator of a :meth:`TrainedGan.document`; it samples the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit the network that
    it names.
    """
    with document_of("a generator"):
        settings = structured(document["network"], GanSettings, "network")
        space = structured(document["space"], ConditionSpace, "space")
        channels, scaling = tuple(document["channels"]), document["scaling"]
        with torch.random.fork_rng(devices=[]):  # initial weights, which are replaced
            built = Generator(len(channels), document["length"], space, settings)
        fill(built, document["state"])
        return TrainedGan(
            settings=settings, training=GanTraining(**document["training"]), space=space,
            channels=channels, units=tuple(document["units"]), length=document["length"],
            scaling=ChannelScaling(
                shift=np.array(scaling["shift"], dtype=np.float64),
                scale=np.array(scaling["scale"], dtype=np.float64), clipped=scaling["clipped"],
            ),
            network=built.requires_grad_(False).eval(),
            history=history_of(document),
        )  # fmt: skip


def encoded(space: ConditionSpace, conditions: Mapping[str, Any]) -> tuple[Tensor, Tensor]:
    """Conditions as tensors: numbers (N, K) in single precision, numbers of words (N, D)."""
    numbers, words = space.encoded(conditions)
    return torch.tensor(numbers, dtype=torch.float32), torch.tensor(words, dtype=torch.int64)


def averaged(built: Generator) -> Generator:
    """A copy that is to hold the running mean of the weights."""
    return deepcopy(built).requires_grad_(False).eval()
