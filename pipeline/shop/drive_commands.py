"""Commands for the axes of a simulated machine: strokes and circles, smoothed as controls do."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np

from pipeline.shop.control_parameters import AxisLimits, ControlParameters
from pipeline.shop.s_curve import Floats, Profile, change_time, rest_to_rest

BELL = (0.008, 0.004)
"""Lengths of the two moving averages after the interpolation [s]."""
REST = 0.3
"""Standstill before and after [s]."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """One way: signed length [mm], greatest speed [mm/s], standstill after it [s]."""

    length: float
    speed: float
    pause: float = 0.12


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Acceleration [mm/s2] and jerk [mm/s3] of a way."""

    acceleration: float
    jerk: float


def of_axis(axis: AxisLimits) -> Limits:
    """Limits of one axis alone."""
    return Limits(acceleration=axis.acceleration * 1e3, jerk=axis.jerk * 1e3)


def of_path(control: ControlParameters) -> Limits:
    """Limits of a path."""
    return Limits(acceleration=control.cutting_acceleration * 1e3, jerk=control.cutting_jerk * 1e3)


def travel(moves: Sequence[Move], limits: Limits, frequency: int) -> Floats:
    """Way of ``moves`` from 0 [mm] at ``frequency`` [Hz], shape (T,)."""
    profiles = [
        rest_to_rest(abs(m.length), m.speed, limits.acceleration, limits.jerk) for m in moves
    ]
    starts = np.cumsum(
        [REST, *(p.duration + m.pause for p, m in zip(profiles, moves, strict=True))]
    )
    time: Floats = np.arange(int((starts[-1] + REST) * frequency), dtype=np.float64) / frequency
    way: Floats = np.zeros(time.size)
    place = 0.0
    edges = [*np.searchsorted(time, starts[:-1]).tolist(), time.size]
    for (first, last), start, move, one in zip(
        pairwise(edges), starts[:-1], moves, profiles, strict=True
    ):
        way[first:last] = place + np.sign(move.length) * covered(one, time[first:last] - start)
        place += move.length
    return smoothed(way, frequency)


def covered(profile: Profile, time: Floats) -> Floats:
    """Way of a profile [mm] at times (T,), also after its end."""
    inside = time < profile.duration
    way: Floats = np.full(time.size, profile.length)
    way[inside] = profile.at(time[inside])[0]
    return way


def smoothed(way: Floats, frequency: int) -> Floats:
    """Mean over the last moments, twice; before the beginning it stood at ``way[0]``.

    The sums are of ways from the first one, so that large coordinates cost no digits.
    """
    result = way - way[0]
    for length in BELL:
        window = max(round(length * frequency), 1)
        total = np.cumsum(result)
        total[window:] -= total[:-window].copy()
        result = total / window
    ended: Floats = result + way[0]
    return ended


def reciprocation(speeds: Sequence[float], rapid: float, limits: Limits, lead: float) -> list[Move]:
    """Back and forth at each speed and at rapid, from both ends of the range, then reversals.

    Plateaus last 1 s at creep and 0.36 s at least.  The other end is no whole number of turns of
    the screw (``lead`` [mm]) away.  Speeds that are not below ``rapid`` [mm/s] are left out.
    """
    strokes = [
        (speed, _stroke(speed, limits)) for speed in (*(v for v in speeds if v < rapid), rapid)
    ]
    moves = [Move(length=way * s, speed=v) for v, s in strokes for way in (1, -1)]
    turns = np.floor(strokes[-1][1] / lead) + 0.37
    moves.append(Move(length=float(turns * lead), speed=rapid))
    moves += [Move(length=way * s, speed=v) for v, s in strokes for way in (-1, 1)]
    return moves + quick(6, -40.0, rapid)


def _stroke(speed: float, limits: Limits) -> float:
    """Length [mm] of a way with a plateau at ``speed`` [mm/s]."""
    bends = change_time(np.zeros(1), np.array([speed]), limits.acceleration, limits.jerk)[0]
    return speed * (min(max(6.0 / speed, 0.36), 1.0) + float(bends))


def quick(count: int, length: float, speed: float) -> list[Move]:
    """Short strokes, one directly after the other."""
    return [Move(length=(-1) ** k * length, speed=speed, pause=0.02) for k in range(2 * count)]


def circles(
    diameter: float, feeds: Sequence[float], turns: float, limits: Limits, frequency: int
) -> tuple[Floats, Floats]:
    """X and Y [mm] on a circle about 0, at each of ``feeds`` [mm/s] there and back."""
    radius = diameter / 2
    length = turns * pi * diameter
    moves = [Move(length=s * length, speed=v, pause=0.5) for v in feeds for s in (1, -1)]
    angle = travel(moves, limits, frequency) / radius
    return radius * np.cos(angle), radius * np.sin(angle)
