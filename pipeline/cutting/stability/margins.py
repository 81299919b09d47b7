"""Chatter margin of the blocks of a program, for a population of spindle speeds.

All that decides whether a station chatters, but its speed and its depth, is its class: tool, arc in
the material, direction of the feed, and of a ball or a corner the part of its edge.  A class is
known between marks of a scale, its depth limit the least at all of them.  One mark alone, be it
that of more material, will not do: forces of the teeth in an arc cancel in part, so that a wider
arc may allow many times the depth of the true one.

Limits are tabulated in cells of spindle speed.  By the zero-order solution
(:mod:`pipeline.cutting.stability.lobes`) a cell holds the least limit of all lobes within it;
between marks the true limit may lie a little lower: 0.15 % were seen.  A ball's limit is that of
the part of its edge that cuts now, deeper it is another one.  At low immersion the solution itself
promises twice too much and more, where flip lobes are.  By semi-discretisation
(:mod:`pipeline.cutting.stability.semi_discretisation`, some 20 ms a cell and mark) a cell holds the
lesser of the limits at its two ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import pi, tan
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.engagement.immersions import Immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.directional import RegenerativeCut, in_plane, stiffness
from pipeline.cutting.stability.lobes import stability_boundary
from pipeline.cutting.stability.semi_discretisation import depth_limits
from pipeline.cutting.stability.tip_dynamics import Dynamics, FrequencyResponse
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Bools, Floats, Ints

SHARES = 32
"""Marks of the radial coefficient in one tangential one."""
_SLACK = 1e-6
"""Of a step: what lies on a mark stays there."""

Corner = tuple[float, float, float, int]
"""Entry, exit, direction of feed [rad], and marks of the radial coefficient above the tool's."""


def classes(stations: Immersions, radial: Floats, step: float) -> Ints:
    """Class of each station: all that it has in common with those of the same depth limit.

    Parameters
    ----------
    stations : Immersions
        N of them.
    radial : ndarray, shape (N, 2)
        Least and greatest radial coefficient less that of the tool's side, over the tangential one.
    step : float
        Between two marks of an arc's ends [rad]; those of the feed are half as far apart.

    Returns
    -------
    ndarray, shape (N, 10)
        Tool, spindle, then the marks below and above entry, exit, feed and radial coefficient.
    """
    feed = np.mod(stations.feed_direction, pi)  # the opposite feed is the same
    return np.column_stack([
        stations.tool,
        stations.direction,
        _below(stations.entry, step),
        _above(np.minimum(stations.entry + stations.bin, pi), step),
        _below(np.maximum(stations.exit - stations.bin, 0.0), step),
        _above(stations.exit, step),
        _below(feed, step / 2),
        _above(feed, step / 2),
        _below(radial[:, 0], 1 / SHARES),
        _above(radial[:, 1], 1 / SHARES),
    ]).astype(np.int64)  # fmt: skip


def corners(marks: list[int], step: float) -> list[Corner]:
    """The cuts that stand for a class, from its columns after tool and spindle."""
    entries, exits, feeds, shares = (sorted(set(marks[k : k + 2])) for k in (0, 2, 4, 6))
    whole = round(2 * pi / step) if abs(2 * pi / step - round(2 * pi / step)) < _SLACK else 0
    cuts = [
        (entry, exit, feed * step / 2, share)
        for entry, exit in _arcs(entries, exits, step)
        for feed, share in product((f % whole if whole else f for f in feeds), shares)
    ]
    return list(dict.fromkeys(cuts))


def _arcs(entries: list[int], exits: list[int], step: float) -> list[tuple[float, float]]:
    """Arcs from each entry to each exit."""
    turned = [(a * step, min(b * step, pi)) for a, b in product(entries, exits)]
    return [(entry, exit) for entry, exit in turned if exit - entry > _SLACK * step]


def _below(value: ArrayLike, step: float) -> Floats:
    mark: Floats = np.floor(np.asarray(value) / step + _SLACK)
    return mark


def _above(value: ArrayLike, step: float) -> Floats:
    mark: Floats = np.ceil(np.asarray(value) / step - _SLACK)
    return mark


Method = Literal["zero_order", "semi_discretisation"]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """Depth limits of K classes in C cells of spindle speed, and the stations that look them up.

    Parameters
    ----------
    lowest, width : float
        Where the first cell begins, and how wide each is [1/s].
    limit : ndarray, shape (K, C)
        Least depth at which chatter begins within the cell [m]; inf without one.
    kind, block : ndarray of int64, shape (N,)
        Class and block of each station.
    depth : ndarray, shape (N,)
        [m].
    judged : ndarray of bool, shape (B,)
        Blocks of which all that is in the material was judged; air is.
    """

    lowest: float
    width: float
    limit: Floats
    kind: Ints
    block: Ints
    depth: Floats
    judged: Bools

    def margins(self, speed_rpm: ArrayLike) -> Floats:
        """Least margin of each block: limit / a_p - 1 [1].

        Parameters
        ----------
        speed_rpm : array_like, shape (P, B) or (B,)
            Spindle speed of each block [rev/min]; that of blocks in the air does not count.

        Returns
        -------
        ndarray, shape of ``speed_rpm``
            inf for blocks in the air; nan where nothing of what is in the material was judged.

        Raises
        ------
        ValueError
            When a speed is outside of the table, or the number of blocks is another one.
        """
        from pipeline.cutting.stability.stability_kernel import fill_margins

        given = np.asarray(speed_rpm, dtype=np.float64)
        blocks = len(self.judged)
        if given.ndim not in (1, 2) or given.shape[-1] != blocks:
            raise ValueError(
                f"speed_rpm has shape {given.shape}: it needs one speed for each of {blocks} blocks"
            )
        speed = np.ascontiguousarray(np.atleast_2d(given)) / 60
        out = np.full(speed.shape, np.inf)
        bad = fill_margins(
            speed, self.lowest, self.width, self.limit, self.kind, self.depth, self.block, out
        )
        if bad >= 0:
            p, b = divmod(bad, blocks)
            highest = self.lowest + self.width * self.limit.shape[1]
            raise ValueError(
                f"speed_rpm[{p}, {b}] = {60 * speed[p, b]:g} is outside of the table of stability, "
                f"{60 * self.lowest:g} to {60 * highest:g} rpm"
            )
        covered = np.zeros(blocks, dtype=np.bool_)
        covered[self.block] = True
        out[:, ~self.judged & ~covered] = np.nan
        return out.reshape(given.shape)


def stability_table(
    stations: Immersions, dynamics: Sequence[Dynamics | None], force_laws: Sequence[ForceLaw],
    tools: Sequence[Tool], *, speed_rpm: tuple[float, float], cells: int = 512,
    angle_step_deg: float = 5.0, thickness: float | None = None, method: Method = "zero_order",
) -> StabilityTable:  # fmt: skip
    """Tabulate the depth limit of each class of a program's stations.

    Parameters
    ----------
    stations : Immersions
        Of the program.
    dynamics, force_laws, tools : sequence
        One for each tool; a tool whose dynamics are not known (None) is not judged.
    speed_rpm : (float, float)
        Least and greatest spindle speed [rev/min].
    cells : int
        Of speed.
    angle_step_deg : float
        Between two marks of an arc's ends, twice that of the feed [deg]; from 0.1 to 45.
    thickness : float, optional
        Of the chip, where a law that is not linear is taken [m].
    method : {"zero_order", "semi_discretisation"}
        The latter needs modes, and looks up to four times the program's greatest depth: above it
        the limit is inf.

    Raises
    ------
    ValueError
        When a parameter is out of its range, or the method does not go with the dynamics.
    """
    if method not in ("zero_order", "semi_discretisation"):
        raise ValueError(f"method = {method!r} is none: write zero_order or semi_discretisation")
    low, high = speed_rpm[0] / 60, speed_rpm[1] / 60
    if not 0.0 < low < high < np.inf:
        raise ValueError(f"speed_rpm = {speed_rpm} must be two speeds above 0, the least first")
    if cells < 1:
        raise ValueError(f"cells = {cells} must be at least 1")
    if not 0.1 <= angle_step_deg <= 45.0:
        raise ValueError(f"angle_step_deg = {angle_step_deg} is out of its range, 0.1 to 45")
    many = int(stations.tool.max(initial=-1)) + 1
    for name, given in (("dynamics", dynamics), ("force_laws", force_laws), ("tools", tools)):
        if len(given) < many:
            raise ValueError(
                f"{name} has {len(given)} entries, and the stations name tool {many - 1}: give one "
                "for each tool, counted from 0"
            )
    # stations that have known dynamics, and blocks that are judged with them
    known = np.array([one is not None for one in dynamics], dtype=np.bool_)
    kept = known[stations.tool] if len(known) else np.zeros(0, dtype=np.bool_)
    judged = ~stations.unjudged
    judged[stations.block[~kept]] = False
    # classes of the stations
    step = np.deg2rad(angle_step_deg)
    radial = _radial(stations, force_laws, tools, kept, thickness)
    kinds, kind = np.unique(classes(stations, radial, step)[kept], axis=0, return_inverse=True)
    limit = np.full((len(kinds), cells), np.inf)
    # limit of each class: the least of the cuts that stand for it, each computed once
    highest = 4.0 * float(stations.depth.max(initial=0.0))
    done: dict[tuple[int, int, Corner], Floats] = {}
    for row, (tool, sense, *marks) in zip(limit, kinds.tolist(), strict=True):
        for corner in corners(marks, step):
            key = tool, sense, corner
            if key not in done:
                cut = _cut(force_laws[tool], tools[tool], sense, corner, thickness)
                tip = dynamics[tool] or ()
                if method == "zero_order":
                    done[key] = _zero_order(tip, cut, low, high, cells)
                else:
                    done[key] = _semi_discretised(tip, cut, low, high, cells, highest)
            np.minimum(row, done[key], out=row)
    return StabilityTable(
        lowest=low, width=(high - low) / cells, limit=limit, kind=kind.ravel().astype(np.int64),
        block=stations.block[kept].astype(np.int64), depth=stations.depth[kept], judged=judged,
    )  # fmt: skip


def _radial(
    stations: Immersions, force_laws: Sequence[ForceLaw], tools: Sequence[Tool],
    kept: Bools, thickness: float | None,
) -> Floats:  # fmt: skip
    """Least and greatest radial coefficient less the side's, over the tangential one; (N, 2).

    That of the lowest and of the highest part of the edge as long as the depth.
    """
    depth = stations.depth
    low = np.zeros_like(depth) if stations.lowest is None else np.maximum(stations.lowest, 0.0)
    high = depth if stations.highest is None else stations.highest
    radial = np.zeros((len(depth), 2))
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
        radial[mine] = np.sort(np.transpose(both), axis=1) / tangential
    return radial


def _cut(
    law: ForceLaw, tool: Tool, sense: int, corner: Corner, thickness: float | None
) -> RegenerativeCut:
    entry, exit, feed, share = corner
    tangential, side = stiffness(law, thickness)
    return RegenerativeCut(
        K_tc=tangential, K_rc=side + tangential * share / SHARES, flutes=tool.flutes, entry=entry,
        exit=exit, feed_direction=feed, direction=1 if sense > 0 else -1,
        lag=abs(tan(tool.helix)) / tool.radius,
    )  # fmt: skip


def _zero_order(
    dynamics: Dynamics, cut: RegenerativeCut, low: float, high: float, cells: int
) -> Floats:
    """Least depth of all lobes within each cell."""
    from pipeline.cutting.stability.stability_kernel import lobes_in_cells

    edge = stability_boundary(dynamics, cut, low, high)
    inverse = np.zeros(cells)
    width = (high - low) / cells
    lobes_in_cells(edge.omega, edge.share, edge.inverse, cut.flutes, low, width, inverse)
    limit = np.full_like(inverse, np.inf)
    np.divide(1.0, inverse, out=limit, where=inverse > 0.0)
    return limit


def _semi_discretised(
    dynamics: Dynamics, cut: RegenerativeCut, low: float, high: float, cells: int, highest: float
) -> Floats:
    """Lesser of the limits at both ends of each cell."""
    if isinstance(dynamics, FrequencyResponse):
        raise ValueError(
            "method semi_discretisation needs modes, and a tool has a measured frequency response: "
            "give its modes, or method zero_order"
        )
    nodes = np.linspace(low, high, cells + 1)
    limit = depth_limits(dynamics, cut, nodes, highest=highest).depth_limit
    least: Floats = np.minimum(limit[:-1], limit[1:])
    return least
