"""Parts that a mill of the shop makes, as its people programmed them: on the safe side.

Cutting data at the lower end of what makers' catalogues (Sandvik, Walter) give for slots in wrought
aluminium, and in unalloyed steel of 0.45 % carbon.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.shop.cutting_parameters import EndMill
from pipeline.shop.part_programs import part_programs
from pipeline.shop.post import PartProgram, Post, Tool, word
from pipeline.shop.trial_job import Box, TrialJob

if TYPE_CHECKING:
    from pipeline.shop.parameters import ShopParameters

NUMBER = 81
"""Of the program, after the control's first."""
CLEAR = 3.0
"""Above the blank, and beside it [mm]."""
SKIN = 0.5
"""Left on a pocket's wall for the finish [mm]."""
SHARPNESS = (1.0, 1.08, 0.94, 1.02, 0.96)
"""Of the teeth of tools that the dynamometer's tests do not use."""


@dataclass(frozen=True, kw_only=True)
class ShopPart:
    """A part: its program, its blank [mm], what its tools may be loaded with [N], the tools."""

    program: PartProgram
    blank: Box
    limit_load_N: float
    tools: dict[int, EndMill]

    def job(self, parameters: "ShopParameters") -> TrialJob:
        """The trial of it."""
        return TrialJob(
            blank=self.blank, limit_load_N=self.limit_load_N, tools=self.tools,
            workpiece=parameters.cutting.workpiece,
            lengths={t.number: t.length for t in self.program.tools},
        )  # fmt: skip


def shop_part(parameters: "ShopParameters") -> ShopPart:
    """The part of a machine: of aluminium with two tools, or of steel with one.

    Raises
    ------
    ValueError
        When the machine has no tool of the number that its cutting tests ask for.
    """
    own = parameters.cutting.tool
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    known = {t.number: t for p in programs for t in p.tools}
    if own.number not in known:
        raise ValueError(f"EndMill.number = {own.number}: the control has no tool of that number")
    soft = parameters.cutting.workpiece.tangential < 1500
    return _guide_plate(parameters, known) if soft else _key_plate(parameters, known)


def write_parts(folder: Path, parameters: "ShopParameters") -> None:
    """Write ``parts/*.nc`` into ``folder``, when the machine's cuts are recorded."""
    if not parameters.cutting.recorded:
        return
    program = shop_part(parameters).program
    path = folder / "parts" / f"{program.name}.nc"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(program.text, encoding="ascii", newline="\n")


def _guide_plate(parameters: "ShopParameters", known: dict[int, Tool]) -> ShopPart:
    own = parameters.cutting.tool
    rough = replace(known[own.number], speed=5000, feed=700.0, plunge=250.0)
    fine = replace(known[9], speed=8000, feed=900.0, plunge=300.0)
    blank = (0.0, 80.0, 0.0, 60.0, -15.0, 0.0)
    post, name = _begun(parameters, "GUIDE PLATE", [rough, fine], blank)
    post.take(rough)
    post.approach(-own.diameter, 14.0, 25.0)
    for depth in (2.5, 5.0):
        _way(post, depth, [(-own.diameter, 14.0), (66.0, 14.0), (66.0, 50.0), (78.0, 50.0)])
    _pocket(post, (28.0, 40.0), (20.0 - SKIN, 12.0 - SKIN), (2.0, 4.0))
    post.rapid(z=25.0)
    post.retract()
    post.take(fine)
    post.approach(28.0, 40.0, 25.0)
    _finish(post, (28.0, 40.0), (20.0, 12.0), 4.0)
    post.retract()
    return ShopPart(
        program=post.end(name), blank=blank, limit_load_N=450.0,
        tools={own.number: own, 9: _like(own, fine, 3)},
    )  # fmt: skip


def _key_plate(parameters: "ShopParameters", known: dict[int, Tool]) -> ShopPart:
    own = parameters.cutting.tool
    mill = replace(known[own.number], speed=2400, feed=240.0, plunge=80.0)
    r, out = own.diameter / 2, own.diameter / 2 + CLEAR
    blank = (0.0, 50.0, 0.0, 40.0, -12.0, 0.0)
    post, name = _begun(parameters, "KEY PLATE", [mill], blank)
    post.take(mill)
    post.approach(-out, 12.0, 25.0)
    for depth in (1.0, 2.0):
        _way(post, depth, [(-out, 12.0), (20.0, 12.0), (20.0, 28.0), (50.0 + out, 28.0)])
    for width in (5.0, 8.0):  # a step at the far side, up to the slot's end
        y = 40.0 + r - width
        _way(post, 2.0, [(-out, y), (8.0, y), (8.0, 40.0 + out)])
    post.rapid(z=25.0)
    post.retract()
    return ShopPart(
        program=post.end(name), blank=blank, limit_load_N=400.0, tools={own.number: own}
    )


def _begun(
    parameters: "ShopParameters", title: str, tools: list[Tool], blank: Box
) -> tuple[Post, str]:
    control, name = parameters.control, f"O{parameters.control.first_program + NUMBER}"
    post = Post(
        numbered=control.numbered, spaced=not control.numbered,
        peck_clearance=control.peck_clearance,
    )  # fmt: skip
    post.begin(name, title, tuple(tools), control.work_offset)
    post.comment("BLANK BOX " + " ".join(word(a, v) for a, v in zip("XXYYZZ", blank, strict=True)))
    post.comment(f"MATERIAL {parameters.cutting.workpiece.name.upper()}")
    return post, name


def _like(own: EndMill, tool: Tool, flutes: int) -> EndMill:
    """A tool that no test used: of the same make and in the same kind of chuck as ``own``."""
    return replace(
        own, number=tool.number, diameter=tool.diameter, flutes=flutes,
        sharpness=SHARPNESS[:flutes],
    )  # fmt: skip


def _way(post: Post, depth: float, points: list[tuple[float, float]]) -> None:
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
