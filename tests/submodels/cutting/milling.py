"""An independent simulation of milling on a dynamometer, for tests.

Every tooth is cut into slices, every slice into time steps; a chip is what stands between the edge
and the surfaces that the teeth before left.  Modes act in the frequency domain of the whole record.
Nothing of it is shared with the rooms that it tests.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What was cut, in N/mm^2, N/mm, mm, degrees."""

    cutting: tuple[float, float, float] = (850.0, 240.0, 140.0)
    edge: tuple[float, float, float] = (22.0, 25.0, 4.0)
    flutes: int = 3
    diameter: float = 12.0
    helix: float = 30.0
    runout: float = 0.006
    runout_angle: float = 25.0
    exponent: float = 0.0
    growth: float = 0.0
    worn: tuple[float, ...] = ()
    natural: tuple[float, float, float] | None = None
    damping: float = 0.05


def milled(
    truth: Truth, *, rpm: float, f_z: float, a_p: float, entry: float, leave: float,
    seconds: float, rate: float, phase: float = 0.4, slices: int = 24,
) -> Floats:  # fmt: skip
    """Forces on the tool along the feed, to the left of it and along the axis [N], (T, 3)."""
    steps = round(seconds * rate * 4)
    theta = phase + np.arange(steps) / (rate * 4) * rpm * np.pi / 30
    lag = np.tan(np.radians(truth.helix)) / (truth.diameter / 2)
    pitch = 2 * np.pi / truth.flutes
    out = np.zeros((steps, 3))
    for j in range(truth.flutes):
        worn = truth.worn[j] if truth.worn else 1.0
        for s in range(slices):
            z = a_p * (s + 0.5) / slices
            phi = (theta - pitch * j - lag * z) % (2 * np.pi)

            def radius(tooth: int, height: float = z) -> float:
                turn = np.radians(truth.runout_angle) + pitch * tooth + lag * height
                return float(truth.runout * np.cos(turn))

            chips = [
                m * f_z * np.sin(phi) + radius(j) - radius(j - m)
                for m in range(1, truth.flutes + 1)
            ]
            h = np.min(chips, axis=0)
            cut = (phi >= entry) & (phi <= leave) & (h > 0)
            h = np.where(cut, h, 0.05)
            power = h * (h / 0.05) ** -truth.exponent
            grown = 1 - np.exp(-h / truth.growth) if truth.growth else 1.0
            t, r, a = (
                (c * power + e * worn * grown) * cut * a_p / slices
                for c, e in zip(truth.cutting, truth.edge, strict=True)
            )
            out[:, 0] -= t * np.cos(phi) + r * np.sin(phi)
            out[:, 1] += t * np.sin(phi) - r * np.cos(phi)
            out[:, 2] += a
    return shown(out, truth, rate)


def shown(force: Floats, truth: Truth, rate: float) -> Floats:
    """What channels with modes show of forces at four times their rate."""
    if truth.natural is None:
        return force[::4]
    frequency = np.fft.rfftfreq(len(force), 1 / (4 * rate))
    spectrum = np.fft.rfft(force, axis=0)
    for k, natural in enumerate(truth.natural):
        r = frequency / natural
        spectrum[:, k] /= 1 - r**2 + 2j * truth.damping * r
    return np.asarray(np.fft.irfft(spectrum, len(force), axis=0)[::4])
