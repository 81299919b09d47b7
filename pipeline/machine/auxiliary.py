"""Times of what does not move an axis: spindle, tool change, M codes, dwell."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import Kind, Moves

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AuxiliaryParameters:
    """How long the machine takes for what does not move an axis.

    Parameters
    ----------
    spindle_acceleration : float
        Below the base speed [rev/min/s]; M3, M4 and M5 take what the change of speed takes, see
        :mod:`pipeline.machine.spindle`.
    spindle_base_speed : float
        Above it the motor gives constant power instead of constant torque [rev/min].
    spindle_deceleration : float, optional
        Of a spindle that is stopped [rev/min/s]; ``spindle_acceleration`` where it is not given.
    spindle_delay : float
        Added to each of them [s].
    spindle_wait : {"at_code", "next_line", "before_cutting", "none"}
        Where the spindle is waited for: at M3, M4 and M5 themselves, before the line that follows,
        before the next cutting move (the axes meanwhile move on), or nowhere.
    spindle_stop_wait : {"as_start", "before_change"}
        Whether a spindle that is stopped is waited for in the same way, or only by what needs it at
        rest: tool change, M0, M1, M2, M30 and the next spindle code.
    speed_change_waits : bool
        Whether an S word while the spindle turns is waited for in the same way; otherwise the
        axes move on and nothing is waited for.
    spindle_orientation : float
        M19 [s].
    maximum_speed : float
        Of the spindle, limits constant surface speed [rev/min].
    tool_change : float
        M6 [s].
    tools : dict of int to float
        What M6 takes longer for a tool [s].
    m_code : float
        An M code that ``m_codes`` does not name [s].
    m_codes : dict of int to float
        M codes by number [s].
    flying_m_codes : tuple of int
        M codes that are sent while the axes move on; they take no time.
    stop : float
        M0 and M1 [s]; 0 leaves out what the operator does.
    """

    spindle_acceleration: float = np.inf
    spindle_base_speed: float = np.inf
    spindle_deceleration: float | None = None
    spindle_delay: float = 0.0
    spindle_wait: Literal["at_code", "next_line", "before_cutting", "none"] = "at_code"
    spindle_stop_wait: Literal["as_start", "before_change"] = "as_start"
    speed_change_waits: bool = False
    spindle_orientation: float = 0.0
    maximum_speed: float = np.inf
    tool_change: float = 0.0
    tools: dict[int, float] = field(default_factory=dict)
    m_code: float = 0.0
    m_codes: dict[int, float] = field(default_factory=dict)
    flying_m_codes: tuple[int, ...] = ()
    stop: float = 0.0

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"auxiliary.{name} = {value} must be positive")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise ValueError(
                    f"auxiliary.{name} = {getattr(self, name)!r} must be one of {choices}"
                )
        for name in ("spindle_delay", "spindle_orientation", "tool_change", "m_code", "stop"):
            _check_time(name, getattr(self, name))
        for number, time in self.tools.items():
            _check_time(f"tools[{number}]", time)
        for number, time in self.m_codes.items():
            _check_time(f"m_codes[{number}]", time)


_POSITIVE = (
    "spindle_acceleration", "spindle_base_speed", "spindle_deceleration", "maximum_speed",
)  # fmt: skip
_CHOICES = {
    "spindle_wait": ("at_code", "next_line", "before_cutting", "none"),
    "spindle_stop_wait": ("as_start", "before_change"),
}


def _check_time(name: str, time: float) -> None:
    if not (np.isfinite(time) and time >= 0):
        raise ValueError(f"auxiliary.{name} = {time} s must be finite and at least 0")


def auxiliary_time(
    moves: Moves, parameters: AuxiliaryParameters, turns: Floats
) -> tuple[npt.NDArray[np.intp], Floats]:
    """Rows that take time without moving, N of them but for the spindle's, and their time [s].

    Parameters
    ----------
    moves : Moves
        M rows.
    parameters : AuxiliaryParameters
        How long each takes.
    turns : (1 or P, M) array
        Speed of the spindle, at least 0 [rev/min].

    Returns
    -------
    rows : (N,) array
    time : (P, N) array
        [s].

    Raises
    ------
    ValueError
        When a dwell counts revolutions of a spindle that stands.
    """
    dwell = np.flatnonzero(moves.kind == Kind.DWELL)
    change = np.flatnonzero(moves.kind == Kind.TOOL_CHANGE)
    stop = np.flatnonzero(moves.kind == Kind.STOP)
    code = np.flatnonzero(moves.kind == Kind.M_CODE)
    tools = moves.tool[change].tolist()
    known = parameters.m_codes | dict.fromkeys(parameters.flying_m_codes, 0.0)
    fixed = [
        *(parameters.tool_change + parameters.tools.get(n, 0.0) for n in tools),
        *(parameters.stop for _ in stop),
        *(known.get(n, parameters.m_code) for n in moves.code[code].tolist()),
    ]
    dwelt = _dwell_time(moves, dwell, turns[:, dwell])
    time = np.hstack([dwelt, np.tile(np.array(fixed, float), (len(turns), 1))])
    return np.concatenate([dwell, change, stop, code]), time


def _dwell_time(moves: Moves, rows: npt.NDArray[np.intp], turns: Floats) -> Floats:
    value = moves.value[rows]
    by_turns = moves.code[rows] == 1
    wrong = ~(np.isfinite(value) & (value >= 0)) | (by_turns & (value > 0) & ~(turns > 0))
    if wrong.any():
        row = rows[np.argmax(wrong.any(axis=0))]
        raise ValueError(
            f"{where(moves, row)}: dwell of {moves.value[row]} "
            f"{'rev with the spindle standing' if moves.code[row] == 1 else 's'}: "
            "it must be finite, at least 0, and in seconds where the spindle stands"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        seconds = np.where(by_turns, value * 60 / turns, value)
    return np.where(value > 0, seconds, 0.0)


def where(moves: Moves, row: int) -> str:
    """File and line of a row, as messages name it."""
    return f"{moves.files[moves.file[row]]}:{moves.line[row]}"
