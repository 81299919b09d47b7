"""Work of a machine: seconds in each execution state by day, and its cycles."""

from collections import Counter
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.sources import SourceRegistry
from pipeline.report.folders import MachineFolders
from pipeline.report.records import CLEANED, nanoseconds
from pipeline.schema.days import UTC, clock, day_end, day_of, day_start, instant, zone_of
from pipeline.schema.si import DAY, NS

BIN = 300  # s of one step of the strips and of the speed curve
STANDS_BELOW = 1.0  # rev/min; slower is standing still, within what encoders say at rest
USUAL_SHARE = 0.1
"""Running time of a day that counts as worked, over that of the median day [1]."""
NO_RECORD = "no record"
STOPPED = ("FEED_HOLD", "INTERRUPTED", "STOPPED", "PROGRAM_STOPPED", "OPTIONAL_STOP")
"""States in which a program stands, or a machine that is on."""
LEAST_STOP_S = 60
"""Least length of a stop that is kept [s]."""
NO_NAME = "(no name)"
UNUSED = np.iinfo(np.int64).min
STATES = "data/clean state table"


@dataclass(frozen=True, kw_only=True)
class Day:
    """Day of the clean state table."""

    day: str
    """ISO date of the plant."""
    seconds: dict[str, float]
    """Time in each execution state [s], ``no record`` included; adds up to the day, 23 to 25 h."""
    running: float | None
    position_control: float | None
    speed_known: float | None
    """Time that the spindle runs, is held by its position loop, has a known speed [s]."""
    runs: list[tuple[str, int, int]]
    """Runs of states, the most frequent state of each bin."""
    speed: np.ndarray
    held: np.ndarray
    """Mean speed [rev/min] and share of the time under position control [1] in each bin."""
    stops: list[tuple[str, int, int]] = field(default_factory=list)
    """State, begin and end of each stop [s since 1970]."""
    end: int | None = None
    """End of the last known second of execution [s since 1970]."""
    kinds: dict[str, float] = field(default_factory=dict)
    """Time in each kind of segment [s]."""

    @property
    def known(self) -> float:
        """Time in a known execution state [s]."""
        return sum(seconds for state, seconds in self.seconds.items() if state != NO_RECORD)

    @property
    def active(self) -> float:
        """Time in state ACTIVE [s]."""
        return self.seconds.get("ACTIVE", 0.0)

    @property
    def stopped(self) -> float:
        """Time in feed hold or interrupted [s]."""
        return self.seconds.get("FEED_HOLD", 0.0) + self.seconds.get("INTERRUPTED", 0.0)


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """Cycle; times in nanoseconds since 1970, ``running`` the share that the spindle runs."""

    program: str
    part: str
    start: int
    end: int
    active: float | None
    stopped: float | None
    running: float | None
    complete: bool | None

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return (self.end - self.start) / NS


@dataclass(frozen=True, kw_only=True)
class Work:
    """Days and cycles of a machine; ``cycles`` is None where their file is absent."""

    folders: MachineFolders
    shelf: SourceRegistry
    days: list[Day]
    cycles: list[Cycle] | None
    state_files: list[Path]
    time_zone: str = UTC

    @property
    def worked_days(self) -> list[Day]:
        """Days with at least one known second of execution."""
        return [d for d in self.days if set(d.seconds) - {NO_RECORD}]

    @property
    def active(self) -> float:
        """Time in state ACTIVE on all days [s]."""
        return sum(day.active for day in self.days)

    @property
    def last(self) -> float | None:
        """End of the last known second of execution [s] since 1970; None without one."""
        for day in reversed(self.days):
            if day.end is not None:
                return float(day.end)
            ends = [end for state, _, end in day.runs if state != NO_RECORD]
            if ends:
                return instant(day.day, BIN * max(ends), self.time_zone) / NS
        return None

    @property
    def periods(self) -> list[tuple[str, str]]:
        """First and last day of each period of records, periods a week or more apart."""
        return periods_of([d.day for d in self.worked_days])

    @property
    def missing_days(self) -> list[str]:
        """Days inside the periods of records that have none."""
        days = [d.day for d in self.worked_days]
        return [
            lost
            for first, last in self.periods
            for lost in days_between([d for d in days if first <= d <= last])
        ]

    @property
    def least_active(self) -> float:
        """Running time from which a day counts as worked [s]; there is a day with records."""
        return USUAL_SHARE * float(np.median([d.active for d in self.worked_days]))

    @property
    def surprising_days(self) -> list[str]:
        """Missing days on a weekday that is usually worked."""
        return self.surprising(self.missing_days)

    def surprising(self, missing: list[str]) -> list[str]:
        """Those of some missing days that fall on a weekday that is usually worked.

        It is where the machine ran on it on as many days as are missing at least, each for
        :data:`USUAL_SHARE` or more of the running time of the median day.
        """
        if not self.worked_days:
            return []
        ran = Counter(_weekday(d.day) for d in self.worked_days if d.active >= self.least_active)
        lost = Counter(_weekday(d) for d in missing)
        return [d for d in missing if ran[_weekday(d)] >= lost[_weekday(d)]]


def _weekday(day: str) -> int:
    return date.fromisoformat(day).weekday()


def days_between(days: list[str]) -> list[str]:
    """ISO days that lie between the first and last of ``days`` and are not among them.

    >>> days_between(["2016-10-10", "2016-10-13", "2016-10-12"])
    ['2016-10-11']
    """
    if not days:
        return []
    every = np.arange(np.datetime64(min(days), "D"), np.datetime64(max(days), "D"))
    return [str(d) for d in every if str(d) not in set(days)]


def periods_of(days: list[str]) -> list[tuple[str, str]]:
    """First and last of each run of ISO days without a hole of more than a week.

    >>> periods_of(["2017-11-13", "2017-11-16", "2019-05-20"])
    [('2017-11-13', '2017-11-16'), ('2019-05-20', '2019-05-20')]
    """
    found: list[tuple[str, str]] = []
    for day in sorted(days):
        near = found and (date.fromisoformat(day) - date.fromisoformat(found[-1][1])).days <= 7
        if near:
            found[-1] = (found[-1][0], day)
        else:
            found.append((day, day))
    return found


def work(folders: MachineFolders, shelf: SourceRegistry, prefix: str = "") -> Work:
    """Days and cycles from stored tables; ``prefix`` selects the spindle (``second_``)."""
    files, days = sorted((folders.clean / "state").glob("*.parquet")), []
    zone = zone_of(folders.clean)
    kinds = _kinds_by_day(folders, shelf, zone)
    cycles = _cycles(folders, shelf)
    used = [np.zeros(2) for _ in cycles or []]  # seconds running, seconds known
    for path in files:
        day = _day(path, shelf, prefix, kinds.get(path.stem, {}), cycles or [], used)
        if day is not None:
            days.append(day)
    if cycles is not None:
        shares = [float(runs / known) if known > 0 else None for runs, known in used]
        cycles = [replace(one, running=of) for one, of in zip(cycles, shares, strict=True)]
    return Work(
        folders=folders, shelf=shelf, days=days, cycles=cycles, state_files=files, time_zone=zone
    )


def _day(
    path: Path, shelf: SourceRegistry, prefix: str, kinds: dict[str, float],
    cycles: list[Cycle], used: list[np.ndarray],
) -> Day | None:  # fmt: skip
    columns = ("time", "execution", f"{prefix}spindle_speed", f"{prefix}spindle_position_control")
    table = shelf.table(path, columns, CLEANED, all_of=False)
    if table is None or "time" not in table.column_names:
        return None
    times = nanoseconds(table.column("time")) // NS
    zone = table.column("time").type.tz
    place = (clock(times * NS, zone) // NS % DAY) // BIN
    execution = _words(table, "execution")
    speed = _numbers(table, columns[2])
    held = _numbers(table, columns[3])
    runs = (np.abs(speed) > STANDS_BELOW) & ~(held > 0.5)
    _use_of_cycles(times, np.isfinite(speed), runs, cycles, used)
    known = bool(np.isfinite(speed).any())
    heard = np.flatnonzero(execution != NO_RECORD)
    return Day(
        day=path.stem,
        seconds=_seconds(execution, day_end(path.stem, zone) - day_start(path.stem, zone)),
        running=float(runs.sum()) if known else None,
        position_control=float((held > 0.5).sum()) if np.isfinite(held).any() else None,
        speed_known=float(np.isfinite(speed).sum()) if known else None,
        runs=_runs(execution, place),
        stops=_stops(execution, times),
        end=int(times[heard[-1]]) + 1 if len(heard) else None,
        speed=_binned(np.abs(speed), place),
        held=_binned(held, place),
        kinds=kinds,
    )


def _words(table: pa.Table, name: str) -> np.ndarray:
    if name not in table.column_names:
        return np.full(table.num_rows, NO_RECORD)
    text = pc.fill_null(table.column(name).cast(pa.string()), NO_RECORD)
    return text.to_numpy(zero_copy_only=False).astype(str)


def _numbers(table: pa.Table, name: str) -> np.ndarray:
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    return pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy()


def _seconds(execution: np.ndarray, whole: int) -> dict[str, float]:
    words, counts = np.unique(execution, return_counts=True)
    seconds = {str(w): float(n) for w, n in zip(words, counts, strict=True) if w != NO_RECORD}
    seconds[NO_RECORD] = max(0.0, whole / NS - sum(seconds.values()))
    return seconds


def _runs(execution: np.ndarray, place: np.ndarray) -> list[tuple[str, int, int]]:
    words, codes = np.unique(np.append(execution, NO_RECORD), return_inverse=True)
    votes = np.zeros((DAY // BIN, len(words)))
    np.add.at(votes, (place, codes[:-1]), 1)
    votes[votes.sum(axis=1) == 0, codes[-1]] = 1
    main = votes.argmax(axis=1)
    edges = np.flatnonzero(np.diff(main)) + 1
    starts, ends = np.append(0, edges), np.append(edges, len(main))
    return [(str(words[main[a]]), int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def _stops(execution: np.ndarray, times: np.ndarray) -> list[tuple[str, int, int]]:
    if not len(times):
        return []
    edges = np.flatnonzero((execution[1:] != execution[:-1]) | (np.diff(times) > 1)) + 1
    starts, ends = np.append(0, edges), np.append(edges, len(times)) - 1
    return [
        (str(execution[a]), int(times[a]), int(times[b]) + 1)
        for a, b in zip(starts, ends, strict=True)
        if execution[a] in STOPPED and times[b] + 1 - times[a] >= LEAST_STOP_S
    ]  # fmt: skip


def _binned(values: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Mean of the values in each bin, NaN in a bin without one."""
    good = np.isfinite(values)
    count = np.bincount(place[good], minlength=DAY // BIN).astype(float)
    total = np.bincount(place[good], weights=values[good], minlength=DAY // BIN)
    return np.divide(total, count, out=np.full(DAY // BIN, np.nan), where=count > 0)


def _use_of_cycles(
    times: np.ndarray, known: np.ndarray, runs: np.ndarray,
    cycles: list[Cycle], used: list[np.ndarray],
) -> None:  # fmt: skip
    """Add this day's seconds of running and known speed to each cycle that it overlaps."""
    sums = np.zeros((2, len(times) + 1))
    sums[0, 1:], sums[1, 1:] = np.cumsum(runs), np.cumsum(known)
    for cycle, total in zip(cycles, used, strict=True):
        a, b = np.searchsorted(times, [cycle.start // NS, cycle.end // NS])
        total += sums[:, b] - sums[:, a]


def _kinds_by_day(
    folders: MachineFolders, shelf: SourceRegistry, zone: str
) -> dict[str, dict[str, float]]:
    """Seconds of each kind of segment on each day; a segment over midnight counts to both."""
    path = folders.clean / "segments.parquet"
    table = shelf.table(path, ("start", "end", "kind"), STATES)
    if table is None:
        return {}
    found: dict[str, dict[str, float]] = {}
    kinds = table.column("kind").cast(pa.string()).to_pylist()
    starts, ends = (nanoseconds(table.column(c)) / NS for c in ("start", "end"))
    for kind, start, end in zip(kinds, starts, ends, strict=True):
        while start < end and start > 0:
            day = day_of(int(start) * NS, zone)
            midnight = day_end(day, zone) / NS
            of_day = found.setdefault(day, {})
            of_day[str(kind)] = of_day.get(str(kind), 0.0) + min(end, midnight) - start
            start = midnight
    return found


def _cycles(folders: MachineFolders, shelf: SourceRegistry) -> list[Cycle] | None:
    """Cycles that have a start and an end; None where their file is absent."""
    columns = ("program", "part", "start", "end", "active_s", "feed_hold_s", "interrupted_s",
               "complete")  # fmt: skip
    path = folders.clean / "cycles.parquet"
    table = shelf.table(path, columns, STATES, all_of=False)
    if table is None or not {"start", "end"} <= set(table.column_names):
        return None
    times = (nanoseconds(table.column(c)).tolist() for c in ("start", "end"))
    rows = table.drop_columns(["start", "end"]).to_pylist() or [{}] * table.num_rows
    return [
        Cycle(
            program=str(row.get("program") or ""),
            part="" if row.get("part") is None else str(row["part"]),
            start=start,
            end=end,
            active=row.get("active_s"),
            stopped=_sum(row.get("feed_hold_s"), row.get("interrupted_s")),
            running=None,
            complete=row.get("complete"),
        )
        for row, start, end in zip(rows, *times, strict=True)
        if UNUSED not in (start, end)
    ]


def _sum(*values: float | None) -> float | None:
    known = [v for v in values if v is not None]
    return sum(known) if known else None
