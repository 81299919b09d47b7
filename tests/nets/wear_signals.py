"""Made windows whose amplitude grows with the wear and whose frequency goes with the cut."""

from typing import Any

import numpy as np

from pipeline.nets.dcgan_settings import GanSettings, GanTraining

LENGTH = 64
CHANNELS = ("force", "vibration")
SMALL = GanSettings(
    latent=16, generator=(16, 12, 8), discriminator=(12, 16), kernel=5, dropout=0.25, embedding=16
)
TRAINING = GanTraining(steps=6, batch=8, learning_rate=1e-3, every=2, average=0.9)


def windows(many: int = 160, seed: int = 0) -> tuple[np.ndarray, dict[str, Any]]:
    """Windows (N, 2, L) with their wear [um] and cut."""
    rng = np.random.default_rng(seed)
    wear, cut = rng.uniform(0.0, 200.0, many), rng.choice(["side", "slot"], many)
    t = np.arange(LENGTH)
    cycles = np.where(cut == "slot", 4.0, 9.0)[:, None]
    phase = rng.uniform(0.0, 2 * np.pi, (many, 1))
    size = ((20.0 + wear) * rng.uniform(0.9, 1.1, many))[:, None]
    force = 50.0 + 0.5 * wear[:, None] + size * np.sin(2 * np.pi * cycles * t / LENGTH + phase)
    force += rng.normal(scale=5.0, size=force.shape)
    vibration = 0.05 * size * rng.normal(size=(many, LENGTH))
    return np.stack([force, vibration], axis=1), {"wear": wear, "cut": cut}
