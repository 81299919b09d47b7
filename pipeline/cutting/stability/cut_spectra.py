"""Spectra of a recorded cut: its actual speed, lines of the rotation, floor, lines between them.

The actual speed is the one within 1.5 % of the nominal at which the lines of the rotation are
highest.
"""

from dataclasses import dataclass, replace
from math import log

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints

TURNS, MOST_TURNS = 32, 128
"""Revolutions of a segment [1]: lines of the rotation cover a sixth of the band, or less."""
LEAST_SEGMENTS = 5
"""Half-overlapping segments that a verdict needs [1]: 96 revolutions in the cut."""
SPEED_ERROR = 0.015
"""Deviation of the actual speed from the nominal one, at most [1]."""
GUARD = 2.5
"""Half width of a line of the rotation under Hann's window [bins]."""
HARMONICS = 40
"""Harmonics of the rotation by which the speed is found [1]."""
FALSE_ALARM = 1e-3
"""Probability that noise alone makes a line anywhere in the band [1]."""
MAINS, MAINS_HARMONICS = (50.0, 60.0), 13
"""Frequencies of the mains [Hz], and the last harmonic that counts [1]."""
LEAKED = 0.25
"""Power of the valley between a line of its own and a line of the rotation, at most [1]."""
IN_CUT = 0.05
"""Energy of the tooth-passing lines over the greatest of all segments, in a cut at least [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CutSpectra:
    """Half-overlapping segments of a recording under Hann's window; channels of unit variance."""

    frequency: Floats  # (F,) [Hz]
    power: Floats  # (C, S, F)
    start: Ints  # (S,) first sample
    n: Floats  # (S,) [1/s]
    length: int
    rate: float  # [Hz]

    def seconds(self, segments: Bools) -> float:
        """Time that segments stand for, about: where one is in the cut at half of it [s]."""
        ends = np.array([segments[0], segments[-1]]).sum()
        runs = np.diff(np.flatnonzero(np.diff(np.r_[False, segments, False])))[::2]
        return float((runs - 1).sum() + ends) * self.length / 2 / self.rate


def cut_spectra(y: Floats, rate: float, speed: Floats, length: int) -> CutSpectra:
    """Spectra at the actual speed; y has shape (C, T), speed (T,)."""
    start = np.arange(0, y.shape[1] - length + 1, length // 2)
    window = np.hanning(length)
    scale = y.std(axis=1, keepdims=True)
    y = (y - y.mean(axis=1, keepdims=True)) / np.where(scale > 0, scale, 1.0)
    power = np.stack([
        np.abs(np.fft.rfft(window * (y[:, k : k + length] - y[:, k : k + length].mean(
            axis=1, keepdims=True)))) ** 2
        for k in start.tolist()
    ], axis=1)  # fmt: skip
    nominal = CutSpectra(
        frequency=np.arange(length // 2 + 1) * rate / length, power=power / (window**2).sum(),
        start=start,
        n=np.array([speed[k : k + length].mean() for k in start.tolist()]), length=length,
        rate=rate,
    )  # fmt: skip
    return _with_speed(nominal)


def _with_speed(found: CutSpectra) -> CutSpectra:
    """The same with the speed at which the rotation's lines are highest, by logarithms."""
    step = found.frequency[1]
    last = int(min(HARMONICS, 0.45 * 2 * found.frequency[-1] / found.n.max()))
    logs = np.log(found.power.sum(axis=0) + 1e-12)
    orders, rows = np.arange(1, last + 1), np.arange(len(found.n))[:, None]
    turns = float(np.median(found.n)) / step
    factors = 1 + np.arange(-SPEED_ERROR, SPEED_ERROR, 0.25 / (turns * last))
    score = [
        logs[rows, np.rint(found.n[:, None] * f * orders / step).astype(int)].sum() for f in factors
    ]
    best = np.flatnonzero(np.array(score) >= max(score) - 1e-9)
    return replace(found, n=found.n * float(factors[best].mean()))


def rotation_lines(found: CutSpectra) -> tuple[Bools, Ints]:
    """Bins of the rotation's lines, and each bin's nearest order; shape (S, F)."""
    ratio = found.frequency[None] / found.n[:, None]
    order = np.rint(ratio).astype(np.int64)
    away = np.abs(ratio - order) * found.n[:, None]
    return away < GUARD * found.frequency[1] + 5e-4 * found.frequency, order


def noise_floor(found: CutSpectra, rotation: Bools) -> Floats:
    """Floor of the noise in each segment [1], by a running median between lines; (C, S, F)."""
    from scipy.ndimage import median_filter

    out = np.empty_like(found.power)
    places = np.arange(len(found.frequency))
    for c, s in np.ndindex(*found.power.shape[:2]):
        between = np.flatnonzero(~rotation[s])
        smooth = median_filter(found.power[c, s, between], 4 * TURNS + 1, mode="nearest")
        out[c, s] = np.interp(places, between, smooth) / log(2)
    return np.maximum(out, 1e-12)


def in_cut(found: CutSpectra, tooth: Bools, floor: Floats, teeth: int) -> tuple[Bools, Bools]:
    """Segments in which the tooth-passing lines stand out, and idle ones; shape (S,).

    Where the speed changes, which spreads the lines, a segment is neither; between two cuts it is
    idle only with the tooth-passing lines near the floor.
    """
    energy = np.where(tooth & (found.frequency > 0.5 * found.n.min()), found.power / floor, 0.0)
    high = energy.max(axis=2).sum(axis=0)
    strength = np.where(tooth, found.power, 0.0).sum(axis=(0, 2))
    strong = strength > IN_CUT * np.quantile(strength, 0.9)
    stands_out = high > 4 * -log(FALSE_ALARM) * len(found.power)
    constant = 2 * teeth * np.abs(np.gradient(found.n)) < GUARD * found.frequency[1]
    cut = stands_out & strong & constant
    between = np.logical_or.accumulate(cut) & np.logical_or.accumulate(cut[::-1])[::-1]
    return cut, constant & ~cut & ~(between & stands_out)


def leaked_lines(power: Floats, rotation: Bools) -> Bools:
    """Bins on the flank of a stronger line of the rotation, without a valley between; (F,)."""

    def on_right_flank(power: Floats, rotation: Bools) -> Bools:
        out, peak, valley = rotation.copy(), 0.0, 0.0
        for k, (p, turned) in enumerate(zip(power.tolist(), rotation.tolist(), strict=True)):
            peak = (max(peak, p) if k and rotation[k - 1] else p) if turned else peak
            valley = p if turned else min(valley, p)
            out[k] |= p < min(peak, valley / LEAKED)
        return out

    left = on_right_flank(power[::-1], rotation[::-1])[::-1]
    return on_right_flank(power, rotation) | left


def standing_lines(
    found: CutSpectra, white: Floats, segments: tuple[Bools, Bools], free: Bools
) -> tuple[Bools, Floats]:
    """Bins of lines that noise alone does not make, and how probable it is that it does; (F,)."""
    from scipy.stats import gamma

    cut, idle = segments
    channels = len(found.power)
    shape = channels * max(cut.sum() / 2, 1.0)
    chance = gamma.sf(white[cut].mean(axis=0) * shape / channels, shape) * free.sum()
    line = free & (chance < FALSE_ALARM)
    if idle.sum() >= 2:  # a line that sounds without the cut too is another machine's
        line &= found.power[:, idle].mean(axis=(0, 1)) < 0.25 * found.power[:, cut].mean((0, 1))
    return line, chance


def mains_lines(frequency: Floats) -> Bools:
    """Bins of the mains' harmonics; shape (F,)."""
    out = np.zeros(len(frequency), bool)
    for mains in MAINS:
        order = np.rint(frequency / mains)
        near = np.abs(frequency - order * mains) < 1.5 * frequency[1]
        out |= near & (order <= MAINS_HARMONICS) & (order > 0)
    return out


def line_frequency(power: Floats, frequency: Floats, at: int) -> tuple[float, float]:
    """Frequency of a line by the centroid of its bins, and half of its 95 % interval [Hz].

    Parameters
    ----------
    power : ndarray, shape (S, F)
        Power of each segment, of channels of unit variance [1].
    frequency : ndarray, shape (F,)
        Frequencies of the bins [Hz].
    at : int
        Bin of the line.
    """
    around = slice(max(at - 2, 0), at + 3)
    weight = np.maximum(power[:, around], 0.0)
    each = (weight @ frequency[around]) / np.maximum(weight.sum(axis=1), 1e-12)
    kept = each[weight.sum(axis=1) > 0.1 * weight.sum(axis=1).max()]
    centre = float(weight.sum(axis=0) @ frequency[around] / weight.sum())
    return centre, float(1.96 * kept.std() / max(len(kept) / 2, 1.0) ** 0.5)


def line_power(
    y: Floats, f_c: float, found: CutSpectra, first: int, last: int
) -> tuple[Floats, int]:
    """Power of a line over samples first to last, in its loudest channel, and which one that is."""
    part = y[:, max(first, 0) : last]
    n = float(np.median(found.n))
    width = max(abs(f_c / n - round(f_c / n)) * n - found.frequency[1], 2 * found.frequency[1])
    size = part.shape[1] + part.shape[1] // 4  # its end does not run into its begin
    spectrum = np.fft.fft(part - part.mean(axis=1, keepdims=True), size)
    frequency = np.fft.fftfreq(size, 1 / found.rate)
    a = np.fft.ifft(np.where(np.abs(frequency - f_c) < width, spectrum, 0.0))
    a2 = np.abs(a[:, : part.shape[1]]) ** 2
    loudest = int(np.argmax(a2.mean(axis=1) / np.maximum(part.var(axis=1), 1e-300)))
    return a2[loudest], loudest
