"""The parameters of a three-loop drive as its compiled loops take them."""

from math import isinf

from pipeline.machine.cascade import Loops
from pipeline.machine.drive_train import Direction, Shafts, Winding
from pipeline.machine.friction import DirectionFriction
from pipeline.machine.fuzzy_pi import FuzzyParameters
from pipeline.machine.motor import MotorParameters
from pipeline.machine.position_loop import PositionLoopParameters
from pipeline.twin.three_loop_parameters import ThreeLoopParameters

_NO_RULES = FuzzyParameters(error_scale=0.0, change_scale=0.0)
_OPEN = PositionLoopParameters(gain=1.0)


def winding(motor: MotorParameters) -> Winding:
    """Return what the currents depend on."""
    return Winding(
        resistance=float(motor.resistance),
        inductance_d=float(motor.inductance_d),
        inductance_q=float(motor.inductance_q),
        flux=float(motor.flux),
        pole_pairs=float(motor.pole_pairs),
    )


def shafts(drive: ThreeLoopParameters) -> Shafts:
    """Return what the speeds depend on; the guideway's friction about the screw."""
    motor, transmission, r = drive.motor, drive.transmission, drive.transmission.ratio
    rigid = isinf(transmission.stiffness)
    return Shafts(
        motor_inertia=float(motor.inertia),
        motor_damping=float(motor.damping),
        motor_coulomb=float(motor.coulomb),
        load_inertia=float(transmission.load_inertia),
        load_damping=float(transmission.load_damping),
        stiffness=0.0 if rigid else float(transmission.stiffness),
        internal_damping=float(transmission.internal_damping),
        rigid=rigid,
        positive=_about_screw(drive.friction.positive, r),
        negative=_about_screw(drive.friction.negative, r),
    )


def _about_screw(friction: DirectionFriction, ratio: float) -> Direction:
    return Direction(
        coulomb=friction.coulomb * ratio,
        static=friction.static * ratio,
        stribeck=friction.stribeck_velocity / ratio,
        viscous=friction.viscous * ratio**2,
    )


def loops(drive: ThreeLoopParameters, steps: int, position: bool) -> Loops:
    """Return what the loops are set to; ``position`` says whether positions are followed."""
    motor, current, speed = drive.motor, drive.current_loop, drive.speed_loop
    outer, fuzzy = drive.position_loop or _OPEN, speed.fuzzy or _NO_RULES
    gain_d, integral_d = current.gains(motor.resistance, motor.inductance_d)
    gain_q, integral_q = current.gains(motor.resistance, motor.inductance_q)
    return Loops(
        period=float(current.period),
        steps=int(steps),
        gain_d=gain_d,
        integral_d=integral_d,
        gain_q=gain_q,
        integral_q=integral_q,
        torque_constant=float(motor.torque_constant),
        torque_limit=float(speed.torque_limit),
        proportional=float(speed.proportional),
        integral=float(speed.integral),
        fuzzy=speed.fuzzy is not None,
        error_scale=float(fuzzy.error_scale),
        change_scale=float(fuzzy.change_scale),
        proportional_span=float(fuzzy.proportional_span),
        integral_span=float(fuzzy.integral_span),
        speed_every=int(speed.every),
        position=position,
        gain=float(outer.gain),
        feedforward=float(outer.velocity_feedforward),
        motor_encoder=bool(outer.motor_encoder),
        position_every=int(outer.every),
        ratio=float(drive.transmission.ratio),
        dc_link=float(drive.inverter.dc_link),
        switched=bool(drive.inverter.switched),
        overmodulation=bool(drive.inverter.overmodulation),
    )
