"""What a spindle's drive lets each row of a cut have, at any speed."""

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive, available_power, no_load_power
from pipeline.optimisation.problem.bounds import inverse
from pipeline.optimisation.settings import CutLimit
from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]


def allowed_power(turns: Floats, drive: SpindleDrive, limits: CutLimit) -> Floats:
    """Of the motor [W] at speeds [rev/min]: its share, less the margin of torque below the base
    speed and that of power from there on; 0 above the top speed.
    """
    n = turns / 60
    margins = limits.margins
    margin = np.where(n < drive.base_speed, margins.torque, margins.power)
    power = np.nan_to_num(available_power(n, drive), nan=0.0)
    allowed: Floats = limits.power_share * (1 - margin) * power
    return allowed


def allowed_torque(turns: Floats, drive: SpindleDrive, limits: CutLimit) -> Floats:
    """Mean torque over a turn that a cut may take [N m]; below 0 where idling takes all."""
    n = turns / 60
    cutting = allowed_power(turns, drive, limits) * drive.efficiency - no_load_power(n, drive)
    torque: Floats = np.divide(
        cutting, 2 * np.pi * n, out=np.full(n.shape, -np.inf), where=n > 0
    )  # fmt: skip
    return torque


def power_feeds(
    cut: Cut, torque: Floats, turns: Floats, drive: SpindleDrive, limits: CutLimit
) -> Floats:
    """Greatest feed for each tooth that the drive allows [m].

    Parameters
    ----------
    cut : Cut
        Of M rows.
    torque : ndarray, shape (M, K + 1)
        Of each row's hardest station at the nodes of the load table [N m].
    turns : ndarray, shape (..., M)
        Of the spindle [rev/min].
    drive : SpindleDrive
        Of the machine.
    limits : CutLimit
        Share of its power, margins.

    Returns
    -------
    ndarray, shape of ``turns``
        0 where idling takes all, or the drive does not turn so fast.
    """
    return inverse(cut, torque, allowed_torque(turns, drive, limits))
