"""Limits of a cut: load, spindle drive, stability."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, motor_power
from pipeline.cutting.tool import tip_deflection, tool_limits
from pipeline.schema.arrays import Floats
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.loads import Cut

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
