"""Mean revolution of the spindle in the steady part of a force record, as harmonics of its speed.

The steady part lies between full engagement of the tool and its exit.  The spindle's angle is not
recorded: it follows from a constant speed, the one whose harmonics carry most of the force, and
from the slow drift that the phase of the revolution shows.
Harmonics are those of a force F = Re(sum over h of line_h exp(i h theta)); line_0 is the mean.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.schema.arrays import Bools, Complexes, Floats

AIR = 0.12
"""Share of the cut's fluctuation below which a revolution is one in air [1]."""
ALIKE = 0.1
"""Share within which revolutions of the steady part have the RMS force of their middle one [1]."""
SMOOTH = 9
"""Revolutions over which the median of the RMS force is taken."""
FEWEST_IN_AIR = 3
"""Revolutions in air from which the zero of the channels is taken, at least."""


@dataclass(frozen=True, kw_only=True)
class Steady:
    """Steady samples of a recording, and the zero of its channels."""

    first: int
    last: int
    """Samples from ``first`` up to and without ``last``."""
    zero: Floats
    """Reading of the channels without force [N]; shape (T, 3)."""
    zero_measured: bool
    """Whether the recording shows air cutting, from which the zero is taken."""


def steady_part(force: Floats, revolution: float, entry_length: float) -> Steady:
    """The steady part of a recording.

    ``force`` (T, 3) [N]; ``revolution`` is its length in samples, ``entry_length`` the samples from
    first contact to full engagement, and the exit takes as many. ValueError when there is no cut in
    it.
    """
    count = int(len(force) / revolution)
    if count < 1:
        raise ValueError("it is shorter than one revolution of the spindle: record more")
    starts = (np.arange(count + 1) * revolution).astype(np.int64)
    # standard deviation within each revolution, all channels together
    fluctuation = np.sqrt([force[a:b].var(axis=0).sum() for a, b in pairwise(starts)])
    strongest = float(np.percentile(fluctuation, 90))
    if strongest == 0.0:
        raise ValueError("its forces do not change: there is no cut in it")
    air = fluctuation < AIR * strongest
    zero, measured = _zero(force, starts, air)
    rms = np.sqrt(np.add.reduceat((force - zero) ** 2, starts[:-1], axis=0).sum(axis=1))
    rms /= np.sqrt(np.diff(np.append(starts[:-1], len(force))))
    first, last = _plateau(rms, _inside(~air, entry_length / revolution))
    return Steady(
        first=int(starts[first]), last=int(starts[last]), zero=zero, zero_measured=measured
    )


def _zero(force: Floats, starts: NDArray[np.int64], air: Bools) -> tuple[Floats, bool]:
    """Straight line through the revolutions in air, and whether there are any; 0 without them."""
    rows = np.flatnonzero(air)
    if len(rows) < FEWEST_IN_AIR:
        return np.zeros_like(force), False
    middle = (starts[rows] + starts[rows + 1]) / 2
    level = np.array([force[starts[k] : starts[k + 1]].mean(axis=0) for k in rows])
    both_ends = rows[0] < len(air) / 2 < rows[-1]
    if not both_ends:
        return np.broadcast_to(np.median(level, axis=0), force.shape), True
    slope, base = np.polyfit(middle, level, 1)
    zero: Floats = np.arange(len(force))[:, None] * slope + base
    return zero, True


def _inside(cut: Bools, entry: float) -> Bools:
    """Revolutions in full engagement: the cut without entry and exit."""
    rows = np.flatnonzero(cut)
    inside = cut.copy()
    margin = int(np.ceil(entry)) + 1
    if rows[0] > 0:
        inside[: rows[0] + margin] = False
    if rows[-1] < len(cut) - 1:
        inside[rows[-1] + 1 - margin :] = False
    if not inside.any():
        raise ValueError("the tool is nowhere fully in the material: record a longer cut")
    return inside


def _plateau(level: Floats, inside: Bools) -> tuple[int, int]:
    """The longest run of revolutions whose force is that of their middle."""
    from scipy.ndimage import median_filter

    smooth = median_filter(level, size=min(SMOOTH, len(level)), mode="nearest")
    middle = float(np.median(smooth[inside]))
    run = (0, 0)
    for _ in range(3):
        similar = inside & (np.abs(smooth / middle - 1) < ALIKE)
        edges = np.diff(similar.astype(np.int8), prepend=0, append=0)
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        if not len(begins):
            raise ValueError("its force never stays the same over revolutions: record a longer cut")
        longest = int(np.argmax(ends - begins))
        run = (int(begins[longest]), int(ends[longest]))
        middle = float(np.median(smooth[run[0] : run[1]]))
    return run


SPEED = 0.03
"""Greatest deviation of the speed from its setpoint, as a share [1]."""
COARSE = 20_000
"""Samples of the first estimate of the speed, and of a block of the regression."""
BLOCK = 3
"""Revolutions over which one phase is taken."""
ROUNDS = 4
"""Alternations between phase and harmonics."""
FEWEST = 6
"""Revolutions of the steady part, at least."""
COHERENT = 0.5
"""Share of the fluctuation that repeats with the revolution, at least [1]."""
BAND = 0.45
"""Share of the sampling rate up to which harmonics are used [1]."""
GRID = 128
"""Angles of a revolution on which single revolutions are resampled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Revolution:
    """Mean revolution of C channels in H harmonics."""

    speed: float
    """Mean speed [rev/s]."""
    lines: Complexes
    """[N]; shape (H + 1, C)."""
    scatter: Floats
    """Variance of ``lines`` from noise and from revolution to revolution, of real and imaginary
    part each [N^2]; shape (H + 1, C)."""
    count: int
    """Revolutions."""
    coherent: Floats
    """Share of each channel's fluctuation that repeats with the revolution [1]; shape (C,)."""


def mean_revolution(
    force: Floats, rate: float, speed: float, flutes: int, highest: int
) -> Revolution:
    """The mean revolution in a steady record.

    ``force`` (T, C) [N] is sampled at ``rate`` [1/s]; ``speed`` is the setpoint of the spindle
    [rev/s], estimated from harmonics up to twice as many as teeth; ``highest`` bounds the
    harmonics. ValueError when the record is too short, or does not repeat with the revolution.
    """
    if len(force) / rate * speed < FEWEST:
        raise ValueError(
            f"its steady part has {len(force) / rate * speed:.1f} revolutions, {FEWEST} are the "
            "least: record a longer cut"
        )
    harmonics = min(int(BAND * rate / speed), highest)
    if harmonics < flutes:
        raise ValueError(
            f"its rate of {rate:g} Hz shows {harmonics} harmonics of the spindle's {speed:g} "
            f"rev/s, {flutes} teeth need {flutes} at least: record faster"
        )
    measured_speed = _speed(force, rate, speed, min(2 * flutes, harmonics))
    angle: Floats = np.asarray(
        2 * np.pi * measured_speed / rate * np.arange(len(force)), np.float64
    )
    lines = _lines(force, angle, harmonics)
    for _ in range(ROUNDS):
        angle = angle + _wander(force, angle, lines)
        lines = _lines(force, angle, harmonics)
    coherent = _coherent(force, angle, lines)
    if coherent[:2].max() < COHERENT:
        raise ValueError(
            f"{100 * coherent[:2].max():.0f} % of its forces repeat with a spindle near "
            f"{60 * speed:g} rev/min: correct its speed, or record a steady cut"
        )
    revolutions = _revolutions(force, angle)
    spectra = np.fft.rfft(revolutions, axis=1)[:, : harmonics + 1] * 2 / GRID
    return Revolution(
        speed=float((angle[-1] - angle[0]) / (len(angle) - 1) * rate / (2 * np.pi)), lines=lines,
        scatter=_scatter(spectra, harmonics), count=len(revolutions), coherent=coherent,
    )  # fmt: skip


def wave(lines: Complexes, angles: Floats) -> Floats:
    """Force of harmonics (H + 1, C) [N] at angles (T,) [rad]; shape (T, C)."""
    return np.real(lines.T @ _phasors(angles, len(lines))).T


def _phasors(angles: Floats, count: int) -> Complexes:
    """exp(i k angle) of the orders k from 0, each a product of two lower ones; (count, T)."""
    found = np.ones((count, len(angles)), np.complex128)
    found[1:2] = np.exp(1j * angles)
    for k in range(2, count):
        np.multiply(found[k // 2], found[k - k // 2], out=found[k])
    return found


def _speed(force: Floats, rate: float, speed: float, harmonics: int) -> float:
    """Speed near the setpoint whose harmonics carry most of the force [rev/s]."""
    from scipy.optimize import minimize_scalar

    part = force[:COARSE] - force[:COARSE].mean(axis=0)
    time = np.arange(len(part)) / rate

    def negative_power(trial: float) -> float:
        phasor = np.exp(-2j * np.pi * trial * time)
        power, factor = 0.0, np.ones_like(phasor)
        for _ in range(harmonics):
            factor *= phasor
            power += float(np.sum(np.abs(factor @ part) ** 2))
        return -power

    step = rate / (4 * len(part) * harmonics)
    grid = np.arange(speed * (1 - SPEED), speed * (1 + SPEED) + step, step)
    best = grid[int(np.argmin([negative_power(float(trial)) for trial in grid]))]
    return float(
        minimize_scalar(negative_power, bounds=(best - step, best + step), method="bounded").x
    )


def _lines(force: Floats, angle: Floats, harmonics: int) -> Complexes:
    """Harmonics by least squares; shape (H + 1, C)."""
    size = 2 * harmonics + 1
    normal, right = np.zeros((size, size)), np.zeros((size, force.shape[1]))
    for first in range(0, len(force), COARSE):
        part = slice(first, first + COARSE)
        phasors = _phasors(angle[part], harmonics + 1)
        table = np.concatenate([phasors.real, phasors[1:].imag])  # 1, cosines and sines
        normal += table @ table.T
        right += table @ force[part]
    # a grain of ridge: at few samples a revolution neighbouring harmonics are hard to tell apart
    solution = np.linalg.solve(normal + 1e-9 * len(force) * np.eye(size), right)
    return np.concatenate(
        [solution[:1], solution[1 : harmonics + 1] - 1j * solution[harmonics + 1 :]]
    ).astype(np.complex128)


def _wander(force: Floats, angle: Floats, lines: Complexes) -> Floats:
    """Lead of the spindle over ``angle`` [rad], by blocks of revolutions; shape (T,)."""
    harmonics = np.arange(len(lines))[:, None]
    slope = np.empty_like(force)
    residual = np.empty_like(force)
    for first in range(0, len(force), COARSE):
        part = slice(first, first + COARSE)
        residual[part] = force[part] - wave(lines, angle[part])
        slope[part] = wave(1j * harmonics * lines, angle[part])
    blocks = (angle - angle[0]) / (2 * np.pi * BLOCK)
    count = max(int(blocks[-1]), 1)
    block = np.minimum(blocks.astype(np.int64), count - 1)
    numerator = np.bincount(block, (slope * residual).sum(axis=1), count)
    denominator = np.bincount(block, (slope**2).sum(axis=1), count)
    ahead = numerator / np.maximum(denominator, 1e-300)
    ahead -= ahead.mean()
    return np.interp(blocks, np.arange(count) + 0.5, np.clip(ahead, -0.5, 0.5))


def _coherent(force: Floats, angle: Floats, lines: Complexes) -> Floats:
    """Share of each channel's variance that repeats with the revolution [1]; shape (C,)."""
    residual = np.concatenate(
        [
            force[first : first + COARSE] - wave(lines, angle[first : first + COARSE])
            for first in range(0, len(force), COARSE)
        ]
    )
    variance = force.var(axis=0)
    return np.asarray(1 - residual.var(axis=0) / np.where(variance > 0, variance, 1.0))


def _revolutions(force: Floats, angle: Floats) -> Floats:
    """Every whole revolution on a grid of angles; shape (R, GRID, C)."""
    from scipy.interpolate import CubicSpline

    first = np.ceil(angle[0] / (2 * np.pi))
    count = int(np.floor((angle[-1] - 2 * np.pi * first) / (2 * np.pi)))
    angles = 2 * np.pi * (first + np.arange(count * GRID) / GRID)
    return CubicSpline(angle, force)(angles).reshape(count, GRID, force.shape[1])


def _scatter(spectra: Complexes, harmonics: int) -> Floats:
    """Variance of the mean lines, of real and imaginary part each; shape (H + 1, C).

    Neighbouring revolutions are correlated, so that the mean of BLOCK revolutions counts as one.
    """
    count = max(len(spectra) // BLOCK, 2)
    blocks = np.stack([part.mean(axis=0) for part in np.array_split(spectra, count)])
    blocks[:, 0] /= 2
    spread = np.abs(blocks - blocks.mean(axis=0)) ** 2
    variance = spread.sum(axis=0) / (count - 1) / count
    variance[1:] /= 2
    # harmonics near a half of the grid are those of the noise beside them
    top = min(harmonics + 1, GRID // 3)
    variance[top:] = variance[max(top - 8, 1) : top].mean(axis=0)
    return np.asarray(variance)
