"""Judging: predictions against measurements, baselines, limits and frozen sets.

A verdict rests on the golden cases where some are frozen, else on those that were held out of the
fit.  Training cases are compared and never decide.  Sealed cases are looked at by promotion only.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Model
from pipeline.schema.verdict import (
    Figures,
    JudgedCase,
    OutsideConditions,
    Role,
    Score,
    Status,
    Verdict,
    outside_conditions,
    sized,
    widening,
)
from pipeline.submodels import scoring
from pipeline.submodels.canaries import canaries, failures
from pipeline.submodels.cases import Case, Cases, golden_used, leak_reasons, set_reasons
from pipeline.submodels.contract import Predictor, Target
from pipeline.submodels.coverage import CheckReasons, covered
from pipeline.submodels.statistics import auc, spread_of

WORDS = {
    "mae": "mean error",
    "rmse": "RMSE",
    "max": "largest error",
    "bias": "bias",
    "relative_percent": "relative error",
    "max_percent": "largest error of the largest value",
    "peak_percent": "error of the peak",
    "mean_percent": "error of the mean",
}
"""Errors in words, for reasons."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A verdict, and the predictions that it was reached on."""

    verdict: Verdict
    predictions: pd.DataFrame


def judge(
    model: Model,
    predictor: Predictor,
    cases: Cases,
    targets: Sequence[Target],
    *,
    sets: GoldenSets | None,
    files: Mapping[str, Mapping[str, Any]],
    roles: Iterable[Role] = ("training", "held_out", "golden"),
) -> Judged:
    """Judge a model on all cases of some roles.

    ``files`` are entries of the manifest by raw file; ``roles`` of the cases that are looked at are
    ``("sealed",)`` at promotion.
    """
    looked_at = cases.of(*roles)
    predicted = [(case, predictor(case)) for case in looked_at]
    outside = [
        found for case in looked_at
        for found in outside_conditions(case.conditions, model.conditions, case.name)
    ]  # fmt: skip
    own = {target.quantity for target in targets if target.widens}
    frame = _table(predicted, outside, own)
    deciding = _deciding(looked_at)
    beyond = {one.case for one in outside}
    known = len(model.trained_on)
    scores = [
        score for target in targets for score in scores_of(frame, target, deciding, beyond, known)
    ]
    decisive = [s for s in scores if s.status != "not judged" and not s.alone]
    checked = canaries((one for _, one in predicted), frame, targets, deciding)
    broken = [
        *set_reasons(model, sets, files),
        *leak_reasons(model, cases.of("golden", "held_out", "sealed")),
        *failures(checked),
    ]
    status, reasons = _status(model, cases, decisive, broken, sets)
    if status == "failed":
        reasons += [f"{case.name}: {one.cause}" for case, one in predicted if one.cause]
    verdict = Verdict(
        submodel=model.submodel,
        machine=model.machine,
        origin=model.origin,
        status=status,
        reasons=tuple(reasons),
        judged_role=deciding if decisive else None,
        golden=golden_used(None if sets is None else sets.golden),
        scores=tuple(scores),
        skills=tuple(
            s for target in targets
            for s in scoring.skills(
                _without(frame, {s.group for s in scores if s.alone}), target, deciding
            )
        ),
        outside=tuple(outside),
        cases=tuple(
            JudgedCase(
                case=case.name, group=case.group, role=case.role, conditions=case.conditions,
                facts=one.facts, note=one.note,
            )
            for case, one in predicted
        ),
        left_out=cases.left_out,
        sealed=len(cases.of("sealed")),
        canaries=checked,
    )  # fmt: skip
    return Judged(verdict=verdict, predictions=frame)


def _table(
    predicted: Sequence[tuple[Case, Any]], outside: Sequence[OutsideConditions], own: set[str]
) -> pd.DataFrame:
    """Rows of all cases, intervals widened beyond training conditions, except in ``own``."""
    distance: dict[str, float] = {}
    for one in outside:
        distance[one.case] = max(distance.get(one.case, 1.0), widening(one))
    parts = []
    for case, one in predicted:
        part = one.frame.assign(case=case.name, group=case.group, role=case.role)
        if case.name in distance and {"low", "high"} <= set(part.columns):
            factor = np.where(part["quantity"].isin(own), 1.0, distance[case.name])
            for end in ("low", "high"):
                part[end] = part["predicted"] + factor * (part[end] - part["predicted"])
        parts.append(part)
    full = [part for part in parts if len(part)]
    if not full:
        return pd.DataFrame()
    frame = pd.concat(full, ignore_index=True)
    for name, default in (("low", np.nan), ("high", np.nan), ("regime", ""), ("scored", True)):
        frame[name] = frame[name].fillna(default) if name in frame else default
    return frame.astype({"scored": bool})


def _deciding(cases: Sequence[Case]) -> Role:
    there = {case.role for case in cases}
    order: tuple[Role, ...] = ("sealed", "golden", "held_out")
    return next((role for role in order if role in there), "held_out")


def scores_of(
    frame: pd.DataFrame, target: Target, deciding: Role, outside: set[str], trained: int
) -> list[Score]:
    """Scores of a target by role and group, and over all groups of each role."""
    rows = scoring.scored_rows(frame, target)
    if not len(rows):
        return []
    # of one axis, say, are fewer recordings than of the model
    learnt = rows.loc[rows["role"] == "training", "group"].nunique() or trained
    found = []
    for role, of_role in rows.groupby("role", sort=False):
        groups = [
            _held_against(_score(part, target, str(group), role, deciding), target, deciding)
            for group, part in of_role.groupby("group", sort=False)
        ]
        lone = _lone(groups, target)
        others = of_role[of_role["group"] != lone] if lone else of_role
        found += [replace(one, alone=one.group == lone) for one in groups]
        total = _score(others, target, scoring.ALL, role, deciding)
        if role == deciding:
            total = _over_all(others, _with_use(total, others, target, outside, trained), target,
                              learnt)  # fmt: skip
        found.append(total)
    return found


def _score(rows: pd.DataFrame, target: Target, group: str, role: Any, deciding: Role) -> Score:
    """A score, with the spread of its figures where its role decides."""
    score = scoring.score_of(rows, target, group, role)
    return replace(score, spread=scoring.spread_over(rows)) if role == deciding else score


def _with_use(
    score: Score, rows: pd.DataFrame, target: Target, outside: set[str], trained: int
) -> Score:
    """A score over all groups with whether its interval is of use, inside where groups are many."""
    rows = rows[~rows["case"].isin(outside)]
    many = rows["group"].nunique() >= scoring.FEWEST_GROUPS
    inside = scoring.score_of(rows, target, scoring.ALL, score.role) if many else score
    score = replace(score, inside_ratio=inside.half_width_over_rmse)
    return replace(score, unknown_interval=target.unknown_interval(score, trained))


def _lone(scores: Sequence[Score], target: Target) -> str | None:
    """The only group that failed where enough others passed; a bad record decides nothing alone."""
    failed = [one.group for one in scores if one.status == "failed"]
    passed = sum(one.status == "passed" for one in scores)
    return failed[0] if target.alone and len(failed) == 1 and passed >= target.alone else None


def _held_against(score: Score, target: Target, deciding: Role) -> Score:
    """A score with its status: limits kept, and better than what it has to beat here."""
    if not score.limits or score.role != deciding:
        return score
    reasons: list[str] = []
    open_: list[str] = []
    regime = f" {target.regime}" if target.regime else ""
    for name, limit in score.limits.items():
        value, spread = getattr(score, name), score.spread.get(name, 0.0)
        unit = "%" if name.endswith("percent") else score.unit
        if value is None:
            reasons.append(f"{score.group}: {target.quantity} has no {WORDS[name]}")
            continue
        said = f"{score.group}: {target.quantity}{regime}, {WORDS[name]} {sized(value, unit)} is"
        if abs(abs(value) - limit) < spread:
            open_.append(f"{said} {_near(f'the limit of {sized(limit, unit)}', spread, unit)}")
        elif abs(value) > limit:
            reasons.append(f"{said} above {sized(limit, unit)}")
    if target.each_group:
        for name in target.must_beat:
            worse, unsure = _shortfall(score, name, target)
            reasons += [f"{score.group}: {reason}" for reason in worse]
            open_ += [f"{score.group}: {reason}" for reason in unsure]
    status: Status = "failed" if reasons else "not decided" if open_ else "passed"
    return replace(score, status=status, reasons=tuple(reasons or open_))


def _near(limit: str, spread: float, unit: str) -> str:
    """Words for a figure nearer to a limit than the spread of trainings."""
    return f"too near to {limit}: trainings differ by \u00b1 {sized(spread, unit, 2)}, not decided"


def _shortfall(score: Score, name: str, target: Target) -> tuple[list[str], list[str]]:
    """Errors not below a baseline's: significantly, and within the uncertainty."""
    other = score.baselines.get(name, Figures())
    spared = score.rounding.get(name, Figures())
    worse, unsure = [], []
    for kind in ("mae", "rmse"):
        own, theirs = getattr(score, kind), getattr(other, kind)
        spread, width = score.spread.get(kind, 0.0), getattr(spared, kind) or 0.0
        if own is None or theirs is None or (own < theirs and theirs - own >= spread):
            continue
        title = target.titles.get(name, name.replace("_", " "))
        that = f"that of {title}, {sized(theirs, score.unit)}"
        mine = f"{WORDS[kind]} {sized(own, score.unit)} is"
        said = f"{mine} not below {that}"
        if abs(own - theirs) < spread:
            unsure.append(f"{mine} {_near(that, spread, score.unit)}")
        elif own - theirs < width:
            unsure.append(
                f"{said}, but the sensor's steps leave {sized(width, score.unit, 2)} open: not "
                "decided"
            )
        else:
            worse.append(said)
    return worse, unsure


def _over_all(rows: pd.DataFrame, score: Score, target: Target, trained: int) -> Score:
    """Score over all groups with its status by each check of its target."""
    found = []
    if target.most_percent:
        found.append(_share_of_quantity(score, target))
    if target.coverage:
        found.append(covered(rows, score, target, trained))
    if target.least_auc:
        found.append(_ordered(rows, target))
    own = bool(found)
    reasons, open_ = (
        [said for one in (_against_baselines(score, target), *found) for said in one[k]]
        for k in (0, 1)
    )
    # a baseline alone passes no target, and one that is too near decides none without limits
    if not (own or reasons or (open_ and target.limits)):
        return score
    status: Status = "failed" if reasons else "not decided" if open_ else "passed"
    return replace(
        score, coverage_limits=target.coverage, status=status, reasons=tuple(reasons or open_)
    )


def _against_baselines(score: Score, target: Target) -> CheckReasons:
    """Baselines that are no worse over all groups."""
    found = [_shortfall(score, name, target) for name in target.must_beat]
    worse, unsure = (
        [f"{target.quantity} over all: {said}" for one in found for said in one[k]] for k in (0, 1)
    )
    return worse, unsure


def _share_of_quantity(score: Score, target: Target) -> CheckReasons:
    """Whether the error is too large a part of what was measured."""
    part, most = score.relative_percent, target.most_percent
    if part is None or score.rmse is None:
        return [], []
    said = (
        f"{target.quantity} over all: RMSE {sized(score.rmse, score.unit)} is {part:.3g} % of the "
        "RMS of what was measured"
    )
    spread = score.spread.get("relative_percent", 0.0)
    if abs(part - most) < spread:
        return [], [f"{said}, {_near(f'the limit of {most:g} %', spread, '%')}"]
    return ([f"{said}, above {most:g} %"] if part > most else []), []


def _without(frame: pd.DataFrame, groups: set[str]) -> pd.DataFrame:
    return frame[~frame["group"].isin(groups)] if groups else frame


def _ordered(rows: pd.DataFrame, target: Target) -> CheckReasons:
    """Whether a class is not separated from the other."""
    truth = rows["measured"].to_numpy(float)
    area = auc(rows["predicted"].to_numpy(float), truth)
    if area is None:
        return [], []
    again = [auc(rows[name].to_numpy(float), truth) for name in scoring.trained_again(rows)]
    spread = spread_of(np.array(again, float)) if len(again) > 1 else 0.0
    said = f"{target.quantity}: area under the ROC curve {area:.3g} is"
    if abs(area - target.least_auc) < spread:
        return [], [f"{said} {_near(f'the limit of {target.least_auc:g}', spread, '')}"]
    return ([f"{said} below {target.least_auc:g}"] if area < target.least_auc else []), []


def _status(
    model: Model,
    cases: Cases,
    decisive: Sequence[Score],
    broken: Sequence[str],
    sets: GoldenSets | None,
) -> tuple[Status, list[str]]:
    """The verdict's status and reasons; what is not decided speaks only where nothing failed."""
    over = [r for score in decisive if score.status == "failed" for r in score.reasons]
    if broken or over:
        return "failed", [*broken, *over]
    unsure = [r for score in decisive if score.status == "not decided" for r in score.reasons]
    if unsure:
        return "not decided", unsure
    if decisive:
        return "passed", []
    return "not judged", [why_not_judged(model, cases, sets)]


def why_not_judged(model: Model, cases: Cases, sets: GoldenSets | None) -> str:
    """Why no case decided, and what to do."""
    others = cases.of("golden", "held_out")
    lacking = "; ".join(f"{one.case}: {one.reason}" for one in cases.left_out[:3])
    said = f" ({lacking})" if lacking else ""
    if others:
        return (
            f"no record that {model.submodel} was not fitted on shows enough to judge by{said}: "
            "record more"
        )
    fitted = sorted({one.file for case in model.trained_on for one in case.files})
    if len(fitted) == 1:
        return (
            f"{fitted[0]} is the only recording of use{said} and the model was fitted on it: "
            "record another to judge by"
        )
    if not fitted:
        return f"no record is of use{said}: see what to record"
    freeze = f", or freeze some with `kerf golden --machine {model.machine}`"
    frozen = "" if sets is not None else freeze
    return (
        f"the model was fitted on all {len(fitted)} recordings of use{said}: leave some out of "
        f"roles.training{frozen}, or record others"
    )


def metrics(judged: Verdict) -> dict[str, Any]:
    """Key figures for ``dvc metrics``: the same keys for every sub-model and machine."""
    found: dict[str, Any] = {
        "status": judged.status,
        "cases_judged": len([c for c in judged.cases if c.role == judged.judged_role]),
    }
    for score in judged.scores:
        if score.group != scoring.ALL or score.role != (judged.judged_role or "training"):
            continue
        name = f"{score.quantity}, {score.regime}" if score.regime else score.quantity
        worst = [s for s in judged.of(score.quantity, role=score.role) if s.regime == score.regime]
        found[name] = {
            "unit": score.unit,
            "mae": score.mae,
            "rmse": score.rmse,
            "relative_percent": score.relative_percent,
            "coverage_90": score.coverage_90,
            "half_width_over_rmse": "not known" if score.unknown_interval
            else scoring.rounded(score.half_width_over_rmse or np.nan),
            "interval_90": score.unknown_interval or ("known" if score.half_width else None),
            "spread_mae": score.spread.get("mae"),
            "spread_rmse": score.spread.get("rmse"),
            "worst_rmse": max((s.rmse for s in worst if s.rmse is not None), default=None),
            "skill_mae": {s.baseline: s.mae for s in judged.skills
                          if (s.quantity, s.regime) == (score.quantity, score.regime)},
        }  # fmt: skip
    return found
