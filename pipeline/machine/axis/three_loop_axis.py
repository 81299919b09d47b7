"""Parameters of a three-loop drive, the step that its simulation needs, and a catalogue axis.

The catalogue axis is put together for comparisons where no machine is at hand.
Motor: 2 kW, 3000 rev/min, 6.36 N m, at most 19.1 N m, 0.544 N m/A (of an effective ampere),
3.19e-4 kg m^2, inertia time constant 0.62 ms, inductive time constant 8.3 ms (Yaskawa Sigma-II
User's Manual, section 8.1.4, SGMSH-20A).  From them phi_f = k_t / (sqrt(2) 3/2 p),
R = tau_m 3/2 (p phi_f)^2 / J and L = tau_e R, with p = 4, which the manual does not name.
Inverter on 200 V mains, rectified.  Screw of 40 mm and 0.97 m with a lead of 10 mm, table of
300 kg: 0.0030 kg m^2 about the motor in all, as Feed2025 has it.  Stiffnesses are those of a
bellows coupling, of the screw's core (34 mm) in torsion, and of a preloaded nut with bearings at
both ends; damping of the twist gives 3 % of critical at the resonance of 247 Hz.
"""

from dataclasses import dataclass
from math import ceil, inf, isfinite, isinf, pi, sqrt

from pipeline.machine.axis.drive_parameters import DirectionFriction, FrictionParameters
from pipeline.machine.axis.drive_train import TransmissionParameters, resonance
from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    PositionLoopParameters,
    SpeedLoopParameters,
)
from pipeline.machine.axis.motor import InverterParameters, MotorParameters

_LONGEST = 0.5
"""Greatest product of a step and a rate of the drive.  The classical method of order four is stable
to 2.8; at a half a free swing loses a per mille of its amplitude in three periods."""


@dataclass(frozen=True, kw_only=True)
class ThreeLoopParameters:
    """Parts of one feed axis."""

    motor: MotorParameters
    """Synchronous motor."""
    inverter: InverterParameters
    """Inverter that feeds it."""
    transmission: TransmissionParameters
    """Drive train from the motor's shaft to the carriage."""
    friction: FrictionParameters
    """Friction of the guideway, at the carriage."""
    current_loop: CurrentLoopParameters
    """Innermost loops, whose period is the clock of all."""
    speed_loop: SpeedLoopParameters
    """PI or fuzzy PI."""
    position_loop: PositionLoopParameters | None = None
    """Outermost loop; it may be left out where only speeds are followed."""


def check_steps(drive: ThreeLoopParameters, steps: int) -> None:
    """Refuse steps that are too long for the drive's windings or its shaft."""
    if not (isfinite(steps) and steps >= 1 and steps % 1 == 0):
        raise ValueError(f"steps = {steps} must be a whole number from 1")
    rates = _rates(drive)
    fastest = max(rates, key=lambda name: rates[name])
    needed = ceil(rates[fastest] * drive.current_loop.period / _LONGEST)
    if steps < needed:
        raise ValueError(
            f"steps = {steps} are too few for {fastest} of {rates[fastest]:.4g} 1/s: "
            f"take {needed} or more"
        )


def _rates(drive: ThreeLoopParameters) -> dict[str, float]:
    """Fastest rates [1/s] of the drive's own motion, by their cause."""
    motor, transmission = drive.motor, drive.transmission
    viscous = max(drive.friction.positive.viscous, drive.friction.negative.viscous)
    drag = transmission.load_damping + viscous * transmission.ratio**2
    inductance = min(motor.inductance_d, motor.inductance_q)
    rates = {"the winding's rate R / L": motor.resistance / inductance}
    if isinf(transmission.stiffness):
        inertia = motor.inertia + transmission.load_inertia
        return rates | {"the damping's rate": (motor.damping + drag) / inertia}
    twist = transmission.internal_damping * (1 / motor.inertia + 1 / transmission.load_inertia)
    return rates | {
        "the shaft's resonance": resonance(
            motor.inertia, transmission.load_inertia, transmission.stiffness
        ),
        "the damping's rate": max(
            motor.damping / motor.inertia, drag / transmission.load_inertia, twist
        ),
    }


def servo_motor() -> MotorParameters:
    """Motor, from the figures of its catalogue.

    >>> round(servo_motor().torque_constant * 12.7 * 2**0.5, 2)
    6.91
    """
    pole_pairs, inertia = 4, 3.19e-4
    flux = 0.544 / (sqrt(2) * 1.5 * pole_pairs)
    resistance = 0.62e-3 * 1.5 * (pole_pairs * flux) ** 2 / inertia
    return MotorParameters(
        resistance=resistance,
        inductance_d=8.3e-3 * resistance,
        inductance_q=8.3e-3 * resistance,
        flux=flux,
        pole_pairs=pole_pairs,
        inertia=inertia,
        damping=1e-4,
        coulomb=0.1,
    )


def servo_axis(*, rigid: bool = False) -> ThreeLoopParameters:
    """Axis with the speed loop's gains at the middle of Feed2025's ranges."""
    guideway = DirectionFriction(coulomb=150, static=220, stribeck_velocity=0.005, viscous=800)
    return ThreeLoopParameters(
        motor=servo_motor(),
        inverter=InverterParameters(dc_link=200 * sqrt(2)),
        transmission=TransmissionParameters(
            lead=0.01,
            mass=300,
            screw_inertia=1.921e-3,
            coupling_stiffness=inf if rigid else 2e4,
            screw_stiffness=inf if rigid else 1.1e4,
            axial_stiffness=inf if rigid else 3e8,
            internal_damping=0.0 if rigid else 0.03,
        ),
        friction=FrictionParameters(positive=guideway, negative=guideway),
        current_loop=CurrentLoopParameters(bandwidth=2 * pi * 500),
        speed_loop=SpeedLoopParameters(torque_limit=19.1, proportional=0.5, integral=40),
        position_loop=PositionLoopParameters(gain=40),
    )
