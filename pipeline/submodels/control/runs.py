"""Runs of part programs in a log: what the control was doing, and what it said meanwhile."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from pipeline.schema.arrays import Floats

Span = tuple[float, float]


def joined(spans: Sequence[Span]) -> tuple[Span, ...]:
    """Spans without overlap, in order.

    Examples
    --------
    >>> joined([(4.0, 5.0), (1.0, 2.0), (1.5, 3.0)])
    ((1.0, 3.0), (4.0, 5.0))
    """
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return tuple(found)


def stopped_within(stops: Sequence[Span], begin: Floats, end: Floats) -> Floats:
    """Share of the times from ``begin`` to ``end``, (N,), in ordered, disjoint ``stops`` [s]."""
    if not stops:
        return np.zeros_like(begin)
    edges = np.ravel(stops)
    held = np.concatenate([[0.0], np.cumsum(np.diff(edges) * (np.arange(len(edges) - 1) % 2 == 0))])
    within: Floats = np.interp(end, edges, held) - np.interp(begin, edges, held)
    return within


ACTIVE = frozenset({"ACTIVE"})
HELD = frozenset({"FEED_HOLD", "INTERRUPTED", "OPTIONAL_STOP", "PROGRAM_OPTIONAL_STOP", "WAIT"})
COMPLETED = frozenset({"PROGRAM_COMPLETED"})


@dataclass(frozen=True, kw_only=True)
class Activity:
    """Activity from becoming active to completing or stopping."""

    start: float
    end: float
    """Begin and end of the active state, in the recording's time [s]."""
    completed: bool
    """Whether the program ran to its end."""
    held: tuple[Span, ...] = ()
    """Spans in which the control said that it was held [s]."""


def activities(said: Iterable[tuple[float, str]], end: float) -> Iterator[Activity]:
    """Activities from a control's execution states.

    ``said`` holds time [s] and state, ``end`` is that of the recording [s].  Without a state all of
    the recording counts: the control may report no execution.
    """
    said = list(said)
    start: float | None = None if said else 0.0
    since: float | None = None  # when it was held
    held: list[Span] = []
    for time, word in said:
        if start is None:
            start = time if word in ACTIVE else None
            continue
        if word in HELD:
            since = time if since is None else since
            continue
        if since is not None:
            held.append((since, time))
            since = None
        if word not in ACTIVE:
            yield Activity(start=start, end=time, completed=word in COMPLETED, held=tuple(held))
            start, held = None, []
    if start is not None:
        if since is not None:
            held.append((since, end))
        yield Activity(start=start, end=end, completed=False, held=tuple(held))


POLL = 0.15
"""Period of regular polls [s], as adapters of controls have it."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """A signal that keeps its value until the next: ``time`` [s] of the recording, ``value``."""

    time: Floats
    value: Floats

    def at(self, time: Floats, before: float) -> Floats:
        """Value in force at ``time``; ``before`` where none was said yet."""
        index = np.searchsorted(self.time, time, side="right") - 1
        return np.where(index >= 0, np.append(self.value, before)[index], before)

    def polled(self) -> "Series":
        """The same at regular polls: logs that write changes only leave out what stays."""
        if not len(self.time):
            return self
        time = np.arange(self.time[0], self.time[-1] + POLL, POLL)
        return Series(time=time, value=self.at(time, before=np.nan))

    def within(self, start: float, end: float) -> "Series":
        """Values reported from ``start`` to ``end``, and the one in force before."""
        keep = (self.time >= start) & (self.time <= end)
        time, value = self.time[keep], self.value[keep]
        earlier = np.searchsorted(self.time, start)
        if earlier:
            time = np.concatenate([[start], time])
            value = np.concatenate([self.value[earlier - 1 : earlier], value])
        return Series(time=time, value=value)


SIGNAL_OF = {
    "line": "line", "feed": "path_feedrate", "speed": "spindle_speed", "tool": "tool_number",
    "feed_override": "feed_override", "rapid_override": "rapid_override",
}  # fmt: skip
"""Signal that each series of a run is read from."""
UNSAID = Series(time=np.empty(0), value=np.empty(0))


@dataclass(frozen=True, kw_only=True)
class Run(Activity):
    """Execution of a program."""

    recording: str
    """The file it is from."""
    number: int
    """Number of the run in that file, counting from 1."""
    line: Series
    """Line of the program, as polled."""
    feed: Series = UNSAID
    """Speed along the path [mm/s]."""
    speed: Series = UNSAID
    """Speed of the spindle [rev/min]."""
    tool: Series = UNSAID
    """Tool in the spindle; 0 while it is changed."""
    feed_override: Series = UNSAID
    rapid_override: Series = UNSAID
    """[%]; empty where never said."""

    @property
    def name(self) -> str:
        """File and number."""
        return self.recording if self.number == 1 else f"{self.recording} (run {self.number})"

    @property
    def latency(self) -> float:
        """Greatest delay of a stamp of the log [s]: the period of its polls.

        That is the lower quartile of the gaps between changes of what changes most often, of line
        and feed; polls that found no change leave longer gaps.
        """
        gaps = [np.diff(np.unique(one.time)) for one in (self.line, self.feed)]
        return min((float(np.quantile(gap, 0.25)) for gap in gaps if len(gap)), default=POLL)

    def during(self, start: float, end: float) -> "Run":
        """The same run as if the log had begun at ``start`` and ended at ``end``."""
        held = tuple((max(a, start), min(b, end)) for a, b in self.held if b > start and a < end)
        said = {name: getattr(self, name).within(start, end) for name in SIGNAL_OF}
        return replace(self, start=start, end=end, held=held, **said)


def read_runs(path: Path, items: Mapping[str, str], recording: str) -> list[Run]:
    """Runs in one recording; empty when it reports no lines.

    ``items`` maps a signal to its data item; ``execution`` and ``line`` are needed, the others of
    :data:`SIGNAL_OF` are used where they are named. ValueError when ``items`` names no data item
    for the line or the execution.
    """
    for needed in ("execution", "line"):
        if needed not in items:
            raise ValueError(
                f"mapping.signals names no data item for {needed}, which runs of a program are "
                "read from: name it in conf/machine/"
            )
    if "data_item" in (names := pq.read_schema(path).names):
        table = pq.read_table(path, columns=["time", "data_item", "number", "text"]).to_pandas()
    elif "time" in names:
        table = _long(pq.read_table(path).to_pandas(), set(items.values()))
    else:
        raise ValueError(
            f"{recording} is a table whose times count from its start: give its layout a start"
        )
    if not len(table):
        return []
    table = table.sort_values("time", kind="stable")
    seconds = (table["time"] - table["time"].iloc[0]).dt.total_seconds().to_numpy()
    series = {name: _series(table, seconds, items.get(name)) for name in SIGNAL_OF.values()}
    states = (table["data_item"] == items["execution"]).to_numpy()
    said = zip(seconds[states].tolist(), table["text"].to_numpy()[states].tolist(), strict=True)
    runs = [
        _run(series, recording, number, active)
        for number, active in enumerate(activities(said, float(seconds[-1])), start=1)
    ]
    return [run for run in runs if len(run.line.time) > 1]


def _long(trace: pd.DataFrame, items: set[str]) -> pd.DataFrame:
    """Items of a control's log that was kept as a table, as observations."""
    there = [name for name in trace.columns if name in items]
    table = trace.melt("time", there, var_name="data_item", value_name="text").dropna()
    table["number"] = pd.to_numeric(table["text"], errors="coerce")
    return table


def _series(table: pd.DataFrame, seconds: Floats, item: str | None) -> Series:
    rows = (table["data_item"] == item).to_numpy()
    value = table["number"].to_numpy(dtype=np.float64)[rows]
    known = np.isfinite(value)
    return Series(time=seconds[rows][known], value=value[known])


def _run(series: Mapping[str, Series], recording: str, number: int, active: Activity) -> Run:
    read: dict[str, Any] = {name: series[signal] for name, signal in SIGNAL_OF.items()}
    whole = Run(recording=recording, number=number, **vars(active), **read)
    run = whole.during(active.start, active.end)
    return replace(run, line=_without_stale(run.line, run.start))


def _without_stale(line: Series, start: float) -> Series:
    """Line numbers without one at ``start`` that is left from the run before: the next is lower."""
    stale = len(line.value) > 1 and line.time[0] <= start and line.value[0] > line.value[1]
    return Series(time=line.time[1:], value=line.value[1:]) if stale else line
