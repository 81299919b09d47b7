"""Parameters of spindle growth: parts that expand, heat paths, shop air, logger of a test stand.

Bearings, motor, chiller and lubricant are those of the machine's spindle.  Sources of the orders
of magnitude:

- Bossmanns, Tu: *A thermal model for high speed motorized spindles*, Int. J. Mach. Tools Manuf. 39
  (1999) 1345-1366: heat paths, 10 to 30 W/K between the rings of a bearing, air gap, rotating
  surfaces; *A power flow model* (J. Manuf. Sci. Eng. 123 (2001) 494-505): share of the losses.
- Burton, Staph: *Thermally activated seizure of angular contact bearings*, ASLE Trans. 10 (1967):
  half of a bearing's heat goes into the balls, a quarter into each ring.
- Mayr et al.: *Thermal issues in machine tools*, CIRP Annals 61 (2012) 771-791: growth of spindle,
  head and column in the same measure, columns with time constants of hours.
- Cao, Holkup, Chen, He: *Study of characteristic variations of high-speed spindles induced by
  centrifugal expansion deformations*, J. Vibroeng. 13 (2011): inner rings grow more than the shaft.
- Timoshenko, Goodier: *Theory of Elasticity*, 3rd ed., art. 32 (rotating discs): a ring of radius r
  grows by rho w^2 r^3 / E.
- Incropera, DeWitt: *Fundamentals of Heat and Mass Transfer*: 3 to 6 W/m2 K of natural convection
  at 10 K, about 5 W/m2 K of radiation; steel 42 to 50, cast iron 48 to 55 W/m K; bolted joints 1e3
  to 1e4 W/m2 K, narrow gaps of air some 100 W/m2 K.
- DIN 743 and VDI 2230 tables: expansion of steel 11 to 12e-6, of grey iron 10 to 11e-6 1/K.
- IEC 60751: class A of Pt100, 0.15 K + 0.002 |T|.
- ISO 230-3: test of distortion by a rotating spindle, probe at a test bar.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged

PROFILES = 26
"""Speed profiles that are recorded."""
SENSORS = 9
"""Pt100 on the spindle, from its front to its rear."""


@dataclass(frozen=True, kw_only=True)
class Body(Ranged, section="Body"):
    """Shaft, housing, head and column as rows of cells; places are counted from the nose."""

    shaft_length: Annotated[float, Range(least=0.2, most=2, unit="m")] = 0.6
    shaft_radius: Annotated[float, Range(least=0.01, most=0.2, unit="m")] = 0.035
    bore_radius: Annotated[float, Range(least=0.001, most=0.1, unit="m")] = 0.012
    """Shaft, from its nose to its end."""
    front: Annotated[float, Range(least=0.02, most=1, unit="m")] = 0.1
    middle: Annotated[float, Range(least=0.02, most=1, unit="m")] = 0.16
    """Places of the bearings that locate the shaft."""
    motor_begin: Annotated[float, Range(least=0.05, most=1.5, unit="m")] = 0.22
    motor_end: Annotated[float, Range(least=0.1, most=1.8, unit="m")] = 0.43
    """Ends of rotor and stator."""
    rear: Annotated[float, Range(least=0.1, most=1.9, unit="m")] = 0.51
    """Place of the rear bearing."""
    rotor_radius: Annotated[float, Range(least=0.02, most=0.4, unit="m")] = 0.06
    """Outer radius of the rotor."""
    housing_radius: Annotated[float, Range(least=0.03, most=0.5, unit="m")] = 0.115
    housing_wall: Annotated[float, Range(least=0.005, most=0.1, unit="m")] = 0.028
    """Outer radius of the housing, and its wall."""
    flange: Annotated[float, Range(least=0.05, most=1.5, unit="m")] = 0.19
    """Place where the housing is bolted to the head."""
    head_length: Annotated[float, Range(least=0.1, most=2, unit="m")] = 0.3
    head_section: Annotated[float, Range(least=1e-3, most=1, unit="m2")] = 0.024
    head_perimeter: Annotated[float, Range(least=0.1, most=10, unit="m")] = 2.0
    """Head from the flange to the mean of the guide carriages."""
    column_height: Annotated[float, Range(least=0.2, most=5, unit="m")] = 0.95
    column_section: Annotated[float, Range(least=1e-3, most=1, unit="m2")] = 0.085
    column_perimeter: Annotated[float, Range(least=0.1, most=20, unit="m")] = 3.2
    """Column from the bed to the head's carriages."""
    column_share: Annotated[float, Range(least=0, most=1)] = 0.6
    """Part of the column's growth that lifts the nose away from the probe."""
    stand: Annotated[float, Range(least=0.02, most=1, unit="m")] = 0.2
    """Height of the probe's stand on the table."""

    def __post_init__(self) -> None:
        super().__post_init__()
        names = ("front", "middle", "motor_begin", "motor_end", "rear", "shaft_length")
        places = [getattr(self, name) for name in names]
        if sorted(places) != places:
            raise ValueError(
                f"Body: {', '.join(names)} = {places} [m] must follow one another from the nose "
                "to the end of the shaft"
            )
        if self.housing_wall >= self.housing_radius - self.rotor_radius:
            raise ValueError(
                f"Body.housing_wall = {self.housing_wall} [m] must leave room for the stator "
                f"between rotor_radius = {self.rotor_radius} and housing_radius = "
                f"{self.housing_radius}"
            )


@dataclass(frozen=True, kw_only=True)
class Expansion(Ranged, section="Expansion"):
    """Expansion by temperature and by speed."""

    steel: Annotated[float, Range(least=5e-6, most=25e-6, unit="1/K")] = 11.7e-6
    cast_iron: Annotated[float, Range(least=5e-6, most=25e-6, unit="1/K")] = 10.4e-6
    """Expansion of shaft, rings, housing and stand; of head and column."""
    contact_angle: Annotated[float, Range(least=10, most=45, unit="deg")] = 18.0
    """Contact angle of the locating bearings: a ring that grows by u pushes the shaft by u /
    tan."""
    ring_share: Annotated[float, Range(least=-1, most=1)] = 0.3
    """Part of that shift that the arrangement lets through: 0 where two bearings face each other
    alike, 1 where a spring takes up all of it."""
    ring_radius: Annotated[float, Range(least=0.01, most=0.2, unit="m")] = 0.038
    """Mean radius of the inner ring."""


@dataclass(frozen=True, kw_only=True)
class HeatPaths(Ranged, section="HeatPaths"):
    """Conductances and film coefficients of the network."""

    ring: Annotated[float, Range(least=0.5, most=1e3, unit="W/K")] = 40.0
    ball: Annotated[float, Range(least=0.1, most=200, unit="W/K")] = 16.0
    seat: Annotated[float, Range(least=0.5, most=1e3, unit="W/K")] = 36.0
    """Thermal conductances of one bearing: shaft to inner ring, ring to balls at rest, outer ring
    to housing."""
    mixing: Annotated[float, Range(least=0, most=10)] = 0.8
    """Increase of the balls' conductance by the lubricant at 12 000 rev/min, as n^0.5."""
    shrink_fit: Annotated[float, Range(least=10, most=1e5, unit="W/m2/K")] = 900.0
    stator_fit: Annotated[float, Range(least=10, most=1e5, unit="W/m2/K")] = 600.0
    """Rotor on shaft, stator in housing."""
    air_gap: Annotated[float, Range(least=1, most=1e3, unit="W/m2/K")] = 45.0
    """Rotor to stator at rest."""
    jacket: Annotated[float, Range(least=1, most=1e4, unit="W/m2/K")] = 850.0
    flow: Annotated[float, Range(least=1, most=1e4, unit="W/K")] = 250.0
    """Housing and stator to the jacket's liquid; its flow times specific heat."""
    bore: Annotated[float, Range(least=1, most=1e4, unit="W/m2/K")] = 45.0
    flange: Annotated[float, Range(least=0.5, most=1e3, unit="W/K")] = 22.0
    carriage: Annotated[float, Range(least=0.1, most=1e3, unit="W/K")] = 14.0
    foot: Annotated[float, Range(least=0.1, most=1e3, unit="W/K")] = 30.0
    """Housing in the head's bore; at the flange; carriages; column to bed."""
    natural: Annotated[float, Range(least=0.1, most=50, unit="W/m2/K")] = 4.0
    radiation: Annotated[float, Range(least=0, most=10, unit="W/m2/K")] = 4.5
    """Heat transfer of surfaces in air: natural convection at 10 K, as dT^1/4; radiation."""
    rotating: Annotated[float, Range(least=1, most=500, unit="W/m2/K")] = 110.0
    """Film coefficient of the nose at 12 000 rev/min, as n^2/3."""
    holder: Annotated[float, Range(least=0, most=1e4, unit="J/K")] = 550.0
    """Heat capacity of the tool holder."""
    centrifugal_load: Annotated[float, Range(least=0, most=5)] = 0.4
    """Part of the preload that centrifugal force adds at 12 000 rev/min, as n^2."""
    stand_lag: Annotated[float, Range(least=10, most=1e5, unit="s")] = 2400.0
    """Time constant of the probe's stand in air."""


@dataclass(frozen=True, kw_only=True)
class Season(Ranged, section="Season"):
    """Air about the test stand over the year of the records, with the shop's door."""

    mean: Annotated[float, Range(least=-10, most=45, unit="degC")] = 21.0
    swing: Annotated[float, Range(least=0, most=20, unit="K")] = 3.5
    scatter: Annotated[float, Range(least=0, most=10, unit="K")] = 0.8
    """Level over the year: mean, amplitude, standard deviation from record to record."""
    daily: Annotated[float, Range(least=0, most=20, unit="K")] = 1.6
    """Amplitude of the day's course, greatest at three in the afternoon."""
    wander: Annotated[float, Range(least=0, most=5, unit="K")] = 0.2
    """Standard deviation of what comes and goes within an hour."""
    doors: Annotated[float, Range(least=0, most=60, unit="1/h")] = 0.7
    drop: Annotated[float, Range(least=0, most=20, unit="K")] = 2.0
    recovery: Annotated[float, Range(least=0.5, most=300, unit="min")] = 12.0
    """Openings of the door an hour, mean fall of the air, time constant of its recovery."""


@dataclass(frozen=True, kw_only=True)
class Instruments(Ranged, section="Instruments"):
    """Logger with nine Pt100, a sensor of the air and a displacement probe, and its faults."""

    decimal: Literal[".", ","] = "."
    encoding: Literal["ascii", "cp1252"] = "ascii"
    blank: Literal["", "---"] = ""
    """Form of the files: a comma comes with semicolons; what stands where there is no value."""
    noise: Annotated[float, Range(least=0, most=2, unit="K")] = 0.06
    resolution: Annotated[float, Range(least=1e-3, most=1, unit="K")] = 0.1
    lag: Annotated[float, Range(least=0, most=600, unit="s")] = 30.0
    """Errors of the Pt100: standard deviation, step, time constant in their bore."""
    tolerance: Annotated[float, Range(least=0, most=1)] = 0.8
    """Part of class A within which their offsets lie."""
    stem: Annotated[float, Range(least=0, most=0.5)] = 0.05
    """Part of the air in what a Pt100 on a surface reads."""
    probe_noise: Annotated[float, Range(least=0, most=10, unit="um")] = 0.3
    probe_resolution: Annotated[float, Range(least=1e-3, most=5, unit="um")] = 0.1
    """Resolution of the displacement probe."""
    missing: Annotated[float, Range(least=0, most=100)] = 3.0
    """Cells without a value in a record, on average."""
    torn: Annotated[int, Range(least=0, most=PROFILES)] = 8
    """Number of the record that breaks off inside its last row, 0 for none."""
    drifting: Annotated[int, Range(least=1, most=SENSORS)] = 3
    drift_from: Annotated[int, Range(least=1, most=PROFILES)] = 11
    drift_after: Annotated[float, Range(least=0, most=8, unit="h")] = 1.4
    drift_rate: Annotated[float, Range(least=-1, most=1, unit="K/h")] = 0.055
    """Sensor that drifts, in which record it begins, after what time, how fast."""
    dead: Annotated[int, Range(least=1, most=SENSORS)] = 7
    dead_from: Annotated[int, Range(least=1, most=PROFILES)] = 13
    dead_after: Annotated[float, Range(least=0, most=8, unit="h")] = 2.2
    dead_as: Literal["open", "held", "missing"] = "open"
    """Sensor that dies, in which record, after what time; it then reads far out of range
    (``open``), its last value (``held``), or nothing (``missing``)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.drifting == self.dead:
            raise ValueError(
                f"Instruments.drifting = {self.drifting} must be another sensor than dead"
            )


@dataclass(frozen=True, kw_only=True)
class Growth(Ranged, section="Growth"):
    """Growth of the spindle and the test stand that records it; ``recorded``: whether it does."""

    recorded: bool = True
    numbers: tuple[int, ...] = tuple(range(1, PROFILES + 1))
    """Records of the year that are made, by their numbers in it."""
    body: Body = field(default_factory=Body)
    expansion: Expansion = field(default_factory=Expansion)
    paths: HeatPaths = field(default_factory=HeatPaths)
    season: Season = field(default_factory=Season)
    instruments: Instruments = field(default_factory=Instruments)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.numbers or not set(self.numbers) <= set(range(1, PROFILES + 1)):
            raise ValueError(
                f"Growth.numbers = {self.numbers} must be one or more from 1 to {PROFILES}"
            )
