"""Programs of a machine, and which of them a run executed: by its tool changes and its feeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.schema.arrays import Bools
from pipeline.submodels.control.runs import Run, Series, read_runs, steady_ratios
from pipeline.twin.control import ControlRecords, program_moves
from pipeline.twin.preflight import path_feed

LATE = 1.0
"""Cuts before the first line and after the last that a log saw of a whole run are shorter [s]."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """Lines of a run that are lines of a program: program's line = run's line - ``shift``."""

    first: int
    last: int
    """First and last line of the run."""
    shift: int
    """0 where the run is of this very program."""


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

    @property
    def left_out(self) -> str:
        """Why the run, or what of it, is left out."""
        if self.program is None:
            return self.reason
        lines = [f"{one.first} to {one.last}" for one in self.sections]
        shown = ", ".join(lines[:3]) + (f" and {len(lines) - 3} more" if len(lines) > 3 else "")
        return f"all but lines {shown}, which are as in {self.program}: {self.reason}"

    def parts(self) -> list[Run]:
        """The matched sections as runs, their lines numbered as in the program."""
        return [self.run] if self.whole else [_part(self.run, s) for s in self.sections]


def match(run: Run, programs: Mapping[str, Moves]) -> Match:
    """The program of ``programs`` that ``run`` executed.

    It must have a tool change to the same tool wherever the log saw one, and no line beyond its
    last may have been seen; a run that completed must have come to its last cut, and seen its
    tools.  Where several do (posts of one part with other feeds), it is the one
    whose programmed feeds the readings repeat with the least spread.  A run of another revision, in
    which the tools are changed in the same order at other lines, is matched in those sections
    between tool changes that are as long in both.  Programs that jump (subprograms, loops) are left
    out: the number of a line does not tell where in them a machine is.
    """
    known = {name: moves for name, moves in programs.items() if _rises(moves)}
    seen = int(run.line.value.max(initial=0))
    fitting = [n for n, m in known.items() if seen <= _last(m) and _tools_agree(run, m)]
    short = {n: why for n in fitting if run.completed and (why := _why_short(run, n, known[n]))}
    if whole := [name for name in fitting if name not in short]:
        return _of_this_program(run, {name: known[name] for name in whole})
    why = _why_none(run, known, len(programs) - len(known)) if not short else min(short.values())
    revisions = {name: found for name, moves in known.items() if (found := _sections(run, moves))}
    if not revisions:
        return Match(run=run, program=None, reason=why)
    alike = {name: sum(s.last - s.first for s in found) for name, found in revisions.items()}
    longest = [name for name in revisions if alike[name] == max(alike.values())]
    spread = {n: sum(_spread(_part(run, s), known[n]) for s in revisions[n]) for n in longest}
    best = min(longest, key=lambda name: (spread[name], name))
    return Match(run=run, program=best, sections=revisions[best], reason=why)


def _of_this_program(run: Run, fitting: Mapping[str, Moves]) -> Match:
    """The one of the programs that fit whose feeds the run repeats, from where the log begins."""
    spread = {name: _spread(run, moves) for name, moves in fitting.items()}
    best = min(fitting, key=lambda name: (spread[name], name))
    if not np.isfinite(spread[best]) and not _alike(list(fitting.values())):
        return Match(run=run, program=None, reason=_why_several(run, sorted(fitting)))
    entered = _entered(run, fitting[best])
    return Match(
        run=run,
        program=best,
        sections=(Section(first=entered, last=_last(fitting[best]), shift=0),),
        reason=_why_late(run, best, entered) if entered > 1 else "",
    )


def _last(moves: Moves) -> int:
    """The last line that does something."""
    return int(moves.line.max(initial=0))


def _rises(moves: Moves) -> bool:
    """Whether each line is executed once and in order, all of one file."""
    return bool((np.diff(moves.line) >= 0).all() and (moves.file == moves.file[:1]).all())


def _alike(programs: Sequence[Moves]) -> bool:
    """Whether programs are copies of one another."""
    first = programs[0]
    return all(
        np.array_equal(other.line, first.line)
        and np.array_equal(other.kind, first.kind)
        and np.array_equal(other.end, first.end)
        and np.array_equal(other.feed, first.feed)
        for other in programs[1:]
    )


def _entered(run: Run, moves: Moves) -> int:
    """The first line seen, where the program cuts for a while before it; 1 otherwise."""
    seen = run.line.value[run.line.value > 0]
    if not len(seen):
        return 1
    return int(seen[0]) if _cutting_seconds(moves, moves.line < seen[0]) > LATE else 1


def _cutting_seconds(moves: Moves, among: Bools) -> float:
    """Path over programmed feed of the cuts ``among`` the rows [s]."""
    return float(np.nansum((moves.length / path_feed(moves))[among])) * 60


def _sections(run: Run, moves: Moves) -> tuple[Section, ...]:
    """Sections of another revision as long as in the program, from tool change to tool change."""
    theirs, ours = tool_changes(run), _programmed_changes(moves)
    ours = ours[max(len(ours) - len(theirs), 0) :]  # the log may have missed the first
    same_tools = [tool for _, tool in ours] == [tool for _, tool in theirs]
    if not run.completed or not theirs or not same_tools:
        return ()
    run_last = int(run.line.value.max())
    their_ends = [line for line, _ in theirs[1:]] + [run_last]
    our_ends = [line for line, _ in ours[1:]] + [_last(moves)]
    found = []
    for (line, _), (mine, _), end, my_end in zip(theirs, ours, their_ends, our_ends, strict=True):
        longer = (my_end - mine) - (end - line)
        # polling may miss the very last line
        if 0 < line < end and longer in ((0, 1) if end == run_last else (0,)):
            found.append(Section(first=line, last=end, shift=line - mine))
    return tuple(found)


def _part(run: Run, section: Section) -> Run:
    line = run.line
    inside = (line.value >= section.first) & (line.value <= section.last)
    begin = float(line.time[inside].min())
    later = line.time[(line.value > section.last) & (line.time > begin)]
    end = float(later.min()) if len(later) else run.end
    keep = inside & (line.time >= begin) & (line.time <= end)
    return replace(
        run.during(begin, end),
        completed=run.completed and not len(later),
        line=Series(time=line.time[keep], value=line.value[keep] - section.shift),
    )


def _why_none(run: Run, programs: Mapping[str, Moves], jumping: int) -> str:
    changes = ", ".join(f"T{tool} at line {line}" for line, tool in tool_changes(run)) or "none"
    longest = max((_last(moves) for moves in programs.values()), default=0)
    more = f", {jumping} more jump" if jumping else ""
    return (
        f"{run.name}: no program of the machine fits (lines up to {int(run.line.value.max())} and "
        f"tool changes {changes} were seen; {len(programs)} programs of up to {longest} lines are "
        f"there{more}): put the program that ran beside the log"
    )


def _why_short(run: Run, name: str, moves: Moves) -> str:
    """Reason why a completed run is not all of a program; a first tool change may be missing."""
    last, shown = int(run.line.value.max(initial=0)), set(run.tool.value.astype(int).tolist())
    changed = [tool for _, tool in _programmed_changes(moves)][1:]
    missing = sorted(set(changed) - shown) if any(tool > 0 for tool in shown) else []
    if not missing and _cutting_seconds(moves, moves.line > last) <= LATE:
        return ""
    tools = f" and never showed {', '.join(f'T{tool}' for tool in missing)}" if missing else ""
    return (
        f"{run.name}: the run says that it completed, but came to line {last} of {_last(moves)} of "
        f"{name}{tools}: no program of the machine is as short, put the one that ran beside the "
        "log, or log the whole run"
    )


def _why_late(run: Run, program: str, entered: int) -> str:
    return (
        f"{run.name}: the log begins at line {entered} of {program}, which cuts before it: "
        "start the log before the program"
    )


def _why_several(run: Run, fitting: Sequence[str]) -> str:
    return (
        f"{run.name}: {', '.join(fitting)} fit alike and no feed was steady long enough to "
        "tell which ran: log the feed, or leave only the program that ran beside the log"
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


def _programmed_changes(moves: Moves) -> list[tuple[int, int]]:
    rows = moves.kind == Kind.TOOL_CHANGE
    return list(zip(moves.line[rows].tolist(), moves.tool[rows].tolist(), strict=True))


def _tools_agree(run: Run, moves: Moves) -> bool:
    programmed = dict(_programmed_changes(moves))
    return all(programmed.get(line) == tool for line, tool in tool_changes(run) if line > 0)


def _spread(run: Run, moves: Moves) -> float:
    """Robust spread of steady readings about the programmed feeds times one factor."""
    _, ratio = steady_ratios(run, moves)
    logs: NDArray[np.float64] = np.log(ratio[ratio > 0])
    if len(logs) < 3:
        return np.inf
    return float(np.mean(np.abs(logs - np.median(logs))) + 0.1 * abs(np.median(logs)))


@dataclass(frozen=True, kw_only=True)
class Programs:
    """Programs of a machine: moves by file name, and why others could not be read."""

    moves: Mapping[str, Moves]
    refused: Mapping[str, str]


def read_programs(raw: Path, records: ControlRecords, setup: Setup) -> Programs:
    """Every part program below ``raw`` that ``records`` names."""
    moves: dict[str, Moves] = {}
    refused: dict[str, str] = {}
    for path in sorted(raw.glob(records.programs)):
        name = path.relative_to(raw).as_posix()
        try:
            moves[name] = program_moves(path, setup)
        except GcodeError as error:
            refused[name] = str(error)
    return Programs(moves=moves, refused=refused)


def read_matches(
    signals: Path,
    files: Mapping[str, Mapping[str, Any]],
    records: ControlRecords,
    items: Mapping[str, str],
    programs: Mapping[str, Moves],
) -> list[Match]:
    """Every run of a program in the recordings, in the order of their names."""
    found: list[Match] = []
    for name, entry in sorted(files.items()):
        if entry["output"] is None or not fnmatchcase(name, records.logs):
            continue
        runs = read_runs(signals / entry["output"], items, name)
        found += [match(run, programs) for run in runs]
    return found
