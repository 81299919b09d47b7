"""Records of feeds by the servo tool, and fast ones of both ends of a drive.

Feeds: strokes of each axis, and stretches of part programs in air; positions are absolute in the
machine's frame, since cogging and the screw's pitch depend on them.  Both ends (motor's encoder,
scale at the carriage, current): reversals of short strokes, strokes at several speeds, a frequency
response by a swept sine on the current while the axis goes at a constant feed.  The encoder errs
once a turn (eccentricity), the scale once a period of its grating; the screw has a pitch error and
grows warm.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.planner import HOME
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.drives.axis import Followed, follow
from pipeline.shop.drives.parameters import Axis, ShaftRecords
from pipeline.shop.drives.records import (
    Column,
    Move,
    axis_columns,
    commanded,
    quick_strokes,
    trace_head,
    travel,
    write_trace,
)
from pipeline.shop.parameters import Random, ShopParameters

SLOWEST = 0.1
"""An axis whose command is slower counts as one that stands [mm/s]."""
MOTION = 0.25
"""Least share of a stretch in which an axis moves [1]."""


def write_feed(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Faults of each of the ``files`` of ``feed/*.csv`` written into ``folder``, with their motion.

    The motion is a stroke or a stretch of a program; nothing is written when feeds are not
    recorded.  Raises ValueError when a part program is too short for its stretches.
    """
    drives = parameters.drives
    if not (drives.recorded and drives.feed.recorded):
        return {}
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    files = [
        _stroke(folder, letter, feed, run, parameters)
        for letter in drives.axes
        for feed, count in drives.feed.feeds
        for run in range(1, count + 1)
    ]
    for program, count in zip(programs, drives.feed.stretches, strict=True):
        files += _stretches(folder, program, count, parameters)
    return {"files": files}


def _stroke(
    folder: Path, letter: str, feed: float, run: int, parameters: ShopParameters
) -> dict[str, Any]:
    """Strokes there and back from a place of their own, at one feed [mm/min]."""
    drives, settings = parameters.drives, parameters.drives.feed
    axis, name = drives.axes[letter], f"stroke-{letter}-f{feed:g}-run{run}"
    random = parameters.generator(f"feed {name}")
    offset = parameters.control.work_offset["XYZ".index(letter)]
    start = round(offset + float(random.uniform(0, settings.spread)), 3)
    moves = [
        Move(length=sign * settings.length, speed=feed / 60)
        for _ in range(settings.times)
        for sign in (1, -1)
    ]
    bounds, frequency = parameters.control.path_bounds, axis.cascade.position_frequency
    command = start + travel(moves, bounds, frequency)
    columns = axis_columns(letter, axis, command, drives.tool, random, rate=settings.rate)
    told = {"axis": letter, "feed_mm_min": feed, "run": run, "start_mm": start}
    head = trace_head(parameters.machine, letter, settings.rate)
    file = f"feed/{name}.csv"
    done = write_trace(folder / file, head, columns, settings.rate, drives.tool, random)
    return {"file": file, **done, **told}


def _stretches(
    folder: Path, program: PartProgram, count: int, parameters: ShopParameters
) -> Iterator[dict[str, Any]]:
    drives, settings = parameters.drives, parameters.drives.feed
    if not count:
        return
    random = parameters.generator(f"feed program {program.name}")
    frequency = drives.x.cascade.position_frequency
    position = commanded(program, parameters, frequency, HOME)
    columns: list[Column] = []
    for command, (letter, axis) in zip(position.T, drives.axes.items(), strict=True):
        columns += axis_columns(letter, axis, command, drives.tool, random, rate=settings.rate)
    rows = round(settings.seconds * settings.rate)
    sampled = position[:: frequency // settings.rate]
    begins = _begins(sampled, rows, settings.rate, random)
    if len(begins) < count:
        raise ValueError(
            f"FeedRecords.stretches asks for {count} of {settings.seconds:g} s of {program.name}, "
            f"which moves in {len(begins)} such: ask for fewer or shorter ones"
        )
    head = trace_head(parameters.machine, drives.axes, settings.rate)
    for part, begin in enumerate(np.sort(begins[:count]).tolist(), 1):
        held = [replace(c, values=c.values[begin : begin + rows]) for c in columns]
        told = {"program": program.name, "start_s": begin / settings.rate}
        file = f"feed/program-{program.name}-part{part}.csv"
        done = write_trace(folder / file, head, held, settings.rate, drives.tool, random)
        yield {"file": file, **done, **told}


def _begins(position: Floats, rows: int, rate: int, random: Random) -> Ints:
    """First rows of stretches of ``rows`` with motion in positions (T, 3) [mm] at ``rate`` [Hz]."""
    moves = np.abs(np.diff(position, axis=0)).max(axis=1) * rate > SLOWEST
    begins = np.arange(int(random.integers(rows)), len(moves) - rows + 1, rows)
    moving = np.array([moves[b : b + rows].mean() for b in begins.tolist()])
    return random.permutation(begins[moving >= MOTION])


COLUMNS = (
    ({"plain": "{}_MotPos", "bracketed": "MPOS({})"}, "mm", 6),
    ({"plain": "{}_Scale", "bracketed": "SCALE({})"}, "mm", 5),
    ({"plain": "{}_Iq", "bracketed": "TCMD({})"}, "A", 3),
)
"""Name by the tool's style, unit and decimals of motor's position, the carriage's, current."""
SHORT = 6.0
"""Stroke of the reversals [mm]."""
REVERSED = (2.0, 8.0, 25.0)
"""Feeds of the reversals [mm/s]."""
SPEEDS = (20.0, 60.0, 150.0, 250.0)
"""Speeds of the long strokes [mm/s]."""
FEED = 25.0
"""Feed of the frequency response [mm/s]."""
SWEEP = (5.0, 220.0)
"""First and last frequency of the swept sine [Hz]."""
SWEPT = 3.0
"""Length of a sweep, one in each direction [s]."""
GRATING = 20e-6
"""Period of the scale's signals [m]."""


def write_shafts(folder: Path, parameters: ShopParameters) -> list[dict[str, Any]]:
    """Write ``shaft/<test>-<axis>.csv`` into ``folder``, when recorded; each file's faults."""
    drives = parameters.drives
    if not (drives.recorded and drives.shaft.recorded):
        return []
    return [
        _written(folder, f"{name}-{letter}", letter, command, swept, parameters)
        for letter in drives.axes
        for name, command, swept in _tests(letter, parameters)
    ]


def _tests(letter: str, parameters: ShopParameters) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, commanded positions (T,) [mm] and current that is added (T,) [A] of each test."""
    limits = getattr(parameters.control, letter.lower())
    frequency = parameters.drives.axes[letter].cascade.position_frequency
    rapid = limits.rapid / 60
    short = [Move(length=s * SHORT, speed=v) for v in REVERSED for s in (1, -1, 1, -1)]
    tests = {
        "reversal": [*short, *quick_strokes(4, 30.0, rapid)],
        "speed-steps": [
            *(Move(length=s * 60.0, speed=v) for v in SPEEDS if v < rapid for s in (1, -1)),
            *quick_strokes(3, -50.0, rapid),
        ],
    }
    for name, moves in tests.items():
        command = travel(moves, limits.bounds, frequency)
        yield name, command, np.zeros(command.size)
    moves = [Move(length=s * FEED * (SWEPT + 0.3), speed=FEED) for s in (1, -1)]
    command = travel(moves, limits.bounds, frequency)
    yield "frequency-response", command, _sweeps(command, frequency, parameters.drives.shaft)


def _sweeps(command: Floats, frequency: int, shaft: ShaftRecords) -> Floats:
    """Swept sines while the axis goes at its feed, one in each direction [A]; shape (T,)."""
    moving = np.abs(np.gradient(command) * frequency) > 0.99 * FEED
    starts = np.flatnonzero(np.diff(moving.astype(int)) == 1)
    added: Floats = np.zeros(command.size)
    time = np.arange(int(SWEPT * frequency)) / frequency
    phase = 2 * np.pi * (SWEEP[0] * time + (SWEEP[1] - SWEEP[0]) * time**2 / (2 * SWEPT))
    for start in starts.tolist():
        room = added[start : start + time.size]
        room += shaft.sweep * np.sin(phase[: room.size])
    return added


def _written(
    folder: Path, name: str, letter: str, command: Floats, swept: Floats, parameters: ShopParameters
) -> dict[str, Any]:
    drives, tool = parameters.drives, parameters.drives.tool
    axis = drives.axes[letter]
    random = parameters.generator(f"shaft {name}")
    out = follow(axis, command * 1e-3, random, injected=swept)
    rate = axis.cascade.position_frequency
    shown = both_ends(axis, out, drives.shaft, random)
    shown["current"] = out.current + random.standard_normal(out.current.size) * tool.current_noise
    columns = [
        Column(name=names[tool.style].format(letter), unit=unit, decimals=decimals, values=values)
        for (names, unit, decimals), values in zip(COLUMNS, shown.values(), strict=True)
    ]
    file = f"shaft/{name}.csv"
    head = trace_head(parameters.machine, letter, rate)
    done = write_trace(folder / file, head, columns, rate, tool, random)
    return {"file": file, **done}


def both_ends(axis: Axis, out: Followed, shaft: ShaftRecords, random: Random) -> dict[str, Floats]:
    """Positions of the motor and of the carriage as both encoders read them [mm]; shape (T,)."""
    turn = axis.gear * out.motor
    motor = out.motor + shaft.eccentricity * 1e-6 * np.sin(turn + 0.4)
    warm = shaft.growth * 1e-6 * np.linspace(0, 1, turn.size)
    pitch = 1e-6 * (shaft.pitch * out.carriage + shaft.pitch_ripple * np.sin(turn - 1.1)) + warm
    grating = shaft.interpolation * 1e-6 * np.sin(2 * np.pi * out.carriage / GRATING)
    noise = shaft.scale_noise * 1e-6 * random.standard_normal(turn.size)
    step, scale = axis.lead * 1e-3 / axis.cascade.steps_per_turn, shaft.scale_step * 1e-6
    return {
        "motor": np.round(motor / step) * step * 1e3,
        "carriage": np.round((out.carriage + pitch + grating + noise) / scale) * scale * 1e3,
    }
