"""Growth of the spindle's nose from the temperatures of the network, and from speed.

Growth is positive where the nose comes nearer to the table: shaft, housing and head grow towards
it, the column lifts all of them, the probe's stand grows against them.  Sources stand in
:mod:`pipeline.shop.growth.parameters`.
"""

import math

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.shop.growth.network import (
    CELLS,
    COLUMN_CELLS,
    HEAD_CELLS,
    STEEL,
    cell_length,
    housing_cells,
)
from pipeline.shop.growth.parameters import Growth

MODULUS, POISSON = 2.1e11, 0.3
"""Of steel [Pa], [1]."""


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
    growth_m: Floats = ring - POISSON * unit * mean_square * located
    return growth_m
