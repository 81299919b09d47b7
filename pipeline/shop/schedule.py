"""Working days at the machine: warm-up, batches of part programs, breaks, changeovers, aborts."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import DAY
from pipeline.shop.parameters import Random, ShopParameters
from pipeline.shop.timeline import (
    WARM_UP,
    Alarm,
    Cycle,
    Execution,
    Mode,
    Operation,
    Program,
    Timeline,
    programs,
)

TOOL_CHANGE = 7
"""Time of a tool change, chip to chip [s]."""
UNLOAD = 90.0
"""Angle of the C axis for loading [deg]."""
Z_CHANGE = 455.0
"""Height at which the arm takes the tool [mm]."""
RETURN = 2
"""Time from the end of a pass to the start of the next [s]."""
LINE = 8
"""Approximate time of a line of a program [s]."""
FRIDAY = 4
"""Day of the week, counted from Monday."""
LATEST = DAY - 1800
"""Latest second of a working day [s]."""
WARNINGS = (
    ("logic_c", "WARNING", "361", "", " ERROR(SET UP SWITCH)"),
    ("logic_c", "WARNING", "1105", "", ""),
    ("coolant_c", "WARNING", "217", "LOW", "COOLANT LEVEL"),
    ("lube_c", "WARNING", "402", "LOW", "LUB. OIL LEVEL"),
    ("system_c", "WARNING", "442", "", "DATA RENEWAL NOT ALLOWED"),
    ("motion_c", "WARNING", "1101", "", "INTERFERE"),
)
"""Data item, level, code, qualifier and text of warnings, as controls give them."""
FAULTS = (
    ("motion_c", "FAULT", "1281", "", "ERROR (X AXIS POS.MALF.)"),
    ("logic_c", "FAULT", "806", "", "TOOL LIFE OVER"),
    ("spindle_c", "FAULT", "53", "HIGH", "SPINDLE OVERLOAD"),
    ("Ztravel", "FAULT", "101", "HIGH", "SOFT LIMIT"),
)
"""Data item, level, code, qualifier and text of faults that end a run."""


@dataclass(kw_only=True)
class Run:
    """One run of a part program within its job."""

    program: Program
    part: int  # in the batch, from 1; 0 for a warm-up
    wear: float = 1.0  # cutting force against a new tool [1]


@dataclass(kw_only=True)
class Job:
    """The batch on the machine; it goes on the next day."""

    program: Program
    size: int
    done: int = 0
    wear: float = 1.0


@dataclass(kw_only=True)
class Shop:
    """State of the shop that outlives a day."""

    parameters: ShopParameters
    random: Random
    job: Job | None = None
    cycles: int = 0


def run_program(shop: Shop, day: Timeline, start: int, run: Run) -> int:
    """Write one run into ``day`` from second ``start``; the second at which it has ended."""
    p, random = shop.parameters, shop.random
    shop.cycles += 1
    name, kind = run.program.name, "part" if run.part else "warm_up"
    cycle = Cycle(number=shop.cycles, program=name, kind=kind, part=run.part, start=start)
    aborted = bool(run.part) and random.random() < p.shift.abort_chance
    last = int(random.integers(len(run.program.operations))) if aborted else -1
    day.select(start, name)
    day.mode[start:] = Mode.AUTOMATIC
    day.hold[start:] = False
    _overrides(day, start, run, random)
    t = start
    for i, operation in enumerate(run.program.operations):
        t = _change_tool(day, t, operation, cycle)
        t = _operation(shop, day, t, i, run, cycle, breaks=i == last)
        if i == last:
            break
        if run.part == 1 and random.random() < 0.35:
            t = _optional_stop(day, t, cycle, random)
    cycle.end, cycle.complete = t, not aborted
    day.execution[t:] = Execution.STOPPED if aborted else Execution.READY
    if aborted:
        _trouble(day, t, random)
    elif run.part:
        day.part_count[t:] += 1
        if run.program.held and p.c_axis:
            day.hold[t:], day.c[t] = True, UNLOAD
    day.cycles.append(cycle)
    return t


def _overrides(day: Timeline, t: int, run: Run, random: Random) -> None:
    first = run.part == 1
    day.rapid_override[t:] = random.choice([25.0, 50.0]) if first else 100.0
    usual = [70.0, 80.0, 90.0, 100.0] if first else [80.0, 90.0, 100.0, 110.0, 120.0]
    odd = first or random.random() < 0.12
    day.feed_override[t:] = random.choice(usual) if odd else 100.0
    day.spindle_override[t:] = random.choice([90.0, 110.0]) if random.random() < 0.03 else 100.0


def _change_tool(day: Timeline, t: int, operation: Operation, cycle: Cycle) -> int:
    day.execution[t:] = Execution.ACTIVE
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
    shop: Shop, day: Timeline, t: int, index: int, run: Run, cycle: Cycle, *, breaks: bool
) -> int:
    """Approach, passes with the holds that people make, retract; ``breaks`` cuts it short."""
    p, random = shop.parameters, shop.random
    operation = run.program.operations[index]
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
        power = operation.power * p.spindle.motor.rated_power * p.power_scale * run.wear
        _write(day, t, path[:, a:b], operation, power)
        day.line[t : t + b - a] = 100 * (index + 1) + np.arange(a, b) // LINE
        t += b - a
    day.line[t:] = 100 * (index + 1) + length // LINE
    day.feed[t:], day.cut_power[t:], day.coolant[t:] = 0.0, 0.0, False
    day.speed_command[t + 1 :] = 0.0
    day.z[t : t + 2] = 300.0
    return t + 2


def _write(day: Timeline, a: int, path: Floats, operation: Operation, power: float) -> None:
    """Rows of ``path``: x, y, z, c [mm, deg], feed [mm/s], whether the tool cuts [W]."""
    b = a + path.shape[1]
    day.x[a:b], day.y[a:b], day.z[a:b] = path[:3]
    if operation.motion == "contour":
        day.hold[a:b] = True
        day.c[a:b] = path[3] % 360
    day.feed[a:b] = path[4]
    day.cut_power[a:b] = power * path[5]
    day.coolant[a:b] = operation.coolant


def _path(operation: Operation, length: int, override: float, random: Random) -> Floats:
    """Path of the tool in each second, shape (6, length); rows as in :func:`_write`."""
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
    feeds = np.where(engaged > 0, feed, operation.length / RETURN)
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


def _feed_hold(day: Timeline, t: int, operation: Operation, cycle: Cycle, random: Random) -> int:
    end = t + int(random.integers(8, 75))
    day.execution[t:end], day.execution[end:] = Execution.FEED_HOLD, Execution.ACTIVE
    day.hold[t:end] = operation.motion == "contour"
    day.coolant[t:end] = operation.coolant
    cycle.feed_hold_s += end - t
    return end


def _optional_stop(day: Timeline, t: int, cycle: Cycle, random: Random) -> int:
    end = t + int(random.integers(20, 150))  # M01: the operator measures
    day.execution[t:end], day.execution[end:] = Execution.INTERRUPTED, Execution.ACTIVE
    cycle.interrupted_s += end - t
    return end


def _trouble(day: Timeline, t: int, random: Random) -> None:
    """An alarm ends the run; sometimes the operator hits the emergency stop."""
    fault = FAULTS[random.integers(len(FAULTS))]
    end = t + int(random.integers(40, 300))
    day.alarms.append(Alarm(*fault, start=t, end=end))
    day.hold[t:] = False
    if random.random() < 0.4:
        day.emergency[t + 1 : t + 1 + int(random.integers(10, 40))] = True
    day.mode[t + 2 :] = Mode.MANUAL
    day.execution[end:] = Execution.READY


def working_day(shop: Shop, number: int) -> Timeline:
    """Timeline of day ``number`` (0 = the first Monday); Saturday and Sunday stay off."""
    day = Timeline(day=number)
    day.execution[:], day.mode[:] = Execution.STOPPED, Mode.MANUAL
    if number % 7 > FRIDAY:
        return day
    p, random = shop.parameters.shift, shop.random
    day.on = int(3600 * random.uniform(p.start_earliest, p.start_latest))
    end = 3600 * (p.friday_end if number % 7 == FRIDAY else p.end) + random.normal(0, 900)
    day.part_count[:] = shop.job.done if shop.job else 0
    day.power[day.on :] = True
    t = day.on + int(random.integers(300, 900))
    day.execution[t:] = Execution.READY
    if random.random() < p.warm_up_chance:
        t = run_program(shop, day, t, Run(program=WARM_UP, part=0))
        t += int(random.integers(60, 400))
    t = _batches(shop, day, t, min(end, LATEST - 5400))
    day.off = min(t + int(random.integers(300, 1500)), LATEST)
    _warnings(day, random)
    _switch_off(day)
    return day


def _batches(shop: Shop, day: Timeline, t: int, end: float) -> int:
    """Run jobs until no further part is started; the second at which work has ended."""
    random = shop.random
    while True:
        if shop.job is None or shop.job.done >= shop.job.size:
            t = _changeover(shop, day, t)
        t = _pause(shop, t)
        if t > end or shop.job is None:
            return t
        job = shop.job
        run = Run(program=job.program, part=job.done + 1, wear=job.wear)
        t = run_program(shop, day, t, run)
        if day.cycles[-1].complete:
            job.done += 1
            job.wear *= 1 + random.uniform(0.0, 0.02)  # the edge dulls
        else:
            t += int(random.integers(240, 1200))  # looks for the cause, changes the tool
            job.wear = 1.0
        t += int(random.integers(45, 130))  # next blank
        if random.random() < 0.06:
            t += int(random.integers(240, 1300))  # measures, waits, talks
        if job.done >= job.size and t > end:
            return t


def _changeover(shop: Shop, day: Timeline, t: int) -> int:
    p, random = shop.parameters, shop.random
    available = programs(p.programs, p.c_axis)
    shop.job = Job(
        program=available[random.integers(len(available))],
        size=int(random.integers(p.shift.batch_smallest, p.shift.batch_largest + 1)),
    )
    end = t + int(random.integers(12 * 60, 40 * 60))
    day.mode[t:], day.hold[t:], day.part_count[t:] = Mode.MANUAL, False, 0
    for start in np.sort(random.integers(t + 60, end - 120, int(random.integers(1, 4)))):
        _by_hand(day, int(start), min(int(start + random.integers(20, 90)), end - 10), random)
    day.execution[end:] = Execution.READY
    return end


def _by_hand(day: Timeline, a: int, b: int, random: Random) -> None:
    """Rotate the spindle by a line of manual data input, move the axes by the handwheel."""
    day.mode[a:b], day.execution[a:b] = Mode.MANUAL_DATA_INPUT, Execution.ACTIVE
    day.speed_command[a:b] = float(random.choice([500.0, 1000.0, 2000.0, 3000.0]))
    day.x[a:b] = np.linspace(random.uniform(-200, 0), random.uniform(-200, 0), b - a)
    day.z[a:b] = np.linspace(300, random.uniform(150, 250), b - a)
    day.feed[a:b] = 5.0
    day.execution[b:], day.speed_command[b:], day.feed[b:] = Execution.READY, 0.0, 0.0


def _pause(shop: Shop, t: int) -> int:
    """Second at which work goes on after a break, in which no part is loaded."""
    for start, length in shop.parameters.shift.breaks:
        a, b = 3600 * start, 3600 * (start + length)
        if a <= t < b:
            return int(b + shop.random.integers(0, 240))
    return t


def _warnings(day: Timeline, random: Random) -> None:
    for _ in range(int(random.poisson(4))):
        warning = WARNINGS[random.integers(len(WARNINGS))]
        a = int(random.integers(day.on + 300, day.off))
        b = min(a + int(random.integers(5, 200)), day.off)
        if not any(x.name == warning[0] and x.start <= b and a <= x.end for x in day.alarms):
            day.alarms.append(Alarm(*warning, start=a, end=b))


def _switch_off(day: Timeline) -> None:
    off = slice(day.off, DAY)
    day.power[off], day.hold[off], day.coolant[off] = False, False, False
    day.speed_command[off], day.cut_power[off], day.feed[off] = 0.0, 0.0, 0.0
    day.execution[off], day.mode[off] = Execution.STOPPED, Mode.MANUAL
    day.emergency[off] = False
