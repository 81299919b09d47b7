"""How near each block of a cut comes to what binds it: load, drive, stability."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.deflection import tip_deflection
from pipeline.cutting.spindle_power import SpindleDrive, available_power, motor_power
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks

Floats = NDArray[np.float64]

BINDS = ("load limit", "spindle drive", "stability")


@dataclass(frozen=True, kw_only=True, eq=False)
class CutLimits:
    """K blocks against their limits; arrays of shape (K,), NaN where nothing is known.

    Parameters
    ----------
    drive : ndarray
        Power of the motor over what it can give at that speed, infinite above its top speed [1].
    margin : ndarray
        Of stability [1].
    deflection : ndarray
        Of the tip under the peak load; a drill's lips balance each other, it has none [m].
    used : ndarray
        Share of the limit that binds [1].
    binds : ndarray of str
        Which one that is; empty where no limit is known.
    """

    drive: Floats
    margin: Floats
    deflection: Floats
    used: Floats
    binds: NDArray[np.str_]


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
        Of the load in the plane [N].
    drive : SpindleDrive or None
        Of the spindle.
    margin : ndarray, shape (M,), or None
        Of stability, by row.
    """
    unknown = np.full(len(blocks), np.nan)
    peak = np.where(blocks.turns > 0, blocks.peak, np.nan)  # no chip, no load that a law tells
    power = unknown if drive is None else _drive_share(blocks, drive)
    stable = unknown if margin is None else margin[blocks.row]
    with np.errstate(divide="ignore"):
        shares = np.stack([
            unknown if limit_load is None else peak / limit_load,
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
    asked = motor_power(blocks.torque, blocks.speed, drive)
    share = np.divide(asked, most, out=np.full(len(most), np.inf), where=most > 0)
    return np.where(blocks.turns > 0, share, np.nan)


def _deflection(cut: Cut, blocks: CutBlocks, peak: Floats) -> Floats:
    found = np.full(len(blocks), np.nan)
    for tool in np.unique(blocks.tool).tolist():
        mine = blocks.tool == tool
        if cut.tools[tool].stickout is not None and cut.tools[tool].kind != "drill":
            found[mine] = tip_deflection(cut.tools[tool], peak[mine])
    return found
