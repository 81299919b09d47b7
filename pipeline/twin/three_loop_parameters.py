"""What a three-loop drive consists of, and how short the steps of its simulation must be."""

from dataclasses import dataclass
from math import ceil, isfinite, isinf

from pipeline.machine.current_loop import CurrentLoopParameters
from pipeline.machine.friction import FrictionParameters
from pipeline.machine.motor import MotorParameters
from pipeline.machine.position_loop import PositionLoopParameters
from pipeline.machine.speed_loop import SpeedLoopParameters
from pipeline.machine.svpwm import InverterParameters
from pipeline.machine.two_mass import TransmissionParameters, resonance

_LONGEST = 0.5
"""Greatest product of a step and a rate of the drive.  The classical method of order four is stable
to 2.8; at a half a free swing loses a per mille of its amplitude in three turns."""


@dataclass(frozen=True, kw_only=True)
class ThreeLoopParameters:
    """One feed axis.

    Parameters
    ----------
    motor : MotorParameters
        Synchronous motor.
    inverter : InverterParameters
        What feeds it.
    transmission : TransmissionParameters
        From the motor's shaft to the carriage.
    friction : FrictionParameters
        Of the guideway, at the carriage.
    current_loop : CurrentLoopParameters
        Innermost loops, whose period is the clock of all.
    speed_loop : SpeedLoopParameters
        PI or fuzzy PI.
    position_loop : PositionLoopParameters, optional
        Outermost loop; it may be left out where only speeds are followed.
    """

    motor: MotorParameters
    inverter: InverterParameters
    transmission: TransmissionParameters
    friction: FrictionParameters
    current_loop: CurrentLoopParameters
    speed_loop: SpeedLoopParameters
    position_loop: PositionLoopParameters | None = None


def check_steps(drive: ThreeLoopParameters, steps: int) -> None:
    """Refuse steps that are too long for the drive's windings or its shaft.

    Parameters
    ----------
    drive : ThreeLoopParameters
        The axis.
    steps : int
        Steps in one period of the current loops.

    Raises
    ------
    ValueError
        When ``steps`` is no count or too few; the message says how many are needed.
    """
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
    """Fastest rates [1/s] of the drive's own motion, by what they belong to."""
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
