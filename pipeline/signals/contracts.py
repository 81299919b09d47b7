"""Contracts of stored tables: pandera schemas made from the table of signals, and their check.

A table that breaks its contract raises one sentence: column, row, value, remedy.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow

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
    Column,
)

if TYPE_CHECKING:
    import pandera.pandas as pa

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


def check(table_name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """Check a table against its contract.

    Parameters
    ----------
    table_name : str
        One of ``TABLES``.
    frame : DataFrame
        The table as pandas reads it.

    Returns
    -------
    DataFrame
        The same table.

    Raises
    ------
    ValueError
        When there is no such contract, or with the column, row and value that break it.
    """
    import pandera.errors

    contract = schema(table_name, frame.columns)
    _check_columns(table_name, frame, contract)
    try:
        contract.validate(frame)
    except pandera.errors.SchemaError as error:
        raise ValueError(_sentence(table_name, frame, error)) from error
    _check_order(table_name, frame)
    return frame


def schema(table_name: str, present: Iterable[str] = ()) -> "pa.DataFrameSchema":
    """The pandera schema of a table.

    Parameters
    ----------
    table_name : str
        One of ``TABLES``.
    present : iterable of str
        The columns of the table at hand: wide tables have those of the signals they have.

    Raises
    ------
    ValueError
        When there is no such table.
    """
    import pandera.pandas as pa

    if table_name not in TABLES:
        raise ValueError(f"table {table_name!r} has no contract; name one of {', '.join(TABLES)}")
    columns = _fixed(table_name) if table_name in SCHEMAS else _wide(table_name, list(present))
    return pa.DataFrameSchema(columns, strict=table_name not in _OPEN)


def _of(accepts: str, *, nullable: bool = False, checks: Any = None) -> "pa.Column":
    """A column of times, words, numbers or counts."""
    import pandera.pandas as pa

    kinds = {
        "time": pa.Check(
            lambda s: isinstance(s.dtype, pd.DatetimeTZDtype) and str(s.dtype.tz) == "UTC",
            error="times with zone UTC",
        ),
        "plant": pa.Check(
            lambda s: isinstance(s.dtype, pd.DatetimeTZDtype), error="times with the plant's zone"
        ),
        "word": pa.Check(_is_words, error="words"),
        "number": pa.Check(
            lambda s: pd.api.types.is_numeric_dtype(s) and not pd.api.types.is_bool_dtype(s),
            error="numbers",
        ),
        "truth": pa.Check(pd.api.types.is_bool_dtype, error="true or false"),
    }
    return pa.Column(None, [kinds[accepts], *(checks or [])], nullable=nullable)


def _is_words(series: pd.Series) -> bool:
    return all(isinstance(word, str) for word in series.dropna().unique())


def _between(column: Column) -> Any:
    import pandera.pandas as pa

    unit = f" {column.unit}" if column.unit else ""
    text = f"within {column.low:g} … {column.high:g}{unit}"
    return [pa.Check.in_range(column.low, column.high, error=text)]


def _fixed(table_name: str) -> "dict[str, pa.Column]":
    """Columns of a table by its Arrow schema."""
    import pandera.pandas as pa

    columns = {}
    for one in SCHEMAS[table_name]:
        checks = None
        if among := _AMONG.get((table_name, one.name)):
            checks = [pa.Check.isin(list(among), error=f"one of {', '.join(among)}")]
        elif one.name in _NOT_NEGATIVE:
            checks = [pa.Check.ge(0, error="at least 0")]
        columns[one.name] = _of(_accepts(one.type), nullable=one.nullable, checks=checks)
    return columns


def _accepts(kind: pyarrow.DataType) -> str:
    if pyarrow.types.is_timestamp(kind):
        return "time"
    if pyarrow.types.is_boolean(kind):
        return "truth"
    return "number" if pyarrow.types.is_primitive(kind) else "word"


def _wide(table_name: str, present: list[str]) -> "dict[str, pa.Column]":
    """Columns of a wide table: known signals within their range, other channels as numbers."""
    columns = {}
    if table_name == "state" or "time" in present:
        columns["time"] = _of("plant" if table_name == "state" else "time")
    else:
        columns["t"] = _of("number")
    for name in present:
        known = COLUMNS.get(name)
        if known is not None and known.text:
            columns[name] = _of("word", nullable=True)
        elif known is not None:
            checks = _between(known) if table_name == "state" else None
            columns[name] = _of("number", nullable=True, checks=checks)
    return columns


def _check_columns(table_name: str, frame: pd.DataFrame, contract: "pa.DataFrameSchema") -> None:
    """No column is missing, and in a closed table none is too many."""
    remedy = _REMEDY.get(table_name, _CLEAN)
    for name in contract.columns:
        if name not in frame.columns:
            raise ValueError(f"{table_name}: column {name!r} is missing; {remedy}")
    if contract.strict:
        for name in frame.columns:
            if name not in contract.columns:
                raise ValueError(f"{table_name}: column {name!r} is not of this table; {remedy}")


def _check_order(table_name: str, frame: pd.DataFrame) -> None:
    """Times ascend where they index the table, and nothing ends before it starts."""
    remedy = _REMEDY.get(table_name, _CLEAN)
    if table_name == "state" and len(frame):
        late = (frame["time"].diff() <= pd.Timedelta(0)).to_numpy()
        if late.any():
            row = int(np.argmax(late))
            raise ValueError(
                f"state: column 'time', row {row}: {frame['time'].iloc[row]} does not follow the "
                f"row before; {remedy}"
            )
    if {"start", "end"} <= set(frame.columns):
        wrong = (frame["end"] < frame["start"]).to_numpy()
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(
                f"{table_name}: column 'end', row {row}: {frame['end'].iloc[row]} is before its "
                f"start {frame['start'].iloc[row]}; {remedy}"
            )


def _sentence(table_name: str, frame: pd.DataFrame, error: Any) -> str:
    """One sentence for what pandera found: column, row, value, what it should be, remedy."""
    remedy = _REMEDY.get(table_name, _CLEAN)
    name = getattr(error.schema, "name", None)
    wanted = getattr(error.check, "error", None) or "a value"
    rows: Any = error.failure_cases
    if not isinstance(rows, pd.DataFrame) or "index" not in rows or rows["index"].isna().all():
        kind = frame[name].dtype if name in frame else "of an unknown kind"
        return f"{table_name}: column {name!r} is {kind} where {wanted} belong; {remedy}"
    case = rows["failure_case"].iloc[0]
    shown = case.item() if isinstance(case, np.generic) else case
    return (
        f"{table_name}: column {name!r}, row {rows['index'].iloc[0]}: {shown!r} where "
        f"{wanted} belongs; {remedy}"
    )


def check_files(folder: Path, tables: Mapping[str, str]) -> None:
    """Check tables on disk against their contracts.

    Parameters
    ----------
    folder : Path
        ``data/signals/<machine>`` or ``data/clean/<machine>``.
    tables : mapping of str to str
        Name of the table -> pattern of its files in ``folder``.

    Raises
    ------
    ValueError
        With the file, column, row and value that break a contract.
    """
    for name, pattern in tables.items():
        for path in sorted(folder.glob(pattern)):
            try:
                check(name, pd.read_parquet(path))
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from error
