"""Which readings of a log were taken in which cut: its lines against those of the program.

A log that says which line is executed says so up to one poll late, and how far the tool has come in
it only by the sum of its speeds.  What this sum is off the line's way tells by how much places are
not known, and whether the program is the one that ran.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.spindle_load_lines import Lines, Stretch
from pipeline.identification.cutting.spindle_load_log import Readings
from pipeline.identification.cutting.spindle_power_levels import runs, settled
from pipeline.identification.cutting.spindle_power_log import LoadLog

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

SLACK = 3.0
"""Periods of the log by which the sum of speeds may be off a line's way: both ends come late."""
SHARE = 0.02
"""Part of the way that it may be off besides."""
TELLING = 8.0
"""Periods that a line must last for its way to tell anything."""
AGREE = 0.75
"""Part of the lines that tell whose ways must be those of the program."""
STEADY = 0.02
"""Share by which the feed may differ from the one that a cut mostly has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Visits:
    """V stays in one line each, of T readings.

    Parameters
    ----------
    first : ndarray of int, shape (V + 1,)
        First reading of each stay, and T.
    line : ndarray of int, shape (V,)
        Line; 0 for what is none of the program's.
    programmed, way : ndarray, shape (V,)
        Way of the line, and the one that the log shows [m].
    poll : ndarray, shape (V,)
        Way in one period at the highest speed [m].
    fed : ndarray of bool, shape (V,)
        Whether it is a line of the program without a rapid.
    """

    first: Ints
    line: Ints
    programmed: Floats
    way: Floats
    poll: Floats
    fed: Flags

    @property
    def near(self) -> Flags:
        """Whether the log's way is the program's; shape (V,)."""
        allowed = SLACK * self.poll + SHARE * self.programmed
        near: Flags = np.abs(self.programmed - self.way) <= allowed
        return near

    @property
    def telling(self) -> Flags:
        """Whether the way tells anything; shape (V,)."""
        long: Flags = np.maximum(self.programmed, self.way) > TELLING * self.poll
        return long & self.fed & (self.poll > 0)


def free_log(log: Readings, settle_s: float) -> LoadLog:
    """The log of a spindle that turns free throughout, as one of cuts that remove nothing.

    Running up takes all the motor has, a hundred times what is to be read after it: the speed has
    been kept for ``settle_s`` [s] where a level begins, which settles once more by itself.
    """
    cut = runs(settled(log.times, log.speed, settle_s=settle_s))
    none = np.zeros(len(cut))
    return LoadLog(
        times=log.times, speed=log.speed, load=log.load, cut=cut, removal=none, edge=none
    )


def cut_log(log: Readings, lines: Lines, *, settle_s: float, name: str, program: str) -> LoadLog:
    """The log with the cut that each reading was taken in.

    Cuts are stretches of one engagement and one feed; where the spindle turns in lines that are
    wholly in air, the reading is one without a cut, as of :func:`free_log`.

    Parameters
    ----------
    log : Readings
        Of one log.
    lines : Lines
        Of the program that it is of.
    settle_s : float
        How long speed and air must have been the same where a level without a cut begins [s].
    name, program : str
        Of the log and the program, for people.

    Raises
    ------
    ValueError
        When the log is not of this program.
    """
    visits = _visits(log, lines)
    _check_program(log, lines, visits, name, program)
    cut = runs(_in_air(log, lines, visits, settle_s))
    number = int(cut.max(initial=-1)) + 1
    area, edge = np.zeros(len(cut)), np.zeros(len(cut))
    step = np.nan_to_num(log.feed) * log.period
    for visit in np.flatnonzero(visits.near & visits.telling).tolist():
        here = slice(int(visits.first[visit]), int(visits.first[visit + 1]))
        off = visits.programmed[visit] - visits.way[visit]
        place = np.cumsum(step[here]) - step[here] + off / 2
        unsure = float(abs(off) / 2 + visits.poll[visit])
        for one in lines.stretches.get(int(visits.line[visit]), ()):
            run = runs(_whole(one, place, unsure, log.feed[here]))
            rows = np.flatnonzero(run >= 0) + here.start
            cut[rows] = number + run[run >= 0]
            area[rows], edge[rows] = one.area, one.edge
            number += int(run.max(initial=-1)) + 1
    return LoadLog(
        times=log.times, speed=log.speed, load=log.load, cut=cut,
        removal=area * np.nan_to_num(log.feed), edge=edge * np.abs(np.nan_to_num(log.speed)),
    )  # fmt: skip


def lines_unused(
    log: Readings, lines: Lines, labelled: LoadLog, shortest_s: float
) -> list[int]:  # fmt: skip
    """Lines with a cut of one engagement that the log shows, of which no reading is of use.

    They went otherwise than in the program, or for less than ``shortest_s`` [s] at one feed.
    """
    asked = [number for number in sorted(lines.stretches) if (log.line == number).any()]
    if labelled.cut is None or labelled.removal is None:
        return asked
    cutting = (labelled.cut >= 0) & (labelled.removal > 0.0)
    long = np.bincount(labelled.cut[cutting], minlength=1) * log.period >= shortest_s
    used = set(log.line[cutting][long[labelled.cut[cutting]]].tolist())
    return [number for number in asked if number not in used]


def _visits(log: Readings, lines: Lines) -> _Visits:
    line = np.where((log.line > 0) & (log.line < len(lines.length)), log.line, 0)
    begins = np.diff(line, prepend=-1) != 0
    first = np.flatnonzero(begins)
    feed = np.nan_to_num(log.feed)
    return _Visits(
        first=np.append(first, len(line)),
        line=line[first],
        programmed=lines.length[line[first]],
        way=np.add.reduceat(feed, first) * log.period,
        poll=np.maximum.reduceat(feed, first) * log.period,
        fed=(line[first] > 0) & ~lines.rapid[line[first]],
    )


def _check_program(
    log: Readings, lines: Lines, visits: _Visits, name: str, program: str
) -> None:  # fmt: skip
    highest = int(log.line.max())
    if highest >= len(lines.length):
        raise ValueError(
            f"{name} is not of {program}: it was in line {highest}, the program's last is "
            f"{len(lines.length) - 1}; name the program that ran"
        )
    telling = visits.telling
    if not telling.any():
        raise ValueError(
            f"{name} stays in no line of {program} long enough to tell where the tool is: log the "
            "line more often, or cut longer passes"
        )
    if visits.near[telling].mean() < AGREE:
        worst = int(np.argmax(np.abs(visits.programmed - visits.way) * telling))
        raise ValueError(
            f"{name} is not of {program}: in line {visits.line[worst]} it went "
            f"{1e3 * visits.way[worst]:.0f} mm, the program {1e3 * visits.programmed[worst]:.0f} "
            "mm; name the program that ran"
        )


def _in_air(log: Readings, lines: Lines, visits: _Visits, settle_s: float) -> Flags:
    """Readings of a spindle that has been turning free, at one speed, for ``settle_s``."""
    free = (visits.line > 0) & ~lines.cuts[visits.line]
    air = np.repeat(free, np.diff(visits.first))
    last = np.maximum.accumulate(np.where(air, -np.inf, log.times))  # reading that was not in air
    since: Flags = air & (log.times - last >= settle_s)
    return since & settled(log.times, log.speed, settle_s=settle_s)


def _whole(one: Stretch, place: Floats, unsure: float, feed: Floats) -> Flags:
    """Readings of a line surely in the stretch, at the feed that the line mostly has there."""
    inside = (place - unsure >= one.begin) & (place + unsure <= one.end) & (feed > 0)
    if not inside.any():
        return np.zeros(len(place), dtype=np.bool_)
    usual = float(np.median(feed[inside]))
    steady: Flags = inside & (np.abs(feed - usual) <= STEADY * usual)
    return steady
