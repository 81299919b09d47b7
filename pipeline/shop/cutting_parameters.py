"""What the simulated shop cuts with and into: material, end mill, its runout and its wear.

Richer than the twin's law: the cutting force is no straight line over the chip's thickness, the
edge's force grows from nothing to its full value over some micrometres, and grows with wear.
Sources of the orders of magnitude:

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
"""

from dataclasses import dataclass, field
from math import pi

from pipeline.shop.dynamometer_parameters import Dynamometer
from pipeline.shop.ranges import Ranged, quantity
from pipeline.shop.spindle_load_parameters import SpindleTests


@dataclass(frozen=True, kw_only=True)
class Workpiece(Ranged):
    """The material: force of an edge for each width of chip, sharp and worn.

    Parameters
    ----------
    tangential, radial, axial : float
        Force for each section of chip where it is ``thickness`` thick.
    exponent : float
        By which that falls with the thickness: the size effect.
    edge_tangential, edge_radial, edge_axial : float
        Ploughing of a new edge under a thick chip.
    ploughing : float
        Thickness of the chip at which 63 % of it is there.
    flank_pressure, flank_friction : float
        On the land of a worn flank.
    """

    name: str = "EN AW-7050 T7451"
    tangential: float = quantity(796.0, "N/mm2", 50, 1e4)
    radial: float = quantity(169.0, "N/mm2", 0, 1e4)
    axial: float = quantity(222.0, "N/mm2", 0, 1e4)
    thickness: float = quantity(0.05, "mm", 1e-3, 1)
    exponent: float = quantity(0.08, "1", 0, 0.9)
    edge_tangential: float = quantity(27.7, "N/mm", 0, 500)
    edge_radial: float = quantity(30.8, "N/mm", 0, 500)
    edge_axial: float = quantity(1.4, "N/mm", -100, 500)
    ploughing: float = quantity(3.0, "um", 0.01, 100)
    flank_pressure: float = quantity(330.0, "N/mm2", 0, 1e4)
    flank_friction: float = quantity(0.35, "1", 0, 1.5)

    @property
    def cutting(self) -> tuple[float, float, float]:
        """Tangential, radial, axial [Pa]."""
        return self.tangential * 1e6, self.radial * 1e6, self.axial * 1e6

    @property
    def edge(self) -> tuple[float, float, float]:
        """Of a new edge, tangential, radial, axial [N/m]."""
        return self.edge_tangential * 1e3, self.edge_radial * 1e3, self.edge_axial * 1e3

    def flank(self, wear: float) -> tuple[float, float, float]:
        """Added by a land ``wear`` wide [m]; tangential, radial, axial [N/m]."""
        normal = self.flank_pressure * 1e6 * wear
        return self.flank_friction * normal, normal, 0.0


@dataclass(frozen=True, kw_only=True)
class EndMill(Ranged):
    """A right-hand end mill in its holder, and how it wears.

    Parameters
    ----------
    number : int
        In the control's tool table.
    runout, runout_angle : float
        Offset of its axis at the tip, and its angle from the first tooth in the sense in which the
        teeth move.
    tilt, tilt_angle : float
        By how much that offset changes with each millimetre up, and where to.
    sharpness : tuple of float
        Edge force of each tooth against the mean one.
    break_in, break_in_length, wear_rate : float
        Flank wear is break_in (1 - exp(-L / break_in_length)) + wear_rate L after the length L in
        the material.

    Raises
    ------
    ValueError
        When a value is out of its range or ``sharpness`` does not have one value for each tooth.
    """

    number: int = quantity(4, "1", 1, 999)
    diameter: float = quantity(12.0, "mm", 1, 100)
    flutes: int = quantity(3, "1", 1, 12)
    helix: float = quantity(30.0, "deg", 0, 65)
    runout: float = quantity(6.5, "um", 0, 200)
    runout_angle: float = quantity(48.0, "deg", -360, 360)
    tilt: float = quantity(0.6, "um/mm", 0, 20)
    tilt_angle: float = quantity(165.0, "deg", -360, 360)
    sharpness: tuple[float, ...] = (1.0, 1.13, 0.87)
    break_in: float = quantity(9.0, "um", 0, 500)
    break_in_length: float = quantity(12.0, "m", 0.1, 1e4)
    wear_rate: float = quantity(0.05, "um/m", 0, 10)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.sharpness) != self.flutes or min(self.sharpness) <= 0:
            raise ValueError(
                f"EndMill.sharpness = {self.sharpness} must have a positive value for each of the "
                f"{self.flutes} teeth"
            )

    @property
    def radius(self) -> float:
        """[m]."""
        return self.diameter / 2 * 1e-3

    @property
    def helix_angle(self) -> float:
        """[rad]."""
        return self.helix * pi / 180


@dataclass(frozen=True, kw_only=True)
class Cutting(Ranged):
    """Cutting tests of a machine: nothing of them is written unless they are ``recorded``.

    Raises
    ------
    ValueError
        When a test takes more of the tool's width than there is.
    """

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
