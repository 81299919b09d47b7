"""Cuts of part programs: facing, contours, pockets, curves of short chords.

Each writes its lines into a :class:`~pipeline.shop.post.Post` whose tool has been taken; the work's
corner is the origin, its top is Z 0.
"""

from dataclasses import dataclass
from math import cos, hypot, pi, sin

from pipeline.shop.post import Post

Holes = list[tuple[float, float]]

CLEAR = 5.0
"""Height of rapids between cuts [mm]."""


@dataclass(frozen=True, kw_only=True)
class Work:
    """A rectangular blank [mm]."""

    x: float
    y: float

    @property
    def middle(self) -> tuple[float, float]:
        """Its centre."""
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
    turns = int(depth // 1.5) + 1
    for turn in range(turns):
        z = 0.5 - (turn + 1) * (depth + 0.5) / turns
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
    """A closed curve about a centre, as far from it as harmonics make it [mm]."""

    centre: tuple[float, float]
    radius: float
    harmonics: tuple[tuple[int, float], ...]  # waves around, amplitude
    wave: float = 0.0  # of Z, three times around

    def point(self, angle: float, inset: float) -> tuple[float, float, float]:
        """X, Y and what Z rises, at ``angle`` [rad]."""
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
    """Drill all holes; the first is waited for, until the coolant comes."""
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
