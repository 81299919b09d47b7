"""Lines of ISO 6983 code, Macro B or LinuxCNC, parsed to statements."""

from dataclasses import replace

from pipeline.gcode.dialects.expression_parser import Cursor, ExpressionParser
from pipeline.gcode.errors import GcodeError, strange_character
from pipeline.gcode.program import OUTPUT, Line, Program, TokenKind, is_block, number_text
from pipeline.gcode.statements import (
    LARGEST,
    Assignment,
    Control,
    Expression,
    Number,
    Statement,
    WordItem,
)

LETTERS = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
POLAR = frozenset("@^$")
"""LinuxCNC's words without a letter: polar radius and angle, spindle number."""


def parse_statement(line: Line, file: str, dialect: str) -> Statement:
    """Statement of a line, in the order written; nothing is executed.

    Raises GcodeError at the first character that cannot be parsed.
    """
    return _LineParser(line, file, dialect).statement()


def parse_blocks(program: Program, line: int) -> Statement:
    """Statement of a Fanuc's line, and those of the blocks behind each ``;`` of it.

    Raises GcodeError when :func:`parse_statement` refuses a block.
    """
    source = program.line(line)
    statement = parse_statement(source, program.name, "fanuc")
    if not program.ends_blocks:
        return statement
    at = next((p.start - source.start for p in source.pieces if p.kind == TokenKind.REMARK), None)
    if at is None:
        return statement
    # blanks keep the columns of what is behind
    behind = Program(b" " * (at + 1) + source.text[at + 1 :], program.name)
    if not is_block(behind.data):
        return statement
    behind.ends_blocks = True
    one = replace(parse_blocks(behind, 1), line=line)
    rest = [replace(part, line=line) for part in (one, *one.rest)]
    return replace(statement, rest=tuple(replace(part, rest=()) for part in rest))


class _LineParser:
    """Parser of one line, and the parts of the statement read so far."""

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
            self.line.number, self.line.skip, self.number, tuple(self.words),
            tuple(self.assignments), self.control, tuple(self.cursor.comments),
        )  # fmt: skip

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
            start = self.cursor.at
            self.cursor.take("N")
            self.number = self.cursor.number()
            if self.number is None:
                raise self.cursor.error(start, "N is followed by no number: add it or delete N")
        else:
            run = self.cursor.letters()
            if self.dialect == "fanuc" and first and run in OUTPUT:
                self.cursor.at = len(self.cursor.code)
                return
            control = None
            if len(run) > 1 and self.dialect == "fanuc" and first:
                control = macro_control(run, self.expressions)
            if control is None:
                self._word(letter)
            else:
                self.control = control

    def _word(self, letter: str) -> None:
        cursor = self.cursor
        start = cursor.at
        cursor.at += len(letter)
        run = letter + cursor.letters()
        if len(run) > len(letter) and cursor.letters() not in self.expressions.functions:
            cursor.at = start + len(run)
            macro = run.startswith(("IF", "GOTO", "WHILE", "END", "DO"))
            raise cursor.error(
                start,
                "LinuxCNC has no such word: use O-words, or the dialect fanuc"
                if macro and self.dialect == "linuxcnc"
                else "this is no word of the dialect: correct it, or choose another dialect",
            )
        strange = "" if cursor.ended else self._strange()
        if strange:
            cursor.at += 1
            raise cursor.error(start, strange)
        if cursor.ended or cursor.peek() not in _VALUE:
            raise cursor.error(start, f"{letter} is followed by no value: add a number")
        if self.dialect == "fanuc" and _SIGNS.issuperset(cursor.peek(2)):
            cursor.at += 2
            raise cursor.error(
                start, "two signs stand before a value, where a Fanuc stops: keep one of them"
            )
        value = self.expressions.value()
        if self.dialect == "fanuc" and getattr(value, "function", "") == "ROUND":
            raise cursor.error(
                start,
                "ROUND in a word rounds to the control's least increment, which is not known: "
                "assign the rounded value to a # variable first",
            )
        column = cursor.columns[start]
        self.words.append(WordItem(letter, value, column, cursor.written(start)))

    def _strange(self) -> str:
        return strange_character(self.cursor.source, self.cursor.column - 1)

    def _unexpected(self, reason: str) -> GcodeError:
        start, strange = self.cursor.at, self._strange()
        self.cursor.at += 1
        return self.cursor.error(start, strange or reason)

    def _check_comments(self) -> None:
        word = next((f"({c})" for c in self.cursor.comments if "(" in c), None)
        source = self.cursor.source
        if word is not None and self.dialect == "linuxcnc" and word in source:
            reason = "a comment holds another ( : LinuxCNC refuses this, delete the inner one"
            column = source.index(word) + 1
            raise GcodeError(self.cursor.file, self.line.number, column, word, reason)


_VALUE = frozenset("0123456789.+-#[ABCDEFGHIJKLMNOPQRSTUVWXYZ")
_REASONS = {
    "(": "the comment is not closed: add )",
    "/": "block skip stands only at the head of a line: put / first",
    "%": "% stands only on a line of its own: put it there or delete it",
}

O_WORDS = (
    "ENDREPEAT", "ENDWHILE", "CONTINUE", "ENDSUB", "ELSEIF", "RETURN", "REPEAT", "ENDIF", "WHILE",
    "BREAK", "CALL", "ELSE", "SUB", "IF", "DO",
)  # fmt: skip
"""O-words, longest first, so that ENDIF is not taken for another."""


def o_word(expressions: ExpressionParser) -> Control:
    """``O1000``, ``O<name>``, and in LinuxCNC with what follows; the O (or ``:``) comes next."""
    cursor = expressions.cursor
    column, start = cursor.column, cursor.at
    cursor.at += 1
    label = _label(expressions, start)
    if expressions.fanuc:
        return Control("program", label, column)
    at = cursor.at
    kind = next((word for word in O_WORDS if cursor.take(word)), None)
    if kind is None:
        if not cursor.ended:
            cursor.at += max(len(cursor.letters()), 1)
            raise cursor.error(at, "no O-word of LinuxCNC: use sub, call, if, while, repeat, …")
        return Control("program", label, column)
    condition: Expression | None = None
    arguments: list[Expression] = []
    if kind in ("IF", "ELSEIF", "WHILE", "REPEAT") or (
        kind in ("RETURN", "ENDSUB") and cursor.peek() == "["
    ):
        condition = expressions.bracketed()
    elif kind == "CALL":
        while cursor.peek() == "[":
            arguments.append(expressions.bracketed())
    return Control(kind.lower(), label, column, condition, tuple(arguments))


def _label(expressions: ExpressionParser, start: int) -> Expression | str:
    cursor = expressions.cursor
    if cursor.take("<"):
        return cursor.name()
    if cursor.peek() in ("#", "["):
        return expressions.value()
    number = cursor.number()
    if number is None or number != int(number):
        raise cursor.error(start, "O is followed by no whole number or <name>: add it")
    return str(int(number))


def macro_control(run: str, expressions: ExpressionParser) -> Control | None:
    """Macro B's control if the run of letters that comes next is one of its words."""
    cursor = expressions.cursor
    column = cursor.column
    if run not in ("IF", "GOTO", "WHILE", "DO", "END"):
        return None
    cursor.at += len(run)
    if run == "GOTO":
        return Control("goto", expressions.value(), column)
    if run in ("DO", "END"):
        return Control(run.lower(), _loop(expressions), column)
    condition = expressions.bracketed()
    at = cursor.at
    if run == "WHILE":
        if not cursor.take("DO"):
            raise cursor.error(at, "DO is expected after WHILE [ ]: add DO1, DO2 or DO3")
        return Control("while_do", _loop(expressions), column, condition)
    if cursor.take("GOTO"):
        return Control("if_goto", expressions.value(), column, condition)
    if cursor.take("THEN") and cursor.peek() == "#":
        then = (assignment(expressions),)
        return Control("if_then", None, column, condition, then=then)
    raise cursor.error(at, "after IF [ ] only GOTO n or THEN #i = … is followed: write one of them")


def _loop(expressions: ExpressionParser) -> Number:
    cursor = expressions.cursor
    start = cursor.at
    number = cursor.number()
    if number not in (1.0, 2.0, 3.0):
        raise cursor.error(start, "DO and END are followed by 1, 2 or 3: add the loop's number")
    return Number(number)


def assignment(expressions: ExpressionParser) -> Assignment:
    """``#… = …``; the ``#`` comes next."""
    cursor = expressions.cursor
    start = cursor.at
    column = cursor.column
    target = expressions.parameter()
    if not cursor.take("="):
        raise cursor.error(start, "= is expected after the parameter: write #… = value")
    value = expressions.expression() if expressions.fanuc else expressions.value()
    return Assignment(target, value, column)


_PLAIN = frozenset({TokenKind.WORD, TokenKind.BLANK, TokenKind.LINE_END})
_PLAIN_LETTERS = frozenset("ABCDEFGHIJKLMPQRSTUVWXYZ")
"""Letters of words that may stand anywhere in a line and do not control the flow."""
_SIGNS = frozenset("+-")


def statement_from_tokens(program: Program, line: int) -> Statement | None:
    """Statement of a line of letters and numbers only, straight from its tokens; else None."""
    tokens = program.tokens
    first, last = tokens.first[line - 1 : line + 1].tolist()
    kinds = tokens.kind[first:last].tolist()
    if not _PLAIN.issuperset(kinds):
        return None
    starts = tokens.start[first : last + 1].tolist()
    text = program.data[starts[0] : starts[-1]].decode("latin-1")
    head = starts[0]
    number, words = None, []
    for index, kind in enumerate(kinds):
        if kind != TokenKind.WORD:
            continue
        begin, end = starts[index] - head, starts[index + 1] - head
        letter = text[begin].upper()
        value = float(number_text(program.data[starts[index] : starts[index + 1]]))
        if not abs(value) <= LARGEST:
            return None  # the parser says why
        if letter in _PLAIN_LETTERS:
            item = WordItem(letter, Number(value), begin + 1, text[begin:end])
            words.append(item)
        elif letter == "N" and number is None and not words and _SIGNS.isdisjoint(text[begin:end]):
            number = value
        else:
            return None
    return Statement(line, None, number, tuple(words), (), None, ())
