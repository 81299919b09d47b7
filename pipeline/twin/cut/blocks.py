"""Stations and blocks of a cut: arcs, chip, depths, loads, power, removal rate, time; limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, motor_power
from pipeline.cutting.engagement.engagement import Engagement, engaged_arc
from pipeline.cutting.tool import Tool, tip_deflection, tool_limits
from pipeline.gcode.moves import METRE_PER_SECOND
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut.loads import Cut

STEEP = float(np.sqrt(0.5))
"""|dz / ds| from which a motion is a plunge [1]: the tool cuts with its end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StationArcs:
    """N stations; every array has shape (N,)."""

    entry: Floats
    exit: Floats
    """Exit angle of the longest engaged arc on the side where a chip is cut, 0 to pi [rad]."""
    radial: Floats
    """Width of that arc across the feed [m]."""
    thickness: Floats
    """Thickness of the thickest chip, over the feed for each tooth [1]."""
    diameter: Floats
    """Greatest diameter at which an edge cuts [m]."""


def station_arcs(engagement: Engagement, tools: tuple[Tool, ...]) -> StationArcs:
    """Arcs of the stations of an engagement; a plunge cuts all around, 0 to 2 pi."""
    inside = engagement.upper > engagement.lower
    ahead = inside & (np.sin(engagement.angles) > 0)
    entry, leave = engaged_arc(np.where(ahead, engagement.upper - engagement.lower, 0.0))
    plunge = np.abs(engagement.slope) > STEEP
    whole = plunge & (inside.mean(axis=1) > 0.5)
    radius = np.array([tool.radius for tool in tools])[engagement.tool]
    width = np.cos(entry) - np.cos(leave)
    radial = radius * np.where(whole, 2.0, np.nan_to_num(width))
    bored = engagement.rings.station[engagement.rings.around_the_axis]
    radial[bored] = engagement.rings.width[engagement.rings.around_the_axis]
    return StationArcs(
        entry=np.where(whole, 0.0, np.nan_to_num(entry)),
        exit=np.where(whole, 2 * np.pi, np.nan_to_num(leave)),
        radial=radial,
        thickness=_thickness(engagement, tools, ahead, plunge),
        diameter=_diameter(engagement, tools, ahead, plunge),
    )


def _thickness(
    engagement: Engagement, tools: tuple[Tool, ...], ahead: Bools,
    plunge: Bools,
) -> Floats:  # fmt: skip
    """sin(phi) sin(kappa) at its greatest; of a drill the sine of half its point."""
    steep = _steepness(engagement, tools)
    chip = np.where(ahead, np.sin(engagement.angles) * steep, 0.0).max(axis=1, initial=0.0)
    chip *= np.array([np.sin(tool.cutting_edge_angle) for tool in tools])[engagement.tool]
    point = np.array(
        [np.sin(tool.point_angle / 2) if tool.kind == "drill" else 1.0 for tool in tools]
    )[engagement.tool]
    return np.where(plunge, point, chip)


def _steepness(engagement: Engagement, tools: tuple[Tool, ...]) -> Floats:
    """sin(kappa) of the highest engaged point of the end's corner; shape (N, F)."""
    corner = np.array([tool.corner_radius for tool in tools])[engagement.tool, None]
    deep = np.divide(
        engagement.upper, corner, out=np.ones(engagement.upper.shape), where=corner > 0
    )
    return np.sqrt(1 - (1 - np.clip(deep, 0.0, 1.0)) ** 2)


def _diameter(
    engagement: Engagement, tools: tuple[Tool, ...], ahead: Bools, plunge: Bools
) -> Floats:
    """Diameter at the highest point that cuts; of a ball 2 sqrt(a_p (D - a_p)) [m]."""
    corner, radius = (
        np.array([getattr(tool, name) for tool in tools])[engagement.tool]
        for name in ("corner_radius", "radius")
    )
    steep = np.where(ahead, _steepness(engagement, tools), 0.0).max(axis=1, initial=0.0)
    whole = plunge | ~ahead.any(axis=1)
    return 2 * (radius - corner * np.where(whole, 0.0, 1 - steep))


@dataclass(frozen=True, kw_only=True, eq=False)
class CutBlocks:
    """K blocks that cut at feed; every array has shape (K,)."""

    row: Rows
    line: Rows
    tool: Rows
    """Row of ``Moves``, line of the program, index of the tool."""
    spindle_speed: Floats
    """Spindle speed [rev/min]."""
    feed: Floats
    """Highest feed reached [mm/min]."""
    feed_per_tooth: Floats
    thickness: Floats
    """Feed per tooth and thickest chip at that feed [m]."""
    axial_depth: Floats
    radial_depth: Floats
    """Axial and radial depth at the deepest and widest station [m]."""
    cutting_diameter: Floats
    """Greatest diameter at which an edge cuts: D, of a corner what its depth reaches [m]."""
    entry: Floats
    exit: Floats
    """Exit angle of the station with the greatest mean load [rad]."""
    peak: Floats
    mean: Floats
    axial: Floats
    """Load in the plane, its peak and its mean over block and turn; peak along the axis [N]."""
    torque: Floats
    peak_torque: Floats
    """Mean over the turn, and peak, at the station where they are greatest [N m]."""
    power: Floats
    mean_power: Floats
    """Mean power of that torque over the block at its mean feed [W]."""
    seconds: Floats
    air: Floats
    """Time in the material, and time of the rest of the block [s]."""
    volume: Floats
    rate: Floats
    """Removed [m^3]; greatest rate of removal [m^3/s]."""
    load_known: Bools
    """Whether loads are known: where the spindle turns, and not of thread mills."""

    def __len__(self) -> int:
        return len(self.row)

    @property
    def speed(self) -> Floats:
        """Spindle speed [1/s]."""
        return self.spindle_speed / 60


def cut_blocks(cut: Cut, arcs: StationArcs | None = None) -> CutBlocks:
    """The blocks of a cut; rapids through material are not among them."""
    arcs = station_arcs(cut.engagement, cut.tools) if arcs is None else arcs
    engagement, plan = cut.engagement, cut.plan
    row = np.flatnonzero(cut.tool >= 0)
    omega = 2 * np.pi * plan.spindle_speed[row] / 60
    loads, local = cut.block_loads, cut.station_loads
    torque = _greatest(cut, local.torque)[row]
    mean = cut.table.loads(cut.mean_feed_per_tooth)
    worst = _worst_station(cut, local.mean)[row]
    seconds = _sums(cut, cut.in_material)[row]
    section = np.divide(
        engagement.volume,
        engagement.length,
        out=np.zeros(len(engagement)),
        where=engagement.length > 0,
    )
    return CutBlocks(
        row=row,
        line=plan.path.moves.line[row].astype(np.intp),
        tool=cut.tool[row],
        spindle_speed=plan.spindle_speed[row],
        feed=plan.v_peak[row] / METRE_PER_SECOND,
        feed_per_tooth=cut.feed_per_tooth[row],
        thickness=cut.feed_per_tooth[row] * _greatest(cut, arcs.thickness)[row],
        axial_depth=_greatest(cut, engagement.axial_depth)[row],
        radial_depth=_greatest(cut, arcs.radial)[row],
        cutting_diameter=_greatest(cut, arcs.diameter)[row],
        entry=arcs.entry[worst],
        exit=arcs.exit[worst],
        peak=loads.peak[row],
        mean=mean.mean[row],
        axial=loads.axial[row],
        torque=torque,
        peak_torque=loads.peak_torque[row],
        power=torque * omega,
        mean_power=mean.torque[row] * omega,
        seconds=seconds,
        air=np.maximum(plan.motion.time[row] - seconds, 0.0),
        volume=_sums(cut, engagement.volume)[row],
        rate=_greatest(cut, section)[row] * plan.v_peak[row],
        load_known=(plan.spindle_speed[row] > 0)
        & np.array([tool.load_known for tool in cut.tools], dtype=np.bool_)[cut.tool[row]],
    )


def _sums(cut: Cut, values: Floats) -> Floats:
    engagement = cut.engagement
    return np.bincount(engagement.block, values, minlength=engagement.blocks).astype(np.float64)


def _greatest(cut: Cut, values: Floats) -> Floats:
    """Greatest value of each row's stations at feed; 0 without one.  Shape (M,)."""
    out = np.zeros(cut.engagement.blocks)
    fed = cut.engagement.feed
    np.maximum.at(out, cut.engagement.block[fed], values[fed])
    return out


def _worst_station(cut: Cut, values: Floats) -> Rows:
    order = np.lexsort((values, cut.engagement.block))
    worst = np.zeros(cut.engagement.blocks, dtype=np.intp)
    worst[cut.engagement.block[order]] = order  # the last of a row stays
    return worst


BINDS = ("load limit", "spindle drive", "stability")


@dataclass(frozen=True, kw_only=True, eq=False)
class CutLimits:
    """K blocks against their limits; arrays of shape (K,), NaN where nothing is known."""

    drive: Floats
    """Power of the motor over its greatest at that speed, infinite above its top speed [1]."""
    margin: Floats
    """Stability margin [1]."""
    deflection: Floats
    """Deflection of the tip under the peak load; a drill's lips balance each other, it has none
    [m]."""
    used: Floats
    """Share of the limit that binds [1]."""
    binds: NDArray[np.str_]
    """Limit that binds; empty where no limit is known."""


def cut_limits(
    cut: Cut, blocks: CutBlocks, *, limit_load: float | None, drive: SpindleDrive | None,
    margin: Floats | None,
) -> CutLimits:  # fmt: skip
    """Blocks of a cut against their limits.

    ``limit_load`` [N]: load in the plane of tools without their own; ``margin`` (M,): of stability.
    """
    unknown = np.full(len(blocks), np.nan)
    peak = np.where(blocks.load_known, blocks.peak, np.nan)
    most = tool_limits(cut.tools, "load_N", limit_load)[blocks.tool]
    power = unknown if drive is None else _drive_share(blocks, drive)
    stable = unknown if margin is None else margin[blocks.row]
    with np.errstate(divide="ignore"):
        shares = np.stack([
            np.where(np.isfinite(most), peak / most, np.nan),
            power,
            1.0 / (1.0 + stable),
        ])  # fmt: skip
    known = np.where(np.isnan(shares), -np.inf, shares)
    which = known.argmax(axis=0)
    used = known.max(axis=0)
    return CutLimits(
        drive=power,
        margin=stable,
        deflection=_deflection(cut, blocks, peak),
        used=np.where(used > -np.inf, used, np.nan),
        binds=np.where(used > -np.inf, np.array(BINDS)[which], ""),
    )


def _drive_share(blocks: CutBlocks, drive: SpindleDrive) -> Floats:
    most = available_power(blocks.speed, drive)
    needed = motor_power(blocks.torque, blocks.speed, drive)
    share = np.divide(needed, most, out=np.full(len(most), np.inf), where=most > 0)
    return np.where(blocks.load_known, share, np.nan)


def _deflection(cut: Cut, blocks: CutBlocks, peak: Floats) -> Floats:
    deflection = np.full(len(blocks), np.nan)
    for tool in np.unique(blocks.tool).tolist():
        mine = blocks.tool == tool
        if cut.tools[tool].stickout is not None and cut.tools[tool].kind != "drill":
            deflection[mine] = tip_deflection(cut.tools[tool], peak[mine])
    return deflection
