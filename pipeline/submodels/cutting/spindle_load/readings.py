"""Log of a spindle's load, and the cut of the program in which each reading was taken.

A log is resampled at even times: line, speed, load and feed hold until their next reading, because
logs that write changes only are silent meanwhile; an unavailable reading holds too.

A log names the executed line up to one poll late, and the position of the tool within it only by
the sum of its speeds.  The difference between that sum and the line's path length is the
uncertainty of positions, and shows whether the program is the one that ran.

The cut of a line of the program is a row of stretches of its path with constant engagement.  A
tooth with the height b(phi) in the material takes, of the area b sin(phi) R dphi that it sweeps
across the feed, the volume per metre of feed; and it shows the width b R dphi of cutting edge to
the material, which times speed and teeth is the edge rate of :mod:`.levels`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import Engagement, ToolPath, engage
from pipeline.cutting.engagement.stock import Mesh, height_map, stock_of
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import METRE, Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.signals.recordings import LogItems
from pipeline.submodels.cutting.settings import LoadCut, LoadItems
from pipeline.submodels.cutting.spindle_load.levels import LoadLog, runs, settled
from pipeline.twin.control import program_moves
from pipeline.twin.cut.path import cutting_path

CHORD = 0.1
"""Greatest distance of a chord from its arc, over the resolution [1]."""
ALIKE = 0.05
"""Share by which engagements of one stretch differ at most [1]."""
LEVEL = 0.01
"""Slope up to which a feed counts as horizontal [1]."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Part of a line's path with constant engagement."""

    begin: float
    end: float
    """Begin and end along the path of the line [m]."""
    area: float
    """Volume removed per path length [m^2]."""
    edge: float
    """Edge rate over the spindle's speed, all teeth in cut [m^2]."""


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Path length, rapids and cuts of a program's lines."""

    length: Floats = field(repr=False)
    """Path length of each line, rapids included [m]; index 0 is no line; shape (L,)."""
    rapid: NDArray[np.bool_] = field(repr=False)
    """Whether a line has a rapid, whose speed not every control shows; shape (L,)."""
    cuts: NDArray[np.bool_] = field(repr=False)
    """Whether anything is in the material in a line; shape (L,)."""
    stretches: Mapping[int, tuple[Stretch, ...]] = field(repr=False)
    """Stretches of each line no shorter than the tool's radius; others are entries and exits."""


def program_lines(raw: Path, cut: LoadCut, setup: Setup) -> Lines:
    """Lines of the program of ``cut``.

    ValueError when the program is not there or cannot be followed, executes lines more than once,
    or its cut cannot be computed.
    """
    path = raw / cut.program
    if not path.is_file():
        raise ValueError(
            f"{path} does not exist: put the program that ran there, or correct its "
            "name in cutting_records.spindle.cuts"
        )
    moves = program_moves(path, setup)
    if (np.diff(moves.line) < 0).any() or len(moves.files) > 1:
        raise ValueError(
            f"{cut.program} jumps (subprograms or loops): the number of a line does not tell where "
            "in it the machine is; cut with a program without them"
        )
    numbers = sorted(cut.tools)
    resolution = cut.resolution_mm * METRE
    pieces = cutting_path(
        moves, numbers, chord=CHORD * resolution, offsets=setup.work_offsets
    ).pieces
    tools = [cut.tools[number] for number in numbers]
    stock = stock_of(cut.stock)
    blank = replace(stock, path=raw / stock.path) if isinstance(stock, Mesh) else stock
    engagement, _ = engage(pieces, tools, height_map(blank, resolution))
    lines = int(moves.line.max(initial=0)) + 1
    rapid, cuts = np.zeros(lines, dtype=bool), np.zeros(lines, dtype=bool)
    rapid[moves.line[(moves.kind == Kind.RAPID) & (moves.length > 0)]] = True
    cuts[moves.line[engagement.block]] = True
    length = METRE * np.bincount(moves.line, moves.length, lines).astype(np.float64)
    stretches = _stretches(moves, pieces, engagement, tools)
    return Lines(length=length, rapid=rapid, cuts=cuts, stretches=stretches)


def _stretches(
    moves: Moves, path: ToolPath, engagement: Engagement, tools: list[Tool]
) -> dict[int, tuple[Stretch, ...]]:
    line: Ints = np.asarray(moves.line[engagement.block], np.int64)
    begin = _length_before(moves, path)[engagement.piece] + engagement.along
    end = begin + engagement.length
    edge = _edges(engagement, tools)
    group = _groups(engagement, line, begin, edge)
    label = np.maximum(group, 0)
    lengths = np.where(group >= 0, engagement.length, 0.0)
    length = np.bincount(label, lengths)
    area = np.bincount(label, lengths * engagement.volume / engagement.length) / length
    edges = np.bincount(label, lengths * edge) / length
    stretches: dict[int, list[Stretch]] = {}
    for number in range(int(group.max(initial=-1)) + 1):
        members = np.flatnonzero(group == number)
        one = Stretch(
            begin=float(begin[members[0]]), end=float(end[members[-1]]),
            area=float(area[number]), edge=float(edges[number]),
        )  # fmt: skip
        if one.end - one.begin >= tools[engagement.tool[members[0]]].radius:
            stretches.setdefault(int(line[members[0]]), []).append(one)
    return {one: tuple(rows) for one, rows in stretches.items()}


def _groups(engagement: Engagement, line: Ints, begin: Floats, edge: Floats) -> Ints:
    """Number of the stretch that each station is in, -1 where a line does not cut in the plane."""
    area, end = engagement.volume / engagement.length, begin + engagement.length
    group = np.full(len(engagement), -1, dtype=np.int64)
    first = last = -1
    for k in np.flatnonzero(
        engagement.feed & (np.abs(engagement.slope) <= LEVEL) & (edge > 0) & (area > 0)
    ).tolist():
        continued = (
            first >= 0
            and line[k] == line[first]
            and begin[k] - end[last] <= engagement.resolution
            and abs(area[k] - area[first]) <= ALIKE * area[first]
            and abs(edge[k] - edge[first]) <= ALIKE * edge[first]
        )
        group[k] = group[last] if continued else group[last] + 1 if last >= 0 else 0
        first, last = (first if continued else k), k
    return group


def _length_before(moves: Moves, path: ToolPath) -> Floats:
    """Path length from the start of its line to the start of each piece [m]; shape (Q,)."""
    travelled = np.concatenate([[0.0], np.cumsum(moves.length)]) * METRE
    starts = np.searchsorted(moves.line, moves.line)  # first row of each row's line
    row = travelled[:-1] - travelled[starts]
    pieces = np.concatenate([[0.0], np.cumsum(path.length)])
    first = np.searchsorted(path.block, path.block)  # first piece of each piece's row
    return row[path.block] + pieces[:-1] - pieces[first]


def _edges(engagement: Engagement, tools: list[Tool]) -> Floats:
    """Edge rate over the spindle's speed [m^2]; shape (N,)."""
    height = np.maximum(engagement.upper - engagement.lower, 0.0).sum(axis=1, dtype=np.float64)
    step = 2 * np.pi / engagement.upper.shape[1]
    teeth = np.array([tool.flutes * tool.radius for tool in tools])[engagement.tool]
    return teeth * height * step


FASTEST, SLOWEST = 0.02, 2.0
"""Bounds of the period of a log [s]."""
QUICK = 0.5
"""Share of an item's changes that follow the one before within a period [1]."""
MOST = 2_000_000
"""Samples of a log, at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Log at even times, T samples."""

    period: float
    """Sampling interval, about that of the log's polls [s]."""
    times: Floats
    """Time since the log's start [s]; shape (T,)."""
    line: Ints
    """Line of the program, -1 where missing; shape (T,)."""
    speed: Floats
    """Speed of the spindle [rev/s]; NaN where missing, as the others; shape (T,)."""
    load: Floats
    """Load [%]; shape (T,)."""
    feed: Floats
    """Speed along the path [m/s]; shape (T,)."""


def read_log(path: Path, items: LoadItems, name: str, *, cuts: bool) -> Readings:
    """Readings of a log.

    ``cuts`` says whether line and feed are needed; ``name`` is the log's, for messages. ValueError
    when the log lacks an item that is needed, or holds too little.
    """
    log = LogItems.read(path)
    if not len(log):
        raise ValueError(f"{name} holds nothing that could be read: log the spindle while it turns")
    needed = ("line", "speed", "load", "feed") if cuts else ("speed", "load")
    there = set(log.item)
    for part in needed:
        if getattr(items, part) not in there:
            listed = ", ".join(sorted(map(str, there))) or "nothing"
            raise ValueError(
                f"{name} has no data item {getattr(items, part)!r}, which "
                f"cutting_records.spindle.items.{part} names (it has {listed}): correct the name, "
                "or let the adapter log it"
            )
    period = _period(log, [getattr(items, part) for part in needed], name)
    times = np.arange(0.0, log.time[-1] + period / 2, period)
    line = log.held(items.line, times)
    return Readings(
        period=period, times=times, line=np.where(np.isfinite(line), line, -1).astype(np.int64),
        speed=log.held(items.speed, times) / 60, load=log.held(items.load, times),
        feed=np.abs(log.held(items.feed, times)) * METRE,
    )  # fmt: skip


def _period(log: LogItems, items: list[str], name: str) -> float:
    """Period of the polls [s]: the quick changes of the item that changes most often."""
    each = [np.diff(np.unique(log.times(item))) for item in items]
    quick = [float(np.quantile(steps, QUICK)) for steps in each if len(steps)]
    if not quick:
        raise ValueError(f"{name} holds one moment only: log the spindle while it turns")
    period = float(np.clip(min(quick), FASTEST, SLOWEST))
    if log.time[-1] / period > MOST:
        raise ValueError(
            f"{name} lasts {log.time[-1] / 3600:.0f} h, more than {MOST} samples of {period:g} s: "
            "cut the part out of it in which the test ran"
        )
    return period


SLACK = 3.0
"""Periods of the log by which the sum of speeds may differ from a line's path length: both ends are
logged late."""
SHARE = 0.02
"""Share of the path length by which it may differ besides [1]."""
CONCLUSIVE = 8.0
"""Periods that a line must last for its path length to be conclusive."""
AGREE = 0.75
"""Share of the conclusive lines whose path length must match the program [1]."""
STEADY = 0.02
"""Share by which the feed may differ from the median of its cut [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _LineRuns:
    """V runs of readings in one line each, of T readings."""

    first: Ints
    """First reading of each run, and T; shape (V + 1,)."""
    line: Ints
    """Line; 0 outside of the program; shape (V,)."""
    programmed: Floats
    travelled: Floats
    """Path length of the line by the program and by the log [m]; shape (V,)."""
    per_period: Floats
    """Path length of one period at the highest speed [m]; shape (V,)."""
    fed: Bools
    """Whether it is a line of the program without rapids; shape (V,)."""

    @property
    def matching(self) -> Bools:
        """Whether the log's path length matches the program's; shape (V,)."""
        allowed = SLACK * self.per_period + SHARE * self.programmed
        return np.abs(self.programmed - self.travelled) <= allowed

    @property
    def conclusive(self) -> Bools:
        """Whether the path length is conclusive; shape (V,)."""
        long: Bools = np.maximum(self.programmed, self.travelled) > CONCLUSIVE * self.per_period
        return long & self.fed & (self.per_period > 0)


def no_load_log(log: Readings, settle_s: float) -> LoadLog:
    """The log of a spindle without load, as one of cuts that remove nothing.

    Acceleration takes the motor's full power, a hundred times what is read after it: the speed has
    been held for ``settle_s`` [s] where a level begins, which settles once more by itself.
    """
    cut = runs(settled(log.times, log.speed, settle_s=settle_s))
    none = np.zeros(len(cut))
    return LoadLog(
        times=log.times, speed=log.speed, load=log.load, cut=cut, removal=none, edge=none
    )


def cut_log(log: Readings, lines: Lines, *, settle_s: float, name: str, program: str) -> LoadLog:
    """The log with the cut in which each reading was taken.

    Cuts are stretches of one engagement and one feed; where the spindle turns in lines that are
    wholly in air, the reading is one without load, as of :func:`no_load_log`.

    ``settle_s`` [s] is how long speed and air must have been the same where a level without a cut
    begins; ``name`` and ``program`` are for messages. ValueError when the log is not of this
    program.
    """
    line_runs = _line_runs(log, lines)
    _check_program(log, lines, line_runs, name, program)
    cut = runs(_in_air(log, lines, line_runs, settle_s))
    number = int(cut.max(initial=-1)) + 1
    area, edge = np.zeros(len(cut)), np.zeros(len(cut))
    step = np.nan_to_num(log.feed) * log.period
    for k in np.flatnonzero(line_runs.matching & line_runs.conclusive).tolist():
        here = slice(int(line_runs.first[k]), int(line_runs.first[k + 1]))
        difference = line_runs.programmed[k] - line_runs.travelled[k]
        position = np.cumsum(step[here]) - step[here] + difference / 2
        uncertainty = float(abs(difference) / 2 + line_runs.per_period[k])
        for one in lines.stretches.get(int(line_runs.line[k]), ()):
            run = runs(_steady_within(one, position, uncertainty, log.feed[here]))
            rows = np.flatnonzero(run >= 0) + here.start
            cut[rows] = number + run[run >= 0]
            area[rows], edge[rows] = one.area, one.edge
            number += int(run.max(initial=-1)) + 1
    return LoadLog(
        times=log.times, speed=log.speed, load=log.load, cut=cut,
        removal=area * np.nan_to_num(log.feed), edge=edge * np.abs(np.nan_to_num(log.speed)),
    )  # fmt: skip


def unused_lines(log: Readings, lines: Lines, labelled: LoadLog, shortest_s: float) -> list[int]:
    """Lines of constant engagement in the log of which no reading is used.

    They ran otherwise than programmed, or at one feed for less than ``shortest_s`` [s].
    """
    logged = [number for number in sorted(lines.stretches) if (log.line == number).any()]
    cutting = (labelled.cut >= 0) & (labelled.removal > 0.0)
    long_enough = np.bincount(labelled.cut[cutting], minlength=1) * log.period >= shortest_s
    used = set(log.line[cutting][long_enough[labelled.cut[cutting]]].tolist())
    return [number for number in logged if number not in used]


def _line_runs(log: Readings, lines: Lines) -> _LineRuns:
    line = np.where((log.line > 0) & (log.line < len(lines.length)), log.line, 0)
    begins = np.diff(line, prepend=-1) != 0
    first = np.flatnonzero(begins)
    feed = np.nan_to_num(log.feed)
    return _LineRuns(
        first=np.append(first, len(line)), line=line[first], programmed=lines.length[line[first]],
        travelled=np.add.reduceat(feed, first) * log.period,
        per_period=np.maximum.reduceat(feed, first) * log.period,
        fed=(line[first] > 0) & ~lines.rapid[line[first]],
    )  # fmt: skip


def _check_program(
    log: Readings, lines: Lines, line_runs: _LineRuns, name: str, program: str
) -> None:
    highest = int(log.line.max())
    if highest >= len(lines.length):
        raise ValueError(
            f"{name} is not of {program}: it was in line {highest}, the program's last is "
            f"{len(lines.length) - 1}; name the program that ran"
        )
    conclusive = line_runs.conclusive
    if not conclusive.any():
        raise ValueError(
            f"{name} stays in no line of {program} long enough to tell where the tool is: log the "
            "line more often, or cut longer passes"
        )
    if line_runs.matching[conclusive].mean() < AGREE:
        worst = int(np.argmax(np.abs(line_runs.programmed - line_runs.travelled) * conclusive))
        raise ValueError(
            f"{name} is not of {program}: in line {line_runs.line[worst]} it went "
            f"{1e3 * line_runs.travelled[worst]:.0f} mm, the program "
            f"{1e3 * line_runs.programmed[worst]:.0f} mm; name the program that ran"
        )


def _in_air(log: Readings, lines: Lines, line_runs: _LineRuns, settle_s: float) -> Bools:
    """Readings of a spindle without load at one speed for ``settle_s``."""
    free = (line_runs.line > 0) & ~lines.cuts[line_runs.line]
    air = np.repeat(free, np.diff(line_runs.first))
    last = np.maximum.accumulate(np.where(air, -np.inf, log.times))  # reading that was not in air
    since: Bools = air & (log.times - last >= settle_s)
    return since & settled(log.times, log.speed, settle_s=settle_s)


def _steady_within(one: Stretch, position: Floats, uncertainty: float, feed: Floats) -> Bools:
    """Readings of a line certainly within the stretch, at the median feed there."""
    inside = (
        (position - uncertainty >= one.begin) & (position + uncertainty <= one.end) & (feed > 0)
    )
    if not inside.any():
        return np.zeros(len(position), dtype=np.bool_)
    median = float(np.median(feed[inside]))
    return inside & (np.abs(feed - median) <= STEADY * median)
