"""State of a machine's twin: what its champion estimates beside what was measured, row by row.

``data/twin_state/<machine>/days/<day>.parquet`` has the rows of the clean state table of that day
and the same columns for every machine, those of :data:`CONTEXT` and of :data:`QUANTITIES`;
``recordings.parquet`` has a row for each cut and channel that was recorded alone; ``state.json``
is :class:`TwinState`.  Null means not known, and the manifest says why.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.store import read_json, read_table, write_json, write_table
from pipeline.schema.verdict import Role, Status

if TYPE_CHECKING:
    import pyarrow as pa

MANIFEST, RECORDINGS, DAYS = "state.json", "recordings.parquet", "days"
MODES = ("idle", "air", "cut", "warm_up", "tool_change")
"""Modes of a row, null where the machine's is not known; a machine that is off has no row."""
WORDS = ("mode", "execution", "program", "tool_number")
"""Columns of words; the last three are those of the clean state table."""
CONTEXT: Mapping[str, str] = {
    **dict.fromkeys(WORDS, ""), "spindle_steady": "", "spindle_speed": "REVOLUTION/MINUTE",
    "spindle_load": "PERCENT", "path_feedrate": "MILLIMETER/SECOND",
}  # fmt: skip
"""Unit of the columns beside the quantities.  ``spindle_steady`` is whether the spindle has held
its speed long enough for its load to count: false while it stands, runs up or is tapping."""
MEASURED, ESTIMATED, LOW, HIGH, RESIDUAL = "measured", "estimated", "low", "high", "residual"
PARTS = (MEASURED, ESTIMATED, LOW, HIGH, RESIDUAL)
"""Parts of a quantity: low and high are the ends of the 90 % interval of the estimate, the residual
is measured minus estimated."""
UNMEASURED = (ESTIMATED, LOW, HIGH)
"""Parts of a quantity that no sensor measures."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Quantity that the twin estimates over production records."""

    name: str
    unit: str
    meaning: str
    submodel: str
    """Sub-model of the champion that estimates it."""
    parts: tuple[str, ...] = PARTS


QUANTITIES = (
    Quantity(name="spindle_temperature", unit="CELSIUS", submodel="spindle",
             meaning="from speed and load alone, measured once at the day's beginning"),
    Quantity(name="spindle_temperature_windows", unit="CELSIUS", submodel="spindle",
             meaning="the same, measured anew at the beginning of each window of an hour",
             parts=(*UNMEASURED, RESIDUAL)),
    Quantity(name="no_load_power", unit="WATT", submodel="cutting",
             meaning="power at the tool of the spindle that turns without a cut"),
    Quantity(name="cutting_power", unit="WATT", submodel="cutting", parts=UNMEASURED,
             meaning="power at the tool above the no-load power"),
    Quantity(name="tangential_force", unit="NEWTON", submodel="cutting", parts=UNMEASURED,
             meaning="cutting power over the cutting speed at the tool's outer diameter"),
    *(Quantity(name=f"{axis}_following_error", unit="MILLIMETER", submodel="drive",
               meaning=f"commanded minus actual position of {axis.upper()} at constant feed")
      for axis in AXES),
)  # fmt: skip
"""Quantities of a day, in the order of their columns ``<quantity>_<part>``."""


def columns() -> dict[str, str]:
    """Columns of a day beside ``time``, each with its unit."""
    return {**CONTEXT, **{f"{q.name}_{part}": q.unit for q in QUANTITIES for part in q.parts}}


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Time of a day over which a quantity is estimated, and why it is not elsewhere."""

    known_s: float = 0.0
    unknown_s: Mapping[str, float] = field(default_factory=dict)
    """Seconds by reason."""


@dataclass(frozen=True, kw_only=True)
class StateDay:
    """A day of the state: its role, its length, the coverage of each quantity."""

    role: Role
    seconds: float
    quantities: Mapping[str, Coverage]


@dataclass(frozen=True, kw_only=True)
class TrendCheck:
    """Trend of a quantity over single recordings, held against what their conditions say."""

    quantity: str
    unit: str
    band_Hz: tuple[float, float]
    recordings: int
    tools: int
    correlation: float | None
    """Pearson's r of measured and estimated: the effect of wear and conditions from other tools,
    the level from earlier cuts of the tool; None for fewer than three tools."""
    correlation_new_tool: float | None
    """The same where the level too is from other tools."""
    least: float
    """Correlation that is asked for [1]."""
    conditions: tuple[str, ...]
    """Conditions of the regression."""
    reason: str = ""
    """Why there is none."""


@dataclass(frozen=True, kw_only=True)
class ForceCheck:
    """Tangential force from the spindle's load against the force law of the dynamometer."""

    recordings: tuple[str, ...]
    levels: int
    """Levels of constant speed and engagement."""
    mape_percent: float | None
    """Mean absolute error over the force of the dynamometer's law [%]."""
    most_percent: float
    """Error that is allowed [%]."""
    reason: str = ""
    """Why there is none."""


@dataclass(frozen=True, kw_only=True)
class TwinState:
    """The content of ``state.json``."""

    machine: str
    origin: str
    bundle: str
    """Hash of the bundle that estimates; empty where nothing serves."""
    submodels: Mapping[str, Status]
    """Status of its sub-models' verdicts."""
    period_s: float
    """Time between two rows [s]."""
    days: Mapping[str, StateDay]
    no_load_drift: float | None = None
    """Half of the 90 % interval of the no-load power beyond its identification, as a share of it:
    what it drifted by on training days; None where it is not identified."""
    intervals_unknown: Mapping[str, str] = field(default_factory=dict)
    """Why low and high of a quantity are null throughout."""
    trends: tuple[TrendCheck, ...] = ()
    force: ForceCheck | None = None


def day_path(folder: Path, day: str) -> Path:
    """Path of a day's table."""
    return folder / DAYS / f"{day}.parquet"


def write_day(time: "pa.Array", values: Mapping[str, Any], path: Path) -> None:
    """Store a day: ``values`` by :func:`columns`, (T,) each, null where one is missing."""
    import pyarrow as pa

    fields, arrays = [pa.field("time", time.type, nullable=False)], [time]
    for name, unit in columns().items():
        kind = (pa.dictionary(pa.int32(), pa.string()) if name in WORDS
                else pa.float32() if unit else pa.bool_())  # fmt: skip
        one = values.get(name)
        fields.append(pa.field(name, kind, metadata={"unit": unit}))
        if one is None:
            arrays.append(pa.nulls(len(time), kind))
        elif isinstance(one, np.ndarray):
            arrays.append(pa.array(one.astype(kind.to_pandas_dtype()), kind, from_pandas=True))
        else:
            arrays.append(one.cast(kind))
    write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def read_day(folder: Path, day: str) -> "pa.Table":
    """A day's table; StoreError where there is none, or it is of another form."""
    import pyarrow as pa

    numbers = {name: pa.float32() for name, unit in columns().items() if unit}
    return read_table(day_path(folder, day), numbers)


def write_recordings(
    words: Mapping[str, Sequence[str]], values: Mapping[str, Floats], units: Mapping[str, str],
    path: Path,
) -> None:  # fmt: skip
    """Store single recordings: columns of words, then of numbers with their units."""
    import pyarrow as pa

    fields = [pa.field(name, pa.string(), nullable=False) for name in words]
    fields += [pa.field(name, pa.float64(), metadata={"unit": units.get(name, "")})
               for name in values]  # fmt: skip
    arrays = [pa.array(list(one), pa.string()) for one in words.values()]
    arrays += [pa.array(one, pa.float64(), from_pandas=True) for one in values.values()]
    write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), path)


def write_state(state: TwinState, folder: Path) -> None:
    """Store the manifest."""
    write_json(state, folder / MANIFEST)


def read_state(folder: Path) -> TwinState:
    """The manifest in ``folder``; StoreError where there is none."""
    return read_json(folder / MANIFEST, TwinState)
