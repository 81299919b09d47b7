"""The catalogue of cutting data: valid rows, no contradiction, bands of the tables it cites."""

from dataclasses import replace
from math import isclose

import numpy as np
import pytest

from pipeline.cutting.catalogue import (
    OPERATIONS,
    CatalogueRow,
    CoatingFactor,
    CuttingCatalogue,
    CuttingRange,
    Operation,
    listed_range,
)
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import Tool, ToolTable
from pipeline.parameters import read_params, structure

PARAMETERS = read_params()
CATALOGUE = structure(PARAMETERS, "catalogue", CuttingCatalogue)
MATERIALS = {
    name: structure(PARAMETERS, f"material.{name}", Material) for name in PARAMETERS["material"]
}
C45 = MATERIALS["steel_medium_carbon"]
FLAT = Tool(kind="flat", diameter_mm=10.0, flutes=4)
DRILL = Tool(kind="drill", diameter_mm=8.5, flutes=2)
FACE = Tool(kind="flat", role="face_mill", diameter_mm=63.0, flutes=5)
REAMER = Tool(kind="flat", role="reamer", diameter_mm=10.0, flutes=6, material="hss")
ROW = CatalogueRow(
    tools=("end_mill",), groups=(1, 4), operations=("roughing",), diameter_mm=(6.0, 10.0, 20.0),
    feed_mm=((0.03, 0.06), (0.05, 0.1)), cutting_speed_m_min=(100.0, 200.0), sources=("maker",),
)  # fmt: skip
SMALL = CuttingCatalogue(rows=(ROW,), sources={"maker": "A maker's table"})


def of_size(tool: Tool, diameter: float) -> Tool:
    return replace(tool, diameter_mm=diameter)


def inside(result: CuttingRange, feed: tuple[float, float], speed: tuple[float, float]) -> bool:
    """Whether both ranges are known and lie within others [mm], [m/min]."""
    f_z, v_c = result.feed_per_tooth_mm, result.cutting_speed_m_min
    return (
        f_z is not None and v_c is not None
        and feed[0] <= f_z[0] < f_z[1] <= feed[1] and speed[0] <= v_c[0] < v_c[1] <= speed[1]
    )  # fmt: skip


def found(tool: Tool, material: str, operation: Operation) -> CuttingRange:
    result = CATALOGUE.lookup(tool, MATERIALS[material], operation)
    assert result is not None, CATALOGUE.why_not(tool, MATERIALS[material], operation)
    return result


def test_a_row_is_of_the_order_of_its_tools() -> None:
    """No feed above 4 % of a shank tool's diameter, by tooth or by revolution, none in a unit
    that was mistaken: 1/25.4 of a value would lie below."""
    for row in CATALOGUE.rows:
        for (low, high), diameter in zip(row.feed_mm, row.diameter_mm, strict=False):
            assert 0.0 <= low < high, (row.words, diameter)
            assert 3e-4 * diameter < high < 0.042 * diameter, (row.words, diameter)
        if row.cutting_speed_m_min is not None:
            slow, fast = row.cutting_speed_m_min
            assert 4.0 <= slow < fast <= 1000.0, row.words
        assert all(CATALOGUE.sources[name].strip() for name in row.sources), row.words


def test_feeds_do_not_fall_with_the_diameter() -> None:
    """Thicker tools bear thicker chips; a greater face mill has a lower feed for its power."""
    for row in CATALOGUE.rows:
        if "face_mill" not in row.tools:
            tops = [high for _, high in row.feed_mm]
            assert tops == sorted(tops), row.words


def test_each_row_of_a_mill_says_how_deep_and_wide_it_is_for() -> None:
    for row in CATALOGUE.rows:
        if {"end_mill", "face_mill"} & set(row.tools) and row.operations != ("plunging",):
            assert row.radial_over_diameter is not None, row.words
            finishes = row.operations == ("finishing", "ball_finishing")
            assert finishes or row.axial_depth_mm(10.0) is not None, row.words


def test_a_face_mill_has_less_feed_over_its_whole_width() -> None:
    """Mitsubishi p. 1293: 0.008 in. up to 0.75 D, 0.006 in. beyond, below 5 mm."""
    ends = []
    for width in (0.0, 0.74, 0.75, 1.0):
        listed = CATALOGUE.lookup(FACE, C45, "face_milling", width)
        assert listed is not None and listed.feed_per_tooth_mm is not None
        assert listed.axial_depth_mm == 5.0
        ends.append(listed.feed_per_tooth_mm[1])
    assert ends == [0.203, 0.203, 0.152, 0.152]
    any_width = listed_range(CATALOGUE, C45, FACE, ("face_milling",))
    assert any_width is not None and any_width.feed_per_tooth_mm == (0.0762, 0.203)


@pytest.mark.parametrize("diameter", [1.0, 2.0, 3.0, 6.0, 8.0, 12.7, 16.0, 20.0, 25.0])
def test_a_slot_never_has_more_feed_than_a_shoulder(diameter: float) -> None:
    tool = of_size(FLAT, diameter)
    for name, material in MATERIALS.items():
        slot = CATALOGUE.lookup(tool, material, "slotting")
        shoulder = CATALOGUE.lookup(tool, material, "roughing")
        assert (slot is None) == (shoulder is None), name
        if slot is not None and shoulder is not None:
            assert slot.feed_per_tooth_mm is not None and shoulder.feed_per_tooth_mm is not None
            assert slot.feed_per_tooth_mm[1] <= shoulder.feed_per_tooth_mm[1], name


@pytest.mark.parametrize(
    ("tool", "material", "operation", "feed", "speed"),
    [
        # IMCO's M525 in steel of medium carbon, 5 flutes: slot 0.051 mm at 91 m/min (10 mm),
        # 0.0817 mm (16 mm)
        (FLAT, "steel_medium_carbon", "slotting", (0.03, 0.08), (90, 200)),
        (of_size(FLAT, 16), "steel_medium_carbon", "slotting", (0.04, 0.1), (90, 200)),
        # its finishing, 0.0708 mm at 114 m/min; a floor of 0.05 mm never needs above 0.15
        (FLAT, "steel_medium_carbon", "finishing", (0.05, 0.15), (110, 300)),
        # ISCAR, group 6, 0.003 to 0.008 D at 160 to 240 m/min; Tungaloy from 70 m/min
        (FLAT, "steel_low_alloy", "roughing", (0.025, 0.11), (60, 240)),
        # ISCAR, group 10, 0.003 to 0.008 D; IMCO 0.0587 mm at 107 m/min
        (FLAT, "steel_tool", "roughing", (0.01, 0.08), (15, 200)),
        # ISCAR, group 14, 0.002 to 0.007 D at 60 to 110 m/min
        (FLAT, "stainless_austenitic", "roughing", (0.02, 0.07), (60, 130)),
        (of_size(FLAT, 3.175), "stainless_austenitic", "roughing", (0.007, 0.018), (53, 77)),
        (FLAT, "stainless_martensitic", "slotting", (0.02, 0.07), (60, 165)),
        # IMCO, grey iron: rough 0.0652 mm at 114 m/min; ISCAR, group 15, up to 275 m/min
        (FLAT, "cast_iron_grey", "roughing", (0.04, 0.1), (110, 275)),
        # Harvey, 1/2 in. in 6061: 0.004 in. at 800 to 1500 ft/min
        (of_size(FLAT, 12.7), "A6061", "slotting", (0.03, 0.102), (240, 760)),
        (of_size(FLAT, 3.175), "A6061", "roughing", (0.012, 0.031), (240, 680)),
        # Harvey, 356 and 380: 500 to 1000 ft/min
        (of_size(FLAT, 16), "aluminium_cast", "slotting", (0.03, 0.127), (150, 360)),
        # ISCAR, group 37, 0.002 to 0.004 D at 60 to 90 m/min; Tungaloy slots from 20 m/min
        (FLAT, "titanium_alloy", "slotting", (0.02, 0.06), (20, 90)),
        (FLAT, "nickel_alloy", "roughing", (0.02, 0.05), (20, 53)),
        (of_size(FLAT, 12.7), "brass", "roughing", (0.05, 0.08), (76, 460)),
        # a ball of 8 mm, of which 0.63 mm had been asked
        (Tool(kind="ball", diameter_mm=8.0, flutes=2), "A7075", "ball_finishing", (0.05, 0.115),
         (240, 900)),
        # high-speed steel: Data Handbook 28 m/min in low-carbon steel, 100 in aluminium
        (replace(of_size(FLAT, 12.7), material="hss"), "steel_low_carbon", "roughing",
         (0.0, 0.052), (20, 40)),
        (replace(of_size(FLAT, 12.7), material="hss"), "A6061", "roughing", (0.0, 0.13),
         (70, 160)),
        # Mitsubishi, 50 to 80 mm, 0.5 to 0.75 D: 0.008 in.; ISCAR, group 2
        (FACE, "steel_medium_carbon", "face_milling", (0.1, 0.204), (120, 280)),
        (FACE, "A6061", "face_milling", (0.07, 0.255), (200, 600)),
        # Data Handbook: 115 to 125 m/min in stainless steel
        (FACE, "stainless_austenitic", "face_milling", (0.07, 0.13), (70, 160)),
        # HIT, carbide drills: 0.006 in. at 1/4 in., 88 m/min; by lip
        (DRILL, "steel_medium_carbon", "drilling", (0.05, 0.077), (40, 89)),
        (replace(DRILL, material="hss"), "steel_medium_carbon", "drilling", (0.05, 0.09),
         (21, 27)),
        (replace(DRILL, material="hss"), "A6061", "drilling", (0.05, 0.128), (60, 122)),
        # two to three times the speed of high-speed steel: Proto has 9 to 26 m/min in tool steels
        (DRILL, "steel_tool", "drilling", (0.05, 0.065), (18, 78)),
        # Etantdonnes: brass 61 m/min with high-speed steel, double with carbide
        (DRILL, "brass", "drilling", (0.05, 0.09), (120, 183)),
        # Fundamentals of Machining, table 5.4: HSS-Co 12 m/min in alpha-beta titanium
        (DRILL, "titanium_alloy", "drilling", (0.03, 0.061), (24, 40)),
        (REAMER, "steel_medium_carbon", "reaming", (0.05, 0.077), (15, 19)),
    ],
)  # fmt: skip
def test_ranges_are_those_of_the_tables(
    tool: Tool, material: str, operation: Operation,
    feed: tuple[float, float], speed: tuple[float, float],
) -> None:  # fmt: skip
    """Inside of a band that other tables than the row's own support where the comment says so."""
    result = found(tool, material, operation)
    assert inside(result, feed, speed)
    assert result.source


@pytest.mark.parametrize(
    ("tool", "group", "operation", "feed", "speed"),
    [
        # ISCAR, group 38: 40 to 80 m/min; Mitsubishi, inserts at 40 to 55 HRC: 0.1 to 0.15 mm
        (FLAT, "H38", "finishing", (0.03, 0.1), (40, 80)),
        (FLAT, "H38", "slotting", (0.01, 0.05), (20, 40)),
        # Sandvik, CoroMill Plura at 60 HRC: 40 m/min
        (FLAT, "H39", "roughing", (0.0, 0.03), (7, 40)),
        (of_size(FLAT, 3.175), "H38", "roughing", (0.005, 0.013), (7, 80)),
        # ATA, up to 12 % Si: 0.08 mm at 10 mm, 294 m/min
        (FLAT, "N25", "slotting", (0.05, 0.09), (100, 300)),
        # a trial of 2000 holes in 304 at 1/4 in.: 0.064 mm by lip, 70 m/min
        (DRILL, "M14", "drilling", (0.0, 0.064), (18, 70)),
        (Tool(kind="drill", role="spot_drill", diameter_mm=10.0, flutes=2), "P2", "centre_drilling",
         (0.02, 0.051), (100, 250)),
        # Kyocera, boring bars: 0.025 to 0.1 mm, 30 to 100 m/min; Machine Tool finishes at 0.25 mm
        (Tool(kind="flat", role="boring_bar", diameter_mm=25.0, flutes=1), "P2", "boring",
         (0.01, 0.25), (20, 140)),
    ],
)  # fmt: skip
def test_ranges_of_harder_materials_and_of_tools_for_holes(
    tool: Tool, group: str, operation: Operation,
    feed: tuple[float, float], speed: tuple[float, float],
) -> None:  # fmt: skip
    """Inside of a band that other tables than the row's own support where the comment says so."""
    of_group = replace(C45, iso=group[0], group=int(group[1:]))
    result = CATALOGUE.lookup(tool, of_group, operation)
    assert result is not None and inside(result, feed, speed)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_there_is_a_range_or_a_reason(operation: Operation) -> None:
    for name, material in MATERIALS.items():
        for tool in (FLAT, DRILL, FACE, REAMER):
            result = CATALOGUE.lookup(tool, material, operation)
            reason = CATALOGUE.why_not(tool, material, operation)
            assert (result is None) == bool(reason), (name, tool)


def test_outside_of_the_catalogue_is_said() -> None:
    brass_reamer = CATALOGUE.why_not(REAMER, MATERIALS["brass"], "reaming")
    assert brass_reamer == (
        "no row for a high-speed steel reamer of 10 mm in ISO N, group 27 of VDI 3323, reaming"
    )
    large = CATALOGUE.why_not(of_size(FLAT, 30.0), C45, "roughing")
    assert large.startswith("no row for a carbide end mill of 30 mm in ISO P, group 2")
    assert large.endswith("roughing: the catalogue has 1 to 6 mm and 6 to 25.4 mm")


@pytest.mark.parametrize("operation", ["boring", "probing", "engraving", "chamfering", "air"])
def test_operations_without_a_source_have_no_range(operation: Operation) -> None:
    assert CATALOGUE.lookup(FLAT, C45, operation) is None


def test_a_plunge_has_the_speed_of_a_slot_and_no_feed() -> None:
    plunge, slot = (found(FLAT, "steel_medium_carbon", name) for name in ("plunging", "slotting"))
    assert plunge.feed_per_tooth_mm is None
    assert plunge.cutting_speed_m_min == slot.cutting_speed_m_min


def test_only_what_keeps_or_never_raises_its_feed_has_none() -> None:
    """A row without a feed leaves it without a limit, which no other operation may be."""
    none = {name for row in CATALOGUE.rows if not row.feed_mm for name in row.operations}
    assert none == {"plunging", "tapping"}


def test_a_table_without_roles_is_understood() -> None:
    """Of a tool without a role, the operation or the size says what it is."""
    bare = {name: replace(tool, role="") for name, tool in {"face": FACE, "ream": REAMER}.items()}
    for operation in ("face_milling", "lead", "finishing"):
        plain = found(bare["face"], "A6061", operation)
        assert plain == found(FACE, "A6061", operation)
    assert found(bare["ream"], "A6061", "reaming") == found(REAMER, "A6061", "reaming")
    assert found(of_size(FLAT, 16.0), "A6061", "face_milling") == found(
        of_size(FLAT, 16.0), "A6061", "slotting"
    )
    assert CATALOGUE.lookup(replace(bare["face"], material="hss"), C45, "roughing") is None


def test_nothing_is_extrapolated_over_diameters() -> None:
    for diameter in (5.999, 20.001):
        assert SMALL.lookup(of_size(FLAT, diameter), C45, "roughing") is None
    spans = [SMALL.lookup(of_size(FLAT, d), C45, "roughing") for d in (6, 9.999, 10, 20)]
    assert [one and one.feed_per_tooth_mm for one in spans] == [
        (0.03, 0.06), (0.03, 0.06), (0.05, 0.1), (0.05, 0.1)
    ]  # fmt: skip


def test_where_rows_touch_the_tool_belongs_to_the_one_that_begins_there() -> None:
    result = found(of_size(FLAT, 6.0), "steel_medium_carbon", "slotting")
    assert result.feed_per_tooth_mm == (0.03, 0.055)


def test_a_drill_s_feed_is_shared_by_its_lips() -> None:
    two = found(DRILL, "A6061", "drilling").feed_per_tooth_mm
    three = found(replace(DRILL, flutes=3), "A6061", "drilling").feed_per_tooth_mm
    assert two is not None and three is not None
    assert isclose(2 * two[1], 3 * three[1])


def test_a_deep_hole_has_less_feed_and_speed_than_a_plain_one() -> None:
    """By the factors of the source's table from 6 D on, for each drill and material."""
    for row in (row for row in CATALOGUE.rows if row.operations == ("drilling",)):
        deep = next(
            one for one in CATALOGUE.rows if one.operations == ("deep_drilling",)
            and (one.groups, one.tool_material) == (row.groups, row.tool_material)
        )  # fmt: skip
        assert deep.diameter_mm == row.diameter_mm and "deep_holes" in deep.sources
        assert np.array(deep.feed_mm) == pytest.approx(0.8 * np.array(row.feed_mm), rel=0.01)
        assert row.cutting_speed_m_min is not None and deep.cutting_speed_m_min is not None
        assert deep.cutting_speed_m_min == pytest.approx(
            [0.6 * end for end in row.cutting_speed_m_min], rel=0.01
        )


def test_uncoated_carbide_is_slower_in_steel_alone() -> None:
    bare = replace(FLAT, coating="none")
    plain, slower = (found(tool, "steel_medium_carbon", "slotting") for tool in (FLAT, bare))
    assert slower.cutting_speed_m_min == pytest.approx((0.7 * 140, 0.7 * 180))
    assert slower.feed_per_tooth_mm == pytest.approx((0.7 * 0.035, 0.7 * 0.07))
    assert slower.source.startswith(plain.source) and "SGS" in slower.source
    assert found(bare, "A6061", "slotting") == found(FLAT, "A6061", "slotting")


def test_tables_of_the_project_are_known_to_the_catalogue() -> None:
    """Every mill and drill of conf/tool that states its range finds one beside it, and overlaps."""
    for name, values in PARAMETERS["tool"].items():
        material = C45 if name == "mill02" else MATERIALS["A6061"]
        for tool in structure({"t": values}, "t", ToolTable).tools.values():
            if tool.role == "spot_drill" or tool.feed_per_tooth_mm is None:
                continue
            operation: Operation = "face_milling" if tool.role == "face_mill" else "roughing"
            beside = CATALOGUE.lookup(tool, material, operation)
            assert beside is not None and beside.feed_per_tooth_mm is not None, tool.name
            assert max(tool.feed_per_tooth_mm[0], beside.feed_per_tooth_mm[0]) < min(
                tool.feed_per_tooth_mm[1], beside.feed_per_tooth_mm[1]
            )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"groups": (4, 1)}, r"groups = \[4, 1\] of the row for carbide end_mill"),
        ({"diameter_mm": (10.0, 6.0, 20.0)}, "must be two or more rising diameters"),
        ({"feed_mm": ((0.03, 0.06),)}, "must be 2 pairs, one for each span"),
        ({"feed_mm": ((0.03, 0.06), (0.1, 0.05))}, r"\[0.1, 0.05\] .* a least and a greater"),
        ({"cutting_speed_m_min": (200.0,)}, r"\[200.0\] .* a least and a greater value"),
        ({"feed_mm": (), "cutting_speed_m_min": None}, "neither feed nor speed"),
        ({"sources": ()}, "has no sources"),
        ({"groups": (1, 42)}, r"catalogue.rows.groups = 42 must lie from 1 to 41"),
    ],
)
def test_a_bad_row_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(ROW, **change)  # type: ignore[arg-type]


def test_rows_that_contradict_each_other_are_refused() -> None:
    other = replace(ROW, groups=(4, 9), diameter_mm=(8.0, 12.0), feed_mm=((0.1, 0.2),))
    with pytest.raises(ValueError, match=r"groups 4-9, roughing overlaps .* groups 1-4"):
        CuttingCatalogue(rows=(ROW, other), sources={"maker": "A table"})
    touching = replace(other, diameter_mm=(20.0, 25.0))
    CuttingCatalogue(rows=(ROW, touching), sources={"maker": "A table"})


def test_sources_are_cited_and_used() -> None:
    with pytest.raises(ValueError, match="source 'maker' is not cited"):
        CuttingCatalogue(rows=(ROW,), sources={"maker": " "})
    with pytest.raises(ValueError, match="no row has source 'other'"):
        CuttingCatalogue(rows=(ROW,), sources={"maker": "A table", "other": "Another"})
    factor = CoatingFactor(
        tools=("end_mill",), tool_material="carbide", coatings=("TiN",), speed=1.2, source="it"
    )
    with pytest.raises(ValueError, match="source 'it' is not cited"):
        CuttingCatalogue(rows=(ROW,), coatings=(factor,), sources={"maker": "A table"})
