"""Run-up time of the spindle, and the rows that wait for it.

Up to its base speed n_b the motor gives constant torque, above it constant power, so that the
speed rises with alpha and then with alpha n_b / n:

    t(n) = n / alpha                                  n <= n_b
    t(n) = n_b / alpha + (n^2 - n_b^2) / (2 alpha n_b)  n > n_b

and a change from n_1 to n_2 takes |t(n_2) - t(n_1)| (reversing, t(n_1) + t(n_2)).
"""

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import Kind, Moves
from pipeline.machine.control.parameters import AuxiliaryParameters
from pipeline.machine.control.path import Halt
from pipeline.schema.arrays import Bools, Floats, Rows

AT_REST = (Kind.TOOL_CHANGE, Kind.STOP, Kind.END, Kind.SPINDLE)
"""Rows that need a stopped spindle at rest, with ``spindle_stop_wait = "before_change"``."""
CUTTING = (Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)
"""Rows that move at feed."""
MOVING = (Kind.RAPID, *CUTTING)
"""Rows that move."""


def run_up_time(speed: Floats, acceleration: Floats, base_speed: float) -> Floats:
    """Time from standstill to a speed, with the sign of the speed [s].

    Parameters
    ----------
    speed, acceleration, base_speed : array
        Signed by the direction [rev/min]; below the base speed [rev/min/s]; [rev/min], infinite for
        constant torque at all speeds.
    """
    n = np.abs(speed)
    low = np.minimum(n, base_speed)
    # where the base speed is infinite nothing lies above it
    above = (n - low) * (n + low) / (2 * acceleration * base_speed)
    return np.sign(speed) * (low / acceleration + above)


def spindle_waits(
    moves: Moves, parameters: AuxiliaryParameters, speeds: Floats
) -> tuple[Rows, Rows, Floats]:
    """Rows that wait for the spindle, and how long it takes.

    Spindle codes that are waited for, (N,); the first row that waits for each, which may be the row
    itself, (N,); time of the spindle from the code on, (P, N) [s]. Spindle ``speeds``, shape (P,
    M), are at least 0 [rev/min].
    """
    rows, waiting = _waiting(moves, parameters)
    now = speeds[:, rows] * moves.direction[rows]
    before = np.where(rows > 0, speeds[:, rows - 1] * moves.direction[rows - 1], 0.0)
    base = parameters.spindle_base_speed
    up = parameters.spindle_acceleration
    down = parameters.spindle_deceleration or up
    rates = np.where(np.abs(now) < np.abs(before), down, up)
    change = run_up_time(now, rates, base) - run_up_time(before, rates, base)
    time = np.abs(change) + parameters.spindle_delay
    return rows, waiting, time + np.where(moves.code[rows] == 19, parameters.spindle_orientation, 0)


def halts(moves: Moves, parameters: AuxiliaryParameters) -> npt.NDArray[np.uint8]:
    """Whether the axes stand still before each row, :class:`Halt`; shape (M,)."""
    still = ~np.isin(moves.kind, MOVING)
    halt = np.where(still, Halt.STOPS, Halt.NONE).astype(np.uint8)
    flying = (moves.kind == Kind.M_CODE) & np.isin(moves.code, parameters.flying_m_codes)
    halt[flying | (moves.kind == Kind.SPINDLE)] = Halt.NONE
    _, waiting = _waiting(moves, parameters)
    halt[waiting] = Halt.STOPS
    return halt


def _waiting(moves: Moves, parameters: AuxiliaryParameters) -> tuple[Rows, Rows]:
    """Spindle codes that are waited for, and the first row that waits for each."""
    rows = np.flatnonzero(moves.kind == Kind.SPINDLE)
    if parameters.spindle_wait == "none":
        rows = rows[:0]
    elif not parameters.speed_change_waits:
        rows = rows[~_speed_changes(moves, rows)]
    if len(rows) == 0:
        return rows, rows
    waiting = rows
    if parameters.spindle_wait == "next_line":
        change = (np.diff(moves.line) != 0) | (np.diff(moves.file) != 0)
        waiting = _first_after(np.flatnonzero(change) + 1, rows, len(moves))
    elif parameters.spindle_wait == "before_cutting":
        waiting = _first_after(np.flatnonzero(np.isin(moves.kind, CUTTING)), rows, len(moves))
    if parameters.spindle_stop_wait == "before_change":
        rest = _first_after(np.flatnonzero(np.isin(moves.kind, AT_REST)), rows, len(moves))
        waiting = np.where(moves.direction[rows] == 0, rest, waiting)
    within = waiting < len(moves)
    return rows[within], waiting[within]


def _speed_changes(moves: Moves, rows: Rows) -> Bools:
    """Flags of spindle rows that only change the speed of a rotating spindle."""
    before = np.where(rows > 0, moves.direction[rows - 1], 0)
    return (before == moves.direction[rows]) & (before != 0)


def _first_after(candidates: Rows, rows: Rows, none: int) -> Rows:
    index = np.searchsorted(candidates, rows, side="right")
    return np.append(candidates, none)[index]
