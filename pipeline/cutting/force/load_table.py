"""Loads of all blocks of a program as functions of the feed per tooth.

Where the tool is in the material does not depend on F and S, so that the loads of a block depend on
f_z = F / (N n) alone.  They are tabulated once; other F and S cost a look-up.

Nodes are at 0, 1, 4, 9, ... parts of u = f_z^(1 - m_c).  Without runout forces are affine in u, so
that peaks, means and RMS values (norms of them) are convex: the chord between two nodes lies above,
never below; with the default nodes by less than 0.6 % for feeds from a twentieth of the greatest.
With runout loads rise by jumps where a tooth begins to cut, and chords err with either sign: over
runouts of 5 to 60 um and feeds up to 0.1 mm by 0.2 to 3 % in RMS, and next to a jump peaks across
the axis by -11 to +9 % and the other loads by up to 31 % (40 um: -5 to +9 % and up to 28 %).  Above
the last node loads go on as fast as the cutting part alone rises, which is an upper bound without
runout.  At f_z = 0 and below nothing is cut.

Teeth stand at angles 1.25 degrees apart, closer in arcs below 60 degrees.  A peak between them is
missed by 0.2 % as a rule and by 3 % at most.  The bins of an engagement are 5 degrees wide and hold
the mean height at their edges: where teeth without helix are in the material together for less
than about 7 degrees, as of some face mills, that moment is smeared, and peaks are up to a third too
low; means are not.

Drills.  The chisel edge, the ridge between the lips with a strongly negative rake, is across the
axis, so its chip is f_z thick whatever the point angle.  It is 0.18 D long for a standard point
(Shaw and Oxford 1957, Trans. ASME 79; webs of 0.12 to 0.2 D, thinned ones less).  With plane flanks
its rake is tan(gamma) = -tan(p / 2) sin(psi), p being the point angle and psi that between chisel
edge and lips.  The specific force rises by 1 % with each degree of negative rake (tool makers'
k_c = k_c1.1 h^-m_c (1 - gamma / 100)).  On a rake that steep metal stands before the edge; thrust
is assumed to equal the cutting force there.  Published shares of the chisel edge in the thrust are
40 to 70 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.engagement.end_rings import whole_ring
from pipeline.cutting.engagement.engagement import Engagement
from pipeline.cutting.force.edge import (
    LIP,
    bin_middles,
    edge_shape,
    piece_buffer,
    radius_differences,
)
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.profile_kernel import (
    AXIAL,
    COLUMNS,
    FINEST,
    FORCE,
    look_up,
    station_loads,
)
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.si import DEGREE

CHISEL_LENGTH = 0.18
"""Length of the chisel edge over the diameter [1]."""
CHISEL_ANGLE = 55.0 * DEGREE
"""Acute angle between the chisel edge and the lips, seen along the axis [rad]."""
POINTED = ("", "spot_drill", "centre_drill")
"""Roles of drills that have a chisel edge; a tap or a countersink has none."""


def chisel_length(tool: Tool) -> float:
    """Length of the chisel edge [m]; 0 for tools without one."""
    return CHISEL_LENGTH * tool.diameter if tool.kind == "drill" and tool.role in POINTED else 0.0


def chisel_rake(tool: Tool) -> float:
    """Rake angle at the chisel edge [deg], negative.

    Examples
    --------
    >>> round(chisel_rake(Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0)), 1)
    -53.7
    """
    half = min(tool.point_angle / 2, 89 * DEGREE)
    return -float(np.degrees(np.arctan(np.tan(half) * np.sin(CHISEL_ANGLE))))


def chisel_thrust(tool: Tool, law: ForceLaw) -> float:
    """Thrust that the chisel edge adds to that of lips up to the axis, over f_z^(1 - m_c).

    All teeth together, in full material; the lips' own part below the chisel edge is taken off.
    """
    half = chisel_length(tool) / 2
    power = 1.0 - law.m_c
    tangential, radial = float(law.cutting[0]), float(law.cutting[1])
    steeper = 1.0 - chisel_rake(tool) / 100
    lips = radial * np.sin(tool.point_angle / 2) ** power
    return float(tool.flutes * half * (steeper * tangential - lips))


def chisel_engaged(tool: Tool, lower: Floats, upper: Floats) -> Floats:
    """Share of a drill's chisel edge in material [1]; shape (S,).

    ``lower`` and ``upper`` (S, F) are the heights on the tool between which there is material, by
    angle [m].
    """
    half = chisel_length(tool) / 2
    height = max(half / np.tan(tool.point_angle / 2), 1e-9)
    inside = (np.minimum(upper, height) - lower) / height
    return np.asarray(np.clip(inside, 0.0, 1.0).mean(axis=1))


MEAN, RMS, TORQUE = 1, 2, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockLoads:
    """Loads while blocks cut; 0 in air.

    Over a block, peaks are the greatest of its stations and means are weighted by the length that
    each stands for, as its time is at one feed; the part of a block in air does not count.
    """

    peak: Floats
    mean: Floats
    rms: Floats
    """RMS load across the tool's axis, sqrt(F_x^2 + F_y^2), over a turn [N]; shape (..., B)."""
    axial: Floats
    """Peak of |F_z| [N]; shape (..., B)."""
    torque: Floats
    peak_torque: Floats
    """Mean and peak of the torque that the cut takes [N m]; shape (..., B)."""


def block_loads(values: Floats, block: NDArray[np.int32], length: Floats, blocks: int) -> Floats:
    """Loads of blocks, shape (6, B, K), from those of their stations; 0 without a station.

    ``values`` (N, K, 6) are in the order of :class:`BlockLoads`, ``block`` (N,) is each station's
    block, ``length`` (N,) the length in the material that it stands for [m].
    """
    out = np.zeros((6, blocks, values.shape[1]))
    if not len(block):
        return out
    order = np.argsort(block, kind="stable")
    at = block[order]
    first = np.flatnonzero(np.diff(at, prepend=-1))
    whole = np.bincount(block, weights=length, minlength=blocks)[at]
    share = np.divide(length[order], whole, out=np.zeros(len(at)), where=whole > 0)[:, None]
    for quantity in range(6):
        one, to = values[order, :, quantity], out[quantity]
        if quantity in (MEAN, TORQUE):
            to[at[first]] = np.add.reduceat(share * one, first)
        elif quantity == RMS:
            to[at[first]] = np.sqrt(np.add.reduceat(share * one**2, first))
        else:
            to[at[first]] = np.maximum.reduceat(one, first)
    return out


NODES = 16
ANGLES = 288
CORNER = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadTable:
    """Loads over the feed for each tooth."""

    values: Floats
    """Peak, mean, RMS, axial, torque and peak torque of each block at K nodes, and their
    extrapolation beyond; shape (6, B, K + 1)."""
    station_values: Floats
    """The same of the different stations; shape (6, U, K + 1)."""
    station_force: Floats
    """Mean force of the different stations over a turn, on the tool along the feed and to the left
    of it, and on the workpiece along the axis (:mod:`pipeline.cutting.force.waveform`); then the
    standard deviation of each; shape (6, U, K + 1)."""
    station: Rows
    """Distinct station of each station of the engagement; shape (N,)."""
    block: NDArray[np.int32]
    """Block of each station; shape (N,)."""
    scale: Floats
    exponent: Floats
    """u is scale f_z^exponent, so that nodes are at squares; shape (B,)."""
    length: Floats
    """Length in the material of each block [m]; shape (B,)."""

    def loads(self, f_z: ArrayLike) -> BlockLoads:
        """Loads at feeds for each tooth [m] of shape (B,) or (P, B); arrays have the same shape.

        ValueError when there is not one feed for each block.
        """
        return _loads(self._feeds(f_z), self.values, self.scale, self.exponent)

    def peaks(self, f_z: ArrayLike, out: Floats | None = None) -> Floats:
        """Peak load across the axis alone [N]; shape of ``f_z``, written to ``out`` if given."""
        feeds = self._feeds(f_z)
        result = np.empty(feeds.shape) if out is None else out
        if result.shape != feeds.shape:
            raise ValueError(f"load table: out has shape {result.shape}, f_z has {feeds.shape}")
        _look_up(feeds, self.values[0], self.scale, self.exponent, result)
        return result

    def station_loads(self, f_z: ArrayLike) -> BlockLoads:
        """Loads of each station at the feeds of its block [m], of shape (B,); arrays are (N,)."""
        feeds = self._feeds(f_z)
        if feeds.ndim != 1:
            raise ValueError(f"load table: f_z has shape {feeds.shape}: give one row of feeds")
        block = self.block
        values = self.station_values[:, self.station]
        return _loads(feeds[block], values, self.scale[block], self.exponent[block])

    def mean_forces(self, station: Rows, f_z: Floats) -> Floats:
        """Mean force over a turn at places of some stations, and the standard deviation of each
        component [N]; shape (Q, 6), frame of the cut.

        ``f_z`` [m] is the feed per tooth at each of Q places.
        """
        block, unique = self.block[station], self.station[station]
        u = self.scale[block] * np.maximum(f_z, 0.0) ** self.exponent[block]
        node = np.minimum(np.sqrt(u), self.station_force.shape[2] - 2).astype(np.intp)
        share = (u - node**2) / (2 * node + 1)
        low, high = (self.station_force[:, unique, node + step] for step in (0, 1))
        return np.where(f_z > 0, low + share * (high - low), 0.0).T

    def _feeds(self, f_z: ArrayLike) -> Floats:
        feeds = np.ascontiguousarray(f_z, dtype=np.float64)
        if feeds.ndim not in (1, 2) or feeds.shape[-1] != len(self.scale):
            raise ValueError(
                f"load table: f_z has shape {feeds.shape}: give one feed for each of the "
                f"{len(self.scale)} blocks"
            )
        return feeds


def load_table(
    engagement: Engagement, tools: Sequence[Tool], force_laws: Sequence[ForceLaw],
    f_z_max: ArrayLike, *, nodes: int = NODES,
) -> LoadTable:  # fmt: skip
    """Tabulate the loads of all blocks.

    The bottom of a flat end cuts where the motion goes down, as edges from the axis to the rim; a
    drill cuts with its lips and its chisel edge.  In full material both take a mean torque of N
    K_tc f_z D^2 / 8 and lips a thrust of N K_rc f_z D / 2 sin(point_angle / 2), 1 for a flat end,
    and edge terms for each length of lip; the chisel edge adds its own.  In a hole of diameter d
    the flat of an end cuts with what is outside of it: N K_tc f_z (D^2 - d^2) / 8.  Loads
    without a model, of thread mills, are 0.

    ``f_z_max`` is the greatest feed per tooth that will be looked up [m], one for all tools or one
    for each; ``nodes`` is K, from 3. ValueError when it is not above 0, or a block cuts with two
    tools.
    """
    most = np.broadcast_to(np.asarray(f_z_max, dtype=np.float64), (len(tools),))
    if not (np.isfinite(most).all() and (most > 0).all()):
        raise ValueError(f"load table: f_z_max = {most} must be finite and positive")
    order, station, tool = _different(engagement)
    values = np.zeros((len(order), nodes + 1, COLUMNS))
    for index in np.unique(tool):
        if not tools[index].load_known:
            continue
        these = np.flatnonzero(tool == index)
        rows = order[these]
        values[these] = _station_values(
            engagement, rows, tools[index], force_laws[index], most[index], nodes
        )
    exponents = np.array([1.0 - law.m_c for law in force_laws] + [1.0])
    scales = (nodes - 1) ** 2 / np.append(most, nodes - 1.0) ** exponents
    of_block = _tools(engagement)
    loads, force = values[..., :FORCE], values[..., FORCE:]
    length = engagement.length * (engagement.upper > engagement.lower).any(axis=1)
    return LoadTable(
        values=block_loads(loads[station], engagement.block, length, engagement.blocks),
        station_values=np.ascontiguousarray(np.moveaxis(loads, 2, 0)),
        station_force=np.ascontiguousarray(np.moveaxis(force, 2, 0)),
        station=station,
        block=engagement.block,
        scale=scales[of_block],
        exponent=exponents[of_block],
        length=np.bincount(engagement.block, length, engagement.blocks).astype(np.float64),
    )


def _tools(engagement: Engagement) -> Rows:
    """Tool of each block, -1 in air, where loads are 0."""
    of_block = np.full(engagement.blocks, -1, dtype=np.intp)
    of_block[engagement.block] = engagement.tool
    mixed = of_block[engagement.block] != engagement.tool
    if mixed.any():
        raise ValueError(
            f"load table: block {engagement.block[mixed][0]} cuts with two tools: a block has one"
        )
    return of_block


def _different(engagement: Engagement) -> tuple[Rows, Rows, NDArray[np.int32]]:
    """Stations that differ, which of them each station is, and their tools."""
    bins = engagement.upper.shape[1]
    key = np.zeros((len(engagement), 2 * bins + 3), dtype=np.float32)
    there = engagement.upper > engagement.lower
    key[:, :bins] = np.where(there, engagement.lower, 0)
    key[:, bins : 2 * bins] = np.where(there, engagement.upper, 0)
    key[:, -3], key[:, -2] = engagement.rings.rows(len(engagement)), engagement.slope
    key[:, -1] = engagement.tool
    key += np.float32(0.0)  # -0 is 0
    rows = key.view(np.dtype((np.void, key.dtype.itemsize * key.shape[1]))).ravel()
    _, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
    return first, inverse, engagement.tool[first]


def _station_values(
    engagement: Engagement, rows: Rows, tool: Tool, law: ForceLaw, f_z_max: float, nodes: int
) -> Floats:
    """Loads and mean forces of the stations ``rows`` at the nodes; shape (S, nodes + 1, 12)."""
    lower, upper, slope = (
        column[rows] for column in (engagement.lower, engagement.upper, engagement.slope)
    )
    ring, inner, outer = _rings(engagement, rows)
    power = 1.0 - law.m_c
    feeds = f_z_max * np.linspace(0.0, 1.0, nodes) ** (2 / power)
    many = np.array([LIP, CORNER, 1])
    bins, shape, most = lower.shape[1], edge_shape(tool), LIP + 2 * CORNER + 1
    angles = tool.flutes * ceil(ANGLES / tool.flutes)
    out = np.empty((len(lower), nodes + 1, COLUMNS))
    station_loads(
        lower, upper, ring, inner, outer, slope, shape, law.constants,
        power, feeds, tool.runout if tool.flutes > 1 else 0.0, radius_differences(tool), many,
        np.empty((most, 7)), np.empty((most, 2, 5)), np.empty(3), bin_middles(bins),
        piece_buffer(most, shape, float(upper.max()), bins),
        np.empty((nodes + 2, FINEST * angles, 4)), out,
    )  # fmt: skip
    if chisel_length(tool):
        low, high, down = (np.asarray(one, dtype=np.float64) for one in (lower, upper, slope))
        steep = np.clip(-down, 0.0, 1.0) ** power * chisel_engaged(tool, low, high)
        # in proportion to f_z^(1 - m_c), as the thrust of the lips
        scaled = f_z_max**power * (np.arange(nodes + 1) / (nodes - 1)) ** 2
        thrust = chisel_thrust(tool, law) * steep[:, None] * scaled
        out[:, :, AXIAL] += thrust
        out[:, :, FORCE + 2] -= thrust
    return out


def _rings(engagement: Engagement, rows: Rows) -> tuple[Rows, Floats, Floats]:
    """Row of each of some stations in inner and outer radii, of which the first is a whole end."""
    rings, bins = engagement.rings, engagement.upper.shape[1]
    inner, outer = (
        np.concatenate([whole[None], radii.reshape(len(rings.station), bins)])
        for whole, radii in zip(whole_ring(bins), (rings.inner, rings.outer), strict=True)
    )
    return rings.rows(len(engagement))[rows], inner, outer


def _loads(f_z: Floats, values: Floats, scale: Floats, exponent: Floats) -> BlockLoads:
    out = np.empty((6, *f_z.shape))
    for one, result in zip(values, out, strict=True):
        _look_up(f_z, one, scale, exponent, result)
    names = (field.name for field in fields(BlockLoads))
    return BlockLoads(**dict(zip(names, out, strict=True)))


def _look_up(f_z: Floats, values: Floats, scale: Floats, exponent: Floats, out: Floats) -> None:
    many = f_z.shape[-1]
    if f_z.size:
        look_up(f_z.reshape(-1, many), values, scale, exponent, out.reshape(-1, many))
