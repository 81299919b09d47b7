"""Heat network of spindle, head and column, its temperatures, and growth of the nose (numba).

Cells along shaft, rotor, stator, housing, head and column; of each bearing inner ring, balls and
outer ring; a jacket through which the chiller's liquid flows.  Friction of the bearings after
Palmgren, losses of the motor without a cut, a two-point chiller.  Explicit Euler; the fastest
nodes, balls and the jacket's liquid, have time constants of about a second.  The heat that leaves
one node enters another, so the balance closes to rounding.  Growth is positive where the nose comes
nearer to the table.  Sources stand in :mod:`pipeline.shop.growth.parameters`.
"""

import math
from dataclasses import astuple, dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import RPM
from pipeline.shop.growth.parameters import Growth
from pipeline.shop.parameters import BearingParameters, ShopParameters
from pipeline.shop.spindle import (
    Bearing,
    Constants,
    chiller_heat,
    constants,
    copper_share,
    flux,
    friction_torque,
    iron_loss,
    viscosity,
)

CELLS, HEAD_CELLS, COLUMN_CELLS, JACKET = 20, 10, 12, 4
"""Cells of the shaft, the head and the column, and of the jacket's flow."""
STEEL, IRON = (45.0, 7850.0, 470.0), (50.0, 7200.0, 500.0)
"""Conductivity [W/m/K], density [kg/m3] and specific heat [J/kg/K]."""
RING_MASS, BALL_HEAT = 0.28, 35.0
"""Mass of a ring [kg], heat capacity of a bearing's balls [J/K], of 80 mm mean diameter."""
BED_AIR, CHILLER_AIR, FLUID = 38.0, 4.0, 350.0
"""Bed to air and chiller to air [W/K]; heat capacity of a cell of the jacket's liquid [J/K]."""

MODULUS, POISSON = 2.1e11, 0.3
"""Young's modulus [Pa] and Poisson's ratio [1] of steel."""


class Path(IntEnum):
    """Dependence of a conductance."""

    CONSTANT = 0
    NATURAL = 1  # grows with the fourth root of the difference
    ROTATING = 2  # a shaft in air, as n^2/3
    AIR_GAP = 3  # shear mixes the gap
    BALLS = 4  # the lubricant carries heat, as n^0.5


@dataclass(kw_only=True)
class Network:
    """Nodes by name with their heat capacities [J/K]; paths between them; the jacket's flow.

    ``edges`` are pairs of nodes with conductance [W/K] and dependence; -1 stands for the air.
    ``flow`` are nodes that the liquid passes one after another, back to the first.
    """

    names: list[str] = field(default_factory=list)
    capacity: list[float] = field(default_factory=list)
    edges: list[tuple[int, int, float, Path]] = field(default_factory=list)
    flow: list[int] = field(default_factory=list)

    def add(self, name: str, capacity: float) -> None:
        """Add a node."""
        self.names.append(name)
        self.capacity.append(capacity)

    def join(self, a: str, b: str, conductance: float, path: Path = Path.CONSTANT) -> None:
        """A path more; ``b`` may be ``air``."""
        other = -1 if b == "air" else self.names.index(b)
        self.edges.append((self.names.index(a), other, conductance, path))

    def exposed(self, name: str, area: float, growth: Growth) -> None:
        """A surface [m2] in air: natural convection and radiation."""
        self.join(name, "air", area * growth.paths.natural, Path.NATURAL)
        self.join(name, "air", area * growth.paths.radiation)


def cell_at(place: float, growth: Growth) -> int:
    """Cell of the shaft, and of the housing around it, ``place`` [m] behind the nose."""
    return min(int(place / growth.body.shaft_length * CELLS), CELLS - 1)


def network(parameters: ShopParameters) -> Network:
    """Heat network of a machine."""
    growth, net = parameters.growth, Network()
    _shaft(net, growth)
    _housing(net, growth)
    _motor(net, parameters)
    _bearings(net, parameters)
    _structure(net, parameters)
    _jacket(net, parameters)
    return net


def _rod(net: Network, name: str, cells: range, section: float, length: float,
         material: tuple[float, float, float]) -> None:  # fmt: skip
    """Cells in a row, each of ``section`` [m2] and ``length`` [m]."""
    conductivity, density, heat = material
    for k in cells:
        net.add(f"{name}_{k:02d}", density * heat * section * length)
        if k > cells.start:
            along = conductivity * section / length
            net.join(f"{name}_{k - 1:02d}", f"{name}_{k:02d}", along)


def cell_length(growth: Growth) -> float:
    """Length of a cell of shaft and housing [m]."""
    return growth.body.shaft_length / CELLS


def housing_cells(growth: Growth) -> range:
    """Cells of the shaft that the housing is around."""
    return range(cell_at(growth.body.front, growth) - 1, cell_at(growth.body.rear, growth) + 2)


def motor_cells(growth: Growth) -> range:
    """Cells of the shaft that carry the rotor."""
    body = growth.body
    return range(cell_at(body.motor_begin, growth), cell_at(body.motor_end, growth) + 1)


def _shaft(net: Network, growth: Growth) -> None:
    body, dx = growth.body, cell_length(growth)
    section = math.pi * (body.shaft_radius**2 - body.bore_radius**2)
    _rod(net, "shaft", range(CELLS), section, dx, STEEL)
    net.capacity[0] += growth.paths.holder
    around, ends = 2 * math.pi * body.shaft_radius * dx, math.pi * body.shaft_radius**2
    for k in set(range(CELLS)) - set(housing_cells(growth)):
        area = around + (2 * ends if k == 0 else ends if k == CELLS - 1 else 0.0)
        net.join(f"shaft_{k:02d}", "air", area * growth.paths.rotating, Path.ROTATING)
        net.join(f"shaft_{k:02d}", "air", area * growth.paths.radiation)


def _housing(net: Network, growth: Growth) -> None:
    body, dx, cells = growth.body, cell_length(growth), housing_cells(growth)
    section = math.pi * (body.housing_radius**2 - (body.housing_radius - body.housing_wall) ** 2)
    _rod(net, "housing", cells, section, dx, STEEL)
    around = 2 * math.pi * body.housing_radius * dx
    for k in cells:
        if k < cell_at(body.flange, growth) or k == cells[-1]:
            face = section if k in (cells[0], cells[-1]) else 0.0
            net.exposed(f"housing_{k:02d}", around + face, growth)


def _motor(net: Network, parameters: ShopParameters) -> None:
    growth = parameters.growth
    body, paths, dx = growth.body, growth.paths, cell_length(growth)
    inner = body.housing_radius - body.housing_wall
    cells = motor_cells(growth)
    rotor = math.pi * (body.rotor_radius**2 - body.shaft_radius**2)
    stator = math.pi * (inner**2 - body.rotor_radius**2) * 0.75  # less slots and gap
    _rod(net, "rotor", cells, rotor, dx, STEEL)
    _rod(net, "stator", cells, stator, dx, STEEL)
    masses = parameters.spindle.masses
    net.add("winding", masses.winding)
    slots = parameters.spindle.paths.winding_stator / len(cells)
    for k in cells:
        shaft_fit = 2 * math.pi * body.shaft_radius * dx * paths.shrink_fit
        gap = 2 * math.pi * body.rotor_radius * dx * paths.air_gap
        net.join(f"shaft_{k:02d}", f"rotor_{k:02d}", shaft_fit)
        net.join(f"rotor_{k:02d}", f"stator_{k:02d}", gap, Path.AIR_GAP)
        fit = 2 * math.pi * inner * dx * paths.stator_fit
        net.join(f"stator_{k:02d}", f"housing_{k:02d}", fit)
        net.join("winding", f"stator_{k:02d}", slots)


def bearing_pieces(parameters: ShopParameters) -> dict[str, tuple[BearingParameters, float]]:
    """Kind and number of bearings at each place; the front set is shared by two places."""
    front, rear = parameters.spindle.front, parameters.spindle.rear
    half = front.count / 2
    return {"front": (front, half), "middle": (front, half), "rear": (rear, float(rear.count))}


def _bearings(net: Network, parameters: ShopParameters) -> None:
    growth = parameters.growth
    paths = growth.paths
    for place, (bearing, pieces) in bearing_pieces(parameters).items():
        size = pieces * (bearing.mean_diameter / 0.08) ** 3
        contact = pieces * bearing.mean_diameter / 0.08
        for part, capacity in (
            ("inner", RING_MASS * STEEL[2]), ("balls", BALL_HEAT), ("outer", RING_MASS * STEEL[2])
        ):  # fmt: skip
            net.add(f"{place}_{part}", capacity * size)
        k = cell_at(getattr(growth.body, place), growth)
        net.join(f"shaft_{k:02d}", f"{place}_inner", paths.ring * contact)
        net.join(f"{place}_inner", f"{place}_balls", paths.ball * contact, Path.BALLS)
        net.join(f"{place}_balls", f"{place}_outer", paths.ball * contact, Path.BALLS)
        net.join(f"{place}_outer", f"housing_{k:02d}", paths.seat * contact)


def _structure(net: Network, parameters: ShopParameters) -> None:
    growth = parameters.growth
    body, paths = growth.body, growth.paths
    dz, dy = body.head_length / HEAD_CELLS, body.column_height / COLUMN_CELLS
    _rod(net, "head", range(HEAD_CELLS), body.head_section, dz, IRON)
    _rod(net, "column", range(COLUMN_CELLS), body.column_section, dy, IRON)
    net.add("bed", parameters.spindle.masses.bed)
    net.join("bed", "air", BED_AIR)
    net.join("column_00", "bed", paths.foot)
    net.join(f"housing_{cell_at(body.flange, growth):02d}", "head_00", paths.flange)
    rear, dx = housing_cells(growth)[-1], cell_length(growth)
    for k in range(cell_at(body.flange, growth) + 1, rear):
        beside = min(int(((k + 0.5) * dx - body.flange) / dz), HEAD_CELLS - 1)
        area = 2 * math.pi * body.housing_radius * dx
        net.join(f"housing_{k:02d}", f"head_{beside:02d}", area * paths.bore)
    carriages = 4
    for k in range(HEAD_CELLS):
        net.exposed(f"head_{k:02d}", body.head_perimeter * dz, growth)
    for k in range(COLUMN_CELLS):
        net.exposed(f"column_{k:02d}", body.column_perimeter * dy, growth)
    for k in range(carriages):
        column, head = COLUMN_CELLS - 1 - k, HEAD_CELLS - carriages + k
        net.join(f"head_{head:02d}", f"column_{column:02d}", paths.carriage / carriages)
    stand = 900.0 * body.stand / 0.2
    net.add("stand", stand)
    net.join("stand", "air", stand / paths.stand_lag)


def _jacket(net: Network, parameters: ShopParameters) -> None:
    """The chiller's liquid comes in at the motor's rear and leaves at the front bearing."""
    growth = parameters.growth
    body, dx = growth.body, cell_length(growth)
    net.add("chiller", parameters.spindle.masses.chiller)
    net.join("chiller", "air", CHILLER_AIR)
    cells = range(cell_at(body.front, growth), motor_cells(growth)[-1] + 1)
    for j in range(JACKET):
        net.add(f"jacket_{j}", FLUID)
    for n, k in enumerate(reversed(cells)):
        area = 2 * math.pi * body.housing_radius * dx
        j = n * JACKET // len(cells)
        net.join(f"housing_{k:02d}", f"jacket_{j}", area * growth.paths.jacket)
    net.flow = [net.names.index(n) for n in ("chiller", *(f"jacket_{j}" for j in range(JACKET)))]


def thermal_growth(growth: Growth) -> dict[str, float]:
    """Growth of the nose for each kelvin of a node, by its name [m/K].

    Shaft before its locating bearings, housing from there to its flange, head, column, stand; and
    inner rings of the locating bearings that widen more than the outer ones.
    """
    body, e, dx = growth.body, growth.expansion, cell_length(growth)
    located = (body.front + body.middle) / 2
    strain = {f"shaft_{k:02d}": e.steel * _overlap(k * dx, dx, 0.0, located) for k in range(CELLS)}
    for k in housing_cells(growth):
        strain[f"housing_{k:02d}"] = e.steel * _overlap(k * dx, dx, located, body.flange)
    for k in range(HEAD_CELLS):
        strain[f"head_{k:02d}"] = e.cast_iron * body.head_length / HEAD_CELLS
    for k in range(COLUMN_CELLS):
        lift = body.column_share * body.column_height / COLUMN_CELLS
        strain[f"column_{k:02d}"] = -e.cast_iron * lift
    strain["stand"] = e.steel * body.stand
    for place in ("front", "middle"):
        shift = e.steel * e.ring_radius * ring_lever(growth) / 2
        strain[f"{place}_inner"], strain[f"{place}_outer"] = shift, -shift
    return {name: per_kelvin for name, per_kelvin in strain.items() if per_kelvin}


def _overlap(begin: float, length: float, first: float, last: float) -> float:
    return max(min(begin + length, last) - max(begin, first), 0.0)


def ring_lever(growth: Growth) -> float:
    """Axial shift of the shaft for each unit by which the inner rings grow radially [1]."""
    e = growth.expansion
    return e.ring_share / math.tan(math.radians(e.contact_angle))


def speed_growth(speed: Floats, growth: Growth) -> Floats:
    """Growth by centrifugal force at each speed [rev/min], in [m].

    Inner rings widen by rho w^2 r^3 / E and shift the shaft; the shaft before them gets shorter by
    nu rho w^2 <r^2> / E, with the mean of r^2 over its section (from the virial theorem).
    """
    body, density = growth.body, STEEL[1]
    unit = density * (np.asarray(speed) * RPM) ** 2 / MODULUS
    ring = unit * growth.expansion.ring_radius**3 * ring_lever(growth)
    located = (body.front + body.middle) / 2
    mean_square = (body.shaft_radius**2 + body.bore_radius**2) / 2
    return ring - POISSON * unit * mean_square * located


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


class _Bearings(NamedTuple):
    """Nodes of the bearings at one place, their number and their kind."""

    inner: int
    balls: int
    outer: int
    pieces: float
    kind: Bearing


class _Constants(NamedTuple):
    spindle: Constants
    front: _Bearings
    middle: _Bearings
    rear: _Bearings
    centrifugal: float
    mixing: float
    flow: float
    winding: int
    rotor_first: int
    stator_first: int
    motor_cells: int
    bed: int
    chiller: int


def _constants(parameters: ShopParameters, net: Network) -> _Constants:
    at, growth = net.names.index, parameters.growth
    first = motor_cells(growth)[0]
    places = {
        place: _Bearings(
            inner=at(f"{place}_inner"), balls=at(f"{place}_balls"), outer=at(f"{place}_outer"),
            pieces=pieces, kind=Bearing(*astuple(kind)),
        )
        for place, (kind, pieces) in bearing_pieces(parameters).items()
    }  # fmt: skip
    return _Constants(
        spindle=constants(parameters.spindle), **places,
        centrifugal=growth.paths.centrifugal_load, mixing=growth.paths.mixing,
        flow=growth.paths.flow, winding=at("winding"), rotor_first=at(f"rotor_{first:02d}"),
        stator_first=at(f"stator_{first:02d}"), motor_cells=len(motor_cells(growth)),
        bed=at("bed"), chiller=at("chiller"),
    )  # fmt: skip


class Heated(NamedTuple):
    """Temperatures each KEPT seconds, from the start on (K, N) [degC]; last state; heats [J]."""

    temperatures: Floats
    state: Floats  # last temperatures, then whether the chiller runs
    generated: float
    to_air: float
    to_chiller: float


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
def _friction(q: Floats, t: Floats, n: float, b: _Bearings, k: _Constants) -> float:
    """Give a bearing's friction heat to its parts; return it [W]."""
    kind = b.kind
    tight = kind.growth * (t[b.inner] - t[b.outer]) + k.centrifugal * (n / REFERENCE) ** 2
    load = kind.preload * max(1.0 + tight, 0.2)
    nu = viscosity(t[b.balls], k.spindle.slope, k.spindle.intercept)
    torque = friction_torque(n, nu, load, kind.d_m, kind.f0, kind.capacity)
    heat = b.pieces * torque * n * RPM
    q[b.balls] += 0.5 * heat
    q[b.inner] += 0.25 * heat
    q[b.outer] += 0.25 * heat
    return float(heat)


@compiled_with()
def _sources(q: Floats, t: Floats, n: float, on: bool, k: _Constants) -> None:
    """Fill ``q`` with the heat made in each node [W]."""
    q[:] = 0.0
    s = k.spindle
    if on:
        q[k.bed] += s.bed_heat
    if n < 1.0:
        return
    made = 0.0
    made += _friction(q, t, n, k.front, k)
    made += _friction(q, t, n, k.middle, k)
    made += _friction(q, t, n, k.rear, k)
    windage = s.windage * (n / REFERENCE) ** 3
    phi = flux(n, s.base_speed)
    current = (made + windage) / (n * RPM) / s.rated_torque / phi
    warm = 1.0 + 0.0039 * (t[k.winding] - 20.0)
    q[k.winding] += s.copper * warm * copper_share(phi, current, s.magnetising)
    iron = iron_loss(phi, n / s.base_speed, s.hysteresis, s.eddy) + 0.5 * windage
    slip = s.rotor * current**2 + 0.5 * windage
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
            cold = chiller_heat(state, k.chiller, air, on, k.spindle)
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
