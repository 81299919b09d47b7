"""What one line says: its words, assignments and control, parsed but not yet executed."""

from dataclasses import dataclass

LARGEST = 1e30
"""Numbers beyond are refused: no machine has them, and products of a few would overflow."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number as written."""

    value: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """``#5``, ``#[1+2]``, ``##3`` or ``#<name>``."""

    key: "Expression | str"


@dataclass(frozen=True, slots=True)
class Unary:
    """``-x`` or ``+x``."""

    operator: str
    operand: "Expression"


@dataclass(frozen=True, slots=True)
class Binary:
    """Two values joined by an operator, named by what it does, whatever the dialect writes.

    ``+ - * / ** GT GE LT LE``; ``MOD`` (never negative, LinuxCNC) and ``REM`` (sign of the left
    side, Fanuc's MOD); ``EQ NE`` (vacant is no 0) and ``NEAR FAR`` (EQ and NE of LinuxCNC);
    ``AND OR XOR`` of truth (LinuxCNC) and ``& | ^`` of bits (Fanuc).
    """

    operator: str
    left: "Expression"
    right: "Expression"


@dataclass(frozen=True, slots=True)
class Call:
    """``SIN[x]``, ``ATAN[y]/[x]``, ``EXISTS[#<name>]``; functions too are named by what they do.

    ``FIX FUP`` (towards and from zero, Fanuc) and ``FLOOR CEIL`` (LinuxCNC's FIX and FUP);
    ``ASIN360 ATAN360`` have values from 0 to 360 degrees.
    """

    function: str
    arguments: tuple["Expression", ...]


Expression = Number | Parameter | Unary | Binary | Call


@dataclass(frozen=True, slots=True)
class WordItem:
    """A letter and its value, ``column`` counting from 1."""

    letter: str
    value: Expression
    column: int
    text: str


@dataclass(frozen=True, slots=True)
class Assignment:
    """``#5 = …`` or ``#<name> = …``; takes effect after the line's words were evaluated."""

    target: Parameter
    value: Expression
    column: int


@dataclass(frozen=True, slots=True)
class Control:
    """Flow control of a line.

    Parameters
    ----------
    kind : str
        ``goto``, ``if_goto``, ``if_then``, ``while_do``, ``do``, ``end`` (Macro B) or, of O-words,
        ``sub``, ``endsub``, ``call``, ``return``, ``if``, ``elseif``, ``else``, ``endif``,
        ``while``, ``endwhile``, ``repeat``, ``endrepeat``, ``break``, ``continue``, ``program``
        (``O1000`` that names a program).
    label : Expression, str or None
        Name or number of an O-word as text (``"100"`` for ``O0100``), an expression where it is
        computed; loop number of DO and END; target of GOTO.
    condition : Expression or None
        Of ``if``, ``while``; the count of ``repeat``; the value of ``return`` or ``endsub``.
    arguments : tuple of Expression
        Of ``call``.
    then : tuple of Assignment
        Of ``if_then``.
    """

    kind: str
    label: "Expression | str | None"
    column: int
    condition: Expression | None = None
    arguments: tuple[Expression, ...] = ()
    then: tuple[Assignment, ...] = ()


@dataclass(frozen=True, slots=True)
class Statement:
    """One line: number in the file, N word, what it asks for, in the order written."""

    line: int
    skip: int | None
    number: float | None
    words: tuple[WordItem, ...]
    assignments: tuple[Assignment, ...]
    control: Control | None
    comments: tuple[str, ...]
