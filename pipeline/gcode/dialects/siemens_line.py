"""Lines of a Sinumerik 840D program, token by token, as words of ISO 6983.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, Job Planning, Cycles.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pipeline.gcode.dialects.siemens_cycles import (
    ARGUMENTS,
    PATTERNS,
    POCKETS,
    CycleCall,
    CycleError,
    Pocket,
    Words,
    cycle_call,
    hole,
    places,
)
from pipeline.gcode.dialects.siemens_tokens import (
    ARGUMENT,
    COMPUTED,
    JUMPS,
    KIND,
    OMITTED,
    WORDS,
    Token,
    call_of,
    control_of,
)
from pipeline.gcode.dialects.siemens_words import (
    AXES,
    FEEDS,
    FOREIGN_M,
    LETTERS,
    UNROTATED,
    WITH_MOTION,
    WITHOUT_MOTION,
    Values,
    WordReader,
    rotated,
)
from pipeline.gcode.statements import Expression, Number, Parameter, WordItem

TYPES = frozenset({"REAL", "INT", "BOOL"})
FRAMES = frozenset((
    "ROT", "RPL", "ROTS", "AROTS", "CROTS", "TOROT", "TOFRAME", "SCALE", "ASCALE",
    "MIRROR", "AMIRROR",
))  # fmt: skip
ALONE = frozenset({"ROT", "SCALE", "MIRROR"})
"""Words that without an axis end every frame, as TRANS does."""
SHOWN = frozenset({"GROUP_BEGIN", "GROUP_ADDEND", "GROUP_END", "WORKPIECE"})
"""Calls that the control's screen shows."""
ATTRIBUTES = frozenset({"SAVE", "DISPLOF", "DISPLON", "SBLOF", "SBLON", "ACTBLOCNO"})
"""Attributes that may stand behind PROC."""
CYCLE = re.compile(r"CYCLE\d+|POCKET\d|SLOT\d|LONGHOLE|HOLES\d|CONTPRON|RET|ISOCALL")
"""Names that are no subprogram of the user."""
UNKNOWN = "this cycle or function is not known in the dialect siemens: post it as single moves"
SWIVEL = (
    "swivelling by CYCLE800 needs the machine's dimensions: post the turned plane with TRAORI and "
    "AROT"
)


class LineReader(WordReader):
    """Reader of one line, and what it calls."""

    def read(self) -> None:
        """Read all tokens."""
        first = self.stream.next
        if first is not None and first.kind == "address" and first.head == "N":
            self.number = self.stream.take().value
        head = self.stream.next
        if head is not None and head.kind == "label":
            self.stream.at += 1
            head = self.stream.next
        if head is not None and head.kind == "name" and head.head in WORDS | JUMPS:
            self.stream.at += 1
            self.control = self._typed(control_of(head, self.stream))
            return
        while (token := self.stream.next) is not None:
            self.stream.at += 1
            kind = _KINDS.get(token.kind)
            if kind is None:
                raise self.stream.error(token, "a word is expected here: delete this")
            kind(self, token)
        self._change_tool()
        self._dwell()
        self._centre_mode()
        self._set_apart()
        self._in_machine()

    def address(self, token: Token) -> None:
        """Word of a letter and a number."""
        if token.head == "G":
            self._g(token)
        elif token.head == "D":
            self._edge(token)
        elif token.head == "T":
            self._tool(Number(token.value), token)
        elif token.head == "M" and token.value in FOREIGN_M:
            raise self.stream.error(
                token, "no M code calls a subprogram in the dialect siemens: write its name or L"
            )
        elif token.head in LETTERS:
            self.word(token.head, token.value, token)
        elif token.head == "L":
            self.subprogram(token)
        else:
            instead = "write CR=" if token.head == "R" else "rewrite the block without it"
            raise self.stream.error(token, f"{token.head} is no address that is known: {instead}")

    def named(self, token: Token) -> None:
        """Word without a value: a setting, a keyword or a subprogram."""
        if token.head in WITHOUT_MOTION:
            return
        _NAMED.get(token.head, LineReader.subprogram)(self, token)

    def called(self, token: Token) -> None:
        """A word with arguments in brackets."""
        if token.head == "MSG":
            self._message(token)
            return
        if token.head in SHOWN:
            self._passed_over(token)
            return
        if token.head in ARGUMENTS:
            self.cycle(token)
            return
        if not CYCLE.fullmatch(token.head):
            self.named(token)
            return
        if token.head not in ("CYCLE800", "CYCLE832"):
            raise self.stream.error(token, UNKNOWN)
        arguments = self._arguments()
        if token.head == "CYCLE832":
            self.word("G", 64.0, token)
            if arguments:
                self.word("P", arguments[0], token)
        elif arguments:
            raise self.stream.error(token, SWIVEL)

    def _passed_over(self, token: Token) -> None:
        """The arguments of a call that moves nothing, whatever they are."""
        depth = 1
        while depth:
            if self.stream.next is None:
                raise self.stream.error(token, "its ) is missing: add it")
            one = self.stream.take()
            depth += (one.text == "(" or one.kind == "call") - (one.text == ")")

    def _message(self, token: Token) -> None:
        """``MSG("Y " << R1)``: texts and values that the screen shows."""
        start = self.stream.at
        self._passed_over(token)
        texts = [one.text for one in self.stream.tokens[start : self.stream.at - 1]]
        self.stream.comments.append(" ".join(text.strip('"') for text in texts))

    def define(self, token: Token) -> None:
        """``DEF REAL A, B=1``: variables are 0 unless they are given a value."""
        stream, kind = self.stream, self._type(token)
        if stream.next is None:
            raise stream.error(kind, "DEF needs the name of a variable: add it")
        while (name := stream.next) is not None:
            if name.head in FEEDS | AXES or name.head in WITH_MOTION:
                raise stream.error(name, f"{name.head} is a word of the control: take another name")
            self._declare(kind)
            if stream.next is not None and not stream.skips(","):
                raise stream.error(stream.next, "a comma is expected here: add it")

    def _type(self, token: Token) -> Token:
        kind = self.stream.next
        if kind is None or kind.head not in TYPES:
            raise self.stream.error(
                kind, f"{token.head} needs a type: write REAL, INT or BOOL; VAR and texts are not "
                "followed"
            )  # fmt: skip
        return self.stream.take()

    def _declare(self, kind: Token, given: Expression | None = None) -> None:
        """A variable of a type, with the value that a call gives, or its own, or 0."""
        name = self.stream.next
        if name is None or name.kind not in ("name", "set"):
            raise self.stream.error(name, "the name of a variable is expected here: add it")
        self.stream.at += 1
        value = self.stream.expression() if name.kind == "set" else Number(0.0)
        self.memory.defined[name.head.lower()] = kind.head
        self._assign(name.head, given or value, name)

    def returns(self, token: Token) -> None:
        """RET: ends the program as M17 does."""
        self.word("M", 17.0, token)

    def frame(self, token: Token) -> None:
        """ROT, SCALE and MIRROR without an axis end every frame as TRANS does; no other goes."""
        if token.head in ALONE and self.stream.next is None:
            self.translate(token)
            return
        raise self.stream.error(
            token, f"{token.head} moves the program's axes in a way that is not followed: post the "
            "coordinates without it, or with TRANS"
        )  # fmt: skip

    def subprogram(self, token: Token) -> None:
        """A call by name, by L or by CALL and its like."""
        alone = not (CYCLE.fullmatch(token.head) or self.words or self.assignments)
        self.control = call_of(token, self.stream, alone=alone)

    def procedure(self, token: Token) -> None:
        """``PROC NAME(REAL A, INT B=2) SAVE``: what the call gives becomes variables."""
        stream, given, number = self.stream, self.memory.given, 0
        name = stream.take() if stream.next else token
        while name.kind == "call" and not stream.skips(")"):
            number += 1
            value = Parameter(f"{ARGUMENT}{number}") if number in given else None
            self._declare(self._type(token), value)
            stream.skips(",")
        if max(given, default=0) > number:
            raise stream.error(name, f"takes {number} values and is given more: correct the call")
        for word in stream.tokens[stream.at :]:
            if word.head not in ATTRIBUTES:
                raise stream.error(word, "this is not followed behind PROC: delete it")
            self.memory.saves |= word.head == "SAVE"
        stream.at = len(stream.tokens)

    def extern(self, token: Token) -> None:
        """``EXTERN NAME(REAL, INT)``: announces a subprogram."""
        self.stream.at = len(self.stream.tokens)

    def computed(self, token: Token) -> None:
        """A jump to where a value says, or lines between labels."""
        raise self.stream.error(
            token, f"{token.head} is not followed: write IF … GOTOF, WHILE or FOR"
        )

    def supa(self, token: Token) -> None:
        """The machine's coordinates, in this block."""
        self.machine = True
        self.word("G", 53.0, token)

    def translate(self, token: Token) -> None:
        """TRANS: shifts the origin and forgets every turn of the axes before; ATRANS adds to it."""
        self._by_itself(token)
        given = self._axes(token)
        self.shifts = True
        memory = self.memory
        if token.head == "ATRANS" and not np.array_equal(memory.frame, UNROTATED):
            raise self.stream.error(
                token, "ATRANS along axes that AROT turned is not followed: write TRANS and AROT"
            )
        if token.head == "ATRANS" and not given:
            raise self.stream.error(token, "ATRANS names no axis: add X, Y or Z")
        before = memory.shift if token.head == "ATRANS" else {}
        memory.frame, memory.shift = UNROTATED, dict(before)
        for letter, value in given.items():
            memory.shift[letter] = before.get(letter, 0.0) + value
        memory.at["X"] = memory.at["Y"] = None
        self.word("G", 52.0, token)
        for letter in "XYZ":
            self.word(letter, memory.shift.get(letter, 0.0), token)

    def turn(self, token: Token) -> None:
        """AROT: additive rotation of the axes."""
        self._by_itself(token)
        given = self._axes(token)
        if not given:
            raise self.stream.error(token, "AROT names no axis: add X, Y or Z and an angle")
        self.memory.frame = rotated(self.memory.frame, *(given.get(axis, 0.0) for axis in "XYZ"))
        self.memory.at["X"] = self.memory.at["Y"] = None

    def _axes(self, token: Token) -> dict[str, float]:
        given: dict[str, float] = {}
        while (item := self.stream.next) is not None:
            self.stream.at += 1
            if item.kind not in ("address", "set") or item.head not in "XYZ":
                raise self.stream.error(item, f"{token.head} takes X, Y and Z only: delete this")
            one = self.stream.expression() if item.kind == "set" else Number(item.value)
            value = self.memory.value(one)
            if value is None:
                raise self.stream.error(item, f"{token.head} takes numbers: write the value itself")
            given[item.head] = value
        return given

    def transform(self, token: Token) -> None:
        """Transformation TRAORI or TRAFOOF."""
        self.memory.transformed = token.head == "TRAORI"

    def modal_call(self, token: Token) -> None:
        """MCALL CYCLE81(…): after each block that moves, a hole; MCALL: no more."""
        call = self.stream.next
        self.calls = True
        if call is None:
            self.memory.drilling = self.memory.modal = None
            self.word("G", self.memory.motion, token)
            return
        self.stream.at += 1
        self.memory.drilling = self.memory.modal = None
        if call.head in ARGUMENTS and call.head not in PATTERNS + POCKETS:
            self.memory.drilling = call, tuple(map(self.memory.value, self._arguments()))
            self._hole(*self.memory.drilling)  # refuses here what it does not know
        elif CYCLE.fullmatch(call.head):
            raise self.stream.error(
                call,
                "MCALL is known with CYCLE81 to 86 and 89 and subprograms: post single moves",
            )
        else:
            control = call_of(call, self.stream)
            known = [(one, self.memory.value(one)) for one in control.arguments]
            kept = tuple(one if v is None or one is OMITTED else Number(v) for one, v in known)
            self.memory.modal = replace(control, kind=f"{KIND}mcall", arguments=kept)

    def _arguments(self) -> tuple[Expression, ...]:
        start = self.stream.at
        arguments = self.stream.arguments(texts=True)
        self._uses(start)
        return arguments

    def drilled(self) -> None:
        """Blocks of the cycle or call that MCALL put in force, after the words of the block."""
        self.control = self.memory.modal
        if self.memory.drilling is not None:
            self.rest += self._hole(*self.memory.drilling)

    def _call(self, token: Token, values: Values) -> CycleCall:
        memory = self.memory
        call = cycle_call(
            token.head, values, unit=memory.unit, feed=memory.feed or 0, speed=memory.speed or 0
        )
        if memory.compensated:
            raise CycleError(f"{token.head} cannot run under G41 or G42: write G40 before")
        if memory.plane != 17 and token.head not in PATTERNS:
            raise CycleError(f"{token.head} is followed along Z, under G17: post single moves")
        return call

    def _hole(self, token: Token, values: Values) -> list[tuple[WordItem, ...]]:
        """Blocks of a hole; the motion in force is so again after them."""
        try:
            blocks = hole(token.head, self._call(token, values))
        except CycleError as error:
            raise self.stream.error(token, str(error)) from None
        return [self._block(token, words) for words in (*blocks, (("G", self.memory.motion),))]

    @staticmethod
    def _block(token: Token, words: Words) -> tuple[WordItem, ...]:
        return tuple(
            WordItem(one[-1], Number(v), token.column, token.text, one[0] != "+")
            for one, v in words
        )

    def cycle(self, token: Token) -> None:
        """A cycle without MCALL, where the tool stands, or a pattern of those of MCALL."""
        self._by_itself(token)
        memory = self.memory
        values = tuple(memory.value(one) for one in self._arguments())
        try:
            if token.head in PATTERNS:
                self._pattern(token, self._call(token, values))
                return
            if memory.transformed or not np.array_equal(memory.frame, UNROTATED):
                raise CycleError(f"{token.head} is followed along Z, under G17: post single moves")
            if token.head in POCKETS:
                self._pocket(token, self._call(token, values))
                return
        except CycleError as error:
            raise self.stream.error(token, str(error)) from None
        self.rest += self._hole(token, values)

    def _pattern(self, token: Token, call: CycleCall) -> None:
        memory = self.memory
        if memory.drilling is None:
            raise CycleError(f"{token.head} drills nothing without a cycle: write MCALL CYCLE81(…)")
        found = places(call, (memory.at["X"], memory.at["Y"]))
        for x, y in found:
            self.rest.append(self._block(token, (("G", 0.0), ("X", x), ("Y", y))))
            self.drilled()
        memory.at["X"], memory.at["Y"] = found[-1]

    def _pocket(self, token: Token, call: CycleCall) -> None:
        memory = self.memory
        number = memory.value(memory.tool)
        radius = memory.radii.get(int(number or 0), 0.0) / call.unit
        if not radius:
            raise CycleError(
                f"{token.head} needs the radius of the tool: give the diameter of tool "
                f"{number or 0:g} in setup.tools of the machine's file"
            )
        pocket = Pocket(call=call, radius=radius)
        pocket.check()
        blocks = (*pocket.blocks(), (("G", memory.motion),))
        self.rest += [self._block(token, words) for words in blocks]
        memory.at["X"], memory.at["Y"] = call.given["PA"], call.given["PO"]
        memory.note(
            self.stream.line,
            f"{token.head} is milled on paths of the control's own: length and time "
            "are approximate",
        )


_KINDS: Mapping[str, Callable[[LineReader, Token], None]] = {
    "address": LineReader.address,
    "set": LineReader.assigned,
    "name": LineReader.named,
    "call": LineReader.called,
}
_NAMED: Mapping[str, Callable[[LineReader, Token], None]] = {
    "DEF": LineReader.define,
    "SUPA": LineReader.supa,
    "TRANS": LineReader.translate,
    "ATRANS": LineReader.translate,
    "AROT": LineReader.turn,
    "TRAORI": LineReader.transform,
    "TRAFOOF": LineReader.transform,
    "MCALL": LineReader.modal_call,
    "RET": LineReader.returns,
    **dict.fromkeys(FRAMES, LineReader.frame),
    "PROC": LineReader.procedure,
    "EXTERN": LineReader.extern,
    **dict.fromkeys(COMPUTED, LineReader.computed),
}
