"""One day of the machine in seconds: what is commanded and what happens, before the physics."""

from dataclasses import dataclass, field

import numpy as np

from pipeline.shop.parameters import DAY

EXECUTION = ("READY", "ACTIVE", "FEED_HOLD", "INTERRUPTED", "STOPPED")
READY, ACTIVE, FEED_HOLD, INTERRUPTED, STOPPED = range(5)
MODES = ("AUTOMATIC", "MANUAL", "MANUAL_DATA_INPUT")
AUTOMATIC, MANUAL, MANUAL_DATA_INPUT = range(3)
NO_PROGRAM = "O0000"


def _zeros() -> np.ndarray:
    return np.zeros(DAY)


def _integers() -> np.ndarray:
    return np.zeros(DAY, dtype=np.int32)


def _no() -> np.ndarray:
    return np.zeros(DAY, dtype=bool)


def _unset() -> np.ndarray:
    return np.full(DAY, np.nan)


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


@dataclass(kw_only=True)
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
    power: np.ndarray = field(default_factory=_no)
    execution: np.ndarray = field(default_factory=_integers)
    mode: np.ndarray = field(default_factory=_integers)
    program: np.ndarray = field(default_factory=_integers)  # index into ``program_names``
    tool: np.ndarray = field(default_factory=_integers)
    line: np.ndarray = field(default_factory=_integers)
    part_count: np.ndarray = field(default_factory=_integers)
    speed_command: np.ndarray = field(default_factory=_zeros)  # rev/min
    cut_power: np.ndarray = field(default_factory=_zeros)  # W, before its random process
    feed: np.ndarray = field(default_factory=_zeros)  # mm/s along the path
    hold: np.ndarray = field(default_factory=_no)  # spindle under position control
    coolant: np.ndarray = field(default_factory=_no)
    x: np.ndarray = field(default_factory=_unset)  # mm; nan = stays where it was
    y: np.ndarray = field(default_factory=_unset)
    z: np.ndarray = field(default_factory=_unset)
    c: np.ndarray = field(default_factory=_unset)  # deg
    feed_override: np.ndarray = field(default_factory=lambda: np.full(DAY, 100.0))
    rapid_override: np.ndarray = field(default_factory=lambda: np.full(DAY, 100.0))
    spindle_override: np.ndarray = field(default_factory=lambda: np.full(DAY, 100.0))
    emergency: np.ndarray = field(default_factory=_no)
    program_names: list[str] = field(default_factory=lambda: [NO_PROGRAM])
    cycles: list[Cycle] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)

    def select(self, second: int, program: str) -> None:
        """Put ``program`` into the controller from ``second`` on."""
        if program not in self.program_names:
            self.program_names.append(program)
        self.program[second:] = self.program_names.index(program)

    @property
    def cutting(self) -> np.ndarray:
        """Whether the tool cuts, in each second."""
        return self.cut_power > 0


def carried(values: np.ndarray, start: float) -> np.ndarray:
    """``values`` (T,) with each nan replaced by what stood before it, ``start`` at the front."""
    known = np.where(np.isnan(values), 0, np.arange(1, values.size + 1))
    return np.concatenate([[start], values])[np.maximum.accumulate(known)]
