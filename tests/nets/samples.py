"""Temperatures of a row of sensors in some speed profiles, and something that grows with them."""

from typing import NamedTuple

import numpy as np
import torch

from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
)
from pipeline.nets.training import METHODS
from pipeline.schema.arrays import Floats, Ints

KINDS: tuple[NetworkSettings, ...] = (
    FuzzyFilteredSettings(),
    ClassicFuzzySettings(),
    BackPropagationSettings(),
    BackPropagationSettings(hidden=16, consequent_inputs=True),
)
WAYS = [(kind, method) for kind in KINDS for method in METHODS[kind.kind]]


class Samples(NamedTuple):
    """What :func:`pipeline.nets.training.train` takes."""

    x: Floats
    c: Floats
    y: Floats
    group: Ints


def warm_up(many: int, sensors: int = 9, groups: int = 5, seed: int = 0) -> Samples:
    """Rises that fall along the machine [K], three mean temperatures, a growth [µm]."""
    rng = np.random.default_rng(seed)
    level = rng.uniform(0.2, 1.0, (many, 3))
    along = np.linspace(0.0, 1.0, sensors)
    shapes = np.stack([np.exp(-0.5 * ((along - k) / 0.3) ** 2) for k in (0.0, 0.5, 1.0)])
    x = 20.0 * level @ shapes + rng.normal(0.0, 0.02, (many, sensors))
    c = np.stack([part.mean(axis=1) for part in np.array_split(x, 3, axis=1)], axis=1)
    y = 1.2 * c[:, 0] + 0.5 * c[:, 2] + 0.02 * c[:, 0] * c[:, 1]
    return Samples(x, c, y, np.sort(rng.permutation(many) % groups))


def tensors(*arrays: Floats) -> tuple[torch.Tensor, ...]:
    return tuple(torch.from_numpy(one) for one in arrays)
