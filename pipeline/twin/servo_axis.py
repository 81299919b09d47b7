"""A feed axis put together from catalogue parts, for comparisons where no machine is at hand.

Motor: 2 kW, 3000 rev/min, 6.36 N m, at most 19.1 N m, 0.544 N m/A (of an effective ampere),
3.19e-4 kg m^2, inertia time constant 0.62 ms, inductive time constant 8.3 ms (Yaskawa Sigma-II
User's Manual, section 8.1.4, SGMSH-20A).  From them phi_f = k_t / (sqrt(2) 3/2 p),
R = tau_m 3/2 (p phi_f)^2 / J and L = tau_e R, with p = 4, which the manual does not name.
Inverter on 200 V mains, rectified.  Screw of 40 mm and 0.97 m with a lead of 10 mm, table of
300 kg: 0.0030 kg m^2 about the motor in all, as Feed2025 has it.  Stiffnesses are those of a
bellows coupling, of the screw's core (34 mm) in torsion, and of a preloaded nut with bearings at
both ends; damping of the twist gives 3 % of critical at the resonance of 247 Hz.
"""

from math import inf, pi, sqrt

from pipeline.machine.current_loop import CurrentLoopParameters
from pipeline.machine.friction import DirectionFriction, FrictionParameters
from pipeline.machine.motor import MotorParameters
from pipeline.machine.position_loop import PositionLoopParameters
from pipeline.machine.speed_loop import SpeedLoopParameters
from pipeline.machine.svpwm import InverterParameters
from pipeline.machine.two_mass import TransmissionParameters
from pipeline.twin.three_loop_parameters import ThreeLoopParameters


def servo_motor() -> MotorParameters:
    """Return the motor, from the figures of its catalogue.

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
    """Return the axis with the speed loop's gains at the middle of Feed2025's ranges.

    Parameters
    ----------
    rigid : bool
        Whether motor and load are one mass.
    """
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
