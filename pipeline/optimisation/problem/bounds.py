"""Feed for each tooth that each row of a cut may have, at most and at least, by what limits it.

Loads of a row depend on f_z alone, so that a limit of the load, the tip's deflection or the torque
is one of f_z; so are those of the chip, h = f_z sin(phi) sin(kappa) at its greatest, and of the
height of feed marks,

    R_t = f^2 / (8 rho),

with rho the tool's radius for walls (Martellotti 1941, of teeth that go straight: f_z much less
than D) or its corner's radius for floors, and f the feed for each tooth; where the tool runs out
one tooth leaves the marks, and f is that of a turn.  Plunges and drills leave none.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.load_table import TORQUE as MEAN_TORQUE
from pipeline.cutting.tool import Tool, tip_stiffness
from pipeline.optimisation.problem.constraints import (
    AS_PROGRAMMED,
    DEFLECTION,
    GREATEST_CHIP,
    LOAD,
    ROUGHNESS,
    TORQUE,
)
from pipeline.optimisation.settings import CutLimit
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]

MM, UM = 1e-3, 1e-6
HIGH = (LOAD, DEFLECTION, ROUGHNESS, GREATEST_CHIP, TORQUE, AS_PROGRAMMED)
"""What bounds f_z from above, whatever the spindle's speed."""
STEEP = float(np.sqrt(0.5))
"""|dz / ds| from which a motion is a plunge."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """Feed for each tooth of M rows [m], whatever the spindle's speed.

    Parameters
    ----------
    most : ndarray, shape (6, M)
        Greatest that each of ``HIGH`` allows; infinite where it does not limit.
    least : ndarray, shape (M,)
        For the least chip; 0 where there is none.
    torque : ndarray, shape (M, K + 1)
        Mean torque over the turn at each row's hardest station, at the nodes of the load table
        [N m].
    """

    most: Floats = field(repr=False)
    least: Floats = field(repr=False)
    torque: Floats = field(repr=False)

    @property
    def high(self) -> Floats:
        """Shape (M,)."""
        lowest: Floats = self.most.min(axis=0)
        return lowest

    @property
    def binds(self) -> Rows:
        """Which of ``CONSTRAINTS`` makes ``high``, -1 where none does; shape (M,)."""
        which = np.array(HIGH)[self.most.argmin(axis=0)]
        return np.where(np.isfinite(self.high), which, -1)


def bounds_of(
    cut: Cut, blocks: CutBlocks, limits: CutLimit, f_z_load: Floats | None = None
) -> Bounds:
    """Bounds of each row of a cut.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    blocks : CutBlocks
        Its K blocks.
    limits : CutLimit
        Of the part.
    f_z_load : ndarray, shape (M,), optional
        Stands for what the load limit allows [m].
    """
    margins = limits.margins
    torque = greatest_torque(cut)
    most = np.full((len(HIGH), cut.engagement.blocks), np.inf)
    load, deflection, roughness, chip, turning, programmed = most
    cuts = cut.tool >= 0
    if f_z_load is not None:
        load[cuts] = f_z_load[cuts]
    elif limits.load_N is not None:
        load[:] = inverse(cut, cut.table.values[0], limits.load_N * (1 - margins.load))
    if limits.deflection_um is not None:
        give = limits.deflection_um * UM * (1 - margins.deflection)
        stiffness = np.array([_stiffness(tool) for tool in cut.tools])
        deflection[:] = inverse(cut, cut.table.values[0], give * stiffness[cut.tool])
    if limits.roughness_um is not None:
        height = limits.roughness_um * UM * (1 - margins.roughness)
        marked = np.array([feed_for_marks(tool, height) for tool in cut.tools])
        roughness[:] = np.where(_plunges(cut), np.inf, marked[cut.tool])
    if limits.torque_Nm is not None:
        turning[:] = inverse(cut, torque, limits.torque_Nm * (1 - margins.torque))
    factor = _chip_factor(cut, blocks)
    chip[:] = _greatest_chip(cut, limits, factor)
    alone = _only_along(cut) | ~np.isfinite(most).any(axis=0)
    programmed[:] = np.where(
        alone & ~np.isfinite(chip), cut.commanded_feed_per_tooth(), np.inf
    )  # fmt: skip
    most[:, ~cuts] = np.inf
    return Bounds(most=most, least=_least(cut, blocks, limits, factor), torque=torque)


def inverse(cut: Cut, values: Floats, limit: Floats | float) -> Floats:
    """Greatest f_z up to which a load stays within a limit [m].

    Parameters
    ----------
    cut : Cut
        Whose load table has M rows.
    values : ndarray, shape (M, K + 1)
        The load at its nodes.
    limit : ndarray, shape (..., M), or float
        In the unit of ``values``; infinite where there is none.

    Returns
    -------
    ndarray, shape (..., M)
        0 where any feed passes the limit, infinite where none does.
    """
    from pipeline.optimisation.problem.inverse_kernel import first_crossings

    table = cut.table
    shape = np.broadcast_shapes(np.shape(limit), table.scale.shape)
    asked = np.ascontiguousarray(np.broadcast_to(limit, shape), dtype=np.float64)
    out = np.empty(shape)
    if out.size:
        many = (-1, shape[-1])
        first_crossings(
            asked.reshape(many), np.ascontiguousarray(values), table.scale, table.exponent,
            out.reshape(many),
        )  # fmt: skip
    return out


def greatest_torque(cut: Cut) -> Floats:
    """Mean torque over the turn at each row's hardest station [N m]; shape (M, K + 1).

    At the nodes of the load table; between them what it tells is not below any station's.
    """
    found, table = cut.engagement, cut.table
    out = np.zeros((found.blocks, table.values.shape[2]))
    fed = np.flatnonzero(found.feed)
    order = fed[np.argsort(found.block[fed], kind="stable")]
    block = found.block[order]
    first = np.flatnonzero(np.diff(block, prepend=-1))
    if len(first):
        each = table.station_values[MEAN_TORQUE][table.station[order]]
        out[block[first]] = np.maximum.reduceat(each, first)
    return out


def at_hardest_station(cut: Cut, torque: Floats, f_z: Floats) -> Floats:
    """What :func:`greatest_torque` tells at feeds for each tooth [N m]; shape (M,)."""
    from pipeline.cutting.force.profile_kernel import look_up

    out = np.empty((1, len(f_z)))
    look_up(f_z[np.newaxis], torque, cut.table.scale, cut.table.exponent, out)
    return out[0]


def feed_for_marks(tool: Tool, height: float) -> float:
    """Feed for each tooth whose marks have that height [m]; infinite for a drill.

    sqrt(8 rho R_t) with the lesser of the radii that leave marks, over the teeth where the tool
    runs out.  Valid for feeds much less than that radius (Martellotti 1941).

    Examples
    --------
    A ball of 6 mm that leaves marks of 1 um:

    >>> ball = Tool(kind="ball", diameter_mm=6.0, flutes=2)
    >>> round(feed_for_marks(ball, 1e-6) * 1e3, 4)
    0.1549
    """
    if tool.kind == "drill":
        return float("inf")
    radius = tool.corner_radius or tool.radius
    teeth = tool.flutes if tool.runout > 0 else 1
    return float(np.sqrt(8 * radius * height)) / teeth


def _stiffness(tool: Tool) -> float:
    """Of the tip [N/m]; infinite where none is known; the lips of a drill balance each other."""
    known = tool.stickout is not None and tool.kind != "drill"
    return tip_stiffness(tool) if known else float("inf")


def _chip_factor(cut: Cut, blocks: CutBlocks) -> Floats:
    """Thickest chip of each row over its feed for each tooth [1]; 0 without a chip.  Shape (M,)."""
    out = np.zeros(cut.engagement.blocks)
    fed = blocks.feed_per_tooth > 0
    out[blocks.row[fed]] = blocks.thickness[fed] / blocks.feed_per_tooth[fed]
    return out


def _greatest_chip(cut: Cut, limits: CutLimit, factor: Floats) -> Floats:
    """f_z of the thickest chip that is allowed, and of what the tools' makers allow [m]."""
    share = 1 - limits.margins.chip
    made = [tool.feed_per_tooth_mm for tool in cut.tools]
    most = np.array([np.inf if span is None else span[1] * MM * share for span in made])[cut.tool]
    if limits.chip_um is not None:
        thickest = limits.chip_um[1] * UM * share
        with np.errstate(divide="ignore"):
            most = np.minimum(most, thickest / factor)
    return most


def _least(cut: Cut, blocks: CutBlocks, limits: CutLimit, factor: Floats) -> Floats:
    """f_z of the least chip, and of what the tools' makers demand [m]; shape (M,).

    What is engaged over less than a cell of the blank is too thin for its thickness to be known.
    """
    share = 1 + limits.margins.chip
    made = [tool.feed_per_tooth_mm for tool in cut.tools]
    least = np.array([0.0 if span is None else span[0] * MM * share for span in made])[cut.tool]
    if limits.chip_um is not None:
        wide = np.zeros(len(least), dtype=np.bool_)
        wide[blocks.row] = blocks.radial_depth >= cut.engagement.resolution
        known = wide & (factor > 0)
        thinnest = limits.chip_um[0] * UM * share
        least = np.maximum(
            least, np.divide(thinnest, factor, out=np.zeros(len(least)), where=known)
        )
    return np.where(cut.tool >= 0, least, 0.0)


def _plunges(cut: Cut) -> Flags:
    """Rows that plunge all along; shape (M,)."""
    found = cut.engagement
    out = np.ones(found.blocks, dtype=np.bool_)
    out[found.block[np.abs(found.slope) < STEEP]] = False
    return out


def _only_along(cut: Cut) -> Flags:
    """Rows somewhere loaded along the tool's axis rather than across: plunges, drills; (M,)."""
    found = cut.engagement
    out = np.zeros(found.blocks, dtype=np.bool_)
    out[found.block[np.abs(found.slope) >= STEEP]] = True
    drills = np.array([tool.kind == "drill" for tool in cut.tools])
    return out | drills[cut.tool]
