"""Tool life after Taylor, spent block by block.

V T^n = C with V [m/min] and T [min] (Taylor 1907); extended by the feed for each tooth, the axial
and the radial depth, V T^n (f_z/f_0)^a (a_p/a_0)^b (a_e/e_0)^c = C.  Where speed and depths change,
shares of life t_i / T(V_i) add up until they make one (Miner's rule, as for fatigue).  Constants
hold for the speeds of their tests; life at a speed far from those is an extrapolation.  Sources
differ by maker, grade and cut: their spread is an interval of C and of n, and that of a life or a
wear is over its four ends.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.si import MINUTE, MM


def not_negative(
    name: str, values: ArrayLike, *, high: float = np.inf, unknown: bool = False
) -> Floats:
    """Values as an array, after a look at their range.

    ``high`` is the greatest value that is one, and infinity is none; ``unknown`` allows NaN.
    ValueError when one is negative, infinite, above ``high`` or no number.
    """
    array = np.asarray(values, dtype=np.float64)
    good = (array >= 0.0) & (array <= high) & (array < np.inf)
    if unknown:
        good |= np.isnan(array)
    if not good.all():
        upper = "and finite" if high == np.inf else f"at most {high:g}"
        raise ValueError(f"{name} = {array[~good].flat[0]} must be 0 or more, {upper}")
    return array


Condition = Literal["f_z", "a_p", "a_e"]
NONE: Mapping[Condition, ArrayLike] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Taylor(Ranged, section="taylor"):
    """Constants of one pair of tool and material; an exponent needs its reference value."""

    n: Annotated[float, Range(least=0.01, most=0.99)]
    """Exponent of life [1]: about 0.125 for high-speed steel, 0.25 for cemented carbide."""
    C_m_min: Annotated[float, Range(least=0.1, most=1e5)]
    """Cutting speed for a life of ``life_min`` [m/min], at the reference values below."""
    life_min: Annotated[float, Range(least=0.1, most=1e4)] = 1.0
    """Life that C belongs to [min]: Taylor's is 1, makers' tables have 15 to 60."""
    C_range_m_min: tuple[float, ...] = ()
    n_range: tuple[float, ...] = ()
    """Least and greatest C [m/min] and n [1] by the sources; empty where there is no spread."""
    uncoated: Annotated[float, Range(least=0.1, most=1.0)] = 1.0
    """C of an uncoated tool over that of others [1]."""
    f_z_exponent: Annotated[float, Range(least=0.0, most=3.0)] = 0.0
    a_p_exponent: Annotated[float, Range(least=0.0, most=3.0)] = 0.0
    a_e_exponent: Annotated[float, Range(least=0.0, most=3.0)] = 0.0
    """a, b, c above [1]; 0 leaves the condition out."""
    f_z_ref_mm: Annotated[float, Range(least=1e-4, most=10.0)] | None = None
    a_p_ref_mm: Annotated[float, Range(least=1e-3, most=1000.0)] | None = None
    a_e_ref_mm: Annotated[float, Range(least=1e-3, most=1000.0)] | None = None
    """Feed per tooth, axial and radial depth of C [mm]; needed with an exponent."""
    speed_range_m_min: tuple[float, ...] = ()
    """Lowest and highest cutting speed of the tests [m/min]."""
    source: str = ""
    """Source of the constants."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("f_z", "a_p", "a_e"):
            if getattr(self, f"{name}_exponent") and getattr(self, f"{name}_ref_mm") is None:
                raise ValueError(
                    f"taylor.{name}_exponent = {getattr(self, f'{name}_exponent')} needs the value "
                    f"that C belongs to: write {name}_ref_mm"
                )
        values = {"C_range_m_min": self.C_m_min, "n_range": self.n, "speed_range_m_min": None}
        for name, value in values.items():
            ends = getattr(self, name)
            inside = len(ends) == 2 and 0.0 < ends[0] <= (value or ends[0]) <= ends[1]
            if ends and not inside:
                between = "" if value is None else f", with {value:g} between them"
                raise ValueError(
                    f"taylor.{name} = {list(ends)} must be the least and the greatest{between}"
                )

    @property
    def C(self) -> float:
        """Cutting speed for a life of one minute [m/s]."""
        return float(self.C_m_min * self.life_min**self.n) / MINUTE

    @property
    def ends(self) -> "tuple[Taylor, ...]":
        """Constants at the ends of their spread; themselves alone where there is none."""
        return tuple(
            replace(self, C_m_min=C, n=n, C_range_m_min=(), n_range=())
            for C in self.C_range_m_min or (self.C_m_min,)
            for n in self.n_range or (self.n,)
        )

    @property
    def words(self) -> str:
        """Speed and life, with their spread, in words."""
        speed, n = (
            " to ".join(f"{end:.4g}" for end in ends)
            for ends in (self.C_range_m_min or (self.C_m_min,), self.n_range or (self.n,))
        )
        return f"v_c {speed} m/min for {self.life_min:g} min, n {n}"


def cutting_speed(diameter: ArrayLike, n: ArrayLike) -> Floats:
    """v_c = pi D n [m/s] from the diameter [m] and the spindle's speed n [rev/s].

    Examples
    --------
    >>> round(float(cutting_speed(6e-3, 8000 / 60)) * 60, 2)  # 6 mm at 8000 rpm, in m/min
    150.8
    """
    speed: Floats = np.pi * np.asarray(diameter, dtype=np.float64) * np.asarray(n)
    return speed


def life(
    taylor: Taylor, v_c: ArrayLike, conditions: Mapping[Condition, ArrayLike] = NONE
) -> Floats:
    """Time in the cut until the tool is worn [s]; shape of ``v_c`` and the conditions broadcast.

    ``v_c`` is the cutting speed [m/s]; a tool at rest has an infinite life. ``conditions`` are f_z,
    a_p and a_e [m]; one with an exponent is needed, and where one is 0 there is no chip and no
    wear. ValueError when a speed or condition is negative or NaN, or one that is needed is missing.

    Examples
    --------
    >>> carbide = Taylor(n=0.25, C_m_min=500.0)
    >>> float(life(carbide, 250 / 60)) / 60  # twice as slow lives 2^4 minutes
    16.0
    """
    with np.errstate(divide="ignore", over="ignore"):
        lasting: Floats = 1.0 / _wear_rate(taylor, v_c, conditions)
    return lasting


def wear(
    taylor: Taylor, times: ArrayLike, v_c: ArrayLike,
    conditions: Mapping[Condition, ArrayLike] = NONE,
) -> Floats:  # fmt: skip
    """Share of tool life of each block, t_i / T(V_i) [1], for times in the cut [s]; (..., B)."""
    spent = not_negative("times", times)
    with np.errstate(over="ignore", invalid="ignore"):  # a rate without bound for no time
        share: Floats = np.where(spent > 0.0, spent * _wear_rate(taylor, v_c, conditions), 0.0)
    return share


def wear_ends(
    taylor: Taylor, times: ArrayLike, v_c: ArrayLike,
    conditions: Mapping[Condition, ArrayLike] = NONE,
) -> Floats:  # fmt: skip
    """Least and greatest :func:`wear` by the spread [1], (2, ..., B); NaN where there is none."""
    found = np.stack([wear(end, times, v_c, conditions) for end in taylor.ends])
    ends: Floats = np.stack([found.min(axis=0), found.max(axis=0)])
    return ends if len(taylor.ends) > 1 else np.full_like(ends, np.nan)


def fastest(
    taylor: Taylor, lasting: float, conditions: Mapping[Condition, ArrayLike] = NONE
) -> Floats:
    """Greatest v_c [m/s] at which an edge lasts ``lasting`` [s] by every constant of the spread.

    Examples
    --------
    >>> spread = Taylor(n=0.25, C_m_min=200.0, life_min=15.0, C_range_m_min=(140.0, 300.0))
    >>> round(float(fastest(spread, 15 * 60.0)) * 60, 6)
    140.0
    """
    with np.errstate(divide="ignore", over="ignore"):  # without end: need not last
        speeds = [(life(end, 1.0, conditions) / lasting) ** end.n for end in taylor.ends]
    slowest: Floats = np.min(speeds, axis=0)
    return slowest


def _wear_rate(taylor: Taylor, v_c: ArrayLike, conditions: Mapping[Condition, ArrayLike]) -> Floats:
    """1 / T [1/s], see :func:`life`."""
    load = not_negative("v_c", v_c) / taylor.C
    for name in ("f_z", "a_p", "a_e"):
        exponent, reference = (getattr(taylor, f"{name}_{end}") for end in ("exponent", "ref_mm"))
        if not exponent:
            continue
        if name not in conditions:
            raise ValueError(f"tool life depends on {name} here: give it, in metres")
        load = load * (not_negative(name, conditions[name]) / (reference * MM)) ** exponent
    rate: Floats = load ** (1.0 / taylor.n) / MINUTE
    return rate
