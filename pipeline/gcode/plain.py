"""Stretches of plain lines at once: the compiled way through most of a part program."""

import numpy as np

from pipeline.gcode import plain_lines
from pipeline.gcode.arcs import LINUXCNC_R_TOLERANCE, LINUXCNC_TOLERANCE, RELATIVE_RADIUS
from pipeline.gcode.moves import FeedMode
from pipeline.gcode.named_parameters import LinuxcncParameters
from pipeline.gcode.plain_expressions import table_of
from pipeline.gcode.plain_words import WIDTH
from pipeline.gcode.program import Program
from pipeline.gcode.rows import COLUMNS
from pipeline.gcode.run import Run
from pipeline.gcode.state import FANUC, LINUXCNC, SIEMENS, State
from pipeline.gcode.variables import FanucVariables

MOTIONS = (0, 10, 20, 30)
AHEAD = 8
"""Lines that are searched for expressions before the table of variables is made."""
FIRST_SYSTEM_PARAMETER = 5000
"""From here on LinuxCNC's numbered parameters may tell of the machine."""
Variables = FanucVariables | LinuxcncParameters


def plain_state(state: State) -> bool:
    """Whether nothing is in force that the compiled lines do not know."""
    return (
        state.dialect != SIEMENS
        and state.feed_mode == FeedMode.PER_MINUTE
        and state.compensation == 0
        and state.transformed == 0
        and (state.motion in MOTIONS or state.dialect == LINUXCNC)
    )


def run_plain(
    program: Program, number: int, stop: int, run: Run, variables: Variables | None = None
) -> int:
    """Carry out plain lines from ``number`` on, as the interpreter would, bit for bit.

    Parameters
    ----------
    program : Program
        That holds the lines.
    number, stop : int
        First line, and the one to stop before, counting from 1.
    run : Run
        Its state and rows change.
    variables : FanucVariables or LinuxcncParameters, optional
        For lines with expressions, which are not plain without.

    Returns
    -------
    int
        The first line that was not carried out: it is not plain, wrong, or ``stop``.
    """
    content = program.content[number - 1 : number - 1 + AHEAD]
    if content[0] > 1 or not plain_state(run.state) or run.pending_length != 0:
        return number
    rows, tokens = run.rows, program.tokens
    rows.reserve(stop - number)
    named = list(zip(COLUMNS, rows.arrays, strict=True))
    floats, integers = run.state.to_arrays()
    line, count = plain_lines.follow(
        np.frombuffer(program.data, dtype=np.uint8),
        (tokens.kind, tokens.start, tokens.value, tokens.first),
        (number, stop),
        floats,
        integers,
        _choices(run),
        table_of(_settled(variables) if (content == 1).any() else {}),
        tuple(column for name, column in named if name in plain_lines.COLUMNS),
        rows.count,
        np.empty(WIDTH),
    )
    if count > rows.count:
        run.beside = None
        for name, column in named:
            if name not in plain_lines.COLUMNS:
                column[rows.count : count] = _constant(name, run.state)
    rows.count = count
    run.state.from_arrays(floats, integers)
    if run.state.dialect == FANUC:
        run.group_1 = run.state.motion
    return int(line)


def _settled(variables: Variables | None) -> dict[int | str, float]:
    """Variables that nothing but an assignment changes."""
    if variables is None:
        return {}
    settled: dict[int | str, float] = dict(variables.locals[-1].items())
    if isinstance(variables, FanucVariables):
        settled.update(variables.common.items())
    else:
        settled.update(
            (key, value)
            for key, value in variables.globals.items()
            if isinstance(key, str) or key < FIRST_SYSTEM_PARAMETER
        )
    return settled


def _constant(name: str, state: State) -> float:
    """What a column holds in all rows of plain lines."""
    if name in ("code", "value") or (name == "speed" and state.direction == 0):
        return 0.0
    return float(getattr(state, name))


def _choices(run: Run) -> np.ndarray:
    """As :func:`plain_lines.follow` takes them."""
    increments = run.setup.decimal == "increment" and run.state.dialect == FANUC
    if run.state.dialect == LINUXCNC:
        tolerances = [LINUXCNC_TOLERANCE, RELATIVE_RADIUS, LINUXCNC_R_TOLERANCE]
    else:
        tolerances = [run.setup.arc_tolerance, 0.0, run.setup.arc_tolerance]
    return np.array([*tolerances, float(increments)])
