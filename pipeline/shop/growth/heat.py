"""Temperatures of the network over a course of speed and air (numba).

Friction of the bearings after Palmgren, losses of the motor without a cut, a two-point chiller.
Explicit Euler; the fastest nodes, balls and the jacket's liquid, have time constants of about a
second.  The heat that leaves one node enters another, so the balance closes to rounding.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import RPM
from pipeline.shop.growth.network import Network, Path, bearing_pieces, motor_cells
from pipeline.shop.parameters import BearingParameters, ShopParameters
from pipeline.shop.spindle import (
    copper_share,
    flux,
    friction_torque,
    iron_loss,
    viscosity,
    viscosity_line,
)

SUBSTEPS = 3
"""Euler steps in a second."""
KEPT = 10
"""Time between the kept temperatures [s]."""
REFERENCE = 12000.0
"""Speed at which what depends on speed has its nominal value [rev/min]."""
NATURAL = int(Path.NATURAL)
"""Path kind as an integer, for compiled functions."""


class Course(NamedTuple):
    """Speed [rev/min], air [degC] and whether the machine is on, at each second; (T,) each."""

    speed: Floats
    air: Floats
    power: Bools


class _Bearing(NamedTuple):
    inner: int
    balls: int
    outer: int
    pieces: float
    d_m: float
    f0: float
    preload: float
    capacity: float
    growth: float


class _Constants(NamedTuple):
    front: _Bearing
    middle: _Bearing
    rear: _Bearing
    slope: float
    intercept: float
    centrifugal: float
    mixing: float
    rated_torque: float
    base_speed: float
    copper: float
    rotor: float
    hysteresis: float
    eddy: float
    magnetising: float
    windage: float
    bed_heat: float
    setpoint: float
    follows: bool
    band: float
    cold: float
    cold_slope: float
    flow: float
    winding: int
    rotor_first: int
    stator_first: int
    motor_cells: int
    bed: int
    chiller: int


def _bearing(net: Network, place: str, b: BearingParameters, pieces: float) -> _Bearing:
    inner, balls, outer = (
        net.names.index(f"{place}_{part}") for part in ("inner", "balls", "outer")
    )
    return _Bearing(
        inner=inner, balls=balls, outer=outer, pieces=pieces, d_m=b.mean_diameter, f0=b.f0,
        preload=b.preload, capacity=b.static_capacity, growth=b.thermal_preload,
    )  # fmt: skip


def _constants(parameters: ShopParameters, net: Network) -> _Constants:
    p, at = parameters.spindle, net.names.index
    slope, intercept = viscosity_line(p.viscosity_40, p.viscosity_100)
    m, c, sets = p.motor, p.chiller, bearing_pieces(parameters)
    first = motor_cells(parameters.growth)[0]
    return _Constants(
        front=_bearing(net, "front", *sets["front"]), rear=_bearing(net, "rear", *sets["rear"]),
        middle=_bearing(net, "middle", *sets["middle"]), slope=slope, intercept=intercept,
        centrifugal=parameters.growth.paths.centrifugal_load, mixing=parameters.growth.paths.mixing,
        rated_torque=m.rated_power / (m.base_speed * RPM), base_speed=m.base_speed,
        copper=m.copper_loss, rotor=m.rotor_loss, hysteresis=m.hysteresis_loss, eddy=m.eddy_loss,
        magnetising=m.magnetising_share, windage=m.windage, bed_heat=p.bed_heat,
        setpoint=c.setpoint, follows=c.follows_ambient, band=c.hysteresis, cold=c.capacity,
        cold_slope=c.capacity_slope, flow=parameters.growth.paths.flow, winding=at("winding"),
        rotor_first=at(f"rotor_{first:02d}"), stator_first=at(f"stator_{first:02d}"),
        motor_cells=len(motor_cells(parameters.growth)), bed=at("bed"), chiller=at("chiller"),
    )  # fmt: skip


class Heated(NamedTuple):
    """Temperatures each KEPT seconds, from the start on (K, N) [degC]; last state; heats [J]."""

    temperatures: Floats
    state: Floats  # last temperatures, then whether the chiller runs
    generated: float
    to_air: float
    to_chiller: float


def at_rest(net: Network, temperature: float) -> Floats:
    """State of a machine that has one temperature [degC]; the chiller is off."""
    return np.append(np.full(len(net.names), temperature), 0.0)


def heated(
    net: Network, state: Floats, course: Course, parameters: ShopParameters,
    substeps: int = SUBSTEPS,
) -> Heated:  # fmt: skip
    """Temperatures of all nodes over a course of speed and air, from ``state`` (N + 1,) on."""
    ends = np.array([(a, b) for a, b, _, _ in net.edges])
    conductances = np.array([g for _, _, g, _ in net.edges])
    kinds = np.array([int(kind) for *_, kind in net.edges])
    return Heated(*_integrated(
        state.copy(), course, _constants(parameters, net), ends, kinds, conductances,
        np.array(net.capacity), np.array(net.flow), substeps,
    ))  # fmt: skip


@compiled_with()
def _friction(q: Floats, t: Floats, n: float, b: _Bearing, k: _Constants) -> float:
    """Give a bearing's friction heat to its parts; return it [W]."""
    tight = b.growth * (t[b.inner] - t[b.outer]) + k.centrifugal * (n / REFERENCE) ** 2
    load = b.preload * max(1.0 + tight, 0.2)
    nu = viscosity(t[b.balls], k.slope, k.intercept)
    heat = b.pieces * friction_torque(n, nu, load, b.d_m, b.f0, b.capacity) * n * RPM
    q[b.balls] += 0.5 * heat
    q[b.inner] += 0.25 * heat
    q[b.outer] += 0.25 * heat
    return float(heat)


@compiled_with()
def _sources(q: Floats, t: Floats, n: float, on: bool, k: _Constants) -> None:
    """Fill ``q`` with the heat made in each node [W]."""
    q[:] = 0.0
    if on:
        q[k.bed] += k.bed_heat
    if n < 1.0:
        return
    made = 0.0
    made += _friction(q, t, n, k.front, k)
    made += _friction(q, t, n, k.middle, k)
    made += _friction(q, t, n, k.rear, k)
    windage = k.windage * (n / REFERENCE) ** 3
    phi = flux(n, k.base_speed)
    current = (made + windage) / (n * RPM) / k.rated_torque / phi
    warm = 1.0 + 0.0039 * (t[k.winding] - 20.0)
    q[k.winding] += k.copper * warm * copper_share(phi, current, k.magnetising)
    iron = iron_loss(phi, n / k.base_speed, k.hysteresis, k.eddy) + 0.5 * windage
    slip = k.rotor * current**2 + 0.5 * windage
    for j in range(k.motor_cells):
        q[k.stator_first + j] += iron / k.motor_cells
        q[k.rotor_first + j] += slip / k.motor_cells


@compiled_with()
def _conducting(
    g: Floats, state: Floats, n: float, air: float, nominal: Floats, kinds: Ints, ends: Ints,
    mixing: float,
) -> None:  # fmt: skip
    """Fill ``g`` with the conductance of each path [W/K] at speed ``n`` [rev/min]."""
    ratio = n / REFERENCE
    by_kind = (
        1.0, 1.0, ratio ** (2.0 / 3.0), 1.0 + 3.0 * ratio**0.6, 1.0 + mixing * math.sqrt(ratio)
    )  # fmt: skip
    for e in range(kinds.size):
        g[e] = nominal[e] * by_kind[kinds[e]]
        if kinds[e] == NATURAL:
            b = ends[e, 1]
            difference = state[ends[e, 0]] - (air if b < 0 else state[b])
            g[e] *= math.sqrt(math.sqrt(abs(difference) / 10.0))


@compiled_with()
def _cold(state: Floats, air: float, on: bool, k: _Constants) -> float:
    """Switch the chiller with its hysteresis; return the heat that it takes away [W]."""
    setpoint = k.setpoint - 20.0 + air if k.follows else k.setpoint
    if not on or state[k.chiller] < setpoint - k.band:
        state[-1] = 0.0
    elif state[k.chiller] > setpoint + k.band:
        state[-1] = 1.0
    return state[-1] * k.cold * max(1.0 - k.cold_slope * (air - 20.0), 0.1)


@compiled_with()
def _integrated(
    state: Floats, x: Course, k: _Constants, ends: Ints, kinds: Ints, conductances: Floats,
    capacity: Floats, flow: Ints, substeps: int,
) -> tuple[Floats, Floats, float, float, float]:  # fmt: skip
    nodes, seconds, dt = capacity.size, x.speed.size, 1.0 / substeps
    kept = np.empty((seconds // KEPT + 1, nodes))
    kept[0] = state[:nodes]
    q, generated, to_air, to_chiller = np.zeros(nodes), 0.0, 0.0, 0.0
    g = np.empty(kinds.size)
    for i in range(seconds):
        n, air, on = x.speed[i], x.air[i], x.power[i]
        _conducting(g, state, n, air, conductances, kinds, ends, k.mixing)
        for _ in range(substeps):
            _sources(q, state, n, on, k)
            generated += q.sum() * dt
            cold = _cold(state, air, on, k)
            q[k.chiller] -= cold
            to_chiller += cold * dt
            for e in range(kinds.size):
                a, b = ends[e, 0], ends[e, 1]
                difference = state[a] - (air if b < 0 else state[b])
                moved = g[e] * difference
                q[a] -= moved
                if b < 0:
                    to_air += moved * dt
                else:
                    q[b] += moved
            if on:
                for j in range(flow.size):
                    a, b = flow[j - 1], flow[j]
                    q[b] += k.flow * (state[a] - state[b])
            for j in range(nodes):
                state[j] += q[j] * dt / capacity[j]
        if (i + 1) % KEPT == 0:
            kept[(i + 1) // KEPT] = state[:nodes]
    return kept, state, generated, to_air, to_chiller
