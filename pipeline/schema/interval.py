"""Stored prediction intervals: half widths by regime."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pipeline.schema.ranges import Count, NotNegative, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class Band(Ranged, section="band"):
    """90 % prediction interval of one regime: from predicted - lower to predicted + upper."""

    lower: NotNegative
    upper: NotNegative
    """Half widths, in the unit of the quantity."""
    n: Count
    """Residuals that it was calibrated on."""
    groups: Count
    """Groups that they are from."""


Bands = Mapping[str, Band]
"""Bands by regime; that of ``""``, over all regimes, serves regimes that have none."""


@dataclass(frozen=True, kw_only=True)
class AdaptiveSettings(Ranged, section="adaptive_interval"):
    """Adaptation of an interval to the errors that have become known."""

    step: Annotated[float, Range(least=0.0, most=1.0)] = 0.01
    """Change of the factor on the half width by a sample outside [1]; 0 keeps it at 1."""
    delay_s: NotNegative = 0.0
    """A measured value is known this long after its time [s]."""
