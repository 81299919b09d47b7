"""Runs of a program, as a log of line numbers shows them.

A log names the line that is being executed each time it is polled and found another, so that lines
shorter than the polling interval are passed over.  A run lasts from the control's becoming active
to its completing or stopping; what the operator held it for within is listed, not removed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.identification.control.execution import Activity, activities

Floats = NDArray[np.float64]

SIGNALS = (
    "execution", "line", "path_feedrate", "spindle_speed", "feed_override", "rapid_override",
    "tool_number",
)  # fmt: skip
"""Signals that a run is read from; the first two are needed."""
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
        """What was said from ``start`` to ``end``, and before it what was in force."""
        keep = (self.time >= start) & (self.time <= end)
        time, value = self.time[keep], self.value[keep]
        earlier = np.searchsorted(self.time, start)
        if earlier:
            time = np.concatenate([[start], time])
            value = np.concatenate([self.value[earlier - 1 : earlier], value])
        return Series(time=time, value=value)


UNSAID = Series(time=np.empty(0), value=np.empty(0))


@dataclass(frozen=True, kw_only=True)
class Run(Activity):
    """One execution of a program.

    Parameters
    ----------
    recording : str
        The file it is from.
    number : int
        Which run of that file, counting from 1.
    line : Series
        Line of the program, as polled.
    feed : Series
        Speed along the path [mm/s].
    speed : Series
        Of the spindle [rev/min].
    tool : Series
        Tool in the spindle; 0 while it is changed.
    feed_override, rapid_override : Series
        [%]; empty where never said.
    """

    recording: str
    number: int
    line: Series
    feed: Series = UNSAID
    speed: Series = UNSAID
    tool: Series = UNSAID
    feed_override: Series = UNSAID
    rapid_override: Series = UNSAID

    @property
    def name(self) -> str:
        """File and number."""
        return self.recording if self.number == 1 else f"{self.recording} (run {self.number})"

    def during(self, start: float, end: float) -> "Run":
        """The same run as if the log had begun at ``start`` and ended at ``end``."""
        return replace(
            self,
            start=start,
            end=end,
            held=tuple((max(a, start), min(b, end)) for a, b in self.held if b > start and a < end),
            line=self.line.within(start, end),
            feed=self.feed.within(start, end),
            speed=self.speed.within(start, end),
            tool=self.tool.within(start, end),
            feed_override=self.feed_override.within(start, end),
            rapid_override=self.rapid_override.within(start, end),
        )


def read_runs(path: Path, items: Mapping[str, str], recording: str) -> list[Run]:
    """Runs in one recording.

    Parameters
    ----------
    path : Path
        Observations of the recording.
    items : mapping of str to str
        Signal -> data item, of :data:`SIGNALS`.
    recording : str
        Its name, for people.

    Returns
    -------
    list of Run
        Empty when the recording says nothing of lines.

    Raises
    ------
    ValueError
        When ``items`` names no data item for the line or the execution.
    """
    for needed in SIGNALS[:2]:
        if needed not in items:
            raise ValueError(
                f"mapping.signals names no data item for {needed}, which runs of a program are "
                "read from: name it in conf/machine/"
            )
    table = pq.read_table(path, columns=["time", "data_item", "number", "text"]).to_pandas()
    if not len(table):
        return []
    table = table.sort_values("time", kind="stable")
    seconds = (table["time"] - table["time"].iloc[0]).dt.total_seconds().to_numpy()
    series = {name: _series(table, seconds, items.get(name)) for name in SIGNALS[1:]}
    states = (table["data_item"] == items["execution"]).to_numpy()
    said = zip(seconds[states].tolist(), table["text"].to_numpy()[states].tolist(), strict=True)
    runs = [
        _run(series, recording, number, active)
        for number, active in enumerate(activities(said, float(seconds[-1])), start=1)
    ]
    return [run for run in runs if len(run.line.time) > 1]


def _series(table: pd.DataFrame, seconds: Floats, item: str | None) -> Series:
    rows = (table["data_item"] == item).to_numpy()
    value = table["number"].to_numpy(dtype=np.float64)[rows]
    known = np.isfinite(value)
    return Series(time=seconds[rows][known], value=value[known])


def _run(series: Mapping[str, Series], recording: str, number: int, active: Activity) -> Run:
    whole = Run(
        recording=recording,
        number=number,
        start=active.start,
        end=active.end,
        completed=active.completed,
        held=active.held,
        line=series["line"],
        feed=series["path_feedrate"],
        speed=series["spindle_speed"],
        tool=series["tool_number"],
        feed_override=series["feed_override"],
        rapid_override=series["rapid_override"],
    )
    run = whole.during(active.start, active.end)
    return replace(run, line=_without_stale(run.line, run.start))


def _without_stale(line: Series, start: float) -> Series:
    """Without the line at ``start`` when the next is lower: it is left from the run before."""
    stale = len(line.value) > 1 and line.time[0] <= start and line.value[0] > line.value[1]
    return Series(time=line.time[1:], value=line.value[1:]) if stale else line
