"""Parameters of a simulated machine: spindle, control, working hours, shop air, log, logger.

The spindle is typical of a 15 kW, 12 000 rev/min integrated motor spindle with hybrid angular
contact bearings, the control of a vertical machining centre of 12 to 15 kW.  Sources of the orders
of magnitude:

- Harris, Kotzalas: *Rolling Bearing Analysis*, 5th ed., ch. 10 (Palmgren's friction torque);
  SKF and FAG super-precision catalogues (70xx C hybrid series: diameters, preload, capacity, f0).
- Bossmanns, Tu: *A thermal model for high speed motorized spindles*, Int. J. Mach. Tools Manuf. 39
  (1999) 1345-1366 (motor loss split, air gap, jacket, share of each heat path).
- Catalogue efficiency of 15 kW induction spindle motors, 88 to 91 % at the rated point: about 6 %
  stator copper, 3 % rotor copper, 3 % iron (IEC 60034-2-1 gives the split of losses).
- Masses times specific heat (steel 460, cast iron 500, copper 385, water 4180 J/kg K).
- Brochures of machining centres (DN Solutions DNM 4500: rapids 36, 36, 30 m/min, tool to tool
  1.3 s; Haas VF-2SS: 35.6 m/min, 1.6 s): rapids 30 to 36 m/min, with the door, the arm and the
  check of the tool 2 to 3 s; accelerations of 0.3 to 0.6 g.
- Altintas: *Manufacturing Automation*, 2nd ed., ch. 5 and 6: jerk of 5e4 mm/s³, position gain of 30
  to 60 1/s.
- Jeon: *Improving Grbl: cornering algorithm* (2011): centripetal junction rule, 0.01 mm.
- Fanuc operator's manuals: standard look-ahead of 200 blocks (AI contour control II), clearance of
  G83 by parameter, per-axis rapids, in-position check.
"""

from dataclasses import dataclass, field
from datetime import date
from typing import Annotated, Literal, TypeVar

import numpy as np

from pipeline.schema.ranges import Range, Ranged
from pipeline.shop.cutting.parameters import Cutting, Workpiece
from pipeline.shop.drives.parameters import Drives
from pipeline.shop.growth.parameters import Growth
from pipeline.shop.wear.parameters import (
    CUTS,
    CUTTERS,
    LIVES,
    Cutter,
    Microscope,
    PlannedCut,
    PlannedLife,
    Sensors,
    WearRate,
)

Random = np.random.Generator
"""Random numbers of one source of chance."""
Named = TypeVar("Named", Cutter, PlannedCut)
STEEL = Workpiece(
    name="42CrMo4", tangential=2180.0, radial=870.0, axial=410.0, thickness=0.05, exponent=0.1,
    edge_tangential=33.0, edge_radial=49.0, edge_axial=4.0, ploughing=6.0, flank_pressure=560.0,
    flank_friction=0.36,
)  # fmt: skip
"""Material in which tools wear by default."""
Bounds = tuple[float, float]
"""Greatest acceleration [mm/s2] and jerk [mm/s3] of a motion."""


def stamp(start: np.datetime64, seconds: float, digits: int = 3) -> str:
    """ISO time (UTC) ``seconds`` after ``start``, with 3 or 6 ``digits`` of a second."""
    unit: Literal["ms", "us"] = "ms" if digits == 3 else "us"
    step = np.timedelta64(round(seconds * (1e3 if digits == 3 else 1e6)), unit)
    return f"{start.astype(f'datetime64[{unit}]') + step}Z"


@dataclass(frozen=True, kw_only=True)
class BearingParameters(Ranged, section="BearingParameters"):
    """A set of equal angular contact ball bearings."""

    count: Annotated[int, Range(least=1, most=6)] = 2
    mean_diameter: Annotated[float, Range(least=0.02, most=0.3, unit="m")] = 0.0825
    # oil-air; 2 for grease (Harris, table 10.3)
    f0: Annotated[float, Range(least=0.3, most=10.0)] = 1.0
    preload: Annotated[float, Range(least=0.0, most=5e3, unit="N")] = 450.0
    static_capacity: Annotated[float, Range(least=1e3, most=1e6, unit="N")] = 29e3
    # shaft grows against housing
    thermal_preload: Annotated[float, Range(least=0.0, most=0.5, unit="1/K")] = 0.06


@dataclass(frozen=True, kw_only=True)
class MotorParameters(Ranged, section="MotorParameters"):
    """An induction motor with field weakening above its base speed."""

    rated_power: Annotated[float, Range(least=1e3, most=1e5, unit="W")] = 15e3
    base_speed: Annotated[float, Range(least=100, most=2e4, unit="rev/min")] = 2500.0
    # stator, rated point, at 20 degC
    copper_loss: Annotated[float, Range(least=10, most=1e4, unit="W")] = 900.0
    rotor_loss: Annotated[float, Range(least=0, most=1e4, unit="W")] = 420.0
    # at base speed and full flux
    hysteresis_loss: Annotated[float, Range(least=0, most=1e4, unit="W")] = 240.0
    eddy_loss: Annotated[float, Range(least=0, most=1e4, unit="W")] = 150.0
    magnetising_share: Annotated[float, Range(least=0.1, most=0.9)] = 0.5  # of rated current
    # servo torque at standstill, rms, of rated
    hold_share: Annotated[float, Range(least=0.0, most=1.0)] = 0.25
    # air gap shear at 12 000 rev/min, grows as n^3
    windage: Annotated[float, Range(least=0, most=2e3, unit="W")] = 90.0
    inertia: Annotated[float, Range(least=1e-4, most=5, unit="kg m2")] = 0.055
    acceleration: Annotated[float, Range(least=100, most=1e5, unit="rev/min/s")] = 3500.0


@dataclass(frozen=True, kw_only=True)
class MassParameters(Ranged, section="MassParameters"):
    """Heat capacities of the nodes of the thermal network."""

    winding: Annotated[float, Range(least=100, most=1e6, unit="J/K")] = 2.6e3
    stator: Annotated[float, Range(least=100, most=1e6, unit="J/K")] = 9.5e3
    rotor: Annotated[float, Range(least=100, most=1e6, unit="J/K")] = 8.5e3
    front_bearing: Annotated[float, Range(least=100, most=1e6, unit="J/K")] = 2.6e3
    rear_bearing: Annotated[float, Range(least=100, most=1e6, unit="J/K")] = 1.5e3
    housing: Annotated[float, Range(least=100, most=1e7, unit="J/K")] = 26e3
    head: Annotated[float, Range(least=100, most=1e8, unit="J/K")] = 125e3
    bed: Annotated[float, Range(least=1e4, most=1e8, unit="J/K")] = 1.5e6
    chiller: Annotated[float, Range(least=1e3, most=1e7, unit="J/K")] = 110e3
    coolant: Annotated[float, Range(least=1e3, most=1e8, unit="J/K")] = 1.1e6


@dataclass(frozen=True, kw_only=True)
class PathParameters(Ranged, section="PathParameters"):
    """Conductances between nodes; where flow or speed matters, at its nominal value."""

    winding_stator: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 95.0
    stator_housing: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 34.0
    stator_jacket: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 24.0
    stator_rotor: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 5.0  # air gap at rest
    rotor_front: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 9.0
    rotor_rear: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 7.0
    front_housing: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 20.0
    rear_housing: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 13.0
    housing_jacket: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 28.0
    housing_head: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 22.0
    head_bed: Annotated[float, Range(least=0.1, most=1e4, unit="W/K")] = 18.0
    # flood on the spindle's nose
    nose_coolant: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 9.0
    bed_coolant: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 15.0
    nose_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 1.5
    housing_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 2.2
    head_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 9.0
    bed_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 38.0
    chiller_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 4.0
    coolant_air: Annotated[float, Range(least=0.0, most=1e4, unit="W/K")] = 90.0  # with evaporation


@dataclass(frozen=True, kw_only=True)
class ChillerParameters(Ranged, section="ChillerParameters"):
    """A two-point chiller of finite capacity."""

    setpoint: Annotated[float, Range(least=5, most=40, unit="degC")] = 22.0
    follows_ambient: bool = False  # then ``setpoint`` is what is added to ambient [K] less 20
    hysteresis: Annotated[float, Range(least=0.05, most=10, unit="K")] = 0.8
    capacity: Annotated[float, Range(least=50, most=5e4, unit="W")] = 2600.0  # at 20 degC ambient
    # lost for each kelvin of ambient
    capacity_slope: Annotated[float, Range(least=0, most=0.1, unit="1/K")] = 0.012


@dataclass(frozen=True, kw_only=True)
class SpindleParameters(Ranged, section="SpindleParameters"):
    """Motor spindle with everything that heats and cools it."""

    top_speed: Annotated[float, Range(least=500, most=1e5, unit="rev/min")] = 12000.0
    front: BearingParameters = field(default_factory=BearingParameters)
    rear: BearingParameters = field(
        default_factory=lambda: BearingParameters(
            mean_diameter=0.07, preload=300.0, static_capacity=21e3
        )
    )
    motor: MotorParameters = field(default_factory=MotorParameters)
    masses: MassParameters = field(default_factory=MassParameters)
    paths: PathParameters = field(default_factory=PathParameters)
    chiller: ChillerParameters = field(default_factory=ChillerParameters)
    viscosity_40: Annotated[float, Range(least=2, most=1e3, unit="mm2/s")] = 22.0  # ISO VG 22
    viscosity_100: Annotated[float, Range(least=1, most=100, unit="mm2/s")] = 4.4
    # hydraulics and fans while switched on
    bed_heat: Annotated[float, Range(least=0, most=1e4, unit="W")] = 160.0
    # guides, screws while axes move
    feed_heat: Annotated[float, Range(least=0, most=1e4, unit="W")] = 120.0
    coolant_pump: Annotated[float, Range(least=0, most=1e4, unit="W")] = 750.0
    chip_heat_to_coolant: Annotated[float, Range(least=0, most=1)] = 0.3  # of the cut's power
    cut_heat_to_tool: Annotated[float, Range(least=0, most=0.5)] = 0.03
    # of the thermistor in the winding
    sensor_lag: Annotated[float, Range(least=0, most=1e3, unit="s")] = 35.0
    sensor_noise: Annotated[float, Range(least=0, most=5, unit="K")] = 0.12

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.viscosity_100 >= self.viscosity_40:
            raise ValueError(
                f"SpindleParameters.viscosity_100 = {self.viscosity_100} [mm2/s] must be below "
                f"viscosity_40 = {self.viscosity_40}: oil gets thinner when warm"
            )


@dataclass(frozen=True, kw_only=True)
class AxisLimits(Ranged, section="AxisLimits"):
    """Greatest speed, acceleration and jerk of one axis."""

    rapid: Annotated[float, Range(least=1e3, most=2e5, unit="mm/min")] = 36000.0
    acceleration: Annotated[float, Range(least=0.2, most=30, unit="m/s2")] = 5.0
    jerk: Annotated[float, Range(least=1, most=2e3, unit="m/s3")] = 50.0

    @property
    def bounds(self) -> Bounds:
        """Greatest acceleration [mm/s2] and jerk [mm/s3]."""
        return self.acceleration * 1e3, self.jerk * 1e3


@dataclass(frozen=True, kw_only=True)
class CodeTimes(Ranged, section="CodeTimes"):
    """Mean time until each M code is acknowledged, without what it starts, and the scatter."""

    m1: Annotated[float, Range(least=0, most=10, unit="s")] = 0.08
    m3: Annotated[float, Range(least=0, most=10, unit="s")] = 0.14
    m5: Annotated[float, Range(least=0, most=10, unit="s")] = 0.12
    m8: Annotated[float, Range(least=0, most=10, unit="s")] = 0.42
    m9: Annotated[float, Range(least=0, most=10, unit="s")] = 0.26
    m30: Annotated[float, Range(least=0, most=10, unit="s")] = 0.35
    scatter: Annotated[float, Range(least=0, most=1, unit="s")] = 0.02


@dataclass(frozen=True, kw_only=True)
class ControlParameters(Ranged, section="ControlParameters"):
    """Settings of a machine's control, and of the adapter that polls it."""

    x: AxisLimits = field(default_factory=AxisLimits)
    y: AxisLimits = field(default_factory=AxisLimits)
    z: AxisLimits = field(
        default_factory=lambda: AxisLimits(rapid=30000.0, acceleration=4.5, jerk=45.0)
    )
    # along the path
    cutting_acceleration: Annotated[float, Range(least=0.2, most=30, unit="m/s2")] = 3.0
    cutting_jerk: Annotated[float, Range(least=1, most=2e3, unit="m/s3")] = 40.0
    centripetal_acceleration: Annotated[float, Range(least=0.2, most=30, unit="m/s2")] = 2.4
    junction_deviation: Annotated[float, Range(least=1e-4, most=1, unit="mm")] = 0.012
    look_ahead: Annotated[int, Range(least=2, most=10000)] = 200  # blocks
    greatest_feed: Annotated[float, Range(least=100, most=1e5, unit="mm/min")] = 15000.0
    position_gain: Annotated[float, Range(least=5, most=500, unit="1/s")] = 33.0
    in_position: Annotated[float, Range(least=1e-4, most=1, unit="mm")] = 0.02
    cycle: Annotated[float, Range(least=1e-4, most=0.02, unit="s")] = 0.002  # of the interpolation
    # of the feed rate, to and from standstill
    hold_ramp: Annotated[float, Range(least=0.05, most=2, unit="s")] = 0.25
    tool_change: Annotated[float, Range(least=0.5, most=30, unit="s")] = 2.6
    tool_change_scatter: Annotated[float, Range(least=0, most=2, unit="s")] = 0.1
    # machine Z where the arm takes the tool
    change_height: Annotated[float, Range(least=-500, most=0, unit="mm")] = 0.0
    spindle_wait: Literal["at_m3", "before_cutting"] = "at_m3"
    # of rated torque and power, speeding up
    spindle_overload: Annotated[float, Range(least=0.5, most=3)] = 1.5
    codes: CodeTimes = field(default_factory=CodeTimes)
    # the number below that of the first
    first_program: Annotated[int, Range(least=1, most=9000)] = 5100
    numbered: bool = True  # N words and no blanks, as the posts of some makers write
    peck_clearance: Annotated[float, Range(least=0.05, most=5, unit="mm")] = 1.0
    work_offset: tuple[float, float, float] = (-410.0, -235.0, -470.0)  # G54 [mm]
    poll: Annotated[float, Range(least=0.02, most=5, unit="s")] = 0.15
    poll_jitter: Annotated[float, Range(least=0, most=0.5, unit="s")] = 0.015

    def __post_init__(self) -> None:
        super().__post_init__()
        weakest = min(axis.acceleration for axis in self.axes)
        needed = (self.cutting_acceleration**2 + self.centripetal_acceleration**2) ** 0.5
        if needed > weakest:
            raise ValueError(
                f"ControlParameters: cutting_acceleration {self.cutting_acceleration} and "
                f"centripetal_acceleration {self.centripetal_acceleration} [m/s2] come to "
                f"{needed:.2f}, more than the weakest axis can: {weakest}"
            )

    @property
    def axes(self) -> tuple[AxisLimits, AxisLimits, AxisLimits]:
        """Limits of X, Y, Z."""
        return self.x, self.y, self.z

    @property
    def path_bounds(self) -> Bounds:
        """Greatest acceleration [mm/s2] and jerk [mm/s3] along the path of a cut."""
        return self.cutting_acceleration * 1e3, self.cutting_jerk * 1e3


@dataclass(frozen=True, kw_only=True)
class ShiftParameters(Ranged, section="ShiftParameters"):
    """Working hours and habits of the people at the machine; hours count from midnight."""

    start_earliest: Annotated[float, Range(least=3, most=12, unit="h")] = 6.0
    start_latest: Annotated[float, Range(least=3, most=12, unit="h")] = 7.0
    end: Annotated[float, Range(least=10, most=21, unit="h")] = 16.5
    friday_end: Annotated[float, Range(least=10, most=21, unit="h")] = 14.5
    breaks: tuple[tuple[float, float], ...] = ((9.25, 0.25), (12.0, 0.67), (14.5, 0.17))
    batch_smallest: Annotated[int, Range(least=1, most=1000)] = 3
    batch_largest: Annotated[int, Range(least=1, most=1000)] = 9
    abort_chance: Annotated[float, Range(least=0, most=1)] = 0.025  # for each cycle
    feed_hold_chance: Annotated[float, Range(least=0, most=1)] = 0.03  # for each operation
    warm_up_chance: Annotated[float, Range(least=0, most=1)] = 0.85  # for each morning

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start_latest < self.start_earliest or self.batch_largest < self.batch_smallest:
            raise ValueError(
                "ShiftParameters: start_latest and batch_largest must not be below start_earliest "
                f"and batch_smallest; got {self.start_latest}, {self.batch_largest}"
            )


@dataclass(frozen=True, kw_only=True)
class AirParameters(Ranged, section="AirParameters"):
    """Air of the shop: heating with setback, outdoors, doors."""

    working: Annotated[float, Range(least=0, most=40, unit="degC")] = 20.5
    setback: Annotated[float, Range(least=-10, most=40, unit="degC")] = 15.5
    weekend: Annotated[float, Range(least=-10, most=40, unit="degC")] = 13.5
    daily_amplitude: Annotated[float, Range(least=0, most=20, unit="K")] = 1.4
    # weather, standard deviation
    day_to_day: Annotated[float, Range(least=0, most=20, unit="K")] = 1.2
    building_lag: Annotated[float, Range(least=0.1, most=48, unit="h")] = 2.5
    doors_a_day: Annotated[float, Range(least=0, most=200)] = 8.0
    door_drop: Annotated[float, Range(least=0, most=20, unit="K")] = 2.5
    door_recovery: Annotated[float, Range(least=0.5, most=300, unit="min")] = 11.0


@dataclass(frozen=True, kw_only=True)
class LogParameters(Ranged, section="LogParameters"):
    """Polling of the machine's log, and its faults (rates are means)."""

    kind: Literal["agent", "adapter"] = "agent"
    poll: Annotated[float, Range(least=0.1, most=60, unit="s")] = 1.05
    jitter: Annotated[float, Range(least=0, most=0.5, unit="s")] = 0.015
    skipped_polls: Annotated[float, Range(least=0, most=0.5)] = 0.02  # share
    zero_temperatures: Annotated[float, Range(least=0, most=2e4, unit="1/day")] = 300.0
    feedrate_spikes: Annotated[float, Range(least=0, most=500, unit="1/day")] = 4.0
    speed_spikes: Annotated[float, Range(least=0, most=500, unit="1/day")] = 1.0
    position_spikes: Annotated[float, Range(least=0, most=500, unit="1/day")] = 0.6
    counter_resets: Annotated[float, Range(least=0, most=500, unit="1/day")] = 0.5
    disconnects: Annotated[float, Range(least=0, most=100, unit="1/day")] = 4.0
    # share stamped before what precedes it
    late_disconnects: Annotated[float, Range(least=0, most=1)] = 0.5
    silences: Annotated[float, Range(least=0, most=20, unit="1/day")] = 0.2
    late_lines: Annotated[float, Range(least=0, most=1e3, unit="1/day")] = 6.0
    broken_lines: Annotated[float, Range(least=0, most=1e3, unit="1/day")] = 1.5

    @property
    def native(self) -> bool:
        """Whether values are written in native units, as an adapter does."""
        return self.kind == "adapter"


@dataclass(frozen=True, kw_only=True)
class LoggerParameters(Ranged, section="LoggerParameters"):
    """The thermocouple logger beside the machine."""

    interval: Annotated[int, Range(least=1, most=3600, unit="s")] = 10
    decimal: Literal[".", ","] = "."
    encoding: Literal["utf-8", "cp1252"] = "utf-8"
    clock_offset: Annotated[float, Range(least=-600, most=600, unit="s")] = 3.0
    clock_drift: Annotated[float, Range(least=-60, most=60, unit="s/day")] = 1.7
    # of the logger's clock against UTC
    zone_hours: Annotated[int, Range(least=-12, most=14, unit="h")] = 0
    noise: Annotated[float, Range(least=0, most=5, unit="K")] = 0.06
    # standard deviation over the channels
    offset: Annotated[float, Range(least=0, most=5, unit="K")] = 0.3
    dropouts: Annotated[int, Range(least=0, most=1000)] = 4  # in all: one channel blank for a while
    spikes: Annotated[int, Range(least=0, most=10000)] = 7  # in all: one sample of one channel


@dataclass(frozen=True, kw_only=True)
class Wear(Ranged, section="Wear"):
    """Tool lives of a machine: nothing of them is written unless they are ``recorded``."""

    recorded: bool = True
    workpiece: Workpiece = STEEL
    cutters: tuple[Cutter, ...] = CUTTERS
    cuts: tuple[PlannedCut, ...] = CUTS
    lives: tuple[PlannedLife, ...] = LIVES
    rate: WearRate = field(default_factory=WearRate)
    sensors: Sensors = field(default_factory=Sensors)
    microscope: Microscope = field(default_factory=Microscope)
    most: Annotated[int, Range(least=1, most=500)] = 48
    """Greatest number of records of one life."""
    depth_error: Annotated[float, Range(least=0, most=0.5)] = 0.03
    width_error: Annotated[float, Range(least=0, most=0.5)] = 0.03
    """Relative standard deviations of width and depth of cut."""
    speed_error: Annotated[float, Range(least=0, most=0.05)] = 1e-3
    speed_wander: Annotated[float, Range(least=0, most=0.05)] = 1e-3
    """Errors of the spindle, as in the dynamometer's tests."""
    unsteady: Annotated[float, Range(least=0, most=0.5)] = 0.02
    """Relative standard deviation of the force inside one cut by the material's structure."""
    entries: Annotated[float, Range(least=0, most=0.5)] = 0.08
    """Share of the records that hold the tool's entry into the material, and as many its exit."""
    delimiter: Literal[",", ";"] = ","
    decimal: Literal[".", ","] = "."
    """Delimiter and decimal mark of the list of records."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for life in self.lives:
            self.cutter(life)
            self.planned(life)
        if len({life.tool for life in self.lives}) != len(self.lives):
            raise ValueError("Wear.lives: two tools have one name: give each a name of its own")
        if self.delimiter == self.decimal:
            raise ValueError(f"Wear.delimiter = {self.delimiter!r} is the decimal mark too")

    def cutter(self, life: PlannedLife) -> Cutter:
        """Type of the tool of a life."""
        return _named(self.cutters, life.cutter, life.tool)

    @property
    def longest(self) -> int:
        """Records over which a life is followed, so that its end is known of each tool."""
        return 2 * self.most

    def planned(self, life: PlannedLife) -> list[PlannedCut]:
        """Cuts of a life."""
        if not life.cuts:
            raise ValueError(f"Wear.lives: {life.tool} has no cuts: name at least one")
        return [_named(self.cuts, name, life.tool) for name in life.cuts]


def _named(some: tuple[Named, ...], name: str, tool: str) -> Named:
    for one in some:
        if one.name == name:
            return one
    raise ValueError(
        f"Wear.lives: {tool} has {name!r}, which is none of {', '.join(o.name for o in some)}"
    )


@dataclass(frozen=True, kw_only=True)
class ShopParameters(Ranged, section="ShopParameters"):
    """A machine of the simulated shop and the weeks to simulate."""

    machine: str
    seed: Annotated[int, Range(least=0, most=2**32 - 1)] = 1
    first_day: str = "2026-01-05"
    weeks: Annotated[int, Range(least=1, most=104)] = 3
    c_axis: bool = True
    programs: tuple[str, ...] = ("O1101", "O2040", "O3307", "O4410")
    power_scale: Annotated[float, Range(least=0.05, most=5)] = 1.0  # of the cuts
    trial_cuts: Annotated[int, Range(least=1, most=1000)] = 20
    """Parts that are cut by each program before and after it was optimised."""
    trial_drives: Annotated[int, Range(least=1, most=1000)] = 3
    """Times that the axes follow each command before and after it was corrected."""
    spindle: SpindleParameters = field(default_factory=SpindleParameters)
    shift: ShiftParameters = field(default_factory=ShiftParameters)
    air: AirParameters = field(default_factory=AirParameters)
    log: LogParameters = field(default_factory=LogParameters)
    logger: LoggerParameters = field(default_factory=LoggerParameters)
    control: ControlParameters = field(default_factory=ControlParameters)
    drives: Drives = field(default_factory=Drives)
    cutting: Cutting = field(default_factory=Cutting)
    growth: Growth = field(default_factory=Growth)
    wear: Wear = field(default_factory=Wear)

    def __post_init__(self) -> None:
        super().__post_init__()
        if date.fromisoformat(self.first_day).weekday() != 0:
            raise ValueError(f"ShopParameters.first_day = {self.first_day} must be a Monday")
        if not self.programs:
            raise ValueError("ShopParameters.programs = () must name at least one part program")

    @property
    def start(self) -> np.datetime64:
        """Midnight (UTC) at which the simulation starts [s]."""
        return np.datetime64(self.first_day, "s")

    @property
    def days(self) -> int:
        """Number of days simulated."""
        return 7 * self.weeks

    def generator(self, stream: str) -> Random:
        """Random numbers of one source of chance, independent of how much others draw."""
        words = [self.seed, *stream.encode()]
        return np.random.Generator(np.random.PCG64(words))
