"""The mean revolution of the spindle in a record of forces, as harmonics of its speed.

The angle of the spindle is not recorded: it is a constant speed, found where the harmonics of the
revolution hold most of the force, and what the phase of the revolution says about its wander.
Harmonics are those of a force F = Re(sum over h of line_h exp(i h theta)); line_0 is the mean.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SPEED = 0.03
"""How far the speed may be from the one that was set, as a share."""
COARSE = 20_000
"""Samples that tell the speed at first."""
BLOCK = 3
"""Revolutions of which one phase is taken."""
ROUNDS = 4
FEWEST = 6
"""Revolutions."""
COHERENT = 0.5
"""Share of the fluctuation that repeats with the revolution, at least."""
BAND = 0.45
"""Of the sampling rate."""
GRID = 128
"""Angles of a revolution, for the scatter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Revolution:
    """Mean revolution of C channels in H harmonics.

    Parameters
    ----------
    speed : float
        Mean speed [rev/s].
    lines : ndarray of complex, shape (H + 1, C)
        [N].
    scatter : ndarray, shape (H + 1, C)
        Variance of ``lines`` from noise and from revolution to revolution, of real and imaginary
        part each [N^2].
    low, high : ndarray, shape (GRID, C)
        Bounds of 95 % of the revolutions over the angle [N].
    count : int
        Revolutions.
    coherent : ndarray, shape (C,)
        Share of each channel's fluctuation that repeats with the revolution [1].
    """

    speed: float
    lines: Complexes
    scatter: Floats
    low: Floats
    high: Floats
    count: int
    coherent: Floats


def mean_revolution(force: Floats, rate: float, speed: float, flutes: int, most: int) -> Revolution:
    """The mean revolution in a steady record.

    Parameters
    ----------
    force : ndarray, shape (T, C)
        [N].
    rate : float
        Of sampling [1/s].
    speed : float
        That was set [rev/s].
    flutes : int
        Teeth; the speed is sought among harmonics up to twice as many.
    most : int
        Harmonics at most.

    Raises
    ------
    ValueError
        When the record is too short, or does not repeat with the revolution.
    """
    if len(force) / rate * speed < FEWEST:
        raise ValueError(
            f"its steady part has {len(force) / rate * speed:.1f} revolutions, {FEWEST} are the "
            "least: record a longer cut"
        )
    harmonics = min(int(BAND * rate / speed), most)
    if harmonics < flutes:
        raise ValueError(
            f"its rate of {rate:g} Hz shows {harmonics} harmonics of the spindle's {speed:g} "
            f"rev/s, {flutes} teeth need {flutes} at least: record faster"
        )
    found = _speed(force, rate, speed, min(2 * flutes, harmonics))
    angle: Floats = np.asarray(2 * np.pi * found / rate * np.arange(len(force)), np.float64)
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
    each = _each(force, angle)
    spectra = np.fft.rfft(each, axis=1)[:, : harmonics + 1] * 2 / GRID
    low, high = np.percentile(each, [2.5, 97.5], axis=0)
    return Revolution(
        speed=float((angle[-1] - angle[0]) / (len(angle) - 1) * rate / (2 * np.pi)), lines=lines,
        scatter=_scatter(spectra, harmonics), low=low, high=high, count=len(each),
        coherent=coherent,
    )  # fmt: skip


def wave(lines: Complexes, angles: Floats) -> Floats:
    """Force of harmonics at angles; shape (T, C).

    Parameters
    ----------
    lines : ndarray of complex, shape (H + 1, C)
        [N].
    angles : ndarray, shape (T,)
        [rad].
    """
    turning = np.exp(1j * np.outer(angles, np.arange(len(lines))))
    return np.real(turning @ lines)


def _speed(force: Floats, rate: float, speed: float, harmonics: int) -> float:
    """Speed near the one set whose harmonics hold most of the force."""
    from scipy.optimize import minimize_scalar

    part = force[:COARSE] - force[:COARSE].mean(axis=0)
    time = np.arange(len(part)) / rate

    def missing(at: float) -> float:
        turning = np.exp(-2j * np.pi * at * time)
        power, factor = 0.0, np.ones_like(turning)
        for _ in range(harmonics):
            factor *= turning
            power += float(np.sum(np.abs(factor @ part) ** 2))
        return -power

    step = rate / (4 * len(part) * harmonics)
    grid = np.arange(speed * (1 - SPEED), speed * (1 + SPEED) + step, step)
    best = grid[int(np.argmin([missing(float(at)) for at in grid]))]
    return float(minimize_scalar(missing, bounds=(best - step, best + step), method="bounded").x)


def _turning(angle: Floats, harmonics: int) -> Floats:
    """1, cosines and sines of the harmonics; shape (T, 2 H + 1)."""
    wheel = np.exp(1j * np.outer(angle, np.arange(1, harmonics + 1)))
    return np.concatenate([np.ones((len(angle), 1)), wheel.real, wheel.imag], axis=1)


def _lines(force: Floats, angle: Floats, harmonics: int) -> Complexes:
    """Harmonics by least squares; shape (H + 1, C)."""
    size = 2 * harmonics + 1
    normal, right = np.zeros((size, size)), np.zeros((size, force.shape[1]))
    for first in range(0, len(force), COARSE):
        part = slice(first, first + COARSE)
        table = _turning(angle[part], harmonics)
        normal += table.T @ table
        right += table.T @ force[part]
    # a grain of ridge: at few samples a revolution neighbouring harmonics are hard to tell apart
    found = np.linalg.solve(normal + 1e-9 * len(force) * np.eye(size), right)
    return np.concatenate(
        [found[:1], found[1 : harmonics + 1] - 1j * found[harmonics + 1 :]]
    ).astype(np.complex128)


def _wander(force: Floats, angle: Floats, lines: Complexes) -> Floats:
    """By how much the spindle is ahead of ``angle``, block by block of revolutions; shape (T,)."""
    harmonics = np.arange(len(lines))[:, None]
    slope = np.empty_like(force)
    rest = np.empty_like(force)
    for first in range(0, len(force), COARSE):
        part = slice(first, first + COARSE)
        rest[part] = force[part] - wave(lines, angle[part])
        slope[part] = wave(1j * harmonics * lines, angle[part])
    turns = (angle - angle[0]) / (2 * np.pi * BLOCK)
    many = max(int(turns[-1]), 1)
    block = np.minimum(turns.astype(np.int64), many - 1)
    above = np.bincount(block, (slope * rest).sum(axis=1), many)
    below = np.bincount(block, (slope**2).sum(axis=1), many)
    ahead = above / np.maximum(below, 1e-300)
    ahead -= ahead.mean()
    found: Floats = np.interp(turns, np.arange(many) + 0.5, np.clip(ahead, -0.5, 0.5))
    return found


def _coherent(force: Floats, angle: Floats, lines: Complexes) -> Floats:
    rest = np.concatenate(
        [
            force[first : first + COARSE] - wave(lines, angle[first : first + COARSE])
            for first in range(0, len(force), COARSE)
        ]
    )
    spread = force.var(axis=0)
    return np.asarray(1 - rest.var(axis=0) / np.where(spread > 0, spread, 1.0))


def _each(force: Floats, angle: Floats) -> Floats:
    """Every whole revolution on a grid of angles; shape (R, GRID, C)."""
    from scipy.interpolate import CubicSpline

    first = np.ceil(angle[0] / (2 * np.pi))
    many = int(np.floor((angle[-1] - 2 * np.pi * first) / (2 * np.pi)))
    places = 2 * np.pi * (first + np.arange(many * GRID) / GRID)
    each: Floats = CubicSpline(angle, force)(places).reshape(many, GRID, force.shape[1])
    return each


def _scatter(spectra: Complexes, harmonics: int) -> Floats:
    """Variance of the mean lines, of real and imaginary part each; shape (H + 1, C).

    Neighbouring revolutions hang together, so that means of BLOCK revolutions count as one.
    """
    many = max(len(spectra) // BLOCK, 2)
    blocks = np.stack([part.mean(axis=0) for part in np.array_split(spectra, many)])
    blocks[:, 0] /= 2
    spread = np.abs(blocks - blocks.mean(axis=0)) ** 2
    variance = spread.sum(axis=0) / (many - 1) / many
    variance[1:] /= 2
    # harmonics near a half of the grid are those of the noise beside them
    top = min(harmonics + 1, GRID // 3)
    variance[top:] = variance[max(top - 8, 1) : top].mean(axis=0)
    return np.asarray(variance)
