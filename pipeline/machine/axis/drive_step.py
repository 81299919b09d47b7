"""Servo and mechanics of an axis in compiled form, on numbers prepared once for each variant.

The equations are those of :mod:`pipeline.machine.axis.servo`,
:mod:`pipeline.machine.axis.feed_drive` and :mod:`pipeline.machine.axis.friction`.  Commands and
forces are counted in the speed that they give the mass in one step of the mechanics, k dt / M for
one unit of the command and dt / M for one newton; the integral of the velocity error as its share
of the command.  A step calls no library.
"""

from math import expm1, sqrt

from numba import types
from numba.extending import intrinsic
from numpy import uint64

from pipeline.kernels import compiled
from pipeline.machine.axis.feed_drive import DriveColumn

ROWS = 31
"""Number of quantities of one axis: state and prepared constants [1].

UP is motion in the positive direction, DOWN in the negative; levels of DOWN are negative.
AMPLITUDE is that of the Stribeck term, NARROW what scales the speed in it.
"""
# unsigned: an index that could be negative would be tested at each access
(
    X, V, INTEGRAL, V_FED_BACK, V_REF, COMMAND, LAST_REFERENCE, LAST_VELOCITY_REF, UNIT,
    P, FV, LEFT_REF, SHARE_V, LEFT_V, MINUS_V, MINUS_I, FA, HIGHEST, LOWEST,
    OFFSET, LOAD_FACTOR, KEEP_UP, KEEP_DOWN, SLOW_UP, SLOW_DOWN,
    COULOMB_UP, COULOMB_DOWN, AMPLITUDE_UP, AMPLITUDE_DOWN, NARROW_UP, NARROW_DOWN,
) = (uint64(i) for i in range(ROWS))  # fmt: skip

_LOOP_GAIN, _PROPORTIONAL = int(DriveColumn.LOOP_GAIN), int(DriveColumn.PROPORTIONAL)
_INTEGRAL, _LIMIT = int(DriveColumn.INTEGRAL), int(DriveColumn.CURRENT_LIMIT)
_FV = int(DriveColumn.VELOCITY_FEEDFORWARD)
_FA = int(DriveColumn.ACCELERATION_FEEDFORWARD)
_MASS, _FORCE = int(DriveColumn.MASS), int(DriveColumn.FORCE_CONSTANT)
_OFFSET, _LOAD_FACTOR = int(DriveColumn.OFFSET), int(DriveColumn.LOAD_FACTOR)
_LAG_V, _LAG_REF = int(DriveColumn.VELOCITY_LAG), int(DriveColumn.POSITION_LAG)
_UP, _DOWN = int(DriveColumn.COULOMB_POSITIVE), int(DriveColumn.COULOMB_NEGATIVE)
FARTHEST = 0.75
"""Greatest argument of the polynomial; exp(-32 * 0.75) = 3.8e-11 is the least result."""
_C1, _C2, _C3 = -0.9999999997846465, 0.49999999118359084, -0.16666654169228362
_C4, _C5, _C6 = 0.04166580070145177, -0.008329979729521968, 0.001381231089254686
_C7, _C8 = -0.00018808908195194982, 1.7037782499404607e-05
# minimax polynomial of exp(-t), t up to FARTHEST, with exp(0) = 1: relative error 1.7e-12


@intrinsic
def fused(context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a b + c, rounded once, in one instruction: no compiler may make it of two."""
    signature = types.float64(types.float64, types.float64, types.float64)
    return signature, lambda target, builder, _, arguments: builder.fma(*arguments)


@intrinsic
def put_into_caller(context):  # type: ignore[no-untyped-def]
    """Make the function that calls this part of its callers, however long it is."""

    def mark(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        builder.function.attributes.add("alwaysinline")
        return target.get_dummy_value()

    return types.none(), mark


@compiled
def decay(y):  # type: ignore[no-untyped-def]
    """exp(-32 y) of y >= 0: relative error 6e-11 up to y = 0.75, absolute 4e-11; 1 at 0."""
    t = min(y, FARTHEST)
    t2 = t * t
    t4 = t2 * t2
    low = fused(t2, fused(t, _C3, _C2), fused(t, _C1, 1.0))
    high = fused(t2, fused(t, _C7, _C6), fused(t, _C5, _C4))
    d = fused(t4, fused(t4, _C8, high), low)
    d *= d
    d *= d
    d *= d
    d *= d
    return d * d


@compiled
def prepare(row, start, first, period, held, data):  # type: ignore[no-untyped-def]
    """Fill the quantities ``data``, shape (ROWS,), of an axis before its first sample.

    ``row`` is one of :func:`pipeline.machine.axis.feed_drive.drive_row`, ``start`` holds the
    numbers of :class:`pipeline.twin.drive.DriveStart`, ``first`` is the first reference [m],
    ``period`` the servo's [s], in which the mechanics make ``held`` steps.
    """
    per_newton = period / held / row[_MASS]
    unit = per_newton * row[_FORCE]
    share_ref, share_v = followed(row[_LAG_REF], period), followed(row[_LAG_V], period)
    data[UNIT] = unit
    data[P] = share_ref * row[_LOOP_GAIN]
    data[FV] = share_ref * row[_FV]
    data[LEFT_REF] = 1.0 - share_ref
    data[SHARE_V] = share_v
    data[LEFT_V] = 1.0 - share_v
    data[MINUS_V] = -unit * row[_PROPORTIONAL]
    data[MINUS_I] = -unit * row[_INTEGRAL] * period
    data[FA] = unit * row[_FA]
    data[HIGHEST] = unit * row[_LIMIT]
    data[LOWEST] = -unit * row[_LIMIT]
    data[OFFSET] = per_newton * row[_OFFSET]
    data[LOAD_FACTOR] = per_newton * row[_LOAD_FACTOR]
    _friction(row, _UP, per_newton, per_newton, data, uint64(0))
    _friction(row, _DOWN, per_newton, -per_newton, data, uint64(1))
    _state(row, start, first, period, unit, data)


@compiled
def _friction(row, column, per_newton, sign, data, at):  # type: ignore[no-untyped-def]
    coulomb, static, narrow = row[column], row[column + 1], row[column + 2]
    half = 0.5 * per_newton * row[column + 3]
    data[at + KEEP_UP] = 1.0 - half
    data[at + SLOW_UP] = 1.0 / (1.0 + half)
    data[at + COULOMB_UP] = sign * coulomb
    data[at + AMPLITUDE_UP] = sign * (static - coulomb)
    # decay() wants a 32nd of the square
    data[at + NARROW_UP] = 1.0 / (narrow * sqrt(32.0))


@compiled
def _state(row, start, first, period, unit, data):  # type: ignore[no-untyped-def]
    x, v, command, forward = start[0], start[1], start[2], start[3]
    v_ref = row[_LOOP_GAIN] * (first - x) + row[_FV] * forward
    integral = unit * (command - row[_PROPORTIONAL] * (v_ref - v))
    data[X] = x
    data[V] = v
    data[INTEGRAL] = integral if row[_INTEGRAL] > 0.0 else 0.0
    data[V_FED_BACK] = v
    data[V_REF] = v_ref
    data[LAST_REFERENCE] = first - period * forward
    data[LAST_VELOCITY_REF] = forward


@compiled
def followed(lag, period):  # type: ignore[no-untyped-def]
    """:func:`pipeline.machine.axis.servo.approach`, compiled."""
    return -expm1(-period / lag) if lag > 0.0 else 1.0


@compiled
def servo_sample(data, r, forward, ahead):  # type: ignore[no-untyped-def]
    """Command of the servo.

    The integral stays while the limit holds and the error would carry it further (conditional
    integration).
    """
    put_into_caller()
    error = r - data[X]
    v_ref = fused(data[FV], forward, data[LEFT_REF] * data[V_REF])
    v_ref = fused(data[P], error, v_ref)
    v_fed_back = fused(data[SHARE_V], data[V], data[LEFT_V] * data[V_FED_BACK])
    data[V_REF] = v_ref
    data[V_FED_BACK] = v_fed_back
    # excess of the speed over its reference
    over = v_fed_back - v_ref
    integral = data[INTEGRAL]
    unlimited = fused(data[MINUS_V], over, fused(data[FA], ahead, integral))
    command = min(max(unlimited, data[LOWEST]), data[HIGHEST])
    growth = over if (unlimited - command) * over >= 0.0 else 0.0
    data[INTEGRAL] = fused(data[MINUS_I], growth, integral)
    data[COMMAND] = command


@compiled
def mechanics_step(data, load, half):  # type: ignore[no-untyped-def]
    """Speed and position one step on, without a branch.

    ``half`` is half of the step [s].
    """
    put_into_caller()
    v = data[V]
    push = data[COMMAND] - fused(data[LOAD_FACTOR], load, data[OFFSET])
    keep_up, keep_down = data[KEEP_UP], data[KEEP_DOWN]
    slow_up, slow_down = data[SLOW_UP], data[SLOW_DOWN]
    narrow_up, narrow_down = data[NARROW_UP], data[NARROW_DOWN]
    up = v > 0.0
    narrow = v * (narrow_up if up else narrow_down)
    faded = decay(narrow * narrow)
    free = fused(v, keep_up if up else keep_down, push)
    on = free > 0.0
    # at v = 0 the Stribeck term has not faded, whatever the direction
    share = faded if up == on else 1.0
    highest = fused(data[AMPLITUDE_UP], share, data[COULOMB_UP])
    lowest = fused(data[AMPLITUDE_DOWN], share, data[COULOMB_DOWN])
    v_next = (free - min(max(free, lowest), highest)) * (slow_up if on else slow_down)
    data[X] = fused(half, v + v_next, data[X])
    data[V] = v_next


@compiled
def drive_traces(  # type: ignore[no-untyped-def]
    reference, load, table, start, period, inner, held, data, begun, position, velocity, command
):
    """Fill position, velocity and command, shape (P, T), at the samples of the reference.

    ``reference`` has shape (T,), ``load`` (1 or T,), ``table`` (P, columns) and ``start`` (P, 4);
    the work array ``data`` is ROWS long.  Where it has ``begun``, the samples follow those that
    left ``data`` as it is.
    """
    each = period / inner
    loaded = 1 if load.shape[0] > 1 else 0
    for p in range(table.shape[0]):
        if not begun:
            prepare(table[p], start[p], reference[0], each, held, data)
        for k in range(reference.shape[0]):
            here, after = reference[k], reference[min(k + 1, reference.shape[0] - 1)]
            position[p, k], velocity[p, k] = data[X], data[V]
            for j in range(inner):
                r = here + (after - here) * (j / inner)
                forward = (r - data[LAST_REFERENCE]) / each
                ahead = (forward - data[LAST_VELOCITY_REF]) / each
                data[LAST_REFERENCE], data[LAST_VELOCITY_REF] = r, forward
                servo_sample(data, r, forward, ahead)
                if j == 0:
                    command[p, k] = data[COMMAND] / data[UNIT]
                for _ in range(held):
                    mechanics_step(data, load[loaded * k], 0.5 * each / held)
