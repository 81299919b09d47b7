"""A feed axis whose friction gives way like a spring before it slides, compiled.

Below sliding the contact is a spring: its deflection z follows z' = v - sigma |v| z / g(v) and
holds with sigma z, where g(v) is Stribeck's level (Canudas de Wit, Olsson, Åström, Lischinsky: A
new model for control of systems with friction, IEEE Trans. Automatic Control 40, 1995; without its
damping term).  Sliding, the friction is that of :mod:`pipeline.machine.axis.friction`.

It matters where an axis stands under a load: friction that sticks exactly holds the load for ever,
while a spring gives way by some micrometres, so that the integral of the velocity loop takes the
load over; and small oscillations about a standstill, as of passing teeth, wear the spring's force
off. So does what shakes an axis that is held in position and nothing else (noise of its encoders,
the torque's ripple, machines beside it): slowly, within seconds, as the deflection's own loss z' =
v - sigma |v| z / g(v) - z / T; the command of a standing axis falls with it. A feed feels it below
g / (sigma T) alone, some um/s. Servo and mass are those of :mod:`pipeline.twin.drive`.

The velocity loop may be a fuzzy PI: the rules of :mod:`pipeline.machine.axis.loops` move both of
its gains about those of the servo.
"""

from math import exp, expm1

from pipeline.kernels import compiled
from pipeline.machine.axis.feed_drive import DriveColumn
from pipeline.machine.axis.loops import FuzzyParameters, increments

_GAIN, _P, _I = (
    int(DriveColumn.LOOP_GAIN), int(DriveColumn.PROPORTIONAL), int(DriveColumn.INTEGRAL),
)  # fmt: skip
_FV, _FA = int(DriveColumn.VELOCITY_FEEDFORWARD), int(DriveColumn.ACCELERATION_FEEDFORWARD)
_LIMIT, _MASS, _FORCE = (
    int(DriveColumn.CURRENT_LIMIT), int(DriveColumn.MASS), int(DriveColumn.FORCE_CONSTANT),
)  # fmt: skip
_OFFSET, _UP, _DOWN = (
    int(DriveColumn.OFFSET), int(DriveColumn.COULOMB_POSITIVE), int(DriveColumn.COULOMB_NEGATIVE),
)  # fmt: skip
_LAG_V, _LAG_REF = int(DriveColumn.VELOCITY_LAG), int(DriveColumn.POSITION_LAG)
_increments = compiled(increments)
PLAIN = (0.0, 0.0, 0.0, 0.0)
"""Rules that move no gain."""
STATES = 9
"""Numbers that an axis remembers from sample to sample."""


def fuzzy_rules(error: float, change: float) -> tuple[float, float, float, float]:
    """Rules of :func:`presliding_trace` whose sets end at these inputs, with the published spans.

    Parameters
    ----------
    error, change : float
        Greatest speed error [m/s] and greatest change of it [m/s^2]; 0 leaves an input out.
    """
    scales = [10.0 / one if one > 0 else 0.0 for one in (error, change)]
    known = FuzzyParameters(error_scale=scales[0], change_scale=scales[1])
    spans = known.proportional_span, known.integral_span
    return known.error_scale, known.change_scale, *spans


@compiled
def presliding_trace(  # type: ignore[no-untyped-def]
    reference, load, row, spring, period, position, command, rules=PLAIN, state=None
):
    """Fill position [m] and command [A] of an axis at T samples of its servo, from rest.

    Parameters
    ----------
    reference, load : (T,) arrays
        Commanded position [m], force against positive motion [N].
    row : (21,) array
        :class:`pipeline.machine.axis.feed_drive.DriveColumn`.
    spring : tuple of two floats
        sigma, the stiffness of friction before it slides [N/m], and the rate at which the
        deflection of an axis that stands is lost [1/s].
    period : float
        From sample to sample [s].
    position, command : (T,) arrays
        That are filled.
    rules : tuple of four floats
        Scales of the speed error [s/m] and of its change [s^2/m], and the spans of the proportional
        and of the integral gain [1], as :class:`pipeline.machine.axis.loops.FuzzyParameters`.
    state : (STATES,) array, optional
        Kept from call to call, where a reference comes in parts; NaN before its first part.

    Returns
    -------
    error, change : float
        Greatest speed error [m/s] and greatest change of it [m/s^2], as magnitudes.
    """
    share_v = -expm1(-period / row[_LAG_V]) if row[_LAG_V] > 0.0 else 1.0
    share_ref = -expm1(-period / row[_LAG_REF]) if row[_LAG_REF] > 0.0 else 1.0
    stiffness, loss = spring
    mass, constant, offset = row[_MASS], row[_FORCE], row[_OFFSET]
    x, v, z, seen, v_ref = reference[0], 0.0, 0.0, 0.0, 0.0
    integral = offset / constant / row[_I] if row[_I] > 0.0 else 0.0
    last, rate, before, greatest, fastest = reference[0], 0.0, 0.0, 0.0, 0.0
    proportional = growth = 1.0
    if state is not None and state[0] == state[0]:
        x, v, z, seen, v_ref = state[0], state[1], state[2], state[3], state[4]
        integral, last, rate, before = state[5], state[6], state[7], state[8]
    for k in range(reference.shape[0]):
        was, rate = rate, (reference[k] - last) / period
        last = reference[k]
        asked = row[_GAIN] * (reference[k] - x) + row[_FV] * rate
        v_ref += share_ref * (asked - v_ref)
        seen += share_v * (v - seen)
        error = v_ref - seen
        change, before = (error - before) / period, error
        greatest, fastest = max(greatest, abs(error)), max(fastest, abs(change))
        if rules[2] > 0.0 or rules[3] > 0.0:
            p, i = _increments(rules[0] * error, rules[1] * change)
            proportional, growth = 1.0 + rules[2] * p, 1.0 + rules[3] * i
        demand = (
            row[_P] * proportional * error + row[_I] * integral + row[_FA] * (rate - was) / period
        )
        drawn = min(max(demand, -row[_LIMIT]), row[_LIMIT])
        if (demand - drawn) * error <= 0.0:
            integral += period * growth * error
        position[k], command[k] = x, drawn
        # the spring follows the speed that was, and pulls on the mass for one step
        side = _UP if v > 0.0 else _DOWN
        level = row[side] + (row[side + 1] - row[side]) * exp(-((v / row[side + 2]) ** 2))
        level = max(level, 1e-9)
        z = (z + period * v) * level / (level + period * (stiffness * abs(v) + loss * level))
        force = constant * drawn - offset - load[k] - stiffness * z
        v_next = (v + period / mass * force) / (1.0 + period / mass * row[side + 3])
        x += 0.5 * period * (v + v_next)
        v = v_next
    if state is not None:
        state[0], state[1], state[2], state[3], state[4] = x, v, z, seen, v_ref
        state[5], state[6], state[7], state[8] = integral, last, rate, before
    return greatest, fastest
