"""What a part costs: the tools it wears out, the machine's and the operator's time, electricity.

C_p = C_t + C_m with C_t = (T_p / T_l) P_t and C_m = (T_p + T_c T_p / T_l) (E_p + C_d) (Sim2023),
where T_p / T_l is the share of tool life spent; here by block, so that each block may have its own
tool, speed and power.  Electricity is counted by the kWh, not by the hour.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.amounts import amounts
from pipeline.cutting.tool import Tool

Floats = NDArray[np.float64]

HOUR = 3600.0
MINUTE = 60.0


@dataclass(frozen=True, kw_only=True)
class CostRates:
    """What time and electricity cost.

    Parameters
    ----------
    currency : str
        Of all prices, those of the tool table included.
    labour_per_h : float
        Operator [currency / h].
    machine_per_h : float
        Machine, without electricity and tools [currency / h].
    energy_per_kWh : float
        Electricity [currency / kWh].
    tool_change_min : float
        To change a worn tool for a new one [min]; not the changes that the program commands, which
        are in its time.

    Raises
    ------
    ValueError
        When a value is negative or no number.
    """

    currency: str
    labour_per_h: float
    machine_per_h: float = 0.0
    energy_per_kWh: float = 0.0
    tool_change_min: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "currency" and not 0.0 <= value < 1e12:
                raise ValueError(f"cost.{item.name} = {value} is out of its range, 0 to 1e12")

    @property
    def per_second(self) -> float:
        """Of machine and operator [currency / s]."""
        return (self.labour_per_h + self.machine_per_h) / HOUR

    @property
    def tool_change(self) -> float:
        """T_c [s]."""
        return self.tool_change_min * MINUTE


@dataclass(frozen=True, kw_only=True, eq=False)
class PartCost:
    """Cost of each block; leading axes are free, so that it holds a population.

    Parameters
    ----------
    time : ndarray, shape (..., B)
        Machine and operator while the program runs.
    tool : ndarray, shape (..., B)
        Tools worn, C_t; NaN where their life is not known.
    change : ndarray, shape (..., B)
        Machine and operator while worn tools are changed; NaN as ``tool``.
    energy : ndarray, shape (..., B)
        Electricity.
    """

    time: Floats
    tool: Floats
    change: Floats
    energy: Floats

    @property
    def block(self) -> Floats:
        """All of it for each block; NaN where the tool's life is not known.  Shape (..., B)."""
        return self.time + self.tool + self.change + self.energy

    @property
    def total(self) -> Floats:
        """Of the part, C_p; NaN when the life of a tool that cuts is not known.  Shape (...)."""
        total: Floats = self.block.sum(axis=-1)
        return total

    @property
    def machine(self) -> Floats:
        """Of the part without its tools: time and electricity.  Shape (...)."""
        total: Floats = (self.time + self.energy).sum(axis=-1)
        return total

    def by_tool(self, tool: ArrayLike, tools: int) -> Floats:
        """Cost of the blocks of each tool.

        Parameters
        ----------
        tool : array_like of int, shape (B,)
            Index of the tool that each block is cut with.
        tools : int
            How many there are, K.

        Returns
        -------
        ndarray, shape (..., K)

        Raises
        ------
        ValueError
            When there is not one tool for each block, or an index is none of a tool.
        """
        block, index = self.block, np.asarray(tool)
        if index.shape != block.shape[-1:]:
            raise ValueError(
                f"tool has the shape {index.shape}, there are {block.shape[-1]} blocks: give each "
                "the index of its tool"
            )
        strange = ~np.isin(index, np.arange(tools))
        if strange.any():
            raise ValueError(
                f"tool {index[strange][0]} of a block is none of {tools} tools: their indices are "
                f"0 to {tools - 1}"
            )
        return np.stack([block[..., index == k].sum(axis=-1) for k in range(tools)], axis=-1)


def life_price(tool: Tool) -> float:
    """What one life of the tool costs, P_t: its price over its edges."""
    return tool.price / tool.edges


def part_cost(
    rates: CostRates, *, times: ArrayLike, wear: ArrayLike, life_prices: ArrayLike,
    energy_kWh: ArrayLike = 0.0,
) -> PartCost:  # fmt: skip
    """Cost of each block of a program.

    Parameters
    ----------
    rates : CostRates
        What time and electricity cost.
    times : array_like, shape (..., B)
        Of each block, cut or not [s].
    wear : array_like, shape (..., B)
        Share of its tool's life that each takes [1], see :func:`pipeline.cutting.tool_life.wear`;
        0 in air, NaN where the life is not known.
    life_prices : array_like, shape (B,) or ()
        What one life of each block's tool costs, see :func:`life_price`.
    energy_kWh : array_like, shape (..., B)
        Electricity that each takes [kWh].

    Raises
    ------
    ValueError
        When one of them is negative, infinite, or no number where that is not provided for.

    Examples
    --------
    >>> rates = CostRates(currency="EUR", labour_per_h=36.0, tool_change_min=1.0)
    >>> cost = part_cost(rates, times=[100.0], wear=[0.1], life_prices=20.0)
    >>> float(cost.tool[0]), float(cost.time[0]), round(float(cost.change[0]), 3)
    (2.0, 1.0, 0.06)
    """
    spent, used = amounts("times", times), amounts("energy_kWh", energy_kWh)
    share, price = amounts("wear", wear, unknown=True), amounts("life_prices", life_prices)
    shape = np.broadcast_shapes(spent.shape, share.shape, used.shape)
    share = np.broadcast_to(share, shape)
    return PartCost(
        time=np.broadcast_to(spent * rates.per_second, shape),
        tool=share * price,
        change=share * (rates.tool_change * rates.per_second),
        energy=np.broadcast_to(used * rates.energy_per_kWh, shape),
    )
