"""Interpreter of part programs: a program and the control's setup to moves, or to a restart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.calls import CallStack, Variables
from pipeline.gcode.codes.execution import block_of, carry_out
from pipeline.gcode.cutter_compensation import close_contour
from pipeline.gcode.dialects.siemens import SiemensReader
from pipeline.gcode.dialects.statement_parser import (
    parse_blocks,
    parse_statement,
    statement_from_tokens,
)
from pipeline.gcode.dialects.variables import FanucVariables, LinuxcncParameters, SiemensVariables
from pipeline.gcode.errors import GcodeError, refuse_foreign
from pipeline.gcode.fast_lines import run_fast_lines
from pipeline.gcode.flow import Flow
from pipeline.gcode.modal import CANCELLED, LINUXCNC, SIEMENS, g_code
from pipeline.gcode.moves import AXES, INCH, FeedMode, Kind, Moves, PathMode, Rows
from pipeline.gcode.program import Program
from pipeline.gcode.run import Block, Run
from pipeline.gcode.setup import Setup
from pipeline.gcode.statements import Statement

COOLANT = {7: "M7", 8: "M8", 9: "M9", 13: "M13", 14: "M14"}
"""M codes that switch coolant; 13 and 14 of a Fanuc with the spindle."""

LENGTHS = "RZQIJ"
"""Words of a canned cycle that are lengths."""


@dataclass(frozen=True, kw_only=True)
class Restart:
    """The state in force before a line, as words of the program's dialect."""

    line: int
    """Line of the program, the first time that it is reached."""
    words: dict[str, str]
    """State in force, by its name."""
    program: tuple[float, ...]
    machine: tuple[float, ...]
    """X Y Z A B C in program and in machine coordinates [mm, deg], lengths of ``program`` in the
    program's unit."""
    warnings: tuple[str, ...] = ()
    """Reasons why the program cannot simply go on from here."""


def restart_of(run: Run, line: int, *, inside: bool, modal: str = "") -> Restart:
    """State in force before a line, ``inside`` a subprogram or not; ``modal``: cycle of MCALL."""
    state = run.state
    return Restart(
        line=line,
        words=dict(_words(run)),
        program=tuple(
            round(value / (state.unit if axis < 3 else 1.0), 6)
            for axis, value in enumerate(run.point)
        ),
        machine=tuple(round(value, 6) for value in state.position),
        warnings=tuple(_warnings(run, inside, modal)),
    )


def _words(run: Run) -> Iterator[tuple[str, str]]:
    state = run.state
    siemens, inch = state.dialect == SIEMENS, state.unit == INCH
    metric, imperial = ("G71", "G70") if siemens else ("G21", "G20")
    yield "units", f"{imperial} (inch)" if inch else f"{metric} (mm)"
    yield "plane", f"G{state.plane}"
    yield "distance mode", "G90" if state.absolute else "G91"
    yield "work offset", list(run.frames)[state.frame].name
    yield "tool", "none yet" if state.tool < 0 else f"T{state.tool}"
    if state.selected >= 0 and state.selected != state.tool:
        yield "next tool", f"T{state.selected}"
    length = f" H{run.length_number}" if run.length_number and run.length_mode != 490 else ""
    yield "tool length", f"{g_code(run.length_mode)}{length}"
    radius = f" D{run.radius_number}" if state.cutter_compensation and run.radius_number else ""
    yield "cutter radius", f"G{state.cutter_compensation or 40}{radius}"
    turning = {1: "M3", -1: "M4"}.get(state.direction, "M5")
    surface = "G96 " if state.constant_surface_speed else ""
    yield "spindle", f"{surface}S{state.speed:g} {turning}"
    feed = state.feed if state.feed_mode == FeedMode.INVERSE_TIME else state.feed / state.unit
    yield "feed", f"G{state.feed_mode} F{feed:g}"
    yield "coolant", _coolant(run)
    yield "path", "G64" if state.path_mode == PathMode.CONTINUOUS else "G61"
    if run.cycle.code != CANCELLED:
        words = " ".join(
            f"{letter}{value / (state.unit if letter in LENGTHS else 1.0):g}"
            for letter, value in run.cycle.words.items()
        )
        yield "cycle", f"{g_code(run.cycle.code)} {'G99' if run.retract_to_r else 'G98'} {words}"
    elif state.motion != CANCELLED:
        yield "motion", g_code(state.motion)


def _coolant(run: Run) -> str:
    rows = run.rows.arrays
    found: set[str] = set()
    kinds, codes = rows["kind"][: run.rows.count], rows["code"][: run.rows.count]
    for code in codes[kinds == Kind.M_CODE].tolist():
        if code == 9:
            found.clear()
        elif code in COOLANT:
            found.add(COOLANT[code])
    return " ".join(sorted(found)) or "M9"


def _warnings(run: Run, inside: bool, modal: str) -> Iterator[str]:
    if run.state.cutter_compensation:
        yield "cutter radius compensation is on: restart before the line that begins it"
    if run.cycle.code != CANCELLED:
        yield "a canned cycle is in force: give all of its words again"
    if modal:
        yield f"MCALL {modal} is in force: call it again with its values"
    if run.modal_call is not None:
        yield "a modal macro call is in force: restart before it"
    if not run.state.absolute:
        yield "G91 is in force: move to the position in G90 first"
    if inside:
        yield "the line stands in a subprogram: its caller is not returned to from here"


def restart_lines(restart: Restart) -> Iterator[str]:
    """The state in words, a line of text each."""
    for warning in restart.warnings:
        yield f"warning: {warning}"
    yield f"in force before line {restart.line}:"
    for name, words in restart.words.items():
        yield f"  {name:<16} {words}"
    for name, point in (("position", restart.program), ("machine position", restart.machine)):
        moved = [(a, v) for i, (a, v) in enumerate(zip(AXES, point, strict=True)) if i < 3 or v]
        unit = " (mm)" if name != "position" else ""
        yield f"  {name:<16} {' '.join(f'{axis}{value:g}' for axis, value in moved)}{unit}"


REPORT_EVERY = 10_000
"""Blocks between two calls of ``progress``."""
FAST_LINES_AT_ONCE = 100_000
"""Fast lines executed before the limit of blocks is checked again."""
SPARE_ROWS = 64
"""Rows by which a program may exceed its lines before the columns are reallocated."""


def interpret(
    program: Program, setup: Setup, progress: Callable[[int], None] | None = None
) -> Moves:
    """Moves of a program from its first line to its end, in the machine's frame [mm, deg].

    ``progress`` gets the number of executed blocks.  Raises GcodeError at the first word that
    cannot be interpreted.
    """
    refuse_foreign(program.data, program.name, setup.dialect)
    return Interpreter(program, setup, progress).moves()


def interpret_in_parts(
    program: Program, setup: Setup, progress: Callable[[int], None] | None, rows: int
) -> Iterator[Moves]:
    """Moves of a program in parts that follow each other, for programs of any length.

    A part has ``rows`` rows at least; the last one may have fewer, or none.  Raises GcodeError at
    the first word that cannot be interpreted, after the parts before it.
    """
    refuse_foreign(program.data, program.name, setup.dialect)
    yield from Interpreter(program, setup, progress).parts(rows)


def restart_at(program: Program, setup: Setup, line: int) -> Restart:
    """The state before a line of a program.

    Raises ValueError when the program has no such line or never comes to it; GcodeError at the
    first word before it that cannot be interpreted.
    """
    if not 1 <= line <= len(program):
        raise ValueError(f"{program.name} has no line {line}: name one from 1 to {len(program)}")
    refuse_foreign(program.data, program.name, setup.dialect)
    interpreter = Interpreter(program, setup)
    if not interpreter.until(line):
        raise ValueError(f"{program.name} never comes to line {line}: name one that is executed")
    inside, siemens = len(interpreter.calls.levels) > 1, interpreter.siemens
    modal = siemens.memory.called if siemens is not None else ""
    return restart_of(interpreter.run, line, inside=inside, modal=modal)


VARIABLES: dict[str, Callable[[Run], Variables]] = {
    "fanuc": FanucVariables,
    "linuxcnc": LinuxcncParameters,
    "siemens": SiemensVariables,
}
"""Dialect -> class that stores its variables."""


def _reader(siemens: SiemensReader | None, setup: Setup) -> Callable[[Program, int], Statement]:
    """Reader of lines; no method of the interpreter, so that nothing keeps a read program."""
    if siemens is not None:
        return lambda source, line: siemens.statement(source.line(line), source.name)

    def read(source: Program, line: int) -> Statement:
        plain = statement_from_tokens(source, line)
        if plain is None and setup.dialect == "fanuc":
            return parse_blocks(source, line)
        return plain or parse_statement(source.line(line), source.name, setup.dialect)

    return read


class Interpreter:
    """Interpretation of one program.

    Fast lines are left to ``compiled`` code, or not; the moves are the same.

    Attributes
    ----------
    executed : ndarray of bool, shape (L + 1,)
        Lines of the program's own file that were carried out until now, that of line n is n.
    """

    def __init__(
        self, program: Program, setup: Setup, progress: Callable[[int], None] | None = None, *,
        compiled: bool = True,
    ) -> None:  # fmt: skip
        self.setup, self.progress, self.program = setup, progress, program
        self.executed: NDArray[np.bool_] = np.zeros(len(program) + 1, dtype=np.bool_)
        self.limit = setup.block_limit + len(program)
        # the reader of Siemens lines remembers what it read: it has to read them all
        self.compiled = compiled and setup.dialect != "siemens"
        self.run = Run(setup, len(program) + SPARE_ROWS)
        self.variables: Variables = VARIABLES[setup.dialect](self.run)
        self.siemens = (
            SiemensReader(program.name, setup, self.variables, self.run.note)
            if setup.dialect == "siemens"
            else None
        )
        reader, memory = _reader(self.siemens, setup), getattr(self.siemens, "memory", None)
        self.calls = CallStack(self.run, self.variables, reader, program, memory)
        self.flow = Flow(self.calls, self.variables)
        self.blocks = 0
        self.reported = 0
        self.ended = False
        self.modal_depth = 0
        self.stop_line = 0

    def moves(self) -> Moves:
        """Moves of the program, interpreted to its end."""
        while not self.ended:
            self._step()
        return self._rest(list(self.setup.initial_position))

    def parts(self, rows: int) -> Iterator[Moves]:
        """The same in parts of at least ``rows`` rows."""
        run, origin = self.run, list(self.setup.initial_position)
        while not self.ended:
            self._step()
            # a contour or corner that is open still changes its rows, G9 the last one
            if run.rows.count > rows and run.contour is None and run.corner is None:
                last = run.rows.cut(run.rows.count - 1)
                part = self._written(run.rows.cut(0), origin)
                run.rows.append(tuple(column[0] for column in last.arrays.values()))
                origin = part.end[-1].tolist()
                yield part
        yield self._rest(origin)

    def until(self, line: int) -> bool:
        """Interpret up to before a line of the program; whether it comes to it."""
        self.stop_line = line
        while not self.ended:
            level = self.calls.current
            if level.source.file == 0 and level.line == line:
                return True
            self._step()
        return False

    def _rest(self, origin: list[float]) -> Moves:
        """Rows that stand at the end of the program."""
        self._refuse_corner()
        close_contour(self.run)
        return self._written(self.run.rows, origin)

    def _written(self, rows: Rows, origin: list[float]) -> Moves:
        run = self.run
        moves = rows.moves(origin, tuple(run.files), tuple(run.frames), tuple(run.cutter_radii))
        return replace(moves, notices=run.notices)

    def _refuse_corner(self) -> None:
        corner = self.run.corner
        if corner is not None:
            raise corner.block.error(
                corner.item, "the corner cannot be made: the next block has to be a straight line"
            )

    def _step(self) -> None:
        """Execute one line, or consecutive fast lines at once."""
        level = self.calls.current
        line = level.line
        if line >= (level.stop or level.source.body.stop):
            self._end_of_file()
            return
        compiled = self.compiled and not self.run.straight_next and self.run.corner is None
        if compiled and not isinstance(self.variables, SiemensVariables):
            stop = min(level.source.body.stop, line + FAST_LINES_AT_ONCE)
            stop = min(stop, self.stop_line) if line < self.stop_line else stop
            after = run_fast_lines(level.source.program, line, stop, self.run, self.variables)
            if after > line:
                self._count(after - line, after - 1)
                self._mark_executed(line, after)
                level.line = after
                if self.run.state.motion != self.run.cycle.code:
                    self.run.cycle.code = CANCELLED
                return
        self._count(1, line)
        level.line = line + 1
        statement = level.source.statement(line)
        if statement.skip is None or statement.skip not in self.setup.block_skip:
            self._mark_executed(line, line + 1)
            self._execute(statement)
            for block in statement.rest:
                if self.ended:
                    return
                if self.calls.current is not level or level.line != line + 1:
                    reason = "a call or jump stands before a block of its line: give each a line"
                    raise GcodeError(self._file, line, 1, "block", reason)
                self._execute(block)

    def _mark_executed(self, line: int, stop: int) -> None:
        if self.calls.current.source.file == 0:
            self.executed[line:stop] = True

    def _execute(self, statement: Statement) -> None:
        self.variables.line = statement.line
        block = None
        if statement.words:
            block = block_of(statement, self.run, self.variables, self._file)
        if statement.assignments:
            self.flow.assign(statement.assignments, statement.line)
            if isinstance(self.variables, FanucVariables) and self.variables.stops:
                self.variables.stops = 0  # #3006 stops the program like M0
                self.run.add_row(Kind.STOP, statement.line)
        if statement.comments and self.run.state.dialect == LINUXCNC:
            self._comments(statement)
        if block is not None:
            self._block(block)
        if statement.control is not None:
            self.flow.follow(statement, statement.control)

    @property
    def _file(self) -> str:
        return self.calls.current.source.program.name

    def _block(self, block: Block) -> None:
        run = self.run
        before, count, corner = run.state.position, run.rows.count, run.corner
        carry_out(block, run)
        if run.corner is corner:
            self._refuse_corner()
        jump = block.flow
        if jump is None:
            moved = run.rows.count > count and run.state.position is not before
            if run.modal_call is not None and moved and len(self.calls.levels) == self.modal_depth:
                self.calls.call(run.modal_call, block.line)
            elif run.modal_call is not None and self.modal_depth == 0:
                self.modal_depth = len(self.calls.levels)
            elif run.modal_call is None:
                self.modal_depth = 0
        elif jump.kind == "end":
            self.ended = True
        elif jump.kind in ("call", "local call"):
            self.calls.call(jump, block.line)
        elif not self.calls.return_to_caller(jump.number, block.line, jump):
            close_contour(run)
            run.add_row(Kind.END, block.line)
            self.ended = True

    def _comments(self, statement: Statement) -> None:
        """(abort, …) ends the program as an error; what else comments do moves nothing."""
        for comment in statement.comments:
            if comment.strip().lower().startswith("abort,"):
                reason = f"the program ends itself: {comment.strip()[6:].strip()}"
                raise GcodeError(self._file, statement.line, 1, f"({comment})", reason)

    def _end_of_file(self) -> None:
        """Past the last line: the end of a main program, an error in a subprogram."""
        level = self.calls.current
        if len(self.calls.levels) > 1 and self.siemens is not None:
            self.calls.return_to_caller(None, level.line, None)
            return
        if len(self.calls.levels) > 1:
            ending = "M99" if level.jump is not None else f"o<{level.label}> endsub"
            reason = f"the subprogram does not return: add {ending}"
            raise GcodeError(self._file, level.source.body.stop - 1, 1, "end of file", reason)
        self.ended = True

    def _count(self, blocks: int, line: int) -> None:
        self.blocks += blocks
        if self.blocks > self.limit:
            reason = (
                f"more than {self.limit} blocks were executed, the program does not come to its "
                "end: end the loop, or raise setup.block_limit of the machine's file"
            )
            raise GcodeError(self._file, line, 1, "block", reason)
        if self.progress is not None and self.blocks - self.reported >= REPORT_EVERY:
            self.reported = self.blocks
            self.progress(self.blocks)
