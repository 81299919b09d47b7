"""One line of a Sinumerik 840D program, word by word."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from pipeline.gcode.siemens_frames import UNTURNED, Matrix, turned
from pipeline.gcode.siemens_scanner import VARIABLE, Pieces, Token
from pipeline.gcode.siemens_words import (
    CALLS,
    FOREIGN_M,
    G_CODES,
    LETTERS,
    SAME_AS,
    TYPES,
    WITHOUT_MOTION,
)
from pipeline.gcode.statements import (
    Assignment,
    Expression,
    Number,
    Parameter,
    Unary,
    WordItem,
)


@dataclass(slots=True)
class Memory:
    """What earlier lines leave for later ones.

    Parameters
    ----------
    tools : dict of str to int
        Number of each tool's name.
    selected, tool : Expression
        Number of the tool called by T, and of the one in the spindle.
    motion : float
        G code of group 1 in force.
    drilling : tuple of Expression or None
        RTP, RFP, SDIS and DP of the CYCLE81 that MCALL put in force.
    frame : (3, 3) array
        AROT: from the program's axes to the workpiece's.
    absolute, shifted, transformed : bool
        G90, TRANS by more than 0, TRAORI.
    at : dict of str to (float or None)
        Last B, C and Z, where they were given as numbers [mm, deg].
    """

    tools: dict[str, int]
    selected: Expression = field(default_factory=lambda: Number(0.0))
    tool: Expression = field(default_factory=lambda: Number(0.0))
    motion: float = 0.0
    drilling: tuple[Expression, ...] | None = None
    frame: Matrix = field(default_factory=lambda: UNTURNED)
    absolute: bool = True
    shifted: bool = False
    transformed: bool = False
    at: dict[str, float | None] = field(default_factory=lambda: {"B": None, "C": None, "Z": None})

    def tool_number(self, name: str) -> float:
        """Number of a tool in the tool table."""
        taken = set(self.tools.values())
        free = next(number for number in range(1, len(taken) + 2) if number not in taken)
        return float(self.tools.setdefault(name, free))


class Reading:
    """One line: its words as they gather."""

    def __init__(self, memory: Memory, pieces: Pieces) -> None:
        self.memory, self.pieces = memory, pieces
        self.number: float | None = None
        self.words: list[WordItem] = []
        self.assignments: list[Assignment] = []
        self.machine = self.shifts = self.calls = False

    def read(self) -> None:
        """Take all pieces."""
        first = self.pieces.next
        if first is not None and first.kind == "address" and first.head == "N":
            self.number = self.pieces.take().value
        while (token := self.pieces.next) is not None:
            self.pieces.at += 1
            kind = _KINDS.get(token.kind)
            if kind is None:
                raise self.pieces.error(token, "a word is expected here: delete this")
            kind(self, token)
        self._dwell()

    def word(self, letter: str, value: Expression | float, token: Token) -> None:
        """Add a word of ISO 6983."""
        if isinstance(value, float | int):
            value = Number(float(value))
        self.words.append(WordItem(letter, value, token.column, token.text))

    def address(self, token: Token) -> None:
        """A letter and a number."""
        if token.head == "G":
            self._g(token)
        elif token.head == "D":
            self._edge(token)
        elif token.head == "T":
            self._tool(Number(token.value), token)
        elif token.head == "M" and token.value in FOREIGN_M:
            raise self.pieces.error(
                token, "subprograms are not called by M codes in the dialect siemens: delete it"
            )
        elif token.head in LETTERS:
            self.word(token.head, token.value, token)
        else:
            raise self.pieces.error(token, f"{token.head} is no address that is known: delete it")

    def _g(self, token: Token) -> None:
        if f"G{token.value:g}" in WITHOUT_MOTION:
            return
        code = float(SAME_AS.get(token.value, token.value))
        if token.value not in SAME_AS and code not in G_CODES:
            raise self.pieces.error(
                token, f"G{token.value:g} is not known in the dialect siemens: delete or rewrite it"
            )
        self.word("G", code, token)

    def _dwell(self) -> None:
        """G4 F: seconds."""
        if any(word.letter == "G" and word.value == Number(4.0) for word in self.words):
            self.words = [
                replace(word, letter="P") if word.letter == "F" else word for word in self.words
            ]

    def _edge(self, token: Token) -> None:
        """D0: no tool offset; D1: length and radius of the tool in the spindle."""
        if token.value not in (0, 1):
            raise self.pieces.error(token, "only the first cutting edge is known: write D1 or D0")
        tool = self.memory.tool if token.value else Number(0.0)
        self.word("D", tool, token)
        self.word("H", tool, token)
        self.word("G", 43.0, token)

    def _tool(self, number: Expression, token: Token) -> None:
        self.memory.selected = number
        self.word("T", number, token)

    def assigned(self, token: Token) -> None:
        """``X=…``, ``CR=…``, ``T="…"`` or ``VARIABLE=…``."""
        pieces, name = self.pieces, token.head
        following = pieces.next
        if name == "T" and following is not None and following.kind == "string":
            pieces.at += 1
            self._tool(Number(self.memory.tool_number(following.text.strip('" '))), token)
            return
        value = pieces.expression()
        if name == "CR":
            self.word("R", value, token)
        elif name in LETTERS:
            self.word(name, value, token)
        elif len(name) > 1:
            target = Parameter(VARIABLE + name.lower())
            self.assignments.append(Assignment(target, value, token.column))
        else:
            raise pieces.error(token, f"{name} takes no expression here: write a number")

    def named(self, token: Token) -> None:
        """A word of its own."""
        if token.head in WITHOUT_MOTION:
            return
        action = _NAMED.get(token.head)
        if action is None:
            raise self.pieces.error(
                token, "this word is not known in the dialect siemens: delete it or rewrite it"
            )
        action(self, token)

    def called(self, token: Token) -> None:
        """A word with arguments in brackets."""
        if token.head == "MSG":
            self._message()
            return
        arguments = self.pieces.arguments()
        if token.head == "CYCLE832":
            self.word("G", 64.0, token)
            if arguments:
                self.word("P", arguments[0], token)
        elif token.head != "CYCLE800" or arguments:
            raise self.pieces.error(token, CALLS.get(token.head, CALLS[""]))

    def _message(self) -> None:
        text = self.pieces.next
        if text is not None and text.kind == "string":
            self.pieces.comments.append(self.pieces.take().text.strip('"'))
        if not self.pieces.skips(")"):
            raise self.pieces.error(self.pieces.next, 'MSG takes a text: write MSG("…")')

    def define(self, token: Token) -> None:
        """``DEF REAL A, B=1``: variables are 0 unless they are given a value."""
        pieces = self.pieces
        kind = pieces.next
        if kind is None or kind.head not in TYPES:
            raise pieces.error(kind, "DEF needs a type: write REAL, INT or BOOL")
        pieces.at += 1
        while (name := pieces.next) is not None:
            pieces.at += 1
            if name.kind not in ("name", "set"):
                raise pieces.error(name, "the name of a variable is expected here: add it")
            value = pieces.expression() if name.kind == "set" else Number(0.0)
            target = Parameter(VARIABLE + name.head.lower())
            self.assignments.append(Assignment(target, value, name.column))
            if pieces.next is not None and not pieces.skips(","):
                raise pieces.error(pieces.next, "a comma is expected here: add it")

    def supa(self, token: Token) -> None:
        """The machine's coordinates, in this block."""
        self.machine = True
        self.word("G", 53.0, token)

    def translate(self, token: Token) -> None:
        """TRANS: shifts the origin and forgets every turn of the axes before."""
        given = self._axes(token)
        self.shifts = True
        self.memory.frame = UNTURNED
        self.memory.shifted = any(constant(value) != 0 for value in given.values())
        self.word("G", 52.0, token)
        for letter in "XYZ":
            self.word(letter, given.get(letter, Number(0.0)), token)

    def turn(self, token: Token) -> None:
        """AROT: turns the axes further."""
        given = self._axes(token)
        if not given:
            raise self.pieces.error(token, "AROT names no axis: add X, Y or Z and an angle")
        angles = [constant(given.get(letter, Number(0.0))) for letter in "XYZ"]
        if None in angles:
            raise self.pieces.error(token, "AROT takes numbers here: write the angle itself")
        x, y, z = (angle or 0.0 for angle in angles)
        self.memory.frame = turned(self.memory.frame, x, y, z)

    def _axes(self, token: Token) -> dict[str, Expression]:
        """The rest of the line, as axes and values."""
        given: dict[str, Expression] = {}
        while (item := self.pieces.next) is not None:
            self.pieces.at += 1
            if item.kind not in ("address", "set") or item.head not in "XYZ":
                raise self.pieces.error(item, f"{token.head} takes X, Y and Z only: delete this")
            given[item.head] = (
                self.pieces.expression() if item.kind == "set" else Number(item.value)
            )
        return given

    def transform(self, token: Token) -> None:
        """TRAORI, TRAFOOF."""
        self.memory.transformed = token.head == "TRAORI"

    def modal_call(self, token: Token) -> None:
        """MCALL CYCLE81(…): after each block that moves, a hole; MCALL: no more."""
        call = self.pieces.next
        self.calls = True
        if call is None:
            self.memory.drilling = None
            self.word("G", self.memory.motion, token)
            return
        self.pieces.at += 1
        if call.head != "CYCLE81":
            raise self.pieces.error(call, "MCALL is known with CYCLE81 only: post single moves")
        arguments = self.pieces.arguments()
        if len(arguments) != 4:
            raise self.pieces.error(
                call, "CYCLE81 is known as (RTP, RFP, SDIS, DP): write these four"
            )
        self.memory.drilling = arguments


def constant(value: Expression) -> float | None:
    """Value of a number with its signs, None of anything else."""
    if isinstance(value, Number):
        return value.value
    if isinstance(value, Unary):
        inner = constant(value.operand)
        return None if inner is None else -inner if value.operator == "-" else inner
    return None


_KINDS: Mapping[str, Callable[[Reading, Token], None]] = {
    "address": Reading.address,
    "set": Reading.assigned,
    "name": Reading.named,
    "call": Reading.called,
}
_NAMED: Mapping[str, Callable[[Reading, Token], None]] = {
    "DEF": Reading.define,
    "SUPA": Reading.supa,
    "TRANS": Reading.translate,
    "AROT": Reading.turn,
    "TRAORI": Reading.transform,
    "TRAFOOF": Reading.transform,
    "MCALL": Reading.modal_call,
}
