"""Feed axis as one mass on a screw under its servo (Sim2023), compiled.

Servo: a P position loop and a PI velocity loop,

v_ref = S_pp P_p (x_ref - x) + f_v x_ref'
A     = S_vp V_p (v_ref - v) + S_vi V_i integral(v_ref - v) dt + f_a x_ref'',   |A| <= limit

The velocity loop sees v late: by what differencing the encoder, filters, computing and the current
loop take, together one first-order lag T_v (v' = (velocity - v) / T_v, exact over a servo period);
and v_ref by T_x, where the position loop samples slower and holds.  Its gains may be moved by the
fuzzy rules of :mod:`pipeline.machine.axis.loops`.

Screw: M x'' = k A - F_f(x') - F_g - F_d with the force constant k = 2 pi k_t / L, friction, gravity
less counterbalance, and load.  The position is stepped by the trapezoid, so that the balance of
energy closes in each step: M (v_next^2 - v^2) / 2 = (k A - F_g - F_d - F_f) (x_next - x).

Friction: Stribeck's curve, F_f(v) = [F_c + (F_s - F_c) exp(-(|v| / v_s)^2)] sgn v + mu_v v, with
sets of their own for v > 0 and v < 0 (Sim2023).  At standstill friction balances whatever acts on
it, up to F_s.  The step is implicit in the direction of motion (a proximal step): what a held force
would make of the speed is brought nearer to 0 by what friction can take, and no further.  It sticks
exactly, does not chatter, and needs no band of speeds that count as none.  Viscous friction is
taken at both ends of the step (Crank and Nicolson), the level at the old speed; at standstill, and
where the step passes it, the level is F_s.  Second order in the step but for the Stribeck term,
which is of first.

Presliding: below sliding the contact may be a spring, whose deflection z follows
z' = v - sigma |v| z / g(v) - z / T and holds with sigma z, where g(v) is Stribeck's level (Canudas
de Wit, Olsson, Åström, Lischinsky: A new model for control of systems with friction, IEEE Trans.
Automatic Control 40, 1995; without its damping term).  It matters where an axis stands under a
load: friction that sticks exactly holds the load for ever, while a spring gives way by some
micrometres, so that the integral of the velocity loop takes the load over; and small oscillations
about a standstill, as of passing teeth, wear the spring's force off.  So does what shakes an axis
that is held in position and nothing else (noise of its encoders, the torque's ripple, machines
beside it): slowly, within seconds, as the deflection's own loss z / T.  A feed feels it below
g / (sigma T) alone, some um/s.

At each sample the servo sees the encoder and sets the command, which holds until the next sample.
Positions at the encoder, which sits on the motor; SI units.
"""

from dataclasses import dataclass, field
from math import expm1, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels import compiled, compiled_with
from pipeline.machine.axis.drive_parameters import DriveColumn, DriveStart, check_steps, samples
from pipeline.machine.axis.loops import FuzzyParameters, increments
from pipeline.schema.arrays import Floats

# products and sums become one instruction, rounded once, where the processor has it
_compiled_fused = compiled_with(nogil=True, _nrt=False, fastmath={"contract"})
_compiled_unfused = compiled_with(nogil=True, _nrt=False, fastmath=False)
_increments = compiled(increments)
NO_RULES = (0.0, 0.0, 0.0, 0.0)
"""Fuzzy rules that move no gain."""
STICKS = (0.0, 0.0)
"""Spring of friction that sticks exactly."""
STATES = 9
"""Numbers that an axis remembers from sample to sample."""
FARTHEST = 0.75
"""Greatest argument of the polynomial; exp(-32 * 0.75) = 3.8e-11 is the least result."""
_C1, _C2, _C3 = -0.9999999997846465, 0.49999999118359084, -0.16666654169228362
_C4, _C5, _C6 = 0.04166580070145177, -0.008329979729521968, 0.001381231089254686
_C7, _C8 = -0.00018808908195194982, 1.7037782499404607e-05
# minimax polynomial of exp(-t), t up to FARTHEST, with exp(0) = 1: relative error 1.7e-12


@_compiled_fused
def decay(y):  # type: ignore[no-untyped-def]
    """exp(-32 y) of y >= 0: relative error 6e-11 up to y = 0.75, absolute 4e-11; 1 at 0."""
    t = min(y, FARTHEST)
    t2 = t * t
    t4 = t2 * t2
    low = t2 * (t * _C3 + _C2) + (t * _C1 + 1.0)
    high = t2 * (t * _C7 + _C6) + (t * _C5 + _C4)
    d = t4 * (t4 * _C8 + high) + low
    d *= d
    d *= d
    d *= d
    d *= d
    return d * d


class Servo(NamedTuple):
    """Loops of an axis at the period of its servo."""

    loop_gain: float
    proportional: float
    integral: float
    velocity_feedforward: float
    acceleration_feedforward: float
    limit: float
    period: float
    reached: float
    """Share of a step of v_ref that is reached in a period [1]."""
    seen: float
    """Share of a step of speed that the velocity loop sees in a period [1]."""


class ServoState(NamedTuple):
    """Memory of the loops from sample to sample."""

    integral: float
    """Share of the command [A]."""
    v_seen: float
    v_ref: float
    """Speed as the velocity loop saw it last, and its reference [m/s]."""
    error: float
    """Their difference at the sample before [m/s]."""


class Side(NamedTuple):
    """Friction in one direction in a step of the mechanics; forces as the speed they take [m/s]."""

    coulomb: float
    dip: float
    """Static less Coulomb friction."""
    narrow: float
    """Factor on the speed in :func:`decay` [s/m]."""
    kept: float
    slowed: float
    """Factors on the speed by viscous friction, at the beginning and at the end of a step [1]."""


@_compiled_fused
def servo_step(x_ref, rate, change, x, v, state, servo, rules):  # type: ignore[no-untyped-def]
    """Command of one sample [A] and the state for the next one.

    ``rate`` and ``change`` are the first two derivatives of the reference.  The integral stays
    while the limit holds and the error would carry it further (conditional integration).
    """
    target = servo.loop_gain * (x_ref - x) + servo.velocity_feedforward * rate
    v_ref = servo.reached * target + (1.0 - servo.reached) * state.v_ref
    v_seen = servo.seen * v + (1.0 - servo.seen) * state.v_seen
    error = v_ref - v_seen
    proportional, integral = servo.proportional, servo.integral
    if rules[2] > 0.0 or rules[3] > 0.0:
        p, i = _increments(rules[0] * error, rules[1] * (error - state.error) / servo.period)
        proportional *= 1.0 + rules[2] * p
        integral *= 1.0 + rules[3] * i
    demand = proportional * error + (servo.acceleration_feedforward * change + state.integral)
    command = min(max(demand, -servo.limit), servo.limit)
    growth = error if (demand - command) * error <= 0.0 else 0.0
    summed = servo.period * integral * growth + state.integral
    return command, ServoState(summed, v_seen, v_ref, error)


@_compiled_fused
def sliding_step(v, push, up, down):  # type: ignore[no-untyped-def]
    """Speed one step on, under friction that sticks exactly [m/s].

    ``push`` is what all but friction would add to the speed [m/s]; ``up`` and ``down`` are friction
    in the positive and the negative direction.
    """
    free = v * (up.kept if v > 0.0 else down.kept) + push
    narrow = v * (up.narrow if v > 0.0 else down.narrow)
    fade = decay(narrow * narrow) if (v > 0.0) == (free > 0.0) else 1.0
    highest, lowest = up.dip * fade + up.coulomb, -down.dip * fade - down.coulomb
    slowed = up.slowed if free > 0.0 else down.slowed
    return (free - min(max(free, lowest), highest)) * slowed


@_compiled_fused
def presliding_step(v, z, push, up, down, per_newton, step, spring):  # type: ignore[no-untyped-def]
    """Speed [m/s] and deflection [m] one step on, under friction that is a spring before it slides.

    The deflection follows the speed that was, and pulls on the mass for one step.
    """
    stiffness, loss = spring
    side = up if v > 0.0 else down
    narrow = v * side.narrow
    level = max((side.coulomb + side.dip * decay(narrow * narrow)) / per_newton, 1e-9)
    z = (z + step * v) * level / (level + step * (stiffness * abs(v) + loss * level))
    return (v + push - per_newton * stiffness * z) / (3.0 - 2.0 * side.kept), z


@compiled
def _followed(lag, period):  # type: ignore[no-untyped-def]
    """Share of a step that a first-order lag covers in one period [1]."""
    return -expm1(-period / lag) if lag > 0.0 else 1.0


@compiled
def _side(row, column, per_newton):  # type: ignore[no-untyped-def]
    coulomb, static, stribeck = row[column], row[column + 1], row[column + 2]
    half = 0.5 * per_newton * row[column + 3]
    return Side(
        per_newton * coulomb, per_newton * (static - coulomb), 1.0 / (stribeck * sqrt(32.0)),
        1.0 - half, 1.0 / (1.0 + half),
    )  # fmt: skip


@_compiled_unfused
def _pushed(constant, command, offset, load):  # type: ignore[no-untyped-def]
    """Force on the mass but friction [N]; unfused, so that what carries its offset stands."""
    return constant * command - offset - load


@_compiled_fused
def follow(  # type: ignore[no-untyped-def]
    reference, load, row, period, inner, held, spring, rules, state, position, velocity, command
):
    """Fill the traces of one axis, (T,), from ``state`` on; greatest speed error and its change.

    The last two [m/s], [m/s^2] count where friction is a spring before it slides.
    """
    each = period / inner
    step = each / held
    per_newton = step / row[DriveColumn.MASS]
    constant, offset = row[DriveColumn.FORCE_CONSTANT], row[DriveColumn.OFFSET]
    up = _side(row, DriveColumn.COULOMB_POSITIVE, per_newton)
    down = _side(row, DriveColumn.COULOMB_NEGATIVE, per_newton)
    servo = Servo(
        row[DriveColumn.LOOP_GAIN], row[DriveColumn.PROPORTIONAL], row[DriveColumn.INTEGRAL],
        row[DriveColumn.VELOCITY_FEEDFORWARD], row[DriveColumn.ACCELERATION_FEEDFORWARD],
        row[DriveColumn.CURRENT_LIMIT], each, _followed(row[DriveColumn.POSITION_LAG], each),
        _followed(row[DriveColumn.VELOCITY_LAG], each),
    )  # fmt: skip
    x, v, z = state[0], state[1], state[2]
    loops = ServoState(state[3], state[4], state[5], state[6])
    last, rate = state[7], state[8]
    greatest, fastest = 0.0, 0.0
    for k in range(reference.shape[0]):
        here, after = reference[k], reference[min(k + 1, reference.shape[0] - 1)]
        against = row[DriveColumn.LOAD_FACTOR] * load[min(k, load.shape[0] - 1)]
        position[k], velocity[k] = x, v
        for j in range(inner):
            x_ref = here + (after - here) * (j / inner)
            before, rate = rate, (x_ref - last) / each
            last = x_ref
            error = loops.error
            drawn, loops = servo_step(
                x_ref, rate, (rate - before) / each, x, v, loops, servo, rules
            )
            if j == 0:
                command[k] = drawn
            push = per_newton * _pushed(constant, drawn, offset, against)
            if spring[0] > 0.0:
                greatest = max(greatest, abs(loops.error))
                fastest = max(fastest, abs(loops.error - error) / each)
            for _ in range(held):
                if spring[0] > 0.0:
                    v_next, z = presliding_step(v, z, push, up, down, per_newton, step, spring)
                else:
                    v_next = sliding_step(v, push, up, down)
                x += 0.5 * step * (v + v_next)
                v = v_next
    state[0], state[1], state[2] = x, v, z
    state[3], state[4], state[5], state[6] = loops.integral, loops.v_seen, loops.v_ref, loops.error
    state[7], state[8] = last, rate
    return greatest, fastest


@dataclass(frozen=True, kw_only=True)
class DriveTraces:
    """P individuals of one axis at T samples, (P, T) each; not finite after an overflow."""

    position: Floats = field(repr=False)
    velocity: Floats = field(repr=False)
    """Position [m] and velocity [m/s] at the encoder."""
    command: Floats = field(repr=False)
    """Set at the sample [A]."""
    greatest: Floats
    """Greatest speed error [m/s] and change of it [m/s^2] where friction is a spring; (P, 2)."""


def simulate(
    reference: ArrayLike,
    period: float,
    table: ArrayLike,
    *,
    load: ArrayLike | None = None,
    substeps: int = 1,
    servo_substeps: bool = False,
    start: DriveStart | None = None,
    spring: tuple[float, float] = STICKS,
    rules: tuple[float, float, float, float] = NO_RULES,
    state: Floats | None = None,
) -> DriveTraces:
    """Traces of many variants of one axis, a ``table`` (P, 21) of :func:`drive_row`.

    All follow one ``reference`` [m] under one ``load`` against positive motion [N], (T,) each, the
    load before each row's factor and held to the next sample; they start at rest at the first
    reference unless ``start`` says otherwise.  The mechanics make ``substeps`` in a ``period``, and
    with ``servo_substeps`` the servo samples at each of them, its reference interpolated: for
    records that are slower than the servo.  ``spring`` is the presliding stiffness sigma [N/m] and
    the rate 1 / T at which the deflection of an axis at rest decays [1/s]; ``rules`` the scales of
    the speed error [s/m] and of its change [s^2/m] and the spans of both gains [1].  ``state``
    (STATES,) is kept from call to call where the reference of a single axis comes in parts, NaN
    before the first.  ValueError when reference or load has another shape or is not finite.
    """
    check_steps(period, substeps)
    rows, x_ref = np.ascontiguousarray(table, dtype=np.float64), samples("reference", reference)
    push = np.zeros(1) if load is None else samples("load", load, len(x_ref))
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    traces, greatest = np.empty((3, len(rows), len(x_ref))), np.empty((len(rows), 2))
    kept = np.full(STATES, np.nan) if state is None else state
    for p, row in enumerate(rows):
        if state is None or np.isnan(kept[0]):
            kept[:] = _first_state(row, float(x_ref[0]), period / inner, start)
        greatest[p] = follow(
            x_ref, push, row, period, inner, held, spring, rules, kept, *traces[:, p]
        )
    return DriveTraces(position=traces[0], velocity=traces[1], command=traces[2], greatest=greatest)


def _first_state(row: Floats, first: float, period: float, start: DriveStart | None) -> list[float]:
    """Memory at rest with settled lags and the first command, including the constant force."""
    begin = start or DriveStart(
        position=first, command=row[DriveColumn.OFFSET] / row[DriveColumn.FORCE_CONSTANT]
    )
    x, v, rate = begin.position, begin.velocity, begin.reference_velocity
    v_ref = row[DriveColumn.LOOP_GAIN] * (first - x) + row[DriveColumn.VELOCITY_FEEDFORWARD] * rate
    integral = begin.command - row[DriveColumn.PROPORTIONAL] * (v_ref - v)
    integral = integral if row[DriveColumn.INTEGRAL] > 0 else 0.0
    return [x, v, 0.0, integral, v, v_ref, 0.0, first - period * rate, rate]


def fuzzy_rules(error: float, change: float) -> tuple[float, float, float, float]:
    """Rules of :func:`simulate` whose sets end at these inputs, with the published spans.

    Parameters
    ----------
    error, change : float
        Greatest speed error [m/s] and greatest change of it [m/s^2]; 0 leaves an input out.
    """
    scales = [10.0 / greatest if greatest > 0 else 0.0 for greatest in (error, change)]
    fuzzy = FuzzyParameters(error_scale=scales[0], change_scale=scales[1])
    return fuzzy.error_scale, fuzzy.change_scale, fuzzy.proportional_span, fuzzy.integral_span
