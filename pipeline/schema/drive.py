"""Stored feed drives: mechanics and loops of each axis, and the motor.

Positions in metres at the encoder; forces in newtons at the carriage, or in the command's unit
where the force constant is not listed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Annotated

from pipeline.schema.model import Band, Correlation, Model
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged

MOTOR = "motor"
"""Group of the motor's parameters, beside the letters of the axes."""
FORCE, FOLLOWING, COMMAND, SPEED = "force", "following error", "command", "speed"
"""Predicted quantities, each followed by the axis' letter; the last two are shown, not scored."""
TWIST = "twist"
"""Predicted too, where both ends of an axis are recorded: motor's position less the carriage's."""
LEVEL, LAG, RIGID = "constant_level", "speed_over_loop_gain", "rigid_shaft"
"""Baselines: one force against motion; the following error at steady speed; no twist."""
BASELINE_TITLES = {LEVEL: "one constant level against motion", LAG: "speed over loop gain",
                   RIGID: "no twist"}  # fmt: skip
"""Baselines in words."""


@dataclass(frozen=True, kw_only=True)
class AxisInCut:
    """One axis while a program's tool is in the material, and at the same moments in air."""

    axis: str
    """Letter of the axis."""
    following_um: float
    following_rms_um: float
    following_air_um: float
    """Following error: greatest and root mean square in the cut, greatest in air [um]."""
    following_line: int
    """Line of the program where it is greatest in the cut."""
    command: float
    command_rms: float
    command_air: float
    """The same of the motor's command [``command_unit``]."""
    command_line: int
    """Line of the program where the command is greatest in the cut."""
    command_unit: str
    """Unit of the command, A or V."""
    force_N: float
    """Greatest force of the cut along the axis, its mean over a turn of the spindle [N]."""
    half_width_um: float = inf
    """Greatest half width of the 90 % interval of the following error in the cut [um]; infinite,
    and not stored, where no residual network gives it."""


@dataclass(frozen=True, kw_only=True)
class DirectionFriction(Ranged, section="friction"):
    """Friction in one direction of motion; all values count as positive."""

    coulomb: NotNegative
    """Level F_c that speed does not change [N]."""
    static: NotNegative
    """Level F_s at the start of motion [N], at least ``coulomb``."""
    stribeck_velocity: Annotated[float, Range(above=0.0, unit="m/s")]
    """Speed v_s over which the level falls from the static to the Coulomb one [m/s]."""
    viscous: NotNegative
    """mu_v [N s/m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.static < self.coulomb:
            raise ValueError(
                f"friction.static = {self.static} N must not be below coulomb = {self.coulomb} N"
            )


@dataclass(frozen=True, kw_only=True)
class FrictionParameters:
    """Friction in both directions of motion."""

    positive: DirectionFriction
    negative: DirectionFriction
    """Friction for v > 0 and for v < 0."""


@dataclass(frozen=True, kw_only=True)
class FeedDriveParameters(Ranged, section="feed_drive"):
    """Mechanics of one axis from its command to the carriage."""

    mass: Positive
    """All that moves, the screw's and motor's inertia as mass: M + J (2 pi / L)^2 [kg]."""
    force_constant: Positive
    """Force on the carriage for one unit of the command [N/A] ([N/V] where the command is a
    voltage).  1 where it is unknown: then forces are in the command's unit, and so is M."""
    friction: FrictionParameters
    """Both directions."""
    offset: Annotated[float, Range(unit="N")] = 0.0
    """Force against positive motion that is always there: gravity less counterbalance [N]."""
    backlash: Annotated[float, Range(least=0.0, unit="m")] = 0.0
    """Backlash between the screw and the carriage [m]; 0 for none."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """Loops of an axis: gains as listed, their scale factors, feed-forward, lags [s].

    Gains in SI: P_p [1/s], V_p [A s/m], V_i [A/m], f_a [A s^2/m]; ``current_limit`` [A] is None
    where there is none.
    """

    position_gain: float
    velocity_gain: float
    integral_gain: float = 0.0
    position_scale: float = 1.0
    velocity_scale: float = 1.0
    integral_scale: float = 1.0
    velocity_feedforward: float = 0.0
    acceleration_feedforward: float = 0.0
    current_limit: float | None = None
    velocity_lag: float = 0.0
    position_lag: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FrictionPoint:
    """Mean force at one constant speed, with half of its 95 % interval and its duration."""

    velocity_mm_s: float
    force: float
    half_width: float | None
    seconds: float


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """Friction and offset of the model at one speed."""

    velocity_mm_s: float
    force: float


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method that was run on one task: its error, its evaluations, whether it was kept."""

    task: str
    method: str
    chosen: bool
    error: float | None
    error_unit: str
    evaluations: int


@dataclass(frozen=True, kw_only=True)
class FitFacts:
    """Quality of a fit."""

    samples: int
    """Number of rows that were fitted [1]."""
    relative_error_percent: float | None
    """Relative error of the force or the command [%]."""
    bandwidth_Hz: float | None
    """Bandwidth of the filter [Hz]; None for no filter."""
    delay_s: float | None = None
    """Delay of the motion behind the command [s]."""
    condition: float | None
    rank: int
    """Condition number (None where it is not known) and rank of the Jacobian with columns scaled to
    length one [1]."""
    correlation: Correlation
    """Correlation of the fitted parameters."""


@dataclass(frozen=True, kw_only=True)
class RecursiveMass:
    """Recursive estimate of the mass through one recording, with half of its 95 % interval."""

    recording: str
    unit: str
    time_s: tuple[float, ...]
    value: tuple[float | None, ...]
    half_width: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class DriveAxis:
    """One identified axis."""

    command_unit: str
    force_unit: str
    """Unit of the command, and of forces: the command's where the force constant is not listed."""
    feed_drive: FeedDriveParameters
    """Mechanics."""
    servo: Servo | None
    """Loops; None where the records do not determine them."""
    servo_reason: str = ""
    """Reason why there is no servo."""
    constant_level: float = 0.0
    """Mean force against motion over the training recordings, the baseline of the force."""
    friction_points: tuple[FrictionPoint, ...] = ()
    """Friction at constant speed as measured."""
    friction_curve: tuple[CurvePoint, ...] = ()
    """Friction and offset of the model over the same speeds."""
    methods: tuple[Method, ...] = ()
    """Methods that were run."""
    fit: FitFacts
    servo_fit: FitFacts | None = None
    """Quality of the fits of the mechanics and of the loops."""
    recursive_mass: RecursiveMass | None = None
    """Recursive estimate; None where no mass is determined or the sampling is too slow."""
    presliding_stiffness: float | None = None
    """Stiffness of friction before it slides [N/m]; None where the records do not determine it."""
    presliding_time_s: float | None = None
    """Time in which friction lets go of a standing axis, to 1/e [s]; None where the records do not
    determine it: it holds."""
    intervals: Mapping[str, Band] = field(default_factory=dict)
    """Half widths of the 90 % intervals of :data:`FORCE`, in ``force_unit``, and :data:`FOLLOWING`
    [um]; missing where too few recordings move the axis."""


@dataclass(frozen=True, kw_only=True)
class DriveMotor:
    """Fit of a synchronous motor: its axis, windows fitted and left out, condition, correlation."""

    axis: str
    windows: int
    left_out: int
    condition: float | None
    correlation: Correlation


@dataclass(frozen=True, kw_only=True)
class TrainingRecording:
    """A training recording: its length [s] and the changes to its rows."""

    recording: str
    seconds: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Shaft:
    """Shaft of an axis between its motor and its carriage, as positions along the axis."""

    factors: tuple[float, ...]
    """Seven factors of the twist's equation in SI: C, C M_m, C B, C F_c, C D, C times the command's
    lag, play."""
    lead: float | None
    """Lead of the screw [m/rev]; None where it is not listed."""
    samples: int
    """Number of samples that were fitted [1]."""
    twist_um: float
    left_um: float
    """Root mean square of the twist, and of what the fit leaves over [um]."""


@dataclass(frozen=True, kw_only=True)
class SpeedLoop:
    """A speed loop on the simulated axis: a step of 1000 rev/min, switched inverter; a ramp."""

    kind: str
    """``"PI"`` or ``"fuzzy PI"``."""
    gains: str
    """``"as found"``, ``"Feed2025"`` or ``"tuned alike"``."""
    proportional: float
    integral: float
    """K_p [N m s/rad], K_i [N m/rad]; with fuzzy rules the middles."""
    settling_ms: float | None
    reaching_ms: float | None
    """Time until the speed stays within 0.1 % and within 2 % of the step [ms]; None for never."""
    overshoot_percent: float
    """Overshoot over the step [%]."""
    ripple_percent: float | None
    """Half of the span of the speed over the last fifth of the step [%]; None where it has not
    settled there."""
    following_um: float | None
    """Greatest following error on 100 mm at 1500 mm/min [um]; None without a position loop."""
    time_ms: tuple[float, ...] = ()
    speed_percent: tuple[float, ...] = ()
    """Response: time [ms] and speed over the step [%]."""


@dataclass(frozen=True, kw_only=True)
class SpeedLoops:
    """Speed loops held against each other on one axis as identified, or why they are not."""

    axis: str
    loops: tuple[SpeedLoop, ...] = ()
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class DriveModel(Model):
    """The drives' ``model.json``."""

    axes: Mapping[str, DriveAxis] = field(default_factory=dict)
    """Axes by letter."""
    motor: DriveMotor | None = None
    """Motor; None without recordings of a motor's voltages and currents."""
    recordings: tuple[TrainingRecording, ...] = ()
    """Training recordings of the axes."""
    substeps: int = 1
    """Number of steps of the closed-loop simulation in one sample [1]."""
    shafts: Mapping[str, Shaft] = field(default_factory=dict)
    """Shafts by letter, of axes whose both ends were recorded."""
    speed_loops: SpeedLoops | None = None
    """PI against fuzzy PI on the axis whose motor was recorded; None without one."""
    blocks: Mapping[str, Mapping[str, DriveAxis]] = field(default_factory=dict)
    """Axes of a single recording as the other blocks of its time give them, by letter, which judge
    it, by the name of each block."""
