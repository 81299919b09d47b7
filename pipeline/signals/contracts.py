"""Contracts of stored tables, made from the table of signals, and their check.

A table that breaks its contract raises one sentence: column, row, value, remedy.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet as pq

from pipeline.signals.columns import (
    ALARM_ENDS,
    ALARM_LEVELS,
    ALARMS,
    AUDIT,
    COLUMNS,
    CYCLES,
    GAP_CAUSES,
    GAPS,
    KINDS,
    OBSERVATIONS,
    REJECTED,
    RUNS,
    SEGMENT_KINDS,
    SEGMENTS,
)

SCHEMAS = {
    "observations": OBSERVATIONS, "runs": RUNS, "rejected": REJECTED, "cycles": CYCLES,
    "segments": SEGMENTS, "gaps": GAPS, "audit": AUDIT, "alarms": ALARMS,
}  # fmt: skip
"""Tables whose columns are always the same."""
TABLES = ("observations", "traces", "state", *tuple(SCHEMAS)[1:])

_OPEN = ("traces", "runs")
"""Tables that may have columns beside their own."""

_AMONG = {("observations", "kind"): KINDS, ("segments", "kind"): SEGMENT_KINDS,
          ("gaps", "cause"): GAP_CAUSES, ("alarms", "level"): ALARM_LEVELS,
          ("alarms", "ended"): ALARM_ENDS}  # fmt: skip
"""Words that a column may hold."""

_NOT_NEGATIVE = {"sequence", "rows", "line", "active_s", "feed_hold_s", "interrupted_s", "idle_s",
                 "tool_changes"}  # fmt: skip

_REMEDY = {
    "observations": "read the raw file again",
    "traces": "correct the table's layout in the machine's file and read it again",
    "runs": "correct the conditions of the recording",
    "rejected": "read the raw file again",
}
_CLEAN = "clean the machine's signals again"


def _is_words(series: "pd.Series[Any]") -> bool:
    if isinstance(series.dtype, pd.StringDtype):
        return True
    return all(isinstance(word, str) for word in series.dropna().unique())


ACCEPTED: dict[str, tuple[str, Callable[["pd.Series[Any]"], bool]]] = {
    "time": (
        "times with zone UTC",
        lambda s: isinstance(s.dtype, pd.DatetimeTZDtype) and str(s.dtype.tz) == "UTC",
    ),
    "plant": (
        "times with the plant's zone", lambda s: isinstance(s.dtype, pd.DatetimeTZDtype),
    ),
    "word": ("words", _is_words),
    "number": (
        "numbers",
        lambda s: pd.api.types.is_numeric_dtype(s) and not pd.api.types.is_bool_dtype(s),
    ),
    "truth": ("true or false", pd.api.types.is_bool_dtype),
}  # fmt: skip
"""Kinds of columns: what belongs there, and whether a column is of the kind."""


@dataclass(frozen=True, kw_only=True)
class Rule:
    """Allowed content of a column of a table."""

    accepts: str
    """Key of :data:`ACCEPTED`."""
    nullable: bool = False
    """Whether values may be missing."""
    among: tuple[str, ...] = ()
    """Words that the column may hold; empty for all."""
    low: float = -np.inf
    high: float = np.inf
    unit: str = ""
    """Least and greatest value, in ``unit``."""

    def broken(self, values: "pd.Series[Any]") -> tuple[str, Any]:
        """Allowed values in words, and the rows that break the rule."""
        missing = values.isna().to_numpy()
        if missing.any() and not self.nullable:
            return "a value", missing
        if self.among:
            return f"one of {', '.join(self.among)}", ~missing & ~values.isin(self.among).to_numpy()
        if np.isinf(self.low) and np.isinf(self.high):
            return "", np.zeros(len(values), bool)
        numbers = values.to_numpy(dtype=float, na_value=np.nan)
        unit = f" {self.unit}" if self.unit else ""
        within = f"within {self.low:g} … {self.high:g}{unit}"
        wanted = f"at least {self.low:g}{unit}" if np.isinf(self.high) else within
        return wanted, ~missing & ~((numbers >= self.low) & (numbers <= self.high))


def _breach(table: str, column: str, said: str) -> ValueError:
    return ValueError(f"{table}: column {column!r}{said}; {_REMEDY.get(table, _CLEAN)}")


def check(table_name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """The same table, checked: a breach is a ValueError with column, row, value and remedy."""
    rules = _rules(table_name, frame.columns)
    _check_columns(table_name, frame, rules)
    for name, rule in rules.items():
        kind, is_of = ACCEPTED[rule.accepts]
        if not is_of(frame[name]):
            raise _breach(table_name, name, f" is {frame[name].dtype} where {kind} belong")
        wanted, wrong = rule.broken(frame[name])
        if wrong.any():
            row = int(np.argmax(wrong))
            case = frame[name].iloc[row]
            shown = case.item() if isinstance(case, np.generic) else case
            raise _breach(table_name, name, f", row {row}: {shown!r} where {wanted} belongs")
    _check_order(table_name, frame)
    return frame


def _rules(table_name: str, present: Iterable[str]) -> dict[str, Rule]:
    """Rule of each column of a table; wide ones have those of the signals that are present."""
    if table_name not in TABLES:
        raise ValueError(f"table {table_name!r} has no contract; name one of {', '.join(TABLES)}")
    if table_name not in SCHEMAS:
        return _wide(table_name, list(present))
    return {
        one.name: Rule(
            accepts=_accepts(one.type), nullable=one.nullable,
            among=tuple(_AMONG.get((table_name, one.name), ())),
            low=0.0 if one.name in _NOT_NEGATIVE else -np.inf,
        )
        for one in SCHEMAS[table_name]
    }  # fmt: skip


def _accepts(kind: pyarrow.DataType) -> str:
    if pyarrow.types.is_timestamp(kind):
        return "time"
    if pyarrow.types.is_boolean(kind):
        return "truth"
    return "number" if pyarrow.types.is_primitive(kind) else "word"


def _wide(table_name: str, present: list[str]) -> dict[str, Rule]:
    """Rules of a wide table: known signals within their range, other channels as numbers."""
    state = table_name == "state"
    columns = {"t": Rule(accepts="number")}
    if state or "time" in present:
        columns = {"time": Rule(accepts="plant" if state else "time")}
    for name in present:
        known = COLUMNS.get(name)
        if known is None:
            continue
        columns[name] = Rule(accepts="word" if known.text else "number", nullable=True)
        if state and not known.text:
            columns[name] = replace(
                columns[name], low=known.low, high=known.high, unit=known.unit or ""
            )
    return columns


def _check_columns(table_name: str, frame: pd.DataFrame, rules: Mapping[str, Rule]) -> None:
    for name in rules:
        if name not in frame.columns:
            raise _breach(table_name, name, " is missing")
    for name in frame.columns if table_name not in _OPEN else ():
        if name not in rules:
            raise _breach(table_name, name, " is not of this table")


def _check_order(table_name: str, frame: pd.DataFrame) -> None:
    """Times ascend where they index the table, and nothing ends before it starts."""
    if table_name == "state" and len(frame):
        late = (frame["time"].diff() <= pd.Timedelta(0)).to_numpy()
        if late.any():
            row = int(np.argmax(late))
            said = f", row {row}: {frame['time'].iloc[row]} does not follow the row before"
            raise _breach("state", "time", said)
    if {"start", "end"} <= set(frame.columns):
        wrong = (frame["end"] < frame["start"]).to_numpy()
        if wrong.any():
            row = int(np.argmax(wrong))
            start, end = (frame[name].iloc[row] for name in ("start", "end"))
            raise _breach(table_name, "end", f", row {row}: {end} is before its start {start}")


def check_files(folder: Path, tables: Mapping[str, str]) -> None:
    """Check tables in ``folder`` against their contracts; ``tables`` maps each to a pattern."""
    for name, pattern in tables.items():
        for path in sorted(folder.glob(pattern)):
            try:
                if name == "traces":  # the kinds of its channels stand in the file's schema
                    kinds = pq.read_schema(path).empty_table().to_pandas()
                    check(name, kinds)
                    check(name, pd.read_parquet(path, columns=["time" if "time" in kinds else "t"]))
                    continue
                check(name, pd.read_parquet(path))
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from error
