"""A feed axis with a real servo that shares nothing with the twin, and what its recorder writes.

Position loop at 1 kHz that holds its output, velocity loop (PI) faster, on differenced counts of
the encoder, averaged over a few; the command waits whole samples of it and the current follows with
a lag.  Motor and carriage are two masses on a spring, LuGre friction on the carriage, cogging at
the motor.  The recorder takes reference, position and actual current at the tick of the position
loop, rounds both and adds noise to the current.
"""

from dataclasses import dataclass
from math import exp, floor, pi, sin

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.submodels.drive.records import AxisConstants, AxisRecord, Recording

Floats = NDArray[np.float64]
PERIOD = 1e-3


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Truth, in SI."""

    position_gain: float = 60.0
    velocity_gain: float = 450.0
    integral_gain: float = 18e3
    velocity_feedforward: float = 0.0
    acceleration_feedforward: float = 0.0
    limit: float = 60.0
    servo_rate: int = 4  # velocity loops in a position loop
    delay: int = 1  # velocity loops until a command is applied
    average: int = 1  # differences of the encoder
    lag: float = 3e-4
    force_constant: float = 100.0
    motor: float = 90.0
    carriage: float = 60.0
    stiffness: float = 1e8
    damping: float = 3e3
    coulomb: float = 150.0
    static: float = 190.0
    stribeck_velocity: float = 0.004
    viscous: float = 300.0
    motor_viscous: float = 80.0
    bristle: float = 1e7
    cogging: float = 4.0
    pitch: float = 0.01
    step_seen: float = 2e-8
    step_written: float = 1e-7
    noise: float = 0.05
    current_step: float = 0.01
    scale: bool = False  # the position loop sees the carriage, the velocity loop the motor

    @property
    def feed_drive(self) -> FeedDriveParameters:
        """What a model of one mass has of it."""
        way = DirectionFriction(
            coulomb=self.coulomb, static=self.static, stribeck_velocity=self.stribeck_velocity,
            viscous=self.viscous + self.motor_viscous,
        )  # fmt: skip
        return FeedDriveParameters(
            mass=self.motor + self.carriage, force_constant=self.force_constant,
            friction=FrictionParameters(positive=way, negative=way),
        )  # fmt: skip


@njit(cache=True)
def _run(reference, feed, ahead, load, p, rates, turn, position, current):  # pragma: no cover
    (kp, kv, ki, ffv, ffa, limit, lag, kf, mm, mc, K, C, fc, fs, vs, mu, mum, s0, cog, pitch,
     seen) = p  # fmt: skip
    rate, delay, average, mech, scale = rates
    hv = 1e-3 / rate
    h = hv / mech
    xm = xc = reference[0]
    vm = vc = z = A = summed = 0.0
    queue, differences = np.zeros(delay + 1), np.zeros(average)
    before = floor(xm / seen + 0.5) * seen
    count = 0
    for i in range(len(reference)):
        position[i] = xc if scale else xm
        current[i] = A
        v_ref = kp * (reference[i] - floor(position[i] / seen + 0.5) * seen) + ffv * feed[i]
        for _ in range(rate):
            now = floor(xm / seen + 0.5) * seen
            differences[count % average] = (now - before) / hv
            before = now
            error = v_ref - differences.mean()
            u = kv * error + ki * summed + ffa * ahead[i]
            if not ((u > limit and error > 0) or (u < -limit and error < 0)):
                summed += error * hv
            queue[count % (delay + 1)] = min(max(u, -limit), limit)
            count += 1
            target = queue[count % (delay + 1)]
            for _ in range(mech):
                A += (1 - exp(-h / lag)) * (target - A)
                spring = K * (xm - xc) + C * (vm - vc)
                dip = exp(-((vc / vs) ** 2))
                g = fc + (fs - fc) * dip
                bent = (z + h * vc) / (1 + h * s0 * abs(vc) / g)
                friction = s0 * bent + 2e3 * (bent - z) / h * dip + mu * vc
                z = bent
                vm += h / mm * (kf * A + cog * sin(8 * pi * xm / pitch + turn) - spring - mum * vm)
                vc += h / mc * (spring - friction - load[i])
                xm += h * vm
                xc += h * vc


def recorded(
    rig: Rig, reference: Floats, seed: int, load: Floats | None = None
) -> tuple[Floats, Floats]:
    """Position [m] and current [A] as the recorder writes them; shape (T,) each."""
    rng = np.random.default_rng(seed)
    feed = np.gradient(reference, PERIOD)
    p = (rig.position_gain, rig.velocity_gain, rig.integral_gain, rig.velocity_feedforward,
         rig.acceleration_feedforward, rig.limit, rig.lag, rig.force_constant, rig.motor,
         rig.carriage, rig.stiffness, rig.damping, rig.coulomb, rig.static, rig.stribeck_velocity,
         rig.viscous, rig.motor_viscous, rig.bristle, rig.cogging, rig.pitch,
         rig.step_seen)  # fmt: skip
    rates = (rig.servo_rate, rig.delay, rig.average, 32 // rig.servo_rate, int(rig.scale))
    position, current = np.empty(len(reference)), np.empty(len(reference))
    nothing = np.zeros(len(reference))
    _run(reference, feed, np.gradient(feed, PERIOD), nothing if load is None else load, p, rates,
         rng.uniform(0, 2 * pi), position, current)  # fmt: skip
    current += rig.noise * rng.standard_normal(len(current))
    return (
        np.round(position / rig.step_written) * rig.step_written,
        np.round(current / rig.current_step) * rig.current_step,
    )


def strokes(
    speeds: tuple[float, ...] = (0.002, 0.01, 0.03, 0.1, 0.25), acceleration: float = 2.5
) -> Floats:
    """Reference [m]: forth and back at each speed, acceleration smoothed; shape (T,)."""
    velocity = [np.zeros(100)]
    for speed in speeds:
        way = min(0.08, max(0.6 * speed, 1.5 * speed**2 / acceleration))
        top = min(speed, (0.9 * way * acceleration) ** 0.5)
        t = np.arange(int((way / top + top / acceleration) / PERIOD) + 2) * PERIOD
        forth = np.clip(np.minimum(t, t[-1] - t) * acceleration, 0, top)
        for sign in (1, -1):
            velocity += [sign * forth, np.zeros(120)]
    smooth = np.convolve(np.concatenate(velocity), np.ones(20) / 20, "same")
    position: Floats = np.cumsum(smooth) * PERIOD
    return position


def recording(
    rig: Rig, reference: Floats, seed: int, constants: AxisConstants, load: Floats | None = None,
    *, name: str = "strokes.csv", trained: bool = True,
) -> Recording:  # fmt: skip
    """What is read of it."""
    position, current = recorded(rig, reference, seed, load)
    return Recording(
        name=name, trained=trained, period=PERIOD, air=np.ones(len(reference), bool),
        axes={"X": AxisRecord(command=current, position=position, reference=reference,
                              constants=constants, load=load)},
    )  # fmt: skip
