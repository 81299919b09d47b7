"""The programs of the spindle's tests: straight passes through a blank, and a warm-up."""

from dataclasses import dataclass

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.cutting_conditions import Conditions
from pipeline.shop.cutting_parameters import Cutting
from pipeline.shop.post import PartProgram, Post, Tool, word

NUMBER = 71
"""Of the program, after the control's first."""
CLEAR = 5.0
"""From the blank's face to the tool's edge before and after a pass, and above the blank [mm]."""
LAND = 3.0
"""Between two slots [mm]."""
FLOOR = 10.0
"""What is left under the deepest pass [mm]."""


@dataclass(frozen=True, kw_only=True)
class Pass:
    """A pass of the program: its line of the text, from and to which X, at which Y [mm]."""

    conditions: Conditions
    line: int
    start: float
    end: float
    y: float


@dataclass(frozen=True, kw_only=True)
class Site:
    """Where a pass is to be cut: Y of the tool's centre [mm], and whether towards +X."""

    conditions: Conditions
    y: float
    forward: bool


def sites(cutting: Cutting) -> tuple[list[Site], float]:
    """Places of all passes, and how wide the blank must be [mm].

    Shoulders eat into the blank from Y 0, the deepest first, so that each finds a fresh face; slots
    lie side by side behind them.  With a spindle that turns clockwise, material to the left of
    the way is cut up, material to the right of it down.
    """
    r, y, placed = cutting.tool.diameter / 2, 0.0, []
    shoulders = [c for c in cutting.spindle.passes if c.immersion != "slot"]
    for c in sorted(shoulders, key=lambda c: -c.depth):
        y += c.width
        placed.append(Site(conditions=c, y=round(y - r, 3), forward=c.immersion == "up"))
    for c in (c for c in cutting.spindle.passes if c.immersion == "slot"):
        placed.append(Site(conditions=c, y=round(y + LAND + r, 3), forward=True))
        y += LAND + 2 * r
    return placed, 5.0 * (int((y + LAND) // 5) + 1)


def cutting_program(
    cutting: Cutting, tool: Tool, control: ControlParameters
) -> tuple[PartProgram, list[Pass]]:
    """The program of the passes, and where each of them stands in it."""
    placed, width = sites(cutting)
    post, name = _begun(f"O{control.first_program + NUMBER}", "CUTTING TEST", tool, control)
    _head(post, cutting, width)
    post.take(tool)
    out, reach = [], cutting.tool.diameter / 2 + CLEAR
    ends = (-reach, cutting.spindle.block + reach)
    speed = 0.0
    for number, site in enumerate(placed, 1):
        c = site.conditions
        start, end = ends if site.forward else ends[::-1]
        post.comment(
            f"PASS {number} {c.immersion.upper()} {word('AP', c.depth)} {word('AE', c.width)}"
        )
        if speed == 0:
            post.tools[-1] = _set(tool, c)
            post.approach(start, site.y, 25.0)
        elif c.speed != speed:
            post.turn(round(c.speed))
        speed = c.speed
        post.rapid(start, site.y)
        post.rapid(z=CLEAR)
        post.line(z=-c.depth, feed=tool.plunge)
        post.line(x=end, feed=c.feed)
        out.append(Pass(conditions=c, line=len(post.lines), start=start, end=end, y=site.y))
        post.rapid(z=25.0)
    post.retract()
    return post.end(name), out


def warm_up(cutting: Cutting, tool: Tool, control: ControlParameters) -> PartProgram:
    """The program that turns the spindle at each of its speeds for a while, without a cut."""
    post, name = _begun("O9071", "NO LOAD", tool, control)
    for speed in cutting.spindle.speeds:
        post.turn(round(speed))
        post.dwell(round(cutting.spindle.hold * 1e3))
    post.turn(0)
    return post.end(name)


def _begun(name: str, title: str, tool: Tool, control: ControlParameters) -> tuple[Post, str]:
    post = Post(
        numbered=control.numbered, spaced=not control.numbered,
        peck_clearance=control.peck_clearance,
    )  # fmt: skip
    post.begin(name, title, (tool,), control.work_offset)
    return post, name


def _head(post: Post, cutting: Cutting, width: float) -> None:
    """What is to be clamped, and the tool."""
    deep = max(c.depth for c in cutting.spindle.passes)
    size = (0.0, cutting.spindle.block, 0.0, width, -deep - FLOOR, 0.0)
    post.comment("BLANK BOX " + " ".join(word(a, v) for a, v in zip("XXYYZZ", size, strict=True)))
    post.comment(f"MATERIAL {cutting.workpiece.name.upper()}")
    t = cutting.tool
    post.comment(f"TOOL {word('D', t.diameter)} FLUTES {t.flutes} {word('HELIX ', t.helix)}")


def _set(tool: Tool, c: Conditions) -> Tool:
    """The tool with the speed and the feed of a pass."""
    return Tool(
        number=tool.number, name=tool.name, diameter=tool.diameter, speed=round(c.speed),
        feed=c.feed, plunge=tool.plunge, length=tool.length,
    )  # fmt: skip
