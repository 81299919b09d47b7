"""Rules by which the nights of a model ask for identification or training, and with what reason.

A target asks when it is over its error budget on two nights running, or when its error rises: a
Page-Hinkley test (E. S. Page, Biometrika 41, 1954) on the logarithm of the error over that of the
judgement.  Records ask when they are missing on two nights running on which the machine works.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pipeline.monitoring.budget import Budget, MonitoringSettings
from pipeline.monitoring.reasons import CAUSES, MEANINGS, REMEDIES, cause
from pipeline.schema.ledger import Ask, Night, Reason, latest

Target = tuple[str, str, str]
"""Sub-model, quantity and regime."""
TWICE, RISES, MISSING = (
    "over the error budget on two nights running",
    "the error rises far above that of the judgement",
    "records are missing on two nights running",
)
"""Rules in words."""
POOLED = 4
"""Nights of a fault, the present one and the last that asked, whose residuals name its cause."""
AGAIN: Mapping[str, str] = {
    "identification": "identify it anew on records of these nights",
    "training": "train it again on records of these nights",
}
"""Work on the model in words."""


def rises(shares: Iterable[float], budget: Budget, settings: MonitoringSettings) -> bool:
    """Whether the errors of the nights, over their budget [1], rise with the last of them."""
    if not budget.shares:
        return False
    from river.drift import PageHinkley

    test = PageHinkley(
        min_instances=1, delta=settings.slack, threshold=settings.threshold, alpha=1.0, mode="up"
    )
    for _ in range(settings.reference_nights):
        test.update(0.0)
    for share in shares:
        test.update(budget.rise(share, settings))
    return bool(test.drift_detected)


def decided(
    nights: Sequence[Night],
    before: Sequence[Night],
    budgets: Mapping[Target, Budget],
    settings: MonitoringSettings,
    *,
    outside: str = "",
    work: Ask = "identification",
) -> list[Night]:
    """Targets of a night with what they ask for, after the nights ``before`` of the same model.

    ``outside`` names the condition furthest beyond the learnt; ``work`` is what mends the model.
    """
    past = [one for one in latest(before) if one.night != nights[0].night]
    rules = [_rule(one, past, budgets, settings) for one in nights]
    if not any(rules):
        return list(nights)
    quiet = [one for one in past if one.result == "within" and not one.ask]
    usual = max((one.beyond for one in quiet), default=0.0)
    asked = list(dict.fromkeys(one.night for one in past if one.ask))[1 - POOLED :]
    fault = [*nights, *(one for one in past if one.night in asked)]
    reason = "" if nights[0].beyond > max(settings.beyond, usual) else cause(fault, quiet)
    known: Reason = CAUSES.get(reason, "not known")
    words = f"{MEANINGS[reason]}: {REMEDIES[reason]}" if reason else "no single cause explains it"
    if nights[0].beyond > max(settings.beyond, usual):
        known, words = "program changed", f"{outside}: record the new program first"
    found = []
    for one, rule in zip(nights, rules, strict=True):
        if rule == MISSING:
            found.append(
                replace(one, rule=rule, ask="records", reason="records missing",
                        words=f"{one.words}: mend the recording, unless the machine stood still")
            )  # fmt: skip
        elif rule:
            said = f"{words}, then {AGAIN[work]}"
            found.append(replace(one, rule=rule, ask=work, reason=known, words=said))
        else:
            found.append(one)
    return found


def _rule(
    one: Night, past: Sequence[Night], budgets: Mapping[Target, Budget],
    settings: MonitoringSettings,
) -> str:  # fmt: skip
    """Rule by which a target asks; empty where none does."""
    if one.result == "no records":
        tried = [p.result for p in past if p.result != "not scored"]
        return MISSING if tried[-1:] == ["no records"] else ""
    own = [p for p in past if p.target == one.target and p.share is not None]
    if one.result == "over" and own and own[-1].result == "over":
        return TWICE
    budget = budgets.get(one.target)
    shares = [share for p in (*own, one) if (share := p.share) is not None]
    return RISES if budget is not None and rises(shares, budget, settings) else ""
