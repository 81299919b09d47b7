"""Look-ahead of the simulated control: the speed along one uninterrupted path of lines and arcs.

A corner is passed at the speed at which an arc that stays within the junction deviation of it would
be (Jeon 2011); acceleration along the path has limited jerk and is zero at the corners that bind.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.post import Step
from pipeline.shop.s_curve import (
    Floats,
    Profile,
    change_distance,
    profile,
    reachable_speed,
)

STRAIGHT = 1e-9
"""Below this 1 - cos of half the change of direction, a corner is none."""


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """N blocks of a path.

    Parameters
    ----------
    length : (N,) array
        [mm].
    begin, end : (N, 3) arrays
        Directions at both ends.
    cap : (N,) array
        Greatest speed in the block [mm/s].
    """

    length: Floats
    begin: Floats
    end: Floats
    cap: Floats


@dataclass(frozen=True, kw_only=True)
class Section:
    """A path from standstill to standstill: its profile and where its blocks end [mm], (N,)."""

    motion: Profile
    ends: Floats
    lines: np.ndarray  # (N,) of the program


def section(
    start: Sequence[float], steps: Sequence[Step], feeds: Floats, control: ControlParameters
) -> Section:
    """Plan ``steps`` (lines and arcs) from ``start`` [mm] with ``feeds`` (N,) [mm/s]."""
    blocks = _blocks(start, steps, feeds, control)
    a, j = control.cutting_acceleration * 1e3, control.cutting_jerk * 1e3
    ends = np.cumsum(blocks.length)
    corner = _corner_speeds(blocks, control)
    _see_no_further(corner, ends, blocks.cap, control)
    nodes = _critical(blocks, corner, a)
    lengths = np.diff(np.concatenate([[0.0], ends])[nodes])
    caps = np.minimum.reduceat(blocks.cap, nodes[:-1])
    limit = np.concatenate([[0.0], corner[nodes[1:-1] - 1], [0.0]])
    speeds = _passed(limit, lengths, a, j)
    motion = profile(speeds, lengths, caps, a, j)
    return Section(motion=motion, ends=ends, lines=np.array([s.line for s in steps]))


def _blocks(
    start: Sequence[float], steps: Sequence[Step], feeds: Floats, control: ControlParameters
) -> Blocks:
    points = np.array([start, *(s.end for s in steps)])
    way = np.diff(points, axis=0)
    turn = np.array([s.turn for s in steps])
    centre = np.array([s.centre for s in steps])
    arc = turn != 0
    r_0, r_1 = points[:-1, :2] - centre, points[1:, :2] - centre
    radius = np.hypot(r_0[:, 0], r_0[:, 1])
    planar = np.where(arc, np.abs(turn) * radius, np.hypot(way[:, 0], way[:, 1]))
    length = np.hypot(planar, way[:, 2])
    begin, end = way / length[:, None], way / length[:, None]
    for unit, r in ((begin, r_0), (end, r_1)):
        across = np.stack([-r[:, 1], r[:, 0]], axis=1) * np.sign(turn)[:, None]
        size = np.hypot(across[:, 0], across[:, 1])
        share = np.divide(planar / length, size, out=np.zeros_like(size), where=arc)
        unit[arc, :2] = (across * share[:, None])[arc]
    cap = np.minimum(feeds, control.greatest_feed / 60)
    bound = np.sqrt(control.centripetal_acceleration * 1e3 * radius)
    cap = np.where(arc, np.minimum(cap, bound), cap)
    return Blocks(length=length, begin=begin, end=end, cap=cap)


def _corner_speeds(blocks: Blocks, control: ControlParameters) -> Floats:
    """Greatest speed at each corner inside the path [mm/s], shape (N - 1,)."""
    cosine = (blocks.end[:-1] * blocks.begin[1:]).sum(axis=1)
    half = np.sqrt(np.clip((1 + cosine) / 2, 0, 1))  # sine of half the angle that both sides form
    square = control.centripetal_acceleration * 1e3 * control.junction_deviation * half
    bend = np.maximum(1 - half, STRAIGHT)
    speed = np.where(1 - half > STRAIGHT, np.sqrt(square / bend), np.inf)
    return np.minimum(speed, np.minimum(blocks.cap[:-1], blocks.cap[1:]))


def _see_no_further(corner: Floats, ends: Floats, cap: Floats, control: ControlParameters) -> None:
    """Be able to stop at the end of what is looked ahead; in place."""
    seen = control.look_ahead
    if len(ends) <= seen:
        return
    a, j = control.cutting_acceleration * 1e3, control.cutting_jerk * 1e3
    inside = slice(0, len(ends) - seen)
    room = ends[seen:] - ends[inside]
    still = np.zeros(len(room))
    corner[inside] = np.minimum(corner[inside], reachable_speed(still, room, cap[inside], a, j))


def _critical(blocks: Blocks, corner: Floats, a: float) -> np.ndarray:
    """Indices of the ends and of corners whose own speed binds a plan of constant acceleration.

    Between them a plan with limited jerk is nowhere faster than that one, so that it keeps to the
    corners in between.
    """
    limit = [0.0, *(corner**2).tolist(), 0.0]
    reach = (2 * a * blocks.length).tolist()
    plan = limit[:]
    for k in range(len(reach) - 1, 0, -1):
        plan[k] = min(plan[k], plan[k + 1] + reach[k])
    for k in range(1, len(reach)):
        plan[k] = min(plan[k], plan[k - 1] + reach[k - 1])
    change = blocks.cap[:-1] != blocks.cap[1:]
    slow = corner < np.minimum(blocks.cap[:-1], blocks.cap[1:])
    binds = np.array(plan[1:-1]) >= corner**2
    inside = np.flatnonzero(change | (slow & binds)) + 1
    return np.concatenate([[0], inside, [len(reach)]])


def _passed(limit: Floats, lengths: Floats, a: float, j: float) -> Floats:
    """Speeds at the nodes: each can be reached from the one before and left for the next."""
    speeds = limit.copy()
    count = len(lengths)
    for here, there in [(k, k + 1) for k in range(count - 1, -1, -1)] + [
        (k + 1, k) for k in range(count)
    ]:
        v, u, way = speeds[here], speeds[there], lengths[min(here, there)]
        if v > u and change_distance(u, v, a, j) > way:
            speeds[here] = reachable_speed(u, way, v, a, j)
    return speeds
