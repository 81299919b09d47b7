"""Alarms: start and end of the warnings and faults in an agent's log.

A data item of category CONDITION may have several at once, distinguished by their native codes.
NORMAL with a code ends that one, NORMAL without a code all of the item, UNAVAILABLE all of it; a
warning that becomes a fault ends, and the fault begins (MTConnect Part 2).
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.signals.columns import ALARMS

LEVELS = ("WARNING", "FAULT")
AT = ("program", "line")
"""Columns of the state table that say where a program was."""
_READ = ["time", "sequence", "data_item", "text", "kind", "key", "attributes"]


class Said(NamedTuple):
    """Condition as reported at ``time`` [ns]; ``level`` is empty for UNAVAILABLE."""

    time: int
    data_item: str
    level: str
    code: str
    message: str


def conditions(path: Path) -> list[Said]:
    """Conditions in a file of observations, in their order, without what repeats the one before."""
    table = pq.read_table(path, columns=_READ)
    table = table.filter(pc.equal(table["kind"].cast(pa.string()), "CONDITION"))
    table = table.sort_by([("time", "ascending"), ("sequence", "ascending")])
    words = [table[name].cast(pa.string()).to_pylist() for name in _READ[2:]]
    found: list[Said] = []
    last: dict[str, Said] = {}
    for time, item, text, _, key, attributes in zip(
        table["time"].cast(pa.int64()).to_pylist(), *words, strict=True
    ):
        level = str(text or "").upper()
        said = Said(
            time, item, level if level != "UNAVAILABLE" else "", key or "", _words(attributes)
        )
        before = last.get(item)
        if before is None or level in LEVELS or before[2:] != said[2:]:
            found.append(said)
        last[item] = said
    return found


def _words(attributes: str | None) -> str:
    try:
        told = json.loads(attributes or "{}")
    except json.JSONDecodeError:
        return ""
    if not isinstance(told, dict):
        return ""
    return " ".join(str(told[name]) for name in ("message", "qualifier") if told.get(name))


def alarms(said: Iterable[Said], state: pd.DataFrame) -> pd.DataFrame:
    """Warnings and faults of all files in the order of ``start``; ``end`` missing if unknown."""
    found: list[dict[str, Any]] = []
    active: dict[tuple[str, str], dict[str, Any]] = {}
    for one in sorted(said, key=lambda s: s.time):
        place = (one.data_item, one.code)
        if one.level in LEVELS:
            if place in active and active[place]["level"] == one.level.lower():
                continue
            _end(active, [place], one.time, "changed")
            active[place] = _begun(one)
            found.append(active[place])
        else:
            whole = one.level == "" or not one.code
            ended = [p for p in active if p[0] == one.data_item] if whole else [place]
            _end(active, ended, one.time, "cleared" if one.level else "unavailable")
    frame = pd.DataFrame(found, columns=[f for f in ALARMS.names if f not in AT])
    for name in ("start", "end"):
        frame[name] = pd.to_datetime(frame[name], unit="ns", utc=True)
    return _placed(frame, state)


def _begun(one: Said) -> dict[str, Any]:
    return {
        "data_item": one.data_item, "level": one.level.lower(), "code": one.code,
        "message": one.message, "start": one.time, "end": None, "ended": "open",
    }  # fmt: skip


def _end(
    active: dict[tuple[str, str], dict[str, Any]], places: Sequence[tuple[str, str]], time: int,
    how: str,
) -> None:  # fmt: skip
    for place in places:
        row = active.pop(place, None)
        if row is not None:
            row["end"], row["ended"] = time, how


def _placed(frame: pd.DataFrame, state: pd.DataFrame) -> pd.DataFrame:
    """With the program and the line that were in the control when each alarm began."""
    known = state.sort_values("time", ignore_index=True)
    row = np.asarray(known["time"].searchsorted(frame["start"], side="right")) - 1
    for name in AT:
        if name not in known or not len(known):
            frame[name] = pd.Series([None] * len(frame), dtype=object)
            continue
        value = known[name].iloc[np.maximum(row, 0)].astype(object).to_numpy().copy()
        value[(row < 0) | pd.isna(value)] = None
        frame[name] = pd.Series(value, dtype=object)
    frame["line"] = pd.to_numeric(frame["line"]).astype(float)
    return frame.reindex(columns=ALARMS.names)
