"""Limits of a cut (load, spindle drive, stability), and warnings before the part is cut."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, motor_power
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics, rigid_directions
from pipeline.cutting.tool import tip_deflection, tool_limits
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.program_cut import CutWarning
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks

WORN = 0.3e-3
"""Width of the flank's land of a worn tool, ISO 8688-2 [m]."""
BINDS = ("load limit", "spindle drive", "stability")


@dataclass(frozen=True, kw_only=True, eq=False)
class CutLimits:
    """K blocks against their limits; arrays of shape (K,), NaN where nothing is known."""

    drive: Floats
    """Power of the motor over its greatest at that speed, infinite above its top speed [1]."""
    margin: Floats
    """Of stability [1]."""
    deflection: Floats
    """Deflection of the tip under the peak load; a drill's lips balance each other, it has none
    [m]."""
    used: Floats
    """Share of the limit that binds [1]."""
    binds: NDArray[np.str_]
    """Which one that is; empty where no limit is known."""


def cut_limits(
    cut: Cut, blocks: CutBlocks, *, limit_load: float | None, drive: SpindleDrive | None,
    margin: Floats | None,
) -> CutLimits:  # fmt: skip
    """Blocks of a cut against their limits.

    Parameters
    ----------
    cut : Cut
        Of a program.
    blocks : CutBlocks
        Its blocks.
    limit_load : float or None
        Of the load in the plane, of tools without their own [N].
    drive : SpindleDrive or None
        Of the spindle.
    margin : ndarray, shape (M,), or None
        Of stability, by row.
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


def cut_warnings(
    cut: Cut, blocks: CutBlocks, limits: CutLimits, limit_load: float | None, *,
    dynamics: TipDynamics | None, drive: SpindleDrive | None, stock: str,
) -> list[CutWarning]:  # fmt: skip
    """Warnings before the part is cut.

    Chatter is grave only where the tips' ``dynamics`` were measured.
    """
    measured = dynamics is not None and dynamics.measured
    standing = blocks.row[blocks.spindle_speed <= 0]
    warnings = [
        _warning(cut, np.flatnonzero(cut.engagement.rapid_depth), "rapids go through the material",
                 "Retract further, or move around the blank.", grave=True),
        _warning(cut, standing, "the spindle stands while the tool is fed into the material",
                 "Program S and M3 before it.", grave=True),
        _too_fast(cut, blocks, drive),
        _warning(cut, blocks.row[(limits.drive > 1) & np.isfinite(limits.drive)],
                 "the spindle’s drive cannot give the power",
                 "Lower feed or depth, or another speed.", grave=True),
        _warning(cut, blocks.row[limits.margin < 0],
                 "blocks chatter" if measured else "blocks may chatter",
                 "Less depth, or a speed between the lobes" + (
                     "." if measured else "; the tips’ dynamics were not measured: tap them."
                 ), grave=measured),
        _warning(cut, _too_deep(cut, blocks), "cuts are deeper than the tool’s flutes are long",
                 "A longer tool, or more passes."),
        _warning(cut, _below(cut), "the tool goes below the blank’s underside",
                 "Check what the blank lies on."),
    ]  # fmt: skip
    most = tool_limits(cut.tools, "load_N", limit_load)[blocks.tool]
    for value in np.unique(most[np.isfinite(most)])[::-1].tolist():
        over = blocks.row[(most == value) & (blocks.peak > value)]
        what = f"the load passes its limit of {value:g} N"
        warnings.insert(1, _warning(cut, over, what, "Lower the feed of these blocks.", grave=True))
    warnings += [
        missed_blank(cut, stock), *_rigid(cut, blocks, dynamics), _unseen(dynamics),
        _damped(cut, blocks, limits, dynamics),
    ]  # fmt: skip
    return [one for one in warnings if one is not None]


def _warning(cut: Cut, rows: Rows, what: str, do: str, *, grave: bool = False) -> CutWarning | None:
    if not len(rows):
        return None
    lines = tuple(dict.fromkeys(cut.plan.path.moves.line[np.sort(rows)].tolist()))
    return CutWarning(what=what, do=do, lines=lines, blocks=len(rows), grave=grave)


def _too_fast(cut: Cut, blocks: CutBlocks, drive: SpindleDrive | None) -> CutWarning | None:
    if drive is None:
        return None
    over = blocks.spindle_speed > drive.top_speed_rpm * (1 + 1e-9)
    fastest = float(blocks.spindle_speed[over].max(initial=0.0))
    what = f"{fastest:g} rev/min is above the top speed {drive.top_speed_rpm:g} of the drive"
    return _warning(cut, blocks.row[over], what, "Lower S.", grave=True)


SMALL = 10.0
"""Extent of the moves at feed over the blank's, along X or Y, from which it may be in inches."""


def missed_blank(cut: Cut, stock: str) -> CutWarning | None:
    """Said where no move at feed meets the blank, or where it is as small as one in inches."""
    blank, pieces = cut.blank, cut.path.pieces
    if not pieces.feed.any():
        return None
    ends = np.concatenate([pieces.start[pieces.feed], pieces.end[pieces.feed]])
    rows, columns = blank.heights.shape
    low = [blank.x0, blank.y0, blank.floor]
    high = [
        blank.x0 + columns * blank.cell, blank.y0 + rows * blank.cell, float(blank.heights.max()),
    ]  # fmt: skip
    small = bool((np.ptp(ends, axis=0) > SMALL * np.subtract(high, low))[:2].any())
    if not small and (cut.tool >= 0).any():
        return None
    fed, held = _spans(ends.min(axis=0), ends.max(axis=0)), _spans(low, high)
    inch = small or stock.lower().endswith(".stl")
    return CutWarning(
        what=f"the blank {stock} is not where the program cuts: feed moves span {fed} mm, the "
        f"blank {held} mm{' (is it in inches? it is read in mm)' * inch}",
        do=f"Give the blank in the coordinates of {cut.path.frame.name}, or name another work "
        "offset.",
        grave=True,
    )


def _spans(low: ArrayLike, high: ArrayLike) -> str:
    """Ranges [mm] of points [m]."""
    ends = zip("XYZ", np.asarray(low) * 1e3, np.asarray(high) * 1e3, strict=True)
    return ", ".join(f"{axis} {round(a, 2) + 0:g}..{round(b, 2) + 0:g}" for axis, a, b in ends)


def _rigid(cut: Cut, blocks: CutBlocks, dynamics: TipDynamics | None) -> list[CutWarning]:
    """Tools whose tip is known along one axis only: the other counts as rigid."""
    if dynamics is None:
        return []
    tips = dynamics.of(cut.numbers)
    stiff: dict[str, list[str]] = {}
    for tool in np.unique(blocks.tool).tolist():
        for name in rigid_directions(tip) if (tip := tips[tool]) else ():
            stiff.setdefault(name, []).append(f"T{cut.numbers[tool]}")
    return [
        CutWarning(
            what=f"the tips of {', '.join(tools)} have no modes along {name}: they count as rigid "
            "there, and the stability may be far off",
            do=f"Write the modes along {name} in the machine’s section dynamics too.",
        )
        for name, tools in stiff.items()
    ]


def _unseen(dynamics: TipDynamics | None) -> CutWarning | None:
    """What the measurement of the tips does not show."""
    if dynamics is None or not dynamics.caution:
        return None
    return CutWarning(
        what=f"{dynamics.caution}: the stability may be too high there",
        do="Measure the tips to a higher frequency.",
    )


def _damped(
    cut: Cut, blocks: CutBlocks, limits: CutLimits, dynamics: TipDynamics | None
) -> CutWarning | None:
    """Blocks said to chatter whose waves are so short that process damping may still hold them.

    A wave is v_c / f long; a flank that is worn to ``WORN`` rubs along a quarter of it where that
    is no longer than the land.
    """
    if dynamics is None:
        return None
    tips = dynamics.of(cut.numbers)
    slowest = np.array([_lowest_mode_Hz(tip) for tip in tips])[blocks.tool]
    radius = np.array([tool.radius for tool in cut.tools])[blocks.tool]
    speed = 2 * np.pi * radius * blocks.spindle_speed / 60
    wave = np.divide(speed, slowest, out=np.full(len(speed), np.inf), where=slowest > 0)
    short = (limits.margin < 0) & (wave < 4 * WORN)
    if not short.any():
        return None
    return _warning(
        cut, blocks.row[short],
        f"waves of the tip's vibration are as short as {wave[short].min() * 1e3:.2g} mm: process "
        "damping, which is not counted, may let these blocks cut deeper, by how much is not known",
        "Try the cut with care, or identify the process damping; do not count on it.",
    )  # fmt: skip


def _lowest_mode_Hz(tip: Sequence[Mode] | None) -> float:
    """Natural frequency of the lowest mode [Hz]; 0 where none is known."""
    if tip is None:
        return 0.0
    return min(mode.natural_frequency_Hz for mode in tip)


def _too_deep(cut: Cut, blocks: CutBlocks) -> Rows:
    long = np.array([np.inf if t.flute_length_mm is None else t.flute_length_mm for t in cut.tools])
    # depth is known to a cell's height error of a surface that another tool has left
    return blocks.row[blocks.axial_depth * 1e3 > long[blocks.tool] + 1e-6]


def _below(cut: Cut) -> Rows:
    """Rows whose tip is below the blank's floor by more than a cell, within its outline."""
    blank, pieces = cut.blank, cut.path.pieces
    rows, columns = blank.heights.shape
    radius = np.array([tool.radius for tool in cut.tools])[pieces.tool]
    below = np.minimum(pieces.start[:, 2], pieces.end[:, 2]) < blank.floor - blank.cell
    for axis, low, many in ((0, blank.x0, columns), (1, blank.y0, rows)):
        ends = pieces.start[:, axis], pieces.end[:, axis]
        below &= np.maximum(*ends) > low - radius
        below &= np.minimum(*ends) < low + many * blank.cell + radius
    return np.unique(pieces.block[below]).astype(np.intp)
