"""One run of a part program, second by second: tools, cuts, holds, aborts."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.programs import Operation, Program
from pipeline.shop.timeline import (
    ACTIVE,
    AUTOMATIC,
    FEED_HOLD,
    INTERRUPTED,
    MANUAL,
    READY,
    STOPPED,
    Alarm,
    Cycle,
    Timeline,
)

TOOL_CHANGE = 7  # s, chip to chip
UNLOAD = 90.0  # deg, where the C axis stands for loading
Z_CHANGE = 455.0  # mm, where the arm takes the tool
RETURN = 2  # s from the end of a pass to the start of the next
LINE = 8  # s that a line of the program takes, about


@dataclass(kw_only=True)
class Run:
    """What a run needs to know of the job it belongs to."""

    program: Program
    part: int  # in the batch, from 1; 0 for a warm-up
    wear: float = 1.0  # cutting force against a new tool [1]


def run_program(
    day: Timeline, start: int, run: Run, number: int, p: ShopParameters, random: np.random.Generator
) -> Cycle:
    """Write one run into ``day`` from second ``start``; the cycle it made is returned and kept."""
    cycle = Cycle(
        number=number, program=run.program.name, kind="part" if run.part else "warm_up",
        part=run.part, start=start,
    )  # fmt: skip
    aborted = bool(run.part) and random.random() < p.shift.abort_chance
    last = int(random.integers(len(run.program.operations))) if aborted else -1
    day.select(start, run.program.name)
    day.mode[start:] = AUTOMATIC
    day.hold[start:] = False
    _overrides(day, start, run, random)
    t = start
    for i, operation in enumerate(run.program.operations):
        t = _change_tool(day, t, operation, cycle)
        t = _operation(day, t, i, operation, run, cycle, p, random, i == last)
        if i == last:
            break
        if run.part == 1 and random.random() < 0.35:
            t = _optional_stop(day, t, cycle, random)
    cycle.end, cycle.complete = t, not aborted
    day.execution[t:] = STOPPED if aborted else READY
    if aborted:
        _trouble(day, t, random)
    elif run.part:
        day.part_count[t:] += 1
        if run.program.held and p.c_axis:
            day.hold[t:], day.c[t] = True, UNLOAD
    day.cycles.append(cycle)
    return cycle


def _overrides(day: Timeline, t: int, run: Run, random: np.random.Generator) -> None:
    """The operator goes carefully with a first part and sometimes drives faster or slower."""
    first = run.part == 1
    day.rapid_override[t:] = random.choice([25.0, 50.0]) if first else 100.0
    usual = [70.0, 80.0, 90.0, 100.0] if first else [80.0, 90.0, 100.0, 110.0, 120.0]
    odd = first or random.random() < 0.12
    day.feed_override[t:] = random.choice(usual) if odd else 100.0
    day.spindle_override[t:] = random.choice([90.0, 110.0]) if random.random() < 0.03 else 100.0


def _change_tool(day: Timeline, t: int, operation: Operation, cycle: Cycle) -> int:
    day.execution[t:] = ACTIVE
    day.speed_command[t:] = 0.0
    if operation.tool in (0, int(day.tool[t])):
        return t
    end = t + TOOL_CHANGE
    day.hold[t:end], day.c[t] = True, 0.0  # the spindle is oriented for the arm
    day.z[t + 1 : end] = Z_CHANGE
    day.tool[t + TOOL_CHANGE // 2 :] = operation.tool
    cycle.tool_changes += 1
    return end


def _operation(
    day: Timeline, t: int, index: int, operation: Operation, run: Run, cycle: Cycle,
    p: ShopParameters, random: np.random.Generator, breaks: bool,
) -> int:  # fmt: skip
    """Approach, passes with the holds that people make, retract; ``breaks`` cuts it short."""
    override = day.feed_override[t] / 100 if operation.feed else 1.0
    length = max(int(operation.duration * random.uniform(0.99, 1.01) / override), 5)
    path = _path(operation, length, override, random)
    cuts = [0, length]
    if breaks:
        cuts = [0, int(length * random.uniform(0.2, 0.9))]
    elif random.random() < p.shift.feed_hold_chance:
        cuts = [0, int(length * random.uniform(0.1, 0.9)), length]
    approach = max(round(3 / np.sqrt(day.rapid_override[t] / 100)), 3)
    day.speed_command[t:] = operation.speed * day.spindle_override[t] / 100
    day.hold[t : t + approach] = operation.motion == "contour"
    t += approach
    for piece, (a, b) in enumerate(pairwise(cuts)):
        if piece:
            t = _feed_hold(day, t, operation, cycle, random)
        _write(day, t, t + b - a, path[:, a:b], operation, run, p)
        day.line[t : t + b - a] = 100 * (index + 1) + np.arange(a, b) // LINE
        t += b - a
    day.line[t:] = 100 * (index + 1) + length // LINE
    day.feed[t:], day.cut_power[t:], day.coolant[t:] = 0.0, 0.0, False
    day.speed_command[t + 1 :] = 0.0
    day.z[t : t + 2] = 300.0
    return t + 2


def _write(
    day: Timeline, a: int, b: int, path: np.ndarray, operation: Operation, run: Run,
    p: ShopParameters,
) -> None:  # fmt: skip
    """Rows of ``path``: x, y, z, c [mm, deg], feed [mm/s], whether the tool is engaged."""
    day.x[a:b], day.y[a:b], day.z[a:b] = path[:3]
    if operation.motion == "contour":
        day.hold[a:b] = True
        day.c[a:b] = path[3] % 360
    day.feed[a:b] = path[4]
    power = operation.power * p.spindle.motor.rated_power * p.power_scale * run.wear
    day.cut_power[a:b] = power * path[5]
    day.coolant[a:b] = operation.coolant


def _path(
    operation: Operation, length: int, override: float, random: np.random.Generator
) -> np.ndarray:
    """Way of the tool in each second, shape (6, length); rows as in :func:`_write`."""
    s, zero = np.arange(length, dtype=float), np.zeros(length)
    x_0, y_0, z_0 = random.uniform(-180, -20), random.uniform(-120, 0), random.uniform(60, 160)
    if operation.motion == "run":
        return np.array([zero - 200, zero, zero + 300, zero, zero, zero])
    feed = operation.feed * override
    one_pass = operation.length / feed
    u, n = s % (one_pass + RETURN), s // (one_pass + RETURN)
    engaged = (u < one_pass).astype(float)
    back = np.clip((u - one_pass) / RETURN, 0, 1)
    along = np.where(engaged > 0, u * feed, operation.length * (1 - back))
    feeds = np.where(engaged > 0, feed, 0.0) + np.where(engaged > 0, 0.0, operation.length / RETURN)
    if operation.motion == "drill":
        x, y = x_0 + 35 * (n % 6), y_0 + 30 * (n // 6 % 5)
        return np.array([x, y, z_0 - along, zero, feeds, engaged])
    if operation.motion == "contour":
        turn = s * feed * 3.0
        return np.array([x_0 + along, y_0 + zero, z_0 - 0.5 * n, turn, feeds, zero])
    if operation.motion == "finish":
        wave = 8 * np.sin(2 * np.pi * u / max(one_pass, 1) * 1.5)
        return np.array([x_0 + along, y_0 + 0.4 * n, z_0 - 15 + wave, zero, feeds, engaged])
    return np.array([x_0 + along, y_0 + 12 * (n % 8), z_0 - 2 * (n // 8), zero, feeds, engaged])


def _feed_hold(
    day: Timeline, t: int, operation: Operation, cycle: Cycle, random: np.random.Generator
) -> int:
    end = t + int(random.integers(8, 75))
    day.execution[t:end], day.execution[end:] = FEED_HOLD, ACTIVE
    day.hold[t:end] = operation.motion == "contour"
    day.coolant[t:end] = operation.coolant
    cycle.feed_hold_s += end - t
    return end


def _optional_stop(day: Timeline, t: int, cycle: Cycle, random: np.random.Generator) -> int:
    end = t + int(random.integers(20, 150))  # M01: the operator measures
    day.execution[t:end], day.execution[end:] = INTERRUPTED, ACTIVE
    cycle.interrupted_s += end - t
    return end


def _trouble(day: Timeline, t: int, random: np.random.Generator) -> None:
    """An alarm ends the run; sometimes the operator hits the emergency stop."""
    kinds = (
        ("motion_c", "FAULT", "1281", "", "ERROR (X AXIS POS.MALF.)"),
        ("logic_c", "FAULT", "806", "", "TOOL LIFE OVER"),
        ("spindle_c", "FAULT", "53", "HIGH", "SPINDLE OVERLOAD"),
        ("Ztravel", "FAULT", "101", "HIGH", "SOFT LIMIT"),
    )
    name, level, code, qualifier, text = kinds[random.integers(len(kinds))]
    end = t + int(random.integers(40, 300))
    day.alarms.append(
        Alarm(name=name, level=level, code=code, qualifier=qualifier, text=text, start=t, end=end)
    )
    day.hold[t:] = False
    if random.random() < 0.4:
        day.emergency[t + 1 : t + 1 + int(random.integers(10, 40))] = True
    day.mode[t + 2 :] = MANUAL
    day.execution[end:] = READY
