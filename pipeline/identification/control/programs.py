"""Which program a run executed: found from where the log saw tools change, and from its feeds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.identification.control.runs import Run, Series

CUTTING = (Kind.FEED, Kind.ARC, Kind.THREAD)
STEADY = 0.005
"""Two readings of the feed, one after the other, that differ by less than this share are steady."""
LAG = 0.25
"""How much later than the machine a polled line may be [s]."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """Lines of a run that are lines of a program: program's line = run's line - ``shift``.

    Parameters
    ----------
    first, last : int
        Of the run.
    shift : int
        0 where the run is of this very program.
    """

    first: int
    last: int
    shift: int


@dataclass(frozen=True, kw_only=True)
class Match:
    """A run and the program that it executed.

    ``program`` is None where none fits; ``reason`` says in one sentence why, or why only some
    ``sections`` of it do.
    """

    run: Run
    program: str | None
    sections: tuple[Section, ...] = ()
    reason: str = ""

    @property
    def whole(self) -> bool:
        """Whether all of the run is of the program as it is there."""
        return self.program is not None and not self.reason

    def parts(self) -> list[Run]:
        """The matched sections as runs, their lines numbered as in the program."""
        return [self.run] if self.whole else [_part(self.run, s) for s in self.sections]


def match(run: Run, programs: Mapping[str, Moves]) -> Match:
    """The program of ``programs`` that ``run`` executed.

    It must have a tool change to the same tool wherever the log saw one, and no line beyond its
    last may have been seen.  Where several do (posts of one part with other feeds), it is the one
    whose programmed feeds the readings repeat with the least spread.  A run of another revision, in
    which the tools are changed in the same order at other lines, is matched in those sections
    between tool changes that are as long in both.
    """
    last = {name: int(moves.line.max(initial=0)) for name, moves in programs.items()}
    seen = int(run.line.value.max(initial=0))
    fitting = [n for n, m in programs.items() if seen <= last[n] and _tools_agree(run, m)]
    if fitting:
        spread = {name: _spread(run, programs[name]) for name in fitting}
        best = min(fitting, key=lambda name: (spread[name], name))
        return Match(run=run, program=best, sections=(Section(first=1, last=last[best], shift=0),))
    revisions = {n: found for n, m in programs.items() if (found := _sections(run, m, last[n]))}
    why = _why_none(run, programs, last, seen)
    if not revisions:
        return Match(run=run, program=None, reason=why)
    best = max(revisions, key=lambda name: (sum(s.last - s.first for s in revisions[name]), name))
    return Match(run=run, program=best, sections=revisions[best], reason=why)


def _sections(run: Run, moves: Moves, last: int) -> tuple[Section, ...]:
    """Sections of another revision that are as long as in the program."""
    rows = moves.kind == Kind.TOOL_CHANGE
    ours = list(zip(moves.line[rows].tolist(), moves.tool[rows].tolist(), strict=True))
    theirs = tool_changes(run)
    ours = ours[len(ours) - len(theirs) :]  # the log may have missed the first
    if not theirs or [tool for _, tool in ours] != [tool for _, tool in theirs]:
        return ()
    ends = [line for line, _ in theirs[1:]], [line for line, _ in ours[1:]]
    run_last = int(run.line.value.max())
    sections = []
    for (line, _), (mine, _), end, my_end in zip(
        theirs, ours, [*ends[0], run_last], [*ends[1], last], strict=True
    ):
        # polling may miss the very last line
        alike = end - line == my_end - mine or (end == run_last and 0 <= my_end - mine - (end - line) <= 1)
        if alike:
            sections.append(Section(first=line, last=end, shift=line - mine))
    return tuple(sections) if run.completed else ()


def _part(run: Run, section: Section) -> Run:
    line = run.line
    inside = (line.value >= section.first) & (line.value <= section.last)
    begin = float(line.time[inside].min())
    later = line.time[line.value > section.last]
    end = float(later.min()) if len(later) else run.end
    series = {
        name: getattr(run, name).within(begin, end)
        for name in ("feed", "speed", "tool", "feed_override", "rapid_override")
    }
    keep = inside & (line.time >= begin) & (line.time <= end)
    return replace(
        run,
        start=begin,
        end=end,
        completed=run.completed and not len(later),
        line=Series(time=line.time[keep], value=line.value[keep] - section.shift),
        held=tuple((a, b) for a, b in run.held if b > begin and a < end),
        **series,
    )


def _why_none(run: Run, programs: Mapping[str, Moves], last: dict[str, int], seen: int) -> str:
    changes = ", ".join(f"T{tool} at line {line}" for line, tool in tool_changes(run)) or "none"
    longest = max(last.values(), default=0)
    return (
        f"{run.name}: no program of the machine fits (lines up to {seen} and tool changes "
        f"{changes} were seen; {len(programs)} programs of up to {longest} lines are there): "
        "put the program that ran beside the log"
    )


def tool_changes(run: Run) -> list[tuple[int, int]]:
    """Line and tool wherever the log saw a new tool.

    The line is that of the poll that saw the spindle without a tool; where none did, the one in
    force before the poll that saw the new tool, which may have seen the next line as well.
    """
    found = []
    empty: float | None = None
    for time, tool in zip(run.tool.time.tolist(), run.tool.value.tolist(), strict=True):
        if time <= run.start:
            continue
        if tool <= 0:
            empty = time
            continue
        moment = empty if empty is not None else float(np.nextafter(time, -np.inf))
        found.append((int(run.line.at(np.array([moment]), before=0.0)[0]), int(tool)))
        empty = None
    return found


def _tools_agree(run: Run, moves: Moves) -> bool:
    rows = moves.kind == Kind.TOOL_CHANGE
    programmed = dict(zip(moves.line[rows].tolist(), moves.tool[rows].tolist(), strict=True))
    return all(programmed.get(line) == tool for line, tool in tool_changes(run) if line > 0)


def feed_of_lines(moves: Moves) -> NDArray[np.float64]:
    """Feed of each line [mm/s], NaN where it does not cut; index 0 is no line."""
    feed = np.full(int(moves.line.max(initial=0)) + 1, np.nan)
    rows = np.isin(moves.kind, CUTTING) & (moves.feed_mode == FeedMode.PER_MINUTE)
    rows &= moves.feed > 0
    feed[moves.line[rows]] = moves.feed[rows] / 60
    return feed


def steady_ratios(
    run: Run, moves: Moves, *, arcs: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Steady readings of the feed on straight cuts: the line, and the share of its feed.

    On arcs, read with ``arcs``, the control may settle at what their curvature allows.  A reading
    counts when the one before it agrees and both were taken while lines that cut were executed,
    since a while.
    """
    programmed = feed_of_lines(moves)
    wanted = np.zeros(len(programmed), dtype=bool)
    wanted[moves.line[np.isin(moves.kind, (Kind.FEED, Kind.ARC) if arcs else Kind.FEED)]] = True
    feed = run.feed.polled()
    time = feed.time
    lines = run.line.at(time, before=0.0).astype(np.int64)
    lines = np.where((lines >= 0) & (lines < len(programmed)), lines, 0)
    earlier = run.line.at(time - LAG, before=0.0).astype(np.int64)
    earlier = np.where((earlier >= 0) & (earlier < len(programmed)), earlier, 0)
    ratio = feed.value / programmed[lines]
    ratio[~np.isfinite(programmed[earlier])] = np.nan
    before = np.concatenate([[np.nan], ratio])[:-1]
    steady = (np.abs(ratio - before) < STEADY * before) & wanted[lines]
    return lines[steady], ratio[steady]


def _spread(run: Run, moves: Moves) -> float:
    """How far steady readings lie from the programmed feeds times one factor: a robust spread."""
    _, ratio = steady_ratios(run, moves)
    ratio = ratio[ratio > 0]
    if len(ratio) < 3:
        return np.inf
    logs = np.log(ratio)
    return float(np.mean(np.abs(logs - np.median(logs))) + 0.1 * abs(np.median(logs)))
