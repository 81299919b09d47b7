"""The step of one axis in compiled form, on numbers made ready for it once.

The equations are those of :mod:`pipeline.machine.servo`, :mod:`pipeline.machine.feed_drive` and
:mod:`pipeline.machine.friction`.  Commands and forces are counted in the speed that they give the
mass in one step of the mechanics, k dt / M for one unit of the command and dt / M for one newton;
the integral of the velocity error as what it makes of the command.
"""

from math import expm1, sqrt

from numpy import uint64

from pipeline.kernels import compiled
from pipeline.machine.drive_columns import DriveColumn
from pipeline.machine.lane_arithmetic import decay, fused, greater, put_into_caller

LANES = 16
"""Axes that lie beside each other; number n of lane l is at n + l."""
ROWS = 35
"""Numbers of one axis: state, made ready, and counted.

UP is motion in the positive direction, DOWN in the negative; levels of DOWN are negative.
"""
# unsigned: an index that could be negative would be tested in each lane
(
    X, V, INTEGRAL, SEEN, REACHED, COMMAND, ASKED, FORWARD, UNIT,
    P, FV, LEFT_REF, FOLLOW, LEFT_V, MINUS_V, MINUS_I, FA, HIGHEST, LOWEST,
    OFFSET, LOAD_FACTOR, KEEP_UP, KEEP_DOWN, SLOW_UP, SLOW_DOWN,
    COULOMB_UP, COULOMB_DOWN, DIP_UP, DIP_DOWN, NARROW_UP, NARROW_DOWN,
    GREATEST_ERROR, SQUARE_ERROR, GREATEST_COMMAND, SQUARE_COMMAND,
) = (uint64(i * LANES) for i in range(ROWS))  # fmt: skip
POSITION, VELOCITY, FIRST_COMMAND, REFERENCE_VELOCITY = range(4)
"""Columns of how an axis starts, as :class:`pipeline.twin.drive.DriveStart`."""

_LOOP_GAIN, _PROPORTIONAL = int(DriveColumn.LOOP_GAIN), int(DriveColumn.PROPORTIONAL)
_INTEGRAL, _LIMIT = int(DriveColumn.INTEGRAL), int(DriveColumn.CURRENT_LIMIT)
_FV = int(DriveColumn.VELOCITY_FEEDFORWARD)
_FA = int(DriveColumn.ACCELERATION_FEEDFORWARD)
_MASS, _FORCE = int(DriveColumn.MASS), int(DriveColumn.FORCE_CONSTANT)
_OFFSET, _LOAD_FACTOR = int(DriveColumn.OFFSET), int(DriveColumn.LOAD_FACTOR)
_LAG_V, _LAG_REF = int(DriveColumn.VELOCITY_LAG), int(DriveColumn.POSITION_LAG)
_UP, _DOWN = int(DriveColumn.COULOMB_POSITIVE), int(DriveColumn.COULOMB_NEGATIVE)


@compiled
def make_ready(row, start, first, period, held, room, at):  # type: ignore[no-untyped-def]
    """Fill an axis' numbers before its first sample; number i lies at ``room[i + at]``.

    ``row`` is one of :func:`pipeline.machine.drive_columns.drive_row`, ``start`` has the columns
    above, ``first`` is the first reference [m], ``period`` the servo's [s], in which the mechanics
    make ``held`` steps.
    """
    by_force = period / held / row[_MASS]
    unit = by_force * row[_FORCE]
    reached, seen = followed(row[_LAG_REF], period), followed(row[_LAG_V], period)
    room[at + UNIT] = unit
    room[at + P] = reached * row[_LOOP_GAIN]
    room[at + FV] = reached * row[_FV]
    room[at + LEFT_REF] = 1.0 - reached
    room[at + FOLLOW] = seen
    room[at + LEFT_V] = 1.0 - seen
    room[at + MINUS_V] = -unit * row[_PROPORTIONAL]
    room[at + MINUS_I] = -unit * row[_INTEGRAL] * period
    room[at + FA] = unit * row[_FA]
    room[at + HIGHEST] = unit * row[_LIMIT]
    room[at + LOWEST] = -unit * row[_LIMIT]
    room[at + OFFSET] = by_force * row[_OFFSET]
    room[at + LOAD_FACTOR] = by_force * row[_LOAD_FACTOR]
    _friction(row, _UP, by_force, by_force, room, at)
    _friction(row, _DOWN, by_force, -by_force, room, at + uint64(LANES))
    _state(row, start, first, period, unit, room, at)


@compiled
def _friction(row, column, by_force, sign, room, at):  # type: ignore[no-untyped-def]
    coulomb, static, narrow = row[column], row[column + 1], row[column + 2]
    half = 0.5 * by_force * row[column + 3]
    room[at + KEEP_UP] = 1.0 - half
    room[at + SLOW_UP] = 1.0 / (1.0 + half)
    room[at + COULOMB_UP] = sign * coulomb
    room[at + DIP_UP] = sign * (static - coulomb)
    # decay() wants a 32nd of the square
    room[at + NARROW_UP] = 1.0 / (narrow * sqrt(32.0))


@compiled
def _state(row, start, first, period, unit, room, at):  # type: ignore[no-untyped-def]
    x, v, command, forward = start[0], start[1], start[2], start[3]
    v_ref = row[_LOOP_GAIN] * (first - x) + row[_FV] * forward
    integral = unit * (command - row[_PROPORTIONAL] * (v_ref - v))
    room[at + X] = x
    room[at + V] = v
    room[at + INTEGRAL] = integral if row[_INTEGRAL] > 0.0 else 0.0
    room[at + SEEN] = v
    room[at + REACHED] = v_ref
    room[at + ASKED] = first - period * forward
    room[at + FORWARD] = forward
    room[at + GREATEST_ERROR] = 0.0
    room[at + SQUARE_ERROR] = 0.0
    room[at + GREATEST_COMMAND] = 0.0
    room[at + SQUARE_COMMAND] = 0.0


@compiled
def followed(lag, period):  # type: ignore[no-untyped-def]
    """:func:`pipeline.machine.servo.approach`."""
    return -expm1(-period / lag) if lag > 0.0 else 1.0


@compiled
def servo_sample(room, i, r, forward, ahead):  # type: ignore[no-untyped-def]
    """:func:`pipeline.machine.servo.servo_step` of the axis at ``i``, and what is counted."""
    put_into_caller()
    error = r - room[i + X]
    room[i + GREATEST_ERROR] = greater(room[i + GREATEST_ERROR], abs(error))
    room[i + SQUARE_ERROR] = fused(error, error, room[i + SQUARE_ERROR])
    reached = fused(room[i + FV], forward, room[i + LEFT_REF] * room[i + REACHED])
    reached = fused(room[i + P], error, reached)
    seen = fused(room[i + FOLLOW], room[i + V], room[i + LEFT_V] * room[i + SEEN])
    room[i + REACHED] = reached
    room[i + SEEN] = seen
    # speed that is too much
    over = seen - reached
    integral = room[i + INTEGRAL]
    wanted = fused(room[i + MINUS_V], over, fused(room[i + FA], ahead, integral))
    command = min(max(wanted, room[i + LOWEST]), room[i + HIGHEST])
    grown = over if (wanted - command) * over >= 0.0 else 0.0
    room[i + INTEGRAL] = fused(room[i + MINUS_I], grown, integral)
    room[i + COMMAND] = command
    room[i + GREATEST_COMMAND] = greater(room[i + GREATEST_COMMAND], abs(command))
    room[i + SQUARE_COMMAND] = fused(command, command, room[i + SQUARE_COMMAND])


@compiled
def mechanics_step(room, i, load, half):  # type: ignore[no-untyped-def]
    """:func:`pipeline.machine.feed_drive.screw_step` of the axis at ``i``, without a branch.

    ``half`` is half of the step [s].
    """
    put_into_caller()
    v = room[i + V]
    push = room[i + COMMAND] - fused(room[i + LOAD_FACTOR], load, room[i + OFFSET])
    keep_up, keep_down = room[i + KEEP_UP], room[i + KEEP_DOWN]
    slow_up, slow_down = room[i + SLOW_UP], room[i + SLOW_DOWN]
    narrow_up, narrow_down = room[i + NARROW_UP], room[i + NARROW_DOWN]
    up = v > 0.0
    narrow = v * (narrow_up if up else narrow_down)
    faded = decay(narrow * narrow)
    free = fused(v, keep_up if up else keep_down, push)
    on = free > 0.0
    # where v = 0 it has not faded, whatever the direction
    dip = faded if up == on else 1.0
    highest = fused(room[i + DIP_UP], dip, room[i + COULOMB_UP])
    lowest = fused(room[i + DIP_DOWN], dip, room[i + COULOMB_DOWN])
    v_next = (free - min(max(free, lowest), highest)) * (slow_up if on else slow_down)
    room[i + X] = fused(half, v + v_next, room[i + X])
    room[i + V] = v_next
