"""Part programs of a mill's control: facing, contours, pockets, chords, and four whole programs.

The corner of the workpiece is the origin, its top is Z 0.  Cutting data are those of catalogues
(Sandvik, Walter) for aluminium.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin

from pipeline.shop.control.postprocessor import PartProgram, Post, Tool
from pipeline.shop.parameters import ControlParameters, Random

Holes = list[tuple[float, float]]
Cut = Callable[[Post], None]
"""Writes the lines of one tool."""

CLEAR = 5.0
"""Height of rapids between cuts [mm]."""
TOOLS = (
    Tool(number=1, name="50MM FACE MILL", diameter=50, speed=5000, feed=2200, plunge=800),
    Tool(number=2, name="16MM ENDMILL", diameter=16, speed=6000, feed=1500, plunge=500),
    Tool(number=4, name="12MM ENDMILL", diameter=12, speed=8000, feed=2200, plunge=600),
    Tool(number=5, name="10MM ENDMILL", diameter=10, speed=9500, feed=2600, plunge=700),
    Tool(number=9, name="8MM FINISH ENDMILL", diameter=8, speed=11500, feed=3000, plunge=800),
    Tool(number=11, name="10MM SPOTDRILL", diameter=10, speed=4500, feed=400, plunge=400),
    Tool(number=12, name="6.8MM DRILL", diameter=6.8, speed=5200, feed=650, plunge=650),
    Tool(number=14, name="5MM DRILL", diameter=5, speed=6500, feed=600, plunge=600),
)


@dataclass(frozen=True, kw_only=True)
class Work:
    """A rectangular blank [mm]."""

    x: float
    y: float

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the workpiece in X and Y [mm]."""
        return self.x / 2, self.y / 2


def facing(post: Post, work: Work, depth: float) -> None:
    """Meander over the whole top, from outside to outside."""
    tool = post.tools[-1]
    over, step = tool.diameter / 2 + 4.0, 0.7 * tool.diameter
    rows = int(work.y // step) + 1
    post.approach(-over, 0.4 * step, 25.0)
    post.rapid(z=CLEAR)
    post.line(z=-depth, feed=tool.plunge)
    for row in range(rows):
        y = 0.4 * step + row * step
        post.line(y=y)
        post.line(x=work.x + over if row % 2 == 0 else -over)
    post.rapid(z=25.0)
    post.retract()


def contour(post: Post, work: Work, depths: list[float], springs: int = 0) -> None:
    """Around the work: two chamfers of 45°, a fillet, a sharp corner; tangential run in and out."""
    tool = post.tools[-1]
    r = tool.diameter / 2
    low, right, high = -r, work.x + r, work.y + r
    cut, fillet = 12.0, 9.0 + r
    post.approach(work.x / 2 + 8.0, low - 8.0, 25.0)
    for depth in depths + depths[-1:] * springs:
        post.rapid(work.x / 2 + 8.0, low - 8.0)
        post.rapid(z=CLEAR)
        post.line(z=-depth, feed=tool.plunge)
        post.arc(work.x / 2, low, (work.x / 2, low - 8.0), feed=tool.feed / 2)
        post.line(low + cut, low)
        post.line(low, low + cut)
        post.line(low, high - fillet)
        post.arc(low + fillet, high, (low + fillet, high - fillet), anticlockwise=False)
        post.line(right, high)
        post.line(right, low + cut)
        post.line(right - cut, low)
        post.line(work.x / 2, low)
        post.arc(work.x / 2 - 8.0, low - 8.0, (work.x / 2, low - 8.0))
        post.rapid(z=CLEAR)
    post.retract()


def pocket(post: Post, centre: tuple[float, float], radius: float, depth: float) -> None:
    """Round pocket: in by a helix, out by half circles that grow, a full circle at the wall."""
    tool = post.tools[-1]
    x, y = centre
    reach, start, step = radius - tool.diameter / 2, 0.3 * tool.diameter, 0.12 * tool.diameter
    post.approach(x + start, y, 25.0)
    post.rapid(z=2.0)
    loops = int(depth // 1.5) + 1
    for loop in range(loops):
        z = 0.5 - (loop + 1) * (depth + 0.5) / loops
        post.arc(x + start, y, centre, z=z, feed=tool.feed / 2)
    post.arc(x + start, y, centre, feed=tool.feed)
    r, side = start, 1
    while r + step < reach:
        r += step / 2
        post.arc(x - side * r, y, (x - side * step / 4, y))
        side = -side
    post.line(x + side * reach, y)
    post.arc(x + side * reach, y, centre)
    post.rapid(z=25.0)
    post.retract()


def trochoidal_slot(post: Post, start: tuple[float, float], length: float, depth: float) -> None:
    """Slot along X in loops: a cutting arc, then straight back with the tool lifted."""
    tool = post.tools[-1]
    x, y = start
    r, step = 0.45 * tool.diameter, 0.1 * tool.diameter
    post.approach(x, y - r, 25.0)
    post.rapid(z=2.0)
    post.line(z=-depth, feed=tool.plunge)
    for loop in range(int(length / step)):
        at = x + loop * step
        post.arc(at, y + r, (at, y), feed=tool.feed)
        post.line(at, y + r, -depth + 0.15, feed=3 * tool.feed)
        post.line(at + step, y - r, -depth + 0.15, feed=3 * tool.feed)
        post.line(z=-depth, feed=tool.feed)
    post.rapid(z=25.0)
    post.retract()


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A closed curve about a centre, with a radius that harmonics modulate [mm]."""

    centre: tuple[float, float]
    radius: float
    harmonics: tuple[tuple[int, float], ...]  # waves around, amplitude
    wave: float = 0.0  # of Z, three times around

    def point(self, angle: float, inset: float) -> tuple[float, float, float]:
        """X, Y and the rise of Z [mm] at ``angle`` [rad]."""
        r = self.radius - inset + sum(a * cos(n * angle) for n, a in self.harmonics)
        x, y = self.centre
        return x + r * cos(angle), y + r * sin(angle), self.wave * sin(3 * angle)


def chords(post: Post, curve: Curve, levels: int, chord: float, step: float) -> None:
    """Finish a wall in ``levels`` that go down by ``step`` [mm], in chords of about ``chord``."""
    tool = post.tools[-1]
    x, y, _ = curve.point(0.0, tool.diameter / 2)
    post.approach(x, y, 25.0)
    post.rapid(z=CLEAR)
    for level in range(levels):
        depth = -(level + 1) * step - curve.wave
        angle = 0.0
        x, y, rise = curve.point(angle, tool.diameter / 2)
        post.line(x, y, depth + rise, feed=tool.plunge if level == 0 else tool.feed)
        while angle < 2 * pi:
            ahead = curve.point(angle + 1e-3, tool.diameter / 2)
            here = curve.point(angle, tool.diameter / 2)
            angle += 1e-3 * chord / hypot(ahead[0] - here[0], ahead[1] - here[1])
            x, y, rise = curve.point(min(angle, 2 * pi), tool.diameter / 2)
            post.line(x, y, depth + rise)
    post.rapid(z=25.0)
    post.retract()


def drilling(post: Post, holes: Holes, depth: float, peck: float = 0.0) -> None:
    """Drill all holes; before the first the program waits for the coolant."""
    post.approach(*holes[0], 25.0)
    post.dwell(500)
    post.drill(holes, 2.0, -depth, peck)
    post.retract()


def bolt_circle(centre: tuple[float, float], radius: float, count: int) -> Holes:
    """Holes evenly spaced on a circle [mm]."""
    x, y = centre
    angles = (2 * pi * k / count for k in range(count))
    return [(x + radius * cos(a), y + radius * sin(a)) for a in angles]


def grid(work: Work, columns: int, rows: int, margin: float) -> Holes:
    """Holes in rows, back and forth [mm]."""
    dx, dy = (work.x - 2 * margin) / (columns - 1), (work.y - 2 * margin) / (rows - 1)
    return [
        (margin + (c if r % 2 == 0 else columns - 1 - c) * dx, margin + r * dy)
        for r in range(rows)
        for c in range(columns)
    ]


def part_programs(
    control: ControlParameters, random: Random
) -> tuple[list[PartProgram], PartProgram]:
    """Four programs of a machine, and the third as it was edited at the control."""
    lengths = [round(float(random.uniform(85, 165)), 3) for _ in TOOLS]
    pace = [round(float(random.uniform(0.85, 1.15)), 2) for _ in TOOLS]
    tools = {
        t.number: replace(t, length=length, feed=round(t.feed * share / 10) * 10.0)
        for t, length, share in zip(TOOLS, lengths, pace, strict=True)
    }
    work = Work(x=float(random.integers(110, 140)), y=float(random.integers(80, 100)))
    curve = Curve(
        centre=work.middle, radius=float(random.uniform(29, 33)),
        harmonics=((3, float(random.uniform(2.0, 3.2))), (7, float(random.uniform(0.7, 1.1)))),
        wave=float(random.uniform(0.2, 0.6)),
    )  # fmt: skip
    levels = int(random.integers(9, 11))
    holes, corners = grid(work, 4, 3, 14.0), grid(work, 3, 2, 12.0)
    circle = bolt_circle(work.middle, 26.0, 10)
    programs: dict[str, dict[int, Cut]] = {
        "BASE PLATE": {
            1: lambda post: facing(post, work, 1.0),
            2: lambda post: contour(post, work, [4.0, 8.0, 12.0], springs=1),
            11: lambda post: drilling(post, holes, 3.2),
            12: lambda post: drilling(post, holes, 16.0, peck=4.0),
        },
        "BEARING HOUSING": {
            1: lambda post: facing(post, work, 0.5),
            4: lambda post: pocket(post, (work.x * 0.33, work.y / 2), 26.0, 9.0),
            5: lambda post: trochoidal_slot(post, (work.x * 0.62, work.y / 2), 34.0, 6.0),
        },
        "CAM": {
            4: lambda post: pocket(post, work.middle, 21.0, 6.0),
            9: lambda post: chords(post, curve, levels, 0.6, 0.6),
        },
        "VALVE BLOCK": {
            11: lambda post: drilling(post, circle + corners, 2.6),
            14: lambda post: drilling(post, circle, 14.0, peck=3.5),
            12: lambda post: drilling(post, corners, 20.0, peck=5.0),
            2: lambda post: contour(post, work, [3.0]),
        },
    }
    edited = programs["CAM"] | {9: lambda post: chords(post, curve, levels + 1, 0.6, 0.6)}

    def written(number: int, title: str, cuts: Mapping[int, Cut]) -> PartProgram:
        name = f"O{control.first_program + number}"
        post = begin_program(control, name, title, [tools[k] for k in cuts])
        for tool, cut in cuts.items():
            post.take(tools[tool])
            cut(post)
        return post.end(name)

    all_four = [written(k, title, cuts) for k, (title, cuts) in enumerate(programs.items(), 1)]
    return all_four, written(3, "CAM", edited)


def begin_program(control: ControlParameters, name: str, title: str, tools: list[Tool]) -> Post:
    """A program with its head written, in the format of the machine's postprocessor."""
    post = Post(
        numbered=control.numbered, spaced=not control.numbered,
        peck_clearance=control.peck_clearance,
    )  # fmt: skip
    post.begin(name, title, tools, control.work_offset)
    return post
