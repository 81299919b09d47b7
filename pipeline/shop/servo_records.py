"""What a servo tuning tool records on a simulated machine: strokes, circles, a program, loads."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.shop.drive_axis import follow
from pipeline.shop.drive_commands import (
    Move,
    circles,
    of_axis,
    of_path,
    quick,
    reciprocation,
    travel,
)
from pipeline.shop.drive_parameters import Axis
from pipeline.shop.drive_program import commanded
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.part_programs import part_programs
from pipeline.shop.s_curve import Floats
from pipeline.shop.servo_parameters import RATE, ServoTool
from pipeline.shop.servo_tool import Column, column, write_trace

PROGRAM = 2
"""Which of the part programs is run, above the table."""
HOME = (-400.0, 0.0, 0.0)
"""Where the machine stands before it [mm]."""
CIRCLES = {20.0: (20.0, 60.0), 80.0: (50.0, 150.0)}
"""Diameter [mm]: feeds [mm/s]."""
TURNS = 1.25
LOADED = "XZ"
"""Axes that are pushed against."""
CREEP = 15.0
"""Feed meanwhile [mm/s]."""
PUSH = (250.0, 1100.0)
"""Least and greatest force of a push [N]."""
SETTLED = 0.03
"""Time that a push takes to come and to go [s]."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """One recording: commands (T,) of its axes [mm], force (T,) [N] and mass (T,) [kg] on them."""

    name: str
    commands: Mapping[str, Floats]
    load: Floats | None = None
    extra: Floats | None = None
    told: dict[str, Any] = field(default_factory=dict)


def write_servo(folder: Path, parameters: ShopParameters) -> list[dict[str, Any]]:
    """Write ``servo/*.csv`` into ``folder``; what is true of each file."""
    return [_written(folder, session, parameters) for session in _sessions(parameters)]


def _sessions(parameters: ShopParameters) -> Iterator[Session]:
    for letter in parameters.drives.axes:
        yield _reciprocation(letter, parameters)
    for diameter, feeds in CIRCLES.items():
        limits, frequency = of_path(parameters.control), _frequency(parameters)
        x, y = circles(diameter, feeds, TURNS, limits, frequency)
        told = {"diameter_mm": diameter, "feeds_mm_s": list(feeds)}
        yield Session(name=f"circle-{diameter:.0f}mm", commands={"X": x, "Y": y}, told=told)
    yield _program(parameters)
    for letter in LOADED:
        yield _load_step(letter, parameters)
    yield _inertia_step(parameters)


def _frequency(parameters: ShopParameters) -> int:
    """Of the position loops, which the axes of a machine share [Hz]."""
    return parameters.drives.x.cascade.position_frequency


def _reciprocation(letter: str, parameters: ShopParameters) -> Session:
    limits = getattr(parameters.control, letter.lower())
    own, lead = of_axis(limits), parameters.drives.axes[letter].lead
    moves = reciprocation(parameters.drives.tool.speeds, limits.rapid / 60, own, lead)
    command = travel(moves, own, _frequency(parameters))
    return Session(name=f"reciprocation-{letter}", commands={letter: command})


def _program(parameters: ShopParameters) -> Session:
    made = part_programs(parameters.control, parameters.generator("part programs"))[0][PROGRAM]
    way = commanded(made, parameters, _frequency(parameters), HOME)
    return Session(
        name=f"program-{made.name}", commands=dict(zip("XYZ", way.T, strict=True)),
        told={"program": made.name},
    )  # fmt: skip


def _load_step(letter: str, parameters: ShopParameters) -> Session:
    own, frequency = of_axis(getattr(parameters.control, letter.lower())), _frequency(parameters)
    moves = [Move(length=way * 12 * CREEP, speed=CREEP, pause=0.5) for way in (1, -1)]
    command = travel(moves, own, frequency)
    random = parameters.generator(f"servo pushes {letter}")
    time = np.arange(command.size) / frequency
    load: Floats = np.zeros(command.size)
    pushes, start = [], 1.2
    while start < time[-1] - 1.5:
        force = float(random.uniform(*PUSH) * random.choice((-1, 1)))
        end = start + float(random.uniform(0.5, 1.2))
        load += force * (_rise((time - start) / SETTLED) - _rise((time - end) / SETTLED))
        pushes.append({"start_s": round(start, 4), "end_s": round(end, 4), "force_N": force})
        start = end + float(random.uniform(0.4, 0.8))
    told = {"pushes": pushes}
    return Session(name=f"load-step-{letter}", commands={letter: command}, load=load, told=told)


def _rise(u: Floats) -> Floats:
    """From 0 to 1 for ``u`` from 0 to 1, smoothly."""
    inside: Floats = np.clip(u, 0, 1)
    return inside * inside * (3 - 2 * inside)


def _inertia_step(parameters: ShopParameters) -> Session:
    """Quick strokes without and with a workpiece, which is set down at standstill between them."""
    own, frequency = of_axis(parameters.control.x), _frequency(parameters)
    half = quick(8, 90.0, parameters.control.x.rapid / 60)
    waits = [*half[:-1], Move(length=half[-1].length, speed=half[-1].speed, pause=2.5)]
    command = travel([*waits, *half], own, frequency)
    middle = command.size // 2
    mass = parameters.drives.tool.workpiece
    extra: Floats = np.where(np.arange(command.size) < middle, 0.0, mass)
    told = {"set_down_s": middle / frequency, "mass_kg": mass}
    return Session(name="inertia-step-X", commands={"X": command}, extra=extra, told=told)


def _written(folder: Path, session: Session, parameters: ShopParameters) -> dict[str, Any]:
    tool, drives = parameters.drives.tool, parameters.drives
    random = parameters.generator(f"servo {session.name}")
    columns = []
    for letter, command in session.commands.items():
        columns += _axis_columns(letter, drives.axes[letter], command, session, tool, random)
    head = {"Machine": parameters.machine, "Axes": " ".join(session.commands),
            "Sampling": f"{1e3 / RATE:g} ms"}  # fmt: skip
    file = f"servo/{session.name}.csv"
    done = write_trace(folder / file, head, columns, RATE, tool, random)
    return {"file": file, **done, **session.told}


def _axis_columns(
    letter: str, axis: Axis, command: Floats, session: Session, tool: ServoTool,
    random: np.random.Generator,
) -> list[Column]:  # fmt: skip
    """Reference, position and current of an axis as the tool writes them, and the load cell's."""
    out = follow(axis, command * 1e-3, random, session.load, session.extra)
    rows = slice(None, None, axis.cascade.position_frequency // RATE)
    current = out.current[rows]
    current = current + random.standard_normal(current.size) * tool.current_noise
    shown = {
        "reference": command[rows],
        "position": _rounded(out.measured[rows] * 1e3, tool.position_step * 1e-3),
        "current": _rounded(current, tool.current_step),
    }
    if session.load is not None:
        noise = random.standard_normal(current.size) * tool.load_cell_noise
        shown["load"] = _rounded(session.load[rows] + tool.load_cell_offset + noise, 1.0)
    return [column(quantity, letter, values, tool) for quantity, values in shown.items()]


def _rounded(values: Floats, step: float) -> Floats:
    stepped: Floats = np.round(values / step) * step
    return stepped
