"""The tool: a milling cutter or a drill, as a tool table says it.

Catalogues speak millimetre and degree, so do the fields; the properties are in SI, for formulas.
"""

from dataclasses import dataclass, fields
from math import pi
from typing import Literal

MM = 1e-3
UM = 1e-6
DEGREE = pi / 180

Kind = Literal["flat", "bull_nose", "ball", "drill"]


@dataclass(frozen=True, kw_only=True)
class Tool:
    """One tool.

    Parameters
    ----------
    kind : {"flat", "bull_nose", "ball", "drill"}
        Form of its end.
    diameter_mm : float
        D over the cutting edges [mm].
    flutes : int
        Number of teeth N.
    helix_deg : float
        Helix angle of the edges [deg]; positive for a right-hand helix.
    corner_radius_mm : float
        Of a bull-nose end mill [mm]; a ball's is D / 2, others have none.
    point_angle_deg : float
        Of a drill, the whole angle [deg].
    flute_length_mm : float, optional
        Length that can cut [mm].
    stickout_mm : float, optional
        From the holder's face to the tip [mm]; without it no deflection is known.
    shank_diameter_mm : float, optional
        [mm]; the tool's diameter by default.
    youngs_modulus_GPa : float
        Of the tool [GPa]: about 600 for cemented carbide, 210 for high-speed steel.
    runout_um : float
        Distance of the tool's axis from the spindle's [um].
    runout_deg : float
        Angle of that offset from the first tooth, in the sense of the tooth's motion [deg].
    material : {"carbide", "hss"}
        Cutting material; chooses a material's constants of tool life.
    price : float
        Of a new tool, or of an insert's set of edges, in the currency of the costs.
    edges : int
        Lives that one price buys (regrinds, edges of an insert).
    feed_per_tooth_mm, cutting_speed_m_min : tuple of float, optional
        Least and greatest that its maker allows in the material that is cut: f_z of each tooth or
        lip [mm], v_c at the full diameter [m/min].
    top_speed_rpm : float, optional
        What its maker, or its holder's, lets it turn at most [rev/min].
    name : str
        For people.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    kind: Kind
    diameter_mm: float
    flutes: int
    helix_deg: float = 0.0
    corner_radius_mm: float = 0.0
    point_angle_deg: float = 140.0
    flute_length_mm: float | None = None
    stickout_mm: float | None = None
    shank_diameter_mm: float | None = None
    youngs_modulus_GPa: float = 600.0
    runout_um: float = 0.0
    runout_deg: float = 0.0
    material: Literal["carbide", "hss"] = "carbide"
    price: float = 0.0
    edges: int = 1
    feed_per_tooth_mm: tuple[float, ...] | None = None
    cutting_speed_m_min: tuple[float, ...] | None = None
    top_speed_rpm: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None or item.name not in _RANGES:
                continue
            low, high = _RANGES[item.name]
            if not low <= value <= high:
                raise ValueError(
                    f"tool.{item.name} = {value} is out of its range, {low:g} to {high:g}"
                )
        for name, high in _SPANS.items():
            _check_span(name, getattr(self, name), high)
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
        """Of the end's corner [m]: 0 for a flat end, R for a ball."""
        return self.radius if self.kind == "ball" else self.corner_radius_mm * MM

    @property
    def helix(self) -> float:
        """Helix angle [rad]."""
        return self.helix_deg * DEGREE

    @property
    def point_angle(self) -> float:
        """Of a drill [rad]."""
        return self.point_angle_deg * DEGREE

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
    def youngs_modulus(self) -> float:
        """[Pa]."""
        return self.youngs_modulus_GPa * 1e9


_RANGES: dict[str, tuple[float, float]] = {
    "diameter_mm": (0.01, 1000.0),
    "flutes": (1, 200),
    "helix_deg": (-75.0, 75.0),
    "corner_radius_mm": (0.0, 500.0),
    "point_angle_deg": (30.0, 180.0),
    "flute_length_mm": (0.01, 1000.0),
    "stickout_mm": (0.1, 3000.0),
    "shank_diameter_mm": (0.01, 1000.0),
    "youngs_modulus_GPa": (1.0, 2000.0),
    "runout_um": (0.0, 2000.0),
    "runout_deg": (-360.0, 360.0),
    "price": (0.0, 1e12),
    "edges": (1, 1000),
    "top_speed_rpm": (1.0, 1e6),
}
_SPANS = {"feed_per_tooth_mm": 10.0, "cutting_speed_m_min": 10_000.0}
"""Least and greatest of what a maker allows, and what neither passes."""


def _check_span(name: str, span: tuple[float, ...] | None, high: float) -> None:
    if span is not None and not (len(span) == 2 and 0.0 <= span[0] <= span[1] <= high and span[1]):
        raise ValueError(
            f"tool.{name} = {list(span)} must be two numbers from 0 to {high:g}, the least first, "
            "the greatest above 0"
        )
