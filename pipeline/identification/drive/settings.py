"""How feed drives are identified: what we choose, as opposed to what a machine is."""

from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from pipeline.search.genetic import GeneticSettings

FINEST = 1000
"""Substeps in a sample: a servo's period is no thousandth of a recorder's."""


@dataclass(frozen=True, kw_only=True)
class DriveFitSettings:
    """How drives are identified.

    Parameters
    ----------
    method : {"least_squares", "genetic"}
        Which optimum is taken.
    compare : bool
        Whether the other method is tried too, for the report.
    bandwidth_Hz : float, optional
        Of the parallel filter on motion and force [Hz]; chosen from the records when None.
    shortest_s : float
        Constant speed is held at least as long in a segment [s].
    widest : float
        A parameter whose 95 % interval is wider than this share of it is not determined [1].
    substeps : int
        Of the closed-loop simulation in one sample.
    genetic : GeneticSettings
        Of the genetic algorithm.
    """

    method: Literal["least_squares", "genetic"] = "least_squares"
    compare: bool = True
    bandwidth_Hz: float | None = None
    shortest_s: float = 0.2
    widest: float = 0.5
    substeps: int = 4
    genetic: GeneticSettings = field(default_factory=GeneticSettings)

    def __post_init__(self) -> None:
        for name in ("bandwidth_Hz", "shortest_s", "widest", "substeps"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ValueError(f"drive_fit.{name} = {value} must be finite and positive")
        if self.substeps > FINEST:
            raise ValueError(f"drive_fit.substeps = {self.substeps} must be at most {FINEST}")
