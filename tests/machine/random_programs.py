"""Random programs under random controls, and what must hold for every one of them.

Everything is judged from sampled positions and the numbers of the parameters; nothing of the
planner's own speeds is used.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.gcode.moves import Kind, Moves, PathMode
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from tests.machine.programs import IN_PLANE, Writer

PERIOD = 2.5e-4


def random_control(rng, *, corner, filters=True, profile="trapezoid"):
    def between(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def axis():
        return AxisParameters(
            rapid_speed=between(4000, 30000),
            cutting_speed=between(1500, 12000),
            rapid_acceleration=between(500, 8000),
            cutting_acceleration=between(300, 4000),
            arc_acceleration=between(100, 2000),
            corner_jump=between(20, 800),
            jerk=between(1e4, 2e5),
        )

    def pair():
        long = float(rng.choice([0.002, 0.004, 0.0073, 0.012]))
        short = float(rng.choice([0.0, 0.001, 0.0035, long]))
        return (long, short) if rng.random() < 0.5 else (short, long)

    cutting = pair() if filters else (0.0, 0.0)
    return ControlParameters(
        axes={letter: axis() for letter in "XYZ"},
        corner=corner,
        tolerance=between(0.002, 0.05),
        cutting_filter=cutting,
        rapid_filter=cutting if rng.random() < 0.5 or not filters else pair(),
        profile=profile,
        rapid_mode=str(rng.choice(["linear", "linear", "independent"])),
        rapid_stop=str(rng.choice(["always", "change", "never"])),
    )


def random_moves(rng, *, spirals=False):
    """Three to five pieces: lines, curves of chords, arcs, tangents, rapids, returns."""
    writer = Writer(rng.uniform(-20, 20, 6) * [1, 1, 1, 0, 0, 0])
    pieces = [_lines, _chords, _chords, _arc, _tangents, _rapid, _return, _specks]
    for _ in range(rng.integers(3, 6)):
        feed = float(np.exp(rng.uniform(np.log(200), np.log(15000))))
        exact = rng.random() < 0.1
        writer.set(feed=feed, path_mode=PathMode.EXACT_STOP if exact else PathMode.CONTINUOUS)
        pieces[rng.integers(len(pieces))](rng, writer)
    if spirals:
        writer.arc(writer.at[:2] + rng.normal(0, 1, 2), rng.uniform(1, 9), rise=rng.normal(0, 1),
                   growth=rng.uniform(0, 2))  # fmt: skip
    return writer.moves


def _lines(rng, writer):
    for _ in range(rng.integers(1, 4)):
        step = rng.normal(0, 1, 3) * (rng.random(3) < 0.7) * np.exp(rng.uniform(-3, 1))
        writer.by(step if step.any() else [0.1])


def _chords(rng, writer):
    count, radius = rng.integers(4, 15), np.exp(rng.uniform(-2, 2))
    turn = rng.uniform(0.02, 0.6) * rng.choice([-1, 1])
    heading, tilt = rng.uniform(0, 2 * np.pi), rng.normal(0, 0.2)
    for _ in range(count):
        heading += turn
        size = radius * abs(turn) * rng.uniform(0.3, 1.5)
        writer.by(size * np.array([np.cos(heading), np.sin(heading), tilt]))


def _arc(rng, writer):
    plane = int(rng.choice([17, 18, 19]))
    a, b, _ = IN_PLANE[plane]
    offset = rng.normal(0, 1, 2) * np.exp(rng.uniform(-2, 1))
    angle = rng.choice([-1, 1]) * rng.uniform(0.1, 7)
    writer.arc(writer.at[[a, b]] + offset, angle, plane=plane)


def _tangents(rng, writer):
    heading, size = rng.uniform(0, 2 * np.pi), np.exp(rng.uniform(-2, 1))
    along = np.array([np.cos(heading), np.sin(heading)])
    writer.by(size * along)
    radius = np.exp(rng.uniform(-2, 1))
    angle = rng.uniform(0.2, 3)
    writer.arc(writer.at[:2] + radius * np.array([-along[1], along[0]]), angle)
    heading += angle
    writer.by(size * np.array([np.cos(heading), np.sin(heading)]))


def _rapid(rng, writer):
    for _ in range(rng.integers(1, 3)):
        writer.by(rng.normal(0, 3, 3), Kind.RAPID)


def _return(rng, writer):
    step = rng.normal(0, 1, 3) * np.exp(rng.uniform(-2, 1))
    writer.by(step).by(-step)


def _specks(rng, writer):
    for _ in range(5):
        writer.by(rng.normal(0, 1, 3) * np.exp(rng.uniform(-8, -3)))


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Limits of the axes X, Y, Z in SI, of cutting and of rapids; shape (3,)."""

    speed: np.ndarray
    acceleration: np.ndarray
    jump: np.ndarray


def bounds(control: ControlParameters, *, rapid: bool) -> Bounds:
    axes = [control.axes[letter] for letter in "XYZ"]

    def column(name, factor):
        return np.array([getattr(a, name) for a in axes]) * factor

    along = column("rapid_acceleration" if rapid else "cutting_acceleration", 1e-3)
    return Bounds(
        speed=column("rapid_speed" if rapid else "cutting_speed", 1e-3 / 60),
        acceleration=along + column("arc_acceleration", 1e-3),
        jump=column("corner_jump", 1e-3 / 60),
    )


def deviation(points: np.ndarray, moves: Moves) -> np.ndarray:
    """Distance of points, shape (T, 3), from the programmed lines and arcs [mm]; shape (T,)."""
    nearest = np.full(len(points), np.inf)
    for k, (start, end) in enumerate(zip(moves.start, moves.end, strict=True)):
        if moves.kind[k] == Kind.ARC:
            distance = _from_arc(points, moves, k, start[:3])
        else:
            distance = _from_line(points, start[:3], end[:3])
        nearest = np.minimum(nearest, distance)
    return nearest


def _from_line(points, start, end):
    along = end - start
    size = along @ along
    part = np.clip((points - start) @ along / size, 0, 1) if size else np.zeros(len(points))
    return np.linalg.norm(points - start - part[:, None] * along, axis=1)


def _from_arc(points, moves, k, start):
    """Of a plane arc: the point of the circle below, or one of the ends."""
    a, b, n = IN_PLANE[int(moves.plane[k])]
    centre = moves.centre[k]
    u, v = points[:, a] - centre[a], points[:, b] - centre[b]
    radius = np.hypot(start[a] - centre[a], start[b] - centre[b])
    phi = np.arctan2(start[b] - centre[b], start[a] - centre[a])
    turned = np.sign(moves.angle[k]) * (np.arctan2(v, u) - phi) % (2 * np.pi)
    on = turned <= abs(moves.angle[k])
    height = points[:, n] - start[n]
    from_circle = np.hypot(np.hypot(u, v) - radius, height)
    ends = [np.linalg.norm(points - p, axis=1) for p in (start, moves.end[k, :3])]
    return np.where(on, from_circle, np.minimum(*ends))
