"""Cascade of position, speed and current loops around a drive train, compiled.

Each period of the current loops: position loop and speed loop when it is their turn, both current
loops, modulation, and the drive train under the voltage that comes of it.  Loops read angles,
speed and currents exactly at the period's start, and act at once; the voltage's frame is turned on
by half a period, so that its mean lies in the commanded direction.
"""

from math import ceil, cos, sin
from typing import NamedTuple

from pipeline.kernels import compiled
from pipeline.machine.axis.drive_train import (
    I_D,
    I_Q,
    STATES,
    TH_L,
    TH_M,
    W_L,
    W_M,
    advance,
    holding_torques,
    modes,
    sliding_friction,
)
from pipeline.machine.axis.loops import increments, induced_voltages
from pipeline.machine.axis.motor import duty, leg_voltage, limited, rotated, torque

TORQUE, FRICTION, U_D, U_Q, GAIN_P, GAIN_I = range(STATES, STATES + 6)
"""T_e and the guideway's friction [N m]; of the last period mean voltages [V], K_p and K_i."""
COLUMNS = STATES + 6
"""Columns of a sample: the state, and those above."""
MEMORY = 11
"""Quantities that the loops keep from period to period."""
_X_D, _X_Q, _X_W, _ERROR, _W_REF, _I_REF, _KP, _KI, _UD, _UQ, _STARTED = range(MEMORY)
_FASTEST = 1e6
"""Speed [rad/s] that no motor reaches: beyond it the drive runs away."""


class Loops(NamedTuple):
    """Settings of the loops; see the parameters of each for its meaning."""

    period: float
    steps: int
    gain_d: float
    integral_d: float
    gain_q: float
    integral_q: float
    torque_constant: float
    torque_limit: float
    proportional: float
    integral: float
    fuzzy: bool
    error_scale: float
    change_scale: float
    proportional_span: float
    integral_span: float
    speed_every: int
    position: bool
    gain: float
    feedforward: float
    motor_encoder: bool
    position_every: int
    ratio: float
    dc_link: float
    switched: bool
    overmodulation: bool


_torque = compiled(torque)
_rotated = compiled(rotated)
_induced = compiled(induced_voltages)
_increments = compiled(increments)
_limited = compiled(limited)
_duty = compiled(duty)
_leg_voltage = compiled(leg_voltage)


@compiled
def follow(reference, load, periods, winding, shafts, loops, y, memory, work, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (T, COLUMNS); the sample from which the drive runs away, or T.

    ``reference`` holds positions [m] or speeds [rad/s] and ``load`` torques against positive motion
    [N m], both of shape (T,); ``periods`` are those of the current loops between two samples.
    ``y`` of shape (STATES,) is the state, ``memory`` of (MEMORY,) zeros; ``work`` has shape
    (WORK_ROWS, STATES).
    """
    T = reference.shape[0]
    done = 0
    for k in range(T):
        _record(y, load[k], winding, shafts, memory, out[k])
        if k == T - 1:
            break
        rise = (reference[k + 1] - reference[k]) / periods
        for c in range(periods):
            if not abs(y[W_M]) < _FASTEST:
                return k
            if not loops.position:
                memory[_W_REF] = reference[k]
            elif done % loops.position_every == 0:
                _position_loop(reference[k] + c * rise, rise / loops.period, y, memory, loops)
            if done % loops.speed_every == 0:
                _speed_loop(y, memory, loops)
            alpha, beta = _current_loops(y, memory, winding, loops)
            if loops.switched:
                _switch(y, alpha, beta, load[k], winding, shafts, loops, work)
            else:
                for _ in range(loops.steps):
                    h = loops.period / loops.steps
                    advance(y, h, alpha, beta, load[k], winding, shafts, work)
            done += 1
    return T


@compiled
def _position_loop(reference, velocity, y, memory, loops):  # type: ignore[no-untyped-def]
    angle = y[TH_M] if loops.motor_encoder else y[TH_L]
    v = loops.gain * (reference - loops.ratio * angle) + loops.feedforward * velocity
    memory[_W_REF] = v / loops.ratio


@compiled
def _speed_loop(y, memory, loops):  # type: ignore[no-untyped-def]
    h = loops.period * loops.speed_every
    error = memory[_W_REF] - y[W_M]
    k_p, k_i = loops.proportional, loops.integral
    if loops.fuzzy:
        change = (error - memory[_ERROR]) / h if memory[_STARTED] > 0.0 else 0.0
        p, i = _increments(loops.error_scale * error, loops.change_scale * change)
        k_p *= 1.0 + loops.proportional_span * p
        k_i *= 1.0 + loops.integral_span * i
    commanded = k_p * error + memory[_X_W]
    limited_torque = min(max(commanded, -loops.torque_limit), loops.torque_limit)
    if commanded == limited_torque or error * commanded < 0.0:
        memory[_X_W] += k_i * h * error
    memory[_I_REF] = limited_torque / loops.torque_constant
    memory[_ERROR], memory[_STARTED] = error, 1.0
    memory[_KP], memory[_KI] = k_p, k_i


@compiled
def _current_loops(y, memory, winding, loops):  # type: ignore[no-untyped-def]
    """Voltage in the stator's frame for the period to come [V]."""
    error_d, error_q = -y[I_D], memory[_I_REF] - y[I_Q]
    induced_d, induced_q = _induced(y[I_D], y[I_Q], y[W_M], winding)
    u_d = loops.gain_d * error_d + memory[_X_D] + induced_d
    u_q = loops.gain_q * error_q + memory[_X_Q] + induced_q
    angle = winding.pole_pairs * (y[TH_M] + 0.5 * loops.period * y[W_M])
    c, s = cos(angle), sin(angle)
    alpha, beta = _rotated(u_d, u_q, c, s)
    alpha, beta = _limited(alpha, beta, loops.dc_link, loops.overmodulation)
    given_d, given_q = _rotated(alpha, beta, c, -s)
    memory[_X_D] += loops.integral_d * (error_d + (given_d - u_d) / loops.gain_d)
    memory[_X_Q] += loops.integral_q * (error_q + (given_q - u_q) / loops.gain_q)
    memory[_UD], memory[_UQ] = given_d, given_q
    return alpha, beta


@compiled
def _switch(y, alpha, beta, load, winding, shafts, loops, work):  # type: ignore[no-untyped-def]
    """A carrier period with its six edges, each where it falls."""
    h = loops.period
    a, b, c = _duty(alpha, beta, loops.dc_link)
    t_a, t_b, t_c = 0.5 * h * (1.0 - a), 0.5 * h * (1.0 - b), 0.5 * h * (1.0 - c)
    first, last = min(t_a, t_b, t_c), max(t_a, t_b, t_c)
    middle = t_a + t_b + t_c - first - last
    begin = 0.0
    for end in (first, middle, last, h - last, h - middle, h - first, h):
        length = end - begin
        if length > 0.0:
            at = begin + 0.5 * length
            on_a = 1.0 if t_a < at < h - t_a else 0.0
            on_b = 1.0 if t_b < at < h - t_b else 0.0
            on_c = 1.0 if t_c < at < h - t_c else 0.0
            u, v = _leg_voltage(on_a, on_b, on_c, loops.dc_link)
            steps = ceil(length / h * loops.steps)
            for _ in range(steps):
                advance(y, length / steps, u, v, load, winding, shafts, work)
            begin = end


@compiled
def _record(y, load, winding, shafts, memory, out):  # type: ignore[no-untyped-def]
    for j in range(STATES):
        out[j] = y[j]
    out[TORQUE] = _torque(y[I_D], y[I_Q], winding)
    _, mode = modes(y, load, winding, shafts)
    if mode != 0.0:
        out[FRICTION] = sliding_friction(mode, y[W_L], shafts)
    else:
        # at standstill friction balances the torque; the motor's bearings take their share first
        out[FRICTION] = holding_torques(y, load, winding, shafts)[1]
    out[U_D], out[U_Q] = memory[_UD], memory[_UQ]
    out[GAIN_P], out[GAIN_I] = memory[_KP], memory[_KI]
