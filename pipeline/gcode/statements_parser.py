"""One line of ISO 6983 code, Macro B or LinuxCNC: words, assignments and control to a statement."""

from pipeline.gcode.control_parser import assignment, macro_control, o_word
from pipeline.gcode.cursor import Cursor
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.expression_parser import ExpressionParser
from pipeline.gcode.program import Line
from pipeline.gcode.statements import Assignment, Control, Expression, Statement, WordItem

LETTERS = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
POLAR = frozenset("@^$")
"""LinuxCNC's words without a letter: polar radius and angle, spindle number."""


def parse_statement(line: Line, file: str, dialect: str) -> Statement:
    """What a line asks for, in the order written; nothing is executed.

    Parameters
    ----------
    line : Line
        Of a program; not a percent line.
    file : str
        Name for errors.
    dialect : str
        ``"fanuc"`` or ``"linuxcnc"``.

    Raises
    ------
    GcodeError
        At the first character that cannot be understood.
    """
    return _LineParser(line, file, dialect).statement()


class _LineParser:
    """The statement that grows while the cursor goes along the line."""

    def __init__(self, line: Line, file: str, dialect: str) -> None:
        text = line.text.decode("latin-1")
        self.cursor = Cursor(text, line.number, file, start=line.code_start)
        self.expressions = ExpressionParser(self.cursor, dialect)
        self.dialect = dialect
        self.line = line
        self.number: float | None = None
        self.words: list[WordItem] = []
        self.assignments: list[Assignment] = []
        self.control: Control | None = None

    def statement(self) -> Statement:
        while not self.cursor.ended:
            if self.control is not None and self.control.kind != "program":
                raise self._unexpected("nothing may follow here: put it on a line of its own")
            self._item()
        self._check_comments()
        return Statement(
            self.line.number,
            self.line.skip,
            self.number,
            tuple(self.words),
            tuple(self.assignments),
            self.control,
            tuple(self.cursor.comments),
        )

    def _item(self) -> None:
        cursor = self.cursor
        following = cursor.peek()
        if following == "#":
            self.assignments.append(assignment(self.expressions))
        elif following in LETTERS:
            self._lettered(following)
        elif following == "," and self.dialect == "fanuc" and cursor.peek(2)[1:] in ("R", "C"):
            self._word(cursor.peek(2))
        elif following in POLAR and self.dialect == "linuxcnc":
            self._word(following)
        elif following == ":" and self.dialect == "fanuc" and not self.words:
            self.control = o_word(self.expressions)
        else:
            raise self._unexpected(_REASONS.get(following, "this character has no meaning here"))

    def _lettered(self, letter: str) -> None:
        first = not self.words and not self.assignments and self.control is None
        if letter == "O" and first:
            self.control = o_word(self.expressions)
        elif letter == "N" and first and self.number is None:
            self.number = self._sequence_number()
        else:
            run = self.cursor.letters()
            control = None
            if len(run) > 1 and self.dialect == "fanuc" and first:
                control = macro_control(run, self.expressions)
            if control is None:
                self._word(letter)
            else:
                self.control = control

    def _sequence_number(self) -> float:
        start = self.cursor.at
        self.cursor.take("N")
        number = self.cursor.number()
        if number is None:
            raise self.cursor.error(start, "N is followed by no number: add it or delete N")
        return number

    def _word(self, letter: str) -> None:
        cursor = self.cursor
        start = cursor.at
        cursor.at += len(letter)
        run = letter + cursor.letters()
        if len(run) > len(letter) and cursor.letters() not in self.expressions.functions:
            cursor.at = start + len(run)
            raise cursor.error(start, self._unknown(run))
        if cursor.ended or cursor.peek() not in _VALUE:
            raise cursor.error(start, f"{letter} is followed by no value: add a number")
        value = self.expressions.value()
        self._refuse_round(start, value)
        column = cursor.columns[start]
        self.words.append(WordItem(letter, value, column, cursor.written(start)))

    def _refuse_round(self, start: int, value: Expression) -> None:
        rounds = getattr(value, "function", "") == "ROUND"
        if self.dialect == "fanuc" and rounds:
            raise self.cursor.error(
                start,
                "ROUND in a word rounds to the control's least increment, which is not known: "
                "assign the rounded value to a # variable first",
            )

    def _unknown(self, run: str) -> str:
        if self.dialect == "linuxcnc" and run.startswith(("IF", "GOTO", "WHILE", "END", "DO")):
            return "LinuxCNC has no such word: use O-words, or the dialect fanuc"
        return "this is no word of the dialect: correct it, or choose another dialect"

    def _unexpected(self, reason: str) -> GcodeError:
        start = self.cursor.at
        self.cursor.at += 1
        return self.cursor.error(start, reason)

    def _check_comments(self) -> None:
        nested = next((c for c in self.cursor.comments if "(" in c), None)
        if nested is not None and self.dialect == "linuxcnc" and f"({nested})" in self._source():
            column = self._source().index(f"({nested})") + 1
            raise GcodeError(
                file=self.cursor.file,
                line=self.line.number,
                column=column,
                word=f"({nested})",
                reason="a comment holds another ( : LinuxCNC refuses this, delete the inner one",
            )

    def _source(self) -> str:
        return self.cursor.source


_VALUE = frozenset("0123456789.+-#[ABCDEFGHIJKLMNOPQRSTUVWXYZ")
_REASONS = {
    "(": "the comment is not closed: add )",
    "/": "block skip stands only at the head of a line: put / first",
    "%": "% stands only on a line of its own: put it there or delete it",
}
