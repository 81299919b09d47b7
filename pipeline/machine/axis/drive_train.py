"""Drive train: motor, twisting shaft and carriage, stepped under a held voltage, compiled.

A motor and its load on a shaft that twists, with coupling, screw and nut in series:

J_m th_m'' + C_m th_m' + K (th_m - th_l) + D (th_m' - th_l') = T_e - T_fm
J_l th_l'' + C_l th_l' + K (th_l - th_m) + D (th_l' - th_m') = -T_l

J_l = J_s + (L / 2 pi)^2 M and 1/K = 1/K_a + 1/K_s + 1/((L / 2 pi)^2 K_g): Feed2025, whose Eq. 12
counts J_m twice.  T_l holds friction and load of the carriage times L / 2 pi.  With K infinite both
are one mass.

The classical Runge-Kutta method of order four runs on everything at once: currents, angles, speeds
and the energies' integrals.  Dry friction makes it smooth in pieces: a body slides in one
direction or the other, or sticks.  A speed that would change its sign within a step is stopped
where it is zero (by regula falsi on the step's length), and there friction balances the torque up
to its static level, or the body goes on.  So a body that sticks stands still exactly, and nothing
chatters.
"""

from dataclasses import dataclass
from math import cos, exp, inf, pi, sin, sqrt
from typing import Annotated, Any, NamedTuple

from pipeline.kernels import compiled
from pipeline.machine.axis.motor import copper_loss, current_rates, input_power, rotated, torque
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged

I_D, I_Q, W_M, TH_M, W_L, TH_L = range(6)
"""Currents [A]; speed [rad/s] and angle [rad] of the motor and of the load."""
INPUT, COPPER, SHAFT, LOST, LOAD = range(6, 11)
"""Integrals [J]: power in, copper loss, T_e w, friction and damping, work on the load."""
STATES = 11
"""Length of the state."""
WORK_ROWS = 6
"""Rows of the work array of a step."""

_EVENTS = 8
"""Greatest number of changes between sliding and sticking within a step."""
_REFINEMENTS = 4
"""Iterations for the instant of standstill; each gains an order of the step's length."""
_Stiffness = Annotated[float, Range(above=0.0, finite=False)]
"""Positive, infinite for a rigid part."""


@dataclass(frozen=True, kw_only=True)
class TransmissionParameters(Ranged, section="transmission"):
    """Transmission from the motor's shaft to the carriage, and the carriage."""

    lead: Positive
    """L, travel of the carriage for one revolution of the screw [m/rev]."""
    mass: Positive
    """M of all that moves along [kg]."""
    screw_inertia: NotNegative = 0.0
    """J_s [kg m^2]."""
    coupling_stiffness: _Stiffness = inf
    screw_stiffness: _Stiffness = inf
    """K_a, K_s, torsion [N m/rad]; infinite, the default, for a rigid part."""
    axial_stiffness: _Stiffness = inf
    """K_g of nut, bearings and screw along the axis [N/m]; infinite for rigid parts."""
    load_damping: NotNegative = 0.0
    """C_l, viscous, about the load's shaft [N m s/rad]."""
    internal_damping: NotNegative = 0.0
    """D of the twist [N m s/rad]; not in Feed2025, where it is 0."""

    @property
    def ratio(self) -> float:
        """L / 2 pi [m/rad], travel of the carriage for one radian of the screw."""
        return self.lead / (2 * pi)

    @property
    def load_inertia(self) -> float:
        """J_l = J_s + (L / 2 pi)^2 M [kg m^2]."""
        return self.screw_inertia + self.ratio**2 * self.mass

    @property
    def stiffness(self) -> float:
        """K about the screw [N m/rad]; infinite when all three parts are rigid."""
        along = self.ratio**2 * self.axial_stiffness
        parts = (self.coupling_stiffness, self.screw_stiffness, along)
        compliance = sum(1 / k for k in parts)
        return 1 / compliance if compliance > 0 else inf


def twist_torque(angle: Any, speed: Any, stiffness: Any, damping: Any) -> Any:
    """Torque of the motor on the load through the shaft [N m].

    Parameters
    ----------
    angle, speed, stiffness, damping : float
        Motor less load [rad], [rad/s]; K [N m/rad], D [N m s/rad].
    """
    return stiffness * angle + damping * speed


def resonance(motor_inertia: float, load_inertia: float, stiffness: float) -> float:
    """Resonance sqrt(K (1/J_m + 1/J_l)) [rad/s]: both swing against each other.

    >>> round(resonance(3.19e-4, 2.68e-3, 650.0))
    1510
    """
    return sqrt(stiffness * (1 / motor_inertia + 1 / load_inertia))


class Winding(NamedTuple):
    """:class:`pipeline.machine.axis.motor.MotorParameters` as the kernel takes them."""

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
def advance(y, h, alpha, beta, load, winding, shafts, work):  # type: ignore[no-untyped-def]
    """Step the state ``y`` of shape (STATES,) by ``h`` [s] in place.

    ``alpha``, ``beta`` is the voltage in the stator's frame [V], ``load`` a torque against positive
    motion [N m], both held; ``work`` has shape (WORK_ROWS, STATES).
    """
    new = work[4]
    left = h
    events = 0
    while left > 0.0:
        mode_m, mode_l = modes(y, load, winding, shafts)
        _runge_kutta(y, left, alpha, beta, load, mode_m, mode_l, winding, shafts, work)
        body = _reversing(y, new, mode_m, mode_l, shafts)
        if body >= 0 and y[body] == 0.0:
            # it broke away and came back within the step: it has not moved
            mode_m = 0.0 if body == W_M or shafts.rigid else mode_m
            mode_l = 0.0 if body == W_L or shafts.rigid else mode_l
            _runge_kutta(y, left, alpha, beta, load, mode_m, mode_l, winding, shafts, work)
            body = _reversing(y, new, mode_m, mode_l, shafts)
        if body < 0 or y[body] == 0.0 or events == _EVENTS:
            part = left
        else:
            part = _until_zero(
                y, left, body, alpha, beta, load, mode_m, mode_l, winding, shafts, work
            )
        _accept(y, new, body, shafts.rigid)
        left -= part
        events += 1


@compiled
def holding_torques(y, load, winding, shafts):  # type: ignore[no-untyped-def]
    """Torques of dry friction at standstill, of motor and load [N m]; the same of a rigid shaft."""
    drive = _torque(y[I_D], y[I_Q], winding)
    if shafts.rigid:
        return drive - load, drive - load
    angle, speed = y[TH_M] - y[TH_L], y[W_M] - y[W_L]
    twist = _twist(angle, speed, shafts.stiffness, shafts.internal_damping)
    return drive - twist, twist - load


@compiled
def modes(y, load, winding, shafts):  # type: ignore[no-untyped-def]
    """Directions in which motor and load slide, 0 for a body that sticks."""
    held_m, held_l = holding_torques(y, load, winding, shafts)
    coulomb, above, below = shafts.motor_coulomb, shafts.positive.static, shafts.negative.static
    if shafts.rigid:
        mode = _mode(y[W_L], held_l, above + coulomb, below + coulomb)
        return mode, mode
    return _mode(y[W_M], held_m, coulomb, coulomb), _mode(y[W_L], held_l, above, below)


@compiled
def _mode(speed, torque, above, below):  # type: ignore[no-untyped-def]
    if speed > 0.0 or (speed == 0.0 and torque > above):
        return 1.0
    if speed < 0.0 or (speed == 0.0 and torque < -below):
        return -1.0
    # a body without dry friction is never held
    return 0.0 if above > 0.0 or below > 0.0 else 1.0


@compiled
def sliding_friction(mode, speed, shafts):  # type: ignore[no-untyped-def]
    """Torque of the guideway's friction that slides in the direction ``mode`` [N m]."""
    side = shafts.positive if mode > 0.0 else shafts.negative
    s = max(mode * speed, 0.0)
    stribeck = (side.static - side.coulomb) * exp(-((s / side.stribeck) ** 2))
    return mode * (side.coulomb + stribeck + side.viscous * s)


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
def _until_zero(y, h, body, alpha, beta, load, mode_m, mode_l, winding, shafts, work):  # type: ignore[no-untyped-def]
    """Shorten a step to the instant of zero speed of ``body``; return its length [s]."""
    new = work[4]
    low, high, at_low, at_high = 0.0, h, y[body], new[body]
    part = h
    for _ in range(_REFINEMENTS):
        part = low + (high - low) * at_low / (at_low - at_high)
        _runge_kutta(y, part, alpha, beta, load, mode_m, mode_l, winding, shafts, work)
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
def _runge_kutta(y, h, alpha, beta, load, mode_m, mode_l, winding, shafts, work):  # type: ignore[no-untyped-def]
    new, between = work[4], work[5]
    _derivative(y, alpha, beta, load, mode_m, mode_l, winding, shafts, work[0])
    for j in range(STATES):
        between[j] = y[j] + 0.5 * h * work[0, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, work[1])
    for j in range(STATES):
        between[j] = y[j] + 0.5 * h * work[1, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, work[2])
    for j in range(STATES):
        between[j] = y[j] + h * work[2, j]
    _derivative(between, alpha, beta, load, mode_m, mode_l, winding, shafts, work[3])
    for j in range(STATES):
        new[j] = y[j] + h / 6.0 * (work[0, j] + 2.0 * (work[1, j] + work[2, j]) + work[3, j])


@compiled
def _derivative(y, alpha, beta, load, mode_m, mode_l, winding, shafts, rate):  # type: ignore[no-untyped-def]
    i_d, i_q, w_m, w_l = y[I_D], y[I_Q], y[W_M], y[W_L]
    angle = winding.pole_pairs * y[TH_M]
    u_d, u_q = _rotated(alpha, beta, cos(angle), -sin(angle))
    rate[I_D], rate[I_Q] = _rates(i_d, i_q, u_d, u_q, w_m, winding)
    drive = _torque(i_d, i_q, winding)
    drag_m = shafts.motor_damping * w_m + mode_m * shafts.motor_coulomb
    drag_l = shafts.load_damping * w_l + sliding_friction(mode_l, w_l, shafts)
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
