"""Words of one line of a Sinumerik 840D program, as words of ISO 6983.

On a machine whose table turns about B and C, TRAORI keeps the tool's tip on the workpiece while the
table turns, AROT turns the program's axes on the workpiece.  A post processor that mills in a
tilted plane turns both so that they cancel,

    R_y(-B) R_z(-C) R_AROT = 1,

and then the linear axes move as the program says, from the point where the axes of B and C meet,
which is where the work offset must lie.  Only this is followed here; everything else would need the
machine's dimensions.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Frames" (AROT: additive, about the axes
already turned; R_z R_y R_x within a block), Job Planning, "Transformations".
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

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
from pipeline.gcode.dialects.siemens_flow import (
    COMPUTED,
    JUMPS,
    KIND,
    WORDS,
    call_of,
    control_of,
)
from pipeline.gcode.dialects.siemens_tokens import (
    ARGUMENT,
    OMITTED,
    R_PARAMETER,
    VARIABLE,
    Token,
    TokenStream,
    variable,
)
from pipeline.gcode.statements import (
    Assignment,
    Binary,
    Call,
    Control,
    Expression,
    ExpressionError,
    Number,
    Parameter,
    ParameterStore,
    WordItem,
    constant,
    evaluate,
)

Matrix = npt.NDArray[np.float64]
Values = tuple[float | None, ...]
"""Arguments of a cycle, None where one is not known."""
SQUARE = 1e-6
"""Angle by which table and work plane may miss cancelling each other [rad]."""
UNROTATED: Matrix = np.eye(3)


def token_of(word: WordItem) -> Token:
    """The token of a word, for errors."""
    return Token("", word.text, word.column, "", 0.0)


def rotation(axis: int, degrees: float) -> Matrix:
    """Matrix (3, 3) of a rotation about X (0), Y (1) or Z (2)."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix


def rotated(frame: Matrix, x: float, y: float, z: float) -> Matrix:
    """A frame after a further AROT X Y Z [deg]."""
    return frame @ rotation(2, z) @ rotation(1, y) @ rotation(0, x)


def tilt(frame: Matrix, b: float, c: float) -> float:
    """Angle between the program's axes and the machine's with the table at B and C [rad]."""
    residual = rotation(1, -b) @ rotation(2, -c) @ frame
    # |R - 1| is √2 times a small angle; the arccos of the trace would lose half its digits
    return float(np.linalg.norm(residual - UNROTATED) / math.sqrt(2))


G_CODES = frozenset(
    (0, 1, 2, 3, 4, 9, 17, 18, 19, 40, 41, 42, 53, 54, 55, 56, 57, 64, 70, 71, 90, 91, 93, 94, 95,
     96, 97, 500, 700, 710)
)  # fmt: skip
"""G codes with the same meaning as in ISO 6983."""
FOREIGN_M = frozenset((98, 99, 198))
"""Subprograms of other controls."""
SAME_AS: dict[float, int] = {
    60: 61,  # exact stop, modal
    **dict.fromkeys((641, 642, 643, 644, 645), 64),
}
"""G code -> the one with the same path here; 641 to 645 differ in how they round corners."""

WITHOUT_MOTION: dict[str, str] = {
    "ADIS": "size of the corners that G641 rounds",
    "ADISPOS": "the same of rapids",
    "BRISK": "acceleration in steps",
    "COMPCAD": "compressor on",
    "COMPCURV": "compressor on",
    "COMPOF": "compressor off",
    "COMPON": "compressor on",
    "CUT2D": "compensation in the plane, as is done here",
    "DIAMOF": "X is a radius",
    "DRIVE": "acceleration that falls with speed",
    "DYNFINISH": "dynamics for finishing",
    "DYNNORM": "normal dynamics",
    "DYNPOS": "dynamics for positioning",
    "DYNROUGH": "dynamics for roughing",
    "DYNSEMIFIN": "dynamics for semi-finishing",
    "FFWOF": "feed-forward control off",
    "FFWON": "feed-forward control on",
    "FNORM": "feed as F says, constant in a block",
    "G450": "around outer corners as an arc, as is done here",
    "G601": "exact stop fine",
    "G602": "exact stop coarse",
    "G603": "exact stop at the end of interpolation",
    "G290": "words of a Sinumerik",
    "LIMS": "greatest speed of the spindle under G96",
    "NORM": "straight to the contour and away from it, as is done here",
    "SBLOF": "single blocks off",
    "SBLON": "single blocks on",
    "SOFT": "acceleration with limited jerk",
    "STOPRE": "blocks are read ahead up to here",
}
"""Word -> what it sets; where the path goes does not depend on it."""

WITH_MOTION: dict[str, str] = {
    **dict.fromkeys(("RND", "RNDM"), "rounds the corner"),
    **dict.fromkeys(("CHF", "CHR"), "chamfers the corner"),
    **dict.fromkeys(("ANG", "ANG1", "ANG2"), "gives the line by its angle"),
    **dict.fromkeys(("AP", "RP"), "gives the point in polar coordinates"),
    "AR": "gives the arc by its angle",
    "OFFN": "sets the contour off",
    **dict.fromkeys(("DISR", "DISCL", "DISRP"), "moves onto the contour"),
}
"""Address of a block that is not followed -> what it does; no variable may have its name."""

FEEDS = frozenset({"FB", "FRC", "FRCM", "FAD", "OVR", "FZ", "FA", "FD"})
"""Feeds of a block, a corner, a tooth or an axis."""

AXES = frozenset("XYZABC")
CENTRES = frozenset("IJK")
LETTERS = frozenset("ABCFIJKMSXYZ")
"""Addresses whose value is passed on as it stands; H would be a function of the machine builder."""
TYPES = frozenset({"REAL", "INT", "BOOL"})
OWN_MODES = frozenset({"AC", "IC"})
"""``X=AC(1)`` counts from the origin, ``X=IC(1)`` from where the axis stands, in this block."""
WAYS = frozenset({"DC", "ACP", "ACN"})
"""The way that a rotary axis takes."""
FRAMES = frozenset((
    "ROT", "RPL", "ROTS", "AROTS", "CROTS", "TOROT", "TOFRAME", "SCALE", "ASCALE",
    "MIRROR", "AMIRROR",
))  # fmt: skip
ALONE = frozenset({"ROT", "SCALE", "MIRROR"})
"""Without an axis they end every frame, as TRANS does."""
SHOWN = frozenset({"GROUP_BEGIN", "GROUP_ADDEND", "GROUP_END", "WORKPIECE"})
"""Calls that the control's screen shows."""
ATTRIBUTES = frozenset({"SAVE", "DISPLOF", "DISPLON", "SBLOF", "SBLON", "ACTBLOCNO"})
"""What may stand behind PROC."""
CYCLE = re.compile(r"CYCLE\d+|POCKET\d|SLOT\d|LONGHOLE|HOLES\d|CONTPRON|RET|ISOCALL")
"""Names that are no subprogram of the user."""
UNKNOWN = "this cycle or function is not known in the dialect siemens: post it as single moves"
SWIVEL = (
    "swivelling by CYCLE800 needs the machine's dimensions: post the turned plane with TRAORI and "
    "AROT"
)


@dataclass(slots=True)
class ModalMemory:
    """Modal data of a Sinumerik program that later lines refer to."""

    tools: dict[str, int]
    """Number of each tool's name."""
    selected: Expression = field(default_factory=lambda: Number(0.0))
    tool: Expression = field(default_factory=lambda: Number(0.0))
    """Number of the tool called by T, and of the one in the spindle."""
    motion: float = 0.0
    """G code of group 1 in force."""
    drilling: tuple[Token, Values] | None = None
    """Token and arguments of the drilling cycle that MCALL put in force."""
    modal: Control | None = None
    """Call of the subprogram that MCALL put in force."""
    feed: float | None = None
    speed: float | None = None
    """Last F and S, where they are known."""
    unit: float = 1.0
    """Millimetres in the program's unit of length."""
    plane: float = 17.0
    """17, 18 or 19."""
    frame: Matrix = field(default_factory=lambda: UNROTATED)
    """AROT: from the program's axes to the workpiece's."""
    shift: dict[str, float] = field(default_factory=dict)
    """TRANS and ATRANS by axis."""
    absolute: bool = True
    transformed: bool = False
    compensated: bool = False
    """G90, TRAORI, G41 or G42."""
    at: dict[str, float | None] = field(default_factory=lambda: dict.fromkeys("BCXY"))
    """Last B, C, X and Y, where they were given as numbers in the frame in force [unit, deg]."""
    defined: dict[str, str] = field(default_factory=dict)
    """Type of each variable that has one, by its name in small letters."""
    common: frozenset[str] = frozenset()
    """Variables of the setup, which every program knows."""
    given: frozenset[int] = frozenset()
    """Numbers of the arguments that the call of the program gives."""
    saves: bool = False
    """Whether its PROC says SAVE."""

    def enter(self, given: frozenset[int], *, modal: bool) -> "ModalMemory":
        """A subprogram begins; what was before.  MCALL calls nothing while it runs itself."""
        before = replace(self, at=dict(self.at), defined=self.defined)
        self.given, self.saves = given, False
        self.modal = None if modal else self.modal
        self.defined = {name: kind for name, kind in self.defined.items() if name in self.common}
        return before

    def leave(self, before: "ModalMemory", *, modal: bool) -> None:
        """It ends: variables are those of its caller, and with SAVE G codes and frames."""
        names = ["defined", "given", "saves", *(["modal"] if modal else [])]
        if self.saves:
            names += ["motion", "unit", "plane", "frame", "shift", "absolute"]
            self.at["X"] = self.at["Y"] = None
        for name in names:
            setattr(self, name, getattr(before, name))

    store: ParameterStore | None = None
    """Variables as they are when a line is read, which is when it is carried out."""
    radii: dict[int, float] = field(default_factory=dict)
    """Radius of each tool [mm]."""
    note: Callable[[int, str], None] = lambda line, what: None
    """Tells the user something about a line."""

    def value(self, expression: Expression) -> float | None:
        """Value of an expression; None where it is not known."""
        if self.store is None:
            return constant(expression)
        try:
            return evaluate(expression, self.store)
        except ExpressionError:
            return None

    @property
    def called(self) -> str:
        """Name of what MCALL put in force; empty where there is none."""
        cycle = self.drilling[0].head if self.drilling else ""
        return str(self.modal.label) if self.modal else cycle

    def tool_number(self, name: str) -> float:
        """Number of a tool in the tool table."""
        taken = set(self.tools.values())
        free = next(number for number in range(1, len(taken) + 2) if number not in taken)
        return float(self.tools.setdefault(name, free))


class LineReader:
    """Reader of one line, token by token, and the words read so far."""

    def __init__(self, memory: ModalMemory, stream: TokenStream) -> None:
        self.memory, self.stream = memory, stream
        self.number: float | None = None
        self.words: list[WordItem] = []
        self.assignments: list[Assignment] = []
        self.control: Control | None = None
        self.centres: set[str] = set()
        self.used: set[str] = set()
        self.rest: list[tuple[WordItem, ...]] = []
        self.machine = self.shifts = self.calls = False

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

    def word(
        self, letter: str, value: Expression | float, token: Token, own: bool | None = None
    ) -> None:
        """Add a word of ISO 6983; ``own`` as :attr:`WordItem.absolute`."""
        if isinstance(value, float | int):
            value = Number(float(value))
        if letter in AXES and any(word.letter == letter for word in self.words):
            raise self.stream.error(token, f"{letter} is given twice in a block: write it once")
        self.words.append(WordItem(letter, value, token.column, token.text, own))

    def address(self, token: Token) -> None:
        """A letter and a number."""
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

    def _g(self, token: Token) -> None:
        if f"G{token.value:g}" in WITHOUT_MOTION:
            return
        code = float(SAME_AS.get(token.value, token.value))
        if token.value not in SAME_AS and code not in G_CODES:
            raise self.stream.error(
                token, f"G{token.value:g} is not followed in the dialect siemens: rewrite "
                "the block without it"
            )  # fmt: skip
        self.machine |= code == 53.0
        self.word("G", code, token)

    def _centre_mode(self) -> None:
        """G90.1 where the centres of the block count from the origin, else G91.1."""
        given = [word for word in self.words if word.letter in CENTRES]
        if not given:
            return
        relative = next((word for word in given if word.letter not in self.centres), None)
        if self.centres and relative is not None:
            raise self.stream.error(
                token_of(relative),
                "the other centre of the block is given with AC: give all of them so, or none",
            )
        first = given[0]
        mode = Number(90.1 if self.centres else 91.1)
        self.words.append(WordItem("G", mode, first.column, first.text))

    def _dwell(self) -> None:
        """G4 F: seconds."""
        dwell = next((w for w in self.words if w.letter == "G" and w.value == Number(4.0)), None)
        if dwell is not None:
            if not any(word.letter == "F" for word in self.words):
                raise self.stream.error(
                    token_of(dwell),
                    "G4 is followed with seconds: write G4 F and the seconds",
                )
            self.words = [
                replace(word, letter="P") if word.letter == "F" else word for word in self.words
            ]

    def _edge(self, token: Token) -> None:
        """D0: no tool offset; D1: length and radius of the tool in the spindle."""
        if token.value not in (0, 1):
            raise self.stream.error(token, "only the first cutting edge is known: write D1 or D0")
        tool = self.memory.tool if token.value else Number(0.0)
        self.word("D", tool, token)
        self.word("H", tool, token)
        self.word("G", 43.0, token)

    def _change_tool(self) -> None:
        """M6 puts edge 1 of its tool in force (MD20270 = 1), unless D0 stands beside it."""
        change = next((w for w in self.words if w.letter == "M" and w.value == Number(6.0)), None)
        if change is None:
            return
        self.memory.tool = self.memory.selected
        edges = [word.text[1:].strip() for word in self.words if word.letter == "D"]
        self.words = [word for word in self.words if word.letter not in "DH"]
        self._edge(replace(token_of(change), value=float(edges[-1] if edges else 1)))

    def _tool(self, number: Expression, token: Token) -> None:
        self.memory.selected = number
        self.word("T", number, token)

    def assigned(self, token: Token) -> None:
        """``X=…``, ``CR=…``, ``T="…"`` or ``VARIABLE=…``."""
        stream, name = self.stream, token.head
        following = stream.next
        if name == "T" and following is not None and following.kind == "string":
            stream.at += 1
            self._tool(Number(self.memory.tool_number(following.text.strip('" '))), token)
            return
        start, own = stream.at, None
        if following is not None and following.kind == "call" and name in AXES | CENTRES:
            value, own = self._own_mode(name, token)
        else:
            value = stream.expression()
        if name in LETTERS or name in ("CR", "TURN"):
            self._uses(start)
        reason = self._not_followed(name)
        if reason:
            raise stream.error(token, reason)
        if name == "T":
            self._tool(value, token)
        elif name == "CR":
            self.word("R", value, token)
        elif name == "TURN":  # full circles beside the arc; P counts the arc too
            self.word("P", Binary("+", value, Number(1.0)), token)
        elif name == "SPOS":
            self.word("M", 19.0, token)
        elif name in WITHOUT_MOTION:
            return
        elif name in LETTERS:
            self.word(name, value, token, own)
        elif len(name) > 1:
            self._assign(name, value, token)
        else:
            raise stream.error(token, f"{name} takes no expression here: write a number")

    def _not_followed(self, name: str) -> str:
        """Why an address with ``=`` is refused; empty where it is not."""
        if name in FEEDS:
            return f"{name} is a feed that is not followed: write F with G94 or G95"
        if name in WITH_MOTION:
            return f"{name} {WITH_MOTION[name]}, which is not followed: post single moves"
        if name[1:].isdigit() and name[0] != "R":
            return (
                f"{name} is of another spindle, axis or point, which is not followed: post it for "
                "one spindle and X Y Z A B C"
            )
        return ""

    def _assign(self, name: str, value: Expression, token: Token) -> None:
        """A variable's new value, rounded for an INT."""
        key = name.lower()
        kind = "REAL" if R_PARAMETER.fullmatch(key) else self.memory.defined.get(key)
        if kind is None and name[0] == "R" and name[1:].isdigit():
            raise self.stream.error(token, f"{name} is no R parameter: they go from R0 to R999")
        if kind is None:
            raise self.stream.error(
                token, f"{name} is neither a word that is followed nor a variable: define it with "
                "DEF before, or in parameters of the machine's setup"
            )  # fmt: skip
        if kind == "INT":
            value = Call("ROUND", (value,))
        elif kind == "BOOL":
            value = Binary("NE", value, Number(0.0))
        self.assignments.append(Assignment(Parameter(variable(name)), value, token.column))

    def _typed(self, control: Control) -> Control:
        """A FOR whose variable has its type; one without DEF is a number from here on."""
        for one in control.then:
            name = str(one.target.key).removeprefix(VARIABLE).upper()
            if name not in AXES:
                self.memory.defined.setdefault(name.lower(), "REAL")
            self._assign(name, one.value, Token("set", f"{name}=", one.column, name, 0.0))
        then, self.assignments = tuple(self.assignments), []
        return replace(control, then=then) if then else control

    def _own_mode(self, name: str, token: Token) -> tuple[Expression, bool | None]:
        """Value of ``X=IC(5)``, ``X=AC(5)`` or ``I=AC(5)``, and how an axis counts it."""
        stream, mode = self.stream, self.stream.tokens[self.stream.at]
        if mode.head in WAYS:
            reason = f"the way of a rotary axis is not chosen here: write {name}=AC(…)"
            raise stream.error(mode, reason)
        if mode.head not in OWN_MODES:
            return stream.expression(), None
        stream.at += 1
        arguments = stream.arguments()
        if len(arguments) != 1:
            raise stream.error(token, f"{name}={mode.head} takes one value: write it alone")
        absolute = mode.head == "AC"
        if name in CENTRES and absolute:
            self.centres.add(name)
        return arguments[0], absolute if name in AXES else None

    def _uses(self, start: int) -> None:
        """Remember the variables that a word's tokens from ``start`` on read."""
        self.used |= {variable(one.text) for one in self.stream.tokens[start : self.stream.at]}

    def _in_machine(self) -> None:
        """No increment beside SUPA or G53."""
        found = next((word for word in self.words if word.absolute is False), None)
        if self.machine and found is not None:
            raise self.stream.error(
                token_of(found),
                "IC beside SUPA or G53 is not followed: write the machine's coordinate",
            )

    def _set_apart(self) -> None:
        """A variable that a block sets is not read by its words: controls differ in which value."""
        for one in self.assignments:
            name = str(one.target.key)
            if name in self.used:
                raise self.stream.error(
                    Token("", name.removeprefix(VARIABLE).upper(), one.column, "", 0.0),
                    "is set and used by a word in one block: set it in a block before",
                )

    def named(self, token: Token) -> None:
        """A word of its own."""
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

    def _by_itself(self, token: Token) -> None:
        if self.words or self.assignments:
            raise self.stream.error(token, f"{token.head} needs a block of its own: write it alone")

    def _axes(self, token: Token) -> dict[str, float]:
        """The rest of the line, as axes and values."""
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
        """TRAORI, TRAFOOF."""
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
        """What MCALL put in force, after the words of the block."""
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
