"""As-built record of a part: how one cycle of a program went, beside what the twin says of it."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Values of a quantity over a cycle; None for what no record has."""

    unit: str
    first: float
    last: float
    least: float
    greatest: float
    mean: float
    known_s: float
    """Time over which it is known [s]."""


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """What the twin estimates of a quantity where it is known; means over that time."""

    unit: str
    known_s: float
    """Time over which it is estimated [s]."""
    estimated: float
    low: float | None
    high: float | None
    """Ends of the 90 % interval of the estimate; None where it has none."""
    greatest: float
    measured: float | None
    """Mean of what was measured at the same times; None where it is not measured."""
    outside: float | None
    """Share of the time in which the measured value is outside the interval [1]."""


@dataclass(frozen=True, kw_only=True)
class ToolUse:
    """Use of a tool in a cycle."""

    tool: str
    in_spindle_s: float
    cutting_s: float | None
    """Time in which it cuts [s]; None where the mode of the machine is not known."""
    cut_before_s: float
    """Time for which a tool of that number had cut in the cycles before, since the records begin
    [s]."""


@dataclass(frozen=True, kw_only=True)
class BlockTime:
    """Time between the first and the last row with a line of the program, all visits added."""

    line: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class ProgramFile:
    """A part program of the name that the log states, among the machine's raw files."""

    file: str
    sha256: str
    predicted_s: float | None
    predicted_90_s: tuple[float, float] | None
    """Cycle time by the identified control, and its 90 % interval [s]."""


@dataclass(frozen=True, kw_only=True)
class PartAlarm:
    """Alarm of the control that stood in a cycle."""

    level: str
    code: str
    message: str
    start: str
    seconds: float | None
    """How long it stood in the cycle [s]; None where its end is not known."""
    line: int | None


@dataclass(frozen=True, kw_only=True)
class PartRecord:
    """One complete cycle of a program, which makes one part, or the parts of one set-up."""

    machine: str
    origin: str
    """Whether the records are simulated or recorded."""
    cycle: int
    program: str
    """Name that the log states; empty without one."""
    part: str
    """Part count that the log states; empty without one."""
    start: str
    end: str
    """Times with the zone of the plant."""
    active_s: float
    feed_hold_s: float
    interrupted_s: float
    idle_s: float
    """Time in each execution state [s]."""
    usual_s: float | None
    """Median ACTIVE time of the other complete cycles of the program [s]."""
    usual_cycles: int
    programs: tuple[ProgramFile, ...]
    blocks: tuple[BlockTime, ...]
    tools: tuple[ToolUse, ...]
    measured: Mapping[str, Measured]
    """Temperatures, loads and speeds by column of the state table; the load of the spindle where it
    holds its speed or stands."""
    twin: Mapping[str, Estimated]
    alarms: tuple[PartAlarm, ...]
    bundle: str
    """Hash of the bundle that estimates; empty where nothing serves."""
    version: int | None
    """Version of that bundle; None where it is not the champion's of the history."""
    submodels: Mapping[str, str]
    """Its sub-models with the statuses of their verdicts."""
    sources: Mapping[str, str]
    """Files that the record was made of, with the sha256 of each."""
    not_known: Mapping[str, str]
    """What the record lacks, with the reason."""
