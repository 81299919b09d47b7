"""Recordings of milling, simulated step by step in time with the surface that each tooth leaves.

The tool vibrates in its modes; each tooth cuts what the surface before it left, and nothing where
it is out of the material, which limits the vibration of chatter (Tlusty, Ismail 1981; Schmitz,
Smith 2019, ch. 4).  Nothing of it is shared with what is tested: the chip is followed on a grid of
angles, the modes are stepped exactly under a force that is held over the step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, exp, pi, sin, sqrt

import numpy as np
from numba import njit
from scipy.signal import butter, sosfiltfilt

from pipeline.cutting.stability.semi_discretisation import RegenerativeCut
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.schema.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """Recorded channels at a fixed rate [Hz], each of shape (T,), in SI."""

    rate: float
    displacement: Floats
    acceleration: Floats
    force: Floats
    """Force on the tool along x [N]."""


@njit(cache=True)
def _stepped(  # type: ignore[no-untyped-def]
    step, axis, weight, flutes, per_tooth, entry, exit, feed, depth, K_t, K_r, runout, engaged,
    noise,
):  # fmt: skip
    """Displacement (T, 2), acceleration (T, 2) and force (T, 2) of the tip."""
    total, turn = engaged.size, flutes * per_tooth
    q, v = np.zeros(axis.size), np.zeros(axis.size)
    surface = np.zeros(turn)
    place, pull, pushed = np.zeros((total, 2)), np.zeros((total, 2)), np.zeros((total, 2))
    f = np.zeros(2)
    x = np.zeros(2)
    for k in range(total):
        x[:] = 0.0
        for j in range(axis.size):
            x[axis[j]] += q[j]
        f[:] = 0.0
        for tooth in range(flutes):
            at = (k + tooth * per_tooth) % turn
            phi = 2 * pi * at / turn
            if phi < entry or phi >= exit:
                continue
            s, c = np.sin(phi), np.cos(phi)
            stands = x[0] * s + x[1] * c + runout[tooth]
            h = feed * s + stands - surface[at]
            if h <= 0.0 or not engaged[k]:
                surface[at] -= feed * s  # left for the next tooth, which comes a feed later
                if not engaged[k]:
                    surface[at] = stands
                continue
            surface[at] = stands
            b = depth * (1.0 + noise[k])
            f[0] -= b * (K_t * c + K_r * s) * h
            f[1] += b * (K_t * s - K_r * c) * h
        place[k], pushed[k] = x, f
        for j in range(axis.size):
            a, force = weight[j], f[axis[j]]
            pull[k, axis[j]] += force * a[2] - a[1] * v[j] - a[0] * q[j]
            new = step[j, 0] * q[j] + step[j, 1] * v[j] + step[j, 4] * force
            v[j] = step[j, 2] * q[j] + step[j, 3] * v[j] + step[j, 5] * force
            q[j] = new
    return place, pull, pushed


def recording(
    modes: Sequence[Mode], cut: RegenerativeCut, n: float, depth: float, *, seconds: float,
    random: np.random.Generator, feed: float = 8e-5, runout: float = 8e-6, rate: float = 10240.0,
    roughness: float = 0.03, in_cut: tuple[float, float] = (0.0, np.inf),
) -> Simulated:  # fmt: skip
    """Recording of a straight cut at ``n`` [1/s]; the tool is in the material while ``in_cut`` [s].

    ``runout``: standard deviation of the teeth's radii [m]; ``roughness``: that of the specific
    force about its mean [1].
    """
    fastest = max(mode.natural_frequency_Hz for mode in modes)
    per_tooth = max(64, int(np.ceil(40 * fastest / (n * cut.flutes))))
    dt = 1.0 / (n * cut.flutes * per_tooth)
    time = np.arange(int(seconds / dt)) * dt
    white = random.standard_normal(time.size)
    keep = exp(-dt / 2e-4)
    noise = np.empty(time.size)
    noise = _lagged(white * roughness * sqrt(1 - keep**2), keep)
    engaged = (time >= in_cut[0]) & (time < in_cut[1])
    step = np.array([_held(mode, dt) for mode in modes])
    weight = np.array([[m.omega**2, 2 * m.damping * m.omega, 1 / m.mass] for m in modes])
    place, pull, pushed = _stepped(
        step, np.array([m.axis for m in modes]), weight, cut.flutes, per_tooth, cut.entry, cut.exit,
        feed, depth, cut.K_tc, cut.K_rc, random.normal(0.0, runout, cut.flutes), engaged, noise,
    )  # fmt: skip
    low_pass = butter(8, 0.4 * rate * 2 * dt, output="sos")
    at = np.arange(int(time[-1] * rate)) / rate
    every = [np.interp(at, time, sosfiltfilt(low_pass, one[:, 0])) for one in (place, pull, pushed)]
    return Simulated(rate=rate, displacement=every[0], acceleration=every[1], force=every[2])


@njit(cache=True)
def _lagged(white, keep):  # type: ignore[no-untyped-def]
    out = np.empty(white.size)
    last = 0.0
    for k in range(white.size):
        last = keep * last + white[k]
        out[k] = last
    return out


def _held(mode: Mode, dt: float) -> list[float]:
    """Exact step of one mode under a constant force: q, v from q, v and force."""
    decay, w = mode.damping * mode.omega, mode.omega * sqrt(1 - mode.damping**2)
    e, c, s = exp(-decay * dt), cos(w * dt), sin(w * dt)
    a, b = e * (c + decay / w * s), e * s / w
    d = e * (c - decay / w * s)
    k = mode.mass * mode.omega**2
    return [a, b, -(mode.omega**2) * b, d, (1 - a) / k, mode.omega**2 * b / k]
