"""Motion of the tool in a trial cut, and the part of the blank that it sweeps.

Any dialect's program becomes steps for the shop's control, whose plan becomes a track of the tool.
Layers of the blank lie between the heights at which the program mills, finer where it ramps; a disc
moves along the path of the tool over their square cells (numba), each of which keeps the path
length at which it was first swept.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.gcode.setup import Tool as Register
from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.shop.control.planner import HOME, SHORTEST, Control, Plan, Section
from pipeline.shop.control.postprocessor import Kind as StepKind
from pipeline.shop.control.postprocessor import PartProgram, Point, Step
from pipeline.shop.control.records import state_at
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import ControlParameters, Random, ShopParameters
from pipeline.shop.trial.job import Box, TrialJob

CODES = {7: 8, 8: 8, 9: 9}
"""M codes that take time, by the code whose time they have; others take none."""
MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC)


def program_steps(
    text: bytes | str, name: str, job: TrialJob, control: ControlParameters
) -> PartProgram:
    """The steps of a program, its coordinates being those of its one work offset.

    Raises GcodeError at the first word that cannot be followed; ValueError at the first move that
    this mill does not have: another axis, another plane, a thread.
    """
    data = text.encode() if isinstance(text, str) else text
    offset = (*control.work_offset, 0.0, 0.0, 0.0)
    tools = {n: Register(length=job.length(n), diameter=t.diameter) for n, t in job.tools.items()}
    moves = interpret(Program(data, name), Setup(
        dialect=job.dialect, initial_position=(*HOME, 0.0, 0.0, 0.0),
        work_offsets={f"G{n}": offset for n in range(54, 60)}, tools=tools,
        peck_clearance=control.peck_clearance,
    ))  # fmt: skip
    _refuse(moves, name)
    steps = _Steps(moves, name, job, control)
    for row in range(len(moves)):
        steps.take(row)
    return PartProgram(name=name, text=data.decode("latin-1"), steps=tuple(steps.done), tools=())


def first_tool(job: TrialJob) -> int:
    """Tool in the spindle before the program: the job's tool where it has but one, else none."""
    return next(iter(job.tools)) if len(job.tools) == 1 else 0


def _refuse(moves: Moves, name: str) -> None:
    arc = moves.kind == Kind.ARC
    turned = np.any(moves.end[:, 3:] != moves.start[:, 3:], axis=1)
    for rows, words in (
        (np.isin(moves.kind, (Kind.PROBE, Kind.THREAD)), "probes or cuts a thread"),
        (arc & (moves.plane != 17), "is an arc outside the plane XY"),
        (turned, "moves a rotary axis"),
        (moves.direction < 0, "turns the spindle to the left"),
        (moves.constant_surface_speed, "asks for a constant surface speed"),
    ):
        if rows.any():
            line = moves.line[int(np.argmax(rows))]
            raise ValueError(f"{name}:{line} {words}: a trial cut mills with X, Y, Z and M3 only")


class _Steps:
    """Rows become steps, one after the other; ``at`` is where the tool's tip is."""

    def __init__(self, moves: Moves, name: str, job: TrialJob, control: ControlParameters) -> None:
        self.moves, self.name, self.job, self.offset = moves, name, job, control.work_offset
        self.height = control.change_height
        self.place = moves.origin[:3]
        self.start, self.length = moves.start[:, :3], moves.length
        self.tool, self.speed = first_tool(job), 0
        self.done = [Step(kind="rapid", line=1, end=self._tip(self.place))]

    def take(self, row: int) -> None:
        moves, kind = self.moves, Kind(self.moves.kind[row])
        line = int(moves.line[row])
        if kind in MOVING:
            self._move(row, kind, line)
        elif kind == Kind.TOOL_CHANGE:
            self.tool = int(moves.tool[row])
            self.place = np.array([*self.place[:2], self.height])
            self._add("tool", line, number=self.tool)
        elif kind == Kind.SPINDLE:
            speed = round(float(moves.speed[row])) if moves.direction[row] else 0
            if speed != self.speed:
                self._add("spindle", line, number=speed)
            self.speed = speed
        elif kind == Kind.DWELL:
            turn = 60 / max(self.speed, 1) if moves.code[row] == 1 else 1.0
            self._add("dwell", line, seconds=float(moves.value[row]) * turn)
        elif kind == Kind.M_CODE and int(moves.code[row]) in CODES:
            self._add("code", line, number=CODES[int(moves.code[row])])
        elif kind in (Kind.STOP, Kind.END):
            number = 1 if kind == Kind.STOP else 30
            self._add("code" if number == 1 else "end", line, number=number)

    def _move(self, row: int, kind: Kind, line: int) -> None:
        moves = self.moves
        # what the program does not move stays where the changer has left it
        stays = moves.end[row, :3] == self.start[row]
        target = np.where(stays, self.place, moves.end[row, :3])
        straight = float(np.linalg.norm(target - self.place))
        length = float(self.length[row]) if kind == Kind.ARC else straight
        if length < SHORTEST:
            return
        tip = self._tip(target)
        if kind == Kind.RAPID:
            self._add("rapid", line, end=tip)
        elif kind == Kind.FEED:
            self._add("line", line, end=tip, feed=self._feed(row, length))
        else:
            centre = moves.centre[row, :2] - self.offset[:2]
            self._add(
                "arc", line, end=tip, centre=(float(centre[0]), float(centre[1])),
                turn=float(moves.angle[row]), feed=self._feed(row, length),
            )  # fmt: skip
        self.place = target

    def _feed(self, row: int, length: float) -> float:
        """Feed of a row [mm/min]."""
        mode, feed = self.moves.feed_mode[row], float(self.moves.feed[row])
        if mode == FeedMode.PER_REVOLUTION:
            feed *= self.speed
        elif mode == FeedMode.INVERSE_TIME:
            feed *= length
        if not feed > 0:
            raise ValueError(
                f"{self.name}:{self.moves.line[row]} cuts without a feed: program F, and S for a "
                "feed by the turn"
            )
        return feed

    def _add(self, kind: StepKind, line: int, end: Point | None = None, **more: Any) -> None:
        tip = self._tip(self.place) if end is None else end
        self.done.append(Step(kind=kind, line=line, end=tip, **more))

    def _tip(self, place: Floats) -> Point:
        """The tool's tip in the coordinates of the work offset [mm]."""
        x, y, z = (float(p - o) for p, o in zip(place, self.offset, strict=True))
        return x, y, z - self.job.length(self.tool)


def control_of(
    program: PartProgram, job: TrialJob, parameters: ShopParameters, random: Random
) -> Control:
    """The shop's control before ``program``, with the job's tools in its magazine."""
    called = {s.number for s in program.steps if s.kind == "tool"} | {0, first_tool(job)}
    return Control(
        parameters=parameters.control, motor=parameters.spindle.motor, random=random,
        lengths={number: job.length(number) for number in called}, tool=first_tool(job),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """A run in T cycles of ``cycle`` [s]."""

    cycle: float
    tip: Floats
    """Tip of the tool, as it is, in the coordinates of the work offset [mm]; shape (T, 3)."""
    line: Ints
    tool: Ints
    """Line of the program, tool in the spindle; shape (T,)."""
    speed: Floats
    """Speed of the spindle as commanded, its ramps included [rev/min]; shape (T,)."""


def track(plan: Plan, job: TrialJob, control: ControlParameters) -> Track:
    """Motion of the tool while the control runs ``plan``."""
    cycles = int(np.ceil(plan.duration / control.cycle)) + 1
    time: Floats = np.arange(cycles, dtype=np.float64) * control.cycle
    command, line, tool = commands_at(plan, job, control, time)
    share = -np.expm1(-control.position_gain * control.cycle)
    tip = np.stack([lagged(np.ascontiguousarray(c), share, c[0]) for c in command.T], axis=1)
    for number in np.unique(tool).tolist():
        tip[tool == number] -= tip_shift(control, job, number)
    return Track(cycle=control.cycle, tip=tip, line=line, tool=tool, speed=plan.spindle_speed(time))


def commands_at(
    plan: Plan, job: TrialJob, control: ControlParameters, time: Floats
) -> tuple[Floats, Ints, Ints]:
    """Positions in the machine's frame (T, 3) [mm], line and tool (T,), at ``time`` (T,)."""
    command = np.empty((time.size, 3))
    line, tool, _ = state_at(plan, time)
    edges = np.searchsorted(time, [s.start for s in plan.spans] + [np.inf])
    for k, span in enumerate(plan.spans):
        part = slice(edges[k], edges[k + 1])
        within = time[part] - span.start
        if span.section is None:
            command[part] = span.positions(within)
        else:
            s = np.minimum(span.section.motion.at(within)[0], span.section.ends[-1])
            block = np.minimum(np.searchsorted(span.section.ends, s), span.section.ends.size - 1)
            command[part] = _along(s, block, span.section)
            command[part] += tip_shift(control, job, span.tool)
    return command, line, tool


def tip_shift(control: ControlParameters, job: TrialJob, tool: int) -> Floats:
    """From the tip's coordinates to the machine's [mm]."""
    return np.array(control.work_offset) + [0.0, 0.0, job.length(tool)]


def _along(s: Floats, block: Ints, section: Section) -> Floats:
    """Positions at ``s`` (T,) [mm] of a path of cuts, in its ``block`` (T,); shape (T, 3) [mm]."""
    points, ends, steps = section.points, section.ends, section.steps
    turn = np.array([step.turn for step in steps])
    centre = np.array([step.centre for step in steps])
    lengths = np.diff(np.concatenate([[0.0], ends]))
    share = 1 - (ends[block] - s) / lengths[block]
    out: Floats = points[block] + (points[block + 1] - points[block]) * share[:, None]
    arcs = turn[block] != 0
    if arcs.any():
        k, part = block[arcs], share[arcs]
        first, last = points[k, :2] - centre[k], points[k + 1, :2] - centre[k]
        radius = np.hypot(*first.T) * (1 - part) + np.hypot(*last.T) * part
        angle = np.arctan2(first[:, 1], first[:, 0]) + turn[k] * part
        out[arcs, 0] = centre[k, 0] + radius * np.cos(angle)
        out[arcs, 1] = centre[k, 1] + radius * np.sin(angle)
    return out


FRACTION = 0.5
"""Share of a cell that the disc moves between two checks for new cells under it [1]."""
OVER = 0.5
"""Share of a cell by which the disc is wider than the tool, so that one on the same path again
meets no cells at the walls that its last pass had touched but not swept [1]."""
CELL = 1 / 300
"""Side of a cell over the smallest tool's diameter [1]."""
MOST = 12_000_000
"""Greatest number of cells in all layers: 48 MiB."""
RAMP = 0.25
"""Greatest height of a layer through which the tool ramps down [mm]."""
SLICE = 0.25
"""Greatest height of a slice of the edges, as the forces are summed [mm]."""
SAME = 1e-4
"""Heights that are closer count as one [mm]."""


@compiled_with(nogil=True)
def sweep(
    first: np.ndarray, middles: np.ndarray, corner: tuple[float, float], cell: float,
    tip: np.ndarray, path: np.ndarray, radius: np.ndarray, new: np.ndarray,
) -> None:  # fmt: skip
    """Fill ``first`` (L, rows, columns) and mark in ``new`` (T,) the cycles that sweep any cell.

    ``first`` is infinite where nothing was swept; ``middles`` (L,), ``corner`` (x, y) and ``cell``
    [mm]; ``tip`` (T, 3), ``path`` (T,) and ``radius`` (T,) of the tool [mm], 0 sweeps nothing.
    """
    layers = middles.size
    was = np.zeros(layers, dtype=np.bool_)  # whether the disc at ``back`` was in the layer
    back_x, back_y, back_r = 0.0, 0.0, 0.0
    top = middles[-1] if layers else -np.inf
    for k in range(1, path.size):
        if radius[k] == 0.0 or (tip[k, 2] > top and tip[k - 1, 2] > top):
            was[:] = False
            continue
        moved = path[k] - path[k - 1]
        checks = max(int(np.ceil(moved / (FRACTION * cell))), 1)
        for check in range(1, checks + 1):
            share = check / checks
            x = tip[k - 1, 0] + (tip[k, 0] - tip[k - 1, 0]) * share
            y = tip[k - 1, 1] + (tip[k, 1] - tip[k - 1, 1]) * share
            z = tip[k - 1, 2] + (tip[k, 2] - tip[k - 1, 2]) * share
            near = np.hypot(x - back_x, y - back_y) < FRACTION * cell and back_r == radius[k]
            same = True
            for layer in range(layers):
                same = same and was[layer] == (z <= middles[layer])
            if near and same:
                continue
            r = radius[k] + OVER * cell
            for layer in range(layers):
                if z > middles[layer]:
                    was[layer] = False
                    continue
                old = r if was[layer] and back_r == radius[k] else -1.0
                if _disc(
                    first[layer], x - corner[0], y - corner[1], r,
                    back_x - corner[0], back_y - corner[1], old, cell,
                    path[k - 1] + moved * share,
                ):  # fmt: skip
                    new[k] = True
                was[layer] = True
            back_x, back_y, back_r = x, y, radius[k]


@compiled_with(nogil=True)
def _disc(
    first: np.ndarray, x: float, y: float, r: float, old_x: float, old_y: float, old_r: float,
    cell: float, path: float,
) -> bool:  # fmt: skip
    """Mark cells under a disc but not under the last one (``old_r`` < 0: none); whether any."""
    rows, columns = first.shape
    new = False
    low = max(int(np.ceil((y - r) / cell - 0.5)), 0)
    high = min(int(np.floor((y + r) / cell - 0.5)), rows - 1)
    for row in range(low, high + 1):
        up = (row + 0.5) * cell
        half = np.sqrt(max(r * r - (up - y) ** 2, 0.0))
        a = max(int(np.ceil((x - half) / cell - 0.5)), 0)
        b = min(int(np.floor((x + half) / cell - 0.5)), columns - 1)
        rest = old_r * old_r - (up - old_y) ** 2
        if old_r <= 0.0 or rest <= 0.0:
            new |= _span(first, row, a, b, path)
            continue
        half = np.sqrt(rest)
        c = int(np.ceil((old_x - half) / cell - 0.5))
        d = int(np.floor((old_x + half) / cell - 0.5))
        new |= _span(first, row, a, min(b, c - 1), path)
        new |= _span(first, row, max(a, d + 1), b, path)
    return new


@compiled_with(nogil=True)
def _span(first: np.ndarray, row: int, a: int, b: int, path: float) -> bool:
    new = False
    for column in range(a, b + 1):
        if first[row, column] == np.inf:
            first[row, column] = path
            new = True
    return new


@dataclass(frozen=True, eq=False)
class Swept:
    """Part of the blank that the tool has swept, in L layers of cells."""

    blank: Box
    """Box of the blank: x, y, z from and to [mm]."""
    cell: float
    """Side of a cell [mm]."""
    heights: Floats
    """Heights between the layers, from below [mm]."""
    first: NDArray[np.float32]
    """Path length of the tip at which each cell was first swept [mm]; infinite where never."""
    corner: tuple[float, float]
    """x, y of the first cell's corner [mm]."""
    path: Floats
    """Path length of the tip in each cycle [mm]."""
    cuts: Bools
    """Cycles in which the tool cuts."""


def swept(tip: Floats, tool: Ints, steps: tuple[Step, ...], job: TrialJob) -> Swept:
    """Sweep the blank of ``job`` along the ``tip`` (T, 3) [mm] of each ``tool`` of the program."""
    widest = max(mill.diameter for mill in job.tools.values()) / 2
    x_0, x_1, y_0, y_1 = _touched(tip, job.blank, widest)
    heights = _heights(steps, job.blank)
    cell = min(mill.diameter for mill in job.tools.values()) * CELL
    area = (x_1 - x_0) * (y_1 - y_0) * (heights.size - 1)
    cell = max(cell, float(np.sqrt(area / MOST)))
    shape = (heights.size - 1, ceil((y_1 - y_0) / cell) or 1, ceil((x_1 - x_0) / cell) or 1)
    first = np.full(shape, np.inf, dtype=np.float32)
    step = np.diff(tip, axis=0, prepend=tip[:1])
    path = np.cumsum(np.sqrt((step**2).sum(axis=1)))
    radius = np.zeros(int(tool.max()) + 1)
    for number, mill in job.tools.items():
        if number < radius.size:
            radius[number] = mill.diameter / 2
    middles = (heights[1:] + heights[:-1]) / 2
    cuts = np.zeros(path.size, dtype=np.bool_)
    sweep(first, middles, (x_0, y_0), cell, tip, path, radius[tool], cuts)
    return Swept(job.blank, cell, heights, first, (x_0, y_0), path, cuts)


def _touched(tip: Floats, blank: Box, radius: float) -> tuple[float, float, float, float]:
    low = tip[tip[:, 2] < blank[5]]
    if not len(low):
        return blank[0], blank[0], blank[2], blank[2]
    reach = radius + 0.1
    (x_0, y_0), (x_1, y_1) = low[:, :2].min(axis=0) - reach, low[:, :2].max(axis=0) + reach
    x, y = np.clip([x_0, x_1], *blank[:2]).tolist(), np.clip([y_0, y_1], *blank[2:4]).tolist()
    return x[0], x[1], y[0], y[1]


def _heights(steps: tuple[Step, ...], blank: Box) -> Floats:
    """Heights between layers from below [mm]: where the program mills, finer where it ramps."""
    bottom, top = blank[4:]
    levels, ramps = [top], []
    for before, step in pairwise(steps):
        if step.kind not in ("line", "arc"):
            continue
        z_0, z_1 = sorted((before.end[2], step.end[2]))
        if bottom < step.end[2] < top:
            levels.append(step.end[2])
        elif step.end[2] <= bottom:
            levels.append(bottom)
        sideways = step.kind == "arc" or before.end[:2] != step.end[:2]
        if z_1 - z_0 > SAME and sideways:
            ramps.append((z_0, z_1))
    milled = np.unique(np.round(levels, 6))
    milled = milled[np.concatenate([[True], np.diff(milled) > SAME])]
    finer = [milled[:1]]
    for low, high in pairwise(milled):
        ramped = any(z_0 < high - SAME and z_1 > low + SAME for z_0, z_1 in ramps)
        count = ceil((high - low) / RAMP - 1e-9) if ramped else 1
        finer.append(low + (high - low) * np.arange(1, count + 1) / count)
    return np.concatenate(finer)
