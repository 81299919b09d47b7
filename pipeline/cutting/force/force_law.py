"""Force law of a cutting edge.

Tangential, radial and axial force for each width of chip b are K_c h^(1 - m_c) + K_e, the edge
terms only where there is a chip (h > 0).  With m_c = 0 this is the linear-edge model (Altintas,
*Manufacturing Automation*, 2nd ed. 2012, eq. 2.40); without edge terms it is Kienzle's law
F = k_c1.1 b h^(1 - m_c) (Kienzle 1952).
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Finite, NotNegative, Range, Ranged

N_MM2 = 1e6
N_MM = 1e3
THICKNESS = 1e-3  # [m], of which k_c1.1 is the specific force


@dataclass(frozen=True, kw_only=True)
class ForceLaw(Ranged, section="force_law"):
    """Constants of one pair of tool and material, in SI; at least one is tangential."""

    K_tc: NotNegative
    K_rc: Finite
    K_ac: Finite = 0.0
    """Cutting coefficients, tangential, radial, axial [N/m^2 m^m_c]."""
    K_te: NotNegative = 0.0
    K_re: Finite = 0.0
    K_ae: Finite = 0.0
    """Edge coefficients [N/m]."""
    m_c: Annotated[float, Range(least=0.0, below=1.0)] = 0.0
    """Exponent of the chip thickness [1]; 0 for the linear-edge model."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.K_tc == self.K_te == 0.0:
            raise ValueError(
                "force_law.K_tc and force_law.K_te are both 0: a tool that cuts takes force"
            )

    @classmethod
    def linear(
        cls, *, K_tc: float, K_rc: float, K_ac: float = 0.0,
        K_te: float = 0.0, K_re: float = 0.0, K_ae: float = 0.0,
    ) -> "ForceLaw":  # fmt: skip
        """Linear-edge law from tables: cutting [N/mm^2], edge [N/mm]."""
        return cls(
            K_tc=K_tc * N_MM2, K_rc=K_rc * N_MM2, K_ac=K_ac * N_MM2,
            K_te=K_te * N_MM, K_re=K_re * N_MM, K_ae=K_ae * N_MM,
        )  # fmt: skip

    @classmethod
    def kienzle(cls, *, k_c11: float, m_c: float, radial: float, axial: float = 0.0) -> "ForceLaw":
        """Kienzle's law from tables: k_c1.1 [N/mm^2], radial and axial force over tangential [1].

        Examples
        --------
        >>> law = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.5)
        >>> chip = 1e-3 ** (1.0 - law.m_c)  # 1 mm thick; force [N/mm] of its width
        >>> round(law.K_tc * chip / 1e3, 6), round(law.K_rc * chip / 1e3, 6)
        (1500.0, 750.0)
        """
        tangential = k_c11 * N_MM2 * THICKNESS**m_c
        return cls(K_tc=tangential, K_rc=radial * tangential, K_ac=axial * tangential, m_c=m_c)

    @property
    def cutting(self) -> Floats:
        """K_tc, K_rc, K_ac; shape (3,)."""
        return np.array([self.K_tc, self.K_rc, self.K_ac])

    @property
    def edge(self) -> Floats:
        """K_te, K_re, K_ae; shape (3,)."""
        return np.array([self.K_te, self.K_re, self.K_ae])
