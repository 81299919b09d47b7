"""Workpiece materials: cutting-force coefficients and tool life, with the source of every number.

Groups are those of VDI 3323, 1 to 41, with the letter of ISO 513.  A group's k_c1.1 and m_c
(Kienzle) stand for all materials of the group, and no tolerance is given with them; coefficients
measured with a tool go first where there are some.

Tool life is Taylor's (1907), V T^n = C with V [m/min] and T [min]; extended by the feed for each
tooth, the axial and the radial depth, V T^n (f_z/f_0)^a (a_p/a_0)^b (a_e/e_0)^c = C.  Where speed
and depths change, shares of life t_i / T(V_i) add up until they make one (Miner's rule, as for
fatigue).  Constants hold for the speeds of their tests; life at a speed far from those is an
extrapolation.  Sources differ by maker, grade and cut: their spread is an interval of C and of n,
and that of a life or a wear is over its four ends.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.schema.si import MINUTE, MM

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
    >>> round(float(cutting_speed(6e-3, 8000 / 60)) * 60, 2)  # 6 mm at 8000 rev/min, in m/min
    150.8
    """
    return np.pi * np.asarray(diameter, dtype=np.float64) * np.asarray(n)


def life(
    taylor: Taylor, v_c: ArrayLike, conditions: Mapping[Condition, ArrayLike] = NONE
) -> Floats:
    """Time in the cut until the tool is worn [s]; shape of ``v_c`` and the conditions broadcast.

    ``v_c`` is the cutting speed [m/s]; a tool at rest has an infinite life. ``conditions`` are f_z,
    a_p and a_e [m]; one with an exponent is needed, and where one is 0 there is no chip and no
    wear. ValueError when one that is needed is missing.

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
    spent = np.asarray(times, dtype=np.float64)
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
    return np.min(speeds, axis=0)


def _wear_rate(taylor: Taylor, v_c: ArrayLike, conditions: Mapping[Condition, ArrayLike]) -> Floats:
    """1 / T [1/s], see :func:`life`."""
    load = np.asarray(v_c, dtype=np.float64) / taylor.C
    for name in ("f_z", "a_p", "a_e"):
        exponent, reference = (getattr(taylor, f"{name}_{end}") for end in ("exponent", "ref_mm"))
        if not exponent:
            continue
        if name not in conditions:
            raise ValueError(f"tool life depends on {name} here: give it, in metres")
        load = load * (np.asarray(conditions[name]) / (reference * MM)) ** exponent
    return load ** (1.0 / taylor.n) / MINUTE


Letter = Literal["P", "M", "K", "N", "S", "H"]

LETTERS: tuple[tuple[int, int, str], ...] = (
    (1, 11, "P"), (12, 13, "PM"), (14, 14, "M"), (15, 20, "K"), (21, 30, "N"),
    (31, 37, "S"), (38, 41, "H"),
)  # fmt: skip
"""First and last group of VDI 3323, and the letters of ISO 513 that they go under."""


@dataclass(frozen=True, kw_only=True)
class LinearEdge:
    """Measured coefficients of the linear-edge model: cutting [N/mm^2], edge [N/mm]."""

    K_tc: float
    K_rc: float
    K_ac: float = 0.0
    K_te: float = 0.0
    K_re: float = 0.0
    K_ae: float = 0.0
    source: str

    def __post_init__(self) -> None:
        if not self.source.strip():
            raise ValueError("material.coefficients.source is empty: say who measured them")
        self.force_law()  # refuses what is no law

    def force_law(self) -> ForceLaw:
        """Force law in SI."""
        return ForceLaw.linear(
            K_tc=self.K_tc, K_rc=self.K_rc, K_ac=self.K_ac,
            K_te=self.K_te, K_re=self.K_re, K_ae=self.K_ae,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Material(Ranged, section="material"):
    """Workpiece material; group and letter belong together."""

    name: str
    """Name for readers."""
    group: Annotated[int, Range(least=1, most=41)]
    """Group of VDI 3323, 1 to 41."""
    iso: Letter
    """Letter of ISO 513."""
    k_c11: Annotated[float, Range(least=10.0, most=20000.0)]
    """Specific cutting force of a chip 1 mm thick and 1 mm wide [N/mm^2]."""
    m_c: Annotated[float, Range(least=0.0, most=0.9)]
    """Kienzle's exponent of the chip's thickness [1]."""
    radial: Annotated[float, Range(least=0.0, most=3.0)]
    axial: Annotated[float, Range(least=-3.0, most=3.0)] = 0.0
    """Radial and axial force over the tangential one [1]."""
    source: str
    """Source of ``k_c11`` and ``m_c``."""
    ratio_source: str
    """Source of ``radial`` and ``axial``, or the assumption."""
    hardness_HB: Annotated[float, Range(least=1.0, most=1000.0)] | None = None
    strength_N_mm2: Annotated[float, Range(least=1.0, most=5000.0)] | None = None
    """Brinell hardness, tensile strength [N/mm^2]."""
    coefficients: LinearEdge | None = None
    """Measured ones, which then are the force law."""
    taylor: dict[Literal["carbide", "hss"], Taylor] = field(default_factory=dict)
    """Constants of tool life by the tool's material; absent where there are none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("source", "ratio_source"):
            if not getattr(self, name).strip():
                raise ValueError(f"material.{name} is empty: say where the numbers come from")
        letters = next(letter for low, high, letter in LETTERS if low <= self.group <= high)
        if self.iso not in letters:
            raise ValueError(
                f"material.iso = {self.iso!r} does not go with group {self.group} of VDI 3323, "
                f"which is {' or '.join(letters)}"
            )

    def force_law(self, *, measured: bool = True) -> ForceLaw:
        """Force law in SI: measured coefficients if any and ``measured``, else Kienzle's law."""
        if measured and self.coefficients is not None:
            return self.coefficients.force_law()
        return ForceLaw.kienzle(
            k_c11=self.k_c11, m_c=self.m_c, radial=self.radial, axial=self.axial
        )

    @property
    def force_source(self) -> str:
        """Source of the numbers of :meth:`force_law`."""
        return self.source if self.coefficients is None else self.coefficients.source

    def tool_life(self, tool: Tool) -> Taylor | None:
        """Constants of the life of ``tool`` in this material; None without data."""
        found = self.taylor.get(tool.material)
        if found is None or tool.coating.casefold() not in ("none", "uncoated"):
            return found
        C, *ends = (found.uncoated * one for one in (found.C_m_min, *found.C_range_m_min))
        return replace(found, C_m_min=C, C_range_m_min=tuple(ends))

    def no_life(self, tool: Tool) -> str:
        """Reason for no life of ``tool`` in this material, and its remedy."""
        edge = {"carbide": "cemented carbide", "hss": "high-speed steel"}[tool.material]
        return (
            f"no source of the life of {edge} in {self.name} was found: write "
            f"taylor.{tool.material}, n and v_c at a life, into the material's file"
        )
