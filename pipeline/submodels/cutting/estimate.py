"""Estimates of single parameters from the identifications of the cut."""

from dataclasses import dataclass

import numpy as np

from pipeline.schema.model import Parameter


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Estimate of one parameter, determined or not."""

    name: str
    unit: str
    value: float
    """Value in the unit."""
    half_width: float
    """Half of the 95 % interval, in the unit."""
    determined: bool
    """Whether the recordings determine it."""
    method: str
    reason: str = ""
    remedy: str = ""
    """Why they do not if so, and what to record then."""
    remark: str = ""
    """Remark on the meaning of a determined value."""
    lowest: float = -np.inf
    """Physical lower bound of its interval."""

    @property
    def parameter(self) -> Parameter:
        """The estimate as it is stored, to five significant digits."""
        if not (self.determined and np.isfinite(self.value) and np.isfinite(self.half_width)):
            return Parameter(
                value=None, unit=self.unit, interval_95=None, determined=False,
                method=self.reason or self.method, remedy=self.remedy,
            )  # fmt: skip
        low = max(self.value - self.half_width, self.lowest)
        return Parameter(
            value=digits(self.value), unit=self.unit, determined=True, method=self.method,
            interval_95=(digits(low), digits(self.value + self.half_width)),
        )  # fmt: skip


def digits(value: float) -> float:
    """A number to five significant digits."""
    return float(f"{value:.5g}")
