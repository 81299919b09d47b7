"""Rules by which the nights of a model ask for identification or training, and with what reason.

A target asks when it is over its error budget on two nights running, or when its error rises: a
Page-Hinkley test (E. S. Page, Biometrika 41, 1954) on the logarithm of the error over that of the
judgement.  Records ask when they are missing on two nights running on which the machine works.

The test forgets what it has alarmed on, so that an ask stays open by itself: each night of the
target asks on until the errors of :data:`BACK` nights are back, or another model serves.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from statistics import mean

from pipeline.monitoring.budget import Budget, MonitoringSettings
from pipeline.monitoring.reasons import CAUSES, MEANINGS, REMEDIES, causes
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
BACK = 7
"""Nights of an ask on which the errors have to be those of the judgement again to close it."""
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
    asking = [_asking(one, past, budgets, settings) for one in nights]
    if not any(rule for rule, _ in asking):
        return list(nights)
    known, words = _cause(nights, past, settings, outside)
    found = []
    for one, (rule, since) in zip(nights, asking, strict=True):
        asked = replace(one, rule=rule, since=since)
        if rule == MISSING:
            said = f"{one.words}: mend the recording, unless the machine stood still"
            asked = replace(asked, ask="records", reason="records missing", words=said)
        elif rule:
            asked = replace(asked, ask=work, reason=known, words=f"{words}, then {AGAIN[work]}")
        found.append(asked)
    return found


def _asking(
    one: Night, past: Sequence[Night], budgets: Mapping[Target, Budget],
    settings: MonitoringSettings,
) -> tuple[str, str]:  # fmt: skip
    """Rule by which a target asks, and the first night of the ask; empty where it asks nothing."""
    if one.result == "no records":
        last = [p for p in past if p.result != "not scored"][-1:]
        missing = any(p.result == "no records" for p in last)
        return (MISSING, last[0].since or one.night) if missing else ("", "")
    own = [p for p in past if p.target == one.target and p.share is not None]
    budget = budgets.get(one.target)
    if budget is None or one.share is None:
        return "", ""
    asked = list(takewhile(lambda p: p.ask, reversed(own)))
    quiet = list(takewhile(lambda p: not p.ask, reversed(own)))[::-1]
    is_open = bool(asked) and not _are_back([one, *asked], budget, settings)
    since = asked[-1].since if is_open else one.night
    if one.result == "over" and own and own[-1].result == "over":
        return TWICE, since
    if rises((p.share or 0.0 for p in (*quiet, one)), budget, settings):
        return RISES, since
    return (asked[0].rule, since) if is_open else ("", "")


def _are_back(asked: Sequence[Night], budget: Budget, settings: MonitoringSettings) -> bool:
    """Whether the errors of an ask, newest night first, are those of the judgement again.

    The last :data:`BACK` nights are within the budget, and on average no further above the errors
    of the judgement than the slack of the test.
    """
    last = asked[:BACK]
    if len(last) < BACK or any(one.result == "over" for one in last):
        return False
    rise = [budget.rise(one.share or 0.0, settings) for one in last if budget.shares]
    return not rise or mean(rise) <= settings.slack


def _cause(
    nights: Sequence[Night], past: Sequence[Night], settings: MonitoringSettings, outside: str
) -> tuple[Reason, str]:
    """Reason of a fault with what to do at the machine, by the residuals of its last nights.

    Nights of programs beyond the learnt speak for nothing but the program.
    """
    quiet = [one for one in past if one.result == "within" and not one.ask]
    asked = list(dict.fromkeys(one.night for one in past if one.ask))[1 - POOLED :]
    fault = [*nights, *(one for one in past if one.night in asked)]
    usual = max((one.beyond for one in quiet), default=0.0)
    learnt = [one for one in fault if one.beyond <= max(settings.beyond, usual)]
    if not learnt:
        return "program changed", f"{outside}: record the new program first"
    found = causes(learnt, quiet)
    if len(found) == 1:
        return CAUSES[found[0]], f"{MEANINGS[found[0]]}: {REMEDIES[found[0]]}"
    if found:
        named = " or ".join(dict.fromkeys(CAUSES[one] for one in found))
        return "not known", f"{named}, not clear yet: the next nights tell"
    return "not known", "no single cause explains it"
