"""Plausibility of tool sizes: values of a tool table in a wrong unit.

The ranges are those of the tools on sale, micro tools and gun drills among them (catalogues of
Sandvik Coromant, Tungaloy, Mitsubishi and botek), rounded outwards: what lies outside of them is
either rare or written in metre, inch, or another unit than the table's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from pipeline.cutting.tool import Tool

LENGTH = {"metre": 1000.0, "inch": 25.4}
"""Millimetre in one unit that lengths of tools are given in."""
ANGLE = {"radian": 57.29578}


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


@dataclass(frozen=True)
class _Usual:
    """Usual range of one field, ``units`` being what else it may have been written in."""

    field: str
    value: float | None
    least: float
    most: float
    words: str
    units: dict[str, float]
    beside: str = ""

    def odd(self) -> OddSize | None:
        if self.value is None or self.least <= self.value <= self.most:
            return None
        meant = tuple(u for u, factor in self.units.items() if self._holds(self.value * factor))
        short = self.value < self.least
        bound = self.least if short else self.most
        reason = f"{'below' if short else 'above'} the {bound:.3g} {self.words}"
        return OddSize(self.field, self.value, reason, meant, self.beside)

    def _holds(self, value: float) -> bool:
        return self.least <= value <= self.most


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
    found: dict[str, OddSize] = {}
    for usual in (*_absolute(tool), *_relative(tool)):
        odd = usual.odd()
        if odd is not None:
            found.setdefault(odd.field, odd)
    if "diameter_mm" in found:  # ratios to it say nothing more
        return tuple(one for one in found.values() if one.beside != "diameter_mm")
    return tuple(found.values())


def _absolute(tool: Tool) -> Iterator[_Usual]:
    least, most = (20.0, 500.0) if tool.role == "face_mill" else (0.1, 200.0)
    yield _Usual("diameter_mm", tool.diameter_mm, least, most, "mm of usual tools", LENGTH)
    yield _Usual("flute_length_mm", tool.flute_length_mm, 0.05, 600.0, "mm of usual tools", LENGTH)
    yield _Usual("stickout_mm", tool.stickout_mm, 3.0, 600.0, "mm of usual tools", LENGTH)
    yield _Usual("shank_diameter_mm", tool.shank_diameter_mm, 1.0, 100.0, "mm of usual shanks",
                 LENGTH)  # fmt: skip
    yield _Usual("youngs_modulus_GPa", tool.youngs_modulus_GPa, 60.0, 1200.0,
                 "GPa of steel, carbide and diamond", {"10^6 psi": 6.894757})  # fmt: skip
    helix = abs(tool.helix_deg)
    yield _Usual("helix_deg", helix or None, 1.4, 75.0, "degrees of usual tools", ANGLE)
    micro = {"mm": 1000.0, "metre": 1e6, "inch": 25_400.0}
    yield _Usual("runout_um", tool.runout_um or None, 0.1, 300.0, "um of usual holders", micro)
    yield _Usual(
        "flank_wear_um", tool.flank_wear_um or None, 2.0, 1000.0, "um of worn tools", micro
    )
    yield _Usual("top_speed_rpm", tool.top_speed_rpm, 100.0, inf, "rev/min of usual tools",
                 {"rev/s": 60.0})  # fmt: skip
    if tool.cutting_speed_m_min is not None:
        yield _Usual("cutting_speed_m_min", tool.cutting_speed_m_min[1], 1.5, inf,
                     "m/min of usual tools", {"m/s": 60.0})  # fmt: skip


def _relative(tool: Tool) -> Iterator[_Usual]:
    """Ranges that depend on the tool's other sizes, as ranges of the value itself."""
    diameter = tool.diameter_mm
    drill, insert = tool.kind == "drill", tool.role != "" or tool.flutes >= 10 or diameter > 16

    def beside_diameter(field: str, value: float | None, least: float, most: float) -> _Usual:
        words = f"mm that go with a diameter of {diameter:g} mm"
        return _Usual(field, value, least, most, words, LENGTH, "diameter_mm")

    thick = max(diameter, tool.shank_diameter_mm or diameter)
    yield beside_diameter(
        "flute_length_mm", tool.flute_length_mm,
        (0.005 if insert else 0.15) * diameter, (60.0 if drill else 15.0) * diameter,
    )  # fmt: skip
    yield beside_diameter(
        "stickout_mm", tool.stickout_mm, 0.3 * diameter, (60.0 if drill else 25.0) * thick
    )
    if (flutes := tool.flute_length_mm) is not None:
        words = f"mm that go with flutes of {flutes:g} mm"
        yield _Usual(
            "stickout_mm", tool.stickout_mm, 0.7 * flutes, inf, words, LENGTH, "flute_length_mm"
        )
    yield beside_diameter(
        "shank_diameter_mm", tool.shank_diameter_mm, 0.1 * diameter, max(4.0 * diameter, 12.0)
    )
    if tool.kind == "bull_nose":
        yield beside_diameter("corner_radius_mm", tool.corner_radius_mm, 0.004 * diameter, inf)
    if tool.feed_per_tooth_mm is not None:
        low, high = 0.0005 * min(diameter, 20.0), 0.25 * diameter
        yield beside_diameter("feed_per_tooth_mm", tool.feed_per_tooth_mm[1], low, high)
