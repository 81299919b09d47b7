"""Chatter margin of the blocks of a program, for a population of spindle speeds.

All that decides whether a station chatters, but its speed and its depth, is its class: tool, arc in
the material, direction of the feed, and of a ball or a corner the part of its edge.  Arcs are
rounded to marks that divide half a turn, of which 90 or more lie in the arc, directions of the feed
to a quarter of a degree; :data:`ROUNDED` takes off what that may change.

The limit of a class at a speed is that of semi-discretisation
(:mod:`pipeline.cutting.stability.semi_discretisation`), which sees flip lobes, and is computed when
it is first asked for and then kept, so that a program, its optimisation and the program that comes
out of it compute it once.  It is looked for up to four times the depth of the class: no margin is
above :data:`MOST`, and a class that does not reach the share
:data:`~pipeline.cutting.stability.semi_discretisation.BELOW` of the depth that harmonics of the cut
bound is not looked at.  Of a measured frequency response the modes are fitted first
(:mod:`pipeline.cutting.stability.modal_fit`).  One case is left to the zero-order solution: speeds
so low that hundreds of waves lie within a cut; there its least depth of all speeds counts.

Speeds lie at nodes.  Between two nodes the lesser of both limits counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf, isnan, pi, tan

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.engagement.engagement import Immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.semi_discretisation import (
    BELOW,
    KEPT,
    RegenerativeCut,
    in_plane,
    least_depth,
    settled_limits,
    stable_depth,
    stiffness,
)
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.cutting.tool import Tool
from pipeline.kernels import compiled
from pipeline.parallel import mapped
from pipeline.schema.arrays import Bools, Floats, Ints

SHARES = 128
"""Marks of the radial coefficient in one tangential one."""
IN_ARC = 90
"""Least number of marks in an arc: its ends are rounded by half a mark each, 1.1 % of it in all."""
FEED = pi / 720
"""Distance between two marks of the feed's direction [rad]."""
ROUNDED = 0.985
"""Share of the limit that is allowed: rounded arcs and feeds may promise as much too much [1]."""
MOST = 3.0
"""Greatest resolved margin [1]: limits are searched up to 1 + this times the depth."""


def classes(stations: Immersions, radial: Floats) -> Ints:
    """Class of each station: all that it has in common with those of the same depth limit.

    Shape (N, 7): tool, spindle, logarithm of the marks in half a turn, then the nearest marks of
    entry, exit, feed and radial coefficient. ``radial`` (N,) is the radial coefficient less that of
    the tool's side, over the tangential one [1].
    """
    arc = stations.exit - stations.entry
    level = np.clip(np.ceil(np.log2(IN_ARC * pi / arc)), 0, 40)
    step = pi / 2.0**level
    return np.column_stack([
        stations.tool,
        stations.direction,
        level,
        np.round(stations.entry / step),
        np.round(stations.exit / step),
        np.round(np.mod(stations.feed_direction, pi) / FEED) % 720,  # the opposite feed is the same
        np.round(radial * SHARES),
    ]).astype(np.int64)  # fmt: skip


def margin(depth: ArrayLike, limit: ArrayLike) -> Floats:
    """Depth limit over depth, less 1 [1]: 0 at the limit, negative in chatter, inf in the air.

    NaN where depth or limit is.

    Examples
    --------
    >>> margin([1e-3, 2e-3, 0.0], 1.5e-3)
    array([ 0.5 , -0.25,   inf])
    """
    a_p, highest = np.broadcast_arrays(np.asarray(depth, float), np.asarray(limit, float))
    over = np.where(np.isnan(highest), np.nan, np.inf)
    np.divide(highest, a_p, out=over, where=~(a_p <= 0.0))
    return over - 1.0


@lru_cache(maxsize=KEPT)
def _kept(tip: object, cut: RegenerativeCut, highest: float) -> dict[float, float]:
    """Limits of a cut by speed, as far as they were computed; empty at first."""
    return {}


@dataclass(frozen=True, kw_only=True)
class CutClass:
    """A cut, the dynamics of its tip, and the depth up to which its limit matters."""

    dynamics: Sequence[Mode] = field(repr=False)
    """Dynamics of the tip."""
    cut: RegenerativeCut
    """Arc and coefficients of the class."""
    highest: float
    """Depth up to which chatter is looked for [m]."""

    def limits(self, n: Floats) -> Floats:
        """Depth that is allowed at speeds of shape (S,) [1/s], at most ``highest`` [m]."""
        tip = (*self.dynamics,)
        known = _kept(tip, self.cut, self.highest)
        missing = np.unique([speed for speed in n.tolist() if speed not in known])
        if len(missing):
            new = _allowed(tip, self.cut, missing, self.highest)
            known.update(zip(missing.tolist(), new.tolist(), strict=True))
        return np.array([known[speed] for speed in n.tolist()])


def _allowed(tip: Sequence[Mode], cut: RegenerativeCut, n: Floats, highest: float) -> Floats:
    if highest <= BELOW * stable_depth(tip, cut):
        return np.full(len(n), highest)
    limit = settled_limits(tip, cut, n, highest=highest).depth_limit
    slow = np.isnan(limit)
    limit[slow] = least_depth(tip, cut)
    return np.minimum(ROUNDED * limit, highest)


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """Depth limits of K classes at C nodes of spindle speed, and the stations that look them up."""

    nodes: Floats
    """Spindle speeds, growing [1/s]; shape (C,)."""
    classes: Sequence[CutClass] = field(repr=False)
    """K of them."""
    limit: Floats = field(repr=False)
    """Depth that is allowed [m]; nan where not computed yet; shape (K, C)."""
    kind: Ints = field(repr=False)
    block: Ints = field(repr=False)
    """Class and block of each station; shape (N,)."""
    depth: Floats = field(repr=False)
    """Depth [m]; shape (N,)."""
    judged: Bools = field(repr=False)
    """Blocks of which all that is in the material was judged; air is; shape (B,)."""
    most: float = MOST
    """Greatest resolved margin [1]."""

    def margins(self, speed_rpm: ArrayLike) -> Floats:
        """Least margin of each block: limit / a_p - 1, at most ``most`` [1]; ``speed_rpm``'s shape.

        ``speed_rpm`` is (P, B) or (B,) [rev/min]. The margin is inf for blocks in the air, at any
        speed, and NaN where nothing in the material could be computed. ValueError when a speed is
        outside of the table, or the number of blocks is another one.
        """
        given = np.asarray(speed_rpm, dtype=np.float64)
        blocks = len(self.judged)
        if given.ndim not in (1, 2) or given.shape[-1] != blocks:
            raise ValueError(
                f"speed_rpm has shape {given.shape}: it needs one speed for each of {blocks} blocks"
            )
        covered = np.zeros(blocks, dtype=np.bool_)
        covered[self.block] = True
        below, above = self._between(np.atleast_2d(given), covered)
        missing = np.zeros(self.limit.shape, dtype=np.bool_)
        mark_missing(below, above, self.limit, self.kind, self.block, missing)

        def fill(kind: int) -> None:
            at = missing[kind]
            self.limit[kind, at] = self.classes[kind].limits(self.nodes[at])

        kinds = np.flatnonzero(missing.any(axis=1)).tolist()
        if kinds:
            mapped(fill, kinds, compute="threads")
        out = np.full(below.shape, np.inf)
        fill_margins(below, above, self.limit, self.kind, self.depth, self.block, self.most, out)
        out[:, ~self.judged & ~covered] = np.nan
        return out.reshape(given.shape)

    def _between(self, speed_rpm: Floats, covered: Bools) -> tuple[Ints, Ints]:
        """Nodes below and above each speed, the same twice at a node; (P, B) each."""
        speed = speed_rpm / 60
        low, high = float(self.nodes[0]), float(self.nodes[-1])
        outside = ~((speed >= low * (1 - NEAR)) & (speed <= high * (1 + NEAR))) & covered
        if outside.any():
            p, b = np.argwhere(outside)[0]
            raise ValueError(
                f"speed_rpm[{p}, {b}] = {60 * speed[p, b]:g} is outside of the table of stability, "
                f"{60 * low:g} to {60 * high:g} rev/min"
            )
        last = len(self.nodes) - 1
        below = np.searchsorted(self.nodes, speed * (1 + NEAR), side="right") - 1
        above = np.searchsorted(self.nodes, speed * (1 - NEAR), side="left")
        return np.clip(below, 0, last), np.clip(above, 0, last)


NEAR = 1e-9
"""Rounding, as a share: a speed as close to a node lies on it."""


def stability_table(
    stations: Immersions, dynamics: Sequence[Sequence[Mode] | None],
    force_laws: Sequence[ForceLaw], tools: Sequence[Tool], *, nodes_rpm: ArrayLike,
    thickness: float | None = None, most: float = MOST,
) -> StabilityTable:  # fmt: skip
    """The classes of a program's stations, whose depth limits are computed where they are read.

    Dynamics, laws and tools are one for each tool; a tool whose dynamics are not known (None) is
    not judged. ``nodes_rpm`` [rev/min] are the spindle speeds at which limits are computed,
    growing; ``thickness`` [m] is that of the chip, where a law that is not linear is taken;
    ``most`` is the greatest resolved margin [1]: the less, the less computing.
    ValueError when a parameter is out of its range.
    """
    nodes = np.atleast_1d(np.asarray(nodes_rpm, dtype=np.float64)) / 60
    if not len(nodes) or not (np.diff(nodes, prepend=0.0) > 0.0).all() or not nodes[-1] < np.inf:
        raise ValueError(
            f"nodes_rpm has {len(nodes)} speeds, which must be above 0 and grow: give one or more"
        )
    # stations that have known dynamics, and blocks that are judged with them
    known = np.array([one is not None for one in dynamics], dtype=np.bool_)
    kept = known[stations.tool] if len(known) else np.zeros(0, dtype=np.bool_)
    judged = ~stations.unjudged
    judged[stations.block[~kept]] = False
    # classes of the stations, and how deep each is
    radial = _radial(stations, force_laws, tools, kept, thickness)
    rows, kind = np.unique(classes(stations, radial)[kept], axis=0, return_inverse=True)
    kind = kind.ravel().astype(np.int64)
    deepest = np.zeros(len(rows))
    np.maximum.at(deepest, kind, stations.depth[kept])
    kinds = [
        CutClass(
            dynamics=dynamics[row[0]] or (), highest=(1.0 + most) * depth,
            cut=_cut(force_laws[row[0]], tools[row[0]], row, thickness),
        )
        for row, depth in zip(rows.tolist(), deepest.tolist(), strict=True)
    ]  # fmt: skip
    return StabilityTable(
        nodes=nodes, classes=kinds, limit=np.full((len(kinds), len(nodes)), np.nan), kind=kind,
        block=stations.block[kept].astype(np.int64), depth=stations.depth[kept], judged=judged,
        most=most,
    )  # fmt: skip


def _radial(
    stations: Immersions, force_laws: Sequence[ForceLaw], tools: Sequence[Tool],
    kept: Bools, thickness: float | None,
) -> Floats:  # fmt: skip
    """Radial less side coefficient over the tangential one [1]; (N,).

    Averaged over the lowest or the highest part of the edge of one axial depth, whichever differs
    more from the side.
    """
    depth = stations.depth
    low = np.zeros_like(depth) if stations.lowest is None else np.maximum(stations.lowest, 0.0)
    high = depth if stations.highest is None else stations.highest
    radial = np.zeros(len(depth))
    for tool in np.unique(stations.tool[kept]).tolist():
        mine = stations.tool == tool
        a, b, length = low[mine], high[mine], depth[mine]
        ends = [(a, a + length), (np.maximum(b - length, a), np.maximum(b, a + length))]
        tangential, side = stiffness(force_laws[tool], thickness)
        if not tangential > 0.0:
            raise ValueError(
                f"force_laws[{tool}].K_tc = {force_laws[tool].K_tc} must be positive: a force that "
                "does not grow with the chip's thickness says nothing of chatter"
            )
        both = [in_plane(force_laws[tool], tools[tool], *end, thickness)[1] - side for end in ends]
        farther = np.abs(both[0]) >= np.abs(both[1])
        radial[mine] = np.where(farther, both[0], both[1]) / tangential
    return radial


def _cut(law: ForceLaw, tool: Tool, row: Sequence[int], thickness: float | None) -> RegenerativeCut:
    """The cut of a class, a row of :func:`classes`."""
    _, sense, level, entry, exit, feed, share = row
    step = pi / 2**level
    tangential, side = stiffness(law, thickness)
    return RegenerativeCut(
        K_tc=tangential, K_rc=side + tangential * share / SHARES, flutes=tool.flutes,
        entry=entry * step, exit=exit * step, feed_direction=feed * FEED,
        direction=1 if sense > 0 else -1, lag=abs(tan(tool.helix)) / tool.radius,
    )  # fmt: skip


@compiled
def mark_missing(below, above, table, kind, block, missing):  # type: ignore[no-untyped-def]
    """Mark what of ``table`` (K, C), nan where it is not known, the nodes of the blocks ask for.

    ``below``, ``above`` (P, B) are the nodes of the speed beside each block's; ``kind``, ``block``
    (N,) those of the stations.
    """
    for p in range(below.shape[0]):
        for i in range(block.shape[0]):
            for c in (below[p, block[i]], above[p, block[i]]):
                if isnan(table[kind[i], c]):
                    missing[kind[i], c] = True


@compiled
def fill_margins(below, above, table, kind, depth, block, most, out):  # type: ignore[no-untyped-def]
    """Lower ``out`` (P, B) to the least margin of each block's stations, ``most`` at most.

    The lesser limit of both nodes counts; parameters as of :func:`mark_missing`, ``depth`` [m].
    """
    for p in range(below.shape[0]):
        for i in range(block.shape[0]):
            b = block[i]
            limit = min(table[kind[i], below[p, b]], table[kind[i], above[p, b]])
            margin = limit / depth[i] - 1.0
            if margin < inf:
                margin = min(margin, most)
            if margin < out[p, b]:
                out[p, b] = margin
