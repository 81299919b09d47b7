"""Records of a servo tuning tool: strokes, standstills, circles, a program, steps, and truth.

Commanded positions are smoothed as controls do; they are in mm at the rate of the position loops,
programs run in the machine's frame.  Files have a head, names, units, rows, and faults, in the
format of two makers: ``plain`` (point, comma, seconds, ``X_PosAct``) and ``bracketed``
(milliseconds, ``APOS(X)``, decimal comma when the tool is set so).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.planner import HOME, Control, Section, Span
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.drives.axis import follow, hidden, truth
from pipeline.shop.drives.motor import RATE as MOTOR_RATE
from pipeline.shop.drives.motor import motor_truth, speed_steps
from pipeline.shop.drives.parameters import RATE, Axis, ServoTool
from pipeline.shop.files import rows_text, torn, write_text
from pipeline.shop.motion import change_time, rest_to_rest
from pipeline.shop.parameters import Bounds, Random, ShopParameters

BELL = (0.008, 0.004)
"""Lengths of the two moving averages after the interpolation [s]."""
REST = 0.3
"""Standstill before and after [s]."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """One stroke: signed length [mm], greatest speed [mm/s], standstill after it [s]."""

    length: float
    speed: float
    pause: float = 0.12


def travel(moves: Sequence[Move], bounds: Bounds, frequency: int) -> Floats:
    """Position along ``moves`` from 0 [mm] at ``frequency`` [Hz], shape (T,)."""
    profiles = [rest_to_rest(abs(m.length), m.speed, *bounds) for m in moves]
    seconds = [p.duration + m.pause for p, m in zip(profiles, moves, strict=True)]
    starts = np.cumsum([REST, *seconds])
    time: Floats = np.arange(int((starts[-1] + REST) * frequency), dtype=np.float64) / frequency
    position: Floats = np.zeros(time.size)
    place = 0.0
    edges = pairwise([*np.searchsorted(time, starts[:-1]).tolist(), time.size])
    for (first, last), start, move, one in zip(edges, starts[:-1], moves, profiles, strict=True):
        position[first:last] = place + np.sign(move.length) * one.covered(time[first:last] - start)
        place += move.length
    return smoothed(position, frequency)


def smoothed(position: Floats, frequency: int) -> Floats:
    """Mean over the last moments, twice; before the beginning it stood at ``position[0]``."""
    result = position - position[0]
    for length in BELL:
        window = max(round(length * frequency), 1)
        total = np.cumsum(result)
        total[window:] -= total[:-window].copy()
        result = total / window
    return result + position[0]


def reciprocation(speeds: Sequence[float], rapid: float, bounds: Bounds, lead: float) -> list[Move]:
    """Back and forth at each speed and at rapid, from both ends of the range, then reversals.

    Plateaus last 1 s at creep and 0.36 s at least.  The other end is no whole number of leads [mm]
    away; speeds below ``rapid`` [mm/s] count.
    """
    strokes = [(v, _stroke(v, bounds)) for v in (*(v for v in speeds if v < rapid), rapid)]
    moves = [Move(length=sign * s, speed=v) for v, s in strokes for sign in (1, -1)]
    revolutions = np.floor(strokes[-1][1] / lead) + 0.37
    moves.append(Move(length=float(revolutions * lead), speed=rapid))
    moves += [Move(length=sign * s, speed=v) for v, s in strokes for sign in (-1, 1)]
    return moves + quick_strokes(6, -40.0, rapid)


def _stroke(speed: float, bounds: Bounds) -> float:
    """Length [mm] of a stroke with a plateau at ``speed`` [mm/s]."""
    bends = change_time(np.zeros(1), np.array([speed]), *bounds)[0]
    return speed * (min(max(6.0 / speed, 0.36), 1.0) + float(bends))


def quick_strokes(count: int, length: float, speed: float) -> list[Move]:
    """Short strokes, one directly after the other."""
    return [Move(length=(-1) ** k * length, speed=speed, pause=0.02) for k in range(2 * count)]


def circles(
    diameter: float, feeds: Sequence[float], revolutions: float, bounds: Bounds, frequency: int
) -> tuple[Floats, Floats]:
    """X and Y [mm] on a circle about 0, at each of ``feeds`` [mm/s] there and back."""
    radius = diameter / 2
    length = revolutions * pi * diameter
    moves = [Move(length=s * length, speed=v, pause=0.5) for v in feeds for s in (1, -1)]
    angle = travel(moves, bounds, frequency) / radius
    return radius * np.cos(angle), radius * np.sin(angle)


def commanded(
    program: PartProgram, parameters: ShopParameters, frequency: int, place: Sequence[float]
) -> Floats:
    """Commanded X Y Z in the machine's frame [mm], shape (T, 3), from ``place`` to the end."""
    plan = Control(
        parameters=parameters.control, motor=parameters.spindle.motor, lengths=program.lengths,
        random=parameters.generator("servo program"), place=list(place),
        tool=program.tools[-1].number,
    ).run(program)  # fmt: skip
    time: Floats = np.arange(int((plan.duration + 2 * REST) * frequency)) / frequency - REST
    position: Floats = np.tile(np.array(place), (time.size, 1))
    spans = [s for s in plan.spans if s.kind == "rapid" or s.section is not None]
    starts = np.searchsorted(time, [s.start for s in spans]).tolist()
    for (first, last), span in zip(pairwise([*starts, time.size]), spans, strict=True):
        if first < last:
            within, path = time[first:last] - span.start, span.section
            position[first:last] = (
                span.positions(within) if path is None else _cut_position(span, path, within)
            )
    return np.stack([smoothed(position[:, k], frequency) for k in range(3)], axis=1)


def _cut_position(span: Span, section: Section, time: Floats) -> Floats:
    """Position (T, 3) [mm] at times since the start of a cut, also after its end."""
    along, ends, points = section.motion.covered(time), section.ends, section.points
    block = np.minimum(np.searchsorted(ends, along), len(ends) - 1)
    begins = np.concatenate([[0.0], ends[:-1]])
    share = np.clip((along - begins[block]) / (ends - begins)[block], 0, 1)
    a, b = points[block], points[block + 1]
    position = a + (b - a) * share[:, None]
    # on an arc the radius of its first point turns about the centre
    turn = np.array([s.turn for s in section.steps])[block]
    arc = turn != 0
    centre = np.array([s.centre for s in section.steps])[block]
    r = a[:, :2] - centre
    c, s = np.cos(turn * share), np.sin(turn * share)
    turned = centre + np.stack([c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1]], axis=1)
    position[arc, :2] = turned[arc]
    # from the program's frame to the machine's
    return position + (np.array(span.begin) - np.array(section.start))


AXIS_COLUMNS = {
    "reference": ({"plain": "{}_PosSet", "bracketed": "CPOS({})"}, "mm", 4),
    "position": ({"plain": "{}_PosAct", "bracketed": "APOS({})"}, "mm", 4),
    "current": ({"plain": "{}_Iq", "bracketed": "TCMD({})"}, "A", 3),
    "load": ({"plain": "{}_Force", "bracketed": "FEXT({})"}, "N", 0),
}
"""Name by the tool's style, unit and decimals of an axis' column for each quantity."""
TITLES = {"plain": "Drive trace DT-4 (simulated)", "bracketed": "SERVO TUNING GUIDE (simulated)"}
WIDEST = 3
"""Rows of the longest gap."""
SLOT = 50
"""Rows from one place of a possible fault to the next."""
PROGRAM = 2
"""Index of the part program that is run, above the table."""
CIRCLES = {20.0: (20.0, 60.0), 80.0: (50.0, 150.0)}
"""Feeds [mm/s] of the circles by their diameter [mm]."""
REVOLUTIONS = 1.25
"""Length of each circular motion, in revolutions."""
STOPS = (31.0, 53.0, -31.0, -53.0)
"""Strokes before the standstills [mm]."""
HOLD = 5.0
"""Length of a standstill [s]."""
LOADED = "XZ"
"""Axes that are pushed against."""
CREEP = 15.0
"""Feed while an axis is pushed, and before a standstill [mm/s]."""
PUSH = (250.0, 1100.0)
"""Least and greatest force of a push [N]."""
SETTLED = 0.03
"""Time that a push takes to come and to go [s]."""
MOTOR_COLUMNS = (
    ({"plain": "Ud", "bracketed": "UD(X)"}, "V", 2, 1.0, 0.0),
    ({"plain": "Uq", "bracketed": "UQ(X)"}, "V", 2, 1.0, 0.0),
    ({"plain": "Id", "bracketed": "ID(X)"}, "A", 3, 1.0, 0.02),
    ({"plain": "Iq", "bracketed": "IQ(X)"}, "A", 3, 1.0, 0.02),
    ({"plain": "Speed", "bracketed": "SPEED(X)"}, "1/min", 2, 1 / RPM, 0.05),
)
"""Name by the tool's style, unit, decimals, factor from SI and standard deviation of the noise of
the motor's columns; voltages are commands, without noise."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: its name, unit, decimals and values (T,) as they are written."""

    name: str
    unit: str
    decimals: int
    values: Floats


def write_trace(
    path: Path, head: Mapping[str, str], columns: list[Column], rate: int, tool: ServoTool,
    random: Random | None,
) -> dict[str, Any]:  # fmt: skip
    """Write one file of T rows at ``rate`` [Hz]; returns its faults, made with ``random``."""
    size = columns[0].values.size
    stamps = np.arange(size) / rate * (1 + tool.clock_error * 1e-6)
    kept: np.ndarray = np.arange(size)
    faults: dict[str, Any] = {"gaps": [], "repeated": [], "torn": False}
    if random is not None:
        kept, faults = _faults(stamps, random, tool)
        faults["torn"] = path.stem == tool.torn
    seconds = tool.style == "plain"
    time = Column(
        name="Time", unit="s" if seconds else "ms", decimals=6 if seconds else 3,
        values=stamps if seconds else stamps * 1e3,
    )  # fmt: skip
    text = _text(path.stem, head, [time, *columns], kept, tool)
    write_text(path, torn(text) if faults["torn"] else text)
    return {"rows": int(kept.size), "seconds": size / rate, **faults}


def _faults(stamps: Floats, random: Random, tool: ServoTool) -> tuple[np.ndarray, dict[str, Any]]:
    """Rows that are kept, and the faults; one stamp is repeated in place."""
    keep = np.ones(stamps.size, bool)
    gaps = []
    slots = random.choice(np.arange(1, stamps.size // SLOT), tool.dropped, replace=False)
    for first in (np.sort(slots) * SLOT).tolist():
        lost = int(random.integers(1, WIDEST + 1))
        keep[first : first + lost] = False
        gaps.append({"row": first, "lost": lost})
    repeated = SLOT * int(random.integers(1, stamps.size // SLOT)) + SLOT // 2
    stamps[repeated] = stamps[repeated - 1]
    return np.flatnonzero(keep), {"gaps": gaps, "repeated": [repeated], "torn": False}


def _text(
    name: str, head: Mapping[str, str], columns: list[Column], rows: np.ndarray, tool: ServoTool
) -> str:
    comma = tool.decimal == ","
    separator = ";" if comma else ","
    lines = [TITLES[tool.style], f"Trace{separator}{name}"]
    lines += [f"{key}{separator}{value}" for key, value in head.items()]
    if tool.style == "bracketed":
        lines = [f"# {line}" for line in lines]
    lines += [separator.join(c.name for c in columns), separator.join(c.unit for c in columns)]
    form = separator.join(f"%.{c.decimals}f" for c in columns) + "\n"
    body = rows_text(np.stack([c.values[rows] for c in columns], axis=1), form)
    return "\n".join(lines) + "\n" + (body.replace(".", ",") if comma else body)


@dataclass(frozen=True, kw_only=True)
class Session:
    """One recording: commands (T,) of its axes [mm], force (T,) [N] and mass (T,) [kg] on them."""

    name: str
    commands: Mapping[str, Floats]
    load: Floats | None = None
    extra: Floats | None = None
    truth: dict[str, Any] = field(default_factory=dict)


def _sessions(parameters: ShopParameters) -> Iterator[Session]:
    for letter in parameters.drives.axes:
        yield _reciprocation(letter, parameters)
        yield _standstill(letter, parameters)
    bounds, frequency = parameters.control.path_bounds, _frequency(parameters)
    for diameter, feeds in CIRCLES.items():
        x, y = circles(diameter, feeds, REVOLUTIONS, bounds, frequency)
        truth = {"diameter_mm": diameter, "feeds_mm_s": list(feeds)}
        yield Session(name=f"circle-{diameter:.0f}mm", commands={"X": x, "Y": y}, truth=truth)
    yield _program(parameters)
    for letter in LOADED:
        yield _load_step(letter, parameters)
    yield _inertia_step(parameters)


def _frequency(parameters: ShopParameters) -> int:
    """Rate of the position loops, which the axes of a machine share [Hz]."""
    return parameters.drives.x.cascade.position_frequency


def _reciprocation(letter: str, parameters: ShopParameters) -> Session:
    limits, speeds = getattr(parameters.control, letter.lower()), parameters.drives.tool.speeds
    lead = parameters.drives.axes[letter].lead
    moves = reciprocation(speeds, limits.rapid / 60, limits.bounds, lead)
    command = travel(moves, limits.bounds, _frequency(parameters))
    return Session(name=f"reciprocation-{letter}", commands={letter: command})


def _standstill(letter: str, parameters: ShopParameters) -> Session:
    bounds = getattr(parameters.control, letter.lower()).bounds
    moves = [Move(length=length, speed=CREEP, pause=HOLD) for length in STOPS]
    command = travel(moves, bounds, _frequency(parameters))
    return Session(name=f"standstill-{letter}", commands={letter: command})


def _program(parameters: ShopParameters) -> Session:
    made = part_programs(parameters.control, parameters.generator("part programs"))[0][PROGRAM]
    position = commanded(made, parameters, _frequency(parameters), HOME)
    return Session(
        name=f"program-{made.name}", commands=dict(zip("XYZ", position.T, strict=True)),
        truth={"program": made.name},
    )  # fmt: skip


def _load_step(letter: str, parameters: ShopParameters) -> Session:
    bounds, frequency = getattr(parameters.control, letter.lower()).bounds, _frequency(parameters)
    moves = [Move(length=sign * 12 * CREEP, speed=CREEP, pause=0.5) for sign in (1, -1)]
    command = travel(moves, bounds, frequency)
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
    truth = {"pushes": pushes}
    return Session(name=f"load-step-{letter}", commands={letter: command}, load=load, truth=truth)


def _rise(u: Floats) -> Floats:
    inside: Floats = np.clip(u, 0, 1)
    return inside * inside * (3 - 2 * inside)


def _inertia_step(parameters: ShopParameters) -> Session:
    """Quick strokes without and with a workpiece, which is set down at standstill between them."""
    limits, frequency = parameters.control.x, _frequency(parameters)
    half = quick_strokes(8, 90.0, limits.rapid / 60)
    waits = [*half[:-1], replace(half[-1], pause=2.5)]
    command = travel([*waits, *half], limits.bounds, frequency)
    middle = command.size // 2
    mass = parameters.drives.tool.workpiece
    extra: Floats = np.where(np.arange(command.size) < middle, 0.0, mass)
    truth = {"set_down_s": middle / frequency, "mass_kg": mass}
    return Session(name="inertia-step-X", commands={"X": command}, extra=extra, truth=truth)


def _written(folder: Path, session: Session, parameters: ShopParameters) -> dict[str, Any]:
    tool, drives = parameters.drives.tool, parameters.drives
    random = parameters.generator(f"servo {session.name}")
    columns = []
    for letter, command in session.commands.items():
        columns += axis_columns(
            letter, drives.axes[letter], command, tool, random, load=session.load,
            extra=session.extra, load_cell=True,
        )  # fmt: skip
    head = trace_head(parameters.machine, session.commands, RATE)
    file = f"servo/{session.name}.csv"
    done = write_trace(folder / file, head, columns, RATE, tool, random)
    return {"file": file, **done, **session.truth}


def trace_head(machine: str, letters: Iterable[str], rate: int) -> dict[str, str]:
    """Lines above a trace: the machine, the axes' letters, the time between samples."""
    return {"Machine": machine, "Axes": " ".join(letters), "Sampling": f"{1e3 / rate:g} ms"}


def axis_columns(
    letter: str, axis: Axis, command: Floats, tool: ServoTool, random: Random, *,
    load: Floats | None = None, extra: Floats | None = None, load_cell: bool = False,
    rate: int = RATE,
) -> list[Column]:  # fmt: skip
    """Reference, position and current of an axis as the tool writes them, and the load cell's.

    ``command`` (T,): at the ticks of the position loop [mm], a multiple of ``rate`` [Hz]; ``load``
    (T,): against positive motion [N]; ``extra`` (T,): on the carriage [kg].
    """
    out = follow(axis, command * 1e-3, random, load, extra)
    rows = slice(None, None, axis.cascade.position_frequency // rate)
    current = out.current[rows]
    current = current + random.standard_normal(current.size) * tool.current_noise
    shown = {
        "reference": command[rows],
        "position": _rounded(out.measured[rows] * 1e3, tool.position_step * 1e-3),
        "current": _rounded(current, tool.current_step),
    }
    if load_cell and load is not None:
        noise = random.standard_normal(current.size) * tool.load_cell_noise
        shown["load"] = _rounded(load[rows] + tool.load_cell_offset + noise, 1.0)
    columns = []
    for quantity, values in shown.items():
        names, unit, decimals = AXIS_COLUMNS[quantity]
        name = names[tool.style].format(letter)
        columns.append(Column(name=name, unit=unit, decimals=decimals, values=values))
    return columns


def _rounded(values: Floats, step: float) -> Floats:
    return np.round(values / step) * step


def write_motor(folder: Path, parameters: ShopParameters) -> tuple[dict[str, Any], dict[str, Any]]:
    """Write ``motor/speed-steps-X.csv``; the truth about the motor and about the file."""
    axis, tool = parameters.drives.x, parameters.drives.tool
    out = speed_steps(axis)
    random = parameters.generator("motor speed-steps-X")
    columns = [
        Column(
            name=names[tool.style], unit=unit, decimals=decimals,
            values=out[:, k] * factor + random.standard_normal(len(out)) * noise,
        )
        for k, (names, unit, decimals, factor, noise) in enumerate(MOTOR_COLUMNS)
    ]  # fmt: skip
    file = "motor/speed-steps-X.csv"
    head = {"Machine": parameters.machine, "Axis": "X", "Sampling": f"{1e3 / MOTOR_RATE:g} ms"}
    done = write_trace(folder / file, head, columns, MOTOR_RATE, tool, None)
    return motor_truth(axis, out), {"file": file, **done}


def write_drives(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``servo/*.csv`` and ``motor/*.csv`` into ``folder``, when the drives are recorded.

    The truth: ``axes`` and ``motor``, parameters that a fit of one mass should recover, in SI;
    ``more``, effects beyond such a model, the tool, the files and their faults.
    """
    drives = parameters.drives
    if not drives.recorded:
        return {}
    files = [_written(folder, session, parameters) for session in _sessions(parameters)]
    motor, file = write_motor(folder, parameters)
    return {
        "axes": {letter: truth(axis) for letter, axis in drives.axes.items()},
        "motor": motor,
        "more": {
            "axes": {letter: hidden(axis) for letter, axis in drives.axes.items()},
            "tool": asdict(drives.tool),
            "files": [*files, file],
        },
    }
