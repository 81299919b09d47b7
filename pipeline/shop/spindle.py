"""Heat of the simulated spindle (numba): bearing friction, motor losses, a network of ten nodes.

Friction torque after Palmgren, motor losses with field weakening, two boundaries (air, chiller).
Explicit Euler with steps of one second or less; the fastest node (winding) has a time constant of
about 27 s.  The heat that leaves one node enters another, so the balance closes to rounding.
Sources stand in :mod:`pipeline.shop.parameters`.
"""

import math
from dataclasses import astuple
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.si import RPM
from pipeline.shop.parameters import BearingParameters, MotorParameters, SpindleParameters

NODES = ("winding", "stator", "rotor", "front_bearing", "rear_bearing", "housing", "head", "bed",
         "chiller", "coolant")  # fmt: skip
WINDING, STATOR, ROTOR, FRONT, REAR, HOUSING, HEAD, BED, CHILLER, COOLANT = range(10)
AIR = 10
OFF_FLOW = 0.04
"""Share of a jacket's conductance that is left when its pump stands [1]."""
SLOWEST = 10.0
"""Least speed at which the rated power is evaluated [rev/min]."""


@compiled_with()
def viscosity(temperature: float, slope: float, intercept: float) -> float:
    """Kinematic viscosity of the lubricant [mm2/s], thinner when warm.

    ``lg lg(nu + 0.7) = intercept - slope lg T`` with T in kelvin.  ``temperature`` [degC].
    Source: ASTM D341 (Walther's equation).
    """
    return 10.0 ** (10.0 ** (intercept - slope * math.log10(temperature + 273.15))) - 0.7


def viscosity_line(nu_40: float, nu_100: float) -> tuple[float, float]:
    """Slope and intercept [1] of :func:`viscosity` from its values at 40 and 100 degC [mm2/s]."""
    y_40, y_100 = (math.log10(math.log10(nu + 0.7)) for nu in (nu_40, nu_100))
    slope = (y_40 - y_100) / (math.log10(373.15) - math.log10(313.15))
    return slope, y_40 + slope * math.log10(313.15)


@compiled_with()
def friction_torque(
    speed: float, nu: float, load: float, d_m: float, f0: float, capacity: float
) -> float:
    """Friction torque of one angular contact bearing [N m].

    ``M0 = 1e-7 f0 (nu n)^(2/3) d_m^3`` [N mm, d_m in mm] where ``nu n >= 2000``, else its value
    there (lubricant), and ``M1 = 0.001 (P/C0)^0.33 P d_m`` (load).  ``speed`` [rev/min], ``nu``
    [mm2/s], ``load`` and ``capacity`` [N], ``d_m`` [m].
    Source: Palmgren, in Harris, Rolling Bearing Analysis, 5th ed., eqs. 10.8 to 10.12.
    """
    m_0 = 0.1 * f0 * max(nu * speed, 2000.0) ** (2.0 / 3.0) * d_m**3
    m_1 = 0.001 * (load / capacity) ** 0.33 * load * d_m
    return m_0 + m_1


@compiled_with()
def flux(speed: float, base_speed: float) -> float:
    """Flux of the motor against its rated flux [1]: weakened as 1/n above the base speed."""
    return 1.0 if speed <= base_speed else base_speed / speed


@compiled_with()
def copper_share(phi: float, current: float, magnetising: float) -> float:
    """Stator copper loss over the rated one [1] at flux ``phi`` and torque current ``current``.

    Magnetising and torque currents stand at right angles, so their squares add.
    """
    return (magnetising * phi) ** 2 + (1.0 - magnetising**2) * current**2


@compiled_with()
def iron_loss(phi: float, ratio: float, hysteresis: float, eddy: float) -> float:
    """Iron loss [W] at speed ratio ``ratio = n / base speed``: hysteresis and eddy currents."""
    return phi**2 * (hysteresis * ratio + eddy * ratio**2)


class Path(IntEnum):
    """Dependence of a conductance."""

    CONSTANT = 0
    AIR_GAP = 1  # shear in the gap mixes it: Taylor number, Bossmanns & Tu (1999)
    PUMP = 2  # chiller water flows while the machine is on
    FLOOD = 3  # cutting coolant is on
    NATURAL = 4  # grows with the fourth root of the difference
    SPINNING = 5  # a turning disc in air, about n^0.7


def _edges(p: SpindleParameters) -> list[tuple[int, int, float, Path]]:
    g = p.paths
    return [
        (WINDING, STATOR, g.winding_stator, Path.CONSTANT),
        (STATOR, HOUSING, g.stator_housing, Path.CONSTANT),
        (STATOR, CHILLER, g.stator_jacket, Path.PUMP),
        (STATOR, ROTOR, g.stator_rotor, Path.AIR_GAP),
        (ROTOR, FRONT, g.rotor_front, Path.CONSTANT),
        (ROTOR, REAR, g.rotor_rear, Path.CONSTANT),
        (FRONT, HOUSING, g.front_housing, Path.CONSTANT),
        (REAR, HOUSING, g.rear_housing, Path.CONSTANT),
        (HOUSING, CHILLER, g.housing_jacket, Path.PUMP),
        (HOUSING, HEAD, g.housing_head, Path.CONSTANT),
        (HEAD, BED, g.head_bed, Path.CONSTANT),
        (FRONT, COOLANT, g.nose_coolant, Path.FLOOD),
        (BED, COOLANT, g.bed_coolant, Path.FLOOD),
        (ROTOR, AIR, g.nose_air, Path.SPINNING),
        (HOUSING, AIR, g.housing_air, Path.NATURAL),
        (HEAD, AIR, g.head_air, Path.NATURAL),
        (BED, AIR, g.bed_air, Path.CONSTANT),
        (CHILLER, AIR, g.chiller_air, Path.CONSTANT),
        (COOLANT, AIR, g.coolant_air, Path.CONSTANT),
    ]


class Bearing(NamedTuple):
    """The fields of ``BearingParameters``, in their order."""

    pieces: int
    d_m: float
    f0: float
    preload: float
    capacity: float
    growth: float


class Constants(NamedTuple):
    """Constants of bearings, motor, chiller and heat shares in SI, speeds in rev/min."""

    front: Bearing
    rear: Bearing
    slope: float
    intercept: float
    rated_torque: float
    base_speed: float
    top_speed: float
    copper: float
    rotor: float
    hysteresis: float
    eddy: float
    magnetising: float
    hold: float
    windage: float
    inertia: float
    bed_heat: float
    feed_heat: float
    pump: float
    chip_share: float
    tool_share: float
    setpoint: float
    follows: bool
    hysteresis_band: float
    capacity: float
    capacity_slope: float


class Inputs(NamedTuple):
    """Loads on the spindle in each second; arrays of shape (T,)."""

    speed: Floats  # rev/min
    cut_power: Floats  # W
    hold: Bools  # bool: position control
    power: Bools  # bool: switched on
    coolant: Bools  # bool: flood on
    moving: Bools  # bool: feed axes move
    ambient: Floats  # degC


class Heat(NamedTuple):
    """Result: temperatures (T, 10) [degC], motor torque (T,) [N m], heats of the whole span [J]."""

    temperatures: Floats
    torque: Floats
    state: Floats  # last temperatures, then whether the chiller runs
    generated: float
    to_air: float
    to_chiller: float


def constants(p: SpindleParameters) -> Constants:
    """Constants of a spindle."""
    slope, intercept = viscosity_line(p.viscosity_40, p.viscosity_100)
    m, c = p.motor, p.chiller
    return Constants(
        front=Bearing(*astuple(p.front)), rear=Bearing(*astuple(p.rear)),
        slope=slope, intercept=intercept,
        rated_torque=m.rated_power / (m.base_speed * RPM), base_speed=m.base_speed,
        top_speed=p.top_speed, copper=m.copper_loss, rotor=m.rotor_loss,
        hysteresis=m.hysteresis_loss, eddy=m.eddy_loss, magnetising=m.magnetising_share,
        hold=m.hold_share, windage=m.windage, inertia=m.inertia, bed_heat=p.bed_heat,
        feed_heat=p.feed_heat, pump=p.coolant_pump, chip_share=p.chip_heat_to_coolant,
        tool_share=p.cut_heat_to_tool, setpoint=c.setpoint, follows=c.follows_ambient,
        hysteresis_band=c.hysteresis, capacity=c.capacity, capacity_slope=c.capacity_slope,
    )  # fmt: skip


def capacities(p: SpindleParameters) -> Floats:
    """Heat capacities of the nodes [J/K], shape (10,)."""
    return np.array([getattr(p.masses, node) for node in NODES])


def state_at_rest(ambient: float, nodes: int = len(NODES)) -> Floats:
    """State of a machine that has the temperature of the air [degC]; the chiller is off."""
    return np.append(np.full(nodes, ambient), 0.0)


def heat(state: Floats, inputs: Inputs, p: SpindleParameters, substeps: int = 1) -> Heat:
    """Node temperatures in each second from ``state`` (11,) [degC] by ``substeps`` Euler steps."""
    table = _edges(p)
    ends = np.array([(a, b) for a, b, _, _ in table])
    kinds = np.array([int(kind) for *_, kind in table])
    conductances = np.array([g for _, _, g, _ in table])
    return Heat(*_simulated(
        state.copy(), inputs, constants(p), ends, kinds, conductances, capacities(p), substeps
    ))  # fmt: skip


@compiled_with()
def _bearing_heat(speed: float, own: float, growth: float, b: Bearing, k: Constants) -> float:
    """Friction heat [W] of a bearing set at temperature ``own``; ``growth`` = shaft - housing."""
    if speed < 1.0:
        return 0.0
    load = b.preload * max(1.0 + b.growth * growth, 0.2)
    nu = viscosity(own, k.slope, k.intercept)
    return b.pieces * friction_torque(speed, nu, load, b.d_m, b.f0, b.capacity) * speed * RPM


@compiled_with()
def _factor(kind: int, speed: float, on: bool, flood: bool, difference: float) -> float:
    if kind == 1:
        return 1.0 + 3.0 * (speed / 12000.0) ** 0.6
    if kind == 2:
        return 1.0 if on else OFF_FLOW
    if kind == 3:
        return 1.0 if flood else 0.0
    if kind == 4:
        return (abs(difference) / 10.0) ** 0.25
    if kind == 5:
        return 1.0 + (speed / 1000.0) ** 0.7
    return 1.0


@compiled_with()
def _sources(
    q: np.ndarray, t: np.ndarray, i: int, acceleration: float, x: Inputs, k: Constants
) -> float:
    """Fill ``q`` with the heat made in each node [W]; return the motor's torque [N m]."""
    n, omega = x.speed[i], x.speed[i] * RPM
    q[:] = 0.0
    q[FRONT] = _bearing_heat(n, t[FRONT], t[ROTOR] - t[HOUSING], k.front, k)
    q[REAR] = _bearing_heat(n, t[REAR], t[ROTOR] - t[HOUSING], k.rear, k)
    windage = k.windage * (n / 12000.0) ** 3
    torque = k.inertia * acceleration
    if n >= 1.0:
        torque += (q[FRONT] + q[REAR] + windage + x.cut_power[i]) / omega
    if n >= 1.0 or x.hold[i]:
        phi = flux(n, k.base_speed)
        current = abs(torque) / k.rated_torque / phi
        if x.hold[i] and n < 1.0:
            current = k.hold
        warm = 1.0 + 0.0039 * (t[WINDING] - 20.0)
        q[WINDING] = k.copper * warm * copper_share(phi, current, k.magnetising)
        q[STATOR] = iron_loss(phi, n / k.base_speed, k.hysteresis, k.eddy) + 0.5 * windage
        q[ROTOR] = k.rotor * current**2 + 0.5 * windage
    q[ROTOR] += k.tool_share * x.cut_power[i]
    if x.power[i]:
        q[BED] = k.bed_heat + (k.feed_heat if x.moving[i] else 0.0)
    if x.coolant[i]:
        q[COOLANT] = k.pump + k.chip_share * x.cut_power[i]
    return torque


@compiled_with()
def chiller_heat(state: Floats, node: int, ambient: float, on: bool, k: Constants) -> float:
    """Switch the chiller, the last of ``state``, by its ``node``; the heat that it takes [W]."""
    setpoint = k.setpoint - 20.0 + ambient if k.follows else k.setpoint
    if not on or state[node] < setpoint - k.hysteresis_band:
        state[-1] = 0.0
    elif state[node] > setpoint + k.hysteresis_band:
        state[-1] = 1.0
    return state[-1] * k.capacity * max(1.0 - k.capacity_slope * (ambient - 20.0), 0.1)


@compiled_with()
def _simulated(
    state: Floats, x: Inputs, k: Constants, ends: np.ndarray, kinds: np.ndarray,
    conductances: np.ndarray, masses: np.ndarray, substeps: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float, float]:  # fmt: skip
    steps, nodes, dt = x.speed.size, masses.size, 1.0 / substeps
    temperatures, torques = np.empty((steps, nodes)), np.empty(steps)
    q, generated, to_air, to_chiller = np.zeros(nodes), 0.0, 0.0, 0.0
    for i in range(steps):
        acceleration = (x.speed[i] - x.speed[max(i - 1, 0)]) * RPM
        for _ in range(substeps):
            torques[i] = _sources(q, state, i, acceleration, x, k)
            generated += q.sum() * dt
            cold = chiller_heat(state, CHILLER, x.ambient[i], x.power[i], k)
            q[CHILLER] -= cold
            to_chiller += cold * dt
            for e in range(kinds.size):
                a, b = ends[e, 0], ends[e, 1]
                other = x.ambient[i] if b == AIR else state[b]
                difference = state[a] - other
                flow = conductances[e] * difference * _factor(
                    kinds[e], x.speed[i], x.power[i], x.coolant[i], difference
                )  # fmt: skip
                q[a] -= flow
                if b == AIR:
                    to_air += flow * dt
                else:
                    q[b] += flow
            for j in range(nodes):
                state[j] += q[j] * dt / masses[j]
        temperatures[i] = state[:nodes]
    return temperatures, torques, state, generated, to_air, to_chiller


def no_load_power(speed: Floats, spindle: SpindleParameters, oil: float) -> Floats:
    """No-load power [W] at each speed [rev/min], oil at ``oil`` [degC] (Palmgren)."""
    nu = viscosity(oil, *viscosity_line(spindle.viscosity_40, spindle.viscosity_100))
    torque = sum(_friction(b, speed, nu) for b in (spindle.front, spindle.rear))
    air = spindle.motor.windage * (speed / 12000) ** 3
    return np.asarray(np.where(speed >= 1, torque * speed * RPM + air, 0.0))


def _friction(bearings: BearingParameters, speed: Floats, nu: float) -> Floats:
    """Torque of a set of bearings in oil of viscosity ``nu`` [mm2/s], in [N m]."""
    b, distinct = bearings, np.unique(speed)
    torque = [
        b.count * friction_torque(n, nu, b.preload, b.mean_diameter, b.f0, b.static_capacity)
        for n in distinct.tolist()
    ]
    return np.asarray(np.interp(speed, distinct, torque))


def available_power(speed: Floats, motor: MotorParameters) -> Floats:
    """Rated power at each speed [rev/min], in [W]: torque is limited below the base speed."""
    shares = np.minimum(np.maximum(speed, SLOWEST) / motor.base_speed, 1.0)
    return np.asarray(motor.rated_power * shares)
