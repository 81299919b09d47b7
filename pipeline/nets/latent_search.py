"""Search in the noise of a generator: noise and conditions that explain a recorded window best.

The loss is the distance of short spectra, whose phase does not count, with a penalty on noise
beyond that of the training.  At each value of one condition the noise is searched anew, from
several starts: a profile over the condition.

Source: Creswell and Bharath 2018, Inverting the generator of a GAN; profiles as of a likelihood.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import nn

from pipeline.nets.dcgan import TrainedGan, encoded
from pipeline.nets.dcgan_training import distances, short_spectra
from pipeline.nets.descent import Adam
from pipeline.nets.settings import Whole
from pipeline.nets.stored import reproducible, samples
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, NotNegative, Positive, Ranged


@dataclass(frozen=True, kw_only=True)
class LatentSearch(Ranged, section="latent_search"):
    """Budget of a search in the noise."""

    values: Count = 11
    """Values of the condition, evenly over what was learnt."""
    starts: Count = 3
    """Noises from which each begins."""
    steps: Count = 60
    """Steps of Adam."""
    rate: Positive = 0.1
    """Learning rate of Adam."""
    penalty: NotNegative = 0.1
    """Penalty of the mean square of the noise beyond 1 [1]."""
    seed: Whole = 0
    """Seed of the starts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """Explanation of a recorded window by a generator."""

    condition: str
    unit: str
    """Condition of the profile, and its unit."""
    values: Floats
    """Values of the condition; shape (V,)."""
    distance: Floats
    """Least distance of a generated window from the recorded one at each value [1]; shape (V,)."""
    best: float
    """Value at the least distance."""
    noise: Floats
    """Noise at the best value; shape (Z,)."""
    window: Floats
    """Generated from it, in the units of the channels; shape (C, L)."""
    typical: float
    """Median distance of generated windows at the best value with noise at random [1]: how much the
    search gained."""


def explain(
    gan: TrainedGan, window: ArrayLike, condition: str, given: Mapping[str, Any],
    settings: LatentSearch | None = None,
) -> Explained:  # fmt: skip
    """Noise and value of ``condition`` that explain a recorded window best.

    ``window`` (C, L) in the units of the channels; ``given``: one value of each other condition, if
    not discrete.  Raises ValueError for another shape, or a condition that is missing or not
    learnt.
    """
    settings = settings or LatentSearch()
    x = samples("window", window, 2)
    if x.shape != (len(gan.channels), gan.length):
        raise ValueError(
            f"the window has shape {x.shape}: this generator makes {len(gan.channels)} channels of "
            f"{gan.length} samples"
        )
    sought = next((one for one in gan.space.continuous if one.name == condition), None)
    if sought is None:
        names = ", ".join(one.name for one in gan.space.continuous)
        raise ValueError(f"{condition} is no continuous condition of this generator: {names} are")
    values = np.linspace(sought.low, sought.high, settings.values)
    rows = np.repeat(values, settings.starts)
    others = {name: np.full(len(rows), one) for name, one in given.items() if name != condition}
    numbers, words = encoded(gan.space, {**others, condition: rows})
    goal = [part.expand(len(rows), *part.shape[1:]) for part in short_spectra(
        gan.scaling.scaled(x[None]))]  # fmt: skip
    with reproducible():
        noise = nn.Parameter(gan.noise(len(rows), settings.seed))
        adam = Adam([noise], settings.rate)
        first = None
        for _ in range(settings.steps):
            made = gan.network(noise, numbers, words)
            apart = distances(goal, short_spectra(made))
            first = apart.detach() if first is None else first
            size = noise.square().mean(dim=1)
            adam.step((apart + settings.penalty * torch.relu(size - 1.0)).sum())
        with torch.no_grad():
            made = gan.network(noise, numbers, words)
            apart = distances(goal, short_spectra(made))
    least = int(apart.argmin())
    each = apart.numpy().reshape(settings.values, settings.starts).astype(np.float64)
    began = apart if first is None else first
    near = began.numpy().reshape(settings.values, settings.starts)[least // settings.starts]
    return Explained(
        condition=condition, unit=sought.unit, values=values, distance=each.min(axis=1),
        best=float(rows[least]), noise=noise.detach().numpy()[least].astype(np.float64),
        window=gan.scaling.restored(made[least : least + 1])[0], typical=float(np.median(near)),
    )  # fmt: skip
