"""How cutting coefficients are identified: what we choose, as opposed to what a machine is."""

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from pipeline.search.genetic import GeneticSettings

MOST_HARMONICS = 64


@dataclass(frozen=True, kw_only=True)
class CuttingFitSettings:
    """How the coefficients of a cut are identified from its forces.

    Parameters
    ----------
    method : {"least_squares", "genetic"}
        Which optimum of the waveform's terms is taken.
    compare : bool
        Whether the other method is tried too, for the report.
    harmonics : int
        Of the spindle's revolution that are used at most; those above 0.45 of the rate are not.
    zero_N : float
        Standard deviation of a recording's zero [N], where the recording shows no air to take it
        from.
    widest : float
        A parameter whose 95 % interval is wider than this share of it is not determined [1].
    gain : float
        Share of the error on recordings left out that a term must save to be kept [1].
    genetic : GeneticSettings
        Of the genetic algorithm.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    method: Literal["least_squares", "genetic"] = "least_squares"
    compare: bool = True
    harmonics: int = 48
    zero_N: float = 1.0
    widest: float = 0.5
    gain: float = 0.02
    genetic: GeneticSettings = field(
        default_factory=lambda: GeneticSettings(population=24, generations=30, stall=10)
    )

    def __post_init__(self) -> None:
        for name in ("zero_N", "widest", "gain"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"cutting_fit.{name} = {value} must be finite and positive")
        if not 1 <= self.harmonics <= MOST_HARMONICS:
            raise ValueError(
                f"cutting_fit.harmonics = {self.harmonics} must be from 1 to {MOST_HARMONICS}"
            )
