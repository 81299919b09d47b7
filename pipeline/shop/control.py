"""The control of a simulated mill: what it does with a part program, and when.

Another planner than the twin's.  Cuts run through without a stop where nothing else happens between
them (:mod:`pipeline.shop.control_path`); in rapids each axis goes as fast as it can; at each
standstill the next block waits until the axes, which lag behind their commands, are in position.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from math import inf, log

import numpy as np

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.control_path import Section, section
from pipeline.shop.post import PartProgram, Step
from pipeline.shop.s_curve import Profile, rest_to_rest
from pipeline.shop.spindle_parameters import MotorParameters
from pipeline.shop.spindle_ramp import Ramp

SHORTEST = 1e-6
"""Ways that are shorter are none [mm]."""


@dataclass(frozen=True, kw_only=True)
class Operator:
    """What the person at the machine does to a run; lines are those of the program.

    Parameters
    ----------
    feed_override : tuple of (line, percent)
        In force from that line on; the first has line 0.
    rapid_override : float
        [percent].
    holds, rapid_stops : mapping of line to seconds
        Feed hold in a cut; rapid override turned to 0 before the first rapid of a line.
    abort : int or None
        Line in which the run is stopped.
    """

    feed_override: tuple[tuple[int, float], ...] = ((0, 100.0),)
    rapid_override: float = 100.0
    holds: Mapping[int, float] = field(default_factory=dict)
    rapid_stops: Mapping[int, float] = field(default_factory=dict)
    abort: int | None = None

    def feed_at(self, line: int) -> float:
        """Feed override in ``line`` [percent]."""
        return [percent for since, percent in self.feed_override if since <= line][-1]


@dataclass(frozen=True, kw_only=True)
class Span:
    """A stretch of time: a cut (with ``section``), a rapid (``axes``) or a wait (neither)."""

    kind: str
    start: float
    end: float
    line: int
    tool: int
    section: Section | None = None
    axes: tuple[Profile, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What happens when, in seconds from the start of the run without the operator's holds."""

    spans: tuple[Span, ...]
    ramps: tuple[tuple[float, Ramp], ...]  # of the spindle, with their beginnings
    tool: int  # in the spindle before

    @property
    def duration(self) -> float:
        """[s]."""
        return self.spans[-1].end


@dataclass(kw_only=True)
class Control:
    """A control that runs a program; ``place`` is X Y Z in the machine's frame [mm]."""

    parameters: ControlParameters
    motor: MotorParameters
    lengths: Mapping[int, float]
    operator: Operator
    random: np.random.Generator
    place: list[float]
    tool: int
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
                self._code(getattr(times, f"m{step.number}"))

    def _machine(self, step: Step) -> list[float]:
        offset = self.parameters.work_offset
        x, y, z = (p + o for p, o in zip(step.end, offset, strict=True))
        return [x, y, self.place[2] if z == inf else z + self.lengths[self.tool]]

    def _cut(self, before: Sequence[float], steps: Sequence[Step]) -> None:
        if self.parameters.spindle_wait == "before_cutting":
            self._wait("spindle", self.turning)
        feeds = np.array([s.feed / 60 * self.operator.feed_at(s.line) / 100 for s in steps])
        path = section(before, steps, feeds, self.parameters)
        self._span("cut", path.motion.duration, section=path)
        self.place, self.line = self._machine(steps[-1]), steps[-1].line
        self._settle((path.motion,))

    def _rapid(self, target: list[float]) -> None:
        if self.line in self.stops:
            self._wait("rapid_stop", self.time + self.stops.pop(self.line))
        share = self.operator.rapid_override / 100 / 60
        axes = tuple(
            rest_to_rest(
                round(abs(b - a), 6), axis.rapid * share, axis.acceleration * 1e3, axis.jerk * 1e3
            )
            for a, b, axis in zip(self.place, target, self.parameters.axes, strict=True)
            if abs(b - a) > SHORTEST
        )
        self.place = target
        if axes:
            self._span("rapid", max(p.duration for p in axes), axes=axes)
            self._settle(axes)

    def _settle(self, axes: tuple[Profile, ...]) -> None:
        """Wait until each axis' lag, as it was when its own way ended, has died down."""
        gain, window = self.parameters.position_gain, self.parameters.in_position
        last = max(p.duration for p in axes)
        ready = [
            self.time - last + p.duration + log(max(p.lag(gain) / window, 1.0)) / gain for p in axes
        ]
        self._wait("in_position", max(ready))

    def _change(self, tool: int) -> None:
        self._wait("spindle", self.turning)
        self._rapid([*self.place[:2], self.parameters.change_height])
        scatter = self.parameters.tool_change_scatter
        self.tool = 0
        self._wait(
            "tool_change",
            self.time + self.parameters.tool_change + self.random.uniform(-scatter, scatter),
        )
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

    def _code(self, seconds: float) -> None:
        self._wait("code", self.time + self._scattered(seconds))

    def _scattered(self, seconds: float) -> float:
        scatter = self.parameters.codes.scatter
        return max(seconds + self.random.uniform(-scatter, scatter), 0.0)

    def _wait(self, kind: str, until: float) -> None:
        if until > self.time:
            self._span(kind, until - self.time)

    def _span(
        self, kind: str, seconds: float, section: Section | None = None,
        axes: tuple[Profile, ...] = (),
    ) -> None:  # fmt: skip
        end = self.time + seconds
        self.spans.append(
            Span(kind=kind, start=self.time, end=end, line=self.line, tool=self.tool,
                 section=section, axes=axes)
        )  # fmt: skip
        self.time = end


def _stretches(steps: Sequence[Step]) -> Iterator[list[Step]]:
    """Cuts that follow one another together; every other step alone."""
    for cuts, group in groupby(steps, key=lambda s: s.kind in ("line", "arc")):
        together = list(group)
        yield from [together] if cuts else ([step] for step in together)
