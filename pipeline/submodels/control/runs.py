"""Runs of part programs in a log, and overrides and stops of the operator, line by line.

A log says an override when it changes.  What was in force before the first change is read from the
speeds that the control reached: on a long line it settles at programmed feed x override, to the
last digit.  So are feeds that were edited at the control.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Floats, Ints

Span = tuple[float, float]


def joined(spans: Sequence[Span]) -> tuple[Span, ...]:
    """Spans without overlap, in order.

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
    return np.interp(end, edges, held) - np.interp(begin, edges, held)


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


def line_spans(run: Run, lines: int) -> tuple[Floats, Floats, Ints]:
    """Begin and end of each line that was seen [s], and its number, from 1 to ``lines`` - 1."""
    number = run.line.value.astype(np.int64)
    keep = (number > 0) & (number < lines)
    time, number = run.line.time[keep], number[keep]
    return time, np.append(time[1:], run.end)[: len(time)], number


def override_of_lines(run: Run, series: Series, lines: int) -> Floats:
    """Mean of an override over the time of each line, spans at 0 left out [1]; 1 where unsaid.

    Lines count up to ``lines``; index 0 is no line. The series is in percent.
    """
    begin, end, number = line_spans(run, lines)
    if not len(series.time) or not len(number):
        return np.ones(lines)
    edges = np.unique(np.concatenate([series.time, begin, end]))
    value = series.at((edges[:-1] + edges[1:]) / 2, before=100.0)
    weight = np.diff(edges) * (value > 0)
    first, after = np.searchsorted(edges, begin), np.searchsorted(edges, end)

    def summed(over_edges: Floats) -> Floats:
        until = np.concatenate([[0.0], np.cumsum(over_edges)])
        return until[after] - until[first]

    spent = summed(weight)
    level = np.divide(
        summed(weight * value), spent, out=np.full(len(spent), 100.0), where=spent > 0
    )
    mean = np.full(lines, np.nan)
    for line, until, percent in zip(number, np.append(number[1:], lines), level, strict=True):
        mean[line : max(until, line + 1)] = percent  # lines that no poll saw go with the one before
    return nearest(mean) / 100


def lines_since(run: Run, series: Series, lines: int) -> NDArray[np.bool_]:
    """Lines executed after a series began to say something."""
    known = np.zeros(lines, dtype=bool)
    if len(series.time):
        begin, _, number = line_spans(run, lines)
        later = number[begin >= series.time[0]]
        known[int(later[0]) if len(later) else lines :] = True
    return known


def nearest(values: Floats) -> Floats:
    """Each NaN replaced by the nearest value, the left one of two; ones where there are none.

    >>> nearest(np.array([np.nan, 2.0, np.nan, 4.0, np.nan])).tolist()
    [2.0, 2.0, 2.0, 4.0, 4.0]
    """
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.ones_like(values)
    index = np.arange(len(values))
    right = np.clip(np.searchsorted(known, index), 0, len(known) - 1)
    left = np.clip(right - 1, 0, len(known) - 1)
    is_left = np.abs(known[left] - index) <= np.abs(known[right] - index)
    return values[known[np.where(is_left, left, right)]]


STEADY = 0.005
"""Two readings, one after the other, that differ by less than this share are steady."""
LAG = 0.25
"""Greatest delay of a polled line behind the machine [s]."""
FEWEST = 6
"""Steady polls that make a plateau: about a second."""
SHARE = 0.05
"""Share of the steady readings that a plateau needs at least."""
WIDTH = 0.004
"""Readings within this share of one another lie on one plateau."""
LOWEST, HIGHEST = 0.02, 3.0
"""Ratios outside are no override that a control offers."""


def feed_of_lines(moves: Moves) -> Floats:
    """Feed of each line [mm/s], NaN where it does not cut; index 0 is no line."""
    feed = np.full(int(moves.line.max(initial=0)) + 1, np.nan)
    rows = np.isin(moves.kind, CUTTING) & (moves.feed_mode == FeedMode.PER_MINUTE)
    rows &= moves.feed > 0
    feed[moves.line[rows]] = moves.feed[rows] / 60
    return feed


def steady(readings: Floats) -> NDArray[np.bool_]:
    """Flags of readings that agree with the one before."""
    before = np.concatenate([[np.nan], readings])[:-1]
    return np.abs(readings - before) < STEADY * before


def steady_ratios(run: Run, moves: Moves, *, arcs: bool = False) -> tuple[Ints, Floats]:
    """Steady readings of the feed on straight cuts: the line, and the share of its feed.

    A reading counts when the one before it agrees and both were taken while lines that cut were
    executed, since a while.

    With ``arcs`` readings on arcs count too, where the control may settle at what their curvature
    allows.
    """
    programmed = feed_of_lines(moves)
    wanted = np.zeros(len(programmed), dtype=bool)
    wanted[moves.line[np.isin(moves.kind, (Kind.FEED, Kind.ARC) if arcs else Kind.FEED)]] = True
    feed = run.feed.polled()
    lines = lines_at(run, feed.time, len(programmed))
    ratio = feed.value / programmed[lines]
    ratio[~np.isfinite(programmed[lines_at(run, feed.time - LAG, len(programmed))])] = np.nan
    kept = steady(ratio) & wanted[lines]
    return lines[kept], ratio[kept]


def lines_at(run: Run, time: Floats, lines: int) -> Ints:
    """Line in force at ``time``; 0, no line, where the program has none of that number."""
    found = run.line.at(time, before=0.0).astype(np.int64)
    return np.where((found >= 0) & (found < lines), found, 0)


def plateau(ratio: Floats, width: float = WIDTH) -> float | None:
    """The highest level that readings share within ``width``, None where they share none.

    A line may be too short to reach its feed, and readings below the level are no sign of it;
    readings above it are rapids on the way out.

    >>> plateau(np.array([0.3, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 1.7]))
    0.9
    """
    ratio = np.sort(ratio[(ratio > LOWEST) & (ratio < HIGHEST)])
    last = np.searchsorted(ratio, ratio * (1 + width), side="right")
    count = last - np.arange(len(ratio))
    enough = np.flatnonzero(count >= max(FEWEST, SHARE * len(ratio)))
    if not len(enough):
        return None
    first = enough[-1]
    return float(np.median(ratio[first : last[first]]))


@dataclass(frozen=True, kw_only=True)
class Operator:
    """Line by line; index 0 is no line."""

    feed: Floats
    """Feed in force over programmed feed [1]; shape (lines + 1,)."""
    rapid: Floats
    """Rapid override in force [1]; shape (lines + 1,)."""
    spindle: Floats
    """Speed of the spindle over programmed speed [1]; shape (lines + 1,)."""
    said: Floats
    """Feed override as the log says it; 1 where it says none [1]; shape (lines + 1,)."""
    stops: tuple[Span, ...]
    """Spans in which the operator held the machine: the control said so, or an override was 0 while
    a line that heeds it was executed [s]."""
    feed_read: float
    """Share of the cutting lines whose feed was read from plateaus; that of the rest is as the log
    says it, or as on the nearest line that was read [1]."""


def operator_of(run: Run, moves: Moves) -> Operator:
    """Operator's overrides and stops in ``run`` of the program ``moves``."""
    programmed = feed_of_lines(moves)
    lines = len(programmed)
    cuts = np.isfinite(programmed)
    said = override_of_lines(run, run.feed_override, lines)
    feed, read = _feed(run, moves, cuts, said)
    rapids = np.zeros(lines, dtype=bool)
    rapids[moves.line[moves.kind == Kind.RAPID]] = True
    stops = [
        *run.held,
        *_zeros(run, run.feed_override, cuts),
        *_zeros(run, run.rapid_override, rapids),
    ]
    return Operator(
        feed=feed,
        rapid=override_of_lines(run, run.rapid_override, lines),
        spindle=_spindle(run, moves, lines),
        said=said,
        stops=joined(stops),
        feed_read=read,
    )


def _feed(run: Run, moves: Moves, cuts: NDArray[np.bool_], said: Floats) -> tuple[Floats, float]:
    """Feed factor of each line, and the share of the cutting lines that it was read on."""
    stretches = _stretches(moves, said)
    known = lines_since(run, run.feed_override, len(said))
    factor = _levels(stretches, *steady_ratios(run, moves))
    if not np.isfinite(factor[cuts & ~known]).any():  # no straight cut is long enough
        curved = _levels(stretches, *steady_ratios(run, moves, arcs=True))
        factor = np.where(np.isfinite(factor) | known, factor, curved)
    read = np.isfinite(factor) & cuts
    # unsaid and unread: as on the nearest line where it could be read
    rest = np.where(known, said, nearest(np.where(cuts, factor, np.nan)))
    factor = np.where(np.isfinite(factor), factor, rest)
    return np.where(factor > 0, factor, 1.0), float(read.sum() / max(cuts.sum(), 1))


def _stretches(moves: Moves, said: Floats) -> Ints:
    """Number of the stretch that each line lies in: one tool, one programmed feed, one override."""
    tool = np.zeros(len(said))
    tool[moves.line] = moves.tool
    latest = np.maximum.accumulate(np.where(tool != 0, np.arange(len(said)), 0))
    feed = np.nan_to_num(feed_of_lines(moves))
    override = np.round(said, 3)  # a mean of what is constant differs in its last digits
    label = np.column_stack([tool[latest], override, feed])
    _, numbers = np.unique(label, axis=0, return_inverse=True)
    return numbers.ravel().astype(np.int64)


def _levels(stretches: Ints, where: Ints, ratio: Floats) -> Floats:
    """The plateau of each stretch, at its lines; NaN where there is none."""
    factor = np.full(len(stretches), np.nan)
    for number in np.unique(stretches[where]):
        level = plateau(ratio[stretches[where] == number])
        if level is not None:
            factor[stretches == number] = level
    return factor


def _spindle(run: Run, moves: Moves, lines: int) -> Floats:
    """Factor of the spindle's speed: what the log last said while one S was in force."""
    factor = np.ones(lines)
    on = moves.direction != 0
    changes = np.flatnonzero(np.diff(moves.speed * on, prepend=0.0, append=0.0))
    begin, _, number = line_spans(run, lines)
    for row, after in pairwise(changes):
        programmed = moves.speed[row]
        first, last = moves.line[row], moves.line[after - 1]
        seen = (number >= first) & (number <= last)
        if not on[row] or programmed <= 0 or not seen.any():
            continue
        ratio = float(run.speed.at(begin[seen][-1:], before=0.0)[0]) / programmed
        if LOWEST < ratio < HIGHEST:
            factor[first : last + 1] = ratio
    return factor


def _zeros(run: Run, series: Series, heeds: NDArray[np.bool_]) -> list[Span]:
    """Spans in which an override stood at 0 while a line that heeds it was, or was about to be."""
    spans = []
    ends = np.append(series.time, run.end)[1:]
    for begin, end, value in zip(series.time, ends, series.value, strict=True):
        if value > 0:
            continue
        line = int(run.line.at(np.array([(begin + end) / 2]), before=0.0)[0])
        if heeds[line : line + 2].any():
            spans.append((float(begin), float(end)))
    return spans
