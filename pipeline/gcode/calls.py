"""Subprogram calls: the stack of call levels, and the programs with their labels."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

from pipeline.gcode.dialects.siemens_tokens import Structure, structures
from pipeline.gcode.dialects.siemens_tokens import labels as siemens_labels
from pipeline.gcode.dialects.siemens_words import ModalMemory
from pipeline.gcode.dialects.variables import FanucVariables, LinuxcncParameters, SiemensVariables
from pipeline.gcode.errors import ErrorAt, GcodeError
from pipeline.gcode.modal import LINUXCNC
from pipeline.gcode.program import Program, read_program
from pipeline.gcode.run import Jump, Run, Snapshot
from pipeline.gcode.statements import Control, Number, Statement

_O_WORD = re.compile(rb"[\s/\d]*?(?:[nN]\s*[\d.]+\s*)?[oO]")
_LOOP = re.compile(rb"(?i)[^(]*?(?:WHILE|DO|END)")
KEPT = 50_000
"""Statements that are cached for lines executed again."""

Parser = Callable[[Program, int], Statement]


@dataclass(frozen=True, slots=True)
class Label:
    """An O-word, WHILE, DO or END, with its line."""

    line: int
    control: Control


class Source:
    """Program with an index of its N words, O programs, labels and loops.

    ``keeps`` says whether a line that is carried out again is the same statement.
    """

    def __init__(self, program: Program, file: int, parse: Parser, *, keeps: bool = True) -> None:
        self.program, self.file, self.parse, self.keeps = program, file, parse, keeps
        self.body, self.opening = program.body, program.opening
        self._statements: dict[int, Statement] = {}

    def statement(self, line: int) -> Statement:
        """Statement of a line, cached since loops need it again."""
        statement = self._statements.get(line)
        if statement is None:
            statement = self.parse(self.program, line)
            if len(self._statements) >= KEPT:
                self._statements.clear()
            if self.keeps:
                self._statements[line] = statement
        return statement

    @cached_property
    def numbers(self) -> dict[int, list[int]]:
        """N word -> the lines that bear it."""
        return self._heads("N")

    @cached_property
    def programs(self) -> dict[int, int]:
        """Number of a program (O1000) -> its first line in this file."""
        return {number: lines[0] for number, lines in self._heads("O").items()}

    @cached_property
    def labels(self) -> dict[str, list[Label]]:
        """O-words by their label, in order."""
        labels: dict[str, list[Label]] = {}
        for label in self._controls(_O_WORD):
            name = label.control.label
            if isinstance(name, str):
                labels.setdefault(name, []).append(label)
        return labels

    @cached_property
    def structures(self) -> dict[int, Structure]:
        """Branches and loops of a Sinumerik program by each of their lines."""
        return structures(self.program)

    @cached_property
    def marks(self) -> dict[str, list[int]]:
        """Labels and block numbers of a Sinumerik program -> the lines that bear them."""
        return siemens_labels(self.program)

    def part(self, first: str, last: str, line: int) -> range | None:
        """Lines that REPEAT or CALL BLOCK in a line carries out; None where a label is missing.

        Without ``last`` they end at ENDLABEL, or before the line of REPEAT itself.
        """
        begin = self.marked(first, line, "gotob") or self.marked(first, line, "goto")
        if begin is None:
            return None
        ends = [place for place in self.marks.get(last or "ENDLABEL", []) if place >= begin]
        if not last and begin < line and not (ends and ends[0] < line):
            return range(begin, line)
        return range(begin, ends[0] + 1) if ends else None

    def marked(self, mark: str, line: int, word: str) -> int | None:
        """Line that ``word`` (goto, gotof or gotob) jumps to from a line."""
        places = self.marks.get(mark, [])
        before = [place for place in places if place <= line]
        after = [place for place in places if place > line]
        if word == "gotob":
            return before[-1] if before else None
        return after[0] if after else before[0] if before and word == "goto" else None

    @cached_property
    def loops(self) -> dict[int, int]:
        """Line of a WHILE or DO -> line of its END, and back."""
        pairs: dict[int, int] = {}
        for number in (1.0, 2.0, 3.0):
            begun: list[int] = []
            for label in self._controls(_LOOP):
                control = label.control
                if not isinstance(control.label, Number) or control.label.value != number:
                    continue
                if control.kind in ("while_do", "do"):
                    begun.append(label.line)
                elif control.kind == "end" and begun:
                    begin = begun.pop()
                    pairs[begin], pairs[label.line] = label.line, begin
        return pairs

    def section(self, line: int) -> range:
        """Lines of the O program that a line belongs to."""
        heads = sorted(self.programs.values())
        first = max((head for head in heads if head <= line), default=self.body.start)
        last = min((head for head in heads if head > line), default=self.body.stop)
        return range(first, last)

    def line_numbered(self, number: int, line: int) -> int | None:
        """Line that bears N ``number``, searched from ``line`` on and then from the top."""
        section = self.section(line)
        places = [place for place in self.numbers.get(number, ()) if place in section]
        return next((place for place in places if place > line), places[0] if places else None)

    def next_label(self, label: str, line: int, kinds: tuple[str, ...]) -> Label | None:
        """The next O-word of a label and one of some kinds."""
        of_kind = (place for place in self.labels.get(label, ()) if place.control.kind in kinds)
        return next((place for place in of_kind if place.line > line), None)

    def previous_label(self, label: str, line: int, kind: str) -> int | None:
        """Line of the last O-word of a label and a kind above a line."""
        of_kind = (place for place in self.labels.get(label, ()) if place.control.kind == kind)
        return max((place.line for place in of_kind if place.line < line), default=None)

    def _heads(self, letter: str) -> dict[int, list[int]]:
        places: dict[int, list[int]] = {}
        for number, line in self.program.heads(letter):
            if line in self.body and number == int(number):
                places.setdefault(int(number), []).append(line)
        return places

    def _controls(self, pattern: re.Pattern[bytes]) -> list[Label]:
        """Flow control of the lines that look like it; what cannot be read is none."""
        labels = []
        for line in self.body:
            if pattern.match(self.program.line(line).text) is None:
                continue
            try:
                control = self.statement(line).control
            except GcodeError:
                continue  # said when the line is executed, if ever
            if control is not None:
                labels.append(Label(line, control))
        return labels


ENDINGS = (".spf", ".mpf", ".nc", ".txt")
"""Endings of files that a Sinumerik's call finds, the first first."""


def _section(program: Program, name: str) -> Program | None:
    """The program that ``%_N_NAME_SPF`` opens in a file of several, with the file's lines."""
    head = rb"(?im)^[ \t]*%%_N_%b_[SM]PF\b" % re.escape(name.encode("latin-1", "replace"))
    found = re.search(head, program.data)
    if found is None:
        return None
    above = program.data.count(b"\n", 0, found.start())
    return Program(b"\n" * above + program.data[found.start() :], program.name)


DEEPEST = 100
"""Levels of calls; controls allow 4 to 15."""
Variables = FanucVariables | LinuxcncParameters | SiemensVariables


@dataclass(slots=True, kw_only=True)
class Level:
    """A program or subprogram that is being executed."""

    source: Source
    """Program that holds its lines."""
    line: int
    """Line to be executed next."""
    first: int
    """Line that the level began with."""
    jump: Jump | None = None
    """The call, where M98, G65 or G66 made it."""
    label: str | None = None
    """Label of an O-word subroutine."""
    repeats_left: int = 0
    """Repetitions after the current one."""
    loops: dict[str, int] = field(default_factory=dict)
    """Label of an open repeat or do -> repetitions left, or the line of the do."""
    stop: int | None = None
    """The line behind the last of lines between labels; None elsewhere."""
    arguments: dict[int, float] | None = None
    """Arguments of a Sinumerik's call, by number; None where no program of one begins."""
    modal: bool = False
    """Whether MCALL made the call."""
    before: ModalMemory | None = None
    """Memory of the reader before the call."""


class CallStack:
    """Stack of call levels with modal state, local variables and the reader's ``memory``."""

    def __init__(
        self, run: Run, variables: Variables, parse: Parser, program: Program,
        memory: ModalMemory | None = None,
    ) -> None:  # fmt: skip
        self.run, self.variables, self.parse, self.memory = run, variables, parse, memory
        self.files: dict[Path, Source] = {}
        self.programs: dict[str, Source] = {}
        main = self._source(program)
        self.levels = [Level(source=main, line=main.body.start, first=main.body.start)]

    @property
    def current(self) -> Level:
        """Innermost level."""
        return self.levels[-1]

    def call(self, jump: Jump, line: int) -> None:
        """Call by M97, M98, G65 or G66."""
        if jump.count == 0:
            return
        error = self._error(line, jump)
        local = jump.kind == "local call"
        place = self._local if local else self._subprogram
        source, first = place(jump.number or 0, error)
        level = Level(
            source=source, line=first, first=first, jump=jump, repeats_left=jump.count - 1
        )
        self._enter(level, error)
        if jump.arguments is not None:
            self.variables.enter(dict(jump.arguments))

    def call_subroutine(
        self, control: Control, label: str, arguments: list[float], line: int
    ) -> None:
        """Call by ``o<name> call [..]``."""
        error = self.place(line, control.column, f"o<{label}> call")
        source, first = self._o_subroutine(label, error)
        self._enter(Level(source=source, line=first, first=first, label=label), error)
        self.variables.enter({index + 1: value for index, value in enumerate(arguments)})

    def call_program(
        self, control: Control, arguments: dict[int, float], count: int, line: int, at: ErrorAt
    ) -> None:
        """A Sinumerik's call of a subprogram, or of the lines between two labels."""
        label, modal = str(control.label), control.kind.endswith("mcall")
        source = self._program(label, at) if label else self.current.source
        level = Level(source=source, line=source.body.start, first=source.body.start, modal=modal)
        level.arguments = arguments if label else None
        if control.part[0]:
            lines = source.part(*control.part, 0 if label else line)
            if lines is None:
                first, last = control.part[0], control.part[1] or "ENDLABEL"
                raise at(f"{first} to {last} is not in the program: add the labels")
            level.line = level.first = lines.start
            level.stop = lines.stop
        level.repeats_left = count - 1
        if count:
            self._enter(level, at)

    def return_to_caller(self, number: int | None, line: int, jump: Jump | None) -> bool:
        """M99, or the end of an O-word subroutine; False in the main program."""
        while jump is not None and self.current.stop and self.current.arguments is None:
            self._leave()  # M17 ends the program that repeats some of its lines
        level = self.current
        if number is not None and (len(self.levels) == 1 or level.repeats_left == 0):
            target = self.levels[-2] if len(self.levels) > 1 else level
            place = target.source.line_numbered(number, max(target.line - 1, 0))
            if place is None:
                raise self._error(line, jump)(f"N{number} to return to is not in the program")
            self._leave()
            self.current.line = place
            return True
        if len(self.levels) == 1:
            return False
        if level.repeats_left > 0:
            level.repeats_left -= 1
            level.line = level.first
            level.loops.clear()
            if level.arguments is not None:
                self._end(level, self.run.saved[-1])
                self._begin(level)
            if level.jump is not None and level.jump.arguments is not None:
                self.variables.leave()
                self.variables.enter(dict(level.jump.arguments))
            return True
        self._leave()
        return True

    def _enter(self, level: Level, error: ErrorAt) -> None:
        if len(self.levels) >= DEEPEST:
            raise error(f"subprograms call each other {DEEPEST} levels deep: end the recursion")
        self.levels.append(level)
        self.run.saved.append(None)
        self.run.state.file = level.source.file
        if level.arguments is not None:
            self._begin(level)

    def _begin(self, level: Level) -> None:
        """A Sinumerik's subprogram begins, again where P counts."""
        if self.memory is not None and level.arguments is not None:
            level.before = self.memory.enter(frozenset(level.arguments), modal=level.modal)
            self.variables.enter(level.arguments)
            self.run.saved[-1] = Snapshot.of(self.run, automatic=False)

    def _end(self, level: Level, snapshot: Snapshot | None) -> None:
        if self.memory is not None and level.before is not None:
            if snapshot is not None and self.memory.saves:
                snapshot.restore(self.run)
            self.memory.leave(level.before, modal=level.modal)
            self.variables.leave()

    def _leave(self) -> None:
        if len(self.levels) == 1:
            return
        level = self.levels.pop()
        snapshot = self.run.saved.pop()
        self._end(level, snapshot)
        if snapshot is not None and snapshot.automatic:
            snapshot.restore(self.run)
        if level.label is not None or (level.jump and level.jump.arguments is not None):
            self.variables.leave()
        self.run.state.file = self.current.source.file

    def _source(self, program: Program) -> Source:
        if program.name not in self.run.files:
            self.run.files.append(program.name)
        keeps = self.run.dialect != "siemens"  # its reader remembers what it read
        return Source(program, self.run.files.index(program.name), self.parse, keeps=keeps)

    def _subprogram(self, number: int, error: ErrorAt) -> tuple[Source, int]:
        """In this file, in the main program's, or in a file of its own."""
        for source in (self.current.source, self.levels[0].source):
            if number in source.programs:
                return source, source.programs[number] + self._skips_head
        stems = {f"o{number:04d}", f"o{number}", f"{number:04d}", f"{number}", f"o{number:08d}"}
        source = self._file(stems, error, f"O{number:04d}")
        head = source.programs.get(number)
        return source, source.body.start if head is None else head + self._skips_head

    def _program(self, label: str, error: ErrorAt) -> Source:
        """A Sinumerik's program: a part of this file, or a file of its own."""
        if label not in self.programs:
            stem, _, ending = label.lower().partition(".")
            section = _section(self.levels[0].source.program, stem)
            stems = {stem, *(f"{n}{stem}_{e}" for n in ("", "_n_") for e in ("spf", "mpf"))}
            endings = (f".{ending}",) if ending else ENDINGS
            self.programs[label] = (
                self._source(section) if section else self._file(stems, error, label, endings)
            )
        return self.programs[label]

    def _local(self, number: int, error: ErrorAt) -> tuple[Source, int]:
        """The line N of a number in the program that runs."""
        source = self.current.source
        line = source.line_numbered(number, self.current.line - 1)
        if line is None:
            raise error(f"N{number} to call is not in the program: add it, or call with M98")
        return source, line

    @property
    def _skips_head(self) -> int:
        """The line ``O1000`` may hold more than the name, but in LinuxCNC."""
        return int(self.run.state.dialect == LINUXCNC)

    def _o_subroutine(self, label: str, error: ErrorAt) -> tuple[Source, int]:
        for source in (self.current.source, self.levels[0].source):
            sub = source.next_label(label, 0, ("sub",))
            if sub is not None:
                return source, sub.line + 1
        source = self._file({label}, error, f"{label}.ngc")
        sub = source.next_label(label, 0, ("sub",))
        if sub is None:
            raise error(f"the file {source.program.name} has no o<{label}> sub: add it")
        return source, sub.line + 1

    def _file(
        self, stems: set[str], error: ErrorAt, shown: str, endings: tuple[str, ...] = ()
    ) -> Source:
        """The file of one of some names, whatever its ending or in the order of ``endings``."""
        for folder in self.run.setup.folders:
            paths = sorted(folder.iterdir()) if folder.is_dir() else []
            paths = [path for path in paths if path.stem.lower() in stems and path.is_file()]
            if endings:
                order = {ending: place for place, ending in enumerate(("", *endings))}
                paths = [path for path in paths if path.suffix.lower() in order]
                paths.sort(key=lambda path: order[path.suffix.lower()])
            if paths:
                if paths[0] not in self.files:
                    self.files[paths[0]] = self._source(read_program(paths[0]))
                return self.files[paths[0]]
        unknown = "this is no word that is known, and " if endings and shown[1:].isalpha() else ""
        raise error(
            f"{unknown}the subprogram {shown} is neither in this file nor in the folders searched: "
            "add its folder to setup.folders of the machine's file"
            + ", or rewrite the word"
            * bool(unknown)
        )

    def _error(self, line: int, jump: Jump | None) -> ErrorAt:
        item = jump.item if jump is not None else None
        return self.place(line, item.column if item else 1, item.text if item else "call")

    def place(self, line: int, column: int, word: str) -> ErrorAt:
        """Error about a word of the program that runs."""
        return partial(GcodeError, self.current.source.program.name, line, column, word)
