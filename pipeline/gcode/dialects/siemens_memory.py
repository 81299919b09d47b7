"""Modal data of a Sinumerik 840D program, and the frames that a table's turn has to cancel.

TRAORI keeps the tool's tip on the workpiece while the table turns about B and C, AROT turns the
program's axes on the workpiece.  Only turns that cancel are followed,

    R_y(-B) R_z(-C) R_AROT = 1,

with the work offset where the axes of B and C meet; everything else would need the machine's
dimensions.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Frames" (AROT: additive, about the axes
already turned; R_z R_y R_x within a block), Job Planning, "Transformations".
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pipeline.gcode.dialects.siemens_tokens import Token
from pipeline.gcode.statements import (
    Control,
    Expression,
    ExpressionError,
    Number,
    ParameterStore,
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
