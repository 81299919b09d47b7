"""One run of a program, cycle by cycle, as the control's own display shows it.

What the operator does to the feed (hold, stop) lets the program's time go slower, smoothly down to
standstill and back: dτ/dt = 1 - 3u² + 2u³ with u from 0 to 1 over the ramp, and the reverse.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.shop.control import Operator, Plan, Span
from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.s_curve import Floats
from pipeline.shop.spindle_ramp import Ramp

ACTIVE, FEED_HOLD, STOPPED, COMPLETED = range(4)
EXECUTION = ("ACTIVE", "FEED_HOLD", "STOPPED", "PROGRAM_COMPLETED")
DETENT = 0.25
"""Seconds from one position of an override's knob to the next."""
HESITATION = 0.4
"""Seconds from the beginning of a tool change until the knob is turned."""
TAIL = 2.5
"""Seconds that the adapter goes on after the end."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Program time of each cycle, how fast it goes (1: as planned), state; arrays of shape (T,)."""

    program: Floats
    rate: Floats
    execution: np.ndarray  # index into EXECUTION
    holds: tuple[tuple[float, float], ...]  # beginning and length [s]
    aborted: float | None


@dataclass(frozen=True, kw_only=True)
class Display:
    """What the control shows in each cycle; arrays of shape (T,), the first at the run's start.

    Parameters
    ----------
    execution, line, tool : (T,) arrays of int
    feedrate : (T,) array
        Along the path [mm/s], of the axes, which lag behind their commands.
    commanded : (T,) array
        The same as commanded.
    speed : (T,) array
        Of the spindle [rev/min].
    feed_override, rapid_override : (T,) arrays
        [percent]; nan before the knob is first turned.
    tool_before : int
        In the spindle before the run.
    clock : Clock
        How program time went.
    """

    execution: np.ndarray
    line: np.ndarray
    tool: np.ndarray
    feedrate: Floats
    commanded: Floats
    speed: Floats
    feed_override: Floats
    rapid_override: Floats
    tool_before: int
    clock: Clock


def display(plan: Plan, operator: Operator, control: ControlParameters) -> Display:
    """Live through ``plan`` with what ``operator`` does."""
    from pipeline.shop.filters import lagged

    time = clock(plan, operator, control)
    line, tool, planned = _state(plan, time.program)
    commanded = planned * time.rate
    begun = time.execution.size if time.aborted is None else _cycles(time.aborted, control)
    speed = _spindle_speed(plan, time.program)
    if time.aborted is not None and plan.ramps:
        ramp = plan.ramps[-1][1]
        down = Ramp(motor=ramp.motor, overload=ramp.overload, n_0=float(speed[begun]), n_1=0.0)
        speed[begun:] = down.at(np.arange(speed.size - begun, dtype=np.float64) * control.cycle)
    share = -np.expm1(-control.position_gain * control.cycle)
    return Display(
        execution=time.execution, line=line, tool=tool, commanded=commanded,
        feedrate=lagged(commanded, share, 0.0), speed=speed,
        feed_override=_feed_knob(operator, line, tool, control),
        rapid_override=_rapid_knob(plan, operator, time.program), tool_before=plan.tool, clock=time,
    )  # fmt: skip


def clock(plan: Plan, operator: Operator, control: ControlParameters) -> Clock:
    """Program time of each cycle of a run."""
    ramp, cycle = control.hold_ramp, control.cycle
    length = plan.duration + sum(operator.holds.values()) + TAIL
    time: Floats = np.arange(_cycles(length, control), dtype=np.float64) * cycle
    program, rate = time.copy(), np.ones(time.size)
    state = np.full(time.size, ACTIVE)
    holds: list[tuple[float, float]] = []
    for line, seconds in sorted(operator.holds.items()):
        start = _middle(plan, line, cycle) + sum(length for _, length in holds)
        down, up = (np.clip((time - t) / ramp, 0, 1) for t in (start, start + seconds))
        program -= np.clip(time - start, 0, seconds + ramp) - ramp * (_braked(down) + _risen(up))
        rate *= 1 - _smooth(down) + _smooth(up)
        state[(time >= start) & (time < start + seconds)] = FEED_HOLD
        holds.append((start, seconds))
    aborted = None
    if operator.abort is not None:
        stopped = _middle(plan, operator.abort, cycle)
        aborted = stopped + sum(length for start, length in holds if start < stopped)
        down = np.clip((time - aborted) / ramp, 0, 1)
        program = np.where(time < aborted, program, stopped + ramp * _braked(down))
        rate *= 1 - _smooth(down)
        state[time >= aborted] = STOPPED
    state[program >= plan.duration] = COMPLETED
    end = int(np.argmax(state >= STOPPED)) + _cycles(TAIL, control)
    return Clock(
        program=program[:end], rate=rate[:end], execution=state[:end], holds=tuple(holds),
        aborted=aborted,
    )  # fmt: skip


def _cycles(seconds: float, control: ControlParameters) -> int:
    return int(np.ceil(seconds / control.cycle))


def _smooth(u: Floats) -> Floats:
    return u * u * (3 - 2 * u)


def _braked(u: Floats) -> Floats:
    """Integral of 1 - smooth."""
    return u - u**3 + u**4 / 2


def _risen(u: Floats) -> Floats:
    """Integral of smooth."""
    return u**3 - u**4 / 2


def _middle(plan: Plan, line: int, cycle: float) -> float:
    """Program time in the middle of the first cut in ``line`` or a later one."""
    for span in plan.spans:
        path = span.section
        if path is not None and path.lines[-1] >= line:
            block = int(np.argmax(path.lines >= line))
            before = path.ends[block - 1] if block else 0.0
            time = np.arange(0.0, path.motion.duration, cycle)
            way = path.motion.at(time)[0]
            return span.start + float(np.interp((before + path.ends[block]) / 2, way, time))
    raise ValueError(f"line {line} and those after it cut nothing: name a line before the last cut")


def _state(plan: Plan, time: Floats) -> tuple[np.ndarray, np.ndarray, Floats]:
    """Line, tool and commanded path speed [mm/s] at program times (T,), which ascend."""
    last = plan.spans[-1]
    line, tool = np.full(time.size, last.line), np.full(time.size, last.tool)
    speed = np.zeros(time.size)
    edges = np.searchsorted(time, [s.start for s in plan.spans] + [plan.duration])
    for k, span in enumerate(plan.spans):
        here = slice(edges[k], edges[k + 1])
        line[here], tool[here] = span.line, span.tool
        within = time[here] - span.start
        if span.section is not None:
            s, speed[here] = span.section.motion.at(within)
            block = np.searchsorted(span.section.ends, s)
            line[here] = span.section.lines[np.minimum(block, len(span.section.lines) - 1)]
        elif span.axes:
            speed[here] = _rapid_speed(span, within)
    return line, tool, speed


def _rapid_speed(span: Span, time: Floats) -> Floats:
    square = np.zeros(time.size)
    for axis in span.axes:
        moving = time < axis.duration
        square[moving] += axis.at(time[moving])[1] ** 2
    speed: Floats = np.sqrt(square)
    return speed


def _spindle_speed(plan: Plan, time: Floats) -> Floats:
    speed = np.zeros(time.size)
    for start, ramp in plan.ramps:
        speed = np.where(time >= start, ramp.at(time - start), speed)
    return speed


def _feed_knob(
    operator: Operator, line: np.ndarray, tool: np.ndarray, control: ControlParameters
) -> Floats:
    """Feed override as the knob tells it, from the first time that it is turned."""
    shown, before = np.full(line.size, np.nan), operator.feed_override[0][1]
    for since, percent in operator.feed_override[1:]:
        at = int(np.argmax(line >= since)) + _cycles(HESITATION, control)
        way = np.arange(before, percent, np.copysign(10.0, percent - before))[1:].tolist()
        if line[-1] < since:
            break
        for value in [*way, percent]:
            shown[at:] = value
            at += _cycles(DETENT, control)
        before = percent
    return shown


def _rapid_knob(plan: Plan, operator: Operator, time: Floats) -> Floats:
    """Rapid override: the run's own, down to 0 and back at each stop."""
    shown = np.full(time.size, operator.rapid_override)
    for span in (s for s in plan.spans if s.kind == "rapid_stop"):
        down = [p for p in (50.0, 25.0, 0.0) if p < operator.rapid_override]
        turns = [(span.start - DETENT * (len(down) - 1 - k), p) for k, p in enumerate(down)]
        back = [*down[-2::-1], operator.rapid_override]
        turns += [(span.end - DETENT * (len(back) - 1 - k), p) for k, p in enumerate(back)]
        for start, percent in turns:
            shown[time >= start] = percent
    return shown
