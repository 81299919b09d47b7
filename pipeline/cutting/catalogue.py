"""Catalogue of cutting data: feed per tooth and cutting speed by tool, material and operation.

Every row is a range of a public table, with its source.  A row holds for its kinds of tool, its
tool material, its groups of VDI 3323, its operations and its diameters; nothing is extrapolated, so
a combination that no row covers is outside of the catalogue.

Ranges are starting values of tool makers: the greatest value is what a maker recommends at most,
the least one is where rubbing or a built-up edge is expected.  They are no property of a tool: its
own range in the tool table goes first, then the limits of the part, then the catalogue; feed for
each tooth and cutting speed each have the first that knows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Literal, get_args

from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import Tool
from pipeline.schema.ranges import Range, Ranged

Operation = Literal[
    "roughing", "slotting", "finishing", "face_milling", "ball_finishing", "ramping", "plunging",
    "drilling", "centre_drilling", "countersinking", "counterboring", "deep_drilling", "reaming",
    "boring", "tapping", "thread_milling", "chamfering", "engraving", "probing", "lead", "air",
]  # fmt: skip
"""Kind of cut, in the terms of cutting-data tables."""

OPERATIONS: tuple[Operation, ...] = get_args(Operation)

SLOTTING_IMMERSION = 0.4
"""Radial depth over diameter from which on a cut has the values of a slot [1], as the tables of
Tungaloy's solid end mills have it."""

ToolType = Literal[
    "end_mill", "ball_end_mill", "face_mill", "drill", "spot_drill", "centre_drill", "reamer",
    "tap", "thread_mill", "chamfer_mill", "boring_bar", "engraver", "probe", "countersink",
    "counterbore",
]  # fmt: skip
"""Kinds of tool in tables of cutting data."""

_BY_FORM: dict[str, ToolType] = {
    "flat": "end_mill", "bull_nose": "end_mill", "ball": "ball_end_mill", "drill": "drill",
}  # fmt: skip


_BY_OPERATION: dict[Operation, ToolType] = {
    "reaming": "reamer", "tapping": "tap", "thread_milling": "thread_mill",
    "centre_drilling": "spot_drill", "countersinking": "countersink",
    "counterboring": "counterbore",
}  # fmt: skip
Span = tuple[float, float]
"""Least and greatest value."""
SOLID = 32.0
"""Greatest diameter of a solid carbide end mill in makers' ranges [mm]; greater mills that are not
ball-nosed hold inserts."""


def tool_type(tool: Tool, operation: Operation) -> ToolType:
    """Kind of tool by which cutting data are listed.

    The tool's role; where the tool table gives none, by the operation, or else by the end form and
    the size.

    Examples
    --------
    >>> tool_type(Tool(kind="flat", diameter_mm=10.0, flutes=6), "reaming")
    'reamer'
    >>> tool_type(Tool(kind="flat", diameter_mm=50.0, flutes=5), "lead")
    'face_mill'
    """
    if tool.role:
        return tool.role
    if operation in _BY_OPERATION:
        return _BY_OPERATION[operation]
    large = tool.material == "carbide" and tool.diameter_mm > SOLID
    return "face_mill" if large and tool.kind in ("flat", "bull_nose") else _BY_FORM[tool.kind]


@dataclass(frozen=True, kw_only=True)
class CuttingRange:
    """Range of cutting data for one tool in one material and operation."""

    feed_per_tooth_mm: Span | None
    """Least and greatest f_z [mm]; of a drill for each lip.  The least is 0 where the source has an
    upper value only.  None where the source has none."""
    cutting_speed_m_min: Span | None
    """Least and greatest v_c at the full diameter [m/min]; None where the source has none."""
    axial_depth_mm: float | None = None
    """Greatest a_p that they are for [mm]; None where the source has none."""
    radial_over_diameter: Span | None = None
    """Least and greatest a_e over D that they are for [1]; None where the source has none."""
    sources: tuple[str, ...]
    """Whose tables they are."""

    @property
    def makers(self) -> str:
        """The sources by their first words."""
        return ", ".join(dict.fromkeys(source.partition(",")[0] for source in self.sources))

    @property
    def source(self) -> str:
        """Sources in words; empty without any."""
        return "; ".join(self.sources)


@dataclass(frozen=True, kw_only=True)
class CatalogueRow(Ranged, section="catalogue.rows"):
    """Rows of a cutting-data table: one line of feeds over the diameter, one range of speed."""

    tools: tuple[ToolType, ...]
    """Kinds of tool that it is for."""
    tool_material: Literal["carbide", "hss"] = "carbide"
    """Cutting material."""
    groups: Annotated[tuple[int, ...], Range(least=1, most=41)]
    """First and last group of VDI 3323."""
    operations: tuple[Operation, ...]
    """Operations that it is for."""
    diameter_mm: Annotated[tuple[float, ...], Range(least=0.01, most=1000.0)]
    """N + 1 rising edges of N spans of diameter [mm]: a tool belongs to the span that begins at or
    below its diameter; the last edge belongs to the last span."""
    feed_mm: Annotated[tuple[tuple[float, ...], ...], Range(least=0.0, most=10.0)] = ()
    """Least and greatest feed in each span [mm]; none where the source has none."""
    feed_per: Literal["tooth", "revolution"] = "tooth"
    """Reference of ``feed_mm``."""
    cutting_speed_m_min: Annotated[tuple[float, ...], Range(least=0.0, most=10_000.0)] | None = None
    """Least and greatest v_c [m/min]."""
    axial_over_diameter: Annotated[float, Range(above=0.0, most=100.0)] | None = None
    axial_mm: Annotated[float, Range(above=0.0, most=1000.0)] | None = None
    """Greatest a_p that the values hold for, over D [1], or as it is [mm]; None if not given."""
    radial_over_diameter: Annotated[tuple[float, ...], Range(least=0.0, most=1.0)] | None = None
    """Least and greatest a_e over D that the values hold for [1]; None where none is given."""
    sources: tuple[str, ...]
    """Names among the sources of the catalogue."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("tools", "operations", "sources"):
            if not getattr(self, name):
                raise ValueError(f"catalogue: {self.words} has no {name}: name at least one")
        if len(self.groups) != 2 or self.groups[0] > self.groups[1]:
            self._refuse("groups", self.groups, "the first and the last group of VDI 3323")
        edges = self.diameter_mm
        if len(edges) < 2 or any(low >= high for low, high in pairwise(edges)):
            self._refuse("diameter_mm", edges, "two or more rising diameters")
        if self.feed_mm and len(self.feed_mm) != len(edges) - 1:
            self._refuse("feed_mm", self.feed_mm, f"{len(edges) - 1} pairs, one for each span")
        speeds = () if self.cutting_speed_m_min is None else (self.cutting_speed_m_min,)
        widths = () if self.radial_over_diameter is None else (self.radial_over_diameter,)
        for span in (*self.feed_mm, *speeds, *widths):
            if len(span) != 2 or not span[0] < span[1]:
                self._refuse("a range", span, "a least and a greater value")
        if not self.feed_mm and not speeds:
            raise ValueError(f"catalogue: {self.words} has neither feed nor speed: leave it out")

    def _refuse(self, name: str, value: tuple[object, ...], wanted: str) -> None:
        raise ValueError(f"catalogue: {name} = {list(value)} of {self.words} must be {wanted}")

    @property
    def words(self) -> str:
        """The row, for messages."""
        return (
            f"the row for {self.tool_material} {', '.join(self.tools)} in groups "
            f"{'-'.join(map(str, self.groups))}, {', '.join(self.operations)}"
        )

    def fits(self, tool: Tool, material: Material, operation: Operation) -> bool:
        """Whether the row is for such tools, whatever the diameter."""
        return (
            tool_type(tool, operation) in self.tools
            and tool.material == self.tool_material
            and self.groups[0] <= material.group <= self.groups[1]
            and operation in self.operations
        )

    def span(self, diameter_mm: float) -> int | None:
        """Index of the span of a diameter [mm]; None outside of all."""
        edges = self.diameter_mm
        if not edges[0] <= diameter_mm <= edges[-1]:
            return None
        return min(sum(edge <= diameter_mm for edge in edges), len(edges) - 1) - 1

    def holds_at(self, width: float) -> bool:
        """Whether the row is for that a_e over D, beginning with its least one [1]."""
        low, high = self.radial_over_diameter or (0.0, 1.0)
        return low <= width < high or width == high == 1.0

    def axial_depth_mm(self, diameter_mm: float) -> float | None:
        """Greatest a_p of a tool of that diameter [mm]; None where none is given."""
        over, deep = self.axial_over_diameter, self.axial_mm
        known = [deep] if over is None else [deep, over * diameter_mm]
        return min((one for one in known if one is not None), default=None)

    def overlaps(self, other: "CatalogueRow") -> bool:
        """Whether some tool, material and operation belongs to both rows.

        Rows that touch in a diameter or a width do not overlap: the tool belongs to the one that
        begins there.
        """
        mine, others = (one.radial_over_diameter or (0.0, 1.0) for one in (self, other))
        return (
            bool(set(self.tools) & set(other.tools))
            and bool(set(self.operations) & set(other.operations))
            and self.tool_material == other.tool_material
            and max(self.groups[0], other.groups[0]) <= min(self.groups[1], other.groups[1])
            and max(self.diameter_mm[0], other.diameter_mm[0])
            < min(self.diameter_mm[-1], other.diameter_mm[-1])
            and max(mine[0], others[0]) < min(mine[1], others[1])
        )


@dataclass(frozen=True, kw_only=True)
class CoatingFactor(Ranged, section="catalogue.coatings"):
    """Feed and speed of tools with a coating over those of the rows."""

    tools: tuple[ToolType, ...]
    """Kinds of tool that it is for."""
    tool_material: Literal["carbide", "hss"]
    """Cutting material."""
    coatings: tuple[str, ...]
    """Coatings as in the tool table; ``none`` is an uncoated tool."""
    groups: Annotated[tuple[int, int], Range(least=1, most=41)] = (1, 41)
    """First and last group of VDI 3323."""
    feed: Annotated[float, Range(above=0.0, most=10.0)] = 1.0
    speed: Annotated[float, Range(above=0.0, most=10.0)] = 1.0
    """Factors on both ends of a range [1]."""
    source: str
    """Name among the sources of the catalogue."""

    def fits(self, tool: Tool, material: Material, operation: Operation) -> bool:
        """Whether it is for that tool in that material and operation."""
        return (
            tool_type(tool, operation) in self.tools
            and tool.material == self.tool_material
            and tool.coating.lower() in {coating.lower() for coating in self.coatings}
            and self.groups[0] <= material.group <= self.groups[1]
        )


@dataclass(frozen=True, kw_only=True)
class CuttingCatalogue:
    """Cutting data of public tables, free of contradictions, every source in use."""

    rows: tuple[CatalogueRow, ...]
    """No two of them hold for the same tool, material and operation."""
    sources: dict[str, str]
    """Name of a source -> its citation."""
    coatings: tuple[CoatingFactor, ...] = field(default_factory=tuple)
    """Applied to the rows; a tool whose coating is not said has the values of the rows."""

    def __post_init__(self) -> None:
        named = {name for row in self.rows for name in row.sources}
        named |= {factor.source for factor in self.coatings}
        for name in sorted(named):
            if not self.sources.get(name, "").strip():
                raise ValueError(f"catalogue: source {name!r} is not cited: add it to the sources")
        for name in self.sources.keys() - named:
            raise ValueError(f"catalogue: no row has source {name!r}: leave it out")
        for index, row in enumerate(self.rows):
            for other in self.rows[:index]:
                if row.overlaps(other):
                    raise ValueError(
                        f"catalogue: {row.words} overlaps {other.words}: make one of both"
                    )

    def lookup(
        self, tool: Tool, material: Material, operation: Operation, width: float = 0.0
    ) -> CuttingRange | None:
        """Feed per tooth and cutting speed, a_e over D by default the narrowest; None if absent."""
        found = self._row(tool, material, operation, width)
        if found is None:
            return None
        row, span = found
        factor = next((one for one in self.coatings if one.fits(tool, material, operation)), None)
        by_feed, by_speed = (1.0, 1.0) if factor is None else (factor.feed, factor.speed)
        if row.feed_per == "revolution":
            by_feed /= tool.flutes
        names = row.sources if factor is None else (*row.sources, factor.source)
        return CuttingRange(
            feed_per_tooth_mm=_scaled(row.feed_mm[span] if row.feed_mm else None, by_feed),
            cutting_speed_m_min=_scaled(row.cutting_speed_m_min, by_speed),
            axial_depth_mm=row.axial_depth_mm(tool.diameter_mm),
            radial_over_diameter=_scaled(row.radial_over_diameter),
            sources=tuple(self.sources[name] for name in dict.fromkeys(names)),
        )

    def why_not(self, tool: Tool, material: Material, operation: Operation) -> str:
        """Why there is no range, in words; "" where there is one."""
        if self._row(tool, material, operation) is not None:
            return ""
        kind = f"{_MATERIAL[tool.material]} {tool_type(tool, operation).replace('_', ' ')}"
        rows = [row for row in self.rows if row.fits(tool, material, operation)]
        spans = " and ".join(
            f"{row.diameter_mm[0]:g} to {row.diameter_mm[-1]:g} mm"
            for row in sorted(rows, key=lambda row: row.diameter_mm)
        )
        return (
            f"no row for a {kind} of {tool.diameter_mm:g} mm in ISO {material.iso}, group "
            f"{material.group} of VDI 3323, {operation.replace('_', ' ')}"
            f"{f': the catalogue has {spans}' if rows else ''}"
        )

    def by_width(
        self, tool: Tool, material: Material, operation: Operation
    ) -> tuple[CuttingRange, ...]:
        """Ranges of a tool, the narrowest cuts first; the next begins where one ends."""
        found: list[CuttingRange] = []
        one = self.lookup(tool, material, operation)
        while one is not None and one not in found:
            found.append(one)
            if one.radial_over_diameter is None:
                break
            one = self.lookup(tool, material, operation, one.radial_over_diameter[1])
        return tuple(found)

    def _row(
        self, tool: Tool, material: Material, operation: Operation, width: float = 0.0
    ) -> tuple[CatalogueRow, int] | None:
        """The row of a tool and its span of diameter; of rows that touch there, the upper one."""
        found = [
            (row, span)
            for row in self.rows
            if row.fits(tool, material, operation)
            and row.holds_at(width)
            and (span := row.span(tool.diameter_mm)) is not None
        ]
        return max(found, key=lambda one: one[0].diameter_mm[0], default=None)


_MATERIAL = {"carbide": "carbide", "hss": "high-speed steel"}


def _scaled(span: Sequence[float] | None, factor: float = 1.0) -> Span | None:
    return None if span is None else (span[0] * factor, span[1] * factor)


LIKE: dict[Operation, tuple[Operation, ...]] = {
    name: ("roughing", "finishing", "ball_finishing", "face_milling")
    for name in ("lead", "ramping", "plunging", "finishing", "ball_finishing")
}
"""Operations whose values hold where the catalogue has none for one, the first that it has."""


def tool_range(
    tool: Tool, listed: CuttingRange | None = None,
    *, cutting_speed_m_min: Sequence[float] | None = None,
) -> CuttingRange:  # fmt: skip
    """Feed and cutting-speed ranges of a tool, with their sources.

    The tool table's own ranges go first, then ``cutting_speed_m_min`` of the part's limits, then
    what the catalogue has (:func:`listed_range`).
    """
    f_z, v_c = _scaled(tool.feed_per_tooth_mm), _scaled(tool.cutting_speed_m_min)
    sources = [] if f_z is None and v_c is None else ["tool table"]
    if v_c is None and cutting_speed_m_min is not None:
        v_c = _scaled(cutting_speed_m_min)
        sources.append("limits")
    axial = radial = None
    if listed is not None and (f_z is None or v_c is None):
        if f_z is None:  # the depth and width are those of the row whose feed it is
            axial, radial = listed.axial_depth_mm, listed.radial_over_diameter
        f_z, v_c = f_z or listed.feed_per_tooth_mm, v_c or listed.cutting_speed_m_min
        sources += listed.sources
    return CuttingRange(
        feed_per_tooth_mm=f_z, cutting_speed_m_min=v_c, axial_depth_mm=axial,
        radial_over_diameter=radial, sources=tuple(sources),
    )  # fmt: skip


def listed_range(
    catalogue: CuttingCatalogue, material: Material, tool: Tool, operations: Sequence[Operation]
) -> CuttingRange | None:
    """Catalogue range of a tool in a material; None where it has none.

    Entries and ramps are cut at the speed of the cut that they lead to, so that where they have no
    row they have its values.

    Of several operations, and of several widths of cut, the range is the widest, from the least to
    the greatest of all that have one.
    """
    found = [one for name in operations for one in by_width(catalogue, material, tool, name)]
    if len(found) < 2:
        return found[0] if found else None
    return CuttingRange(
        feed_per_tooth_mm=_widest([one.feed_per_tooth_mm for one in found]),
        cutting_speed_m_min=_widest([one.cutting_speed_m_min for one in found]),
        sources=tuple(dict.fromkeys(name for one in found for name in one.sources)),
    )


def by_width(
    catalogue: CuttingCatalogue, material: Material, tool: Tool, operation: Operation
) -> tuple[CuttingRange, ...]:
    """Ranges of one operation, or of the first similar operation with data; narrow cuts first."""
    names = (operation, *LIKE.get(operation, ()))
    ranges = (catalogue.by_width(tool, material, name) for name in names)
    return next((found for found in ranges if found), ())


def _widest(spans: Sequence[Span | None]) -> Span | None:
    ends = [end for span in spans if span is not None for end in span]
    return (min(ends), max(ends)) if ends else None
