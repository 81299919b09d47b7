"""Replay of a span of production: quantities, parts of the twin replaced in turn, what is named.

A table of a day has the rows of the twin's state: ``time``, its context, and for each quantity
``_measured``, ``_estimated``, ``_low``, ``_high``, ``_previous`` (the version before) and a column
for each part, ``_<sub-model>_<part>``: the estimate with that part replaced.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

SENSOR = "sensor"
"""Candidate beside the sub-models: the measured channel itself is wrong."""
Basis = Literal["champion", "known-good days"]
Outcome = Literal["named", "not told apart", "none explains", "nothing to explain"]


@dataclass(frozen=True, kw_only=True)
class ReplayedQuantity:
    """A quantity over the span."""

    unit: str
    basis: Basis
    """Where its estimate comes from: a model that serves, or what is usual on known-good days."""
    seconds: float
    """Time over which it is compared [s]."""
    excess: float
    limit: float
    """Greatest sum of the squared distance beyond 1, in half intervals, over windows in a row; the
    sum from which on a residual stands."""
    span: tuple[float, ...] = ()
    """Begin of the first and of the last of these windows [s since 1970]; empty without one."""
    rms: Mapping[str, float] = field(default_factory=dict)
    """Root mean square of measured less champion, previous version and best part there [unit]."""

    @property
    def stands(self) -> bool:
        """Whether there is a residual to explain."""
        return self.excess > self.limit


@dataclass(frozen=True, kw_only=True)
class Replacement:
    """A part of the twin with parameters of the span in the place of the champion's."""

    submodel: str
    """Its sub-model, or :data:`SENSOR`."""
    part: str
    parameters: Mapping[str, float]
    """Parameters fitted to all that stands, with what they are."""
    removed: float
    """Share of what stands that it removes from blocks that it was not fitted to [1]."""
    best: float
    """Share of the resampled blocks in which it alone is the best of all sub-models' [1]."""
    spoilt: str = ""
    """Quantity without a residual that would have one with it, which rules it out."""
    borrowed: float | None = None
    """Share that it removes with its parameters of the other span; None without one."""

    @property
    def key(self) -> str:
        """Name of its columns."""
        return f"{self.submodel}_{self.part}".replace(" ", "_")


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The content of ``replay.json``."""

    machine: str
    origin: str
    first: str
    last: str
    """Span as it was named, days or times of the plant."""
    days: tuple[str, ...]
    bundle: str
    version: int
    previous: int | None
    """Hash and version of what serves, and the version that served before; None without one."""
    known_good: tuple[str, ...]
    borrowed: str
    """Known-good days, and the span that parameters are borrowed from; empty without one."""
    outcome: Outcome
    named: tuple[str, ...]
    """Sub-models that explain what stands: one, or several that are not told apart."""
    sure: float | None
    """Share of the resampled blocks that name the same [1]."""
    quantities: Mapping[str, ReplayedQuantity]
    replaced: tuple[Replacement, ...]
    """Parts, the best first; empty where nothing stands."""
    missing: Mapping[str, str]
    """Quantities that are not compared, and why."""

    @property
    def stands(self) -> list[str]:
        """Quantities with a residual to explain."""
        return [name for name, one in self.quantities.items() if one.stands]

    @property
    def sentence(self) -> str:
        """What explains the residual, how sure, or why nothing does."""
        what = ", ".join(name.replace("_", " ") for name in self.stands)
        if self.outcome == "nothing to explain":
            return "nothing to explain: what was measured lies where the twin expects it"
        best = self.replaced[0] if self.replaced else None
        share = f"{100 * best.removed:.0f} %" if best and not best.spoilt else "none"
        if best is None or self.outcome == "none explains":
            return f"no sub-model explains the residual of {what}: the best removes {share} of it"
        if self.outcome == "named":
            return (f"{best.submodel} explains the residual of {what}: its {best.part}, refitted, "
                    f"removes {share} of it, sure to {100 * (self.sure or 0.0):.0f} %")  # fmt: skip
        return (f"{' or '.join(self.named)} explains the residual of {what}, not told apart; the "
                f"best, {best.submodel} {best.part}, removes {share} of it")  # fmt: skip
