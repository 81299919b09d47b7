"""Records of a Sunday at the control: part programs, run twice each while an adapter listens."""

from dataclasses import asdict, dataclass
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.si import DAY
from pipeline.shop.control.display import STOPPED, Display, display, log_lines
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.planner import HOME, Control, Operator, Plan
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.files import write_text
from pipeline.shop.parameters import ShopParameters, stamp

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
    moment: np.datetime64 = sunday + np.timedelta64(round(second * 1e3), "ms")
    return moment


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


def _one(lines: list[int], random: np.random.Generator) -> int:
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
