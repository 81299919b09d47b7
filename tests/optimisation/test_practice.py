"""What holds without being asked: no cut beyond its source's row, or the program, by the defaults.

Cuts that a maker would not raise, each with the sentence that names why, and cuts that may have as
thick a chip as their row means.  Nothing is given but the program, the tools and the material.
"""

import re
from dataclasses import dataclass, replace
from math import pi

import pytest

from pipeline.app.optimise import optimise_lines
from pipeline.app.tables import read_material
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Moves
from pipeline.optimisation.document import optimised_part
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.job import job_of
from pipeline.optimisation.optimise import optimise
from pipeline.optimisation.practice import immersion
from pipeline.optimisation.settings import OptimisationSettings, SearchSettings
from pipeline.schema.limits import CutLimit, MachiningPractice
from pipeline.schema.part import OptimisedPart
from tests.optimisation.adaptive import trochoid
from tests.optimisation.direct_parts import control
from tests.optimisation.several_tools import request_of

SETTINGS = OptimisationSettings(
    search=SearchSettings(population=4, generations=1, paper_generations=1, baseline=0)
)
SIX = Tool(kind="flat", diameter_mm=6.0, flutes=4, helix_deg=35.0, flute_length_mm=16.0,
           stickout_mm=60.0)  # fmt: skip
TEN = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=38.0, flute_length_mm=25.0,
           stickout_mm=35.0)  # fmt: skip
TWELVE = Tool(kind="flat", diameter_mm=12.0, flutes=4, helix_deg=38.0, flute_length_mm=30.0,
              stickout_mm=36.0)  # fmt: skip
STIFF = replace(TWELVE, youngs_modulus_GPa=2000.0, stickout_mm=31.0)
FACE = Tool(kind="flat", role="face_mill", diameter_mm=63.0, flutes=5, flute_length_mm=10.0,
            stickout_mm=60.0, shank_diameter_mm=27.0)  # fmt: skip
T_SLOT = Tool(kind="flat", diameter_mm=25.0, flutes=6, flute_length_mm=11.0, stickout_mm=30.0,
              shank_diameter_mm=14.0)  # fmt: skip
BALL = Tool(kind="ball", diameter_mm=8.0, flutes=2, flute_length_mm=16.0, stickout_mm=25.0)
DRIVE = SpindleDrive(rated_power_kW=100.0, base_speed_rpm=800.0, top_speed_rpm=12_000.0)
C45, STAINLESS, TITANIUM = "steel_medium_carbon", "stainless_austenitic", "titanium_alloy"


def optimised(
    text: str, tool: Tool, material: str, *, group: int | None = None, long: int | None = None,
    limits: CutLimit | None = None, dynamics: TipDynamics | None = None,
) -> Result:  # fmt: skip
    """A program optimised with nothing given but what stands here."""
    law = read_material(material)
    request = request_of(
        text, {1: tool}, stock=f"box:0,{long or length(tool)},0,60,-30,0", material=material,
        settings=SETTINGS, control=control(), limits=limits, resolution=0.5, drive=DRIVE,
        dynamics=dynamics, law=replace(law, group=group or law.group),
    )  # fmt: skip
    return optimise(job_of(request))


def length(tool: Tool) -> int:
    """Of the blank, so that a pass is no lead [mm]."""
    return 60 if tool.diameter_mm < 30 else 160


def line(depth: float, feed: float, speed: float, tool: Tool, y: float = 30.0) -> str:
    """One pass along X at y, from just before the blank to just behind [mm], [mm/min]."""
    out, long = tool.diameter_mm / 2 + 0.5, length(tool)
    return (
        f"G21 G90\n(ROUGH)\nT1 M6\nS{speed:g} M3\nG0 X-{out:g} Y{y:g} Z5\nG0 Z-{depth:g}\n"
        f"G1 X{long + out:g} F{feed:g}\nG0 Z50\nM30\n"
    )


def side(width: float, depth: float, feed: float, speed: float, tool: Tool) -> str:
    """A pass that takes ``width`` off the side at y = 0 [mm]."""
    return line(depth, feed, speed, tool, y=width - tool.diameter_mm / 2)


def page(result: Result) -> OptimisedPart:
    return optimised_part(result, machine="mine", origin="recorded", control="conf/machine")


@dataclass(frozen=True, kw_only=True)
class Held:
    """A cut that gets no more than programmed, and the sentence that says why."""

    text: str
    tool: Tool
    material: str
    why: str
    limit: str
    group: int | None = None
    """Of VDI 3323, where it is not the material's."""


HELD = {
    # C45, Tungaloy p. 1084: 0.03 to 0.055 mm; a stickout of ten diameters bends
    "long D6": Held(text=line(4, 1000, 5300, SIX), tool=SIX, material=C45, limit="deflection",
                    why="its tip bends .* um as programmed, more than 50 um and 3 f_z = 142 um"),
    # Tungaloy p. 1084: slots end at 1 D in stainless steel and titanium
    "deep slot, stainless": Held(
        text=line(24, 290, 1900, STIFF), tool=STIFF, material=STAINLESS, limit="depth of the table",
        why=r"24 mm deep is 2 D, the row for slotting \(Tungaloy\) ends at 1 D \(12 mm\)"),
    "deep slot, titanium": Held(
        text=line(24, 170, 1050, STIFF), tool=STIFF, material=TITANIUM, limit="depth of the table",
        why=r"24 mm deep is 2 D, the row for slotting \(Tungaloy\) ends at 1 D \(12 mm\)"),
    # the same: shoulders end at 2 D
    "deep shoulder": Held(
        text=side(1.5, 28, 400, 1900, STIFF), tool=STIFF, material=STAINLESS,
        limit="depth of the table", why="28 mm deep is 2.3 D, the row for roughing .* ends at 2 D"),
    # Mitsubishi p. 1293: 5 mm at 0.5 to 0.75 D
    "deep face": Held(text=line(7, 600, 900, FACE, y=10), tool=FACE, material=C45,
                      limit="depth of the table", why="7 mm deep .* ends at 0.079 D \\(5 mm\\)"),
    # Tungaloy p. 131: shoulders of 0.25 D in aluminium with 13 % Si
    "wide shoulder": Held(
        text=side(4.2, 4, 1000, 5000, STIFF), tool=STIFF, material="aluminium_cast", group=25,
        limit="width of the table", why="wide is 0.3.* D, the row for roughing .* ends at 0.25 D"),
    "T-slot cutter": Held(text=line(16, 100, 500, T_SLOT), tool=T_SLOT, material="A6061",
                          limit="length of the flutes",
                          why="16 mm deep, and its flutes are 11 mm long"),
}  # fmt: skip


SOME = {"long D6", "deep slot, titanium", "wide shoulder", "T-slot cutter"}
"""One for each of what may hold a cut; the others of its kind are proof."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in SOME else pytest.mark.proof) for name in HELD]
)
def test_a_cut_beyond_its_row_its_flutes_or_its_stiffness_stays_as_programmed(name: str) -> None:
    cut = HELD[name]
    result = optimised(cut.text, cut.tool, cut.material, group=cut.group)
    assert result.answer.text == result.job.program.data
    said = page(result)
    (use,) = [one for one in said.tools if one.no_more_feed]
    assert re.search(cut.why, use.no_more_feed or "")
    assert cut.limit in [one.limit for one in said.binding]
    printed = "\n".join(optimise_lines(said))
    assert f"F not raised: T1 {use.operation}: {use.no_more_feed}" in printed
    assert re.search(r"bending .*binds", printed)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name == "wide shoulder" else pytest.mark.proof) for name in HELD
])  # fmt: skip
def test_neither_feed_nor_width_is_all_that_held_it(name: str) -> None:
    """With a range of its own, on a stiff holder and flutes that reach, each gets more."""
    cut = HELD[name]
    tool = replace(cut.tool, feed_per_tooth_mm=(0.0, 1.0), flute_length_mm=40.0, stickout_mm=41.0,
                   youngs_modulus_GPa=2000.0, shank_diameter_mm=None)  # fmt: skip
    result = optimised(cut.text, tool, cut.material, group=cut.group,
                       limits=CutLimit(deflection_um=1e4))  # fmt: skip
    assert result.answer.decision.row_feeds.max() > 1.4 * result.moves.feed.max()


@pytest.mark.parametrize(("width", "most"), [(0.9, 0.152), (0.6, 0.203)])
def test_a_face_mill_has_the_feed_of_its_width(width: float, most: float) -> None:
    """Mitsubishi p. 1293, carbon steel, below 5 mm: 0.008 in. up to 0.75 D, 0.006 in. beyond."""
    result = optimised(side(width * 63, 2, 630, 900, FACE), FACE, C45)
    before, after = (one.feed.max() / (5 * 900) for one in (result.moves, moves_after(result)))
    assert before == pytest.approx(0.14)
    assert 0.95 * most < after <= most


def moves_after(result: Result) -> Moves:
    return result.answer.cut.plan.path.moves


@pytest.mark.parametrize(
    "width", [1.0, 6.0, *(pytest.param(width, marks=pytest.mark.proof) for width in (2.0, 4.0))]
)
def test_the_chip_is_the_measure_of_the_feed(width: float) -> None:
    """Tungaloy p. 1084 and 1091, 10 mm in carbon steel: 0.11 mm up to 0.4 D, 0.07 mm in slots."""
    widened = CutLimit(practice=MachiningPractice(change=(0.1, 10.0)))
    text = side(width, 5, 1000, 5000, TEN)
    result = optimised(text, TEN, C45, limits=widened)
    f_z = moves_after(result).feed.max() / (4 * 5000)
    table = 0.07 if width > 4 else 0.11 * float(immersion(0.4) / immersion(width / 10))
    assert 0.9 * table < f_z <= 1.02 * table


LOOPS = pytest.mark.parametrize("loops", [12, pytest.param(375, marks=pytest.mark.proof)])
"""Of eight arcs each: 96, and 3,000."""


@LOOPS
def test_an_adaptive_program_is_as_fast_as_with_its_chip_given_by_hand(loops: int) -> None:
    text, long = trochoid(loops, 1600.0), max(60, loops)
    found = optimised(text, TEN, C45, long=long)
    own = replace(TEN, feed_per_tooth_mm=(0.0, 1.0))
    chip = CutLimit(chip_um=(0.0, 110.0 * float(immersion(0.4))))
    by_hand = optimised(text, own, C45, limits=chip, long=long)
    times = [page(one).after.time_s for one in (found, by_hand)]
    assert times[0] == pytest.approx(times[1], rel=0.03)
    assert times[0] is not None and times[0] < 0.95 * (page(found).before.time_s or 0.0)


@LOOPS
def test_a_program_whose_chips_were_thinned_already_stays(loops: int) -> None:
    """0.11 mm at 0.4 D is as thick a chip as 0.18 mm at the loops' 0.1 D."""
    feed = 0.11 / float(immersion(0.1)) * 4 * 5000
    result = optimised(trochoid(loops, round(feed, -1)), TEN, C45, long=max(60, loops))
    assert result.answer.text == result.job.program.data


def speeds(result: Result) -> float:
    return float(moves_after(result).speed.max())


LONG_LIFE = MachiningPractice(tool_life_min=0.1)
TIP = TipDynamics(source="stiff", measured=False, every=tuple(
    Mode(direction=axis, natural_frequency_Hz=2000.0, damping=0.05, stiffness_N_m=1e9)
    for axis in "xy"
))  # fmt: skip


def test_s_rises_where_stability_is_known_or_a_range_is_given_alone() -> None:
    text = side(2, 5, 2800, 5000, TEN)
    limits = CutLimit(practice=LONG_LIFE)
    held = optimised(text, TEN, "A6061", limits=limits)
    assert speeds(held) == 5000.0
    (use,) = [one for one in page(held).tools if one.operation == "roughing"]
    assert use.no_faster == "its stability is not known and no range of S is given"
    asked = replace(limits, speed_rpm=(100.0, 10_000.0))
    assert speeds(optimised(text, TEN, "A6061", limits=asked)) > 5000.0
    known = optimised(text, TEN, "A6061", limits=limits, dynamics=TIP)
    assert speeds(known) > 5000.0


def test_a_ball_has_the_cutting_speed_of_the_diameter_that_cuts() -> None:
    """On a floor it cuts at 2 sqrt(a_p (D - a_p)), 3.9 mm at 0.5 mm, at a wall at 8 mm."""
    floor = page(optimised(line(0.5, 500, 9000, BALL), BALL, C45)).tools[0]
    wall = page(optimised(side(0.6, 8, 500, 9000, BALL), BALL, C45)).tools[0]
    depth = floor.before.axial_depth_mm or 0.0
    deep = 2 * (depth * (8.0 - depth)) ** 0.5
    assert depth == pytest.approx(0.5, abs=0.05)
    assert floor.before.cutting_speed_m_min == pytest.approx(pi * deep * 9.0, rel=0.01)
    assert wall.before.cutting_speed_m_min == pytest.approx(pi * 8.0 * 9.0, rel=0.01)


def test_a_face_mill_has_its_lead_angle() -> None:
    """The usual 45 degrees, said, or that of the tool table: h = f_z sin(kappa_r)."""
    for tool, sine in ((FACE, 0.5**0.5), (replace(FACE, cutting_edge_angle_deg=90.0), 1.0)):
        said = page(optimised(side(40, 2, 630, 900, FACE), tool, C45))
        use = said.tools[0].before
        assert use.chip_thickness_mm == pytest.approx(0.14 * sine, rel=0.01)
        assert any("usual 45 degrees" in note for note in said.notes) == (sine < 1.0)
