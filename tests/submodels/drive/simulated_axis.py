"""A feed axis that shares nothing with the twin: two masses, LuGre friction, cogging, a real servo.

The motor (with its encoder) drives the carriage through a spring; friction of LuGre acts on the
carriage (Canudas de Wit 1995), its bristles stepped exactly; cogging goes with the motor's angle.
Position loop at 1 kHz, velocity loop (PI) at 4 kHz on differenced encoder counts, the current
follows with a lag; the recorder gives position and mean current of each millisecond, quantised and
noisy.
"""

from dataclasses import dataclass, field
from functools import partial
from math import exp, floor, pi, sin

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.schema.drive import DirectionFriction
from pipeline.submodels.drive.records import AxisConstants, AxisRecord, Recording

Floats = NDArray[np.float64]
STEP = 5e-5
"""Of the mechanics [s]."""


Way = partial(DirectionFriction, coulomb=60.0, static=90.0, stribeck_velocity=0.004, viscous=300.0)


@dataclass(frozen=True, kw_only=True)
class SimulatedAxis:
    """Truth of one axis, in SI."""

    motor_mass: float = 60.0
    carriage_mass: float = 90.0
    stiffness: float = 4e7
    damping: float = 4e3
    bristle: float = 6e6
    bristle_damping: float = 2e3
    positive: DirectionFriction = field(default_factory=Way)
    negative: DirectionFriction = field(
        default_factory=lambda: Way(coulomb=55.0, static=80.0, viscous=340.0)
    )
    offset: float = 0.0
    cogging: float = 4.0
    lead: float = 0.01
    force_constant: float = 120.0
    position_gain: float = 60.0
    velocity_gain: float = 200.0
    integral_gain: float = 6000.0
    lag: float = 4e-4
    step_mm: float = 2e-4
    current_noise: float = 0.03

    @property
    def mass(self) -> float:
        """All that moves [kg]."""
        return self.motor_mass + self.carriage_mass


@njit(cache=True)
def _run(reference, load, p, ways, q, position, current, kick):  # pragma: no cover
    m1, m2, k, c, s0, s1, offset, cogging, lead, kf, pg, vg, ig, lag = p
    x1 = x2 = reference[0]
    v1 = v2 = z = i = integral = wanted = 0.0
    i = integral = offset / kf
    counts = round(x1 / q)
    inner = 5  # mechanics in one sample of the velocity loop
    speed = 0.0
    for n in range(len(reference)):
        position[n] = round(x1 / q) * q
        mean = 0.0
        v_ref = pg * (reference[n] - round(x1 / q) * q)
        for _ in range(4):
            now = round(x1 / q)
            speed += 0.5 * ((now - counts) * q / 2.5e-4 - speed)
            counts = now
            error = v_ref - speed
            integral += ig * error * 2.5e-4
            wanted = vg * error + integral
            for _ in range(inner):
                i += (wanted - i) * STEP / lag
                mean += i / (4 * inner)
                way = ways[0] if v2 >= 0 else ways[1]
                g = way[0] + (way[1] - way[0]) * exp(-((v2 / way[2]) ** 2))
                sign = 1.0 if v2 >= 0 else -1.0
                new = g * sign / s0 + (z - g * sign / s0) * exp(-s0 * abs(v2) * STEP / g)
                rate = (new - z) / STEP
                z = new
                friction = s0 * z + s1 * rate + way[3] * v2
                spring = k * (x1 - x2) + c * (v1 - v2)
                ripple = cogging * (sin(2 * pi * 8 * x1 / lead) + 0.5 * sin(2 * pi * x1 / lead))
                v1 += STEP / m1 * (kf * i - spring - ripple)
                v2 += STEP / m2 * (spring - friction - offset - load[n] + kick[n])
                x1 += STEP * v1
                x2 += STEP * v2
        current[n] = mean


def simulate(
    axis: SimulatedAxis, reference: Floats, seed: int, load: Floats | None = None
) -> tuple[Floats, Floats]:
    """Recorded position [m] and current [A] at 1 kHz; shape (T,) each."""
    rng = np.random.default_rng(seed)
    a = axis
    p = (a.motor_mass, a.carriage_mass, a.stiffness, a.damping, a.bristle, a.bristle_damping,
         a.offset, a.cogging, a.lead, a.force_constant, a.position_gain, a.velocity_gain,
         a.integral_gain, a.lag)  # fmt: skip
    ways = np.array([[w.coulomb, w.static, w.stribeck_velocity, w.viscous]
                     for w in (a.positive, a.negative)])  # fmt: skip
    position, current = np.empty(len(reference)), np.empty(len(reference))
    pushed = np.zeros(len(reference)) if load is None else load
    # slow rumble of the guideway: what a friction model never explains
    kick = _rumble(rng, len(reference))
    start = rng.uniform(0, axis.lead)
    _run(reference + start, pushed, p, ways, axis.step_mm * 1e-3, position, current, kick)
    noisy = current + axis.current_noise * rng.standard_normal(len(current))
    return position, np.round(noisy / 0.01) * 0.01


def _rumble(rng: np.random.Generator, samples: int, level: float = 2.0) -> Floats:
    """Coloured force noise of standard deviation ``level`` [N], memory of 50 ms."""
    keep = exp(-1e-3 / 0.05)
    white = rng.standard_normal(samples) * level * (1 - keep**2) ** 0.5
    for n in range(1, samples):
        white[n] += keep * white[n - 1]
    return white


def reciprocation(
    speeds: Floats, acceleration: float = 3.0, jerk_time: float = 0.03, plateau: float = 0.5,
    travel: float = 0.0, period: float = 1e-3,
) -> Floats:  # fmt: skip
    """Reference position [m]: forth and back at each speed, acceleration smoothed; shape (T,).

    A speed is held for ``plateau`` [s], or as long as it takes to travel ``travel`` [m].
    """
    velocity = [np.zeros(200)]
    for speed in speeds:
        ramp = max(floor(speed / acceleration / period), 1)
        up = np.linspace(0, speed, ramp, endpoint=False)
        held = floor(max(plateau, travel / speed) / period)
        forth = np.r_[up, np.full(held, speed), up[::-1]]
        velocity += [forth, np.zeros(100), -forth, np.zeros(100)]
    kernel = np.ones(floor(jerk_time / period)) / floor(jerk_time / period)
    smooth = np.convolve(np.concatenate(velocity), kernel, "same")
    position: Floats = np.cumsum(smooth) * period
    return position


SPEEDS = np.geomspace(2e-4, 0.4, 12)
COG = 2.5e-3
"""Slow strokes travel two cogs of the simulated motor [m]."""


def recording(
    axis: SimulatedAxis, seed: int, *, speeds=SPEEDS, repeats=2, load=None, known=True,
    name="reciprocation.csv", **options,
) -> Recording:  # fmt: skip
    """Strokes forth and back at ``speeds``, every one ``repeats`` times."""
    settings = {"plateau": 0.5, "travel": COG, **options}
    reference = np.concatenate([reciprocation(speeds, **settings) for _ in range(repeats)])
    pushed = None if load is None else load(len(reference))
    position, current = simulate(axis, reference, seed, pushed)
    constants = AxisConstants(force_constant=axis.force_constant if known else None)
    record = AxisRecord(
        command=current, position=position, reference=reference + position[0],
        load=pushed, constants=constants,
    )  # fmt: skip
    return Recording(name=name, trained=True, period=1e-3, air=np.ones(len(position), bool),
                     axes={"X": record}, sha256="0" * 64)  # fmt: skip


def truth(axis: SimulatedAxis) -> dict[str, float]:
    """Parameters as the fit names them."""
    found = {"mass": axis.mass}
    for sign in ("positive", "negative"):
        way = getattr(axis, sign)
        found |= {
            f"coulomb_{sign}": way.coulomb, f"static_{sign}": way.static,
            f"stribeck_velocity_{sign}": way.stribeck_velocity, f"viscous_{sign}": way.viscous,
        }  # fmt: skip
    return found
