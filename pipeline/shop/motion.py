"""Motion along a path at limited speed, acceleration and jerk, slew rates and first-order lags.

A profile has seven phases of constant jerk and is exact.  A stretch goes from one speed to another,
without acceleration at either end.  A change of speed of dv takes dv/a + a/j, or 2 √(dv/j) when it
ends before the acceleration a is reached; as it is symmetric about its middle, its mean speed is
the mean of both ends.  Lengths in mm, times in s.  Slew rates and lags run in numba.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats

HALVINGS = 60
"""Bisections of an interval of speeds: down to the rounding of a float."""
_JERK = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])


def change_time(v_0: Floats, v_1: Floats, a: float, j: float) -> Floats:
    """Time to go from one speed to another [s], shape as the speeds'."""
    dv = np.abs(v_1 - v_0)
    return np.where(dv >= a * a / j, dv / a + a / j, 2 * np.sqrt(dv / j))


def change_distance(v_0: Floats, v_1: Floats, a: float, j: float) -> Floats:
    """Distance over which the speed changes from one to another [mm]."""
    return (v_0 + v_1) / 2 * change_time(v_0, v_1, a, j)


def peak_speed(v_0: Floats, v_1: Floats, length: Floats, cap: Floats, a: float, j: float) -> Floats:
    """Greatest speed up to ``cap`` from which ``v_1`` is reached at the end, shape (N,)."""
    low, high = np.maximum(v_0, v_1), np.array(cap, dtype=float)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        needed = change_distance(v_0, middle, a, j) + change_distance(middle, v_1, a, j)
        fits = needed <= length
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    needed = change_distance(v_0, cap, a, j) + change_distance(cap, v_1, a, j)
    return np.where(needed <= length, cap, low)


def reachable_speed(v: Floats, length: Floats, cap: Floats, a: float, j: float) -> Floats:
    """Greatest speed up to ``cap`` that is reached from ``v`` within ``length``, shape (N,)."""
    low, high = np.minimum(v, cap), np.array(cap, dtype=float)
    fits = change_distance(v, high, a, j) <= length
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        short = change_distance(v, middle, a, j) <= length
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.where(fits, cap, low)


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Phases of constant jerk, one after another; arrays of shape (7 N,) at their beginnings."""

    time: Floats
    distance: Floats
    speed: Floats
    acceleration: Floats
    jerk: Floats
    """[s], [mm], [mm/s], [mm/s2], [mm/s3]; the jerk until the next phase."""
    duration: float
    length: float
    """Duration [s] and length [mm] of all phases."""

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Distance [mm] and speed [mm/s] at ``time`` (T,), which lies within the profile."""
        k = np.maximum(np.searchsorted(self.time, time, side="right") - 1, 0)
        t, v, a, j = time - self.time[k], self.speed[k], self.acceleration[k], self.jerk[k]
        return self.distance[k] + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2)

    def covered(self, time: Floats) -> Floats:
        """Distance [mm] at ``time`` (T,), also after the end."""
        inside = time < self.duration
        distance: Floats = np.full(time.size, self.length)
        distance[inside] = self.at(time[inside])[0]
        return distance

    def lag(self, gain: float) -> float:
        """Following error of a drive of position gain ``gain`` [1/s] at the end [mm].

        e' = v - gain e, solved exactly in each phase; behind by v/gain when it begins.
        """
        error, last = self.speed[0] / gain, np.append(self.time[1:], self.duration)
        for t, v, a, j in zip(
            last - self.time, self.speed, self.acceleration, self.jerk, strict=True
        ):
            v_1, a_1 = v + t * (a + t * j / 2), a + t * j
            steady, steady_1 = (
                u / gain - b / gain**2 + j / gain**3 for u, b in ((v, a), (v_1, a_1))
            )
            error = steady_1 + (error - steady) * np.exp(-gain * t)
        return float(error)


def profile(nodes: Floats, lengths: Floats, caps: Floats, a: float, j: float) -> Profile:
    """Profile through stretches of ``lengths`` (N,) with speeds ``nodes`` (N + 1,) between them.

    No faster than ``caps`` (N,); each stretch must be long enough for the change between its nodes.
    """
    v_0, v_1 = nodes[:-1], nodes[1:]
    peak = peak_speed(v_0, v_1, lengths, caps, a, j)
    rise, fall = (_ramp(peak - v, a, j) for v in (v_0, v_1))
    needed = change_distance(v_0, peak, a, j) + change_distance(peak, v_1, a, j)
    cruise = np.maximum(lengths - needed, 0) / peak
    duration = np.stack([*rise, cruise, *fall], axis=1)
    jerk = np.broadcast_to(j * _JERK, duration.shape)
    acceleration, speed, distance = _integrated(duration, jerk, v_0)
    start = np.concatenate([[0.0], np.cumsum(duration)])
    distance += np.concatenate([[0.0], np.cumsum(lengths)[:-1]])[:, None]
    return Profile(
        time=start[:-1], distance=distance.ravel(), speed=speed.ravel(),
        acceleration=acceleration.ravel(), jerk=jerk.ravel(), duration=float(start[-1]),
        length=float(lengths.sum()),
    )  # fmt: skip


@lru_cache(maxsize=4096)
def rest_to_rest(length: float, cap: float, a: float, j: float) -> Profile:
    """Profile of one distance from standstill to standstill."""
    return profile(np.zeros(2), np.array([length]), np.array([cap]), a, j)


def _ramp(dv: Floats, a: float, j: float) -> tuple[Floats, Floats, Floats]:
    """Times of the three phases of a change of speed."""
    full = dv >= a * a / j
    bend = np.where(full, a / j, np.sqrt(np.maximum(dv, 0) / j))
    return bend, np.where(full, dv / a - a / j, 0.0), bend


def _integrated(duration: Floats, jerk: Floats, v_0: Floats) -> tuple[Floats, Floats, Floats]:
    """Acceleration, speed and distance at the beginning of each phase, shape (N, 7)."""
    acceleration, speed, distance = (np.zeros(duration.shape) for _ in range(3))
    speed[:, 0] = v_0
    for k in range(6):
        t, a, v, j = duration[:, k], acceleration[:, k], speed[:, k], jerk[:, k]
        acceleration[:, k + 1] = a + t * j
        speed[:, k + 1] = v + t * (a + t * j / 2)
        distance[:, k + 1] = distance[:, k] + t * (v + t * (a / 2 + t * j / 6))
    return acceleration, speed, distance


@compiled_with()
def slewed(command: np.ndarray, acceleration: float) -> np.ndarray:
    """Speed that follows ``command`` (T,) by at most ``acceleration`` each second, from rest."""
    out = np.empty(command.size)
    now = 0.0
    for i in range(command.size):
        now += min(max(command[i] - now, -acceleration), acceleration)
        out[i] = now
    return out


@compiled_with()
def lagged(x: np.ndarray, share: float, start: float) -> np.ndarray:
    """First-order lag of ``x`` (T,): each step closes ``share`` [1] of the distance."""
    out = np.empty(x.size)
    now = start
    for i in range(x.size):
        now += share * (x[i] - now)
        out[i] = now
    return out
