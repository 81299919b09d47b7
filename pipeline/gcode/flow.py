"""Flow control: Macro B's IF, WHILE, DO, GOTO, LinuxCNC's O-words, the Sinumerik's structures."""

from pipeline.gcode.calls import CallStack
from pipeline.gcode.dialects.siemens_tokens import JUMPS, OMITTED, Structure
from pipeline.gcode.dialects.siemens_tokens import KIND as SIEMENS
from pipeline.gcode.dialects.variables import SiemensVariables
from pipeline.gcode.errors import ErrorAt
from pipeline.gcode.statements import (
    Assignment,
    Binary,
    Control,
    Expression,
    ExpressionError,
    Number,
    ParameterStore,
    Statement,
    evaluate,
    parameter_key,
)

MOST_REPEATS = 1_000_000_000
MOST_TIMES = 9999
"""Largest P of a Sinumerik's call."""
LONGEST_LABEL = 1e15


class Flow:
    """Carries out the control of a statement by setting the line that comes next."""

    def __init__(self, calls: CallStack, parameters: ParameterStore) -> None:
        self.calls, self.parameters = calls, parameters

    def assign(self, assignments: tuple[Assignment, ...], line: int) -> None:
        """Evaluate all values, then keep them; on a Sinumerik one after the other."""
        if not isinstance(self.parameters, SiemensVariables):
            self._assign(assignments, line)
            return
        for one in assignments:
            self._assign((one,), line)

    def _assign(self, assignments: tuple[Assignment, ...], line: int) -> None:
        made = []
        for assignment in assignments:
            at = self.calls.place(line, assignment.column, "#")
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
        """Follow the flow control of the statement."""
        word = control.kind.removeprefix(SIEMENS).replace("_", " ").upper()
        at = self.calls.place(statement.line, control.column, word)
        if control.kind in ("goto", "if_goto", "if_then", "while_do", "end") or (
            control.kind == "do" and not isinstance(control.label, str)
        ):
            self._macro(control, statement.line, at)
        elif control.kind.startswith(SIEMENS):
            self._siemens(control, statement.line, at)
        elif control.kind in ("program", "endsub", "return", "call"):
            self._subroutine(control, statement.line, at)
        elif control.kind != "endif":
            self._o_word(control, self._label(control, at), statement.line, at)

    def _macro(self, control: Control, line: int, at: ErrorAt) -> None:
        level = self.calls.current
        match control.kind:
            case "goto":
                self._goto(control, line, at)
            case "if_goto":
                if self._value(control.condition, at):
                    self._goto(control, line, at)
            case "if_then":
                if self._value(control.condition, at):
                    self.assign(control.then, line)
            case "while_do":
                end = self._partner(line, at)
                if not self._value(control.condition, at):
                    level.line = end + 1
            case "do":
                self._partner(line, at)
            case "end":
                level.line = self._partner(line, at)

    def _siemens(self, control: Control, line: int, at: ErrorAt) -> None:
        level = self.calls.current
        word = control.kind.removeprefix(SIEMENS)
        if word in ("call", "mcall", "part"):
            self._call(control, line, at)
            return
        if word.upper() in JUMPS:
            if control.condition is None or self._value(control.condition, at):
                level.line = self._marked(str(control.label), line, word, at)
            return
        found = level.source.structures.get(line)
        if found is None:
            raise at("it has no partner: every IF, WHILE, FOR, LOOP and REPEAT needs its end")
        unless = {
            "if": (found.otherwise or found.end) + 1, "while": found.end + 1,
            "until": found.opening + 1,
        }  # fmt: skip
        always = {"else": found.end + 1, "endwhile": found.opening, "endloop": found.opening + 1}
        if word in unless:
            if not self._value(control.condition, at):
                level.line = unless[word]
        elif word == "for":
            self.assign(control.then, line)
            self._count(control, found, at)
        elif word == "endfor":
            self._next_count(found, line, at)
        else:
            level.line = always.get(word, level.line)

    def _call(self, control: Control, line: int, at: ErrorAt) -> None:
        """A subprogram, or lines between labels, P times."""
        at = self.calls.place(line, control.column, str(control.label) or "REPEAT")
        times = self._value(control.condition, at)
        if times != int(times) or not 0 <= times <= MOST_TIMES:
            raise at(f"P{times:g} must be a whole number from 0 to {MOST_TIMES}: correct it")
        given = enumerate(control.arguments, 1)
        values = {n: self._value(one, at) for n, one in given if one is not OMITTED}
        self.calls.call_program(control, values, int(times), line, at)

    def _marked(self, mark: str, line: int, word: str, at: ErrorAt) -> int:
        level = self.calls.current
        target = level.source.marked(mark, line, word)
        if target is None:
            where = {"gotof": "below this line", "gotob": "above this line"}.get(word, "here")
            raise at(f"{mark} is no label or block number {where}: add it or correct the jump")
        if level.stop and not level.first <= target < level.stop:
            raise at(
                f"{mark} leads out of the lines that REPEAT or CALL BLOCK repeats: stay inside"
            )
        return target

    def _next_count(self, found: Structure, line: int, at: ErrorAt) -> None:
        """ENDFOR: the variable of its FOR one up, and into the loop again or behind it."""
        level = self.calls.current
        begun = level.source.statement(found.opening).control
        if begun is not None:
            target = begun.then[0].target
            one_up = Binary("+", target, Number(1.0))
            self.assign((Assignment(target, one_up, begun.column),), line)
            level.line = found.opening + 1
            self._count(begun, found, at)

    def _count(self, control: Control, found: Structure, at: ErrorAt) -> None:
        """Behind the ENDFOR of a FOR whose variable is beyond its end."""
        over = Binary("ABOVE", control.then[0].target, control.condition or Number(0.0))
        if self._value(over, at):
            self.calls.current.line = found.end + 1

    def _subroutine(self, control: Control, line: int, at: ErrorAt) -> None:
        """Call and return of an O-word subroutine; the head of a numbered program."""
        level = self.calls.current
        if control.kind == "program":
            begins = level.first, level.source.section(level.first).start, level.source.opening
            if line not in begins:
                raise at(
                    "the program runs into the next one in the file: end it with M30 or M99 before"
                )
        elif control.kind == "call":
            arguments = [self._value(argument, at) for argument in control.arguments]
            self.calls.call_subroutine(control, self._label(control, at), arguments, line)
        else:
            value = self._value(control.condition, at)
            if level.label is None:
                raise at("no O-word subroutine runs here: call it, do not run into it")
            self.calls.return_to_caller(None, line, None)
            self.parameters.write("_value", value)
            self.parameters.write("_value_returned", float(control.condition is not None))

    def _value(self, expression: Expression | None, at: ErrorAt) -> float:
        if expression is None:
            return 0.0
        try:
            return evaluate(expression, self.parameters) or 0.0
        except ExpressionError as error:
            raise at(str(error)) from None

    def _goto(self, control: Control, line: int, at: ErrorAt) -> None:
        if not isinstance(control.label, str) and control.label is not None:
            number = self._value(control.label, at)
            if not 0 <= number < LONGEST_LABEL or number != int(number):
                raise at(f"GOTO {number:g} is no N word: give a whole number")
            target = self.calls.current.source.line_numbered(int(number), line)
            if target is None:
                raise at(f"N{int(number)} is not in the program: add it or correct the GOTO")
            self.calls.current.line = target

    def _partner(self, line: int, at: ErrorAt) -> int:
        partner = self.calls.current.source.loops.get(line)
        if partner is None:
            raise at("WHILE … DO and END do not match: add the missing one with the same number")
        return partner

    def _o_word(self, control: Control, label: str, line: int, at: ErrorAt) -> None:
        """Loops and branches of LinuxCNC; a subroutine's definition is passed over."""
        level = self.calls.current
        match control.kind:
            case "sub":
                level.line = self._forward(label, line, ("endsub",), at) + 1
            case "if":
                self._branch(control, label, line, at)
            case "elseif" | "else":
                level.line = self._forward(label, line, ("endif",), at) + 1
            case "do":
                level.loops[label] = line
            case "while":
                self._while(control, label, line, at)
            case "endwhile":
                level.line = self._start("while", label, line, at)
            case "repeat":
                self._repeat(control, label, line, at)
            case "endrepeat":
                start = self._start("repeat", label, line, at)
                level.loops[label] -= 1
                if level.loops[label] > 0:
                    level.line = start + 1
                else:
                    del level.loops[label]
            case "break" | "continue":
                level.line = self._forward(label, line, ("endwhile", "endrepeat", "while"), at)
                if control.kind == "break":
                    level.line += 1
                    level.loops.pop(label, None)

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

    def _start(self, kind: str, label: str, line: int, at: ErrorAt) -> int:
        """Line of the while or repeat that an end belongs to."""
        level = self.calls.current
        start = level.source.previous_label(label, line, kind)
        if start is None or (kind == "repeat" and label not in level.loops):
            raise at(f"o<{label}> end{kind} has no {kind} before it: add one")
        return start

    def _repeat(self, control: Control, label: str, line: int, at: ErrorAt) -> None:
        count = self._value(control.condition, at)
        end = self._forward(label, line, ("endrepeat",), at)
        if count > MOST_REPEATS:
            raise at(f"repeat {count:g} does not end: give a smaller count")
        if count < 1:
            self.calls.current.line = end + 1
        else:
            self.calls.current.loops[label] = int(count)

    def _branch(self, control: Control, label: str, line: int, at: ErrorAt) -> None:
        """To the first branch of an if whose condition holds."""
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

    def _while(self, control: Control, label: str, line: int, at: ErrorAt) -> None:
        level = self.calls.current
        true = self._value(control.condition, at) != 0
        if label in level.loops:  # the while that ends a do
            if true:
                level.line = level.loops[label] + 1
            else:
                del level.loops[label]
        elif not true:
            level.line = self._forward(label, line, ("endwhile",), at) + 1
