"""Error budgets: the error that a model may make each night, and its errors when it was judged."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import log
from statistics import median, stdev
from typing import Annotated

from pipeline.schema.ranges import Positive, Range, Ranged, Share
from pipeline.schema.verdict import Figures, Score, Verdict
from pipeline.submodels.contract import Target
from pipeline.submodels.scoring import ALL


@dataclass(frozen=True, kw_only=True)
class MonitoringSettings(Ranged, section="monitoring"):
    """Error budgets and tests of the nights."""

    factor: Annotated[float, Range(least=1.0, most=10.0, unit="1")] = 2.0
    """Budget of a target without limits, over the model's own error when it was judged."""
    slack: Annotated[float, Range(least=0.0, most=5.0, unit="1")] = 1.0
    threshold: Annotated[float, Range(above=0.0, most=50.0, unit="1")] = 6.0
    """Page-Hinkley's delta and lambda, in standard deviations of the errors between groups."""
    least_spread: Annotated[float, Range(least=0.05, most=2.0, unit="1")] = 0.25
    """Least standard deviation between groups of the logarithm of an error: few groups lie closer
    together than nights do."""
    reference_nights: Annotated[int, Range(least=1, most=366)] = 14
    """Nights that the errors at the judgement count as in the running mean of the test."""
    beyond: Positive = 0.5
    """Distance beyond the learnt range of a condition, over its width, from which a program counts
    as changed [1]."""
    least_records: Share = 0.25
    """Share of the usual number of samples below which records count as missing [1]."""


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Allowed errors of a target each night, and its errors when the model was judged."""

    target: Target
    allowed: Mapping[str, float]
    """Allowed error by the name of its figure."""
    shares: tuple[float, ...] = ()
    """Errors over what is allowed in each group of the judgement [1]."""
    samples: float = 0.0
    """Usual number of samples of a group."""

    def share(self, found: Figures) -> float | None:
        """Greatest error over its budget [1]; None where an error is not known."""
        values = [(getattr(found, name), most) for name, most in self.allowed.items()]
        known = [abs(value) / most for value, most in values if value is not None]
        return max(known) if len(known) == len(values) else None

    def rise(self, share: float, settings: MonitoringSettings) -> float:
        """Logarithm of an error over the usual one, in standard deviations between groups."""
        spread = stdev(map(log, self.shares)) if len(self.shares) > 1 else 0.0
        usual = median(map(log, self.shares))
        return (log(max(share, 1e-9)) - usual) / max(spread, settings.least_spread)


def budgets(
    targets: Iterable[Target], verdict: Verdict, settings: MonitoringSettings
) -> list[Budget]:
    """Budget of each target that decides: its limits, else its own errors by the settings' factor.

    A target without limits that was not judged has no budget.
    """
    found = []
    for target in targets:
        if not (target.limits or target.coverage or target.most_percent or target.least_auc):
            continue
        scores = [s for s in verdict.of(target.quantity, role=verdict.judged_role or "held_out")
                  if s.regime == target.regime and not s.alone]  # fmt: skip
        allowed = dict(target.limits) or _own(scores, settings.factor)
        if not allowed:
            continue
        budget = Budget(target=target, allowed=allowed)
        groups = [s for s in scores if s.group != ALL]
        shares = [share for s in groups if (share := budget.share(s))]
        usual = median(s.n for s in groups) if groups else 0.0
        found.append(
            Budget(target=target, allowed=allowed, shares=tuple(shares), samples=float(usual))
        )
    return found


def _own(scores: Iterable[Score], factor: float) -> dict[str, float]:
    """Allowed errors by those over all groups."""
    whole = next((s for s in scores if s.group == ALL), None)
    errors = {} if whole is None else {name: getattr(whole, name) for name in ("mae", "rmse")}
    return {name: factor * value for name, value in errors.items() if value}
