"""Flow control: Macro B's IF, WHILE, DO, GOTO and LinuxCNC's O-words."""

from collections.abc import Callable

from pipeline.gcode.calls import CallStack
from pipeline.gcode.errors import ErrorAt
from pipeline.gcode.statements import (
    Assignment,
    Control,
    Expression,
    ExpressionError,
    ParameterStore,
    Statement,
    evaluate,
    parameter_key,
)

MOST_REPEATS = 1_000_000_000
LONGEST_LABEL = 1e15


class Flow:
    """Carries out the control of a statement by setting the line that comes next.

    Parameters
    ----------
    calls : CallStack
        Levels of subprograms.
    parameters : ParameterStore
        Variables.
    """

    def __init__(self, calls: CallStack, parameters: ParameterStore) -> None:
        self.calls, self.parameters = calls, parameters

    def assign(self, assignments: tuple[Assignment, ...], line: int) -> None:
        """Evaluate all values, then keep them."""
        made = []
        for assignment in assignments:
            at = self._at(line, assignment.column, "#")
            try:
                key = parameter_key(assignment.target, self.parameters)
                made.append((key, evaluate(assignment.value, self.parameters), at))
            except ExpressionError as error:
                raise at(str(error)) from None
        for key, value, at in made:
            try:
                self.parameters.write(key, value)
            except ExpressionError as error:
                raise at(str(error)) from None

    def follow(self, statement: Statement, control: Control) -> None:
        """Go where the statement leads."""
        at = self._at(statement.line, control.column, control.kind.replace("_", " ").upper())
        _CONTROLS[control.kind](self, statement, control, at)

    def _at(self, line: int, column: int, word: str) -> ErrorAt:
        return ErrorAt(self.calls.current.source.program.name, line, column, word)

    def _value(self, expression: Expression | None, at: ErrorAt) -> float:
        if expression is None:
            return 0.0
        try:
            return evaluate(expression, self.parameters) or 0.0
        except ExpressionError as error:
            raise at(str(error)) from None

    def _goto(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        if not isinstance(control.label, str) and control.label is not None:
            number = self._value(control.label, at)
            if not 0 <= number < LONGEST_LABEL or number != int(number):
                raise at(f"GOTO {number:g} is no N word: give a whole number")
            target = self.calls.current.source.line_numbered(int(number), statement.line)
            if target is None:
                raise at(f"N{int(number)} is not in the program: add it or correct the GOTO")
            self.calls.current.line = target

    def _if_goto(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        if self._value(control.condition, at):
            self._goto(statement, control, at)

    def _if_then(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        if self._value(control.condition, at):
            self.assign(control.then, statement.line)

    def _partner(self, line: int, at: ErrorAt) -> int:
        partner = self.calls.current.source.loops.get(line)
        if partner is None:
            raise at("WHILE … DO and END do not match: add the missing one with the same number")
        return partner

    def _while_do(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        end = self._partner(statement.line, at)
        if not self._value(control.condition, at):
            self.calls.current.line = end + 1

    def _do(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        self._partner(statement.line, at)

    def _end(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        self.calls.current.line = self._partner(statement.line, at)

    def _program(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        level = self.calls.current
        if level.first != statement.line and level.source.section(level.first).start != (
            statement.line
        ):
            raise at(
                "the program runs into the next one in the file: end it with M30 or M99 before"
            )

    # O-words of LinuxCNC

    def _label(self, control: Control, at: ErrorAt) -> str:
        if isinstance(control.label, str):
            return control.label
        number = self._value(control.label, at)
        if not 0 <= number < LONGEST_LABEL or number != int(number):
            raise at(f"O{number:g} is no label: give a whole number")
        return str(int(number))

    def _forward(self, label: str, line: int, kinds: tuple[str, ...], at: ErrorAt) -> int:
        target = self.calls.current.source.next_label(label, line, kinds)
        if target is None:
            raise at(f"o<{label}> has no {' or '.join(kinds)} after it: add one")
        return target.line

    def _sub(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label = self._label(control, at)
        self.calls.current.line = self._forward(label, statement.line, ("endsub",), at) + 1

    def _call(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        arguments = [self._value(argument, at) for argument in control.arguments]
        self.calls.call_subroutine(control, self._label(control, at), arguments, statement.line)

    def _return(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        value = self._value(control.condition, at)
        if self.calls.current.label is None:
            raise at("no O-word subroutine runs here: call it, do not run into it")
        self.calls.return_to_caller(None, statement.line, None)
        self.parameters.write("_value", value)
        self.parameters.write("_value_returned", float(control.condition is not None))

    def _if(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, line = self._label(control, at), statement.line
        taken = self._value(control.condition, at) != 0
        while not taken:
            target = self.calls.current.source.next_label(label, line, ("elseif", "else", "endif"))
            if target is None:
                raise at(f"o<{label}> if has no endif: add o<{label}> endif")
            line = target.line
            taken = target.control.kind != "elseif" or (
                self._value(target.control.condition, at) != 0
            )
            self.calls.current.line = line + 1

    def _else(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label = self._label(control, at)
        self.calls.current.line = self._forward(label, statement.line, ("endif",), at) + 1

    def _while(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        true = self._value(control.condition, at) != 0
        if label in level.loops:  # the while that ends a do
            if true:
                level.line = level.loops[label] + 1
            else:
                del level.loops[label]
        elif not true:
            level.line = self._forward(label, statement.line, ("endwhile",), at) + 1

    def _endwhile(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        target = level.source.previous_label(label, statement.line, ("while",))
        if target is None:
            raise at(f"o<{label}> endwhile has no while before it: add one")
        level.line = target.line

    def _o_do(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        self.calls.current.loops[self._label(control, at)] = statement.line

    def _repeat(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        count = self._value(control.condition, at)
        end = self._forward(label, statement.line, ("endrepeat",), at)
        if count > MOST_REPEATS:
            raise at(f"repeat {count:g} does not end: give a smaller count")
        if count < 1:
            level.line = end + 1
        else:
            level.loops[label] = int(count)

    def _endrepeat(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        target = level.source.previous_label(label, statement.line, ("repeat",))
        if target is None or label not in level.loops:
            raise at(f"o<{label}> endrepeat has no repeat before it: add one")
        level.loops[label] -= 1
        if level.loops[label] > 0:
            level.line = target.line + 1
        else:
            del level.loops[label]

    def _break(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        kinds = ("endwhile", "endrepeat", "while")
        level.line = self._forward(label, statement.line, kinds, at) + 1
        level.loops.pop(label, None)

    def _continue(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        label, level = self._label(control, at), self.calls.current
        kinds = ("endwhile", "endrepeat", "while")
        level.line = self._forward(label, statement.line, kinds, at)

    def _nothing(self, statement: Statement, control: Control, at: ErrorAt) -> None:
        """An endif that is reached."""


_CONTROLS: dict[str, Callable[[Flow, Statement, Control, ErrorAt], None]] = {
    "goto": Flow._goto,
    "if_goto": Flow._if_goto,
    "if_then": Flow._if_then,
    "while_do": Flow._while_do,
    "do": lambda flow, statement, control, at: (
        Flow._o_do if isinstance(control.label, str) else Flow._do
    )(flow, statement, control, at),
    "end": Flow._end,
    "program": Flow._program,
    "sub": Flow._sub,
    "endsub": Flow._return,
    "return": Flow._return,
    "call": Flow._call,
    "if": Flow._if,
    "elseif": Flow._else,
    "else": Flow._else,
    "endif": Flow._nothing,
    "while": Flow._while,
    "endwhile": Flow._endwhile,
    "repeat": Flow._repeat,
    "endrepeat": Flow._endrepeat,
    "break": Flow._break,
    "continue": Flow._continue,
}
