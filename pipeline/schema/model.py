"""Stored models: identified parameters, the records of their fit, intervals of predictions."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated

from pipeline.schema.ranges import Count, NotNegative, Range, Ranged

Origin = str
"""``"simulated"`` or ``"recorded"``; what rests on simulated records is labelled so everywhere."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One identified parameter: the one shape of anything that a fit says."""

    value: float | None
    """Value in ``unit``; None where the records do not determine it."""
    unit: str
    """Unit, ``"1"`` for none."""
    interval_95: tuple[float, float] | None
    """Lower and upper end of its 95 % confidence interval."""
    determined: bool
    """Whether the records determine it."""
    method: str
    """Source of the value; of an undetermined one, the reason."""
    remedy: str = ""
    """Record that would determine it; empty where it is determined."""

    @classmethod
    def estimated(
        cls, value: float, low: float, high: float, unit: str, *, method: str, remedy: str,
        determined: bool,
    ) -> "Parameter":  # fmt: skip
        """An estimate with its interval to five significant digits; neither where it is open."""
        ends = significant(low), significant(high)
        return cls(
            value=significant(value) if determined else None, unit=unit,
            interval_95=ends if determined and all(map(isfinite, ends)) else None,
            determined=determined, method=method, remedy="" if determined else remedy,
        )  # fmt: skip


def significant(value: float, digits: int = 5) -> float:
    """Value to so many significant digits."""
    return float(f"{value:.{digits}g}")


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """A raw file by its path below ``data/raw/<machine>`` and the SHA-256 of its bytes."""

    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Training:
    """A case that a model was fitted on: its name, its group, and its raw files."""

    case: str
    group: str
    files: tuple[SourceFile, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """A case that was not used, and why."""

    case: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Correlation:
    """Correlation matrix of fitted parameters; an entry is None where it is not defined."""

    names: tuple[str, ...] = ()
    values: tuple[tuple[float | None, ...], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Range of a condition over the training cases: numbers from ``low`` to ``high``, or words."""

    unit: str = ""
    low: float | None = None
    high: float | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Model:
    """Content of every ``model.json``."""

    submodel: str
    machine: str
    """Sub-model and machine."""
    origin: Origin
    """Origin of the records."""
    parameters: Mapping[str, Mapping[str, Parameter]]
    """Parameters by group (an axis, a motor, a tool; ``""`` where there is one only) and name."""
    trained_on: tuple[Training, ...]
    """The cases, with the hashes of their raw files."""
    left_out: tuple[LeftOut, ...] = ()
    """Cases that say nothing to the fit, with the reason."""
    conditions: Mapping[str, Condition] = field(default_factory=dict)
    """Range of each condition over the training cases."""

    @property
    def training_files(self) -> Mapping[str, str]:
        """SHA-256 of each raw file that the model was fitted on -> its path."""
        return {one.sha256: one.file for case in self.trained_on for one in case.files}


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
