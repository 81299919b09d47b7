"""The cut of Insperger and Stepan, and a delayed equation integrated step by step."""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np

from pipeline.cutting.stability.directional import RegenerativeCut
from pipeline.cutting.stability.tip_dynamics import Mode

X = Mode(direction="x", natural_frequency_Hz=922.0, damping=0.011, mass_kg=0.03993)
Y = Mode(direction="y", natural_frequency_Hz=1100.0, damping=0.02, mass_kg=0.05)
SLOT = RegenerativeCut(K_tc=6e8, K_rc=2e8, flutes=2, entry=0.0, exit=pi)
DOWN = replace(SLOT, entry=pi / 2)
UP = replace(SLOT, exit=pi / 2)
TWENTIETH = replace(SLOT, entry=pi - np.arccos(0.9))
"""Down-milling, a_e / D = 0.05."""
STEADY = replace(SLOT, flutes=4)
"""A slot with four flutes: the sum over its teeth is the same at each angle."""


def growth(modes, cut, n: float, depth: float, *, periods: int = 120, steps: int = 480) -> float:
    """Factor by which vibration grows in a tooth period: Runge-Kutta of fourth order.

    The formulas of the force are written out for each tooth; the delayed displacement comes from
    the states before by Hermite's cubic.
    """
    h = 1.0 / (n * cut.flutes) / steps
    omega = np.array([mode.omega for mode in modes])
    zeta = np.array([mode.damping for mode in modes])
    mass = np.array([mode.mass for mode in modes])
    axis = np.array([mode.axis for mode in modes])

    def tip(q):
        u = np.zeros(2)
        np.add.at(u, axis, q)
        return u

    def force(phi, teeth, gap):
        total = np.zeros(2)
        for tooth in teeth:
            s, c = sin(phi + tooth * cut.pitch), cos(phi + tooth * cut.pitch)
            chip = s * gap[0] + c * gap[1]
            total[0] += depth * chip * (-cut.K_tc * c - cut.K_rc * s)
            total[1] += depth * chip * (cut.K_tc * s - cut.K_rc * c)
        return total

    def slope(q, v, phi, teeth, old):
        push = force(phi, teeth, tip(q) - old)[axis]
        return v, push / mass - 2 * zeta * omega * v - omega**2 * q

    places = np.zeros((steps + 1, 2))
    speeds = np.zeros((steps + 1, 2))
    q, v = np.full(len(modes), 1e-6), np.zeros(len(modes))
    sizes = []
    for _ in range(periods):
        new_places, new_speeds = np.empty_like(places), np.empty_like(speeds)
        new_places[0], new_speeds[0] = tip(q), tip(v)
        for i in range(steps):
            phi, step = i / steps * cut.pitch, cut.pitch / steps
            angles = [(phi + step / 2 + t * cut.pitch) for t in range(cut.flutes)]
            teeth = [t for t, a in enumerate(angles) if cut.entry < a % (2 * pi) < cut.exit]
            before, after = places[i], places[i + 1]
            middle = (before + after) / 2 + h / 8 * (speeds[i] - speeds[i + 1])
            a1, b1 = slope(q, v, phi, teeth, before)
            a2, b2 = slope(q + h / 2 * a1, v + h / 2 * b1, phi + step / 2, teeth, middle)
            a3, b3 = slope(q + h / 2 * a2, v + h / 2 * b2, phi + step / 2, teeth, middle)
            a4, b4 = slope(q + h * a3, v + h * b3, phi + step, teeth, after)
            q = q + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            v = v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
            new_places[i + 1], new_speeds[i + 1] = tip(q), tip(v)
        places, speeds = new_places, new_speeds
        sizes.append(np.sqrt(np.sum(places**2)))
    late = np.log(sizes[periods // 2 :])
    return float(np.exp(np.polyfit(np.arange(len(late)), late, 1)[0]))
