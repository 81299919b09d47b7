"""Feed and cutting-speed ranges of a tool: tool table, limits of the part, catalogue.

The tool table goes first, then the limits of the part, then the catalogue; feed for each tooth and
cutting speed each have the first that knows them.
"""

from collections.abc import Sequence

from pipeline.cutting.catalogue import CuttingCatalogue, CuttingRange, Operation, Span
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import Tool

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
    f_z, v_c = _pair(tool.feed_per_tooth_mm), _pair(tool.cutting_speed_m_min)
    sources = [] if f_z is None and v_c is None else ["tool table"]
    if v_c is None and cutting_speed_m_min is not None:
        v_c = _pair(cutting_speed_m_min)
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
    known = [span for span in spans if span is not None]
    if not known:
        return None
    return min(low for low, _ in known), max(high for _, high in known)


def _pair(span: Sequence[float] | None) -> Span | None:
    return None if span is None else (span[0], span[1])
