"""Servo and mechanics step of an axis in compiled form, on numbers prepared for it once.

The equations are those of :mod:`pipeline.machine.axis.servo`,
:mod:`pipeline.machine.axis.feed_drive` and :mod:`pipeline.machine.axis.friction`.  Commands and
forces are counted in the speed that they give the mass in one step of the mechanics, k dt / M for
one unit of the command and dt / M for one newton; the integral of the velocity error as its share
of the command.  The arithmetic calls no library, so that loops over lanes become SIMD vectors.
"""

from math import expm1, sqrt

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy import uint64

from pipeline.kernels import compiled
from pipeline.machine.axis.feed_drive import DriveColumn

LANES = 16
"""Axes that lie beside each other; quantity n of lane l is at n + l."""
ROWS = 35
"""Quantities of one axis: state, prepared constants, and error statistics.

UP is motion in the positive direction, DOWN in the negative; levels of DOWN are negative.
AMPLITUDE is that of the Stribeck term, NARROW what scales the speed in it.
"""
# unsigned: an index that could be negative would be tested in each lane
(
    X, V, INTEGRAL, V_FED_BACK, V_REF, COMMAND, LAST_REFERENCE, LAST_VELOCITY_REF, UNIT,
    P, FV, LEFT_REF, SHARE_V, LEFT_V, MINUS_V, MINUS_I, FA, HIGHEST, LOWEST,
    OFFSET, LOAD_FACTOR, KEEP_UP, KEEP_DOWN, SLOW_UP, SLOW_DOWN,
    COULOMB_UP, COULOMB_DOWN, AMPLITUDE_UP, AMPLITUDE_DOWN, NARROW_UP, NARROW_DOWN,
    GREATEST_ERROR, SQUARE_ERROR, GREATEST_COMMAND, SQUARE_COMMAND,
) = (uint64(i * LANES) for i in range(ROWS))  # fmt: skip
POSITION, VELOCITY, FIRST_COMMAND, REFERENCE_VELOCITY = range(4)
"""Columns of an axis' start, as :class:`pipeline.twin.drive.DriveStart`."""

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
def greater(context, a, b):  # type: ignore[no-untyped-def]
    """The greater of two numbers in one instruction; neither may be NaN.

    A comparison would be stored in single lanes, which the next load of them has to wait for.
    """

    def build(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        number = arguments[0].type
        maximum = builder.module.declare_intrinsic(
            "llvm.maxnum", [number], ir.FunctionType(number, [number, number])
        )
        return builder.call(maximum, arguments, fastmath=("nnan", "nsz"))

    return types.float64(types.float64, types.float64), build


@intrinsic
def put_into_caller(context):  # type: ignore[no-untyped-def]
    """Make the function that calls this part of its callers, however long it is."""

    def mark(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        builder.function.attributes.add("alwaysinline")
        return target.get_dummy_value()

    return types.none(), mark


@intrinsic
def in_widest_vectors(context):  # type: ignore[no-untyped-def]
    """Let the compiler use 512 bits in the function that calls this, where the processor has them.

    Left alone it takes 256, for fear of the clock of older processors.
    """

    def mark(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        # the library knows the attributes without a value only, and refuses others in its own add
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
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
def prepare(row, start, first, period, held, data, at):  # type: ignore[no-untyped-def]
    """Fill an axis' quantities before its first sample; quantity i lies at ``data[i + at]``.

    ``row`` is one of :func:`pipeline.machine.axis.feed_drive.drive_row`, ``start`` has the columns
    above, ``first`` is the first reference [m], ``period`` the servo's [s], in which the mechanics
    make ``held`` steps.
    """
    per_newton = period / held / row[_MASS]
    unit = per_newton * row[_FORCE]
    share_ref, share_v = followed(row[_LAG_REF], period), followed(row[_LAG_V], period)
    data[at + UNIT] = unit
    data[at + P] = share_ref * row[_LOOP_GAIN]
    data[at + FV] = share_ref * row[_FV]
    data[at + LEFT_REF] = 1.0 - share_ref
    data[at + SHARE_V] = share_v
    data[at + LEFT_V] = 1.0 - share_v
    data[at + MINUS_V] = -unit * row[_PROPORTIONAL]
    data[at + MINUS_I] = -unit * row[_INTEGRAL] * period
    data[at + FA] = unit * row[_FA]
    data[at + HIGHEST] = unit * row[_LIMIT]
    data[at + LOWEST] = -unit * row[_LIMIT]
    data[at + OFFSET] = per_newton * row[_OFFSET]
    data[at + LOAD_FACTOR] = per_newton * row[_LOAD_FACTOR]
    _friction(row, _UP, per_newton, per_newton, data, at)
    _friction(row, _DOWN, per_newton, -per_newton, data, at + uint64(LANES))
    _state(row, start, first, period, unit, data, at)


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
def _state(row, start, first, period, unit, data, at):  # type: ignore[no-untyped-def]
    x, v, command, forward = start[0], start[1], start[2], start[3]
    v_ref = row[_LOOP_GAIN] * (first - x) + row[_FV] * forward
    integral = unit * (command - row[_PROPORTIONAL] * (v_ref - v))
    data[at + X] = x
    data[at + V] = v
    data[at + INTEGRAL] = integral if row[_INTEGRAL] > 0.0 else 0.0
    data[at + V_FED_BACK] = v
    data[at + V_REF] = v_ref
    data[at + LAST_REFERENCE] = first - period * forward
    data[at + LAST_VELOCITY_REF] = forward
    data[at + GREATEST_ERROR] = 0.0
    data[at + SQUARE_ERROR] = 0.0
    data[at + GREATEST_COMMAND] = 0.0
    data[at + SQUARE_COMMAND] = 0.0


@compiled
def followed(lag, period):  # type: ignore[no-untyped-def]
    """:func:`pipeline.machine.axis.servo.approach`, compiled."""
    return -expm1(-period / lag) if lag > 0.0 else 1.0


@compiled
def servo_sample(data, i, r, forward, ahead):  # type: ignore[no-untyped-def]
    """Command of the servo of the axis at ``i``, and its statistics.

    The integral stays while the limit holds and the error would carry it further (conditional
    integration).
    """
    put_into_caller()
    error = r - data[i + X]
    data[i + GREATEST_ERROR] = greater(data[i + GREATEST_ERROR], abs(error))
    data[i + SQUARE_ERROR] = fused(error, error, data[i + SQUARE_ERROR])
    v_ref = fused(data[i + FV], forward, data[i + LEFT_REF] * data[i + V_REF])
    v_ref = fused(data[i + P], error, v_ref)
    v_fed_back = fused(data[i + SHARE_V], data[i + V], data[i + LEFT_V] * data[i + V_FED_BACK])
    data[i + V_REF] = v_ref
    data[i + V_FED_BACK] = v_fed_back
    # excess of the speed over its reference
    over = v_fed_back - v_ref
    integral = data[i + INTEGRAL]
    unlimited = fused(data[i + MINUS_V], over, fused(data[i + FA], ahead, integral))
    command = min(max(unlimited, data[i + LOWEST]), data[i + HIGHEST])
    growth = over if (unlimited - command) * over >= 0.0 else 0.0
    data[i + INTEGRAL] = fused(data[i + MINUS_I], growth, integral)
    data[i + COMMAND] = command
    data[i + GREATEST_COMMAND] = greater(data[i + GREATEST_COMMAND], abs(command))
    data[i + SQUARE_COMMAND] = fused(command, command, data[i + SQUARE_COMMAND])


@compiled
def mechanics_step(data, i, load, half):  # type: ignore[no-untyped-def]
    """Speed and position of the axis at ``i`` one step on, without a branch.

    ``half`` is half of the step [s].
    """
    put_into_caller()
    v = data[i + V]
    push = data[i + COMMAND] - fused(data[i + LOAD_FACTOR], load, data[i + OFFSET])
    keep_up, keep_down = data[i + KEEP_UP], data[i + KEEP_DOWN]
    slow_up, slow_down = data[i + SLOW_UP], data[i + SLOW_DOWN]
    narrow_up, narrow_down = data[i + NARROW_UP], data[i + NARROW_DOWN]
    up = v > 0.0
    narrow = v * (narrow_up if up else narrow_down)
    faded = decay(narrow * narrow)
    free = fused(v, keep_up if up else keep_down, push)
    on = free > 0.0
    # at v = 0 the Stribeck term has not faded, whatever the direction
    share = faded if up == on else 1.0
    highest = fused(data[i + AMPLITUDE_UP], share, data[i + COULOMB_UP])
    lowest = fused(data[i + AMPLITUDE_DOWN], share, data[i + COULOMB_DOWN])
    v_next = (free - min(max(free, lowest), highest)) * (slow_up if on else slow_down)
    data[i + X] = fused(half, v + v_next, data[i + X])
    data[i + V] = v_next
