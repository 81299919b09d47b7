"""A part program on a machine: what the control makes of it, row by row."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import read_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.planner import Plan, limited_path, plan

Floats = NDArray[np.float64]


def program_moves(path: Path, setup: Setup, progress: Callable[[int], None] | None = None) -> Moves:
    """Moves of the part program at ``path``.

    Raises
    ------
    GcodeError
        At the first word that cannot be followed.
    """
    return interpret(read_program(path), setup, progress)


@dataclass(frozen=True, kw_only=True)
class Overrides:
    """What the operator sets while a program runs, over what is programmed [1].

    Each is one number, or one a row.
    """

    feed: Floats | float = 1.0
    rapid: Floats | float = 1.0
    spindle: Floats | float = 1.0


AS_PROGRAMMED = Overrides()


def planned_program(
    moves: Moves, control: ControlParameters, overrides: Overrides = AS_PROGRAMMED
) -> Plan:
    """What ``control`` makes of ``moves``.

    Raises
    ------
    ValueError
        As :func:`pipeline.machine.control.planner.plan`.
    """
    return plan(
        limited_path(moves, control),
        speeds=moves.speed * overrides.spindle,
        feed_override=np.asarray(overrides.feed) * 100,
        rapid_override=np.asarray(overrides.rapid) * 100,
    )
