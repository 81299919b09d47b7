"""Spindle temperature from speed and load: a thermal network of one or two nodes.

One node is the measured winding (or housing) itself,

    dT/dt = sum_i a_i h_i(t) - (T - T_amb) / (R C),        a_i = k_i / C,

with the heat sources ``h``: bearing friction n^(5/3), load times speed, copper loss tau^2,
windage n^2, and the magnetising current of a motor that holds its position at standstill
(``spindle_position_control``).  Two nodes add a body (housing, cartridge) that exchanges heat with
the first and loses its own to the ambient; the heat of the bearings goes into the one or the other.
Of a winding that is nearly massless beside a body that hardly warms, only the exchange is left (a
fixed body: capacity ratio 0).  Where the coolant's temperature is recorded it is a
further sink (or source: it carries the heat of chips, pump and tank), of the body where there is
one, else of the measured node: - (T - T_coolant) / (R_c C).  Only k_i/C and
1/(RC) can be had from temperatures, so only these are parameters.

Bearing law: Palmgren's viscous torque M0 ~ (nu n)^(2/3), hence power ~ n^(5/3) at constant
viscosity (Harris, Kotzalas: Essential Concepts of Bearing Technology, 5th ed., ch. 10).  The step
is exact for sources that are constant over it.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Finite, NotNegative, Range, Ranged

_Rate = Annotated[float, Range(least=0.0, unit="1/s")]

SOURCES: dict[str, str] = {
    "bearing_friction": "K/s/(rad/s)^(5/3)",
    "load_speed": "K/s/(rad/s)",
    "copper": "K/s",
    "windage": "K/s/(rad/s)^2",
    "position_hold": "K/s",
}
"""Heat sources and the unit of their coefficients k_i / C; the load tau is a share of rating."""


@dataclass(frozen=True, kw_only=True)
class SpindleThermalParameters(Ranged):
    """Thermal network of a spindle; rates and coefficients are non-negative.

    A fixed body has no sink of its own.
    """

    heating: dict[str, float] = field(default_factory=dict)
    """Coefficient a_i = k_i / C of each source in :data:`SOURCES`; absent ones are zero."""
    cooling_rate: _Rate
    """1 / (R C) of the measured node to the ambient (one node) [1/s]."""
    ambient: Finite = 20.0
    """Ambient temperature when none is measured [degC]."""
    ambient_offset: Finite = 0.0
    """Excess of the spindle's own surround (oil, headstock) over a measured ambient [K]."""
    coupling_rate: _Rate = 0.0
    """Heat exchange of the measured node with the body, over its C [1/s]; 0 for one node."""
    capacity_ratio: NotNegative = 0.0
    """C of the measured node over C of the body [1]; 0 for a body that stays as warm as it was."""
    body_cooling_rate: _Rate = 0.0
    """1 / (R C) of the body to the ambient [1/s]."""
    coolant_rate: _Rate = 0.0
    """1 / (R C) of the body, or of the only node, to the coolant [1/s]; 0 without one."""
    friction_in_body: bool = False
    """Whether the bearings' friction heats the body; its coefficient is then over the body's C."""

    def __post_init__(self) -> None:
        unknown = set(self.heating) - set(SOURCES)
        if unknown:
            raise ValueError(f"heating names {sorted(unknown)}, known sources are {list(SOURCES)}")
        super().__post_init__()
        for name, value in self.heating.items():
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(
                    f"heating[{name}] = {value} {SOURCES[name]} must be finite and at least 0"
                )
        if self.fixed_body and self.body_cooling_rate + self.coolant_rate > 0:
            raise ValueError(
                "capacity_ratio = 0 with body_cooling_rate or coolant_rate above 0: a body that "
                "never warms has no sink; give a positive capacity_ratio, or set both rates to 0"
            )

    @property
    def nodes(self) -> int:
        """Number of nodes, 1 or 2."""
        return 2 if self.coupling_rate > 0 else 1

    @property
    def fixed_body(self) -> bool:
        """Whether the second node is a body that stays as warm as it was at the beginning."""
        return self.nodes == 2 and self.capacity_ratio == 0

    @property
    def rates(self) -> Floats:
        """State matrix of the network, shape (nodes, nodes) [1/s]."""
        if self.nodes == 1:
            return np.array([[-self.cooling_rate - self.coolant_rate]])
        k, r = self.coupling_rate, self.coupling_rate * self.capacity_ratio
        body = self.body_cooling_rate + self.coolant_rate
        return np.array([[-k - self.cooling_rate, k], [r, -r - body]])


def heat_sources(speed: ArrayLike, load: ArrayLike, hold: ArrayLike) -> Floats:
    """Heat sources h_i, shape (..., len(SOURCES)).

    Parameters
    ----------
    speed : array_like, shape (...)
        Spindle speed of either sign [rad/s].
    load : array_like, shape (...)
        Load over rated load [1].
    hold : array_like, shape (...)
        1 while the position loop holds the spindle, else 0.

    Examples
    --------
    >>> heat_sources(100.0, 0.5, 0.0).round(2).tolist()
    [2154.43, 50.0, 0.25, 10000.0, 0.0]
    """
    n, tau = np.abs(np.asarray(speed, float)), np.abs(np.asarray(load, float))
    return np.stack(
        np.broadcast_arrays(n ** (5 / 3), tau * n, tau**2, n**2, np.asarray(hold, float)), axis=-1
    )


def first_order(rate: float, source: Floats, start: float, dt: float) -> Floats:
    """Response of dz/dt = rate z + source, shape (T,), exact for a source held over each step.

    The value at a sample is the one at the beginning of its step.
    """
    from pipeline.thermal.recursion import follow

    decay, gain = _over_step(np.array([rate]), dt)
    response = np.full((len(source), 1), start, dtype=float)
    follow(np.repeat(decay, len(source) - 1), (gain * source)[:-1, None], response)
    return response[:, 0]


def _over_step(rates: Floats, dt: float) -> tuple[Floats, Floats]:
    """Decay of each mode over a step [1], and its gain from what drives it [s]."""
    still = np.where(rates == 0, 1.0, rates)
    return np.exp(rates * dt), np.where(rates == 0, dt, np.expm1(still * dt) / still)


def _modes(parameters: SpindleThermalParameters) -> tuple[Floats, Floats, Floats]:
    """Eigenvalues [1/s] of a network of two nodes, its modes and their inverse.

    Scaled by the root of the capacities the state matrix is symmetric, so that the modes are real
    and orthogonal however different the two nodes are.
    """
    scale = np.array([1.0, np.sqrt(parameters.capacity_ratio)])
    eigenvalues, vectors = np.linalg.eigh(parameters.rates / np.outer(scale, 1 / scale))
    return eigenvalues, scale[:, None] * vectors, vectors.T / scale


def slow_share(parameters: SpindleThermalParameters) -> float:
    """Error of the body over that of the measured node, in the slow mode [1].

    The error of a free run that is older than the fast mode stands in the slow one.
    """
    if parameters.fixed_body:
        return 1.0
    eigenvalues, vectors, _ = _modes(parameters)
    slow = vectors[:, int(np.argmax(eigenvalues))]
    return float(slow[1] / slow[0])


def temperatures(
    sources: Floats,
    start: ArrayLike,
    parameters: SpindleThermalParameters,
    dt: float,
    *,
    ambient: ArrayLike | None = None,
    coolant: ArrayLike | None = None,
    body_start: ArrayLike | None = None,
) -> Floats:
    """Node temperatures [degC], shape (nodes, ..., T).

    ValueError when the coolant's temperature is needed and missing.

    Parameters
    ----------
    sources : ndarray, shape (..., T, len(SOURCES))
        Heat sources of :func:`heat_sources`, held over each step.
    start : array_like, shape (...)
        Measured temperature at the first sample [degC].
    parameters : SpindleThermalParameters
        The network.
    dt : float
        Step [s].
    ambient : array_like, shape (..., T), optional
        Measured ambient [degC], to which ``parameters.ambient_offset`` is added;
        ``parameters.ambient`` when there is none.
    coolant : array_like, shape (..., T), optional
        Temperature of the coolant [degC]; needed where ``parameters.coolant_rate`` is not 0.
    body_start : array_like, shape (...), optional
        The body's temperature at the first sample; the quasi-steady one for ``start`` by default.

    Examples
    --------
    Without heat a spindle 10 K above the ambient has 10/e K left after one time constant:

    >>> p = SpindleThermalParameters(cooling_rate=1 / 600, ambient=20.0)
    >>> temperatures(np.zeros((61, len(SOURCES))), 30.0, p, 10.0)[0, -1].round(3).item()
    23.679
    """
    if coolant is None and parameters.coolant_rate > 0:
        raise ValueError(
            f"coolant_rate = {parameters.coolant_rate:g} 1/s needs the coolant's temperature: "
            "record coolant_temperature, or take a network without that sink"
        )
    from pipeline.thermal.recursion import run_modes

    sources, heating = np.require(sources, float, ["C", "W"]), _heating(parameters)
    shape = sources.shape[:-1]
    surround: ArrayLike = parameters.ambient
    if ambient is not None:
        surround = np.asarray(ambient, float) + parameters.ambient_offset
    sink = None if coolant is None else np.asarray(coolant, float)
    given = np.empty((2, *shape))
    given[0] = parameters.cooling_rate * np.asarray(surround)
    given[1] = parameters.body_cooling_rate * np.asarray(surround)
    if sink is not None:
        given[parameters.nodes - 1] += parameters.coolant_rate * sink
    start = np.asarray(start, float)
    rates, vectors, inverse = np.zeros(2), np.eye(2), np.eye(2)
    if parameters.nodes == 2:
        if body_start is None:
            first = np.broadcast_to(surround, shape)[..., 0]
            cold = None if sink is None else sink[..., 0]
            body_start = quasi_steady_body(start, first, parameters, cold)
        if not parameters.fixed_body:
            rates, vectors, inverse = _modes(parameters)
        else:  # a body that stays as it is drives the node as a surround
            given[0] += parameters.coupling_rate * np.asarray(body_start, float)[..., None]
    if parameters.nodes == 1 or parameters.fixed_body:
        rates[0] = parameters.rates[0, 0]
        given[1], heating[1] = 0.0, 0.0
    nodes = np.empty((2, *shape))
    starts = np.empty((*shape[:-1], 2))
    starts[..., 0], starts[..., 1] = start, start if body_start is None else body_start
    rows = (math.prod(shape[:-1]), shape[-1])
    run_modes(
        sources.reshape(*rows, len(SOURCES)), heating, given.reshape(2, *rows),
        np.ascontiguousarray(inverse), np.ascontiguousarray(vectors), *_over_step(rates, dt),
        starts.reshape(-1, 2), nodes.reshape(2, *rows),
    )  # fmt: skip
    return nodes[: parameters.nodes]


def _heating(parameters: SpindleThermalParameters) -> Floats:
    """Heating of the measured node and of the body by each source [K/s], (2, len(SOURCES))."""
    found = np.zeros((2, len(SOURCES)))
    for place, name in enumerate(SOURCES):
        bearings = name == "bearing_friction" and parameters.nodes == 2
        body = parameters.friction_in_body and bearings
        found[int(body), place] = parameters.heating.get(name, 0.0)
    return found


def quasi_steady_body(
    start: ArrayLike,
    ambient: ArrayLike,
    parameters: SpindleThermalParameters,
    coolant: ArrayLike | None = None,
) -> Floats:
    """Body temperature in balance with a measured node that stayed at ``start`` [degC]."""
    r = parameters.coupling_rate * parameters.capacity_ratio
    loss, chill = parameters.body_cooling_rate, parameters.coolant_rate
    if r + loss + chill == 0:
        return np.asarray(start, float)
    drawn = r * np.asarray(start, float) + loss * np.asarray(ambient, float)
    if coolant is not None:
        drawn = drawn + chill * np.asarray(coolant, float)
    return drawn / (r + loss + chill)
