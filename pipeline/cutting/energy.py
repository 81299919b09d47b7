"""Electricity of a program: spindle, feed drives, coolant, and what is always on.

The spindle's drive takes (P_c + P_0(n)) / (eta eta_m) while it turns: cutting power and no-load
losses over the efficiency from the motor's shaft to the tool, and over that of motor and inverter.
What it takes to speed the spindle up, and gives back where the drive can, is left out: it belongs
to the changes of speed, not to the blocks.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.amounts import amounts
from pipeline.cutting.spindle_power import SpindleDrive, shaft_power

Floats = NDArray[np.float64]

KW = 1e3
KWH = 3.6e6


@dataclass(frozen=True, kw_only=True)
class EnergyParameters:
    """Power of a machine without its spindle.

    Parameters
    ----------
    base_load_kW : float
        Control, hydraulics, fans, lubrication: as long as the machine is on [kW].
    drives_kW : float
        Feed drives while an axis moves [kW].
    coolant_kW : float
        Pumps while coolant is on [kW].

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    base_load_kW: float
    drives_kW: float = 0.0
    coolant_kW: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not 0.0 <= value <= 1000.0:
                raise ValueError(f"energy.{item.name} = {value} is out of its range, 0 to 1000")


@dataclass(frozen=True, kw_only=True, eq=False)
class Energy:
    """Electricity of each block [kWh]; arrays of shape (..., B)."""

    spindle: Floats
    drives: Floats
    coolant: Floats
    base: Floats

    @property
    def block(self) -> Floats:
        """All of it for each block [kWh]; shape (..., B)."""
        return self.spindle + self.drives + self.coolant + self.base

    @property
    def total(self) -> Floats:
        """Of the program [kWh]; shape (...)."""
        total: Floats = self.block.sum(axis=-1)
        return total


def spindle_supply(cutting: ArrayLike, no_load: ArrayLike, drive: SpindleDrive) -> Floats:
    """Electrical power that the spindle's drive takes, (P_c + P_0) / (eta eta_m) [W].

    Parameters
    ----------
    cutting : array_like
        P_c = F_t v_c at the tool [W].
    no_load : array_like
        P_0(n), what the spindle takes turning free [W]; 0 where it stands.
    drive : SpindleDrive
        With its efficiencies eta and eta_m.

    Raises
    ------
    ValueError
        When a power is negative or not finite.

    Examples
    --------
    >>> drive = SpindleDrive(
    ...     rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0,
    ...     efficiency=0.9, motor_efficiency=0.8,
    ... )
    >>> round(float(spindle_supply(900.0, 180.0, drive)), 6)
    1500.0
    """
    power = shaft_power(amounts("cutting", cutting), amounts("no_load", no_load), drive)
    return power / drive.motor_efficiency


def energy(
    parameters: EnergyParameters, *, times: ArrayLike, spindle_W: ArrayLike,
    moving: ArrayLike = 1.0, coolant: ArrayLike = 0.0,
) -> Energy:  # fmt: skip
    """Electricity of each block.

    Parameters
    ----------
    parameters : EnergyParameters
        Of the machine.
    times : array_like, shape (..., B)
        Of each block [s].
    spindle_W : array_like, shape (..., B)
        Mean electrical power of the spindle's drive [W], see :func:`spindle_supply`.
    moving, coolant : array_like, shape (..., B)
        Share of the time in which axes move, in which coolant is on [1].

    Raises
    ------
    ValueError
        When a time or power is negative or not finite, or a share is not from 0 to 1.
    """
    spent, supply = amounts("times", times), amounts("spindle_W", spindle_W)
    shares = amounts("moving", moving, high=1.0), amounts("coolant", coolant, high=1.0)
    spent, supply, drives, pumps = np.broadcast_arrays(spent, supply, *shares)
    kWh = spent / KWH
    return Energy(
        spindle=kWh * supply,
        drives=kWh * drives * (parameters.drives_kW * KW),
        coolant=kWh * pumps * (parameters.coolant_kW * KW),
        base=kWh * (parameters.base_load_kW * KW),
    )
