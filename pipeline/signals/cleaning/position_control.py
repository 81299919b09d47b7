"""Position control of a spindle: engaged while its position loop holds it as a C axis.

A motor that holds a position carries current while it stands, and heats.  Without a reported rotary
mode two signs show it: the angle of the C axis changes, or driven tools turn in the other spindle,
while this one's speed is zero (engaged); and the spindle turns under speed control (released).
Between the two the state stays.  Not seen: a spindle held at angle zero that neither moves nor is
milled, a brake, a release without a turn.
"""

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import NS
from pipeline.signals.cleaning.series import Series, empty, held
from pipeline.signals.cleaning.settings import CleanSettings

ANGLE_STEP = 1e-3
"""Smallest change of angle that is a motion [DEGREE]."""
RATE = 1e-2
"""Smallest angular velocity that is a motion [DEGREE/SECOND]; a held axis shows less."""
HELD_MODES = ("INDEX", "CONTOUR")
"""Rotary modes in which the position loop holds the spindle."""


def position_control(
    angle: Series,
    speed: Series,
    settings: CleanSettings,
    *,
    rate: Series | None = None,
    tool_speed: Series | None = None,
    mode: Series | None = None,
    initial: float = np.nan,
) -> Series:
    """Position control (0 released, 1 engaged, NaN not known) when angle or speed is reported.

    ``angle`` [DEGREE], ``speed`` [REVOLUTION/MINUTE], ``rate`` [DEGREE/SECOND] and ``tool_speed``
    of the driven tools' spindle are clean; ``mode`` says SPINDLE, INDEX or CONTOUR.  ``initial`` is
    the state before the first row, unknown again after ``off_after_s`` without data.
    """
    rate = empty(text=False) if rate is None else rate
    tool_speed = empty(text=False) if tool_speed is None else tool_speed
    mode = empty(text=True) if mode is None else mode
    reported = (angle, speed, rate, tool_speed, mode)
    time = np.unique(np.concatenate([series.time for series in reported]))
    if not len(time):
        return Series(time=time, value=np.array([]), fresh=np.array([], dtype=bool))
    turning, standing = _speeds(speed, time, settings.turning_rpm)
    turned = rate.fresh & (np.abs(rate.value.astype(float)) > RATE)
    moved = np.isin(time, np.concatenate([angle.time[_moves(angle)], rate.time[turned]]))
    milling, _ = _speeds(tool_speed, time, settings.turning_rpm)
    state = np.full(len(time), np.nan)
    state[(moved | milling) & standing] = 1.0
    state[turning] = 0.0
    word = held(mode, time)
    state[np.isin(word, HELD_MODES)] = 1.0
    state[word == "SPINDLE"] = 0.0
    lost, back = _off(angle, speed, time, settings)
    marked = np.where(lost, -1.0, np.where(back & np.isnan(state), 0.0, state))
    value = _carried(marked, initial)
    return Series(time=time, value=value, fresh=np.ones(len(time), dtype=bool))


def _speeds(speed: Series, time: Ints, turning_rpm: float) -> tuple[Bools, Bools]:
    """Whether the spindle turns, and whether it stands, at each time, shape (T,)."""
    value = held(speed, time).astype(float)
    return np.abs(value) > turning_rpm, np.abs(value) <= turning_rpm


def _moves(angle: Series) -> Bools:
    """Rows at which the angle moved to one other than zero, shape (T,).

    A jump to zero without the steps between is the control clearing its display, and after data was
    lost the first value is no motion.
    """
    value = angle.value.astype(float)
    before = np.r_[np.nan, value[:-1]]
    changed = np.abs(value - before) > ANGLE_STEP
    return changed & (np.abs(value) > ANGLE_STEP) & angle.fresh


def _off(angle: Series, speed: Series, time: Ints, settings: CleanSettings) -> tuple[Bools, Bools]:
    """Losses of angle and speed for long, and the first return of one of them, shape (T,)."""
    known = np.zeros(len(time), dtype=bool)
    for series in (angle, speed):
        known |= ~np.isnan(held(series, time).astype(float))
    at = np.flatnonzero(known)
    lost, back = np.zeros_like(known), np.zeros_like(known)
    if not len(at):
        return lost, back
    i, j = at[:-1], at[1:]
    hole = j > i + 1
    hole[hole] = time[j[hole]] - time[i[hole] + 1] > settings.off_after_s * NS
    lost[i[hole] + 1] = True
    back[j[hole]] = True
    if at[0] > 0:  # the record begins with a machine that was off
        lost[0], back[at[0]] = True, True
    return lost, back


def _carried(marked: Floats, initial: float) -> Floats:
    """Each marked state until the next one; -1 marks "not known"."""
    place = np.where(np.isnan(marked), -1, np.arange(len(marked)))
    place = np.maximum.accumulate(place)
    value = np.where(place < 0, initial, marked[np.maximum(place, 0)])
    return np.where(value == -1.0, np.nan, value)
