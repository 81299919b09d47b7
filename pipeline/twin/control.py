"""Identified control as stored, its records, and its plan of a part program."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.program import read_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.planner import Plan, limited_path, plan
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Bands, Condition, Correlation, Model
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact, widest

WHOLE = "whole run"
"""Regime of the time of a whole run, beside those of its types of rows."""


@dataclass(frozen=True, kw_only=True)
class ControlFitFacts:
    """Goodness of fit of a control to the durations of segments."""

    rmse_s: float | None
    """Root mean square of the residuals, without outliers beyond 10 times the noise [s]."""
    segments: int
    condition: float | None
    """Condition number of the scaled Jacobian [1]."""
    correlation: Correlation
    """Correlation of the parameters that were fitted to durations."""


@dataclass(frozen=True, kw_only=True)
class ControlModelFile(Model):
    """The content of a control's ``model.json``."""

    control: Mapping[str, ControlParameters]
    """Controls by unit, where several machines of a kind are taken as one; else by ``""``."""
    fit: ControlFitFacts
    programs: Mapping[str, str]
    """Program that each training run executed."""
    intervals: Bands = field(default_factory=dict)
    """Half-widths of the 90 % interval of a time as shares of it [1], by type of row and for
    :data:`WHOLE`; empty with too few programs."""
    ends: Mapping[str, tuple[ControlParameters, ControlParameters]] = field(default_factory=dict)
    """Controls, by unit, with what the runs do not determine at its slow and at its fast end."""


@dataclass(frozen=True, kw_only=True)
class ControlRecords:
    """Recordings of runs of programs, and the programs."""

    logs: str
    """Pattern of the recordings' names below the machine's folder."""
    programs: str
    """Pattern of the part programs there."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Recordings of each machine, name -> pattern, where several of a kind are taken as one."""
    default_unit: str = ""
    """Unit whose control programs are simulated with by default."""
    simulate: tuple[str, ...] = ("*",)
    """Patterns of the programs that the report shows."""

    def __post_init__(self) -> None:
        if self.units and self.default_unit not in self.units:
            raise ValueError(
                f"control_records.default_unit is {self.default_unit!r}: "
                f"name one of its units, {', '.join(self.units)}"
            )

    def shown(self, raw: Path) -> dict[str, Path]:
        """Programs below ``raw`` that the report shows, each with the name of its results.

        That is the file's name without its ending; where several have the same, their whole path.
        """
        paths = {path.relative_to(raw).as_posix(): path for path in sorted(raw.glob(self.programs))}
        files = {
            place: path
            for place, path in paths.items()
            if any(fnmatchcase(place, pattern) for pattern in self.simulate)
        }
        often = Counter(path.stem.lower() for path in files.values())
        return {
            path.stem if often[path.stem.lower()] == 1 else place.replace("/", "_"): path
            for place, path in files.items()
        }

    def unit(self, recording: str) -> str:
        """Unit of a kind of machines that a recording is of; "" where there is one only.

        Raises ValueError when there are units and none of their patterns fits.
        """
        for name, pattern in self.units.items():
            if fnmatchcase(recording, pattern):
                return name
        if self.units:
            raise ValueError(
                f"recording {recording} fits no pattern of control_records.units "
                f"({', '.join(self.units.values())}): add its unit in conf/machine/"
            )
        return ""


def read_controls(path: Path) -> dict[str, ControlParameters]:
    """Controls in a ``model.json``, by unit ("" for a single machine).  May raise StoreError."""
    return dict(read_json(path, ControlModelFile).control)


def control_of_unit(controls: Mapping[str, ControlParameters], unit: str) -> ControlParameters:
    """The control that was identified for ``unit``.

    Raises ValueError when none was; the message names those there are.
    """
    if unit not in controls:
        known = ", ".join(repr(name) for name in sorted(controls)) or "none"
        raise ValueError(
            f"no control was identified for unit {unit!r}, there are {known}: "
            "name one of them, or let it learn from a run of that unit"
        )
    return controls[unit]


def time_interval(
    planned: Plan, intervals: Bands, learnt: Mapping[str, Condition],
    ends: Sequence[ControlParameters] = (),
) -> tuple[float, float] | None:  # fmt: skip
    """90 % interval of the predicted time of a whole run [s]; None where none was learnt.

    It is wider where feeds or spindle speeds are outside of the conditions that were ``learnt``,
    and reaches as far as the slowest and the fastest control, ``ends``.  A dwell is sure to a clock
    tick.
    """
    band = intervals.get(WHOLE)
    if band is None:
        return None
    moves, control = planned.path.moves, planned.path.control
    factor, (seconds, ticks) = widest(program_conditions(moves), learnt), dwells(moves, control)
    rest = max(planned.total - seconds, 0.0)
    open_ = [planned_program(moves, end).total - planned.total for end in ends]
    below = float(np.hypot(rest * factor * band.lower, min([0.0, *open_])))
    above = float(np.hypot(rest * factor * band.upper, max([0.0, *open_])))
    low = max(0.0, rest - below) + max(0.0, seconds - ticks)
    return round(low, 3), round(rest + above + seconds + ticks, 3)


def dwells(moves: Moves, control: ControlParameters) -> tuple[float, float]:
    """Time of the dwells that are programmed in seconds, and a tick of the control for each [s]."""
    timed = (moves.kind == Kind.DWELL) & (moves.code == 0)
    return float(moves.value[timed].sum()), int(timed.sum()) * control.interpolation_period


def program_conditions(moves: Moves) -> dict[str, Fact]:
    """Highest programmed feed and spindle speed."""
    timed = moves.feed[(moves.feed_mode == FeedMode.PER_MINUTE) & np.isin(moves.kind, CUTTING)]
    found = {}
    if len(timed):
        found["highest feed"] = Fact(value=round(float(timed.max()), 3), unit="mm/min")
    if len(moves.speed):
        speed = round(float(moves.speed.max()), 3)
        found["highest spindle speed"] = Fact(value=speed, unit="rev/min")
    return found


def program_moves(path: Path, setup: Setup, progress: Callable[[int], None] | None = None) -> Moves:
    """Moves of the part program at ``path``.

    Raises GcodeError at the first word that cannot be followed.
    """
    return interpret(read_program(path), setup, progress)


@dataclass(frozen=True, kw_only=True)
class Overrides:
    """Overrides of the operator over what is programmed [1], each one number or one a row."""

    feed: Floats | float = 1.0
    rapid: Floats | float = 1.0
    spindle: Floats | float = 1.0


AS_PROGRAMMED = Overrides()


def planned_program(
    moves: Moves, control: ControlParameters, overrides: Overrides = AS_PROGRAMMED
) -> Plan:
    """Plan of ``moves`` by ``control``.

    Raises ValueError when the planner, :func:`pipeline.machine.control.planner.plan`, refuses a
    move.
    """
    return plan(
        limited_path(moves, control),
        speeds=moves.speed * overrides.spindle,
        feed_override=np.asarray(overrides.feed) * 100,
        rapid_override=np.asarray(overrides.rapid) * 100,
    )
