"""Parameters of tool lives: cutters, cuts, wear rate, sensors of force, vibration and emission.

Sources of the orders of magnitude:

- Usui, Shirakashi, Kitagawa: *Analytical prediction of cutting tool wear*, Wear 100 (1984):
  dW/dt = C_1 σ v exp(-C_2 / θ), C_2 of 5302 K for carbide in carbon steel below 1150 K.
- Cook: *Tool wear and tool life*, J. Eng. Ind. 95 (1973); Shaw: *Metal cutting principles*, 2nd
  ed., ch. 9 and 12: temperature as v^0.4, less by the feed; a land that heats itself ends the life.
- ISO 8688-2:1989, tool life testing in end milling: flank wear VB 1 uniform over the teeth, 0.3 mm
  of carbide as the end of life, 0.2 mm in finishing; steps of the measurement below 10 % of it.
- Wager, Barash: *Study of the distribution of the life of HSS tools*, J. Eng. Ind. 93 (1971);
  Rossetto, Levi: *Fracture and wear as factors affecting stochastic tool-life models*, J. Eng. Ind.
  99 (1977): lives of one batch scatter by a coefficient of variation of 0.15 to 0.35.
- Smithey, Kapoor, DeVor (2000), see :mod:`pipeline.shop.cutting.parameters`: a worn flank adds a
  force that grows as its width.
- Dornfeld, Kannatey-Asibu: *Acoustic emission during orthogonal metal cutting*, Int. J. Mech. Sci.
  22 (1980): the signal's rms is the square root of the rate of work; Kannatey-Asibu, Dornfeld: *A
  study of tool wear using statistical analysis of metal-cutting acoustic emission*, Wear 76 (1982):
  the flank's share grows with the land; coupling changes from mounting to mounting.
- Harris, Kotzalas: *Rolling bearing analysis*, ch. 1: pass frequencies of balls, multiples of the
  speed that are no whole numbers.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged

CHANNELS = 7
"""Forces x, y, z, accelerations x, y, z, envelope of the acoustic emission."""


@dataclass(frozen=True, kw_only=True)
class Cutter(Ranged, section="Cutter"):
    """A type of end mill; each tool of it has a runout and edges of its own."""

    name: str
    """Name in the tool store."""
    diameter: Annotated[float, Range(least=1, most=100, unit="mm")] = 12.0
    flutes: Annotated[int, Range(least=1, most=12)] = 4
    helix: Annotated[float, Range(least=0, most=65, unit="deg")] = 38.0
    runout: Annotated[float, Range(least=0, most=100, unit="um")] = 5.0
    tilt: Annotated[float, Range(least=0, most=20, unit="um/mm")] = 0.5
    """Usual offset of the axis at the tip and its change over the height."""
    edge_scatter: Annotated[float, Range(least=0, most=0.4)] = 0.08
    """Standard deviation of the teeth's edge forces."""


@dataclass(frozen=True, kw_only=True)
class PlannedCut(Ranged, section="PlannedCut"):
    """A cut of the programs in which tools wear: a slot is as wide as the tool."""

    name: str
    immersion: Literal["slot", "up", "down"] = "down"
    depth: Annotated[float, Range(least=0.05, most=100, unit="mm")] = 4.0
    width: Annotated[float, Range(least=0.05, most=100, unit="mm")] = 3.0
    cutting_speed: Annotated[float, Range(least=5, most=2e3, unit="m/min")] = 130.0
    feed_per_tooth: Annotated[float, Range(least=1e-3, most=1, unit="mm")] = 0.05


@dataclass(frozen=True, kw_only=True)
class PlannedLife(Ranged, section="PlannedLife"):
    """One tool from new to worn: its type, cuts by turns, speed, how often it is recorded."""

    tool: str
    """Name of this very tool."""
    cutter: str
    """Type of the tool."""
    cuts: tuple[str, ...]
    """Cuts that it makes, one after another."""
    records: Annotated[int, Range(least=1, most=500)] | None = None
    """Number of records of a tool that is still in the spindle; None for a whole life."""
    speed: Annotated[float, Range(least=0.2, most=3)] = 1.0
    """Factor on the cutting speed of its cuts."""
    interval: Annotated[float, Range(least=0.05, most=100, unit="min")] = 2.5
    """Time in the cut between two records."""


@dataclass(frozen=True, kw_only=True)
class WearRate(Ranged, section="WearRate"):
    """Rate of flank wear, as Usui has it, with scatter."""

    rate: Annotated[float, Range(least=0.01, most=50, unit="um/min")] = 2.6
    """Rate of a tooth without a land at ``cutting_speed`` and ``feed_per_tooth`` in a slot."""
    cutting_speed: Annotated[float, Range(least=5, most=2e3, unit="m/min")] = 130.0
    feed_per_tooth: Annotated[float, Range(least=1e-3, most=1, unit="mm")] = 0.05
    temperature: Annotated[float, Range(least=400, most=1600, unit="K")] = 1050.0
    activation: Annotated[float, Range(least=0, most=4e4, unit="K")] = 5302.0
    """Temperature of the flank there, and activation of the wear."""
    speed_exponent: Annotated[float, Range(least=0, most=1)] = 0.4
    feed_exponent: Annotated[float, Range(least=0, most=1)] = 0.2
    """Exponents by which the temperature rises with cutting speed and feed per tooth."""
    land_heating: Annotated[float, Range(least=0, most=5, unit="1/mm")] = 0.8
    """Share by which a land raises the temperature."""
    break_in: Annotated[float, Range(least=0, most=150, unit="um")] = 28.0
    break_in_time: Annotated[float, Range(least=0.05, most=60, unit="min")] = 2.5
    """Wear of a sharp edge, and the time that it takes."""
    tool_scatter: Annotated[float, Range(least=0, most=1)] = 0.2
    tooth_scatter: Annotated[float, Range(least=0, most=1)] = 0.1
    """Standard deviation of the rate's logarithm from tool to tool, from tooth to tooth."""
    hardness_scatter: Annotated[float, Range(least=0, most=0.5)] = 0.04
    batch: Annotated[float, Range(least=0.5, most=1e4, unit="min")] = 25.0
    """Scatter from batch to batch of the material, and mean time in the cut of a batch."""
    hardness_exponent: Annotated[float, Range(least=0, most=10)] = 2.5
    """Exponent of the rate over the hardness."""


@dataclass(frozen=True, kw_only=True)
class Mode(Ranged, section="Mode"):
    """A mode of spindle, tool or table that one accelerometer sees."""

    frequency: Annotated[float, Range(least=10, most=2e4, unit="Hz")]
    damping: Annotated[float, Range(least=1e-3, most=0.5)] = 0.04
    mass: Annotated[float, Range(least=0.05, most=1e5, unit="kg")] = 4.0


@dataclass(frozen=True, kw_only=True)
class Sensors(Ranged, section="Sensors"):
    """The measuring chain of seven channels and the files of its data-acquisition system."""

    rate: Annotated[int, Range(least=2000, most=50000, unit="Hz")] = 10000
    seconds: Annotated[float, Range(least=0.1, most=10, unit="s")] = 0.5
    plate: tuple[float, ...] = (2100.0, 1840.0, 2860.0)
    plate_damping: Annotated[float, Range(least=1e-3, most=0.5)] = 0.03
    """Natural frequencies of the dynamometer with vise and workpiece [Hz], and their damping."""
    x: tuple[Mode, ...] = (
        Mode(frequency=92.0, damping=0.05, mass=900.0),
        Mode(frequency=790.0, mass=9.0),
        Mode(frequency=1640.0, damping=0.03, mass=3.5),
    )
    y: tuple[Mode, ...] = (
        Mode(frequency=74.0, damping=0.06, mass=1100.0),
        Mode(frequency=830.0, mass=8.0),
        Mode(frequency=1590.0, damping=0.03, mass=3.8),
    )
    z: tuple[Mode, ...] = (
        Mode(frequency=118.0, damping=0.05, mass=1500.0),
        Mode(frequency=1210.0, damping=0.035, mass=14.0),
    )
    """Modes that the accelerometers at the spindle's nose see."""
    mounting: Annotated[float, Range(least=1000, most=2e4, unit="Hz")] = 4100.0
    mounting_damping: Annotated[float, Range(least=1e-3, most=0.9)] = 0.08
    """Resonance of an accelerometer on its magnet."""
    across: Annotated[float, Range(least=0, most=1)] = 0.12
    """Share of the force along x that y shows, and vice versa."""
    unbalance: Annotated[float, Range(least=0, most=100, unit="m/s2")] = 1.1
    """Acceleration at the speed of the spindle at 6000 rev/min; it grows as the square."""
    bearing: tuple[tuple[float, float], ...] = ((7.21, 0.35), (9.79, 0.25), (14.42, 0.2))
    """Multiples of the speed, and their amplitudes at 6000 rev/min [m/s2]."""
    shear: Annotated[float, Range(least=0, most=1, unit="V2/W")] = 2.0e-4
    flank: Annotated[float, Range(least=0, most=1, unit="V2/W")] = 3.5e-4
    """Square of the envelope for each rate of work in the chip and at the flank."""
    lag: Annotated[float, Range(least=1e-4, most=1, unit="s")] = 1.2e-3
    """Time constant of the detector of the envelope."""
    speckle: Annotated[float, Range(least=0, most=2)] = 0.25
    """Relative standard deviation of the envelope from row to row."""
    bursts: Annotated[float, Range(least=0, most=1e4, unit="1/s")] = 60.0
    burst: Annotated[float, Range(least=0, most=10, unit="V")] = 0.05
    """Bursts by breaking chips, and their mean height."""
    coupling: Annotated[float, Range(least=0, most=2)] = 0.15
    """Standard deviation of the logarithm of the emission from mounting to mounting; it also creeps
    by half of that over a life."""
    gain: Annotated[float, Range(least=0, most=0.5)] = 0.01
    """Standard deviation of the other channels from mounting to mounting."""
    noise: tuple[float, ...] = (1.5, 1.5, 1.5, 0.6, 0.6, 0.6, 0.003)
    offset: tuple[float, ...] = (4.0, 4.0, 4.0, 0.05, 0.05, 0.05, 0.01)
    drift: tuple[float, ...] = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.002)
    ranges: tuple[float, ...] = (2500.0, 2500.0, 1000.0, 500.0, 500.0, 500.0, 5.0)
    """Standard deviations of noise [unit of the channel], offset and drift over a second from
    record to record; ends of the converter."""
    hum: Annotated[float, Range(least=0, most=50, unit="N")] = 0.8
    mains: Annotated[float, Range(least=15, most=70, unit="Hz")] = 50.0
    """Amplitude and frequency of the mains hum in the forces."""
    bits: Annotated[int, Range(least=8, most=24)] = 16
    """Resolution of the converter."""
    columns: tuple[str, ...] = ("Fx", "Fy", "Fz", "Ax", "Ay", "Az", "AE_env")
    units: tuple[str, ...] = ("N", "N", "N", "m/s^2", "m/s^2", "m/s^2", "V")
    factors: tuple[float, ...] = (1.0,) * CHANNELS
    """Columns and units as the files have them, and factors from N, m/s2 and V to those units."""
    lost: Annotated[int, Range(least=1, most=CHANNELS)] = 5
    lost_from: Annotated[int, Range(least=1, most=1000)] = 9
    lost_count: Annotated[int, Range(least=0, most=1000)] = 2
    """Channel that a loose plug takes out, the record (from 1) of the first life from which on, and
    how many; 0 records for none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        wanted = ("noise", "offset", "drift", "ranges", "columns", "units", "factors")
        for name in wanted:
            if len(getattr(self, name)) != CHANNELS:
                raise ValueError(
                    f"Sensors.{name} = {getattr(self, name)} must have {CHANNELS} values, one for "
                    "each channel"
                )
        if len(self.plate) != 3 or min(self.plate) <= 0:
            raise ValueError(f"Sensors.plate = {self.plate} must be 3 frequencies above 0 Hz")


@dataclass(frozen=True, kw_only=True)
class Microscope(Ranged, section="Microscope"):
    """Measurement of the land: mean of all teeth, after some cuts only."""

    error: Annotated[float, Range(least=0, most=50, unit="um")] = 2.5
    step: Annotated[float, Range(least=0.01, most=50, unit="um")] = 1.0
    """Standard deviation, and the unit in which it is written down."""
    every: Annotated[int, Range(least=1, most=100)] = 3
    """Records from one measurement to the next; the first record is measured too."""
    forgotten: Annotated[float, Range(least=0, most=0.9)] = 0.06
    """Share of the measurements that were not written down."""
    changed_at: Annotated[float, Range(least=20, most=2000, unit="um")] = 215.0
    """Reading at which the tool is taken out."""


CUTS = (
    PlannedCut(name="slot roughing", immersion="slot", depth=2.0, feed_per_tooth=0.045),
    PlannedCut(name="side roughing", depth=6.0, width=3.0, feed_per_tooth=0.06),
    PlannedCut(name="side finishing", depth=8.0, width=0.8, cutting_speed=150.0),
)
CUTTERS = (
    Cutter(name="EM12Z4"),
    Cutter(name="EM10Z4", diameter=10.0, helix=35.0, runout=4.0, edge_scatter=0.1),
)


def _life(
    tool: str, cutter: str, cuts: tuple[str, str], speed: float, interval: float,
    records: int | None = None,
) -> PlannedLife:  # fmt: skip
    return PlannedLife(
        tool=tool, cutter=cutter, cuts=cuts, speed=speed, interval=interval, records=records
    )


SLOT, SIDE, FINISH = (one.name for one in CUTS)
LIVES = (
    _life("T21", "EM12Z4", (SLOT, SIDE), 1.0, 4.0),
    _life("T22", "EM12Z4", (SIDE, FINISH), 1.1, 5.0),
    _life("T23", "EM12Z4", (SLOT, FINISH), 0.92, 5.0),
    _life("T24", "EM12Z4", (SIDE, SLOT), 1.05, 4.0),
    _life("T25", "EM12Z4", (FINISH, SIDE), 0.97, 6.0),
    _life("T31", "EM10Z4", (SLOT, SIDE), 1.08, 3.0),
    _life("T32", "EM10Z4", (SIDE, FINISH), 1.0, 5.0),
    _life("T33", "EM10Z4", (SIDE, SLOT), 0.95, 3.5),
    _life("T26", "EM12Z4", (SLOT, SIDE), 1.02, 4.0, records=10),
    _life("T34", "EM10Z4", (SIDE, FINISH), 1.04, 5.0, records=8),
)
