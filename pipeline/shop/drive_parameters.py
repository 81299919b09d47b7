"""The feed drives of a simulated mill: screw, carriage, guideways, motor, gains of its axes.

Typical of a vertical machining centre of 12 to 15 kW.  Sources of the orders of magnitude:

- Altintas, Verl, Brecher, Uriarte, Pritschow: *Machine tool feed drives*, CIRP Annals 60 (2011):
  ball screws of 10 to 20 mm lead, 100 to 250 N/um between motor and table, two masses.
- THK and NSK catalogues: C3 and C5 screws of 36 and 40 mm, roller guideways with wipers, friction
  of screw nut and wipers together 200 to 500 N.
- Canudas de Wit, Olsson, Åström, Lischinsky: *A new model for control of systems with friction*,
  IEEE TAC 40 (1995); Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994): Stribeck
  speeds of mm/s, presliding over some 10 um, static friction 1.2 to 1.5 times Coulomb's.
- Fanuc: *AC servo motor α series, descriptions* (B-65262EN), Siemens: *1FK7*: motors of 8 to
  22 N m, 2 to 6e-3 kg m2, 3 or 4 pole pairs.
"""

from dataclasses import dataclass, field
from math import pi

from pipeline.shop.motor_parameters import AxisMotor
from pipeline.shop.ranges import Ranged, quantity
from pipeline.shop.servo_parameters import Cascade, ServoTool

GRAVITY = 9.81
"""[m/s2]."""


@dataclass(frozen=True, kw_only=True)
class Friction(Ranged):
    """LuGre friction of guideways and nut, for motion in positive and in negative direction.

    Parameters
    ----------
    bristle_stiffness, bristle_damping : float
        How the contact gives way before it slides; the damping fades as it slides (Olsson 1996).
    pitch_ripple : float
        Share of the level by which it goes up and down once a turn of the screw.

    Raises
    ------
    ValueError
        When static friction is less than Coulomb's.
    """

    coulomb_positive: float = quantity(318.0, "N", 1, 1e4)
    coulomb_negative: float = quantity(332.0, "N", 1, 1e4)
    static_positive: float = quantity(410.0, "N", 1, 1e4)
    static_negative: float = quantity(436.0, "N", 1, 1e4)
    stribeck_velocity_positive: float = quantity(6.2, "mm/s", 0.1, 100)
    stribeck_velocity_negative: float = quantity(7.4, "mm/s", 0.1, 100)
    viscous_positive: float = quantity(860.0, "N s/m", 0, 1e5)
    viscous_negative: float = quantity(910.0, "N s/m", 0, 1e5)
    bristle_stiffness: float = quantity(30.0, "N/um", 1, 500)
    bristle_damping: float = quantity(70.0, "N s/mm", 0, 1e3)
    pitch_ripple: float = quantity(0.02, "1", 0, 0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        for way in ("positive", "negative"):
            static, coulomb = getattr(self, f"static_{way}"), getattr(self, f"coulomb_{way}")
            if static < coulomb:
                raise ValueError(
                    f"Friction.static_{way} = {static} [N] must not be below "
                    f"coulomb_{way} = {coulomb}"
                )


@dataclass(frozen=True, kw_only=True)
class Axis(Ranged):
    """One axis: a motor that turns a screw, which moves a carriage.

    Parameters
    ----------
    inertia : float
        Of rotor, coupling and screw.
    stiffness, damping : float
        Of coupling, screw, its bearings and nut, in the direction of motion.
    backlash : float
        Between screw and carriage; 0 for a preloaded nut.
    motor_viscous : float
        Of the bearings of motor and screw.
    counterbalance : float
        Share of the weight that something else carries; a vertical axis has positive up.
    """

    lead: float = quantity(16.0, "mm", 1, 100)
    inertia: float = quantity(5.2e-3, "kg m2", 1e-5, 1)
    carriage: float = quantity(520.0, "kg", 1, 1e5)
    stiffness: float = quantity(180.0, "N/um", 1, 5e3)
    damping: float = quantity(14.0, "N s/mm", 0, 1e3)
    backlash: float = quantity(0.0, "um", 0, 500)
    motor_viscous: float = quantity(1.4e-3, "N m s/rad", 0, 1)
    vertical: bool = False
    counterbalance: float = quantity(0.0, "1", 0, 1)
    friction: Friction = field(default_factory=Friction)
    motor: AxisMotor = field(default_factory=AxisMotor)
    cascade: Cascade = field(default_factory=Cascade)

    @property
    def gear(self) -> float:
        """Turn of the motor for the way of the carriage [rad/m]."""
        return 2 * pi / (self.lead * 1e-3)

    @property
    def force_constant(self) -> float:
        """Force on the carriage for each ampere [N/A]."""
        return self.motor.torque_constant * self.gear

    @property
    def motor_mass(self) -> float:
        """The inertia as mass at the carriage [kg]."""
        return self.inertia * self.gear**2

    @property
    def weight(self) -> float:
        """Force against positive motion that the drive carries all the time [N]."""
        carried = self.carriage * GRAVITY * (1 - self.counterbalance)
        return carried if self.vertical else 0.0


def _y() -> Axis:
    return Axis(
        carriage=760.0, inertia=5.4e-3, stiffness=165.0,
        friction=Friction(
            coulomb_positive=402.0, coulomb_negative=388.0, static_positive=522.0,
            static_negative=497.0, stribeck_velocity_positive=5.1, stribeck_velocity_negative=5.6,
            viscous_positive=1240.0, viscous_negative=1190.0, bristle_stiffness=36.0,
        ),
        cascade=Cascade(position_scale=0.825, velocity_scale=1.12, integral_scale=0.92),
    )  # fmt: skip


def _z() -> Axis:
    return Axis(
        carriage=460.0, lead=12.0, inertia=4.1e-3, stiffness=210.0, vertical=True,
        counterbalance=0.62,
        friction=Friction(
            coulomb_positive=286.0, coulomb_negative=297.0, static_positive=352.0,
            static_negative=371.0, stribeck_velocity_positive=8.3, stribeck_velocity_negative=6.9,
            viscous_positive=1050.0, viscous_negative=1120.0,
        ),
        cascade=Cascade(
            velocity_gain=420.0, integral_gain=36e3, velocity_scale=0.87, integral_scale=0.94,
            acceleration_feedforward=0.9,
        ),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Drives(Ranged):
    """The axes of a machine, and the tool that records them when ``recorded``.

    Raises
    ------
    ValueError
        When the position loops of the axes do not run at one rate.
    """

    recorded: bool = True
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=_y)
    z: Axis = field(default_factory=_z)
    tool: ServoTool = field(default_factory=ServoTool)

    def __post_init__(self) -> None:
        super().__post_init__()
        rates = {letter: a.cascade.position_frequency for letter, a in self.axes.items()}
        if len(set(rates.values())) > 1:
            raise ValueError(f"Drives: position_frequency must be one for all axes, got {rates}")

    @property
    def axes(self) -> dict[str, Axis]:
        """By letter."""
        return {"X": self.x, "Y": self.y, "Z": self.z}
