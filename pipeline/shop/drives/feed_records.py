"""Records of feeds by the servo tool: strokes of each axis, and stretches of part programs in air.

Positions are absolute in the machine's frame, since cogging and the screw's pitch depend on them.
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
from pipeline.shop.drives import commands
from pipeline.shop.drives.commands import Move
from pipeline.shop.drives.records import Column, axis_columns, trace_head, write_trace
from pipeline.shop.parameters import ShopParameters

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
    command = start + commands.travel(moves, bounds, frequency)
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
    position = commands.commanded(program, parameters, frequency, HOME)
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


def _begins(position: Floats, rows: int, rate: int, random: np.random.Generator) -> Ints:
    """First rows of stretches of ``rows`` with motion in positions (T, 3) [mm] at ``rate`` [Hz]."""
    moves = np.abs(np.diff(position, axis=0)).max(axis=1) * rate > SLOWEST
    begins = np.arange(int(random.integers(rows)), len(moves) - rows + 1, rows)
    moving = np.array([moves[b : b + rows].mean() for b in begins.tolist()])
    return random.permutation(begins[moving >= MOTION])
