"""Where the tool is in each cycle of a run: the control's commands, and axes that lag behind them.

Every axis closes the same share of its distance in each second (``position_gain``), as the feed
rate of the control's own display does; corners and arcs are cut as round as that makes them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.shop.control import SHORTEST, Control, Operator, Plan, Span
from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.control_path import Section
from pipeline.shop.filters import lagged
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.post import PartProgram, Step
from pipeline.shop.s_curve import Floats, Profile
from pipeline.shop.trial_job import TrialJob
from pipeline.shop.trial_program import HOME, first_tool

Way = tuple[Sequence[float], Sequence[Step]]
"""Where a stretch of cuts begins [mm], and its steps."""


@dataclass(kw_only=True)
class Watched(Control):
    """A control that also tells where its spans go, in the machine's frame [mm]."""

    places: list[tuple[float, ...]] = field(default_factory=list)  # at the end of each span
    ways: list[Way] = field(default_factory=list)  # of each cut

    def _cut(self, before: Sequence[float], steps: Sequence[Step]) -> None:
        self.ways.append((before, steps))
        super()._cut(before, steps)

    def _span(
        self, kind: str, seconds: float, section: Section | None = None,
        axes: tuple[Profile, ...] = (),
    ) -> None:  # fmt: skip
        super()._span(kind, seconds, section, axes)
        end = self._machine(self.ways[-1][1][-1]) if section is not None else self.place
        self.places.append(tuple(end))


def control_of(
    program: PartProgram, job: TrialJob, parameters: ShopParameters, random: np.random.Generator
) -> Watched:
    """The shop's control before ``program``, with the job's tools in its magazine."""
    called = {s.number for s in program.steps if s.kind == "tool"} | {0, first_tool(job)}
    return Watched(
        parameters=parameters.control, motor=parameters.spindle.motor,
        lengths={number: job.length(number) for number in called}, operator=Operator(),
        random=random, place=list(HOME), tool=first_tool(job),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A run in T cycles of ``cycle`` [s].

    Parameters
    ----------
    tip : (T, 3) array
        Of the tool, as it is, in the coordinates of the work offset [mm].
    line, tool : (T,) arrays of int
        Of the program; in the spindle.
    speed : (T,) array
        Of the spindle as commanded, its ramps included [rev/min].
    """

    cycle: float
    tip: Floats
    line: np.ndarray
    tool: np.ndarray
    speed: Floats


def track(control: Watched, plan: Plan, job: TrialJob) -> Track:
    """Where ``control`` has the tool while it runs ``plan``, its own."""
    its = control.parameters
    time = np.arange(int(np.ceil(plan.duration / its.cycle)) + 1, dtype=np.float64) * its.cycle
    command, line, tool = _commands(control, plan, job, time)
    share = -np.expm1(-its.position_gain * its.cycle)
    tip = np.stack([lagged(np.ascontiguousarray(c), share, c[0]) for c in command.T], axis=1)
    for number in np.unique(tool).tolist():
        tip[tool == number] -= _shift(its, job, number)
    return Track(cycle=its.cycle, tip=tip, line=line, tool=tool, speed=_spindle(plan, time))


def _commands(
    control: Watched, plan: Plan, job: TrialJob, time: Floats
) -> tuple[Floats, np.ndarray, np.ndarray]:
    """Places in the machine's frame (T, 3) [mm], line and tool (T,), at ``time`` (T,)."""
    command = np.empty((time.size, 3))
    line, tool = np.empty(time.size, dtype=np.int64), np.empty(time.size, dtype=np.int64)
    edges = np.searchsorted(time, [s.start for s in plan.spans] + [np.inf])
    ways, here = iter(control.ways), np.array(HOME)
    for k, (span, end) in enumerate(zip(plan.spans, control.places, strict=True)):
        part, target = slice(edges[k], edges[k + 1]), np.array(end)
        line[part], tool[part] = span.line, span.tool
        within = time[part] - span.start
        if span.section is None:
            command[part] = _between(here, target, span, within)
        else:
            s = np.minimum(span.section.motion.at(within)[0], span.section.ends[-1])
            block = np.minimum(np.searchsorted(span.section.ends, s), span.section.ends.size - 1)
            command[part] = _along(s, block, span.section.ends, next(ways))
            command[part] += _shift(control.parameters, job, span.tool)
            line[part] = span.section.lines[block]
        here = target
    return command, line, tool


def _shift(control: ControlParameters, job: TrialJob, tool: int) -> Floats:
    """From the tip's coordinates to the machine's [mm]."""
    return np.array(control.work_offset) + [0.0, 0.0, job.length(tool)]


def _between(here: Floats, target: Floats, span: Span, within: Floats) -> Floats:
    """Places in a rapid, in which each axis goes on its own, or in a wait; shape (T, 3)."""
    out = np.tile(here, (within.size, 1))
    if not span.axes:
        return out
    moved = np.flatnonzero(np.abs(target - here) > SHORTEST)
    for axis, motion in zip(moved, span.axes, strict=True):
        way = motion.at(np.minimum(within, motion.duration))[0]
        out[:, axis] += np.sign(target[axis] - here[axis]) * way
    return out


def _along(s: Floats, block: np.ndarray, ends: Floats, way: Way) -> Floats:
    """Places at ``s`` (T,) of a stretch of cuts, which lie in its ``block`` (T,); shape (T, 3)."""
    before, steps = way
    points = np.array([before, *(step.end for step in steps)])
    turn = np.array([step.turn for step in steps])
    centre = np.array([step.centre for step in steps])
    lengths = np.diff(np.concatenate([[0.0], ends]))
    share = 1 - (ends[block] - s) / lengths[block]
    out: Floats = points[block] + (points[block + 1] - points[block]) * share[:, None]
    arcs = turn[block] != 0
    if arcs.any():
        k, part = block[arcs], share[arcs]
        first, last = points[k, :2] - centre[k], points[k + 1, :2] - centre[k]
        radius = np.hypot(*first.T) * (1 - part) + np.hypot(*last.T) * part
        angle = np.arctan2(first[:, 1], first[:, 0]) + turn[k] * part
        out[arcs, 0] = centre[k, 0] + radius * np.cos(angle)
        out[arcs, 1] = centre[k, 1] + radius * np.sin(angle)
    return out


def _spindle(plan: Plan, time: Floats) -> Floats:
    """Speed as commanded [rev/min], shape (T,)."""
    speed = np.zeros(time.size)
    for start, ramp in plan.ramps:
        speed = np.where(time >= start, ramp.at(time - start), speed)
    return speed
