"""Replay of a span of production: quantities, parts of the twin replaced in turn, what is named.

A day's table has the rows of the twin's state; of each quantity ``_measured``, ``_estimated``,
``_low``, ``_high``, ``_previous`` (the version before) and ``_<sub-model>_<part>``, the estimate
with that part replaced, in windows of half a minute.
"""

from collections.abc import Mapping
from dataclasses import dataclass

SENSOR = "sensor"
"""Candidate beside the sub-models: the measured channel itself is wrong."""
LEAST_REMOVED, SURE = 0.5, 0.75
"""Least share that a named part removes; share of the samples in which it is clearly best [1]."""


@dataclass(frozen=True, kw_only=True)
class ReplayedQuantity:
    """A quantity over the span."""

    unit: str
    basis: str
    """Where its estimate comes from: the champion, or known-good days."""
    seconds: float
    """Time over which it is compared [s]."""
    excess: float
    limit: float
    """Greatest rise of the sum of squared distances less 1; beyond the limit a residual stands."""

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
    removed: float
    """Share of what stands that it removes from blocks that it was not fitted to [1]."""
    best: float
    """Share of samples of the blocks in which its sub-model alone clearly leaves the least [1]."""
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
    """Hash and version of what serves; version that served before, None without one."""
    known_good: tuple[str, ...]
    borrowed: str
    """Known-good days; the span that parameters are borrowed from, empty without one."""
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
    def named(self) -> tuple[str, ...]:
        """Sub-models that explain what stands: one, several that are not told apart, or none."""
        fit = [one for one in self.replaced if not one.spoilt and one.removed >= LEAST_REMOVED]
        if not fit or fit[0].best >= SURE:
            return tuple(one.submodel for one in fit[:1])
        return tuple(dict.fromkeys(one.submodel for one in fit))

    @property
    def sentence(self) -> str:
        """What explains the residual, how sure, or why nothing does."""
        what = ", ".join(self.stands).replace("_", " ")
        if not what:
            return "nothing to explain: what was measured lies where the twin expects it"
        if not self.named:
            return f"no sub-model explains the residual of {what}"
        best = self.replaced[0]
        share = f"{best.part}, refitted, removes {100 * best.removed:.0f} % of it"
        sure = f", sure to {100 * best.best:.0f} %" if len(self.named) == 1 else ""
        return f"{' or '.join(self.named)} explains the residual of {what}{sure}: {share}"
