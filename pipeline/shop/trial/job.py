"""Jobs of trial cuts (blank, tools, material, load limit), and the parts of the shop's mills.

Cutting data are at the lower end of catalogues (Sandvik, Walter) for slots in wrought aluminium and
in unalloyed steel of 0.45 % carbon.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged
from pipeline.shop.control.part_programs import begin_program, part_programs
from pipeline.shop.control.postprocessor import PartProgram, Post, Tool
from pipeline.shop.cutting.parameters import EndMill, Workpiece
from pipeline.shop.files import write_text
from pipeline.shop.parameters import ShopParameters

Box = tuple[float, float, float, float, float, float]
"""x from and to, y from and to, z from and to [mm]."""

LENGTH = 100.0
"""Length of a tool in its holder where the set-up sheet has none [mm]."""
NUMBER = 81
"""Number of the program, counted from the control's first."""
CLEAR = 3.0
"""Clearance above the blank, and beside it [mm]."""
SKIN = 0.5
"""Allowance on a pocket's wall for the finish [mm]."""
SHARPNESS = (1.0, 1.08, 0.94)
"""Relative edge forces of the teeth of a tool that no dynamometer test uses [1]."""


@dataclass(frozen=True, kw_only=True)
class TrialJob(Ranged, section="TrialJob"):
    """A job as the shop's set-up sheet has it."""

    blank: Box
    """Box in the coordinates of the work offset: x, y, z from and to [mm]."""
    limit_load_N: Annotated[float, Range(above=0.0, unit="N")]
    """Limit that peaks of the load are compared with [N]."""
    tools: Mapping[int, EndMill]
    """Tools that cut, by the number that the program calls.  Runout and tilt are those of a usual
    mounting: each seed mounts them anew."""
    workpiece: Workpiece = field(default_factory=Workpiece)
    """The material; each seed has a batch of its own."""
    lengths: Mapping[int, float] = field(default_factory=dict)
    """Lengths of the tools in their holders [mm]."""
    dialect: Literal["fanuc", "linuxcnc", "siemens"] = "fanuc"
    """Dialect of the program."""

    def __post_init__(self) -> None:
        super().__post_init__()
        b = self.blank
        if len(b) != 6 or not (b[0] < b[1] and b[2] < b[3] and b[4] < b[5]):
            raise ValueError(
                f"TrialJob.blank = {b} must be x, y and z from and to [mm], the lower one first"
            )
        if not self.tools:
            raise ValueError("TrialJob.tools = {} must have the end mill that cuts")

    def length(self, tool: int) -> float:
        """Length of a tool in its holder [mm]; 0 of none."""
        return self.lengths.get(tool, LENGTH) if tool > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class ShopPart:
    """A part: its program, its blank [mm], load limit [N] and tools."""

    program: PartProgram
    blank: Box
    limit_load_N: float
    tools: dict[int, EndMill]

    def job(self, parameters: ShopParameters) -> TrialJob:
        """Trial cut of the part."""
        return TrialJob(
            blank=self.blank, limit_load_N=self.limit_load_N, tools=self.tools,
            workpiece=parameters.cutting.workpiece, lengths=self.program.lengths,
        )  # fmt: skip


def shop_part(parameters: ShopParameters) -> ShopPart:
    """Part of a machine: of aluminium with two tools, or of steel with one.

    Raises ValueError when the machine has no tool of the number in its cutting tests.
    """
    own = parameters.cutting.tool
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    tools = {t.number: t for p in programs for t in p.tools}
    if own.number not in tools:
        raise ValueError(f"EndMill.number = {own.number}: the control has no tool of that number")
    soft = parameters.cutting.workpiece.tangential < 1500
    return _guide_plate(parameters, tools) if soft else _key_plate(parameters, tools)


def write_parts(folder: Path, parameters: ShopParameters) -> None:
    """Write ``parts/*.nc`` into ``folder``, when the machine's cuts are recorded."""
    if not parameters.cutting.recorded:
        return
    program = shop_part(parameters).program
    write_text(folder / "parts" / f"{program.name}.nc", program.text)


def _guide_plate(parameters: ShopParameters, tools: dict[int, Tool]) -> ShopPart:
    own = parameters.cutting.tool
    rough = replace(tools[own.number], speed=5000, feed=700.0, plunge=250.0)
    fine = replace(tools[9], speed=8000, feed=900.0, plunge=300.0)
    blank = (0.0, 80.0, 0.0, 60.0, -15.0, 0.0)
    post, name = _begin(parameters, "GUIDE PLATE", [rough, fine], blank)
    post.take(rough)
    post.approach(-own.diameter, 14.0, 25.0)
    for depth in (2.5, 5.0):
        _path(post, depth, [(-own.diameter, 14.0), (66.0, 14.0), (66.0, 50.0), (78.0, 50.0)])
    _pocket(post, (28.0, 40.0), (20.0 - SKIN, 12.0 - SKIN), (2.0, 4.0))
    post.rapid(z=25.0)
    post.retract()
    post.take(fine)
    post.approach(28.0, 40.0, 25.0)
    _finish(post, (28.0, 40.0), (20.0, 12.0), 4.0)
    post.retract()
    # of the same make and in the same kind of chuck as the tool of the tests
    finisher = replace(own, number=9, diameter=fine.diameter, flutes=3, sharpness=SHARPNESS)
    return ShopPart(
        program=post.end(name), blank=blank, limit_load_N=450.0,
        tools={own.number: own, 9: finisher},
    )  # fmt: skip


def _key_plate(parameters: ShopParameters, tools: dict[int, Tool]) -> ShopPart:
    own = parameters.cutting.tool
    mill = replace(tools[own.number], speed=2400, feed=240.0, plunge=80.0)
    r, out = own.diameter / 2, own.diameter / 2 + CLEAR
    blank = (0.0, 50.0, 0.0, 40.0, -12.0, 0.0)
    post, name = _begin(parameters, "KEY PLATE", [mill], blank)
    post.take(mill)
    post.approach(-out, 12.0, 25.0)
    for depth in (1.0, 2.0):
        _path(post, depth, [(-out, 12.0), (20.0, 12.0), (20.0, 28.0), (50.0 + out, 28.0)])
    for width in (5.0, 8.0):  # a step at the far side, up to the slot's end
        y = 40.0 + r - width
        _path(post, 2.0, [(-out, y), (8.0, y), (8.0, 40.0 + out)])
    post.rapid(z=25.0)
    post.retract()
    return ShopPart(
        program=post.end(name), blank=blank, limit_load_N=400.0, tools={own.number: own}
    )


def _begin(
    parameters: ShopParameters, title: str, tools: list[Tool], blank: Box
) -> tuple[Post, str]:
    control, name = parameters.control, f"O{parameters.control.first_program + NUMBER}"
    post = begin_program(control, name, title, tools)
    post.blank(blank, parameters.cutting.workpiece.name)
    return post, name


def _path(post: Post, depth: float, points: list[tuple[float, float]]) -> None:
    """Down beside the blank, along straight lines from point to point, up."""
    post.rapid(*points[0])
    post.rapid(z=CLEAR)
    post.line(z=-depth, feed=post.tools[-1].plunge)
    for x, y in points[1:]:
        post.line(x, y, feed=post.tools[-1].feed)
    post.rapid(z=CLEAR)


def _pocket(
    post: Post, centre: tuple[float, float], half: tuple[float, float], depths: tuple[float, ...]
) -> None:
    """Rectangular pocket: in by helices, out by rectangles that grow."""
    (x, y), tool = centre, post.tools[-1]
    r, step = 0.3 * tool.diameter, 0.45 * tool.diameter
    reach = half[0] - tool.diameter / 2, half[1] - tool.diameter / 2
    rings = int((reach[1] - r) / step) + 1
    post.rapid(x + r, y)
    post.rapid(z=CLEAR)
    top = 0.0
    for depth in depths:
        post.line(z=-top + 0.2, feed=tool.plunge)
        for turn in (1, 2):
            z = -top + 0.2 - turn / 2 * (depth - top + 0.2)
            post.arc(x + r, y, centre, z=z, feed=tool.feed / 2)
        post.arc(x + r, y, centre)
        for ring in range(rings):
            short = (rings - 1 - ring) * step
            _rectangle(post, centre, (reach[0] - short, reach[1] - short), tool.feed)
        post.rapid(z=CLEAR)
        post.rapid(x + r, y)
        top = depth


def _rectangle(
    post: Post, centre: tuple[float, float], half: tuple[float, float], feed: float
) -> None:
    """Around, the material to the right: from the middle of the right side and back there."""
    (x, y), (a, b) = centre, half
    post.line(x + a, y, feed=feed)
    for across, up in ((a, b), (-a, b), (-a, -b), (a, -b), (a, 0.0)):
        post.line(x + across, y + up)


def _finish(
    post: Post, centre: tuple[float, float], half: tuple[float, float], depth: float
) -> None:
    """Around the wall of a pocket, in and out along quarters of a circle."""
    (x, y), tool = centre, post.tools[-1]
    a, b, lead = half[0] - tool.diameter / 2, half[1] - tool.diameter / 2, 2.0
    post.rapid(x + a - lead, y - lead)
    post.rapid(z=CLEAR)
    post.line(z=-depth, feed=tool.plunge)
    post.arc(x + a, y, (x + a - lead, y), feed=tool.feed)
    _rectangle(post, centre, (a, b), tool.feed)
    post.arc(x + a - lead, y + lead, (x + a - lead, y))
    post.rapid(z=25.0)
