"""Timeline of one day in seconds, and the operations of the part programs that fill it.

Speeds, feeds and powers of operations are those of catalogue cutting data (Sandvik, Walter) for
aluminium and quenched steel on a 15 kW spindle; 1/15 of the rated power is 1 kW.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from functools import partial
from typing import Literal

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import DAY

NO_PROGRAM = "O0000"
Motion = Literal["mill", "drill", "finish", "contour", "run"]


class Execution(IntEnum):
    """State of the execution of a program."""

    READY = 0
    ACTIVE = 1
    FEED_HOLD = 2
    INTERRUPTED = 3
    STOPPED = 4


class Mode(IntEnum):
    """Mode of the controller."""

    AUTOMATIC = 0
    MANUAL = 1
    MANUAL_DATA_INPUT = 2


_NO = partial(np.full, DAY, False)
_ZERO_INT = partial(np.full, DAY, 0)
_ZERO = partial(np.full, DAY, 0.0)
_NAN = partial(np.full, DAY, np.nan)
_HUNDRED = partial(np.full, DAY, 100.0)


@dataclass(kw_only=True)
class Cycle:
    """One run of a part program; ``start`` and ``end`` are seconds since the first midnight."""

    number: int
    program: str
    kind: str  # part, warm_up
    part: int  # in the batch, from 1; 0 for none
    start: int
    end: int = 0
    complete: bool = False
    tool_changes: int = 0
    feed_hold_s: int = 0
    interrupted_s: int = 0


@dataclass
class Alarm:
    """A condition between two seconds of the day."""

    name: str
    level: str
    code: str
    qualifier: str
    text: str
    start: int
    end: int


@dataclass(kw_only=True)
class Timeline:
    """Columns of shape (86400,): the state in each second of one day."""

    day: int
    on: int = DAY  # second at which the control is switched on; DAY when it never is
    off: int = DAY
    power: Bools = field(default_factory=_NO)
    execution: Ints = field(default_factory=_ZERO_INT)  # Execution
    mode: Ints = field(default_factory=_ZERO_INT)  # Mode
    program: Ints = field(default_factory=_ZERO_INT)  # index into ``program_names``
    tool: Ints = field(default_factory=_ZERO_INT)
    line: Ints = field(default_factory=_ZERO_INT)
    part_count: Ints = field(default_factory=_ZERO_INT)
    speed_command: Floats = field(default_factory=_ZERO)  # rev/min
    cut_power: Floats = field(default_factory=_ZERO)  # W, before its random process
    feed: Floats = field(default_factory=_ZERO)  # mm/s along the path
    hold: Bools = field(default_factory=_NO)  # spindle under position control
    coolant: Bools = field(default_factory=_NO)
    x: Floats = field(default_factory=_NAN)  # mm; nan = stays where it was
    y: Floats = field(default_factory=_NAN)
    z: Floats = field(default_factory=_NAN)
    c: Floats = field(default_factory=_NAN)  # deg
    feed_override: Floats = field(default_factory=_HUNDRED)
    rapid_override: Floats = field(default_factory=_HUNDRED)
    spindle_override: Floats = field(default_factory=_HUNDRED)
    emergency: Bools = field(default_factory=_NO)
    program_names: list[str] = field(default_factory=lambda: [NO_PROGRAM])
    cycles: list[Cycle] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)

    def select(self, second: int, program: str) -> None:
        """Select ``program`` at the control from ``second`` on."""
        if program not in self.program_names:
            self.program_names.append(program)
        self.program[second:] = self.program_names.index(program)

    @property
    def cutting(self) -> Bools:
        """Whether the tool cuts, in each second."""
        return self.cut_power > 0


def carried(values: Floats, start: float) -> Floats:
    """``values`` (T,) with each nan replaced by the value before it, ``start`` at the front."""
    last = np.where(np.isnan(values), 0, np.arange(1, values.size + 1))
    return np.concatenate([[start], values])[np.maximum.accumulate(last)]


@dataclass(frozen=True)
class Operation:
    """Work of one tool: ``power`` as a share of the rated power, ``feed`` in mm/s.

    In the ``motion`` ``contour`` the spindle is a C axis; ``run`` turns the spindle only (warm-up).
    """

    tool: int
    motion: Motion
    speed: float
    duration: int
    power: float = 0.0
    feed: float = 0.0
    length: float = field(default=150.0, kw_only=True)
    coolant: bool = field(default=True, kw_only=True)


@dataclass(frozen=True, kw_only=True)
class Program:
    """``held`` leaves the spindle in position control after the end, as programs often do."""

    name: str
    operations: tuple[Operation, ...]
    held: bool = False


WARM_UP = Program(
    name="O9001",
    operations=tuple(
        Operation(0, "run", s, d, coolant=False)
        for s, d in ((1500.0, 180), (3000.0, 180), (6000.0, 240), (9000.0, 240), (12000.0, 180))
    ),
)

PROGRAMS: dict[str, Program] = {
    p.name: p
    for p in (
        Program(  # aluminium housing
            name="O1101",
            operations=(
                Operation(1, "mill", 6000, 110, 0.42, 50.0, length=320),
                Operation(3, "mill", 12000, 240, 0.30, 66.0, length=240),
                Operation(5, "drill", 8000, 120, 0.18, 20.0, length=38),
                Operation(8, "drill", 900, 80, 0.06, 15.0, length=22),
                Operation(11, "finish", 12000, 300, 0.05, 40.0, length=210),
            ),
        ),
        Program(  # steel bracket
            name="O2040",
            operations=(
                Operation(2, "mill", 1250, 260, 0.40, 8.0, length=180),
                Operation(4, "mill", 2400, 520, 0.40, 14.0, length=220),
                Operation(6, "drill", 3100, 180, 0.17, 6.0, length=45),
                Operation(7, "mill", 4200, 200, 0.22, 16.0, length=120),
                Operation(9, "finish", 7500, 320, 0.06, 20.0, length=160),
            ),
        ),
        Program(  # mould insert, finished with a ball nose
            name="O3307",
            operations=(
                Operation(4, "mill", 3000, 420, 0.33, 18.0, length=160),
                Operation(12, "finish", 9000, 780, 0.08, 45.0, length=90),
                Operation(14, "finish", 11500, 1500, 0.04, 55.0, length=70),
            ),
        ),
        Program(  # shaft: turned and engraved with the spindle as C axis
            name="O4410",
            operations=(
                Operation(21, "contour", 0, 380, 0.0, 4.0, length=90),
                Operation(6, "drill", 4000, 140, 0.15, 9.0, length=30),
                Operation(22, "contour", 0, 460, 0.0, 2.5, length=60),
                Operation(7, "mill", 5200, 160, 0.18, 20.0, length=80),
            ),
            held=True,
        ),
    )
}


def programs(names: tuple[str, ...], c_axis: bool) -> list[Program]:
    """The programs called ``names``; those that need a C axis only if there is one.

    Raises ValueError when a name is unknown or nothing is left; the message lists the names that
    exist.
    """
    unknown = [n for n in names if n not in PROGRAMS]
    if unknown:
        raise ValueError(f"part program {unknown[0]!r} is unknown; there are {sorted(PROGRAMS)}")
    chosen = [PROGRAMS[n] for n in names]
    if not c_axis:
        chosen = [p for p in chosen if all(o.motion != "contour" for o in p.operations)]
    if not chosen:
        raise ValueError(f"none of the programs {list(names)} can run without a C axis")
    return chosen
