"""Parameters of the feed drives: screw, carriage, guideways, motor, loops, and the servo tool.

Typical of a vertical machining centre of 12 to 15 kW.  Sources of the orders of magnitude:

- Altintas, Verl, Brecher, Uriarte, Pritschow: *Machine tool feed drives*, CIRP Annals 60 (2011):
  ball screws of 10 to 20 mm lead, 100 to 250 N/um between motor and table, two masses.
- THK and NSK catalogues: C3 and C5 screws of 36 and 40 mm, roller guideways with wipers, friction
  of screw nut and wipers together 200 to 500 N.
- Canudas de Wit, Olsson, Åström, Lischinsky: *A new model for control of systems with friction*,
  IEEE TAC 40 (1995); Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994): Stribeck
  speeds of mm/s, presliding over some 10 um, static friction 1.2 to 1.5 times Coulomb's.
- Altintas: *Manufacturing Automation*, 2nd ed., ch. 6: position gains of 25 to 40 1/s, velocity
  loops of 30 to 60 Hz, feed-forward of 50 to 100 %.
- Siemens: *SINAMICS S120 function manual*: current controller 125 us and less, speed controller 125
  or 250 us, position controller 0.5 to 2 ms.
- Heidenhain: *Encoders for servo drives*, *LC 400*: 2^17 to 2^20 and more steps a revolution,
  scales of 0.1 um and finer.
- Catalogues of motors of 8 to 22 N m (Fanuc: *AC servo motor α series, descriptions*, B-65262EN;
  Siemens 1FK7; Bosch Rexroth MS2N): 2 to 6e-3 kg m2, 3 or 4 pole pairs, 0.3 to 1 ohm, 3 to 8 mH a
  phase; cogging below 1 % of the stall torque.  Dead time of 2 us at 10 kHz and 560 V costs 11 V,
  of which a residual network leaves some per cent.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from math import pi
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged

INTEGRATION = 40000
"""Rate at which the drives are integrated [Hz]."""
RATE = 1000
"""Sampling rate of the servo tool [Hz]."""
GRAVITY = 9.81
"""Acceleration of free fall [m/s2]."""


@dataclass(frozen=True, kw_only=True)
class AxisMotor(Ranged, section="AxisMotor"):
    """Synchronous motor with magnets on its rotor; currents are amplitudes of a phase."""

    torque_constant: Annotated[float, Range(least=0.01, most=20, unit="N m/A")] = 1.26
    pole_pairs: Annotated[int, Range(least=1, most=50)] = 4
    resistance: Annotated[float, Range(least=1e-3, most=100, unit="ohm")] = 0.62
    """Phase resistance at 20 degC."""
    inductance_d: Annotated[float, Range(least=0.01, most=500, unit="mH")] = 5.1
    inductance_q: Annotated[float, Range(least=0.01, most=500, unit="mH")] = 5.9
    """Inductances without current across."""
    saturation: Annotated[float, Range(least=0, most=0.3)] = 0.03
    """Share that L_q loses at ``saturation_current``; grows with its square."""
    saturation_current: Annotated[float, Range(least=0.1, most=1e3, unit="A")] = 20.0
    current_lag: Annotated[float, Range(least=0.01, most=5, unit="ms")] = 0.18
    current_noise: Annotated[float, Range(least=0, most=1, unit="A")] = 0.02
    """Time constant and standard deviation of the closed current loop."""
    cogging: Annotated[float, Range(least=0, most=10, unit="N m")] = 0.06
    cogging_period: Annotated[int, Range(least=1, most=1000)] = 72
    """Amplitude of the torque without current, and its periods a turn (a third of it at twice
    that)."""
    torque_ripple: Annotated[float, Range(least=0, most=0.2)] = 0.006
    """Share of the torque, six periods in each electrical one."""
    heat_capacity: Annotated[float, Range(least=1, most=1e6, unit="J/K")] = 420.0
    cooling: Annotated[float, Range(least=0, most=1e4, unit="W/K")] = 9.0
    """Heat capacity and cooling of the winding."""
    bus_voltage: Annotated[float, Range(least=10, most=2e3, unit="V")] = 560.0
    dead_time_error: Annotated[float, Range(least=0, most=50, unit="V")] = 0.5
    """Voltage between the inverter's rails, voltage that a phase loses against its current."""

    top_speed: Annotated[float, Range(least=100, most=2e4, unit="rev/min")] = 2250.0
    """Speed of the axis' rapid, about."""

    @property
    def flux(self) -> float:
        """Flux linkage of the magnets [V s]: T = 1.5 p flux i_q."""
        return self.torque_constant / (1.5 * self.pole_pairs)


@dataclass(frozen=True, kw_only=True)
class Cascade(Ranged, section="Cascade"):
    """Position loop P, velocity loop PI, with the rates at which they run."""

    position_frequency: Annotated[int, Range(least=RATE, most=INTEGRATION, unit="Hz")] = 2000
    velocity_frequency: Annotated[int, Range(least=RATE, most=INTEGRATION, unit="Hz")] = 8000
    position_gain: Annotated[float, Range(least=1, most=500, unit="1/s")] = 40.0
    velocity_gain: Annotated[float, Range(least=1, most=1e5, unit="A s/m")] = 500.0
    integral_gain: Annotated[float, Range(least=0, most=1e7, unit="A/m")] = 48e3
    """Gains in the list of the control's parameters."""
    position_scale: Annotated[float, Range(least=0.2, most=5)] = 0.825
    velocity_scale: Annotated[float, Range(least=0.2, most=5)] = 1.17
    integral_scale: Annotated[float, Range(least=0.2, most=5)] = 0.86
    """Factors of the loops on them: the maker's own scalings, which the list leaves out."""
    velocity_feedforward: Annotated[float, Range(least=0, most=1)] = 0.6
    """Share of the commanded velocity."""
    acceleration_feedforward: Annotated[float, Range(least=0, most=100, unit="A s2/m")] = 1.3
    current_limit: Annotated[float, Range(least=0.1, most=1e3, unit="A")] = 40.0
    feedback: Literal["scale", "motor"] = "scale"
    """Sensor that closes the position loop: a scale at the carriage, or the motor's encoder."""
    scale_step: Annotated[float, Range(least=1e-3, most=10, unit="um")] = 0.1
    steps_per_turn: Annotated[int, Range(least=1000, most=2**26)] = 2**20
    """Steps of the motor's encoder, from which the velocity comes."""
    velocity_filter: Annotated[float, Range(least=0.01, most=10, unit="ms")] = 0.4
    """Time constant of the velocity filter."""

    def __post_init__(self) -> None:
        super().__post_init__()
        chain = (RATE, self.position_frequency, self.velocity_frequency, INTEGRATION)
        if any(b % a for a, b in pairwise(chain)):
            raise ValueError(
                f"Cascade: position_frequency = {self.position_frequency} and velocity_frequency = "
                f"{self.velocity_frequency} [Hz] must divide one another between {RATE} and "
                f"{INTEGRATION}"
            )


@dataclass(frozen=True, kw_only=True)
class ServoTool(Ranged, section="ServoTool"):
    """Servo tuning tool: its files, their faults, and its recordings."""

    style: Literal["plain", "bracketed"] = "plain"
    """Maker's format: ``X_PosAct`` and seconds, or ``APOS(X)`` and milliseconds."""
    decimal: Literal[".", ","] = "."
    clock_error: Annotated[float, Range(least=-1e3, most=1e3, unit="ppm")] = 50.0
    """Error of its stamps: positive where its clock goes fast."""
    position_step: Annotated[float, Range(least=0.01, most=10, unit="um")] = 0.1
    current_step: Annotated[float, Range(least=1e-5, most=1, unit="A")] = 0.005
    """Resolution of the written values."""
    current_noise: Annotated[float, Range(least=0, most=1, unit="A")] = 0.03
    dropped: Annotated[int, Range(least=0, most=100)] = 3
    torn: Literal["", "circle-20mm", "circle-80mm", "inertia-step-X"] = "circle-80mm"
    """Gaps in each file; the file that ends inside a row."""
    speeds: tuple[float, ...] = (
        0.2, 0.4, 0.8, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 180.0, 300.0, 450.0,
    )  # fmt: skip
    """Speeds of the strokes [mm/s]; rapid comes after them."""
    workpiece: Annotated[float, Range(least=1, most=1e4, unit="kg")] = 160.0
    """Mass that is set down between strokes."""
    load_cell_noise: Annotated[float, Range(least=0, most=100, unit="N")] = 4.0
    load_cell_offset: Annotated[float, Range(least=-100, most=100, unit="N")] = 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.speeds or min(self.speeds) <= 0:
            raise ValueError(f"ServoTool.speeds = {self.speeds} [mm/s] must be positive")


@dataclass(frozen=True, kw_only=True)
class FeedRecords(Ranged, section="FeedRecords"):
    """Recordings of feeds by the servo tool: strokes at cutting feeds, part programs in air."""

    recorded: bool = True
    rate: Annotated[int, Range(least=100, most=RATE, unit="Hz")] = 500
    """Sampling rate that the tool is set to, a whole fraction of its greatest."""
    feeds: tuple[tuple[float, int], ...] = (
        (500.0, 1), (1000.0, 1), (1500.0, 2), (2000.0, 1), (3000.0, 2), (4500.0, 1), (6000.0, 1),
    )  # fmt: skip
    """Feed of the strokes [mm/min] and number of recordings at it, of each axis."""
    length: Annotated[float, Range(least=1, most=250, unit="mm")] = 100.0
    times: Annotated[int, Range(least=1, most=20)] = 2
    """Length of a stroke; number of strokes there and back in a recording."""
    spread: Annotated[float, Range(least=0, most=250, unit="mm")] = 100.0
    """Greatest distance from the work offset at which the strokes begin."""
    seconds: Annotated[float, Range(least=2, most=600, unit="s")] = 12.0
    """Time that the recorder holds while a part program runs."""
    stretches: tuple[int, int, int, int] = (2, 2, 3, 1)
    """Number of stretches that are recorded of each part program."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if RATE % self.rate:
            raise ValueError(f"FeedRecords.rate = {self.rate} [Hz] must divide {RATE}")
        if not self.feeds or any(not 10 <= f <= 15e3 or not 1 <= n <= 100 for f, n in self.feeds):
            raise ValueError(
                f"FeedRecords.feeds = {self.feeds} must be pairs of a feed from 10 to 15000 mm/min "
                "and a number of recordings from 1 to 100"
            )
        if min(self.stretches) < 0 or max(self.stretches) > 100:
            raise ValueError(f"FeedRecords.stretches = {self.stretches} must lie from 0 to 100")


@dataclass(frozen=True, kw_only=True)
class ShaftRecords(Ranged, section="ShaftRecords"):
    """Recordings of both ends of each drive, and what stands between them beside twist and play.

    Errors of a ground screw of class C3 to C5 (ISO 3408-3), of a sealed scale of 20 um, and of an
    encoder's coupling; a scale is set up beside the axis where none closes its loop.
    """

    recorded: bool = True
    sweep: Annotated[float, Range(least=0, most=100, unit="A")] = 3.0
    """Amplitude of the swept sine on the current."""
    scale_step: Annotated[float, Range(least=1e-3, most=10, unit="um")] = 0.05
    scale_noise: Annotated[float, Range(least=0, most=10, unit="um")] = 0.03
    interpolation: Annotated[float, Range(least=0, most=10, unit="um")] = 0.06
    """Resolution and noise of the scale, error within a period of its grating."""
    eccentricity: Annotated[float, Range(least=0, most=10, unit="um")] = 0.12
    """Error of the motor's encoder, once a turn, at the carriage."""
    pitch: Annotated[float, Range(least=-100, most=100, unit="um/m")] = 9.0
    pitch_ripple: Annotated[float, Range(least=0, most=10, unit="um")] = 0.5
    """Error of the screw along a metre, and once a turn."""
    growth: Annotated[float, Range(least=-10, most=10, unit="um")] = 0.4
    """Growth of the screw from its warmth, over a recording."""


@dataclass(frozen=True, kw_only=True)
class Friction(Ranged, section="Friction"):
    """LuGre friction of guideways and nut, for motion in positive and in negative direction."""

    coulomb_positive: Annotated[float, Range(least=1, most=1e4, unit="N")] = 318.0
    coulomb_negative: Annotated[float, Range(least=1, most=1e4, unit="N")] = 332.0
    static_positive: Annotated[float, Range(least=1, most=1e4, unit="N")] = 410.0
    static_negative: Annotated[float, Range(least=1, most=1e4, unit="N")] = 436.0
    stribeck_velocity_positive: Annotated[float, Range(least=0.1, most=100, unit="mm/s")] = 6.2
    stribeck_velocity_negative: Annotated[float, Range(least=0.1, most=100, unit="mm/s")] = 7.4
    viscous_positive: Annotated[float, Range(least=0, most=1e5, unit="N s/m")] = 860.0
    viscous_negative: Annotated[float, Range(least=0, most=1e5, unit="N s/m")] = 910.0
    bristle_stiffness: Annotated[float, Range(least=1, most=500, unit="N/um")] = 30.0
    bristle_damping: Annotated[float, Range(least=0, most=1e3, unit="N s/mm")] = 70.0
    """Contact before it slides; the damping fades as it slides (Olsson 1996)."""
    pitch_ripple: Annotated[float, Range(least=0, most=0.5)] = 0.02
    """Share of the level by which it goes up and down once a turn of the screw."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for side in ("positive", "negative"):
            static, coulomb = getattr(self, f"static_{side}"), getattr(self, f"coulomb_{side}")
            if static < coulomb:
                raise ValueError(
                    f"Friction.static_{side} = {static} [N] must not be below "
                    f"coulomb_{side} = {coulomb}"
                )


@dataclass(frozen=True, kw_only=True)
class Axis(Ranged, section="Axis"):
    """One axis: a motor that turns a screw, which moves a carriage."""

    lead: Annotated[float, Range(least=1, most=100, unit="mm")] = 16.0
    inertia: Annotated[float, Range(least=1e-5, most=1, unit="kg m2")] = 5.2e-3
    """Inertia of rotor, coupling and screw."""
    carriage: Annotated[float, Range(least=1, most=1e5, unit="kg")] = 520.0
    stiffness: Annotated[float, Range(least=1, most=5e3, unit="N/um")] = 180.0
    damping: Annotated[float, Range(least=0, most=1e3, unit="N s/mm")] = 14.0
    """Coupling, screw, its bearings and nut, in the direction of motion."""
    backlash: Annotated[float, Range(least=0, most=500, unit="um")] = 0.0
    """Play between screw and carriage; 0 for a preloaded nut."""
    motor_viscous: Annotated[float, Range(least=0, most=1, unit="N m s/rad")] = 1.4e-3
    """Friction of the bearings of motor and screw."""
    vertical: bool = False
    counterbalance: Annotated[float, Range(least=0, most=1)] = 0.0
    """Share of the weight that something else carries; a vertical axis has positive up."""
    friction: Friction = field(default_factory=Friction)
    motor: AxisMotor = field(default_factory=AxisMotor)
    cascade: Cascade = field(default_factory=Cascade)

    @property
    def gear(self) -> float:
        """Angle of the motor for each metre of the carriage [rad/m]."""
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
class Drives(Ranged, section="Drives"):
    """The axes of a machine, and the tool that records them when ``recorded``."""

    recorded: bool = True
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=_y)
    z: Axis = field(default_factory=_z)
    tool: ServoTool = field(default_factory=ServoTool)
    feed: FeedRecords = field(default_factory=FeedRecords)
    """Recordings of feeds, made when those are ``recorded`` too."""
    shaft: ShaftRecords = field(default_factory=ShaftRecords)
    """Recordings of both ends of each drive, made when those are ``recorded`` too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rates = {letter: a.cascade.position_frequency for letter, a in self.axes.items()}
        if len(set(rates.values())) > 1:
            raise ValueError(f"Drives: position_frequency must be one for all axes, got {rates}")

    @property
    def axes(self) -> dict[str, Axis]:
        """Axes by their letter."""
        return {"X": self.x, "Y": self.y, "Z": self.z}
