"""A program's text as the steps that the shop's control runs.

The text is read by the project's interpreter, which knows nothing of the machine; what the machine
does with it is the shop's own.
"""

from typing import Any

import numpy as np

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.gcode.setup import Tool as Register
from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.post import Kind as StepKind
from pipeline.shop.post import PartProgram, Point, Step
from pipeline.shop.s_curve import Floats
from pipeline.shop.trial_job import TrialJob

HOME = (-400.0, 0.0, 0.0)
"""Where the machine stands before the program [mm]."""
SHORTEST = 1e-6
"""Ways that are shorter are none [mm]."""
CODES = {7: 8, 8: 8, 9: 9}
"""M codes that take time, and the one whose time it is; others are answered at once."""
MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC)


def program_steps(
    text: bytes | str, name: str, job: TrialJob, control: ControlParameters
) -> PartProgram:
    """The steps of a program, its coordinates being those of its one work offset.

    Raises
    ------
    GcodeError
        At the first word that cannot be followed.
    ValueError
        At the first move that this mill does not have: another axis, another plane, a thread.
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
    """In the spindle before the program: the job's tool where it has but one, else none."""
    return next(iter(job.tools)) if len(job.tools) == 1 else 0


def _refuse(moves: Moves, name: str) -> None:
    arc = moves.kind == Kind.ARC
    turned = np.any(moves.end[:, 3:] != moves.start[:, 3:], axis=1)
    for found, what in (
        (np.isin(moves.kind, (Kind.PROBE, Kind.THREAD)), "probes or cuts a thread"),
        (arc & (moves.plane != 17), "is an arc outside the plane XY"),
        (turned, "moves a rotary axis"),
        (moves.direction < 0, "turns the spindle to the left"),
        (moves.constant_surface_speed, "asks for a constant surface speed"),
    ):
        if found.any():
            line = moves.line[int(np.argmax(found))]
            raise ValueError(f"{name}:{line} {what}: a trial cut mills with X, Y, Z and M3 only")


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
        """Add what a row does."""
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
        way = float(self.length[row]) if kind == Kind.ARC else straight
        if way < SHORTEST:
            return
        tip = self._tip(target)
        if kind == Kind.RAPID:
            self._add("rapid", line, end=tip)
        elif kind == Kind.FEED:
            self._add("line", line, end=tip, feed=self._feed(row, way))
        else:
            centre = moves.centre[row, :2] - self.offset[:2]
            self._add(
                "arc", line, end=tip, centre=(float(centre[0]), float(centre[1])),
                turn=float(moves.angle[row]), feed=self._feed(row, way),
            )  # fmt: skip
        self.place = target

    def _feed(self, row: int, way: float) -> float:
        """[mm/min]."""
        mode, feed = self.moves.feed_mode[row], float(self.moves.feed[row])
        if mode == FeedMode.PER_REVOLUTION:
            feed *= self.speed
        elif mode == FeedMode.INVERSE_TIME:
            feed *= way
        if not feed > 0:
            raise ValueError(
                f"{self.name}:{self.moves.line[row]} cuts without a feed: program F, and S for a "
                "feed by the turn"
            )
        return feed

    def _add(self, kind: StepKind, line: int, end: Point | None = None, **what: Any) -> None:
        tip = self._tip(self.place) if end is None else end
        self.done.append(Step(kind=kind, line=line, end=tip, **what))

    def _tip(self, place: Floats) -> Point:
        """The tool's tip in the coordinates of the work offset [mm]."""
        x, y, z = (float(p - o) for p, o in zip(place, self.offset, strict=True))
        return x, y, z - self.job.length(self.tool)
