"""Checks of programs: against the machine (`kerf preflight`), and two of them (`kerf check`).

Two programs are proved to be equal but for F and S; F and S out of range are warned of.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.app.cut import REMEDY
from pipeline.app.fleet import machine_parameters
from pipeline.app.programs import (
    check_program,
    machine_limits,
    machine_setup,
    read_moves,
)
from pipeline.app.tables import read_catalogue, read_material, read_tools, section
from pipeline.cutting.catalogue import (
    OPERATIONS,
    CuttingCatalogue,
    CuttingRange,
    Operation,
    listed_range,
    tool_range,
)
from pipeline.cutting.economics.material import Material
from pipeline.cutting.engagement.stock import height_map, stock_of
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import METRE, FeedMode, Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup, setup_beside
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.operations import MAY_BE, operations_without_cut
from pipeline.optimisation.proof.prove import Proof, proved
from pipeline.optimisation.settings import Part
from pipeline.optimisation.text.editable_blocks import LineRuns, at_speed, cuts_at_feed
from pipeline.optimisation.text.words import FeedWords
from pipeline.schema.arrays import Bools, Rows
from pipeline.schema.limits import MachiningPractice
from pipeline.twin.cut.loads import CHORD, rapid_speeds
from pipeline.twin.cut.path import cutting_path
from pipeline.twin.preflight import (
    IN_MATERIAL,
    Preflight,
    clearance_not_checked,
    contact_violations,
    preflight,
    rapid_violations,
    violation_lines,
)

ADDED = "-"
NEAR = 1e-3
"""Rounding of words, as a share."""
LONGEST = 160
"""Characters of a line that are shown."""
TABLE = "the tool table"
NO_BLANK = "not checked: shank and holder against the part (give --stock and --tool-table)"


def check_programs(
    before: Path, after: Path, machine: str | None, dialect: str | None, *, splits: bool = False
) -> tuple[Proof, tuple[Moves, Moves] | None]:
    """Proof and moves of two programs with the set-up of ``machine``, read in ``dialect``.

    No moves where the texts differ in more than F and S.  Subprograms of both are searched beside
    ``before``.  With ``splits`` the second may have more points on the path of straight cuts.
    """
    setup = setup_beside(machine_setup(machine, dialect), before)
    for path in (before, after):
        check_program(path)
    texts = before.read_bytes(), after.read_bytes()
    return proved(*texts, before.name, after.name, setup, splits=splits)


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
        yield f"  {before.name}: {_printable(proof.first.before)}"
        yield f"  {after.name}: {_printable(proof.first.after)}"
        return
    but = ", but for feed and speed" if proof.differences else ""
    yield f"{proof.moves} moves are the same to the last bit{but}"
    yield f"proof sha256 {proof.sha256}"


def _printable(text: str) -> str:
    """Beginning of a line as a terminal may show it, its control characters escaped."""
    shown = text if len(text) <= LONGEST else f"{text[:LONGEST]} …"
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in shown)


def range_lines(
    after: Path, moves: tuple[Moves, Moves], tool_table: str, material: str | None = None
) -> Iterator[str]:
    """Lines of AFTER whose changed F or S leaves the range of the tool.

    Cuts at feed count, but for threads, tapping and G93.  Without a range in the tool table that of
    the catalogue for ``material`` counts: of the known operation, else the widest of all milling.
    """
    tools = read_tools(tool_table).tools
    data = None if material is None else (read_catalogue(), read_material(material))
    program, (old, new) = parse_program(after.read_bytes(), after.name), moves
    lines = len(old) == len(new)
    known = set(in_force(old, np.arange(len(old)), lines=lines))
    known_speeds = {speed_of(key) for key in known}
    told = operations_without_cut(program, new, tools).code
    written = FeedWords(program, new).written(new.feed)
    limits_of = cache(partial(_limits, tools, data))
    rows = _cuts(new)
    said: set[str] = set()
    silent: set[tuple[int, str]] = set()
    for row, key in zip(rows.tolist(), in_force(new, rows, lines=lines), strict=True):
        number = int(new.tool[row])
        limits = limits_of(number, OPERATIONS[told[row]])
        if limits.why_not:
            silent.add((number, limits.why_not))
            continue
        if key in known:
            continue
        new_speed = speed_of(key) not in known_speeds
        for line in _outside(
            new, row, tools[number], limits, word=f"F{written[row]:g}", new_speed=new_speed
        ):
            if line not in said:
                said.add(line)
                yield line
    for number, why in sorted(silent):
        yield f"not judged: T{number} {why}"


@dataclass(frozen=True, kw_only=True)
class _Limits:
    """Ranges of a tool's feed and speed, with their source and the reason of a missing one."""

    range: CuttingRange | None = None
    feed_of: str = TABLE
    speed_of: str = TABLE
    why_not: str = ""


def _limits(
    tools: Mapping[int, Tool], data: tuple[CuttingCatalogue, Material] | None,
    number: int, told: Operation,
) -> _Limits:  # fmt: skip
    """Ranges of the tool table, else those of the catalogue common to every operation of a row."""
    if number not in tools:
        return _Limits(why_not=f"is not in {TABLE}")
    tool = tools[number]
    listed = None if data is None else listed_range(*data, tool, MAY_BE.get(told, (told,)))
    found = tool_range(tool, listed)
    if found.feed_per_tooth_mm is None and found.cutting_speed_m_min is None:
        why = f"has no range in {TABLE}"
        if data is not None:
            why = f"{why}, and the catalogue has {data[0].why_not(tool, data[1], told)}"
        return _Limits(why_not=why)
    catalogue = "" if listed is None else f"the catalogue ({listed.source})"
    return _Limits(
        range=found,
        feed_of=catalogue if tool.feed_per_tooth_mm is None else TABLE,
        speed_of=catalogue if tool.cutting_speed_m_min is None else TABLE,
    )


def _cuts(moves: Moves) -> Rows:
    runs = LineRuns.among(moves)
    plain = cuts_at_feed(moves) & at_speed(moves) & ~moves.constant_surface_speed
    return np.flatnonzero(plain & ~runs.taps[runs.of] & (moves.tool >= 0))


def in_force(moves: Moves, rows: Rows, *, lines: bool = True) -> Iterator[tuple[float, ...]]:
    """File, line, tool, F and S of rows; without ``lines`` all stand in line 0."""
    line = moves.line if lines else np.zeros_like(moves.line)
    columns = (moves.file, line, moves.tool, moves.feed, moves.speed)
    return zip(*(column[rows].tolist() for column in columns), strict=True)


def speed_of(key: tuple[float, ...]) -> tuple[float, ...]:
    """File, line, tool and S of what :func:`in_force` gives."""
    return *key[:3], key[4]


def place(moves: Moves, row: int) -> str:
    """Line and tool of a row, with its file where that is not the program's own."""
    where = f"line {moves.line[row]}, T{moves.tool[row]}"
    if moves.file[row]:
        return f"{Path(moves.files[moves.file[row]]).name} {where}"
    return where


def _outside(
    moves: Moves, row: int, tool: Tool, limits: _Limits, *, word: str, new_speed: bool
) -> Iterator[str]:
    """Values of a row outside of the range of its tool; S only where it is another one."""
    known = limits.range
    if known is None:
        return
    feed, speed = float(moves.feed[row]), float(moves.speed[row])
    per_turn = moves.feed_mode[row] == FeedMode.PER_REVOLUTION
    f_z = feed / tool.flutes / (1.0 if per_turn else speed)
    v_c = np.pi * tool.diameter * speed
    where = place(moves, row)
    for said, value, span, unit, whose in (
        (f"{word} at S{speed:g}", f_z, known.feed_per_tooth_mm, "mm/tooth", limits.feed_of),
        (f"S{speed:g}", v_c, known.cutting_speed_m_min if new_speed else None, "m/min",
         limits.speed_of),
    ):  # fmt: skip
        if span is not None and not span[0] * (1 - NEAR) <= value <= span[1] * (1 + NEAR):
            yield (
                f"warning: {where}: {said} is {value:.3g} {unit}, outside of {span[0]:g} to "
                f"{span[1]:g} of {whose}"
            )


def machine_lines(after: Path, moves: tuple[Moves, Moves]) -> Iterator[str]:
    """Warnings of F and S that changed by more than the default factor of ``kerf optimise``."""
    program, (old, new) = parse_program(after.read_bytes(), after.name), moves
    fed = cuts_at_feed(new)
    turns = at_speed(new) & ~new.constant_surface_speed & (new.length > 0)
    if len(old) == len(new):  # with points put in, rows are not each other’s
        yield from _far(old, new, (fed, turns), FeedWords(program, new))


def _far(old: Moves, new: Moves, rows: tuple[Bools, Bools], words: FeedWords) -> Iterator[str]:
    """F and S that changed by more than the default change."""
    low, high = MachiningPractice().change
    then, now = words.written(old.feed), words.written(new.feed)
    for letter, own, value, mine in (
        ("F", then, now, rows[0]), ("S", old.speed, new.speed, rows[1]),
    ):  # fmt: skip
        ratio = np.divide(value, own, out=np.ones(len(own)), where=mine & (own > 0))
        far = (ratio > high * (1 + NEAR)) | (ratio < low * (1 - NEAR))
        for found in _alike(np.flatnonzero(far), own, value):
            first = found[0]
            yield (
                f"warning: {_where(new, found)}: {letter}{own[first]:g} became "
                f"{letter}{value[first]:g}, ×{ratio[first]:.3g}, outside of ×{low:g} to "
                f"×{high:g}: look whether it is meant"
            )


def _alike(rows: Rows, *values: np.ndarray) -> Iterator[Rows]:
    """Rows of equal values, in the order of the first of each."""
    found: dict[tuple[float, ...], list[int]] = {}
    for row in rows.tolist():
        found.setdefault(tuple(float(one[row]) for one in values), []).append(row)
    for alike in found.values():
        yield np.array(alike, dtype=np.intp)


def _where(moves: Moves, rows: Rows) -> str:
    more = len(set(moves.line[rows].tolist())) - 1
    others = f" and {more} more line{'s' * (more > 1)}" if more else ""
    return f"{place(moves, int(rows[0]))}{others}"


class Clearance(NamedTuple):
    """Options of the blank and the tools whose shanks and holders are held against it."""

    stock: str | None
    tool_table: str | None
    resolution: float | None
    work_offset: str | None

    @property
    def wanted(self) -> bool:
        """Whether more is given than tools, whose ranges `kerf check` looks at alone."""
        return any((self.stock, self.resolution, self.work_offset))


def preflight_program(
    path: Path, machine: str, dialect: str | None = None, *, beside: Path | None = None,
    clearance: Clearance | None = None, moves: Moves | None = None,
) -> Preflight:  # fmt: skip
    """Preflight of the program at ``path`` against ``machine``, and its tools' bodies.

    ``beside`` is a program whose folder is searched for subprograms too; ``moves`` are those of the
    program, where it was followed with this set-up before.
    """
    setup = machine_setup(machine, dialect)
    setup = setup if beside is None else setup_beside(setup, beside)
    sections = machine_parameters(machine)["machine"][machine]
    moves = read_moves(path, setup, lambda done: None) if moves is None else moves
    found = preflight(moves, setup, machine_limits(sections, setup))
    if clearance is None or not clearance.wanted:
        return found
    control = section(dict(sections), "control", ControlParameters)
    return _with_contacts(found, moves, setup, clearance, control)


def _with_contacts(
    found: Preflight, moves: Moves, setup: Setup, clearance: Clearance,
    control: ControlParameters | None,
) -> Preflight:  # fmt: skip
    if clearance.stock is None or clearance.tool_table is None:
        missing = "stock" if clearance.stock is None else "tool_table"
        raise ValueError(f"--{missing.replace('_', '-')} is missing: {REMEDY[missing]}")
    tools = read_tools(clearance.tool_table).tools
    resolution = (clearance.resolution or Part.resolution_mm) * METRE
    path = cutting_path(
        moves, sorted(tools), chord=CHORD * resolution, offsets=setup.work_offsets,
        offset=clearance.work_offset,
        rapid_speeds=None if control is None else rapid_speeds(control),
    )  # fmt: skip
    blank = height_map(stock_of(clearance.stock), resolution)
    at = moves, path, tools, blank
    met = (*found.violations, *contact_violations(*at), *rapid_violations(*at))
    return replace(found, violations=met, clearance=clearance_not_checked(moves, tools))


def preflight_lines(result: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and what was not checked, a line of text each."""
    yield from beyond_lines(result, program, machine)
    yield from not_checked_lines(result, machine)


def clearance_lines(result: Preflight) -> Iterator[str]:
    """Shanks and holders that were not checked against the part, in one line."""
    if result.clearance is None:
        yield NO_BLANK
    elif result.clearance:
        yield f"not checked: {'; '.join(result.clearance)}"


def beyond_lines(result: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and how many there are."""
    for said in violation_lines(result.violations):
        yield f"warning: {said}"
    met = sum(one.what in IN_MATERIAL for one in result.violations)
    for many, does in (
        (len(result.violations) - met, f"leaves the limits of {machine}"),
        (met, "brings a shank, a holder or a rapid into the part"),
    ):
        if many:
            yield (
                f"warning: {program.name} {does} {many} time{'s' * (many > 1)}: do not run it as "
                "it is"
            )


def not_checked_lines(result: Preflight, machine: str) -> Iterator[str]:
    """Limits that the machine's file does not list, in one line."""
    if result.not_checked:
        yield (
            f"not listed in conf/machine/{machine}.yaml, not checked: "
            f"{'; '.join(result.not_checked)}"
        )
