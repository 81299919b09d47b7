"""Operations of rows, in programs as process engineers write them and in small ones."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.app.tables import read_catalogue, read_material
from pipeline.cutting.catalogue import OPERATIONS, listed_range
from pipeline.cutting.engagement.stock import Box
from pipeline.cutting.tool import Tool
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.gcode.setup import Tool as Register
from pipeline.optimisation.operation_signs import drills_on_one_side
from pipeline.optimisation.operations import Operations, operations, operations_without_cut
from pipeline.optimisation.practice import practice_of
from pipeline.optimisation.problem.arrays import Practice
from pipeline.schema.limits import CutLimit, MachiningPractice
from pipeline.twin.control import planned_program
from pipeline.twin.cut.blocks import cut_blocks
from pipeline.twin.cut.loads import Cut, CutJob, cut_program
from tests.gcode.following import follow
from tests.optimisation.machinist import PROGRAMS, tools_of
from tests.twin.cut_parts import CONTROL, LAW, cut_of

FLAT = Tool(kind="flat", diameter_mm=10.0, flutes=4)
SPOT = Tool(kind="drill", diameter_mm=10.0, flutes=2, point_angle_deg=120.0)
STOCKS = {
    "fitting": Box(x_mm=(0, 70), y_mm=(0, 50), z_mm=(-30, 0.5)),
    "base_plate": Box(x_mm=(0, 100), y_mm=(0, 70), z_mm=(-20, 0)),
    "lever": Box(x_mm=(0, 101.6), y_mm=(0, 63.5), z_mm=(-31.75, 0)),
    "housing": Box(x_mm=(0, 160), y_mm=(0, 120), z_mm=(-40, 2)),
}
BLOCK = Box(x_mm=(0, 60), y_mm=(0, 50), z_mm=(-10, 0))


def of_lines(
    text: str, tools: dict[int, Tool], stock: Box = BLOCK, resolution: float = 0.5
) -> list[tuple[int, int, str]]:
    """Line, tool and operation of each row at feed, by the cut."""
    cut = cut_with(text, tools, stock, resolution)
    moves = cut.plan.path.moves
    found = operations(parse_program(text.encode(), "P.nc"), moves, cut, cut_blocks(cut))
    return listed(moves, found.code)


def cut_with(text: str, tools: dict[int, Tool], stock: Box = BLOCK, resolution: float = 1.0) -> Cut:
    """The cut of a program with tools of their nominal diameter [mm]."""
    registers = {number: Register(diameter=tool.diameter_mm) for number, tool in tools.items()}
    plan = planned_program(follow(text, tools=registers), CONTROL)
    return cut_program(plan, CutJob(stock=stock, tools=tools, force_laws=dict.fromkeys(tools, LAW),
                                    resolution=resolution * 1e-3))  # fmt: skip


def without_cut(
    text: str, dialect: str = "fanuc", tool: Tool = FLAT
) -> tuple[list[tuple[int, int, str]], Operations]:
    """Operations of a program of T1 as far as they are known without its cut."""
    program = parse_program(text.encode(), "P.nc")
    moves = interpret(program, Setup(dialect=dialect, tools={1: Register(diameter=10.0)}))
    found = operations_without_cut(program, moves, {1: tool})
    return listed(moves, found.code), found


def practice_in_steel(text: str, cut: Cut, practice: MachiningPractice) -> Practice:
    """Practice of a program in C45."""
    return practice_of(
        parse_program(text.encode(), "P.nc"), cut.plan.path.moves, cut,
        limits=CutLimit(practice=practice), catalogue=read_catalogue(),
        material=read_material("steel_medium_carbon"),
    )  # fmt: skip


def listed(moves: Moves, code: np.ndarray) -> list[tuple[int, int, str]]:
    """Line, tool and operation of each row with one."""
    rows = np.flatnonzero(code >= 0).tolist()
    return [(int(moves.line[row]), int(moves.tool[row]), OPERATIONS[code[row]]) for row in rows]


def below(text: str, found: list[tuple[int, int, str]], comment: str) -> set[str]:
    """Operations of the rows between a comment and the next."""
    lines = text.splitlines()
    first = next(k for k, line in enumerate(lines, 1) if comment in line)
    last = next((k for k, line in enumerate(lines, 1) if k > first and "(" in line), len(lines) + 1)
    return {name for line, _, name in found if first <= line < last} - {"air"}


@cache
def whole(name: str, *, resolution: float = 0.5) -> list[tuple[int, int, str]]:
    """Operations of one of the programs."""
    text = (PROGRAMS / f"{name}.nc").read_text()
    return of_lines(text, tools_of(name), STOCKS[name], resolution)


def of_tool(found: list[tuple[int, int, str]], number: int) -> set[str]:
    """Operations of a tool in the material, or kept for what it is called."""
    return {name for _, tool, name in found if tool == number} - {"air"}


@pytest.mark.parametrize(("tool", "names"), [
    (1, {"face_milling"}), (2, {"roughing", "slotting"}),
    (4, {"centre_drilling"}), (5, {"deep_drilling"}), (6, {"tapping"}), (7, {"countersinking"}),
    (8, {"chamfering"}), (9, {"drilling"}),
])  # fmt: skip
def test_each_tool_of_the_fitting_does_what_it_is_called(tool: int, names: set[str]) -> None:
    assert of_tool(whole("fitting"), tool) == names


def test_the_sections_of_the_base_plate_are_what_their_comments_say() -> None:
    text, found = (PROGRAMS / "base_plate.nc").read_text(), whole("base_plate")
    assert of_tool(found, 1) == {"roughing", "plunging", "slotting"}
    assert below(text, found, "(FINISH BORE 40)") == {"boring"}
    assert below(text, found, "(ROUGH SLOT 10 WIDE)") == {"finishing", "deep_drilling"}
    assert below(text.replace("T2 FINISHING", "T2"), of_lines(
        text.replace("T2 FINISHING", "T2"), tools_of("base_plate"), STOCKS["base_plate"]
    ), "(ROUGH SLOT 10 WIDE)") == {"slotting", "deep_drilling"}  # fmt: skip


def test_a_finish_face_mill_is_finishing_and_a_drill_for_a_reamer_a_drill() -> None:
    found = whole("housing", resolution=1.0)
    assert [of_tool(found, tool) for tool in (1, 5, 6)] == [
        {"finishing"},
        {"deep_drilling"},  # 44 mm of 9.7
        {"reaming"},
    ]


def test_a_loop_of_trochoidal_milling_is_one_operation() -> None:
    """Front arcs with the steps before them, in air or not, but for the first and the last."""
    found = [one for one in whole("lever") if one[1] == 1 and one[2] != "air"]
    assert len(found) > 200
    assert [name for _, _, name in found].count("lead") <= 3
    assert {name for _, _, name in found} == {"roughing", "lead"}


def test_without_words_thin_rows_of_a_loop_are_finishing() -> None:
    text = (PROGRAMS / "lever.nc").read_text().replace("(ADAPTIVE ROUGHING OPTILOAD .055)", "")
    found = of_lines(text, tools_of("lever"), STOCKS["lever"])
    assert of_tool(found, 1) == {"roughing", "lead", "finishing"}


def test_a_siemens_program_is_read_as_well() -> None:
    program = parse_program((PROGRAMS / "flange.nc").read_bytes(), "flange.nc")
    moves = interpret(program, Setup(dialect="siemens"))
    found = listed(moves, operations_without_cut(program, moves, tools_of("flange")).code)
    assert [of_tool(found, tool) for tool in range(1, 6)] == [
        {"roughing"}, {"finishing"}, {"centre_drilling"}, {"drilling"}, {"countersinking"},
    ]  # fmt: skip


DRILLED = """T1 M6
G0 X20 Y20 S1000 M3
Z5
G99 G81 Z{first} R2 F100
X40 Z{second}
G80
G0 Z5
M30
"""


@pytest.mark.parametrize(("point", "depths", "names"), [
    (120.0, (-1.5, -2.0), ["centre_drilling", "centre_drilling"]),
    (120.0, (-1.5, -8.0), ["centre_drilling", "drilling"]),
    (90.0, (-3.0, -8.0), ["centre_drilling", "centre_drilling"]),
    (180.0, (-1.0, -1.0), ["drilling", "drilling"]),
])  # fmt: skip
def test_a_cone_that_never_gets_to_its_full_diameter_spots(
    point: float, depths: tuple[float, float], names: list[str]
) -> None:
    """Hole by hole, without words; a point of 90 degrees is no twist drill's."""
    tool = replace(SPOT, point_angle_deg=point)
    found = of_lines(DRILLED.format(first=depths[0], second=depths[1]), {1: tool})
    assert [name for _, _, name in found] == names


def test_pecks_with_g1_are_drilling_from_the_first_one_on() -> None:
    text = "T1 M6\nG0 X20 Y20 Z1 S1000 M3\nG1 Z-1 F100\nG0 Z1\nZ-0.9\nG1 Z-8\nG0 Z5\nM30\n"
    assert [name for _, _, name in of_lines(text, {1: SPOT})] == ["drilling", "drilling"]


PECKS = "T1 M6\nG0 X20 Y20 Z1 S1000 M3\n{pecks}G0 Z5\nM30\n"
DEEP_BLOCK = Box(x_mm=(0, 60), y_mm=(0, 50), z_mm=(-60, 0))


@pytest.mark.parametrize(("depth", "step", "name"), [
    (28.0, 4.0, "drilling"), (34.0, 4.0, "deep_drilling"), (50.0, 3.0, "deep_drilling"),
    (50.0, 50.0, "deep_drilling"),
])  # fmt: skip
@pytest.mark.parametrize("between", [
    "G0 Z1\nX25\nX20\n", *(pytest.param(way, marks=pytest.mark.proof) for way in ("G0 Z1\n", "")),
])  # fmt: skip
def test_pecks_down_one_hole_are_as_deep_as_the_hole(
    depth: float, step: float, name: str, between: str
) -> None:
    """From 3 D of the full diameter on, posted with G1 and G0; D is 10, its cone 2.9 mm high."""
    ends = np.append(np.arange(step, depth, step), depth).tolist()
    pecks = "".join(f"{between}G1 Z{-end} F100\n" for end in ends)
    found = of_lines(PECKS.format(pecks=pecks), {1: SPOT}, DEEP_BLOCK)
    assert {one for _, _, one in found} - {"air"} == {name}


def test_a_plain_cycle_down_a_deep_hole_is_as_deep() -> None:
    found = of_lines(DRILLED.format(first=-20, second=-40), {1: SPOT}, DEEP_BLOCK)
    assert [name for _, _, name in found] == ["drilling", "deep_drilling"]


def test_a_drill_that_moves_sideways_chamfers() -> None:
    text = "T1 M6\nG0 X-10 Y0 Z-2 S1000 M3\nG1 X70 F100\nG0 Z5\nM30\n"
    assert of_tool(of_lines(text, {1: SPOT}), 1) == {"chamfering"}


@pytest.mark.parametrize("name", ["centre_drilling", "countersinking", "counterboring"])
def test_no_countersink_has_the_row_of_a_twist_drill(name: str) -> None:
    catalogue, steel = read_catalogue(), read_material("steel_medium_carbon")
    drill = listed_range(catalogue, steel, SPOT, ("drilling",))
    assert drill is not None and listed_range(catalogue, steel, SPOT, (name,)) != drill
    assert listed_range(catalogue, steel, replace(SPOT, role="countersink"), ("drilling",)) is None


SLOTTED = "T1 M6\nG0 X-10 Y20 S6000 M3\nZ5\nG1 Z-5 F300\nX70 F600\nG0 Z5\n"
SLOPED = "T1 M6\nG0 X-10 Y20 S6000 M3\nZ-3\n" + "".join(
    f"Z{-3 + 0.1 * k:g}\nG1 X70 Y{14 + 0.4 * k:g} F600\nG0 Z5\nX-10\n" for k in range(30)
)


@pytest.mark.parametrize(("resolution", "point"), [
    pytest.param(0.25, 140.0, marks=pytest.mark.proof), (0.5, 118.0),
])  # fmt: skip
@pytest.mark.parametrize(("before", "place", "one_sided"), [
    ("", "X30.37 Y20.19", False),
    ("", "X4.6 Y20", False),  # 0.4 mm of its radius beside the blank
    ("", "X3 Y20", True),
    (SLOTTED, "X30 Y20", True), (SLOTTED, "X30 Y24", True), (SLOTTED, "X30 Y35", False),
    (SLOPED, "X30 Y20", True),
    ("T1 M6\nG0 X30 Y20 S6000 M3\nZ5\nG1 Z-8 F300\nG0 Z5\n", "X30 Y20", False),  # a pilot hole
])  # fmt: skip
def test_a_drill_cuts_on_one_side_over_slots_slopes_and_edges(
    before: str, place: str, one_sided: bool, resolution: float, point: float
) -> None:
    text = f"{before}T2 M6\nG0 {place} S1000 M3\nZ1\nG1 Z-9 F100\nG0 Z5\nM30\n"
    tools = {1: replace(FLAT, diameter_mm=6.0), 2: replace(SPOT, point_angle_deg=point)}
    cut = cut_of(text, tools=tools, resolution=resolution)
    drilled = cut.plan.path.moves.line[drills_on_one_side(cut)].tolist()
    assert drilled == ([text.count("\n") - 2] if one_sided else [])


def test_a_flat_drill_in_solid_material_cuts_all_around() -> None:
    cut = cut_of(PECKS.format(pecks="G1 Z-6 F100\n"), tools={1: replace(SPOT, point_angle_deg=180)})
    assert not drills_on_one_side(cut).any()


HEAD = "T1 M6\nG0 X-10 Y20 S6000 M3\nZ5\nG1 Z-3 F300\n"


@pytest.mark.parametrize(("path", "names"), [
    ("X70\n", ["slotting"]),  # from air to air
    ("X8\nX40\nX70\n", ["lead", "slotting", "slotting"]),
    ("X30\nX55\nX70\n", ["slotting", "slotting", "lead"]),
    ("X8\nG0 Z5\n", ["lead"]),  # beside a rapid
])  # fmt: skip
def test_leads_are_the_short_ends_of_a_cut(path: str, names: list[str]) -> None:
    found = of_lines(f"{HEAD}{path}G0 Z5\nM30\n", {1: FLAT})
    assert [name for _, _, name in found if name != "air"] == names


STEP = "T1 M6\n({said})\nG0 X-10 Y{y} S6000 M3\nZ5\nG1 Z-8 F300\n{path}G0 Z5\nM30\n"


@pytest.mark.parametrize(("said", "last", "names"), [
    ("ADAPTIVE ROUGHING", "F300", ["roughing", "roughing"]),
    ("POCKET", "F300", ["roughing", "finishing"]),
    ("ROUGH AND FINISH", "F300", ["finishing", "finishing"]),
    ("ADAPTIVE ROUGHING", "F200", ["roughing", "finishing"]),
])  # fmt: skip
def test_a_thin_wall_is_roughing_where_comment_and_feed_say_so(
    said: str, last: str, names: list[str]
) -> None:
    """Two cuts along the edge, 2 mm and 0.4 mm deep across, 8 mm deep along the axis."""
    path = f"X70\nG0 Z5\nX-10 Y-2.6\nG1 Z-8\nX70 {last}\n"
    found = of_lines(STEP.format(said=said, y=-3, path=path), {1: FLAT}, resolution=0.2)
    assert [name for _, _, name in found if name != "air"] == names


def test_a_cut_that_is_mostly_thin_is_finishing_all_along() -> None:
    """A wall with a deep corner at the same F."""
    path = "X40 Y-4.6\nX50 Y-2\nX75\n"
    found = of_lines(STEP.format(said="WALL", y=-4.6, path=path), {1: FLAT}, resolution=0.2)
    assert of_tool(found, 1) == {"finishing"}


SECTIONS = """T1 M6
G0 X-10 Y-2 S6000 M3
(FINISH BORE 40)
G1 Z-3 F300
X70
({title})
G1 X71
M30
"""


@pytest.mark.parametrize(("title", "name"), [
    ("ROUGH SLOT", "roughing"), ("SCHRUPPEN NUT", "roughing"), ("POCKET", "roughing"),
    ("TASCHE", "roughing"), ("KONTUR", "roughing"), ("FINISH FLOOR", "finishing"),
    ("AT Z-3", "boring"), ("SLOT WALLS", "boring"),
])  # fmt: skip
def test_a_section_of_another_kind_ends_a_comment(title: str, name: str) -> None:
    assert without_cut(SECTIONS.format(title=title))[0][-1] == (7, 1, name)


TITLED = """%
O5000 ({title})
({title})
N10 G21 G17 G90
{above}
N15 T1 M6
N20 G0 X-10 Y-2 S6000 M3
N30 G1 Z-3 F300
N40 X70
M30
%
"""


@pytest.mark.parametrize("title", [
    "DRILL AND TAP M8", "BOHREN UND REIBEN 10H7", "FINISHING OP20", "TARAUDAGE M8", "PROBE HOLDER",
])  # fmt: skip
@pytest.mark.parametrize("above", ["", "({title})\nG0 Z100", "T1 (END MILL)"])
def test_what_stands_above_the_first_tool_change_is_a_title(title: str, above: str) -> None:
    rows, found = without_cut(TITLED.format(title=title, above=above.format(title=title)))
    assert {name for _, _, name in rows} == {"roughing"}
    assert found.comments.below(title.split()[0]).any()  # --keep finds it all the same


@pytest.mark.parametrize("above", ["(FINISH WALLS)", "(FINISH WALLS)\n(0.2 LEFT)\nN12 T1"])
def test_a_comment_right_above_the_first_tool_change_names_its_operation(above: str) -> None:
    found, _ = without_cut(TITLED.format(title="PLATE", above=above))
    assert {name for _, _, name in found} == {"finishing"}


CALLED = """O1(PLATE)
T1 M6
(FINISH WALLS)
M98 P2
(ROUGH POCKET)
{between}
M98 P2
(POCKET OF ANOTHER PROGRAM, REAMED)
M30
O2{title}
G91 G1 X10 F300
G90
M99
"""


@pytest.mark.parametrize(("title", "between", "names"), [
    ("", "G0 Y5", ["finishing", "roughing"]),
    ("(POCKET 24 X 22)", "G0 Y5", ["finishing", "roughing"]),
    ("(ENGRAVE)", "G0 Y5", ["engraving", "engraving"]),
    ("", "", ["finishing", "finishing"]),  # two calls in a row: which of them is not known
])  # fmt: skip
def test_a_subprogram_is_under_the_comment_where_it_is_called(
    title: str, between: str, names: list[str]
) -> None:
    found, _ = without_cut(CALLED.format(title=title, between=between))
    assert [name for _, _, name in found] == names


DEFINED = """(PLATE)
{title}
o<wall> sub
{said}
G91 G1 X10 F300
G90
o<WALL> endsub
T1 M6
(FINISH WALLS)
G1 X1 F300
o<wall> call
(ROUGH POCKET)
G1 X2
o<wall> call
G1 X3
M2
"""


@pytest.mark.parametrize(("title", "said", "names"), [
    ("", "", ["finishing", "finishing", "roughing", "roughing", "roughing"]),
    ("", "(ENGRAVE)", ["finishing", "engraving", "roughing", "engraving", "roughing"]),
    ("(REAMED WALL, FINE)", "", ["finishing", "finishing", "roughing", "finishing", "roughing"]),
    ("G4 P1 (REAM)", "", ["finishing", "finishing", "roughing", "roughing", "roughing"]),
])  # fmt: skip
def test_a_subprogram_of_linuxcnc_is_under_its_callers_comment(
    title: str, said: str, names: list[str]
) -> None:
    """It stands above the main program; a comment right above it is its title."""
    found, _ = without_cut(DEFINED.format(title=title, said=said), "linuxcnc")
    assert [line for line, _, _ in found] == [10, 5, 13, 5, 15]
    assert [name for _, _, name in found] == names


def test_a_comment_of_the_main_program_holds_beyond_a_subprogram_in_its_midst() -> None:
    text = "T1 M6\n(FINISH)\no100 sub\n(ENGRAVE)\no0100 endsub\nG1 X1 F300\nM2\n"
    rows, found = without_cut(text, "linuxcnc")
    assert rows == [(6, 1, "finishing")]
    assert not found.comments.below("engrave").any()


KEPT = """(T1 D10 {tool})
T1 M6
G0 X-10 Y20 S6000 M3
({first})
G1 Z-2 F300
X5
({second})
M98 P200
X25
T2 M6
X30
M30
O200
X20
M99
"""


@pytest.mark.parametrize(("said", "lines"), [
    (("FINISH", "", ""), [3, 5, 6, 14, 9]),  # of a tool
    (("", "", "FINISH WALL"), [14, 9]),  # of the subprogram below it
    (("", "FINISH WALL", "POCKET"), [5, 6]),  # up to the next operation
    (("", "FINISH WALL", "NEAR CLAMP"), [5, 6, 14, 9]),
    (("", "NOT TO FINISHED SIZE", "ROUGH"), [5, 6]),  # names no operation
])  # fmt: skip
def test_a_word_keeps_the_rows_that_its_comment_holds_for(
    said: tuple[str, str, str], lines: list[int]
) -> None:
    text = KEPT.format(**dict(zip(("tool", "first", "second"), said, strict=True)))
    cut = cut_with(text, {1: FLAT, 2: FLAT})
    moves = cut.plan.path.moves

    def kept(word: str) -> np.ndarray:
        practice = practice_in_steel(text, cut, MachiningPractice(keep=(word,)))
        return dict(practice.kept_feed)[f"keep {word}"]

    rows = moves.line[kept("finish") & (moves.length > 0)]
    assert list(dict.fromkeys(rows.tolist())) == lines
    with pytest.raises(ValueError, match="'REAM', which stands in no comment that holds"):
        kept("REAM")


@pytest.mark.parametrize("minutes", [15.0, 60.0])
def test_an_edge_lasts_by_the_slowest_constants_of_its_spread(minutes: float) -> None:
    """C45: S goes no further than the least speed that makers' tables have for 15 min."""
    text = "T1 M6\nG0 X-10 Y20 S2000 M3\nG1 Z-3 F300\nX70\nM30\n"
    cut = cut_with(text, {1: FLAT})
    practice = practice_in_steel(text, cut, MachiningPractice(tool_life_min=minutes))
    taylor = read_material("steel_medium_carbon").taylor["carbide"]
    low, n = taylor.C_range_m_min[0], taylor.n_range[1]
    speed = low * (15 / minutes) ** n / (np.pi * 0.010)
    highest = practice.surface_high[cut.tool == 0]
    assert highest == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize(("role", "name", "operation"), [
    ("face_mill", "63MM FINISH FACE MILL", "finishing"), ("face_mill", "63MM", "face_milling"),
    ("countersink", "", "countersinking"), ("counterbore", "", "counterboring"),
    ("spot_drill", "10MM DRILL", "centre_drilling"),
])  # fmt: skip
def test_the_role_goes_first_but_a_face_mill_may_finish(
    role: str, name: str, operation: str
) -> None:
    tool = replace(FLAT, role=role, name=name)
    found, _ = without_cut("T1 M6\nS1000 M3\nG1 X10 F300\nM30\n", tool=tool)
    assert found == [(3, 1, operation)]


def test_what_is_engraved_is_kept_with_a_chamfer_mill() -> None:
    tool = replace(FLAT, role="chamfer_mill")
    found, _ = without_cut("T1 M6\nS1000 M3\n(ENGRAVE)\nG1 X10 F300\nM30\n", tool=tool)
    assert found == [(4, 1, "engraving")]
