"""Modal data of a Sinumerik 840D program, and addresses and assignments as words of ISO 6983.

TRAORI keeps the tool's tip on the workpiece while the table turns about B and C, AROT turns the
program's axes on the workpiece.  Only turns that cancel are followed,

    R_y(-B) R_z(-C) R_AROT = 1,

with the work offset where the axes of B and C meet; everything else would need the machine's
dimensions.  Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Block rules", "Value
assignments", "Frames" (AROT: additive, about the axes already turned; R_z R_y R_x within a block),
Job Planning, "Transformations".
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pipeline.gcode.dialects.siemens_tokens import (
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
    """Plane: 17, 18 or 19."""
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
    """Notice to the user about a line."""

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
OWN_MODES = frozenset({"AC", "IC"})
"""``X=AC(1)`` counts from the origin, ``X=IC(1)`` from where the axis stands, in this block."""
WAYS = frozenset({"DC", "ACP", "ACN"})
"""Directions of a rotary axis to its target."""


def token_of(word: WordItem) -> Token:
    """The token of a word, for errors."""
    return Token("", word.text, word.column, "", 0.0)


class WordReader:
    """Words and assignments of one block, read so far."""

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

    def word(
        self, letter: str, value: Expression | float, token: Token, own: bool | None = None
    ) -> None:
        """Add a word of ISO 6983; ``own`` as :attr:`WordItem.absolute`."""
        if isinstance(value, float | int):
            value = Number(float(value))
        if letter in AXES and any(word.letter == letter for word in self.words):
            raise self.stream.error(token, f"{letter} is given twice in a block: write it once")
        self.words.append(WordItem(letter, value, token.column, token.text, own))

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

    def _by_itself(self, token: Token) -> None:
        if self.words or self.assignments:
            raise self.stream.error(token, f"{token.head} needs a block of its own: write it alone")
