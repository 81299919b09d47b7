"""Auxiliary networks that read one condition from a window, for the training of a generator.

They see recorded windows of the training alone and are fixed before the generator's first step;
inputs are level, spread and power in bands of each channel, and the other conditions.  The readings
of generated windows are to be distributed as those of recorded windows at the same conditions, by
the energy distance, which is proper.

Sources: auxiliary classifier: Odena, Olah and Shlens 2017; regression labels: Ding et al. 2021.
"""

from collections.abc import Sequence
from math import cos, pi

import torch
from torch import Tensor, nn

from pipeline.nets.adam import Adam
from pipeline.nets.diversity import band_edges

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
FLOOR = 1e-4
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
    bands = torch.log(2.0 * power @ band + FLOOR**2)
    spread = torch.log(2.0 * power[:, :, 1:].sum(dim=2) + FLOOR**2)
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
