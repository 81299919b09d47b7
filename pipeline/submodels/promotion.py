"""Gate of a promotion: a challenger's errors against the champion's on the same cases.

Both are predicted on the golden cases of the machine, or on the held-out ones where no golden case
decides, and compared group by group (day, recording, tool).  A case whose raw files one of the two
was fitted on is left out of the comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.golden import GoldenSets
from pipeline.schema.ranges import NotNegative, Ranged
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.verdict import Role, Score, Status, Verdict
from pipeline.submodels.cases import Cases, Records
from pipeline.submodels.contract import SubModel
from pipeline.submodels.judge import judge
from pipeline.submodels.scoring import FEWEST_GROUPS
from pipeline.submodels.statistics import gains


@dataclass(frozen=True, kw_only=True)
class PromotionSettings(Ranged, section="promotion"):
    """Tolerances of a promotion."""

    tolerance: NotNegative = 0.05
    """Greatest rise of the mean absolute error of any target over the champion's [1]."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Target of a sub-model, predicted by champion and challenger."""

    submodel: str
    quantity: str
    regime: str
    unit: str
    """Target, with its sub-model and unit."""
    groups: int
    """Groups that both predicted."""
    champion: float
    challenger: float
    """Mean absolute error, averaged over the groups [unit]."""
    better: bool
    """Whether the challenger's squared errors are significantly lower over the groups, by more than
    trainings with other seeds differ."""
    worse: bool
    """Whether its mean error is above the champion's by more than the tolerance."""

    @property
    def words(self) -> str:
        """The comparison as a sentence without its verdict."""
        regime = f", {self.regime}" if self.regime else ""
        groups = "1 group" if self.groups == 1 else f"{self.groups} groups"
        return (
            f"{self.submodel} ({self.quantity}{regime}): mean error {self.challenger:.4g} "
            f"{self.unit} against the champion's {self.champion:.4g} {self.unit} over {groups}"
        )


@dataclass(frozen=True, kw_only=True)
class Contest:
    """Champion and challenger of one sub-model on the same cases."""

    submodel: str
    """Sub-model."""
    compared: tuple[Compared, ...]
    """Comparisons by target with limits; none where no case could be compared."""
    status: Status = "not judged"
    """Status of the challenger against its limits, on the cases that were looked at."""
    note: str = ""
    """Why nothing was compared."""

    @property
    def words(self) -> str:
        """The contest as one sentence."""
        return "; ".join(one.words for one in self.compared) or f"{self.submodel}: {self.note}"


def contest(
    submodel: SubModel[Any, Any, Any],
    settings: Any,
    records: Records,
    *,
    sets: GoldenSets | None,
    champion: Path,
    challenger: Path,
    tolerance: float,
    roles: Sequence[Role] = ("golden", "held_out"),
) -> Contest:
    """Predict the same cases with both models of a sub-model, and compare their errors.

    ``settings`` are of its ``judging`` type; ``champion`` and ``challenger`` the folders of the two
    models; ``tolerance`` as in :class:`PromotionSettings` [1]; ``roles`` of the cases that are
    looked at are ``("sealed",)`` for the last look.
    """
    name = submodel.name
    try:
        models = [read_json(folder / "model.json", submodel.model)
                  for folder in (champion, challenger)]  # fmt: skip
        predictors = [submodel.load(folder, settings) for folder in (champion, challenger)]
    except StoreError as error:
        return Contest(submodel=name, compared=(), note=f"cannot be compared: {error}")
    fitted = {sha256 for model in models for sha256 in model.training_files}
    unseen = [
        case for case in submodel.cases(records, settings, sets).cases
        if not any(one.sha256 in fitted for one in case.files)
    ]  # fmt: skip
    cases = Cases(cases=tuple(unseen))
    verdicts = [
        judge(
            model, predictor, cases, submodel.targets(settings, model),
            sets=sets, files=records.files, roles=roles,
        ).verdict
        for model, predictor in zip(models, predictors, strict=True)
    ]  # fmt: skip
    compared = tuple(compare(verdicts[0], verdicts[1], tolerance))
    note = "" if compared else "no case that neither model was fitted on could be compared"
    return Contest(submodel=name, compared=compared, status=verdicts[1].status, note=note)


def compare(champion: Verdict, challenger: Verdict, tolerance: float) -> list[Compared]:
    """Errors of two models of a sub-model, paired over the groups that decide.

    Both are verdicts on the same cases; ``tolerance`` as in :class:`PromotionSettings` [1].
    """
    first, second = _by_group(champion), _by_group(challenger)
    targets = dict.fromkeys((s.quantity, s.regime, s.unit) for s in second.values())
    found = []
    for quantity, regime, unit in targets:
        keys = [k for k in second if k[:2] == (quantity, regime) and k in first]
        if not keys:
            continue
        old, new = ([scores[key] for key in keys] for scores in (first, second))
        mean_old, mean_new = (float(np.mean([s.mae for s in some])) for some in (old, new))
        squared_old, squared_new = (
            np.array([s.rmse for s in some], dtype=float) ** 2 for some in (old, new)
        )
        found.append(
            Compared(
                submodel=challenger.submodel, quantity=quantity, regime=regime, unit=unit,
                groups=len(keys), champion=mean_old, challenger=mean_new,
                better=mean_old - mean_new > _spread(new) and gains(squared_old, squared_new),
                worse=mean_new > (1 + tolerance) * mean_old,
            )
        )  # fmt: skip
    return found


def _spread(scores: Sequence[Score]) -> float:
    return float(np.mean([s.spread.get("mae", 0.0) for s in scores]))


def _by_group(verdict: Verdict) -> dict[tuple[str, str, str], Score]:
    """Scores that decide, by quantity, regime and group."""
    return {
        (s.quantity, s.regime, s.group): s
        for s in verdict.scores
        if s.limits and s.role == verdict.judged_role and None not in (s.mae, s.rmse)
    }


def objections(
    contests: Sequence[Contest],
    *,
    statuses: dict[str, Status],
    added: Sequence[str] = (),
    absent: Sequence[str] = (),
) -> list[str]:
    """Objections to a promotion, each as a sentence; none when the challenger may serve.

    A challenger serves when it is significantly better in at least one sub-model, or adds one that
    passed, and is in none worse than the tolerance.  One that is not decided neither speaks for it
    nor against it.
    """
    found = [f"its {name} failed: see {name}/verdict.json" for name, status in statuses.items()
             if status == "failed"]  # fmt: skip
    found += [f"it has no {name}, which the champion has" for name in absent]
    found += [one.words for one in contests if not one.compared]
    compared = [one for contest in contests for one in contest.compared]
    found += [f"it is worse: {one.words}" for one in compared if one.worse]
    gained = [name for name in added if statuses[name] == "passed"]
    if not gained and not any(one.better for one in compared):
        found.append(_not_better(compared))
    return found


def _not_better(compared: Sequence[Compared]) -> str:
    """Why no difference counts: too few groups, or none that chance could not make."""
    if not compared:
        return "no sub-model was compared, so that none is shown to be better"
    said = "; ".join(one.words for one in compared)
    if all(one.groups < FEWEST_GROUPS for one in compared):
        return (
            f"with fewer than {FEWEST_GROUPS} groups no difference is significant ({said}): "
            "record more, or promote it with --anyway"
        )
    return f"no sub-model is significantly better ({said})"


def sealed_objections(contests: Sequence[Contest]) -> list[str]:
    """Objections of the sealed set to a promotion: exceeded limits, larger errors."""
    failed = [
        f"its {one.submodel} fails on the sealed set: {one.words}"
        for one in contests if one.status == "failed"
    ]  # fmt: skip
    worse = [
        f"it is worse on the sealed set: {compared.words}"
        for one in contests for compared in one.compared if compared.worse
    ]  # fmt: skip
    return [*failed, *worse]
