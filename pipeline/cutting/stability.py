"""Margin to chatter for the blocks of a program, for many programs of speeds at once.

What decides whether a station chatters, but its speed and its depth, is its class: tool, arc in the
material, direction of the feed.  For each class the depth limit is tabulated in cells of spindle
speed.  By the zero-order solution (:mod:`pipeline.cutting.lobes`, some 5 ms a class) a cell holds
the least limit of all lobes within it, so that a look-up never promises more than they allow; but
at low immersion the solution itself promises twice too much and more, where flip lobes are.  By
semi-discretisation (:mod:`pipeline.cutting.semi_discretisation`, some 20 ms a cell) a cell holds
the lesser of the limits at its two ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.directional import RegenerativeCut
from pipeline.cutting.force_law import ForceLaw
from pipeline.cutting.frf import Dynamics, FrequencyResponse
from pipeline.cutting.immersions import Immersions
from pipeline.cutting.lobes import border
from pipeline.cutting.semi_discretisation import depth_limits
from pipeline.cutting.tool import Tool

Floats = NDArray[np.float64]
Method = Literal["zero_order", "semi_discretisation"]


def margin(depth: ArrayLike, limit: ArrayLike) -> Floats:
    """Depth limit over depth, less 1 [1]: 0 at the border, negative in chatter, inf in the air.

    Examples
    --------
    >>> margin([1e-3, 2e-3, 0.0], 1.5e-3)
    array([ 0.5 , -0.25,   inf])
    """
    a_p, highest = np.broadcast_arrays(np.asarray(depth, float), np.asarray(limit, float))
    over = np.full(a_p.shape, np.inf)
    np.divide(highest, a_p, out=over, where=a_p > 0.0)
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
    kind: NDArray[np.int64]
    block: NDArray[np.int64]
    depth: Floats
    judged: NDArray[np.bool_]

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
        from pipeline.cutting.lobes_kernel import fill_margins

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
    stations: Immersions, dynamics: Sequence[Dynamics | None], laws: Sequence[ForceLaw],
    tools: Sequence[Tool], *, speed_rpm: tuple[float, float], cells: int = 512,
    angle_step_deg: float = 5.0, thickness: float | None = None, method: Method = "zero_order",
) -> StabilityTable:  # fmt: skip
    """Tabulate the depth limit of each class of a program's stations.

    Parameters
    ----------
    stations : Immersions
        Of the program.
    dynamics, laws, tools : sequence
        One for each tool; a tool whose dynamics are not known (None) is not judged.
    speed_rpm : (float, float)
        Least and greatest spindle speed [rev/min].
    cells : int
        Of speed.
    angle_step_deg : float
        Stations are one class when arcs, widened to multiples of this, and directions of feed,
        rounded to them, are the same [deg]; from 0.1 to 45.
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
    known = np.array([one is not None for one in dynamics], dtype=np.bool_)
    kept = known[stations.tool] if len(known) else np.zeros(0, dtype=np.bool_)
    judged = ~stations.unjudged
    judged[stations.block[~kept]] = False
    step = np.deg2rad(angle_step_deg)
    classes, kind = np.unique(_classes(stations, step)[kept], axis=0, return_inverse=True)
    limit = np.empty((len(classes), cells))
    for row, (tool, first, last, feed, sense) in zip(limit, classes.tolist(), strict=True):
        given = dynamics[tool] or ()
        cut = RegenerativeCut.of(
            laws[tool], tools[tool], entry=first * step, exit=min(last * step, pi),
            feed_direction=feed * step, direction=1 if sense > 0 else -1, thickness=thickness,
        )  # fmt: skip
        if method == "zero_order":
            row[:] = _zero_order(given, cut, low, high, cells)
        else:
            highest = 4.0 * float(stations.depth.max())
            row[:] = _semi_discretised(given, cut, low, high, cells, highest)
    return StabilityTable(
        lowest=low, width=(high - low) / cells, limit=limit, kind=kind.ravel().astype(np.int64),
        block=stations.block[kept].astype(np.int64), depth=stations.depth[kept], judged=judged,
    )  # fmt: skip


def _classes(stations: Immersions, step: float) -> NDArray[np.int64]:
    """Tool, entry, exit, direction of feed (its opposite is the same), spindle; shape (N, 5)."""
    slack = 1e-6  # an angle on a multiple stays there
    return np.stack([
        stations.tool,
        np.floor(stations.entry / step + slack),
        np.ceil(stations.exit / step - slack),
        np.round(np.mod(stations.feed_direction, pi) / step) % np.ceil(pi / step - slack),
        stations.direction,
    ], axis=1).astype(np.int64)  # fmt: skip


def _zero_order(
    dynamics: Dynamics, cut: RegenerativeCut, low: float, high: float, cells: int
) -> Floats:
    """Least depth of all lobes within each cell."""
    from pipeline.cutting.lobes_kernel import lobes_in_cells

    edge = border(dynamics, cut, low, high)
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
