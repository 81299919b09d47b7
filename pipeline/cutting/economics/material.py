"""Workpiece materials: cutting-force coefficients and tool life, with the source of every number.

Groups are those of VDI 3323, 1 to 41, with the letter of ISO 513.  A group's k_c1.1 and m_c
(Kienzle) stand for all materials of the group, and no tolerance is given with them; coefficients
measured with a tool go first where there are some.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from pipeline.cutting.economics.tool_life import Taylor
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.schema.ranges import Range, Ranged

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
