"""A program while it runs: its statements, and where its labels stand."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.program import Program
from pipeline.gcode.statements import Control, Number, Statement

_O_WORD = re.compile(rb"[\s/\d]*?(?:[nN]\s*[\d.]+\s*)?[oO]")
_LOOP = re.compile(rb"(?i)[^(]*?(?:WHILE|DO|END)")
KEPT = 50_000
"""Statements kept for lines that come again."""

Parser = Callable[[Program, int], Statement]


@dataclass(frozen=True, slots=True)
class Label:
    """An O-word, WHILE, DO or END: where it stands and what it says."""

    line: int
    control: Control


class Source:
    """One program with what was found in it.

    Parameters
    ----------
    program : Program
        Text.
    file : int
        Its index in ``Moves.files``.
    parse : callable
        From a program and a line number to the statement.
    """

    def __init__(self, program: Program, file: int, parse: Parser) -> None:
        self.program, self.file, self.parse = program, file, parse
        self.body = program.body
        self._statements: dict[int, Statement] = {}

    def statement(self, line: int) -> Statement:
        """What a line says; kept, since loops ask again."""
        known = self._statements.get(line)
        if known is None:
            known = self.parse(self.program, line)
            if len(self._statements) >= KEPT:
                self._statements.clear()
            self._statements[line] = known
        return known

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
        found: dict[str, list[Label]] = {}
        for label in self._controls(_O_WORD):
            name = label.control.label
            if isinstance(name, str):
                found.setdefault(name, []).append(label)
        return found

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

    def numbered(self, number: int, line: int) -> int | None:
        """The line that bears N ``number``, searched from ``line`` on and then from the top."""
        section = self.section(line)
        places = [place for place in self.numbers.get(number, ()) if place in section]
        return next((place for place in places if place > line), places[0] if places else None)

    def after(self, label: str, line: int, kinds: tuple[str, ...]) -> Label | None:
        """The next O-word of a label and one of some kinds."""
        for found in self.labels.get(label, ()):
            if found.line > line and found.control.kind in kinds:
                return found
        return None

    def before(self, label: str, line: int, kinds: tuple[str, ...]) -> Label | None:
        """The last such O-word above a line."""
        for found in reversed(self.labels.get(label, ())):
            if found.line < line and found.control.kind in kinds:
                return found
        return None

    def _heads(self, letter: str) -> dict[int, list[int]]:
        places: dict[int, list[int]] = {}
        for number, line in self.program.heads(letter):
            if line in self.body and number == int(number):
                places.setdefault(int(number), []).append(line)
        return places

    def _controls(self, pattern: re.Pattern[bytes]) -> list[Label]:
        """Flow control of the lines that look like it; what cannot be read is none."""
        found = []
        for line in self.body:
            if pattern.match(self.program.line(line).text) is None:
                continue
            try:
                control = self.statement(line).control
            except GcodeError:
                continue  # said when the line is executed, if ever
            if control is not None:
                found.append(Label(line, control))
        return found
