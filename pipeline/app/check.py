"""Two programs by hand: the proof that they differ in F and S alone, and F and S that leave the
range of a tool.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.app.cut import read_tools
from pipeline.app.programs import check_program, machine_setup, setup_beside
from pipeline.cutting.catalogue import CuttingRange
from pipeline.cutting.tool import Tool
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import FeedMode, Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.problem.arrays import Rows
from pipeline.optimisation.proof.prove import Proof, prove
from pipeline.optimisation.text.modal_words import LineRuns, at_speed, cuts_at_feed

ADDED = "-"
NEAR = 1e-3
"""Rounding of words, as a share."""


def check_programs(
    before: Path, after: Path, machine: str | None, dialect: str | None, *, splits: bool = False
) -> Proof:
    """Compare two programs with the set-up of ``machine``, read in ``dialect``.

    Subprograms of both are searched in the folder of ``before``.  With ``splits`` the second may
    have more points on the path of straight cuts.

    Raises
    ------
    ValueError
        When a file does not exist or cannot be followed, or there is no such machine or dialect.
    """
    setup = setup_beside(machine_setup(machine, dialect), before)
    for path in (before, after):
        check_program(path)
    texts = before.read_bytes(), after.read_bytes()
    return prove(*texts, before.name, after.name, setup, splits=splits)


def check_lines(proof: Proof, before: Path, after: Path) -> Iterator[str]:
    """Lines that ``kerf check`` prints: words that differ, how many, and the proof's hash."""
    if proof.differences:
        yield f"{'line':>8}  {before.name} -> {after.name}"
    for change in proof.differences:
        yield f"{change.line:>8}  {change.before or ADDED:<12} -> {change.after}"
    counts = [
        f"{sum(c.letter == letter and (c.before is None) == added for c in proof.differences)} "
        f"{letter} {'added' if added else 'changed'}"
        for letter in "FS"
        for added in (False, True)
    ]
    if proof.points:
        counts.append(f"{proof.points} points put in")
    yield ", ".join(counts)
    if proof.first is not None:
        yield f"not the same, first in line {proof.first.line}: {proof.first.reason}"
        yield f"  {before.name}: {proof.first.before}"
        yield f"  {after.name}: {proof.first.after}"
        return
    but = ", but for feed and speed" if proof.differences else ""
    yield f"{proof.moves} moves are the same to the last bit{but}"
    yield f"proof sha256 {proof.sha256}"


def tool_range(tool: Tool) -> CuttingRange:
    """What a tool may be given, where it is known: its own in the tool table."""
    f_z, v_c = (
        None if span is None else (span[0], span[1])
        for span in (tool.feed_per_tooth_mm, tool.cutting_speed_m_min)
    )
    return CuttingRange(feed_per_tooth_mm=f_z, cutting_speed_m_min=v_c, source="the tool table")


def range_lines(
    before: Path, after: Path, machine: str | None, dialect: str | None, tool_table: str
) -> Iterator[str]:
    """Lines of AFTER whose F or S is not that of BEFORE and leaves the range of the tool.

    Cuts at feed count, with the F and S in force; feeds of threads, cycles of tapping and G93 are
    no feeds a tooth.

    Raises
    ------
    ValueError
        When the tool table cannot be read, or a program cannot be followed.
    """
    setup = setup_beside(machine_setup(machine, dialect), before)
    tools = read_tools(tool_table).tools
    old, new = (_moves(path, setup) for path in (before, after))
    known = set(_in_force(old, np.arange(len(old))))
    rows = _cuts(new)
    said: set[str] = set()
    silent: dict[int, str] = {}
    for row, key in zip(rows.tolist(), _in_force(new, rows), strict=True):
        number = int(new.tool[row])
        if number not in tools:
            silent[number] = "is not in the tool table"
            continue
        limits = tool_range(tools[number])
        if limits.feed_per_tooth_mm is None and limits.cutting_speed_m_min is None:
            silent[number] = f"has no range in {limits.source}"
            continue
        if key in known:
            continue
        for line in _outside(new, row, tools[number], limits):
            if line not in said:
                said.add(line)
                yield line
    for number, why in sorted(silent.items()):
        yield f"not judged: T{number} {why}"


def _moves(path: Path, setup: Setup) -> Moves:
    return interpret(parse_program(path.read_bytes(), path.name), setup)


def _cuts(moves: Moves) -> Rows:
    """Rows at feed with a turning spindle and a tool, whose S is a speed and F a feed."""
    runs = LineRuns.among(moves)
    plain = cuts_at_feed(moves) & at_speed(moves) & ~moves.constant_surface_speed
    return np.flatnonzero(plain & ~runs.taps[runs.of] & (moves.tool >= 0))


def _in_force(moves: Moves, rows: Rows) -> Iterator[tuple[float, ...]]:
    """File, line, tool, F and S of rows."""
    columns = (moves.file, moves.line, moves.tool, moves.feed, moves.speed)
    return zip(*(column[rows].tolist() for column in columns), strict=True)


def _outside(moves: Moves, row: int, tool: Tool, limits: CuttingRange) -> Iterator[str]:
    """What of a row is outside of the range of its tool."""
    feed, speed = float(moves.feed[row]), float(moves.speed[row])
    per_turn = moves.feed_mode[row] == FeedMode.PER_REVOLUTION
    f_z = feed / tool.flutes / (1.0 if per_turn else speed)
    v_c = np.pi * tool.diameter * speed
    where = f"line {moves.line[row]}, T{moves.tool[row]}"
    if moves.file[row]:
        where = f"{Path(moves.files[moves.file[row]]).name} {where}"
    for word, value, span, unit in (
        (f"F{feed:g} at S{speed:g}", f_z, limits.feed_per_tooth_mm, "mm a tooth"),
        (f"S{speed:g}", v_c, limits.cutting_speed_m_min, "m/min"),
    ):
        if span is not None and not span[0] * (1 - NEAR) <= value <= span[1] * (1 + NEAR):
            yield (
                f"warning: {where}: {word} is {value:.3g} {unit}, outside of {span[0]:g} to "
                f"{span[1]:g} of {limits.source}"
            )
