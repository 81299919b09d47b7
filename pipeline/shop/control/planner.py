"""Motion planner of the simulated control: look-ahead, rapids, waits, spindle ramps of a program.

A corner is passed at the speed of an arc that stays within the junction deviation of it (Jeon
2011); acceleration along the path has limited jerk and is zero at the corners that bind.  In rapids
each axis goes as fast as it can; at each standstill the next block waits until the axes, which lag
behind their commands, are in position.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import inf, log
from typing import NamedTuple

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import RPM
from pipeline.shop.control.postprocessor import PartProgram, Step
from pipeline.shop.motion import Profile, change_distance, profile, reachable_speed, rest_to_rest
from pipeline.shop.parameters import ControlParameters, MotorParameters, Random

STRAIGHT = 1e-9
"""Least 1 - cos of half the change of direction at which a corner counts as one [1]."""
SHORTEST = 1e-6
"""Shorter distances count as no motion [mm]."""
HOME = (-400.0, 0.0, 0.0)
"""Place of the machine before its first run, in its own frame [mm]."""


class Blocks(NamedTuple):
    """N blocks of a path."""

    length: Floats  # (N,) [mm]
    begin: Floats  # (N, 3), direction at the beginning
    end: Floats  # (N, 3), direction at the end
    cap: Floats  # (N,), greatest speed [mm/s]


@dataclass(frozen=True, kw_only=True)
class Section:
    """A path of N blocks from standstill to standstill."""

    start: Sequence[float]
    """Programmed X Y Z before it [mm]."""
    steps: tuple[Step, ...]
    """Lines and arcs of the path."""
    motion: Profile
    """Motion along the path."""
    ends: Floats
    """Path length at which each block ends [mm]."""

    @property
    def lines(self) -> Ints:
        """Line of the program of each block, shape (N,)."""
        return np.array([s.line for s in self.steps])

    @property
    def points(self) -> Floats:
        """Programmed ends of the blocks, the start before them, shape (N + 1, 3) [mm]."""
        return np.array([self.start, *(s.end for s in self.steps)])


def section(
    start: Sequence[float], steps: Sequence[Step], feeds: Floats, control: ControlParameters
) -> Section:
    """Plan ``steps`` (lines and arcs) from ``start`` [mm] with ``feeds`` (N,) [mm/s]."""
    blocks = _blocks(start, steps, feeds, control)
    a, j = control.path_bounds
    ends = np.cumsum(blocks.length)
    corner = _corner_speeds(blocks, control)
    _limit_to_look_ahead(corner, ends, blocks.cap, control)
    nodes = _critical(blocks, corner, a)
    lengths = np.diff(np.concatenate([[0.0], ends])[nodes])
    caps = np.minimum.reduceat(blocks.cap, nodes[:-1])
    limit = np.concatenate([[0.0], corner[nodes[1:-1] - 1], [0.0]])
    speeds = _reachable_nodes(limit, lengths, a, j)
    motion = profile(speeds, lengths, caps, a, j)
    return Section(start=start, steps=tuple(steps), motion=motion, ends=ends)


def _blocks(
    start: Sequence[float], steps: Sequence[Step], feeds: Floats, control: ControlParameters
) -> Blocks:
    points = np.array([start, *(s.end for s in steps)])
    step = np.diff(points, axis=0)
    turn = np.array([s.turn for s in steps])
    centre = np.array([s.centre for s in steps])
    arc = turn != 0
    r_0, r_1 = points[:-1, :2] - centre, points[1:, :2] - centre
    radius = np.hypot(r_0[:, 0], r_0[:, 1])
    planar = np.where(arc, np.abs(turn) * radius, np.hypot(step[:, 0], step[:, 1]))
    length = np.hypot(planar, step[:, 2])
    begin, end = step / length[:, None], step / length[:, None]
    for unit, r in ((begin, r_0), (end, r_1)):
        across = np.stack([-r[:, 1], r[:, 0]], axis=1) * np.sign(turn)[:, None]
        size = np.hypot(across[:, 0], across[:, 1])
        share = np.divide(planar / length, size, out=np.zeros_like(size), where=arc)
        unit[arc, :2] = (across * share[:, None])[arc]
    cap = np.minimum(feeds, control.greatest_feed / 60)
    bound = np.sqrt(control.centripetal_acceleration * 1e3 * radius)
    cap = np.where(arc, np.minimum(cap, bound), cap)
    return Blocks(length, begin, end, cap)


def _corner_speeds(blocks: Blocks, control: ControlParameters) -> Floats:
    """Greatest speed at each corner inside the path [mm/s], shape (N - 1,)."""
    cosine = (blocks.end[:-1] * blocks.begin[1:]).sum(axis=1)
    half = np.sqrt(np.clip((1 + cosine) / 2, 0, 1))  # sine of half the angle that both sides form
    square = control.centripetal_acceleration * 1e3 * control.junction_deviation * half
    bend = np.maximum(1 - half, STRAIGHT)
    speed = np.where(1 - half > STRAIGHT, np.sqrt(square / bend), np.inf)
    return np.minimum(speed, np.minimum(blocks.cap[:-1], blocks.cap[1:]))


def _limit_to_look_ahead(
    corner: Floats, ends: Floats, cap: Floats, control: ControlParameters
) -> None:
    """Limit corner speeds, in place, so that the path can stop where the look-ahead ends."""
    count = control.look_ahead
    if len(ends) <= count:
        return
    inside = slice(0, len(ends) - count)
    ahead = ends[count:] - ends[inside]
    fastest = reachable_speed(np.zeros(len(ahead)), ahead, cap[inside], *control.path_bounds)
    corner[inside] = np.minimum(corner[inside], fastest)


def _critical(blocks: Blocks, corner: Floats, a: float) -> Ints:
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


def _reachable_nodes(limit: Floats, lengths: Floats, a: float, j: float) -> Floats:
    """Speeds at the nodes: each can be reached from the one before and left for the next."""
    speeds = limit.copy()
    count = len(lengths)
    backward = [(k, k + 1) for k in range(count - 1, -1, -1)]
    for here, there in backward + [(k + 1, k) for k in range(count)]:
        v, u, length = speeds[here], speeds[there], lengths[min(here, there)]
        if v > u and change_distance(u, v, a, j) > length:
            speeds[here] = reachable_speed(u, length, v, a, j)
    return speeds


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """Change of spindle speed from ``n_0`` to ``n_1`` [rev/min] at ``overload`` [1] rated powers.

    J dω/dt = P/max(ω, ω_b): from rest, ω takes J ω_b ω / P up to ω_b and J (ω² + ω_b²) / 2P above.
    """

    motor: MotorParameters
    overload: float
    n_0: float
    n_1: float

    @property
    def duration(self) -> float:
        """Time from one speed to the other [s]."""
        return abs(self._from_rest(self.n_1) - self._from_rest(self.n_0))

    def at(self, time: Floats) -> Floats:
        """Speed ``time`` (T,) [s] after the beginning [rev/min]; ``n_1`` after the end."""
        elapsed = np.clip(time, 0, self.duration)
        rising = 1 if self.n_1 > self.n_0 else -1
        spent = np.maximum(self._from_rest(self.n_0) + rising * elapsed, 0)
        base, lever = self.motor.base_speed * RPM, self.motor.inertia / self._power
        low = spent / (lever * base)
        high = np.sqrt(np.maximum(2 * spent / lever - base**2, 0))
        speed = np.where(low <= base, low, high) / RPM
        return np.where(time >= self.duration, self.n_1, speed)

    @property
    def _power(self) -> float:
        return self.overload * self.motor.rated_power

    def _from_rest(self, speed: float) -> float:
        omega, base = speed * RPM, self.motor.base_speed * RPM
        lever = self.motor.inertia / self._power
        return lever * (base * omega if omega <= base else (omega**2 + base**2) / 2)


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Actions of the person at the machine during a run; lines are those of the program."""

    feed_override: tuple[tuple[int, float], ...] = ((0, 100.0),)
    """Feed override from a line on [percent]; the first has line 0."""
    rapid_override: float = 100.0
    """Rapid override [percent]."""
    holds: Mapping[int, float] = field(default_factory=dict)
    rapid_stops: Mapping[int, float] = field(default_factory=dict)
    """Feed hold in a cut; rapid override turned to 0 before the first rapid of a line."""
    abort: int | None = None
    """Line in which the run is stopped."""

    def feed_at(self, line: int) -> float:
        """Feed override in ``line`` [percent]."""
        return [percent for since, percent in self.feed_override if since <= line][-1]


@dataclass(frozen=True, kw_only=True)
class Span:
    """A stretch of time: a cut (with ``section``), a rapid (``axes``) or a wait (neither).

    ``begin`` and ``target`` are X Y Z at both ends in the machine's frame [mm].
    """

    kind: str
    start: float
    end: float
    line: int
    tool: int
    begin: tuple[float, ...]
    target: tuple[float, ...]
    section: Section | None = None
    axes: tuple[Profile, ...] = ()

    def positions(self, time: Floats) -> Floats:
        """Position (T, 3) [mm] at times since the start of a rapid or wait, also after its end."""
        position = np.tile(np.array(self.begin), (time.size, 1))
        profiles = iter(self.axes)
        for k, (a, b) in enumerate(zip(self.begin, self.target, strict=True)):
            if self.axes and abs(b - a) > SHORTEST:
                position[:, k] += np.sign(b - a) * next(profiles).covered(time)
        return position


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Spans of a run, in seconds from its start without the operator's holds."""

    spans: tuple[Span, ...]
    ramps: tuple[tuple[float, Ramp], ...]  # of the spindle, with their beginnings
    tool: int  # in the spindle before

    @property
    def duration(self) -> float:
        """Time of the whole run [s]."""
        return self.spans[-1].end

    def spindle_speed(self, time: Floats) -> Floats:
        """Commanded speed of the spindle, ramps included, at ``time`` (T,) [rev/min]."""
        speed = np.zeros(time.size)
        for start, ramp in self.ramps:
            speed = np.where(time >= start, ramp.at(time - start), speed)
        return speed


@dataclass(kw_only=True)
class Control:
    """A control that runs a program; ``place`` is X Y Z in the machine's frame [mm]."""

    parameters: ControlParameters
    motor: MotorParameters
    lengths: Mapping[int, float]
    random: Random
    tool: int
    operator: Operator = field(default_factory=Operator)
    place: list[float] = field(default_factory=lambda: list(HOME))
    time: float = 0.0
    line: int = 0
    speed: float = 0.0  # of the spindle, commanded [rev/min]
    answered: float = 0.0  # when the line's M3 or M5 lets the next line go on
    turning: float = 0.0  # when the spindle has its speed
    spans: list[Span] = field(default_factory=list)
    ramps: list[tuple[float, Ramp]] = field(default_factory=list)
    stops: dict[int, float] = field(default_factory=dict)  # of rapids, that are still to come

    def run(self, program: PartProgram) -> Plan:
        """Plan the whole program."""
        self.stops, tool = dict(self.operator.rapid_stops), self.tool
        before = (0.0, 0.0, inf)
        for steps in _stretches(program.steps):
            if steps[0].line != self.line:
                self._wait("spindle", self.answered)
                self.line = steps[0].line
            if steps[0].kind in ("line", "arc"):
                self._cut(before, steps)
            else:
                self._do(steps[0])
            before = steps[-1].end
        return Plan(spans=tuple(self.spans), ramps=tuple(self.ramps), tool=tool)

    def _do(self, step: Step) -> None:
        times = self.parameters.codes
        match step.kind:
            case "rapid":
                self._rapid(self._machine(step))
            case "home":
                self._rapid([*self.place[:2], 0.0])
            case "tool":
                self._change(step.number)
            case "spindle":
                self._turn(float(step.number), times.m3 if step.number else times.m5)
            case "dwell":
                self._wait("dwell", self.time + step.seconds)
            case _:
                answer = self._scattered(getattr(times, f"m{step.number}"))
                self._wait("code", self.time + answer)

    def _machine(self, step: Step) -> list[float]:
        offset = self.parameters.work_offset
        x, y, z = (p + o for p, o in zip(step.end, offset, strict=True))
        return [x, y, self.place[2] if z == inf else z + self.lengths[self.tool]]

    def _cut(self, before: Sequence[float], steps: Sequence[Step]) -> None:
        if self.parameters.spindle_wait == "before_cutting":
            self._wait("spindle", self.turning)
        feeds = np.array([s.feed / 60 * self.operator.feed_at(s.line) / 100 for s in steps])
        path = section(before, steps, feeds, self.parameters)
        self._span("cut", path.motion.duration, target=self._machine(steps[-1]), section=path)
        self.line = steps[-1].line
        self._settle((path.motion,))

    def _rapid(self, target: list[float]) -> None:
        if self.line in self.stops:
            self._wait("rapid_stop", self.time + self.stops.pop(self.line))
        share = self.operator.rapid_override / 100 / 60
        axes = tuple(
            rest_to_rest(round(abs(b - a), 6), axis.rapid * share, *axis.bounds)
            for a, b, axis in zip(self.place, target, self.parameters.axes, strict=True)
            if abs(b - a) > SHORTEST
        )
        if axes:
            self._span("rapid", max(p.duration for p in axes), target=target, axes=axes)
            self._settle(axes)
        self.place = target

    def _settle(self, axes: tuple[Profile, ...]) -> None:
        """Wait until the following error that each axis has when its motion ends has died down."""
        gain, window = self.parameters.position_gain, self.parameters.in_position
        last = max(p.duration for p in axes)
        self._wait("in_position", max(
            self.time - last + p.duration + log(max(p.lag(gain) / window, 1.0)) / gain for p in axes
        ))  # fmt: skip

    def _change(self, tool: int) -> None:
        self._wait("spindle", self.turning)
        self._rapid([*self.place[:2], self.parameters.change_height])
        scatter = self.parameters.tool_change_scatter
        until = self.time + self.parameters.tool_change + self.random.uniform(-scatter, scatter)
        self.tool = 0
        self._wait("tool_change", until)
        self.tool = tool

    def _turn(self, speed: float, answer: float) -> None:
        ramp = Ramp(
            motor=self.motor, overload=self.parameters.spindle_overload, n_0=self.speed, n_1=speed
        )
        self.ramps.append((self.time, ramp))
        self.speed, self.turning = speed, self.time + ramp.duration
        self.answered = self.time + self._scattered(answer)
        if self.parameters.spindle_wait == "at_m3":
            self.answered += ramp.duration

    def _scattered(self, seconds: float) -> float:
        scatter = self.parameters.codes.scatter
        return max(seconds + self.random.uniform(-scatter, scatter), 0.0)

    def _wait(self, kind: str, until: float) -> None:
        if until > self.time:
            self._span(kind, until - self.time)

    def _span(
        self, kind: str, seconds: float, *, target: list[float] | None = None,
        section: Section | None = None, axes: tuple[Profile, ...] = (),
    ) -> None:  # fmt: skip
        begin, end = tuple(self.place), self.time + seconds
        self.place = self.place if target is None else target
        self.spans.append(
            Span(kind=kind, start=self.time, end=end, line=self.line, tool=self.tool, begin=begin,
                 target=tuple(self.place), section=section, axes=axes)
        )  # fmt: skip
        self.time = end


def _stretches(steps: Sequence[Step]) -> Iterator[list[Step]]:
    """Cuts that follow one another together; every other step alone."""
    for cuts, group in groupby(steps, key=lambda s: s.kind in ("line", "arc")):
        together = list(group)
        yield from [together] if cuts else ([step] for step in together)
