"""Levels of subprograms: where each stands, and where a called one is found."""

from dataclasses import dataclass, field
from pathlib import Path

from pipeline.gcode.block import Jump
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.named_parameters import LinuxcncParameters
from pipeline.gcode.program import Program, read_program
from pipeline.gcode.run import Run
from pipeline.gcode.siemens_variables import SiemensVariables
from pipeline.gcode.source import Parser, Source
from pipeline.gcode.state import LINUXCNC
from pipeline.gcode.statements import Control
from pipeline.gcode.variables import FanucVariables

DEEPEST = 100
"""Levels of calls; controls allow 4 to 15."""
Variables = FanucVariables | LinuxcncParameters | SiemensVariables


@dataclass(slots=True, kw_only=True)
class Level:
    """A program or subprogram that is being executed.

    Parameters
    ----------
    source : Source
        Where its lines are.
    line : int
        The next one.
    first : int
        The one it began with.
    jump : Jump or None
        The call, where M98, G65 or G66 made it.
    label : str or None
        Of an O-word subroutine.
    left : int
        How often it is still to run after this time.
    loops : dict of str to int
        Label of an open repeat or do -> repetitions left, or the line of the do.
    """

    source: Source
    line: int
    first: int
    jump: Jump | None = None
    label: str | None = None
    left: int = 0
    loops: dict[str, int] = field(default_factory=dict)


class Calls:
    """The stack of levels.

    Parameters
    ----------
    run, variables : Run, Variables
        Take part in a call: local variables, saved modal state.
    parse : callable
        Makes statements.
    program : Program
        The main program.
    """

    def __init__(self, run: Run, variables: Variables, parse: Parser, program: Program) -> None:
        self.run, self.variables, self.parse = run, variables, parse
        self.files: dict[Path, Source] = {}
        main = self._source(program)
        self.levels = [Level(source=main, line=main.body.start, first=main.body.start)]

    @property
    def here(self) -> Level:
        """The innermost level."""
        return self.levels[-1]

    def call(self, jump: Jump, line: int) -> None:
        """M98, G65 or G66."""
        if jump.count == 0:
            return
        error = self._error(line, jump)
        source, first = self._subprogram(jump.number or 0, error)
        self._enter(source, first, error, jump=jump, left=jump.count - 1)
        if jump.arguments is not None:
            self.variables.enter(dict(jump.arguments))

    def call_o(self, control: Control, label: str, arguments: list[float], line: int) -> None:
        """``o<name> call [..]``."""
        error = self._place(line, control.column, f"o<{label}> call")
        source, first = self._o_subroutine(label, error)
        self._enter(source, first, error, label=label)
        self.variables.enter({index + 1: value for index, value in enumerate(arguments)})

    def back(self, number: int | None, line: int, jump: Jump | None) -> bool:
        """M99, or the end of an O-word subroutine; False in the main program."""
        level = self.here
        if number is not None and (len(self.levels) == 1 or level.left == 0):
            target = self.levels[-2] if len(self.levels) > 1 else level
            found = target.source.numbered(number, max(target.line - 1, 0))
            if found is None:
                raise self._error(line, jump)(f"N{number} to return to is not in the program")
            self._leave()
            self.here.line = found
            return True
        if len(self.levels) == 1:
            return False
        if level.left > 0:
            level.left -= 1
            level.line = level.first
            level.loops.clear()
            if level.jump is not None and level.jump.arguments is not None:
                self.variables.leave()
                self.variables.enter(dict(level.jump.arguments))
            return True
        self._leave()
        return True

    def _enter(
        self,
        source: Source,
        first: int,
        error: "ErrorAt",
        *,
        jump: Jump | None = None,
        label: str | None = None,
        left: int = 0,
    ) -> None:
        if len(self.levels) >= DEEPEST:
            raise error(f"subprograms call each other {DEEPEST} levels deep: end the recursion")
        self.levels.append(
            Level(source=source, line=first, first=first, jump=jump, label=label, left=left)
        )
        self.run.saved.append(None)
        self.run.state.file = source.file

    def _leave(self) -> None:
        if len(self.levels) == 1:
            return
        level = self.levels.pop()
        snapshot = self.run.saved.pop()
        if snapshot is not None and snapshot.automatic:
            snapshot.restore(self.run)
        if level.label is not None or (level.jump and level.jump.arguments is not None):
            self.variables.leave()
        self.run.state.file = self.here.source.file

    def _source(self, program: Program) -> Source:
        if program.name not in self.run.files:
            self.run.files.append(program.name)
        return Source(program, self.run.files.index(program.name), self.parse)

    def _subprogram(self, number: int, error: "ErrorAt") -> tuple[Source, int]:
        """In this file, in the main program's, or in a file of its own."""
        for source in (self.here.source, self.levels[0].source):
            if number in source.programs:
                return source, source.programs[number] + self._skips_head
        stems = {f"o{number:04d}", f"o{number}", f"{number:04d}", f"{number}", f"o{number:08d}"}
        source = self._file(stems, error, f"O{number:04d}")
        head = source.programs.get(number)
        return source, source.body.start if head is None else head + self._skips_head

    @property
    def _skips_head(self) -> int:
        """The line ``O1000`` may hold more than the name, but in LinuxCNC."""
        return int(self.run.state.dialect == LINUXCNC)

    def _o_subroutine(self, label: str, error: "ErrorAt") -> tuple[Source, int]:
        for source in (self.here.source, self.levels[0].source):
            sub = source.after(label, 0, ("sub",))
            if sub is not None:
                return source, sub.line + 1
        source = self._file({label}, error, f"{label}.ngc")
        sub = source.after(label, 0, ("sub",))
        if sub is None:
            raise error(f"the file {source.program.name} has no o<{label}> sub: add it")
        return source, sub.line + 1

    def _file(self, stems: set[str], error: "ErrorAt", shown: str) -> Source:
        for folder in self.run.setup.folders:
            for path in sorted(folder.iterdir()) if folder.is_dir() else ():
                if path.stem.lower() in stems and path.is_file():
                    if path not in self.files:
                        self.files[path] = self._source(read_program(path))
                    return self.files[path]
        raise error(
            f"the subprogram {shown} is neither in this file nor in the folders searched: "
            "add its folder to setup.folders of the machine's file"
        )

    def _error(self, line: int, jump: Jump | None) -> "ErrorAt":
        item = jump.item if jump is not None else None
        return self._place(line, item.column if item else 1, item.text if item else "call")

    def _place(self, line: int, column: int, word: str) -> "ErrorAt":
        return ErrorAt(self.here.source.program.name, line, column, word)


@dataclass(frozen=True, slots=True)
class ErrorAt:
    """Makes the error about one place."""

    file: str
    line: int
    column: int
    word: str

    def __call__(self, reason: str) -> GcodeError:
        """The error with its reason."""
        return GcodeError(
            file=self.file, line=self.line, column=self.column, word=self.word, reason=reason
        )
