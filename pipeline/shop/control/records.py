"""Records of a Sunday at the control: part programs, run twice each while an adapter listens.

The operator's feed hold or stop slows the program's time smoothly down to standstill and back:
dτ/dt = 1 - 3u² + 2u³ with u from 0 to 1 over the ramp, and the reverse.  The adapter writes what
has changed since its last poll.
"""

from dataclasses import asdict, dataclass
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import DAY
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.planner import HOME, Control, Operator, Plan, Ramp, Span
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.files import write_text
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import ControlParameters, Random, ShopParameters, stamp

ACTIVE, FEED_HOLD, STOPPED, COMPLETED = range(4)
EXECUTION = ("ACTIVE", "FEED_HOLD", "STOPPED", "PROGRAM_COMPLETED")
DETENT = 0.25
"""Time from one position of an override's knob to the next [s]."""
HESITATION = 0.4
"""Time from the beginning of a tool change until the knob is turned [s]."""
TAIL = 2.5
"""Time that the adapter goes on after the end [s]."""
LEAD = 1.3
"""Time from the adapter's connection to the start of the program [s]."""
TORN = 4
"""Characters that are left of a torn line: the year."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Program time of each cycle, its rate (1: as planned), state; arrays of shape (T,)."""

    program: Floats
    rate: Floats
    execution: Ints  # index into EXECUTION
    holds: tuple[tuple[float, float], ...]  # beginning and length [s]
    aborted: float | None


@dataclass(frozen=True, kw_only=True)
class Display:
    """Display of the control in each cycle; arrays of shape (T,), the first at the run's start."""

    execution: Ints
    line: Ints
    tool: Ints
    feedrate: Floats
    """Speed of the axes along the path, which lag behind their commands [mm/s]."""
    commanded: Floats
    """Commanded speed along the path [mm/s]."""
    speed: Floats
    """Speed of the spindle [rev/min]."""
    feed_override: Floats
    rapid_override: Floats
    """Overrides [percent]; nan before the knob is first turned."""
    tool_before: int
    """Tool in the spindle before the run."""
    clock: Clock


def display(plan: Plan, operator: Operator, control: ControlParameters) -> Display:
    """Display of a run of ``plan`` with the actions of ``operator``."""
    time = clock(plan, operator, control)
    line, tool, planned = state_at(plan, time.program)
    commanded = planned * time.rate
    begun = time.execution.size if time.aborted is None else _cycles(time.aborted, control)
    speed = plan.spindle_speed(time.program)
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
        program -= np.clip(time - start, 0, seconds + ramp) - ramp * (
            _slowed_time(down) + _resumed_time(up)
        )
        rate *= 1 - _smooth(down) + _smooth(up)
        state[(time >= start) & (time < start + seconds)] = FEED_HOLD
        holds.append((start, seconds))
    aborted = None
    if operator.abort is not None:
        stopped = _middle(plan, operator.abort, cycle)
        aborted = stopped + sum(length for start, length in holds if start < stopped)
        down = np.clip((time - aborted) / ramp, 0, 1)
        program = np.where(time < aborted, program, stopped + ramp * _slowed_time(down))
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


def _slowed_time(u: Floats) -> Floats:
    """Integral of 1 - smooth."""
    return u - u**3 + u**4 / 2


def _resumed_time(u: Floats) -> Floats:
    """Integral of smooth."""
    return u**3 - u**4 / 2


def _middle(plan: Plan, line: int, cycle: float) -> float:
    for span in plan.spans:
        path = span.section
        if path is not None and path.lines[-1] >= line:
            block = int(np.argmax(path.lines >= line))
            before = path.ends[block - 1] if block else 0.0
            time = np.arange(0.0, path.motion.duration, cycle)
            along = path.motion.at(time)[0]
            return span.start + float(np.interp((before + path.ends[block]) / 2, along, time))
    raise ValueError(f"line {line} and those after it cut nothing: name a line before the last cut")


def state_at(plan: Plan, time: Floats) -> tuple[Ints, Ints, Floats]:
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
    return np.sqrt(square)


def _feed_knob(operator: Operator, line: Ints, tool: Ints, control: ControlParameters) -> Floats:
    shown, before = np.full(line.size, np.nan), operator.feed_override[0][1]
    for since, percent in operator.feed_override[1:]:
        at = int(np.argmax(line >= since)) + _cycles(HESITATION, control)
        between = np.arange(before, percent, np.copysign(10.0, percent - before))[1:].tolist()
        if line[-1] < since:
            break
        for value in [*between, percent]:
            shown[at:] = value
            at += _cycles(DETENT, control)
        before = percent
    return shown


def _rapid_knob(plan: Plan, operator: Operator, time: Floats) -> Floats:
    """Rapid override: the run's own, down to 0 and back at each stop."""
    shown = np.full(time.size, operator.rapid_override)
    for span in (s for s in plan.spans if s.kind == "rapid_stop"):
        down = [p for p in (50.0, 25.0, 0.0) if p < operator.rapid_override]
        settings = [(span.start - DETENT * (len(down) - 1 - k), p) for k, p in enumerate(down)]
        back = [*down[-2::-1], operator.rapid_override]
        settings += [(span.end - DETENT * (len(back) - 1 - k), p) for k, p in enumerate(back)]
        for start, percent in settings:
            shown[time >= start] = percent
    return shown


def log_lines(
    run: Display, start: np.datetime64, control: ControlParameters, random: Random,
    torn: bool = False, load: Floats | None = None,
) -> list[str]:  # fmt: skip
    """Lines of a log, ``timestamp|item|value``, of a program that was started at ``start`` (UTC).

    ``torn``: one line in the middle is cut short; ``load`` (T,): of the spindle [percent], if
    polled.
    """
    polls = _polls(run.line.size * control.cycle, control, random)
    cycle = np.floor(polls / control.cycle).astype(int)
    lines: list[tuple[int, int, str]] = []
    for rank, (name, values) in enumerate(_items(run, cycle, load).items()):
        known = ~np.isnan(values)
        new = np.append(True, values[1:] != values[:-1]) & known
        lines += [
            (k, rank, f"|{name}|{_text(name, values[k])}") for k in np.flatnonzero(new).tolist()
        ]
    stamps = [stamp(start, t) for t in polls]
    text = [stamps[k] + words for k, _, words in sorted(lines)]
    if torn:
        feeds = [k for k, line in enumerate(text) if "|vpath|" in line]
        place = feeds[int(random.uniform(0.3, 0.7) * len(feeds))]
        text[place] = text[place][:TORN]
    return text


def _polls(end: float, control: ControlParameters, random: Random) -> np.ndarray:
    """Times of the polls [s] since the start of the program, to the millisecond."""
    count = int((end + LEAD) / control.poll * 1.2) + 20
    steps = control.poll + random.normal(0, control.poll_jitter, count)
    times: np.ndarray = np.round(np.cumsum(np.maximum(steps, control.poll / 3)) - LEAD, 3)
    return times[times < end]


def _items(run: Display, cycle: Ints, load: Floats | None) -> dict[str, Floats]:
    """Polled values (P,) of each item, nan where it is not available."""
    shown = {
        "exec": (run.execution, np.nan), "ln": (run.line, 0.0), "tool": (run.tool, run.tool_before),
        "fovr": (run.feed_override, np.nan), "rovr": (run.rapid_override, run.rapid_override[0]),
        "S1n": (np.round(run.speed), 0.0), "vpath": (np.round(run.feedrate, 2), 0.0),
    }  # fmt: skip
    if load is not None:
        shown["S1load"] = (load, 0.0)
    at = np.maximum(cycle, 0)
    return {
        name: np.where(cycle >= 0, values[at], before) for name, (values, before) in shown.items()
    }


def _text(name: str, value: float) -> str:
    if name == "exec":
        return EXECUTION[int(value)]
    return f"{value + 0.0:.2f}".rstrip("0").rstrip(".")


OPENING = 8.0 * 3600
"""Start of the first run [s of the day]."""
PAUSE = (200.0, 600.0)
"""Shortest and longest time between two runs [s]."""
LONG = 30.0
"""Least length of a long cut [mm]."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """One run: its program, the operator's actions, whether it was edited before."""

    program: PartProgram
    operator: Operator
    edited: bool = False
    torn: bool = False


def write_control(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``programs/*.nc`` and ``control/*.txt``; the truth of control and runs."""
    programs, edited = part_programs(parameters.control, parameters.generator("part programs"))
    for program in programs:
        write_text(folder / "programs" / f"{program.name}.nc", program.text)
    start, place, runs = OPENING, list(HOME), []
    for number, play in enumerate(_plays(programs, edited, parameters)):
        random = parameters.generator(f"control run {number}")
        control = Control(
            parameters=parameters.control, motor=parameters.spindle.motor, random=random,
            lengths=play.program.lengths, tool=play.program.tools[-1].number,
            operator=play.operator, place=list(place),
        )  # fmt: skip
        plan = control.run(play.program)
        shown = display(plan, play.operator, parameters.control)
        moment = _moment(parameters, start)
        name = f"control/{play.program.name}-run{number % 2 + 1}.txt"
        lines = log_lines(shown, moment, parameters.control, random, play.torn)
        write_text(folder / name, "\n".join(lines) + "\n")
        truth = _truth(play, plan, shown, moment, parameters)
        runs.append({"file": name, "machine_origin": place, **truth})
        start += round(shown.line.size * parameters.control.cycle + random.uniform(*PAUSE), 3)
        place = [round(x, 6) for x in control.place]
    return {
        "work_offset": list(parameters.control.work_offset),
        "tool_lengths": {str(t.number): t.length for p in programs for t in p.tools},
        "parameters": asdict(parameters.control),
        "programs": {p.name: {"file": f"programs/{p.name}.nc", "lines": p.lines} for p in programs},
        "runs": runs,
    }


def _moment(parameters: ShopParameters, second: float) -> np.datetime64:
    """A second of the Sunday before the first week (UTC) [ms]."""
    sunday = (parameters.start - np.timedelta64(DAY, "s")).astype("datetime64[ms]")
    return sunday + np.timedelta64(round(second * 1e3), "ms")


def _plays(
    programs: list[PartProgram], edited: PartProgram, parameters: ShopParameters
) -> list[Play]:
    random = parameters.generator("control operator")
    plate, housing, cam, block = programs
    changes, end = [s.line for s in housing.steps if s.kind == "tool"], housing.steps[-1].line
    slower = ((0, 80.0), (changes[-1], 100.0))
    faster = ((0, 100.0), (changes[1], 120.0), (end, 100.0))
    pause = {_one(_long_cuts(plate), random): round(float(random.uniform(5, 14)), 2)}
    stop = {_one(_rapids_after_cuts(housing), random): round(float(random.uniform(4, 9)), 2)}
    cuts = [s.line for s in block.steps if s.kind == "line"]
    abort = _one(cuts[len(cuts) // 2 :], random)
    return [
        Play(program=plate, operator=Operator(holds=pause)),
        Play(program=plate, operator=Operator(rapid_override=50.0)),
        Play(program=housing, operator=Operator(feed_override=slower)),
        Play(program=housing, operator=Operator(feed_override=faster, rapid_stops=stop)),
        Play(program=cam, operator=Operator(), torn=True),
        Play(program=edited, operator=Operator(), edited=True),
        Play(program=block, operator=Operator()),
        Play(program=block, operator=Operator(abort=abort)),
    ]


def _long_cuts(program: PartProgram) -> list[int]:
    pairs = pairwise(program.steps)
    return [b.line for a, b in pairs if b.kind == "line" and dist(a.end, b.end) > LONG]


def _rapids_after_cuts(program: PartProgram) -> list[int]:
    lines, cut = [], 0.0
    for before, step in pairwise(program.steps):
        if step.kind in ("line", "arc"):
            cut += dist(before.end, step.end)
            continue
        if cut > LONG and step.kind == "rapid":
            lines.append(step.line)
        cut = 0.0
    return lines


def _one(lines: list[int], random: Random) -> int:
    return lines[int(random.integers(len(lines)))]


def _truth(
    play: Play, plan: Plan, shown: Display, moment: np.datetime64, parameters: ShopParameters
) -> dict[str, Any]:
    cycle, clock = parameters.control.cycle, shown.clock
    over = int(np.argmax(shown.execution >= STOPPED)) * cycle
    return {
        "program": None if play.edited else play.program.name,
        "edited_from": play.program.name if play.edited else None,
        "lines": play.program.lines,
        "start": stamp(moment, 0.0),
        "end": stamp(moment, over),
        "duration_s": round(over, 3),
        "completed": clock.aborted is None,
        "planned_s": round(plan.duration, 6),
        "feed_override": [list(x) for x in play.operator.feed_override],
        "rapid_override": play.operator.rapid_override,
        "feed_holds": [{"time": stamp(moment, t), "seconds": round(s, 3)} for t, s in clock.holds],
        "rapid_stops": [
            {"time": stamp(moment, s.start), "seconds": round(s.end - s.start, 3)}
            for s in plan.spans
            if s.kind == "rapid_stop" and clock.aborted is None
        ],
        "aborted": None if clock.aborted is None else stamp(moment, clock.aborted),
        "torn_lines": int(play.torn),
    }
