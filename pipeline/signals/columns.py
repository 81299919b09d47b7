"""Table of signals: name, unit, meaning, physical range, factor to SI.

Names and units are those of MTConnect (ANSI/MTC1.4) wherever it has them; physics speaks SI and
multiplies by :attr:`Column.factor` (and adds :attr:`Column.offset`) at its door.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa

from pipeline.schema.si import DEGREE, MM, RPM, ZERO_CELSIUS

Between = Literal["hold", "linear"]


@dataclass(frozen=True, kw_only=True)
class Column:
    """One signal of the clean tables."""

    name: str
    """Canonical name, snake case."""
    unit: str
    """MTConnect unit on disk, ``""`` for states, counts and names."""
    meaning: str
    """Meaning of the signal, for people."""
    low: float = -np.inf
    high: float = np.inf
    """Values outside are not physical for any machine tool; they are glitches."""
    factor: float = 1.0
    offset: float = 0.0
    """Offset to SI: ``SI = value * factor + offset``."""
    between: Between = "hold"
    """Value between two observations when it is resampled."""
    text: bool = False
    """Whether the signal is a word (a state, a program's name) instead of a number."""


_STATES = (
    ("availability", "whether the machine answers"),
    ("execution", "what the controller is doing: ACTIVE, READY, FEED_HOLD, INTERRUPTED, STOPPED"),
    ("controller_mode", "AUTOMATIC, MANUAL, MANUAL_DATA_INPUT, SEMI_AUTOMATIC, EDIT"),
    ("emergency_stop", "ARMED or TRIGGERED"),
    ("power_state", "ON or OFF"),
    ("program", "name of the program in the controller"),
    ("tool_number", "tool in the spindle"),
    ("spindle_rotary_mode", "SPINDLE under speed control, INDEX or CONTOUR under position control"),
)


def _axes() -> list[Column]:
    columns = []
    for axis in "xyzabc":
        up, linear = axis.upper(), axis in "xyz"
        columns += [
            Column(name=f"{axis}_position", unit="MILLIMETER", meaning=f"actual position of {up}",
                   low=-1e5, high=1e5, factor=MM, between="linear"),
            Column(name=f"{axis}_commanded_position", unit="MILLIMETER",
                   meaning=f"commanded position of {up}", low=-1e5, high=1e5, factor=MM,
                   between="linear"),
            Column(name=f"{axis}_feedrate", unit="MILLIMETER/SECOND",
                   meaning=f"feed rate of axis {up}", low=-5e3, high=5e3, factor=MM),
        ] if linear else [
            Column(name=f"{axis}_angle", unit="DEGREE", meaning=f"actual angle of {up}",
                   low=-1e6, high=1e6, factor=DEGREE),
            Column(name=f"{axis}_angular_velocity", unit="DEGREE/SECOND",
                   meaning=f"angular velocity of {up}", low=-1e5, high=1e5, factor=DEGREE),
        ]  # fmt: skip
        columns.append(Column(name=f"{axis}_load", unit="PERCENT", low=-500, high=500, factor=1e-2,
                              meaning=f"load of axis {up} drive"))  # fmt: skip
    return columns


def _spindles() -> list[Column]:
    columns = []
    for prefix, which in (("", "the modelled spindle"), ("second_", "the other spindle")):
        columns += [
            Column(name=f"{prefix}spindle_speed", unit="REVOLUTION/MINUTE",
                   meaning=f"speed of {which}", low=-2e5, high=2e5, factor=RPM),
            Column(name=f"{prefix}spindle_load", unit="PERCENT",
                   meaning=f"load of {which} against its rating", low=-500, high=500, factor=1e-2),
            Column(name=f"{prefix}spindle_temperature", unit="CELSIUS",
                   meaning=f"temperature of {which}", low=-30, high=200, offset=ZERO_CELSIUS,
                   between="linear"),
        ]  # fmt: skip
    return columns


def _others() -> list[Column]:
    return [
        Column(name="spindle_position_control", unit="",
               meaning="1 while the spindle is held by its position loop (a C axis), 0 otherwise",
               low=0, high=1),
        Column(name="ambient_temperature", unit="CELSIUS", meaning="air around the machine",
               low=-40, high=70, offset=ZERO_CELSIUS, between="linear"),
        Column(name="coolant_temperature", unit="CELSIUS",
               meaning="coolant that reaches the spindle, in its tank or at its inlet",
               low=-20, high=90, offset=ZERO_CELSIUS, between="linear"),
        Column(name="path_feedrate", unit="MILLIMETER/SECOND", meaning="actual feed along the path",
               low=-5e3, high=5e3, factor=MM),
        *(Column(name=f"{what}_override", unit="PERCENT", low=0, high=500, factor=1e-2,
                 meaning=f"{what}{' speed' * (what == 'spindle')} override")
          for what in ("feed", "rapid", "spindle")),
        Column(name="line", unit="", meaning="line or block of the program", low=0),
        Column(name="part_count", unit="", meaning="parts made, as the controller counts", low=0),
        Column(name="total_time", unit="SECOND", meaning="time the machine was on", low=0),
        Column(name="auto_time", unit="SECOND", meaning="time in automatic operation", low=0),
        Column(name="cut_time", unit="SECOND", meaning="time cutting", low=0),
    ]  # fmt: skip


_STATE_COLUMNS = [Column(name=n, unit="", meaning=m, text=True) for n, m in _STATES]
COLUMNS: dict[str, Column] = {
    c.name: c for c in (*_STATE_COLUMNS, *_axes(), *_spindles(), *_others())
}


def column(name: str) -> Column:
    """The column called ``name``; for an unknown one a ValueError that lists the nearest names."""
    if name not in COLUMNS:
        import difflib

        near = ", ".join(difflib.get_close_matches(name, COLUMNS))
        hint = f"did you mean {near}?" if near else "they are listed in pipeline/signals/columns.py"
        raise ValueError(f"signal {name!r} is not in the table of signals; {hint}")
    return COLUMNS[name]


def field(name: str) -> pa.Field:
    """Arrow field of a clean column, its unit as metadata."""
    c = column(name)
    return pa.field(name, pa.string() if c.text else pa.float64(), metadata={"unit": c.unit})


def unit_of(column: pa.Field) -> str:
    """Unit in the metadata of an Arrow field, ``""`` for none."""
    return (column.metadata or {}).get(b"unit", b"").decode()


def component_words(kind: str, name: str) -> str:
    """Part of a machine by its MTConnect component and its name, each once."""
    return kind if kind.casefold() == name.casefold() else f"{kind} {name}".strip()


TIME = pa.timestamp("ns", tz="UTC")
_CODED, _WORD, _NUMBER = pa.dictionary(pa.int32(), pa.string()), pa.string(), pa.float64()


def _schema(needed: str, **columns: pa.DataType) -> pa.Schema:
    """Schema of ``columns`` in their order; those ``needed`` hold no null."""
    return pa.schema([pa.field(n, t, n not in needed.split()) for n, t in columns.items()])


OBSERVATIONS = _schema(
    "time data_item sequence kind",
    time=TIME, data_item=_CODED, number=_NUMBER, text=_CODED, sequence=pa.uint64(), kind=_CODED,
    key=_CODED, attributes=_WORD, instance=pa.uint64(),
)  # fmt: skip
"""Long form of a machine's observations.

``number`` or ``text`` holds the value; both null say that the item became unavailable at ``time``.
``kind`` is one of :data:`KINDS`.  ``key`` distinguishes values of one item at the same time: a
condition's native code or id, an entry of a data set (``row/column`` for a table), X, Y, Z of a
position, the place in a time series, the id of an asset.  ``attributes`` is JSON of the rest.
``sequence`` is the agent's, or the place of the record in its file (from 1) when there is none;
``instance`` is the agent's instanceId."""

KINDS = ("SAMPLE", "EVENT", "CONDITION", "MESSAGE", "DATA_SET", "TABLE", "TIME_SERIES", "ASSET",
         "UNKNOWN")  # fmt: skip

REJECTED = _schema("file reason", file=_WORD, line=pa.uint64(), reason=_WORD, excerpt=_WORD)
"""Unreadable records: file, line (null for the whole file), reason, beginning of the text."""

RUNS = _schema(
    "recording file format rows",
    recording=_WORD, file=_WORD, format=_WORD, start=TIME, end=TIME, rows=pa.int64(),
)  # fmt: skip
"""Table of recordings, one row each; further columns are their conditions."""

AUDIT = _schema("time data_item rule", time=TIME, data_item=_WORD, before=_WORD, after=_WORD,
                rule=_WORD)  # fmt: skip
GAPS = _schema("start cause", data_item=_WORD, start=TIME, end=TIME, cause=_WORD)
CYCLES = pa.schema([
    *_schema("cycle start end", cycle=pa.int64(), program=_WORD, part=_WORD, start=TIME, end=TIME),
    *(pa.field(n, _NUMBER, nullable=False, metadata={"unit": "SECOND"})
      for n in ("active_s", "feed_hold_s", "interrupted_s", "idle_s")),
    *_schema("tool_changes complete", tool_changes=pa.int64(), complete=pa.bool_()),
])  # fmt: skip
SEGMENTS = _schema("start end kind", start=TIME, end=TIME, kind=_WORD)
ALARMS = _schema(
    "data_item level code message start ended",
    data_item=_WORD, level=_WORD, code=_WORD, message=_WORD, start=TIME, end=TIME, ended=_WORD,
    program=_WORD, line=_NUMBER,
)  # fmt: skip

ALARM_LEVELS = ("warning", "fault")
ALARM_ENDS = ("cleared", "changed", "unavailable", "open")
GAP_CAUSES = ("unavailable", "silence", "instance", "sequence")
SEGMENT_KINDS = ("off", "warm_up", "idle", "air", "cut")
