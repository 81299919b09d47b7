"""State of an interpretation: the block being executed, modal state, offsets, corners, rows so far.

Corners of two straight lines are rounded (``,R``, the radius) or broken (``,C``, the distance from
the corner to both ends of the chamfer).  Source: Fanuc 0i-F operator's manual B-64694EN, "Optional
chamfering and corner R".
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.modal import CANCELLED, DIALECTS, Offsets, State, Transform
from pipeline.gcode.moves import (
    IN_PLANE,
    INCH,
    NO_CENTRE,
    CutterRadius,
    Frame,
    Kind,
    Rows,
)
from pipeline.gcode.setup import Setup
from pipeline.gcode.statements import WordItem

AXES = {"X": 0, "Y": 1, "Z": 2, "A": 3, "B": 4, "C": 5}
"""Letter -> index into positions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Jump out of a block: M97, M98, M99, G65 or the end of the program."""

    kind: str
    """``"call"``, ``"local call"``, ``"return"`` or ``"end"``."""
    item: WordItem
    """Word of the call or return."""
    number: int | None = None
    """Number of the program to call, or of the N word to call or to return to."""
    count: int = 1
    """Number of executions."""
    arguments: Mapping[int, float] | None = None
    """Local variables of a macro; None for a plain subprogram, which shares those of its caller."""


class Block:
    """Evaluated words of a line; a word that no code uses is an error."""

    __slots__ = (
        "actions", "comments", "feed_given", "file", "flow", "items", "line", "m_codes",
        "modifiers", "ordered", "words",
    )  # fmt: skip

    def __init__(self, file: str, line: int) -> None:
        self.file, self.line = file, line
        self.words: dict[str, float] = {}
        self.items: dict[str, WordItem] = {}
        self.ordered: list[tuple[WordItem, float]] = []
        self.actions: list[tuple[int, str, int, WordItem]] = []
        self.m_codes: list[int] = []
        self.modifiers: set[int] = set()
        self.comments: tuple[str, ...] = ()
        self.feed_given = False
        self.flow: Jump | None = None

    def take(self, letter: str) -> float | None:
        """Value of a word, which then counts as carried out; None where there is none."""
        return self.words.pop(letter, None)

    def is_absolute(self, letter: str, modal: int) -> bool:
        """Whether a coordinate counts from the origin, as its word says or else the mode."""
        own = self.items[letter].absolute
        return bool(modal) if own is None else own

    def need(self, letter: str, what: str, item: WordItem | None) -> float:
        """Value of a word that ``what`` cannot do without."""
        value = self.words.pop(letter, None)
        if value is None:
            raise self.error(item, f"{what} needs {letter}: add it")
        return value

    def whole(self, letter: str, value: float, least: int, most: int) -> int:
        """A word's value as an integer between two limits."""
        number = round(value)
        if abs(number - value) > 1e-4 or not least <= number <= most:
            raise self.error(
                self.items.get(letter),
                f"{letter}{value:g} must be a whole number from {least} to {most}: correct it",
            )
        return number

    def error(self, item: WordItem | None, reason: str) -> GcodeError:
        """The error about one word of the block."""
        column, word = (item.column, item.text) if item else (1, "block")
        return GcodeError(self.file, self.line, column, word, reason)

    def any_item(self) -> WordItem | None:
        """A word to point at when none in particular is wrong."""
        return self.ordered[0][0] if self.ordered else None

    def take_axes(self, unit: float) -> dict[int, float]:
        """Axis words taken, by axis [mm, deg]; ``unit`` is the program's of length [mm]."""
        return {
            axis: self.words.pop(letter) * (unit if axis < 3 else 1.0)
            for letter, axis in AXES.items()
            if letter in self.words
        }


@dataclass(slots=True)
class Cycle:
    """Words of a canned cycle, which stay in force until it is cancelled [mm, s]."""

    code: int = CANCELLED
    """Ten times the G code; ``CANCELLED`` when none is in force."""
    initial: float = 0.0
    """Coordinate along the plane's normal before the first block of the cycle."""
    words: dict[str, float] = field(default_factory=dict)
    """R, Z, Q, P … as last given, R and Z in program coordinates."""


@dataclass(slots=True)
class Register:
    """Register of the tool table while the program runs [mm], offsets ``across`` Z [mm, deg]."""

    length: float = 0.0
    length_wear: float = 0.0
    radius: float = 0.0
    radius_wear: float = 0.0
    across: dict[int, float] = field(default_factory=dict)


@dataclass(slots=True, kw_only=True)
class Snapshot:
    """Modal state that M70 or M73 of LinuxCNC saved."""

    values: dict[str, float]
    """Fields of the state."""
    length: list[float]
    """Tool offset by axis."""
    active: str
    """Work coordinate system."""
    retract_to_r: bool
    automatic: bool
    """M73: restored when the subroutine ends."""
    g52: list[float] | None = None
    """Shift by TRANS that SAVE of a Sinumerik restores, which leaves F, S and tools as they are."""

    @classmethod
    def of(cls, run: "Run", *, automatic: bool) -> "Snapshot":
        """Snapshot of the state in force."""
        siemens = run.dialect == "siemens"
        return cls(
            values={name: getattr(run.state, name) for name in (MODES if siemens else SAVED)},
            g52=list(run.offsets.g52) if siemens else None, length=list(run.offsets.length),
            active=run.offsets.active, retract_to_r=run.retract_to_r, automatic=automatic,
        )  # fmt: skip

    def restore(self, run: "Run") -> None:
        """Put the state in force again."""
        for name, value in self.values.items():
            setattr(run.state, name, value)
        run.offsets.active, run.retract_to_r = self.active, self.retract_to_r
        if self.g52 is None:
            run.offsets.length = list(self.length)
        else:
            run.offsets.g52 = list(self.g52)
        run.remap()


@dataclass(frozen=True, slots=True, kw_only=True)
class Contour:
    """Contour that G41 or G42 opened."""

    side: int
    """1 for left, -1 for right."""
    radius: float
    """Radius of the tool [mm]."""
    plane: int
    """Plane: 17, 18 or 19."""
    first: int
    """Row that the contour begins with."""
    start: tuple[float, ...]
    """Position of the machine before the contour [mm, deg]."""
    word: str
    """Word that opened it, for errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """A corner whose next line is still to come."""

    rounded: bool
    """An arc, else a chamfer."""
    size: float
    """Radius, or length of each side that a chamfer takes off [mm]."""
    row: int
    """Row that ends in the corner."""
    block: Block
    """Block of that row, for errors."""
    item: WordItem
    """Word that requires it."""


SAVED = (
    "unit", "plane", "absolute", "arc_absolute", "feed_mode", "path_mode", "tolerance", "feed",
    "speed", "direction", "constant_surface_speed", "wcs",
)  # fmt: skip
"""Fields of the state that M70 saves."""
MODES = ("motion", "unit", "plane", "absolute", "feed_mode", "path_mode", "tolerance", "wcs")
"""Fields of the state that SAVE of a Sinumerik restores."""


class Run:
    """State of one interpretation, on which all codes act."""

    def __init__(self, setup: Setup, capacity: int) -> None:
        self.setup = setup
        self.dialect = setup.dialect
        self.offsets = Offsets(work={name: list(v) for name, v in setup.work_offsets.items()})
        self.rows = Rows(capacity)
        self.state = State(
            position=list(setup.initial_position),
            unit=INCH if setup.inch else 1.0,
            dialect=DIALECTS.index(setup.dialect),
            motion=CANCELLED if setup.dialect == "linuxcnc" else 0,
        )
        self.registers = {
            number: Register(length=tool.length, radius=tool.diameter / 2)
            for number, tool in setup.tools.items()
        }
        self.frames: dict[Frame, int] = {}
        self.files: list[str] = []
        self.transform: Transform = self.offsets.transform()
        self.references = dict(setup.references)
        self.cycle = Cycle()
        self.contour: Contour | None = None
        self.cutter_radii: list[CutterRadius] = []
        self.compensated_position: list[float] | None = None
        self.polar_angle: float | None = None
        self.modal_call: Jump | None = None
        self.saved: list[Snapshot | None] = [None]
        self.group_1 = 0
        self.retract_to_r = setup.dialect == "linuxcnc"
        self.length_mode = 490
        self.length_number = self.radius_number = 0
        self.pending_length = 0.0
        self.rigid = self.diameter = self.probed = self.waited = False
        self.straight_next = False
        self.corner: Corner | None = None
        self.feed_unit = self.state.unit
        self.notes: dict[str, list[int]] = {}
        self.remap()

    def remap(self) -> None:
        """Update the transformation after a change of ``offsets``."""
        self.transform = self.offsets.transform()
        frame = self.offsets.frame(self.transform)
        self.state.frame = self.frames.setdefault(frame, len(self.frames))
        self.state.translation = self.transform.translation
        self.state.transformed = int(
            self.transform.matrix is not None
            or self.offsets.polar
            or self.diameter
            or self.modal_call is not None
        )

    @property
    def point(self) -> list[float]:
        """Position in program coordinates [mm, deg]."""
        return self.transform.program(self.state.position)

    def note(self, line: int, what: str) -> None:
        """Keep a notice to the user about a line."""
        lines = self.notes.setdefault(what, [])
        if line not in lines[-1:]:
            lines.append(line)

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices so far, each with its lines."""
        return tuple(
            f"{what} (line {', '.join(map(str, lines[:5]))}{' …' * (len(lines) > 5)})"
            for what, lines in self.notes.items()
        )

    def register(self, number: int) -> Register:
        """Entry of the tool table, made when it is not there."""
        return self.registers.setdefault(number, Register())

    def listed_tool(self, number: int, block: Block, item: WordItem) -> Register:
        """Entry of LinuxCNC's tool table, where tool 0 is none; GcodeError if not in the table."""
        if number <= 0:
            return Register()
        if number not in self.registers:
            raise block.error(
                item,
                f"tool {number} is not in the tool table: add it to setup.tools of the machine's "
                "file",
            )
        return self.registers[number]

    def line_to(self, kind: Kind, line: int, end: list[float], *, code: int = 0) -> None:
        """A straight row to a machine position; ``code`` of the canned cycle it belongs to."""
        self.state.position = end
        self.compensated_position = None
        self._append(kind, line, code=code)

    def arc_to(self, line: int, end: list[float], centre: tuple[float, ...], angle: float) -> None:
        """An arc to a machine position."""
        self.state.position = end
        self.compensated_position = None
        self._append(Kind.ARC, line, centre, angle)

    def add_row(self, kind: Kind, line: int, *, code: int = 0, value: float = 0.0) -> None:
        """A row that does not move."""
        programmed = self.state.position
        if self.compensated_position is not None:
            self.state.position = self.compensated_position
        self._append(kind, line, code=code, value=value)
        self.state.position = programmed

    def _append(
        self, kind: int, line: int, centre: tuple[float, ...] = NO_CENTRE, angle: float = 0.0,
        *, code: int = 0, value: float = 0.0,
    ) -> None:  # fmt: skip
        """One row more, which ends at the state's position."""
        state = self.state
        self.rows.append((
            kind, line, state.file, state.position, centre, angle, state.plane, state.feed,
            state.feed_mode, state.speed if state.direction else 0.0, state.direction,
            state.constant_surface_speed, state.tool, state.frame, state.path_mode,
            state.tolerance, code, value,
        ))  # fmt: skip


LEAST_TURN = 1e-9
"""Angle between directions that are one line [rad]."""
SAME = 1e-9
"""Lengths that are equal [mm] or [deg]."""


def begin_corner(run: Run, block: Block) -> None:
    """Remember the corner in which a block's last row ends, where it has ``,R`` or ``,C``."""
    letter = next((word for word in (",R", ",C") if word in block.words), None)
    if letter is None:
        return
    item, value = block.items[letter], block.words.pop(letter)
    if not value > 0:
        raise block.error(item, f"{letter} is {value:g}: give more than 0")
    matrix = run.transform.matrix
    if matrix is not None and abs(abs(np.linalg.det(np.array(matrix))) - 1) > SAME:
        raise block.error(item, "a corner under G51 is not followed: write its arc or its line")
    run.corner = Corner(
        rounded=letter == ",R", size=value * run.state.unit, row=run.rows.count - 1, block=block,
        item=item,
    )  # fmt: skip


def finish_corner(run: Run, corner: Corner) -> None:
    """Put in the arc or the line of a corner, before the straight line that is the last row.

    Raises GcodeError where the lines are not straight, not in the plane, one, or too short.
    """
    run.corner, last = None, run.rows.count - 1
    if last != corner.row + 1 or run.rows.arrays["kind"][last] not in (Kind.RAPID, Kind.FEED):
        raise _error(corner, "the next block has to be a straight line")
    after = tuple(array[last].copy() for array in run.rows.arrays.values())
    end, run.rows.count = run.state.position, last
    _insert(run, corner, end)
    run.rows.append(after)
    run.state.position = end


def _insert(run: Run, corner: Corner, end: list[float]) -> None:
    """The row of the corner, behind the line that is shortened for it."""
    ends = run.rows.arrays["end"]
    begin = ends[corner.row - 1] if corner.row else np.array(run.setup.initial_position)
    at, to = ends[corner.row].copy(), np.array(end)
    first, second, normal = IN_PLANE[run.state.plane]
    others = [normal, 3, 4, 5]
    if np.abs([(at - begin)[others], (to - at)[others]]).max() > SAME:
        raise _error(corner, "both lines have to lie in the plane of G17, G18 or G19")
    plane = [first, second]
    back, on = (begin - at)[plane], (to - at)[plane]
    lengths = math.hypot(*back), math.hypot(*on)
    cross = back[0] * on[1] - back[1] * on[0]
    angle = math.atan2(abs(cross), float(back @ on))  # between the lines, pi where they are one
    if min(lengths) < SAME or math.sin(angle) < LEAST_TURN:
        raise _error(corner, "it needs two lines that meet at an angle")
    taken = corner.size / math.tan(angle / 2) if corner.rounded else corner.size
    if taken > min(lengths) + SAME:
        raise _error(
            corner,
            f"it takes {taken:.4g} mm of lines of {lengths[0]:.4g} and {lengths[1]:.4g} mm: make "
            "it smaller",
        )
    u, v = back / lengths[0], on / lengths[1]
    leave, join = at.copy(), at.copy()
    leave[plane] += taken * u
    join[plane] += taken * v
    run.rows.arrays["end"][corner.row] = leave
    if corner.rounded:
        centre = at[:3].copy()
        towards = (u + v) / math.hypot(*(u + v))
        centre[plane] += corner.size / math.sin(angle / 2) * towards
        turned = math.copysign(math.pi - angle, -cross)
        x, y, z = centre.tolist()
        run.arc_to(corner.block.line, join.tolist(), (x, y, z), turned)
    else:
        run.line_to(Kind.FEED, corner.block.line, join.tolist())
    feed = run.rows.arrays["feed"]  # that of the corner's block, whatever F the next one has
    feed[run.rows.count - 1] = feed[corner.row]


def _error(corner: Corner, reason: str) -> Exception:
    return corner.block.error(corner.item, f"the corner cannot be made: {reason}")
