"""Electricity and cost of a part: tools, time of machine and operator, energy.

The spindle's drive takes (P_c + P_0(n)) / (eta eta_m) while it turns: cutting power and no-load
losses over the efficiency from the motor's shaft to the tool, and over that of motor and inverter.
Energy to speed the spindle up, and energy that a drive recovers, are left out: they belong to the
changes of speed, not to the blocks.

C_p = C_t + C_m with C_t = (T_p / T_l) P_t and C_m = (T_p + T_c T_p / T_l) (E_p + C_d) (Sim2023),
where T_p / T_l is the share of tool life spent; here by block, so that each block may have its own
tool, speed and power.  Electricity is counted by the kWh, not by the hour.
"""

from dataclasses import dataclass, fields
from typing import Annotated, cast

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.spindle_power import SpindleDrive, shaft_power
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.si import HOUR, KW, KWH, MINUTE


@dataclass(frozen=True, kw_only=True)
class EnergyParameters(Ranged, section="energy"):
    """Power of a machine without its spindle."""

    base_load_kW: Annotated[float, Range(least=0.0, most=1000.0)]
    """Control, hydraulics, fans, lubrication: as long as the machine is on [kW]."""
    drives_kW: Annotated[float, Range(least=0.0, most=1000.0)] = 0.0
    """Feed drives while an axis moves [kW]."""
    coolant_kW: Annotated[float, Range(least=0.0, most=1000.0)] = 0.0
    """Pumps while coolant is on [kW]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ByBlock:
    """Parts of an amount by block, arrays of shape (..., B); leading axes are a population's."""

    @property
    def block(self) -> Floats:
        """All of it for each block; shape (..., B)."""
        return cast(Floats, sum(getattr(self, part.name) for part in fields(self)))

    @property
    def total(self) -> Floats:
        """All of it for the program; shape (...)."""
        return cast(Floats, self.block.sum(axis=-1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Energy(ByBlock):
    """Electricity of each block [kWh]."""

    spindle: Floats
    drives: Floats
    coolant: Floats
    base: Floats


def spindle_supply(cutting: ArrayLike, no_load: ArrayLike, drive: SpindleDrive) -> Floats:
    """Electrical power of the spindle drive, (P_c + P_0) / (eta eta_m) [W].

    ``cutting`` is P_c = F_t v_c at the tool [W], ``no_load`` P_0(n) of the spindle [W], 0 at
    standstill.

    Examples
    --------
    >>> drive = SpindleDrive(
    ...     rated_power_kW=11.0, base_speed_rpm=1500.0, top_speed_rpm=8000.0,
    ...     efficiency=0.9, motor_efficiency=0.8,
    ... )
    >>> round(float(spindle_supply(900.0, 180.0, drive)), 6)
    1500.0
    """
    return shaft_power(cutting, no_load, drive) / drive.motor_efficiency


def energy(
    parameters: EnergyParameters, *, times: ArrayLike, spindle_W: ArrayLike,
    moving: ArrayLike = 1.0, coolant: ArrayLike = 0.0,
) -> Energy:  # fmt: skip
    """Electrical energy of each block, all arrays of shape (..., B).

    ``times`` are the blocks' [s], ``spindle_W`` the mean electrical power of the spindle drive [W]
    (:func:`spindle_supply`), ``moving`` and ``coolant`` the shares of the time with axes in motion
    and with coolant [1].
    """
    spent, supply, drives, pumps = np.broadcast_arrays(
        *(np.asarray(one, dtype=np.float64) for one in (times, spindle_W, moving, coolant))
    )
    kWh = spent / KWH
    return Energy(
        spindle=kWh * supply,
        drives=kWh * drives * (parameters.drives_kW * KW),
        coolant=kWh * pumps * (parameters.coolant_kW * KW),
        base=kWh * (parameters.base_load_kW * KW),
    )


Amount = Annotated[float, Range(least=0.0, below=1e12)]
"""Price or time of one item."""


@dataclass(frozen=True, kw_only=True)
class CostRates(Ranged, section="cost"):
    """Prices of time and electricity."""

    currency: str
    """Currency of all prices, those of the tool table included."""
    labour_per_h: Amount
    """Operator [currency / h]."""
    machine_per_h: Amount = 0.0
    """Machine, without electricity and tools [currency / h]."""
    energy_per_kWh: Amount = 0.0
    """Electricity [currency / kWh]."""
    tool_change_min: Amount = 0.0
    """Time to replace a worn tool [min]; without the tool changes that the program commands."""

    @property
    def per_second(self) -> float:
        """Hourly rate of machine and operator [currency / s]."""
        return (self.labour_per_h + self.machine_per_h) / HOUR

    @property
    def tool_change(self) -> float:
        """T_c [s]."""
        return self.tool_change_min * MINUTE


@dataclass(frozen=True, kw_only=True, eq=False)
class PartCost(ByBlock):
    """Cost of each block; the total is C_p, NaN when the life of a cutting tool is unknown."""

    time: Floats
    """Machine and operator while the program runs."""
    tool: Floats
    """Tools worn, C_t; NaN without a life."""
    change: Floats
    """Machine and operator while worn tools are changed; NaN as ``tool``."""
    energy: Floats
    """Electricity."""


def life_price(tool: Tool) -> float:
    """Cost of one life of the tool, P_t: its price over its edges."""
    return tool.price / tool.edges


def part_cost(
    rates: CostRates, *, times: ArrayLike, wear: ArrayLike, life_prices: ArrayLike,
    energy_kWh: ArrayLike = 0.0,
) -> PartCost:  # fmt: skip
    """Cost of each block of a program.

    ``times`` are the blocks', in the cut or not [s], ``energy_kWh`` their electricity, ``wear`` the
    share of the tool's life [1] (:func:`pipeline.cutting.economics.material.wear`), 0 in air, NaN
    where the life is not determined, each of shape (..., B); ``life_prices`` (B,) or () the cost of
    one life of each block's tool (:func:`life_price`).

    Examples
    --------
    >>> rates = CostRates(currency="EUR", labour_per_h=36.0, tool_change_min=1.0)
    >>> cost = part_cost(rates, times=[100.0], wear=[0.1], life_prices=20.0)
    >>> float(cost.tool[0]), float(cost.time[0]), round(float(cost.change[0]), 3)
    (2.0, 1.0, 0.06)
    """
    spent, used, share, price = (
        np.asarray(one, dtype=np.float64) for one in (times, energy_kWh, wear, life_prices)
    )
    shape = np.broadcast_shapes(spent.shape, share.shape, used.shape)
    share = np.broadcast_to(share, shape)
    return PartCost(
        time=np.broadcast_to(spent * rates.per_second, shape),
        tool=share * price,
        change=share * (rates.tool_change * rates.per_second),
        energy=np.broadcast_to(used * rates.energy_per_kWh, shape),
    )
