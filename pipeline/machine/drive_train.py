"""Motor, shaft and carriage under a held voltage, stepped by Runge and Kutta's method, compiled.

The classical method of order four runs on everything at once: currents, angles, speeds and the
energies' integrals.  Dry friction makes it smooth in pieces: a body slides one way, the other, or
sticks.  A speed that would change its sign within a step is stopped where it is zero (by regula
falsi on the step's length), and there friction holds whatever is asked of it up to its static
level, or the body goes on.  So what sticks stands still exactly, and nothing chatters.
"""

from math import cos, exp, sin
from typing import NamedTuple

from pipeline.kernels import compiled
from pipeline.machine.motor import copper_loss, current_rates, input_power, torque
from pipeline.machine.park import rotated
from pipeline.machine.two_mass import twist_torque

I_D, I_Q, W_M, TH_M, W_L, TH_L = range(6)
"""Currents [A]; speed [rad/s] and angle [rad] of the motor and of the load."""
INPUT, COPPER, SHAFT, LOST, LOAD = range(6, 11)
"""Integrals [J]: power in, copper loss, T_e w, friction and damping, work on the load."""
STATES = 11
ROOM = 6
"""Rows of room that a step works in."""

_EVENTS = 8
"""Changes between sliding and sticking within a step that are followed."""
_REFINEMENTS = 4
"""Each wins an order of the step's length in where a speed is zero."""


class Winding(NamedTuple):
    """:class:`pipeline.machine.motor.MotorParameters` as the kernel takes them."""

    resistance: float
    inductance_d: float
    inductance_q: float
    flux: float
    pole_pairs: float


class Direction(NamedTuple):
    """Friction of the guideway in one direction, about the screw."""

    coulomb: float
    static: float
    stribeck: float
    viscous: float


class Shafts(NamedTuple):
    """Two masses, or one when ``rigid``; [kg m^2], [N m], [rad]."""

    motor_inertia: float
    motor_damping: float
    motor_coulomb: float
    load_inertia: float
    load_damping: float
    stiffness: float
    internal_damping: float
    rigid: bool
    positive: Direction
    negative: Direction


_rates = compiled(current_rates)
_torque = compiled(torque)
_input = compiled(input_power)
_copper = compiled(copper_loss)
_rotated = compiled(rotated)
_twist = compiled(twist_torque)


@compiled
def advance(y, h, alpha, beta, load, winding, shafts, room):  # type: ignore[no-untyped-def]
    """Step the state ``y`` of shape (STATES,) by ``h`` [s] in place.

    ``alpha``, ``beta`` is the voltage in the stator's frame [V], ``load`` a torque against positive
    motion [N m], both held; ``room`` has shape (ROOM, STATES).
    """
    new = room[4]
    left = h
    events = 0
    while left > 0.0:
        mode_m, mode_l = modes(y, load, winding, shafts)
        _runge_kutta(y, left, alpha, beta, load, mode_m, mode_l, winding, shafts, room)
        body = _reversing(y, new, mode_m, mode_l, shafts)
        if body >= 0 and y[body] == 0.0:
            # it broke away and came back within the step: it has not moved
            mode_m = 0.0 if body == W_M or shafts.rigid else mode_m
            mode_l = 0.0 if body == W_L or shafts.rigid else mode_l
            _runge_kutta(y, left, alpha, beta, load, mode_m, mode_l, winding, shafts, room)
            body = _reversing(y, new, mode_m, mode_l, shafts)
        if body < 0 or y[body] == 0.0 or events == _EVENTS:
            part = left
        else:
            part = _until_zero(
                y, left, body, alpha, beta, load, mode_m, mode_l, winding, shafts, room
            )
        _accept(y, new, body, shafts.rigid)
        left -= part
        events += 1


@compiled
def asked_torques(y, load, winding, shafts):  # type: ignore[no-untyped-def]
    """Torques that dry friction has to hold at standstill, of the motor and of the load [N m].

    Rigid shafts are one body: both are the same.
    """
    drive = _torque(y[I_D], y[I_Q], winding)
    if shafts.rigid:
        return drive - load, drive - load
    angle, speed = y[TH_M] - y[TH_L], y[W_M] - y[W_L]
    twist = _twist(angle, speed, shafts.stiffness, shafts.internal_damping)
    return drive - twist, twist - load


@compiled
def modes(y, load, winding, shafts):  # type: ignore[no-untyped-def]
    """Directions in which motor and load slide, 0 for a body that sticks."""
    asked_m, asked_l = asked_torques(y, load, winding, shafts)
    coulomb, above, below = shafts.motor_coulomb, shafts.positive.static, shafts.negative.static
    if shafts.rigid:
        mode = _mode(y[W_L], asked_l, above + coulomb, below + coulomb)
        return mode, mode
    return _mode(y[W_M], asked_m, coulomb, coulomb), _mode(y[W_L], asked_l, above, below)


@compiled
def _mode(speed, asked, above, below):  # type: ignore[no-untyped-def]
    if speed > 0.0 or (speed == 0.0 and asked > above):
        return 1.0
    if speed < 0.0 or (speed == 0.0 and asked < -below):
        return -1.0
    # what has no dry friction is never held
    return 0.0 if above > 0.0 or below > 0.0 else 1.0


@compiled
def sliding(mode, speed, shafts):  # type: ignore[no-untyped-def]
    """Torque of the guideway's friction that slides in the direction ``mode`` [N m]."""
    one = shafts.positive if mode > 0.0 else shafts.negative
    s = max(mode * speed, 0.0)
    dip = (one.static - one.coulomb) * exp(-((s / one.stribeck) ** 2))
    return mode * (one.coulomb + dip + one.viscous * s)


@compiled
def _reversing(y, new, mode_m, mode_l, shafts):  # type: ignore[no-untyped-def]
    """The body with dry friction whose speed changes its sign first, -1 for none."""
    dry_m = shafts.motor_coulomb > 0.0
    dry_l = shafts.positive.static > 0.0 or shafts.negative.static > 0.0
    body = -1
    first = 1.0
    if mode_l * new[W_L] < 0.0 and (dry_l or (shafts.rigid and dry_m)):
        body = W_L
        first = y[W_L] / (y[W_L] - new[W_L])
    motor = mode_m * new[W_M] < 0.0 and dry_m and not shafts.rigid
    if motor and y[W_M] / (y[W_M] - new[W_M]) < first:
        body = W_M
    return body


@compiled
def _until_zero(y, h, body, alpha, beta, load, mode_m, mode_l, winding, shafts, room):  # type: ignore[no-untyped-def]
    """Shorten a step to where the speed of ``body`` is zero; what is left of its length [s]."""
    new = room[4]
    low, high, at_low, at_high = 0.0, h, y[body], new[body]
    part = h
    for _ in range(_REFINEMENTS):
        part = low + (high - low) * at_low / (at_low - at_high)
        _runge_kutta(y, part, alpha, beta, load, mode_m, mode_l, winding, shafts, room)
        if new[body] == 0.0:
            break
        # signs and not a product, which could underflow to zero
        if (new[body] > 0.0) == (at_low > 0.0):
            low, at_low = part, new[body]
        else:
            high, at_high = part, new[body]
    return part


@compiled
def _accept(y, new, stopped, rigid):  # type: ignore[no-untyped-def]
    for j in range(STATES):
        y[j] = new[j]
    if stopped >= 0:
        y[stopped] = 0.0
        if rigid:
            y[W_M] = 0.0
            y[W_L] = 0.0


@compiled
def _runge_kutta(y, h, alpha, beta, load, mode_m, mode_l, winding, shafts, room):  # type: ignore[no-untyped-def]
    new, between = room[4], room[5]
    _derivative(y, alpha, beta, load, mode_m, mode_l, winding, shafts, room[0])
    for j in range(STATES):
        between[j] = y[j] + 0.5 * h * room[0, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, room[1])
    for j in range(STATES):
        between[j] = y[j] + 0.5 * h * room[1, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, room[2])
    for j in range(STATES):
        between[j] = y[j] + h * room[2, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, room[3])
    for j in range(STATES):
        new[j] = y[j] + h / 6.0 * (room[0, j] + 2.0 * (room[1, j] + room[2, j]) + room[3, j])


@compiled
def _derivative(y, alpha, beta, load, mode_m, mode_l, winding, shafts, rate):  # type: ignore[no-untyped-def]
    i_d, i_q, w_m, w_l = y[I_D], y[I_Q], y[W_M], y[W_L]
    angle = winding.pole_pairs * y[TH_M]
    u_d, u_q = _rotated(alpha, beta, cos(angle), -sin(angle))
    rate[I_D], rate[I_Q] = _rates(i_d, i_q, u_d, u_q, w_m, winding)
    drive = _torque(i_d, i_q, winding)
    drag_m = shafts.motor_damping * w_m + mode_m * shafts.motor_coulomb
    drag_l = shafts.load_damping * w_l + sliding(mode_l, w_l, shafts)
    lost = drag_m * w_m + drag_l * w_l
    if shafts.rigid:
        inertia = shafts.motor_inertia + shafts.load_inertia
        rate[W_M] = abs(mode_l) * (drive - drag_m - drag_l - load) / inertia
        rate[W_L] = rate[W_M]
    else:
        twist = _twist(y[TH_M] - y[TH_L], w_m - w_l, shafts.stiffness, shafts.internal_damping)
        rate[W_M] = abs(mode_m) * (drive - drag_m - twist) / shafts.motor_inertia
        rate[W_L] = abs(mode_l) * (twist - drag_l - load) / shafts.load_inertia
        lost += shafts.internal_damping * (w_m - w_l) ** 2
    rate[TH_M] = w_m
    rate[TH_L] = w_l
    rate[INPUT] = _input(i_d, i_q, u_d, u_q)
    rate[COPPER] = _copper(i_d, i_q, winding)
    rate[SHAFT] = drive * w_m
    rate[LOST] = lost
    rate[LOAD] = load * w_l
