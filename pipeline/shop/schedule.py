"""The working day: switching on, warm-up, batches, breaks, changeovers, end of shift."""

from dataclasses import dataclass

import numpy as np

from pipeline.shop.cycles import Run, run_program
from pipeline.shop.parameters import DAY, ShopParameters
from pipeline.shop.programs import WARM_UP, Program, programs
from pipeline.shop.timeline import (
    ACTIVE,
    MANUAL,
    MANUAL_DATA_INPUT,
    READY,
    STOPPED,
    Alarm,
    Timeline,
)

FRIDAY = 4
LATEST = DAY - 1800  # no working day goes on after that

WARNINGS = (  # as controls say them; some say nothing
    ("logic_c", "WARNING", "361", "", " ERROR(SET UP SWITCH)"),
    ("logic_c", "WARNING", "1105", "", ""),
    ("coolant_c", "WARNING", "217", "LOW", "COOLANT LEVEL"),
    ("lube_c", "WARNING", "402", "LOW", "LUB. OIL LEVEL"),
    ("system_c", "WARNING", "442", "", "DATA RENEWAL NOT ALLOWED"),
    ("motion_c", "WARNING", "1101", "", "INTERFERE"),
)


@dataclass(kw_only=True)
class Job:
    """The batch on the machine; it goes on the next day."""

    program: Program
    size: int
    done: int = 0
    wear: float = 1.0


@dataclass(kw_only=True)
class Shop:
    """What outlives a day."""

    parameters: ShopParameters
    random: np.random.Generator
    job: Job | None = None
    cycles: int = 0


def working_day(shop: Shop, number: int) -> Timeline:
    """Timeline of day ``number`` (0 = the first Monday); Saturday and Sunday stay off."""
    day = Timeline(day=number)
    day.execution[:], day.mode[:] = STOPPED, MANUAL
    if number % 7 > FRIDAY:
        return day
    p, random = shop.parameters.shift, shop.random
    day.on = int(3600 * random.uniform(p.start_earliest, p.start_latest))
    end = 3600 * (p.friday_end if number % 7 == FRIDAY else p.end) + random.normal(0, 900)
    day.part_count[:] = shop.job.done if shop.job else 0
    day.power[day.on :] = True
    t = day.on + int(random.integers(300, 900))
    day.execution[t:] = READY
    if random.random() < p.warm_up_chance:
        t = _run(shop, day, t, Run(program=WARM_UP, part=0)) + int(random.integers(60, 400))
    t = _batches(shop, day, t, min(end, LATEST - 5400))
    day.off = min(t + int(random.integers(300, 1500)), LATEST)
    _warnings(day, random)
    _switch_off(day)
    return day


def _run(shop: Shop, day: Timeline, t: int, run: Run) -> int:
    shop.cycles += 1
    return run_program(day, t, run, shop.cycles, shop.parameters, shop.random).end


def _batches(shop: Shop, day: Timeline, t: int, end: float) -> int:
    """Run jobs until nobody starts another part; the second at which work has ended."""
    random = shop.random
    while True:
        if shop.job is None or shop.job.done >= shop.job.size:
            t = _changeover(shop, day, t)
        t = _pause(shop, t)
        if t > end or shop.job is None:
            return t
        job = shop.job
        t = _run(shop, day, t, Run(program=job.program, part=job.done + 1, wear=job.wear))
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
    """A new job: set up by hand, try the spindle, touch the work."""
    p, random = shop.parameters, shop.random
    known = programs(p.programs, p.c_axis)
    shop.job = Job(
        program=known[random.integers(len(known))],
        size=int(random.integers(p.shift.batch_smallest, p.shift.batch_largest + 1)),
    )
    end = t + int(random.integers(12 * 60, 40 * 60))
    day.mode[t:], day.hold[t:], day.part_count[t:] = MANUAL, False, 0
    for start in np.sort(random.integers(t + 60, end - 120, int(random.integers(1, 4)))):
        _by_hand(day, int(start), min(int(start + random.integers(20, 90)), end - 10), random)
    day.execution[end:] = READY
    return end


def _by_hand(day: Timeline, a: int, b: int, random: np.random.Generator) -> None:
    """A line of manual data input turns the spindle, the handwheel moves the axes."""
    day.mode[a:b], day.execution[a:b] = MANUAL_DATA_INPUT, ACTIVE
    day.speed_command[a:b] = float(random.choice([500.0, 1000.0, 2000.0, 3000.0]))
    day.x[a:b] = np.linspace(random.uniform(-200, 0), random.uniform(-200, 0), b - a)
    day.z[a:b] = np.linspace(300, random.uniform(150, 250), b - a)
    day.feed[a:b] = 5.0
    day.execution[b:], day.speed_command[b:], day.feed[b:] = READY, 0.0, 0.0


def _pause(shop: Shop, t: int) -> int:
    """Nobody loads a part in a break."""
    for start, length in shop.parameters.shift.breaks:
        a, b = 3600 * start, 3600 * (start + length)
        if a <= t < b:
            return int(b + shop.random.integers(0, 240))
    return t


def _warnings(day: Timeline, random: np.random.Generator) -> None:
    for _ in range(int(random.poisson(4))):
        name, level, code, qualifier, text = WARNINGS[random.integers(len(WARNINGS))]
        a = int(random.integers(day.on + 300, day.off))
        b = min(a + int(random.integers(5, 200)), day.off)
        if any(x.name == name and x.start <= b and a <= x.end for x in day.alarms):
            continue
        day.alarms.append(
            Alarm(name=name, level=level, code=code, qualifier=qualifier, text=text, start=a, end=b)
        )


def _switch_off(day: Timeline) -> None:
    off = slice(day.off, DAY)
    day.power[off], day.hold[off], day.coolant[off] = False, False, False
    day.speed_command[off], day.cut_power[off], day.feed[off] = 0.0, 0.0, 0.0
    day.execution[off], day.mode[off] = STOPPED, MANUAL
    day.emergency[off] = False
