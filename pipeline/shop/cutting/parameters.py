"""Parameters of the cutting tests: passes, material, end mill, dynamometer, spindle load meter.

Richer than the twin's model: the cutting force is no straight line over the chip thickness, the
edge's force grows from nothing to its full value over some micrometres, and grows with wear.  The
load meter shows the power over the rated one at that speed, P_rated min(1, n / n_base), as the
machine's own log does.  Sources of the orders of magnitude:

- Engin, Altintas: *Mechanics and dynamics of general milling cutters, part I*, Int. J. Mach. Tools
  Manuf. 41 (2001): end milling of Al 7050-T7451, 796, 169, 222 N/mm2 and 27.7, 30.8, 1.4 N/mm.
- König, Essel: *Spezifische Schnittkraftwerte für die Zerspanung metallischer Werkstoffe* (1973):
  C45, k_c1.1 of 2220 N/mm2 with an exponent of 0.14, which holds the edge's force too; radial
  forces of 0.4 to 0.5 of the tangential one.
- Budak, Altintas, Armarego: *Prediction of milling force coefficients from orthogonal cutting
  data*, J. Eng. Ind. 118 (1996): edge forces of 20 to 50 N/mm; size effect in shear and friction.
- Waldorf, DeVor, Kapoor: *A slip-line field for ploughing during orthogonal cutting*, J. Manuf.
  Sci. Eng. 120 (1998): ploughing grows until the chip is about as thick as the edge is round.
- Smithey, Kapoor, DeVor: *A worn tool force model for three-dimensional cutting operations*, Int.
  J. Mach. Tools Manuf. 40 (2000): forces of a worn flank grow as its width.
- Kline, DeVor: *The effect of runout on cutting geometry and forces in end milling*, Int. J. Mach.
  Tool Des. Res. 23 (1983): offset and tilt of the cutter's axis.
- Kistler data sheets 9257B (crosstalk up to 2 %, natural frequencies above 2 kHz, above 3 kHz along
  z, bare) and 9255C; with vise and workpiece 1 to 2.5 kHz (Girardin, Remond, Rigal: *High frequency
  correction of dynamometer for cutting force observation in milling*, J. Manuf. Sci. Eng. 132
  (2010)); charge amplifiers drift by 0.05 pC/s and more.
- Altintas: *Manufacturing Automation*, 2nd ed., ch. 5 (lag of a drive's current signal, 5 to 20 Hz
  behind its filter, less for a display); Fanuc: *AC spindle motor αi series, parameter manual*
  (B-65280EN): load meter in percent of the maximum output, its filter of some tenths of a second.
"""

from dataclasses import dataclass, field
from math import acos, pi
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged

Immersion = Literal["slot", "up", "down"]
RATE = 10000
"""Sampling rate of the dynamometer [Hz]."""
SPEEDS = (1000.0, 2000.0, 3000.0, 4500.0, 6000.0, 8000.0, 10000.0, 12000.0)


@dataclass(frozen=True, kw_only=True)
class Conditions(Ranged, section="Conditions"):
    """Depth and width of a pass, speed of the spindle, feed; a slot is as wide as the tool."""

    immersion: Immersion
    depth: Annotated[float, Range(least=0.01, most=200, unit="mm")] = 2.0
    width: Annotated[float, Range(least=0.01, most=200, unit="mm")] = 12.0
    speed: Annotated[float, Range(least=10, most=1e5, unit="rev/min")] = 4000.0
    feed: Annotated[float, Range(least=1, most=1e5, unit="mm/min")] = 600.0

    def feed_per_tooth(self, flutes: int) -> float:
        """Feed per tooth [mm]."""
        return self.feed / (self.speed * flutes)

    @property
    def removal_rate(self) -> float:
        """Material removal rate [mm3/s]."""
        return self.depth * self.width * self.feed / 60


def engaged(conditions: Conditions, diameter: float) -> tuple[float, float]:
    """Angles at which a tooth enters and leaves [rad]."""
    arc = acos(1 - 2 * min(conditions.width / diameter, 1.0))
    return (0.0, arc) if conditions.immersion == "up" else (pi - arc, pi)


@dataclass(frozen=True, kw_only=True)
class ChannelMode(Ranged, section="ChannelMode"):
    """Mode of one channel: its response to a force at each frequency."""

    frequency: Annotated[float, Range(least=200, most=2e4, unit="Hz")] = 2100.0
    damping: Annotated[float, Range(least=1e-3, most=0.5)] = 0.03


def _z() -> ChannelMode:
    return ChannelMode(frequency=2860.0, damping=0.022)


@dataclass(frozen=True, kw_only=True)
class Series(Ranged, section="Series"):
    """Tests on the dynamometer: slots and half immersions, two speeds and depths, several feeds."""

    speeds: tuple[float, ...] = (4000.0, 6000.0)
    depths: tuple[float, ...] = (2.0, 3.0)
    """Speeds [rev/min] and depths [mm]."""
    feeds: tuple[float, ...] = (0.03, 0.05, 0.08, 0.12)
    """Feeds for each tooth [mm]."""
    seconds: Annotated[float, Range(least=0.1, most=60, unit="s")] = 0.8
    """Length of a recording inside the material."""
    block: Annotated[float, Range(least=20, most=1000, unit="mm")] = 80.0
    """Length of a pass."""
    passes_between: Annotated[float, Range(least=0, most=1000)] = 1.0
    """Cuts between two tests, in passes of the test before: unrecorded wear."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, count in (("speeds", 2), ("depths", 2), ("feeds", 4)):
            values = getattr(self, name)
            if len(values) != count or min(values) <= 0:
                raise ValueError(f"Series.{name} = {values} must be {count} positive numbers")


@dataclass(frozen=True, kw_only=True)
class Dynamometer(Ranged, section="Dynamometer"):
    """The dynamometer under the workpiece and all behind it."""

    along: Literal["x", "y"] = "x"
    """Axis that points along the feed; x of the other one to the right of it."""
    axial: Literal["lift", "pressure"] = "lift"
    """Force that its z channel counts positive."""
    series: Series = field(default_factory=Series)
    x: ChannelMode = field(default_factory=ChannelMode)
    y: ChannelMode = field(default_factory=lambda: ChannelMode(frequency=1840.0, damping=0.035))
    z: ChannelMode = field(default_factory=_z)
    """Modes of its channels."""
    crosstalk: Annotated[float, Range(least=0, most=0.2)] = 0.018
    """Greatest share of a force that another channel shows."""
    speed_error: Annotated[float, Range(least=0, most=0.05)] = 1e-3
    speed_wander: Annotated[float, Range(least=0, most=0.05)] = 1e-3
    """Greatest offset of the spindle in a cut from the speed that is commanded, standard deviation
    about it."""
    depth_error: Annotated[float, Range(least=0, most=200, unit="um")] = 8.0
    """Standard deviation of the tool's length as it was measured for a test."""
    offset: Annotated[float, Range(least=0, most=100, unit="N")] = 3.0
    drift: Annotated[float, Range(least=0, most=50, unit="N/s")] = 0.8
    """Standard deviations of the amplifier from test to test."""
    noise: Annotated[float, Range(least=0, most=50, unit="N")] = 1.2
    hum: Annotated[float, Range(least=0, most=50, unit="N")] = 0.7
    mains: Annotated[float, Range(least=15, most=70, unit="Hz")] = 50.0
    range: Annotated[float, Range(least=10, most=1e5, unit="N")] = 1000.0
    low_range: Annotated[float, Range(least=1, most=1e5, unit="N")] = 320.0
    bits: Annotated[int, Range(least=8, most=24)] = 16
    """Force at the converter's end, the one that was left set too low in one test, resolution."""
    decimal: Literal[".", ","] = "."
    """Decimal mark of its files."""


PASSES = (
    Conditions(immersion="down", depth=10.0, width=6.0, speed=6000.0, feed=2160.0),
    Conditions(immersion="down", depth=10.0, width=6.0, speed=8000.0, feed=2880.0),
    Conditions(immersion="up", depth=10.0, width=6.0, speed=8000.0, feed=1920.0),
    Conditions(immersion="down", depth=8.0, width=4.0, speed=11000.0, feed=3960.0),
    Conditions(immersion="slot", depth=6.0, width=12.0, speed=6000.0, feed=1440.0),
    Conditions(immersion="slot", depth=4.0, width=12.0, speed=8000.0, feed=1440.0),
    Conditions(immersion="slot", depth=6.0, width=12.0, speed=8000.0, feed=2400.0),
    Conditions(immersion="slot", depth=4.0, width=12.0, speed=11000.0, feed=3300.0),
)


@dataclass(frozen=True, kw_only=True)
class SpindleTests(Ranged, section="SpindleTests"):
    """Passes with a cut, speeds without one, and the load meter that shows them."""

    passes: tuple[Conditions, ...] = PASSES
    """Passes of the program; shoulders that get deeper are cut in the reverse order."""
    block: Annotated[float, Range(least=20, most=1000, unit="mm")] = 150.0
    """Length of the blank."""
    speeds: tuple[float, ...] = SPEEDS
    hold: Annotated[float, Range(least=1, most=600, unit="s")] = 8.0
    """Speeds of the warm-up [rev/min], and the time of each."""
    efficiency: Annotated[float, Range(least=0.3, most=1)] = 0.94
    """Efficiency from motor to tool, of the power of the cut."""
    oil_temperature: Annotated[float, Range(least=0, most=100, unit="degC")] = 34.0
    """Oil temperature of the bearings, after the warm-up."""
    lag: Annotated[float, Range(least=0.01, most=10, unit="s")] = 0.25
    noise: Annotated[float, Range(least=0, most=20, unit="percent")] = 0.15
    step: Annotated[float, Range(least=0.01, most=10, unit="percent")] = 0.1
    """Time constant, standard deviation and resolution of the meter."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.passes or not self.speeds or min(self.speeds) <= 0:
            raise ValueError(
                "SpindleTests: there must be at least one pass and one speed above 0, got "
                f"{len(self.passes)} passes and speeds = {self.speeds} [rev/min]"
            )


@dataclass(frozen=True, kw_only=True)
class Workpiece(Ranged, section="Workpiece"):
    """The material: force of an edge for each width of chip, sharp and worn."""

    name: str = "EN AW-7050 T7451"
    tangential: Annotated[float, Range(least=50, most=1e4, unit="N/mm2")] = 796.0
    radial: Annotated[float, Range(least=0, most=1e4, unit="N/mm2")] = 169.0
    axial: Annotated[float, Range(least=0, most=1e4, unit="N/mm2")] = 222.0
    """Force for each section of chip where it is ``thickness`` thick."""
    thickness: Annotated[float, Range(least=1e-3, most=1, unit="mm")] = 0.05
    exponent: Annotated[float, Range(least=0, most=0.9)] = 0.08
    """Exponent by which that falls with the thickness: the size effect."""
    edge_tangential: Annotated[float, Range(least=0, most=500, unit="N/mm")] = 27.7
    edge_radial: Annotated[float, Range(least=0, most=500, unit="N/mm")] = 30.8
    edge_axial: Annotated[float, Range(least=-100, most=500, unit="N/mm")] = 1.4
    """Ploughing of a new edge under a thick chip."""
    ploughing: Annotated[float, Range(least=0.01, most=100, unit="um")] = 3.0
    """Thickness of the chip at which 63 % of the ploughing is there."""
    flank_pressure: Annotated[float, Range(least=0, most=1e4, unit="N/mm2")] = 330.0
    flank_friction: Annotated[float, Range(least=0, most=1.5)] = 0.35
    """Pressure and friction on the land of a worn flank."""

    @property
    def cutting(self) -> tuple[float, float, float]:
        """Cutting-force coefficients, tangential, radial, axial [Pa]."""
        return self.tangential * 1e6, self.radial * 1e6, self.axial * 1e6

    @property
    def edge(self) -> tuple[float, float, float]:
        """Edge force of a new edge, tangential, radial, axial [N/m]."""
        return self.edge_tangential * 1e3, self.edge_radial * 1e3, self.edge_axial * 1e3

    def flank(self, wear: float) -> tuple[float, float, float]:
        """Added by a land ``wear`` wide [m]; tangential, radial, axial [N/m]."""
        normal = self.flank_pressure * 1e6 * wear
        return self.flank_friction * normal, normal, 0.0


@dataclass(frozen=True, kw_only=True)
class EndMill(Ranged, section="EndMill"):
    """A right-hand end mill in its holder, with its wear.

    Flank wear is break_in (1 - exp(-L / break_in_length)) + wear_rate L after the length L in the
    material.
    """

    number: Annotated[int, Range(least=1, most=999)] = 4
    """Number in the control's tool table."""
    diameter: Annotated[float, Range(least=1, most=100, unit="mm")] = 12.0
    flutes: Annotated[int, Range(least=1, most=12)] = 3
    helix: Annotated[float, Range(least=0, most=65, unit="deg")] = 30.0
    runout: Annotated[float, Range(least=0, most=200, unit="um")] = 6.5
    runout_angle: Annotated[float, Range(least=-360, most=360, unit="deg")] = 48.0
    """Offset of its axis at the tip, and its angle from the first tooth in the sense in which the
    teeth move."""
    tilt: Annotated[float, Range(least=0, most=20, unit="um/mm")] = 0.6
    tilt_angle: Annotated[float, Range(least=-360, most=360, unit="deg")] = 165.0
    """Change of that offset with each millimetre up, and its angle."""
    sharpness: tuple[float, ...] = (1.0, 1.13, 0.87)
    """Edge force of each tooth against the mean one."""
    break_in: Annotated[float, Range(least=0, most=500, unit="um")] = 9.0
    break_in_length: Annotated[float, Range(least=0.1, most=1e4, unit="m")] = 12.0
    wear_rate: Annotated[float, Range(least=0, most=10, unit="um/m")] = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.sharpness) != self.flutes or min(self.sharpness) <= 0:
            raise ValueError(
                f"EndMill.sharpness = {self.sharpness} must have a positive value for each of the "
                f"{self.flutes} teeth"
            )

    @property
    def radius(self) -> float:
        """Radius [m]."""
        return self.diameter / 2 * 1e-3

    @property
    def helix_angle(self) -> float:
        """Helix angle [rad]."""
        return self.helix * pi / 180


@dataclass(frozen=True, kw_only=True)
class Cutting(Ranged, section="Cutting"):
    """Cutting tests of a machine: nothing of them is written unless they are ``recorded``."""

    recorded: bool = True
    workpiece: Workpiece = field(default_factory=Workpiece)
    tool: EndMill = field(default_factory=EndMill)
    dynamometer: Dynamometer = field(default_factory=Dynamometer)
    spindle: SpindleTests = field(default_factory=SpindleTests)

    def __post_init__(self) -> None:
        super().__post_init__()
        widest = max((p.width for p in self.spindle.passes), default=0.0)
        if widest > self.tool.diameter:
            raise ValueError(
                f"Cutting.spindle.passes: a width of {widest} [mm] is more than the tool's "
                f"diameter, {self.tool.diameter}"
            )
