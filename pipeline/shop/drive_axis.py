"""From an axis' catalogue values to a run of it: constants in SI, chance, what comes out."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.shop.drive_parameters import Axis
from pipeline.shop.s_curve import Floats
from pipeline.shop.servo_parameters import INTEGRATION

if TYPE_CHECKING:
    from pipeline.shop.drive_motion import Loops, Mechanics

RIPPLE_PERIOD = 6
"""Of the torque ripple in each electrical period of the motor."""


@dataclass(frozen=True, kw_only=True)
class Followed:
    """An axis at the ticks of its position loop; arrays of shape (T,) in SI.

    Parameters
    ----------
    measured : (T,) array
        Position that closes the loop [m].
    current : (T,) array
        That makes torque [A].
    motor, motor_speed, carriage, speed : (T,) arrays
        True positions [m] and speeds [m/s]; the motor's by the screw's lead.
    friction, bristle, force : (T,) arrays
        Of the guideways [N], deflection before sliding [m], of the motor [N].
    """

    measured: Floats
    current: Floats
    motor: Floats
    motor_speed: Floats
    carriage: Floats
    speed: Floats
    friction: Floats
    bristle: Floats
    force: Floats


def follow(
    axis: Axis, reference: Floats, random: np.random.Generator, load: Floats | None = None,
    extra: Floats | None = None,
) -> Followed:  # fmt: skip
    """Let an axis follow its commands, from standstill.

    Parameters
    ----------
    axis : Axis
        Screw, guideways, motor and loops.
    reference : (T,) array
        Commanded positions at the ticks of the position loop [m].
    random : Generator
        Of the current's noise.
    load, extra : (T,) arrays or None
        Force against positive motion [N], mass on the carriage [kg]; none by default.
    """
    from pipeline.shop.drive_motion import followed

    nothing: Floats = np.zeros(reference.size)
    ticks = axis.cascade.velocity_frequency // axis.cascade.position_frequency
    noise = random.standard_normal(reference.size * ticks) * axis.motor.current_noise
    out = followed(
        _mechanics(axis), _loops(axis), reference, nothing if load is None else load,
        nothing if extra is None else extra, noise,
    )  # fmt: skip
    return Followed(**dict(zip(Followed.__dataclass_fields__, out.T, strict=True)))


def _mechanics(axis: Axis) -> "Mechanics":
    from pipeline.shop.drive_motion import Mechanics

    f, motor = axis.friction, axis.motor
    return Mechanics(
        step=1 / INTEGRATION, frequency=float(INTEGRATION), motor_mass=axis.motor_mass,
        carriage=axis.carriage, stiffness=axis.stiffness * 1e6, damping=axis.damping * 1e3,
        half_backlash=axis.backlash * 1e-6 / 2, motor_viscous=axis.motor_viscous * axis.gear**2,
        weight=axis.weight, gear=axis.gear, force_constant=axis.force_constant,
        cogging=motor.cogging * axis.gear, cogging_period=float(motor.cogging_period),
        ripple=motor.torque_ripple, ripple_period=float(RIPPLE_PERIOD * motor.pole_pairs),
        coulomb=(f.coulomb_negative, f.coulomb_positive),
        dip=(f.static_negative - f.coulomb_negative, f.static_positive - f.coulomb_positive),
        stribeck=(f.stribeck_velocity_negative * 1e-3, f.stribeck_velocity_positive * 1e-3),
        viscous=(f.viscous_negative, f.viscous_positive), bristle=f.bristle_stiffness * 1e6,
        bristle_damping=f.bristle_damping * 1e3, pitch_ripple=f.pitch_ripple,
    )  # fmt: skip


def _loops(axis: Axis) -> "Loops":
    from pipeline.shop.drive_motion import Loops

    c = axis.cascade
    period = 1 / c.velocity_frequency
    return Loops(
        position_period=1 / c.position_frequency, velocity_period=period,
        velocity_ticks=c.velocity_frequency // c.position_frequency,
        steps=INTEGRATION // c.velocity_frequency,
        position_gain=c.position_scale * c.position_gain,
        velocity_gain=c.velocity_scale * c.velocity_gain,
        integral_gain=c.integral_scale * c.integral_gain,
        velocity_feedforward=c.velocity_feedforward,
        acceleration_feedforward=c.acceleration_feedforward, limit=c.current_limit,
        at_motor=c.feedback == "motor", scale_step=c.scale_step * 1e-6,
        encoder_step=axis.lead * 1e-3 / c.steps_per_turn,
        filter_share=float(-np.expm1(-period * 1e3 / c.velocity_filter)),
        current_share=float(-np.expm1(-1e3 / INTEGRATION / axis.motor.current_lag)),
    )  # fmt: skip


def truth(axis: Axis) -> dict[str, float]:
    """What a model of one mass with Stribeck's friction should find, in SI.

    Friction is the steady state of LuGre's equation; the bearings of motor and screw count to it.
    Where a scale at the carriage closes the loop the motor is ahead of it by the screw's twist
    k A / K: of the velocity loop's gains a carriage shows S / (1 + S_vi V_i k / K).
    """
    f, c = axis.friction, axis.cascade
    ahead = c.integral_scale * c.integral_gain * axis.force_constant / (axis.stiffness * 1e6)
    shown = 1.0 if c.feedback == "motor" else 1 / (1 + ahead)
    bearings = axis.motor_viscous * axis.gear**2
    sides = ("positive", "negative")
    return {
        "mass": axis.carriage + axis.motor_mass,
        **{f"coulomb_{s}": getattr(f, f"coulomb_{s}") for s in sides},
        **{f"static_{s}": getattr(f, f"static_{s}") for s in sides},
        **{f"stribeck_velocity_{s}": getattr(f, f"stribeck_velocity_{s}") * 1e-3 for s in sides},
        **{f"viscous_{s}": getattr(f, f"viscous_{s}") + bearings for s in sides},
        "offset": axis.weight,
        "backlash": axis.backlash * 1e-6,
        "force_constant": axis.force_constant,
        "position_scale": c.position_scale,
        "velocity_scale": shown * c.velocity_scale,
        "integral_scale": shown * c.integral_scale,
        "velocity_feedforward": c.velocity_feedforward,
        "acceleration_feedforward": c.acceleration_feedforward,
    }


def hidden(axis: Axis) -> dict[str, float]:
    """What no model of one mass has, in SI; and what the records show in place of the truth.

    Motion shows only sums of Coulomb friction and a force that is always there: who takes friction
    as alike both ways finds ``coulomb_if_equal`` and ``offset_if_equal``.
    """
    f = axis.friction
    return {
        "coulomb_if_equal": (f.coulomb_positive + f.coulomb_negative) / 2,
        "offset_if_equal": axis.weight + (f.coulomb_positive - f.coulomb_negative) / 2,
        "carriage": axis.carriage,
        "motor_mass": axis.motor_mass,
        "stiffness": axis.stiffness * 1e6,
        "bristle_stiffness": f.bristle_stiffness * 1e6,
        "bristle_damping": f.bristle_damping * 1e3,
        "motor_viscous": axis.motor_viscous * axis.gear**2,
        "cogging": axis.motor.cogging * axis.gear,
        "loop_gain": axis.cascade.position_scale * axis.cascade.position_gain,
        "velocity_scale_at_motor": axis.cascade.velocity_scale,
        "integral_scale_at_motor": axis.cascade.integral_scale,
    }
