"""The tool: a milling cutter or a drill, its stiffness at the tip, and the tool table of a machine.

Catalogues speak millimetre and degree, so do the fields; the properties are in SI, for formulas.
Usual sizes are those of the tools on sale, micro tools and gun drills among them (catalogues of
Sandvik Coromant, Tungaloy, Mitsubishi and botek), rounded outwards: what lies outside of them is
either rare or written in metre, inch, or another unit than the table's.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.limits import ENDLESS, check_change
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.si import DEGREE, MM, UM

LEAD_ANGLE = 45.0
"""Usual cutting edge angle of face mills [deg]."""

Kind = Literal["flat", "bull_nose", "ball", "drill"]
Role = Literal[
    "", "face_mill", "spot_drill", "centre_drill", "reamer", "tap", "thread_mill", "chamfer_mill",
    "boring_bar", "engraver", "probe", "countersink", "counterbore",
]  # fmt: skip
"""Purpose of a tool, where the form of its end does not show it."""
Length = Annotated[float, Range(least=0.01, most=1000.0)]
"""Length on a tool [mm]."""


@dataclass(frozen=True, kw_only=True)
class Tool(Ranged, section="tool"):
    """Milling cutter or drill."""

    kind: Kind
    """Form of its end."""
    role: Role = ""
    """Purpose, where that is neither plain milling nor drilling: ``face_mill``, ``spot_drill``,
    ``centre_drill``, ``reamer``, ``tap``, ``thread_mill``, ``chamfer_mill``, ``boring_bar``,
    ``engraver``, ``probe``, ``countersink`` or ``counterbore``. Geometry goes by ``kind``."""
    diameter_mm: Length
    """D over the cutting edges [mm]."""
    flutes: Annotated[int, Range(least=1, most=200)]
    """Number of teeth N."""
    helix_deg: Annotated[float, Range(least=-75.0, most=75.0)] = 0.0
    """Helix angle of the edges [deg]; positive for a right-hand helix."""
    corner_radius_mm: Annotated[float, Range(least=0.0, most=500.0)] = 0.0
    """Corner radius of a bull-nose end mill [mm]; a ball's is D / 2, others have none."""
    point_angle_deg: Annotated[float, Range(least=30.0, most=180.0)] = 140.0
    """Point angle of a drill, the whole angle [deg]."""
    cutting_edge_angle_deg: Annotated[float, Range(least=1.0, most=90.0)] | None = None
    """Tool cutting edge angle kappa_r of a mill, between its edge and the surface that it makes
    (ISO 3002-1), the lead angle of face mills [deg]; by default 45 of a ``face_mill``, 90 of
    others.  It makes chips thinner; forces are those of 90."""
    flute_length_mm: Length | None = None
    """Length that can cut [mm]."""
    stickout_mm: Annotated[float, Range(least=0.1, most=3000.0)] | None = None
    """Stickout from the holder's face to the tip [mm]; needed for the deflection."""
    shank_diameter_mm: Length | None = None
    """[mm]; the tool's diameter by default.  A wider one begins where the flutes end."""
    holder_diameter_mm: Length | None = None
    """Diameter of the holder at its face, the underside of all that is above the stickout [mm]."""
    youngs_modulus_GPa: Annotated[float, Range(least=1.0, most=2000.0)] = 600.0
    """Young's modulus [GPa]: about 600 for cemented carbide, 210 for high-speed steel."""
    runout_um: Annotated[float, Range(least=0.0, most=2000.0)] = 0.0
    """Distance of the tool's axis from the spindle's [um]."""
    runout_deg: Annotated[float, Range(least=-360.0, most=360.0)] = 0.0
    """Angle of that offset from the first tooth, in the sense of the tooth's motion [deg]."""
    material: Literal["carbide", "hss"] = "carbide"
    """Cutting material; chooses a material's constants of tool life."""
    coating: str = ""
    """Coating by its maker's name, "TiAlN", "TiN", "DLC"; "none" without one, "" if unspecified."""
    price: Annotated[float, Range(least=0.0, most=1e12)] = 0.0
    """Price of a new tool, or of an insert's set of edges, in the currency of the costs."""
    edges: Annotated[int, Range(least=1, most=1000)] = 1
    """Lives that one price buys (regrinds, edges of an insert)."""
    feed_per_tooth_mm: tuple[float, ...] | None = None
    cutting_speed_m_min: tuple[float, ...] | None = None
    """Least and greatest that its maker allows in the material that is cut: f_z of each tooth or
    lip [mm], v_c at the full diameter [m/min]."""
    change: Annotated[tuple[float, ...], Range(above=0.0, most=1e6)] | None = None
    """F, S and the feed for each tooth over those programmed, least and greatest [1]; by default
    that of the part's limits."""
    top_speed_rpm: Annotated[float, Range(least=1.0, most=1e6)] | None = None
    """Greatest spindle speed that its maker, or its holder's, allows [rev/min]."""
    limit_load_N: Annotated[float, Range(above=0.0, below=ENDLESS, unit="N")] | None = None
    limit_deflection_um: Annotated[float, Range(above=0.0, below=ENDLESS, unit="um")] | None = None
    limit_torque_Nm: Annotated[float, Range(above=0.0, below=ENDLESS, unit="N m")] | None = None
    """Greatest load across its axis [N], deflection of its tip [um] and torque [N m]; by default
    those of the part's limits."""
    flank_wear_um: Annotated[float, Range(least=0.0, most=2000.0)] | None = None
    """Flank wear VB that it has now, as measured [um]."""
    name: str = ""
    """Name for readers."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, high in _SPANS.items():
            _check_span(name, getattr(self, name), high)
        if self.change is not None:
            check_change("tool.change", self.change)
        if self.kind == "bull_nose" and not 0 < self.corner_radius_mm <= self.diameter_mm / 2:
            raise ValueError(
                f"tool.corner_radius_mm = {self.corner_radius_mm} of a bull-nose end mill must be "
                f"above 0 and at most half of its diameter, {self.diameter_mm / 2:g}"
            )
        if self.kind != "bull_nose" and self.corner_radius_mm:
            raise ValueError(
                f"tool.corner_radius_mm = {self.corner_radius_mm} does not go with kind "
                f"{self.kind!r}: leave it out, or write kind: bull_nose"
            )

    @property
    def diameter(self) -> float:
        """D [m]."""
        return self.diameter_mm * MM

    @property
    def radius(self) -> float:
        """R = D / 2 [m]."""
        return self.diameter / 2

    @property
    def corner_radius(self) -> float:
        """Corner radius of the end [m]: 0 for a flat end, R for a ball."""
        return self.radius if self.kind == "ball" else self.corner_radius_mm * MM

    @property
    def helix(self) -> float:
        """Helix angle [rad]."""
        return self.helix_deg * DEGREE

    @property
    def point_angle(self) -> float:
        """Point angle of a drill [rad]."""
        return self.point_angle_deg * DEGREE

    @property
    def cutting_edge_angle(self) -> float:
        """kappa_r of a mill [rad]."""
        usual = LEAD_ANGLE if self.role == "face_mill" else 90.0
        return (self.cutting_edge_angle_deg or usual) * DEGREE

    @property
    def runout(self) -> float:
        """[m]."""
        return self.runout_um * UM

    @property
    def runout_angle(self) -> float:
        """[rad]."""
        return self.runout_deg * DEGREE

    @property
    def stickout(self) -> float | None:
        """[m]."""
        return None if self.stickout_mm is None else self.stickout_mm * MM

    @property
    def shank_diameter(self) -> float:
        """[m]."""
        shank = self.diameter_mm if self.shank_diameter_mm is None else self.shank_diameter_mm
        return shank * MM

    @property
    def load_known(self) -> bool:
        """Whether its forces are computed: not those of a thread mill's profile."""
        return self.role != "thread_mill"

    @property
    def youngs_modulus(self) -> float:
        """[Pa]."""
        return self.youngs_modulus_GPa * 1e9


_SPANS = {"feed_per_tooth_mm": 10.0, "cutting_speed_m_min": 10_000.0}
"""Greatest value of each span that a maker allows; the least is 0."""


def _check_span(name: str, span: tuple[float, ...] | None, high: float) -> None:
    if span is not None and not (len(span) == 2 and 0.0 <= span[0] <= span[1] <= high and span[1]):
        raise ValueError(
            f"tool.{name} = {list(span)} must be two numbers from 0 to {high:g}, the least first, "
            "the greatest above 0"
        )


@dataclass(frozen=True, kw_only=True)
class ToolTable:
    """Tools by their non-negative number, at least one."""

    tools: dict[int, Tool]
    """Tools by their number in the program."""
    description: str = ""
    """Owner of the tools, for readers."""

    def __post_init__(self) -> None:
        if not self.tools:
            raise ValueError("the tool table is empty: write its tools as `tools: {1: {...}}`")
        for number in self.tools:
            if number < 0:
                raise ValueError(f"tools.{number} is no tool number: it must be 0 or more")


def tool_limits(
    tools: Sequence[Tool], name: str, of_part: float | None, outside: Collection[int] = ()
) -> Floats:
    """Limit of each tool: its own, else that of the part; infinite where there is none.

    ``name`` is the part's limit, one of ``BY_TOOL``, ``of_part`` its value in the unit of the name;
    no limit holds for tools whose index is ``outside``.
    """
    limits = np.full(len(tools), np.inf if of_part is None else of_part, dtype=np.float64)
    for index, tool in enumerate(tools):
        limits[index] = getattr(tool, f"limit_{name}") or limits[index]
        if not tool.load_known or index in outside:
            limits[index] = np.inf
    return limits


FLUTED = 0.8
"""Effective diameter of a fluted part over its outer one [1] (Kops and Vo 1990)."""


def tip_stiffness(tool: Tool) -> float:
    """Stiffness of the tip across the axis [N/m]: a cantilever of a fluted part and a shank.

    NaN without the tool's stickout.  Holder and spindle count as rigid, the force as one on the
    tip: of an end mill in its holder alone, a bound for cuts that reach up the flute.

    1 / k = l_f^3 / (3 E I_f) + (l^3 - l_f^3) / (3 E I_s), with I = pi d^4 / 64, the fluted length
    l_f (all of the stickout l where the tool has none) and the diameters 0.8 D and the shank's.

    Examples
    --------
    A rod of carbide 10 mm thick, 40 mm long, with next to no flutes:

    >>> rod = Tool(kind="flat", diameter_mm=10.0, flutes=2, stickout_mm=40.0, flute_length_mm=0.01)
    >>> round(tip_stiffness(rod) / (3 * 600e9 * np.pi * 0.01**4 / 64 / 0.04**3), 6)
    1.0
    """
    if tool.stickout is None:
        return float("nan")
    fluted = tool.stickout
    if tool.flute_length_mm is not None:
        fluted = min(tool.flute_length_mm * 1e-3, tool.stickout)
    compliance = fluted**3 / _rigidity(tool, FLUTED * tool.diameter)
    compliance += (tool.stickout**3 - fluted**3) / _rigidity(tool, tool.shank_diameter)
    return 1.0 / compliance


def tip_deflection(tool: Tool, force: ArrayLike) -> Floats:
    """Deflection of the tip under a force across the axis [m]; NaN without the tool's stickout.

    Parameters
    ----------
    tool : Tool
        Tool with its stickout.
    force : array_like
        Across the axis [N], any shape.
    """
    return np.asarray(force, dtype=np.float64) / tip_stiffness(tool)


def _rigidity(tool: Tool, diameter: float) -> float:
    """3 E I [N m^2]."""
    return float(3 * tool.youngs_modulus * np.pi * diameter**4 / 64)


LENGTH = {"metre": 1000.0, "inch": 25.4}
"""Millimetre in one unit that lengths of tools are given in."""
ANGLE = {"radian": 57.29578}
"""Degree in one unit that angles are given in."""
MICRO = {"mm": 1000.0, "metre": 1e6, "inch": 25_400.0}
"""Micrometre in one unit that runout and wear are given in."""
UsualRange = tuple[str, float | None, float, float, str, dict[str, float]]
"""Field, its value, least and greatest usual value, their words, other units in the field's."""


@dataclass(frozen=True)
class OddSize:
    """Value of a tool that no usual tool has."""

    field: str
    """Its name in the tool table."""
    value: float
    """Value as in the tool table."""
    reason: str
    """Finding, as the end of a sentence."""
    units: tuple[str, ...] = ()
    """Units in which the value would be usual."""
    beside: str = ""
    """Field that it does not go with; empty where the value is odd by itself."""

    @property
    def remedy(self) -> str:
        """Remedy, as a sentence."""
        meant = f"; {' or '.join(self.units)} seems to be meant" if self.units else ""
        fields = f"{self.field} and {self.beside}" if self.beside else self.field
        return f"Check {fields} and its unit{meant}; leave it where the tool is of that size."


def odd_sizes(tool: Tool) -> tuple[OddSize, ...]:
    """Values of ``tool`` outside of what is usual, at most one of each field.

    Absolute sizes are compared first, then ratios to the diameter.

    Examples
    --------
    A tool of 16 mm whose diameter alone is in metre:

    >>> odd = odd_sizes(Tool(kind="flat", diameter_mm=0.016, flutes=3, flute_length_mm=3.0))
    >>> [(one.field, one.value, one.units) for one in odd]
    [('diameter_mm', 0.016, ('metre', 'inch'))]
    """
    odd: dict[str, OddSize] = {}
    usual = [*((row, "") for row in _absolute_ranges(tool)), *_relative_ranges(tool)]
    for (field, value, least, most, words, units), beside in usual:
        if value is None or least <= value <= most:
            continue
        meant = tuple(unit for unit, factor in units.items() if least <= value * factor <= most)
        side, bound = ("below", least) if value < least else ("above", most)
        size = OddSize(field, value, f"{side} the {bound:.3g} {words}", meant, beside)
        odd.setdefault(field, size)
    if "diameter_mm" in odd:  # ratios to it say nothing more
        return tuple(size for size in odd.values() if size.beside != "diameter_mm")
    return tuple(odd.values())


def _absolute_ranges(tool: Tool) -> list[UsualRange]:
    least, most = (20.0, 500.0) if tool.role == "face_mill" else (0.1, 200.0)
    speed = tool.cutting_speed_m_min
    mm, degrees = "mm of usual tools", "degrees of usual tools"
    return [
        ("diameter_mm", tool.diameter_mm, least, most, mm, LENGTH),
        ("flute_length_mm", tool.flute_length_mm, 0.05, 600.0, mm, LENGTH),
        ("stickout_mm", tool.stickout_mm, 3.0, 600.0, mm, LENGTH),
        ("shank_diameter_mm", tool.shank_diameter_mm, 1.0, 100.0, "mm of usual shanks", LENGTH),
        ("youngs_modulus_GPa", tool.youngs_modulus_GPa, 60.0, 1200.0,
         "GPa of steel, carbide and diamond", {"10^6 psi": 6.894757}),
        ("helix_deg", abs(tool.helix_deg) or None, 1.4, 75.0, degrees, ANGLE),
        ("runout_um", tool.runout_um or None, 0.1, 300.0, "um of usual holders", MICRO),
        ("flank_wear_um", tool.flank_wear_um or None, 2.0, 1000.0, "um of worn tools", MICRO),
        ("top_speed_rpm", tool.top_speed_rpm, 100.0, inf, "rev/min of usual tools",
         {"rev/s": 60.0}),
        ("cutting_speed_m_min", None if speed is None else speed[1], 1.5, inf,
         "m/min of usual tools", {"m/s": 60.0}),
    ]  # fmt: skip


def _relative_ranges(tool: Tool) -> list[tuple[UsualRange, str]]:
    """Ranges that depend on another size, as ranges of the value itself, and that size's field."""
    diameter, flutes, f_z = tool.diameter_mm, tool.flute_length_mm, tool.feed_per_tooth_mm
    drill, insert = tool.kind == "drill", tool.role != "" or tool.flutes >= 10 or diameter > 16
    thick = max(diameter, tool.shank_diameter_mm or diameter)
    short, long = 0.005 if insert else 0.15, 60.0 if drill else 15.0
    corner = tool.corner_radius_mm if tool.kind == "bull_nose" else None
    near, beside = f"mm that go with a diameter of {diameter:g} mm", "diameter_mm"
    rows: list[tuple[str, float | None, float, float, str, str]] = [
        ("flute_length_mm", flutes, short * diameter, long * diameter, near, beside),
        ("stickout_mm", tool.stickout_mm, 0.3 * diameter, (60.0 if drill else 25.0) * thick, near,
         beside),
        ("stickout_mm", tool.stickout_mm, 0.7 * (flutes or 0.0), inf,
         f"mm that go with flutes of {flutes or 0.0:g} mm", "flute_length_mm"),
        ("shank_diameter_mm", tool.shank_diameter_mm, 0.1 * diameter, max(4.0 * diameter, 12.0),
         near, beside),
        ("corner_radius_mm", corner, 0.004 * diameter, inf, near, beside),
        ("feed_per_tooth_mm", None if f_z is None else f_z[1], 0.0005 * min(diameter, 20.0),
         0.25 * diameter, near, beside),
    ]  # fmt: skip
    return [((a, b, c, d, words, LENGTH), beside) for a, b, c, d, words, beside in rows]
