"""Features of windows of signals: levels, shape, spectrum, harmonics of the spindle, conditions.

Channels are divided by their scale in training, so that every feature is a number of about one.
Logarithms make gains of sensors and depths of cut additive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import ChannelScaling, WearWindows

BANDS = 8
"""Bands of the spectrum between the window's own frequency and half the rate [1]."""
HARMONICS = 8
"""Number of harmonics of the spindle frequency [1]; a cutter's teeth pass at some of them."""
FLOOR = 1e-3
"""Least amplitude that a logarithm sees, as a share of the channel's scale [1]."""
REACH = 4.0
"""Standard deviations of training [1] beyond which a feature counts no further."""


@dataclass(frozen=True, kw_only=True)
class KnownConditions:
    """Conditions that predictions look at, as they were in training."""

    numbers: tuple[str, ...] = ()
    """Names of the continuous ones."""
    words: Mapping[str, tuple[str, ...]]
    """Discrete ones -> their values in training."""

    @staticmethod
    def of(windows: WearWindows, progress: str) -> "KnownConditions":
        """Conditions of training windows, without the tool's use, which only the baseline has.

        A condition that is the same in all windows tells nothing and is left out.
        """
        numbers, words = [], {}
        for name, values in windows.conditions.items():
            different = np.unique(values)
            if name == progress or len(different) < 2:
                continue
            if name in windows.condition_units:
                numbers.append(name)
            else:
                words[name] = tuple(different.tolist())
        return KnownConditions(numbers=tuple(numbers), words=words)

    def columns(self, windows: WearWindows) -> dict[str, Floats]:
        """Conditions of windows as numbers, (N,) each; a word is one column of 0 and 1 for each."""
        found = {name: np.asarray(windows.conditions[name], float) for name in self.numbers}
        for name, known in self.words.items():
            for word in known:
                found[f"{name} {word}"] = (windows.conditions[name] == word).astype(float)
        return found

    def matrix(self, windows: WearWindows) -> Floats:
        """The same, shape (N, K)."""
        columns = list(self.columns(windows).values())
        return np.stack(columns, axis=1) if columns else np.zeros((len(windows), 0))


def features(windows: WearWindows, scaling: ChannelScaling, known: KnownConditions) -> Floats:
    """Features of windows, shape (N, F), by scaling and conditions of training windows."""
    x = windows.values / np.array(scaling.scale)[:, None]
    mean = x.mean(axis=2)
    beside = x - mean[..., None]
    std = beside.std(axis=2)
    level = np.sqrt((x**2).mean(axis=2))
    shape = beside / np.maximum(std, FLOOR)[..., None]
    parts = [
        mean, _log(std), _log(level), np.ptp(shape, axis=2), (shape**4).mean(axis=2),
        (shape**3).mean(axis=2), np.quantile(x, 0.05, axis=2), np.quantile(x, 0.95, axis=2),
        *_bands(beside), *_harmonics(beside, windows), known.matrix(windows),
    ]  # fmt: skip
    return np.concatenate(parts, axis=1).astype(float)


def _log(amplitude: Floats) -> Floats:
    return np.log(np.maximum(amplitude, FLOOR))


def _bands(x: Floats) -> list[Floats]:
    """Logarithm of the RMS in each band of frequencies, (N, C) each."""
    length = x.shape[2]
    power = np.abs(np.fft.rfft(x * np.hanning(length), axis=2)) ** 2 / length**2
    edges = np.geomspace(1.0 / length, 0.5, BANDS + 1)
    frequency = np.fft.rfftfreq(length)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, BANDS - 1)
    rows = [(place == k) & (frequency > 0) for k in range(BANDS)]
    return [_log(np.sqrt(power[..., one].sum(axis=2))) for one in rows if one.any()]


def _harmonics(x: Floats, windows: WearWindows) -> list[Floats]:
    """Logarithm of the amplitude at multiples of the spindle's frequency, (N, C) each."""
    name = spindle_speed(windows.condition_units)
    if name is None or not np.isfinite(windows.conditions[name]).all():
        return []
    factor, _ = conversion(windows.condition_units[name], "rev/min")
    turns = np.asarray(windows.conditions[name], float) * factor / MINUTE
    t = np.arange(x.shape[2]) / windows.rate_Hz
    found = []
    for harmonic in range(1, HARMONICS + 1):
        wave = np.exp(-2j * np.pi * harmonic * turns[:, None] * t) * np.hanning(len(t))
        amplitude = np.abs(np.einsum("nct,nt->nc", x, wave)) * 4.0 / len(t)
        found.append(_log(amplitude))
    return found


def spindle_speed(units: Mapping[str, str]) -> str | None:
    """The condition that is a speed of rotation, None without one."""
    for name, unit in units.items():
        try:
            conversion(unit, "rev/min")
        except ValueError:
            continue
        return name
    return None


@dataclass(frozen=True, kw_only=True)
class FeatureScaling:
    """Mean and standard deviation of F features in training."""

    mean: Sequence[float]
    std: Sequence[float]

    @staticmethod
    def of(x: Floats) -> "FeatureScaling":
        """Scaling by training windows, shape (N, F)."""
        std = x.std(axis=0)
        std = np.where(std > 1e-9, std, 1.0)
        return FeatureScaling(mean=tuple(x.mean(axis=0).tolist()), std=tuple(std.tolist()))

    def scaled(self, x: Floats) -> Floats:
        """Features about zero, bounded by :data:`REACH`; shape (N, F)."""
        found: Floats = (x - np.array(self.mean)) / np.array(self.std)
        return np.clip(found, -REACH, REACH)
