"""Runs of a program, as a log of line numbers shows them.

A log names the line that is being executed each time it is polled and found another, so that lines
shorter than the polling interval are passed over.  A run lasts from the control's becoming active
to its completing or stopping; what the operator held it for within is listed, not removed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Span = tuple[float, float]

ACTIVE = frozenset({"ACTIVE"})
HELD = frozenset({"FEED_HOLD", "INTERRUPTED", "OPTIONAL_STOP", "PROGRAM_OPTIONAL_STOP", "WAIT"})
COMPLETED = frozenset({"PROGRAM_COMPLETED"})

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


@dataclass(frozen=True, kw_only=True)
class Run:
    """One execution of a program.

    Parameters
    ----------
    recording : str
        The file it is from.
    number : int
        Which run of that file, counting from 1.
    start, end : float
        When the control became active and when it ceased to be, in the recording's time [s].
    completed : bool
        Whether the program ran to its end.
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
    held : tuple of (float, float)
        Spans in which the control said that it was held [s].
    """

    recording: str
    number: int
    start: float
    end: float
    completed: bool
    line: Series
    feed: Series
    speed: Series
    tool: Series
    feed_override: Series
    rapid_override: Series
    held: tuple[Span, ...]

    @property
    def name(self) -> str:
        """File and number."""
        return self.recording if self.number == 1 else f"{self.recording} (run {self.number})"


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
    numbers = {
        signal: _series(table, seconds, items.get(signal)) for signal in SIGNALS if signal in items
    }
    state = table["data_item"].to_numpy() == items["execution"]
    said = list(zip(seconds[state], table["text"].to_numpy()[state], strict=True))
    end = float(seconds[-1])
    return [
        _run(numbers, recording, number, *span)
        for number, span in enumerate(_active(said, end), start=1)
        if len(numbers["line"].within(span[0], span[1]).time) > 1
    ]


def _series(table: object, seconds: Floats, item: str | None) -> Series:
    rows = table["data_item"].to_numpy() == item  # type: ignore[index]
    value = table["number"].to_numpy()[rows]  # type: ignore[index]
    known = np.isfinite(value)
    return Series(time=seconds[rows][known], value=value[known])


def _active(said: list[tuple[float, str]], end: float) -> Iterator[tuple[float, float, bool, tuple[Span, ...]]]:
    """Start, end, whether completed, and what was held, of each run."""
    start: float | None = None if said else 0.0
    held: list[Span] = []
    since: float | None = None
    for time, word in said:
        if word in ACTIVE:
            if start is None:
                start, held = time, []
            elif since is not None:
                held.append((since, time))
            since = None
        elif word in HELD:
            since = time if start is not None and since is None else since
        elif start is not None:
            if since is not None:
                held.append((since, time))
            yield start, time, word in COMPLETED, tuple(held)
            start, since = None, None
    if start is not None:
        yield start, end, False, tuple(held)


def _run(
    numbers: Mapping[str, Series],
    recording: str,
    number: int,
    start: float,
    end: float,
    completed: bool,
    held: tuple[Span, ...],
) -> Run:
    none = Series(time=np.empty(0), value=np.empty(0))
    parts = {s: numbers.get(s, none).within(start, end) for s in SIGNALS if s != "execution"}
    return Run(
        recording=recording,
        number=number,
        start=start,
        end=end,
        completed=completed,
        line=parts["line"],
        feed=parts["path_feedrate"],
        speed=parts["spindle_speed"],
        tool=parts["tool_number"],
        feed_override=parts["feed_override"],
        rapid_override=parts["rapid_override"],
        held=held,
    )
