"""State of a machine's twin: what its champion estimates beside what was measured, row by row.

``data/twin_state/<machine>/days/<day>.parquet`` has the rows of the clean state table of that day
and the same columns for every machine: ``time``, :data:`CONTEXT`, :func:`columns`;
``recordings.parquet`` has the vibration of cuts that were recorded alone, as predictions by tool;
``state.json`` is :class:`TwinState`.  Null means not known; ``state.json`` says why for a day.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.schema.store import read_table, write_table
from pipeline.schema.verdict import Role, Status

if TYPE_CHECKING:
    import pyarrow as pa

MANIFEST, RECORDINGS, DAYS = "state.json", "recordings.parquet", "days"
MODES = ("idle", "air", "cut", "warm_up", "tool_change")
"""Modes of a row, null where the machine's is not known; a machine that is off has no row."""
WORDS = ("mode", "execution", "program", "tool_number")
CONTEXT: Mapping[str, str] = {
    **dict.fromkeys(WORDS, ""), "spindle_steady": "", "spindle_speed": "REVOLUTION/MINUTE",
    "spindle_load": "PERCENT", "path_feedrate": "MILLIMETER/SECOND",
}  # fmt: skip
"""Columns beside the quantities, with their units.  ``spindle_steady`` is whether the spindle has
held its speed long enough for its load to count: false while it stands, runs up or is tapping."""
PARTS = ("measured", "estimated", "low", "high", "residual")
"""Parts of a quantity: low and high are the ends of the 90 % interval of the estimate, the residual
is measured minus estimated."""
AXES = ("x", "y", "z")
_WATT, _UNMEASURED = "WATT", PARTS[1:4]
QUANTITIES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "spindle_temperature": ("CELSIUS", PARTS),
    "no_load_power": (_WATT, PARTS), "cutting_power": (_WATT, _UNMEASURED),
    "tangential_force": ("NEWTON", _UNMEASURED),
    **{f"{axis}_following_error": ("MILLIMETER", PARTS) for axis in AXES},
}  # fmt: skip
"""Unit and parts of each quantity.  The temperature is estimated from speed and load after one
measurement a day; powers are those at the tool."""


@dataclass(frozen=True, kw_only=True)
class StateDay:
    """A day of the state."""

    role: Role
    seconds: float
    known_s: Mapping[str, float]
    """Time over which each quantity is estimated [s]."""
    unknown: Mapping[str, str]
    """Why a quantity is estimated nowhere on this day."""


@dataclass(frozen=True, kw_only=True)
class TrendCheck:
    """Vibration of single recordings, held against what conditions and wear say."""

    quantity: str
    recordings: int = 0
    tools: int = 0
    correlation: float | None = None
    """Pearson's r of measured and estimated: the effect of wear and conditions from other tools,
    the level from earlier cuts of the tool; None for fewer than three tools."""
    correlation_new_tool: float | None = None
    """The same where the level too is from other tools."""
    least: float
    """Correlation that is asked for [1]."""
    reason: str = ""
    """Why there is none."""


@dataclass(frozen=True, kw_only=True)
class ForceCheck:
    """Force from the spindle's load against the force law of the dynamometer."""

    recordings: tuple[str, ...]
    levels: int
    """Levels of constant speed and engagement."""
    mape_percent: float | None
    most_percent: float
    """Mean absolute error over the law's force, and what is allowed [%]."""


@dataclass(frozen=True, kw_only=True)
class TwinState:
    """The content of ``state.json``."""

    bundle: str
    """Hash of the bundle that estimates; empty where nothing serves."""
    submodels: Mapping[str, Status]
    """Status of its sub-models' verdicts."""
    period_s: float
    """Time between two rows [s]."""
    days: Mapping[str, StateDay]
    idle: tuple[str, ...] = ()
    """Sub-models that do not serve: nothing is estimated by them."""
    temperature_interval_unknown: str = ""
    """Why low and high of the spindle temperature are null throughout; empty where they are not."""
    trends: tuple[TrendCheck, ...] = ()
    force: ForceCheck | None = None


def columns() -> dict[str, str]:
    """Columns of a day beside ``time``, each with its unit."""
    return {**CONTEXT, **{f"{name}_{part}": unit for name, (unit, parts) in QUANTITIES.items()
                          for part in parts}}  # fmt: skip


def day_path(folder: Path, day: str) -> Path:
    """Path of a day's table."""
    return folder / DAYS / f"{day}.parquet"


def write_day(time: Any, values: Mapping[str, Any], path: Path) -> None:
    """Store a day: ``values`` by :func:`columns`, (T,) each, null where one is missing.

    ``time`` (T,) is an index of times with the zone of the plant.
    """
    import pyarrow as pa

    arrays, fields = [pa.array(time.as_unit("ns"))], []
    for name, unit in columns().items():
        kind = pa.float32() if unit else pa.string() if name in WORDS else pa.bool_()
        one = values.get(name)
        array = (pa.nulls(len(time), kind) if one is None
                 else pa.array(one, from_pandas=True).cast(kind))  # fmt: skip
        arrays.append(array.dictionary_encode() if name in WORDS else array)
        fields.append(pa.field(name, arrays[-1].type, metadata={"unit": unit}))
    fields = [pa.field("time", arrays[0].type, nullable=False), *fields]
    write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def read_day(folder: Path, day: str) -> "pa.Table":
    """A day's table; StoreError where there is none, or it is of another form."""
    import pyarrow as pa

    numbers = {name: pa.float32() for name, unit in columns().items() if unit}
    return read_table(day_path(folder, day), numbers)
