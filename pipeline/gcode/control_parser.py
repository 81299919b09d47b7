"""Flow control in a line: Macro B's GOTO, IF, WHILE, DO, END and LinuxCNC's O-words."""

from pipeline.gcode.expression_parser import ExpressionParser
from pipeline.gcode.statements import Assignment, Control, Expression, Number

O_WORDS = (
    "ENDREPEAT", "ENDWHILE", "CONTINUE", "ENDSUB", "ELSEIF", "RETURN", "REPEAT", "ENDIF", "WHILE",
    "BREAK", "CALL", "ELSE", "SUB", "IF", "DO",
)  # fmt: skip
"""Longest first, so that ENDIF is not taken for another."""


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
