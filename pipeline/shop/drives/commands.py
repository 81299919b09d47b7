"""Commanded positions of the axes: strokes, circles and part programs, smoothed as controls do.

Positions are in mm at the rate of the position loops; programs run in the machine's frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.control.planner import Control, Section, Span
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.motion import change_time, rest_to_rest
from pipeline.shop.parameters import Bounds, ShopParameters

BELL = (0.008, 0.004)
"""Lengths of the two moving averages after the interpolation [s]."""
REST = 0.3
"""Standstill before and after [s]."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """One stroke: signed length [mm], greatest speed [mm/s], standstill after it [s]."""

    length: float
    speed: float
    pause: float = 0.12


def travel(moves: Sequence[Move], bounds: Bounds, frequency: int) -> Floats:
    """Position along ``moves`` from 0 [mm] at ``frequency`` [Hz], shape (T,)."""
    profiles = [rest_to_rest(abs(m.length), m.speed, *bounds) for m in moves]
    seconds = [p.duration + m.pause for p, m in zip(profiles, moves, strict=True)]
    starts = np.cumsum([REST, *seconds])
    time: Floats = np.arange(int((starts[-1] + REST) * frequency), dtype=np.float64) / frequency
    position: Floats = np.zeros(time.size)
    place = 0.0
    edges = pairwise([*np.searchsorted(time, starts[:-1]).tolist(), time.size])
    for (first, last), start, move, one in zip(edges, starts[:-1], moves, profiles, strict=True):
        position[first:last] = place + np.sign(move.length) * one.covered(time[first:last] - start)
        place += move.length
    return smoothed(position, frequency)


def smoothed(position: Floats, frequency: int) -> Floats:
    """Mean over the last moments, twice; before the beginning it stood at ``position[0]``."""
    result = position - position[0]
    for length in BELL:
        window = max(round(length * frequency), 1)
        total = np.cumsum(result)
        total[window:] -= total[:-window].copy()
        result = total / window
    ended: Floats = result + position[0]
    return ended


def reciprocation(speeds: Sequence[float], rapid: float, bounds: Bounds, lead: float) -> list[Move]:
    """Back and forth at each speed and at rapid, from both ends of the range, then reversals.

    Plateaus last 1 s at creep and 0.36 s at least.  The other end is no whole number of leads [mm]
    away; speeds below ``rapid`` [mm/s] count.
    """
    strokes = [(v, _stroke(v, bounds)) for v in (*(v for v in speeds if v < rapid), rapid)]
    moves = [Move(length=sign * s, speed=v) for v, s in strokes for sign in (1, -1)]
    revolutions = np.floor(strokes[-1][1] / lead) + 0.37
    moves.append(Move(length=float(revolutions * lead), speed=rapid))
    moves += [Move(length=sign * s, speed=v) for v, s in strokes for sign in (-1, 1)]
    return moves + quick_strokes(6, -40.0, rapid)


def _stroke(speed: float, bounds: Bounds) -> float:
    """Length [mm] of a stroke with a plateau at ``speed`` [mm/s]."""
    bends = change_time(np.zeros(1), np.array([speed]), *bounds)[0]
    return speed * (min(max(6.0 / speed, 0.36), 1.0) + float(bends))


def quick_strokes(count: int, length: float, speed: float) -> list[Move]:
    """Short strokes, one directly after the other."""
    return [Move(length=(-1) ** k * length, speed=speed, pause=0.02) for k in range(2 * count)]


def circles(
    diameter: float, feeds: Sequence[float], revolutions: float, bounds: Bounds, frequency: int
) -> tuple[Floats, Floats]:
    """X and Y [mm] on a circle about 0, at each of ``feeds`` [mm/s] there and back."""
    radius = diameter / 2
    length = revolutions * pi * diameter
    moves = [Move(length=s * length, speed=v, pause=0.5) for v in feeds for s in (1, -1)]
    angle = travel(moves, bounds, frequency) / radius
    return radius * np.cos(angle), radius * np.sin(angle)


def commanded(
    program: PartProgram, parameters: ShopParameters, frequency: int, place: Sequence[float]
) -> Floats:
    """Commanded X Y Z in the machine's frame [mm], shape (T, 3), from ``place`` to the end."""
    plan = Control(
        parameters=parameters.control, motor=parameters.spindle.motor, lengths=program.lengths,
        random=parameters.generator("servo program"), place=list(place),
        tool=program.tools[-1].number,
    ).run(program)  # fmt: skip
    time: Floats = np.arange(int((plan.duration + 2 * REST) * frequency)) / frequency - REST
    position: Floats = np.tile(np.array(place), (time.size, 1))
    spans = [s for s in plan.spans if s.kind == "rapid" or s.section is not None]
    starts = np.searchsorted(time, [s.start for s in spans]).tolist()
    for (first, last), span in zip(pairwise([*starts, time.size]), spans, strict=True):
        if first < last:
            within, path = time[first:last] - span.start, span.section
            position[first:last] = (
                span.positions(within) if path is None else _cut_position(span, path, within)
            )
    return np.stack([smoothed(position[:, k], frequency) for k in range(3)], axis=1)


def _cut_position(span: Span, section: Section, time: Floats) -> Floats:
    """Position (T, 3) [mm] at times since the start of a cut, also after its end."""
    along, ends, points = section.motion.covered(time), section.ends, section.points
    block = np.minimum(np.searchsorted(ends, along), len(ends) - 1)
    begins = np.concatenate([[0.0], ends[:-1]])
    share = np.clip((along - begins[block]) / (ends - begins)[block], 0, 1)
    a, b = points[block], points[block + 1]
    position = a + (b - a) * share[:, None]
    # on an arc the radius of its first point turns about the centre
    turn = np.array([s.turn for s in section.steps])[block]
    arc = turn != 0
    centre = np.array([s.centre for s in section.steps])[block]
    r = a[:, :2] - centre
    c, s = np.cos(turn * share), np.sin(turn * share)
    turned = centre + np.stack([c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1]], axis=1)
    position[arc, :2] = turned[arc]
    # from the program's frame to the machine's
    shifted: Floats = position + (np.array(span.begin) - np.array(section.start))
    return shifted
