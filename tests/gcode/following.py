"""Follow a program given as text: what the tests of meanings start from."""

import numpy as np

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup

MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)


def follow(text: str, **choices) -> Moves:
    """Moves of a program; ``choices`` are those of Setup.  Line by line, without compiled code."""
    program = parse_program(text.encode(), "P")
    return Interpreter(program, Setup(**choices), compiled=False).moves()


def refusal(text: str, **choices) -> str:
    """What is said of a program that cannot be followed."""
    try:
        follow(text, **choices)
    except GcodeError as error:
        return str(error)
    raise AssertionError("the program was followed")


def ends(moves: Moves, axes: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Where the moving rows end, and which of them are rapid."""
    rows = np.isin(moves.kind, MOVING)
    return moves.end[rows, :axes], moves.kind[rows] == Kind.RAPID


def points(moves: Moves, axes: int = 3) -> list[list[float]]:
    """Where the moving rows end, without those that stay where they are."""
    here, found = moves.origin[:axes], []
    for row in np.flatnonzero(np.isin(moves.kind, MOVING)):
        end = moves.end[row, :axes]
        if not np.allclose(end, here, atol=1e-9, rtol=0):
            found.append(end.round(9).tolist())
        here = end
    return found


def kinds(moves: Moves) -> list[str]:
    """Names of the rows' kinds."""
    return [Kind(kind).name for kind in moves.kind]
