"""The cut block by block: chip, depths, loads, power, removal rate and time in the material."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import METRE_PER_SECOND
from pipeline.twin.cut import Cut
from pipeline.twin.cut_stations import Stations, stations

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class CutBlocks:
    """K blocks that cut at feed; every array has shape (K,).

    Parameters
    ----------
    row, line, tool : ndarray of int
        Row of ``Moves``, line of the program, index of the tool.
    turns : ndarray
        Of the spindle [rev/min].
    feed : ndarray
        Highest feed reached [mm/min].
    feed_per_tooth, thickness : ndarray
        At that feed: f_z, and the thickest chip [m].
    axial_depth, radial_depth : ndarray
        At the deepest and widest station [m].
    entry, exit : ndarray
        Of the station with the greatest mean load [rad].
    peak, mean, axial : ndarray
        Load in the plane, its peak and its mean over block and turn; peak along the axis [N].
    torque, peak_torque : ndarray
        Mean over the turn, and peak, at the station where they are greatest [N m].
    power, mean_power : ndarray
        Of that torque; mean over the block at its mean feed [W].
    seconds, air : ndarray
        Time in the material, and time of the rest of the block [s].
    volume, rate : ndarray
        Removed [m^3]; greatest rate of removal [m^3/s].
    """

    row: Indices
    line: Indices
    tool: Indices
    turns: Floats
    feed: Floats
    feed_per_tooth: Floats
    thickness: Floats
    axial_depth: Floats
    radial_depth: Floats
    entry: Floats
    exit: Floats
    peak: Floats
    mean: Floats
    axial: Floats
    torque: Floats
    peak_torque: Floats
    power: Floats
    mean_power: Floats
    seconds: Floats
    air: Floats
    volume: Floats
    rate: Floats

    def __len__(self) -> int:
        return len(self.row)

    @property
    def speed(self) -> Floats:
        """Of the spindle [1/s]."""
        return self.turns / 60


def cut_blocks(cut: Cut, arcs: Stations | None = None) -> CutBlocks:
    """The blocks of a cut; rapids through material are not among them."""
    arcs = stations(cut.engagement, cut.tools) if arcs is None else arcs
    found, plan = cut.engagement, cut.plan
    row = np.flatnonzero(cut.tool >= 0)
    omega = 2 * np.pi * plan.spindle_speed[row] / 60
    loads, local = cut.block_loads, cut.station_loads
    torque = _greatest(cut, local.torque)[row]
    mean = cut.table.loads(cut.mean_feed_per_tooth)
    worst = _worst_station(cut, local.mean)[row]
    seconds = _sums(cut, cut.in_material)[row]
    section = np.divide(
        found.volume, found.length, out=np.zeros(len(found)), where=found.length > 0
    )
    return CutBlocks(
        row=row,
        line=plan.path.moves.line[row].astype(np.intp),
        tool=cut.tool[row],
        turns=plan.spindle_speed[row],
        feed=plan.v_peak[row] / METRE_PER_SECOND,
        feed_per_tooth=cut.feed_per_tooth[row],
        thickness=cut.feed_per_tooth[row] * _greatest(cut, arcs.thickness)[row],
        axial_depth=_greatest(cut, found.axial_depth)[row],
        radial_depth=_greatest(cut, arcs.radial)[row],
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
        volume=_sums(cut, found.volume)[row],
        rate=_greatest(cut, section)[row] * plan.v_peak[row],
    )


def _sums(cut: Cut, values: Floats) -> Floats:
    """Sum over each row's stations; shape (M,)."""
    found = cut.engagement
    return np.bincount(found.block, values, minlength=found.blocks).astype(np.float64)


def _greatest(cut: Cut, values: Floats) -> Floats:
    """Greatest value of each row's stations at feed; 0 without one.  Shape (M,)."""
    out = np.zeros(cut.engagement.blocks)
    fed = cut.engagement.feed
    np.maximum.at(out, cut.engagement.block[fed], values[fed])
    return out


def _worst_station(cut: Cut, values: Floats) -> Indices:
    """Station of each row where ``values`` are greatest; shape (M,)."""
    order = np.lexsort((values, cut.engagement.block))
    worst = np.zeros(cut.engagement.blocks, dtype=np.intp)
    worst[cut.engagement.block[order]] = order  # the last of a row stays
    return worst
