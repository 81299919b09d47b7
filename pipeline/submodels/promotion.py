"""Gate of a promotion: a challenger is judged against the champion, rule by rule.

Both are compared on the golden cases of the machine, or on the held-out ones where no golden case
decides, group by group (day, recording, tool); on the newest day where records are continuous; and
on the sealed cases last.  A case whose raw files one of the two was fitted on is left out.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.schema.bundle import VERDICT, Bundle
from pipeline.schema.decision import Against, Compared, PromotionSettings, Result, Rule, RuleName
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Model
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.verdict import Role, Score, Status, Verdict
from pipeline.submodels.cases import Cases, golden_used, leak_reasons, learnt_from, newest_day
from pipeline.submodels.contract import SubModel, Target
from pipeline.submodels.judge import judge
from pipeline.submodels.scoring import ALL, FEWEST_GROUPS
from pipeline.submodels.statistics import LEVEL, gains

Look = Literal["golden", "newest day", "sealed"]
"""Cases that are looked at."""
LACKING: tuple[Status, ...] = ("failed", "not judged")
"""Statuses that are a failure where the champion's is none of them."""


Files = Mapping[str, Mapping[str, Any]]
ReadCases = Callable[[], tuple[Cases, Files]]
"""Cases of a sub-model, and the manifest of the raw files."""


@dataclass(frozen=True, kw_only=True)
class Contest:
    """Champion and challenger of one sub-model on the same cases."""

    submodel: str
    """Sub-model."""
    compared: tuple[Compared, ...]
    """Comparisons by target with limits; none where no case could be compared."""
    champion: Status = "not judged"
    challenger: Status = "not judged"
    """Status of each against its limits, on the cases that were looked at."""
    lost: tuple[str, ...] = ()
    """Targets and groups that the champion predicts and the challenger does not, in words."""
    learnt: tuple[str, ...] = ()
    """Frozen records that the challenger was fitted on, in words."""
    canaries: tuple[str, ...] = ()
    """Words of the canaries that the challenger did not pass."""
    note: str = ""
    """Why nothing was compared."""

    @property
    def words(self) -> str:
        """The contest as one sentence."""
        return "; ".join(one.words for one in self.compared) or f"{self.submodel}: {self.note}"


def contest(
    submodel: SubModel[Any, Any, Any],
    judging: Any,
    read: Sequence[ReadCases],
    *,
    sets: GoldenSets | None,
    champion: Path,
    challenger: Path,
    settings: PromotionSettings,
    look: Look = "golden",
    tests: int = 1,
) -> Contest | None:
    """Compare the errors of both models of a sub-model on the same cases.

    ``judging`` are settings of its judging type; ``read`` gives the cases for champion and for
    challenger, which differ where it builds on other models; ``champion`` and ``challenger`` are
    the folders of the two models; ``tests`` the comparisons of the whole decision.  Where both
    verdicts are on the present golden set and by the present limits, their scores are taken.  None
    where there is no case of that look.
    """
    name, folders = submodel.name, (champion, challenger)
    try:
        models: list[Model] = [read_json(f / "model.json", submodel.model) for f in folders]
        verdicts = [read_json(folder / VERDICT, Verdict) for folder in folders]
        limits = [submodel.targets(judging, model) for model in models]
        if look != "golden" or not _same_cases(models, verdicts, limits, sets):
            both = [cases() for cases in read]
            looked_at, roles = _looked_at(both[1][0], look)
            if look != "golden" and not looked_at:
                return None
            names = {
                case.name for case in looked_at
                if not any(leak_reasons(model, [case]) for model in models)
            }  # fmt: skip
            verdicts = [
                judge(
                    model, submodel.load(folder, judging),
                    Cases(cases=tuple(case for case in cases.cases if case.name in names)),
                    targets, sets=sets, files=files, roles=roles,
                ).verdict
                for model, folder, targets, (cases, files) in zip(
                    models, folders, limits, both, strict=True
                )
            ]  # fmt: skip
    except StoreError as error:
        return Contest(submodel=name, compared=(), note=f"cannot be compared: {error}")
    compared = tuple(compare(verdicts[0], verdicts[1], settings, tests=tests))
    if look != "golden" and not compared:  # nobody worked, or nothing was measured
        return None
    note = "" if compared else "no case that neither model was fitted on could be compared"
    return Contest(
        submodel=name, compared=compared, note=note,
        champion=verdicts[0].status, challenger=verdicts[1].status,
        lost=tuple(_lost(verdicts[0], verdicts[1])), learnt=tuple(_learnt(models[1], sets)),
        canaries=tuple(one.words for one in verdicts[1].canaries if one.status == "failed"),
    )  # fmt: skip


def _looked_at(cases: Cases, look: Look) -> tuple[Sequence[Any], tuple[Role, ...]]:
    if look == "newest day":
        return newest_day(cases), ("held_out",)
    roles: tuple[Role, ...] = ("sealed",) if look == "sealed" else ("golden", "held_out")
    return cases.of(*roles), roles


def _same_cases(
    models: Sequence[Model],
    verdicts: Sequence[Verdict],
    limits: Sequence[Sequence[Target]],
    sets: GoldenSets | None,
) -> bool:
    """Whether two verdicts are on the present golden cases and limits, and no case was learnt."""
    if sets is None or sets.golden is None:
        return False
    first, second = ({(c.case, c.group) for c in v.cases if c.role == "golden"} for v in verdicts)
    present = golden_used(sets.golden)
    return (
        first == second
        and all(v.judged_role == "golden" and v.golden == present for v in verdicts)
        and all(_judged_by(v, targets) for v, targets in zip(verdicts, limits, strict=True))
        and not any(_learnt(model, sets) for model in models)
    )


def _judged_by(verdict: Verdict, targets: Sequence[Target]) -> bool:
    """Whether the scores of a verdict were held against the limits of some targets."""
    wanted = {(t.quantity, t.regime): dict(t.limits) for t in targets}
    own = [s for s in verdict.scores if s.role == "golden" and s.limits]
    return all(wanted.get((s.quantity, s.regime)) == dict(s.limits) for s in own)


def _learnt(model: Model, sets: GoldenSets | None) -> list[str]:
    """Frozen records that a model was fitted on, in words."""
    if sets is None:
        return []
    found: dict[str, None] = {}
    for what, frozen in (("golden", sets.golden), ("sealed", sets.sealed)):
        pairs = [learnt_from(frozen, case) for case in model.trained_on] if frozen else []
        for pair in filter(None, pairs):
            found[f"{model.submodel} was fitted on {pair[1].file} of the {what} set"] = None
    return list(found)


def compare(
    champion: Verdict, challenger: Verdict, settings: PromotionSettings, *, tests: int = 1
) -> list[Compared]:
    """Errors of two models of a sub-model, paired over the groups that decide.

    Both are verdicts on the same cases.  Of ``tests`` comparisons in all each is held to its share
    of the level (Bonferroni), so that many quantities make no gain by chance.
    """
    first, second = _by_group(champion), _by_group(challenger)
    targets = dict.fromkeys((s.quantity, s.regime, s.unit) for s in second.values())
    found = []
    for quantity, regime, unit in targets:
        keys = [k for k in second if k[:2] == (quantity, regime) and k in first]
        if not keys:
            continue
        pairs = [(first[key], second[key]) for key in keys]
        mean_old, mean_new = (
            float(np.mean([pair[side].mae or 0.0 for pair in pairs])) for side in (0, 1)
        )
        result, worst = _against(pairs, mean_old, mean_new, settings, LEVEL / max(tests, 1))
        found.append(
            Compared(
                submodel=challenger.submodel, quantity=quantity, regime=regime, unit=unit,
                groups=len(keys), champion=mean_old, challenger=mean_new, result=result,
                worst_group=worst,
            )
        )  # fmt: skip
    return found


def _against(
    pairs: Sequence[tuple[Score, Score]],
    old: float,
    new: float,
    settings: PromotionSettings,
    level: float,
) -> tuple[Against, str]:
    """Result of a target from its groups' scores and both means, and the group that alone is bad.

    Better is what a paired test over the groups shows, by more than trainings with other seeds
    differ; worse what passes a tolerance by more than that.
    """
    spread = float(np.mean([score.spread.get("mae", 0.0) for _, score in pairs]))
    rises = {b.group: (b.mae or 0.0) - (a.mae or 0.0) - b.spread.get("mae", 0.0) for a, b in pairs}
    worst = max(rises, key=lambda group: rises[group])
    if rises[worst] > settings.group_tolerance * old:
        return "worse", worst
    if new > (1 + settings.tolerance) * old:
        return ("worse" if new - old > spread else "not decided"), ""
    before, after = (
        np.array([pair[side].rmse for pair in pairs], dtype=float) ** 2 for side in (0, 1)
    )
    if gains(before, after, level):
        return ("better" if old - new > spread else "not decided"), ""
    return "equal", ""


def deciding(verdict: Verdict) -> list[tuple[str, str]]:
    """Quantities and regimes that a verdict rests on and that are compared group by group."""
    return list(dict.fromkeys(key[:2] for key in _by_group(verdict)))


def _lost(champion: Verdict, challenger: Verdict) -> list[str]:
    """What the champion predicts where it decides, and the challenger does not."""
    first, second = _by_group(champion), _by_group(challenger)
    kept = {key[:2] for key in second}
    name = challenger.submodel
    gone = dict.fromkeys(f"{q} {r}".strip() for q, r, _ in first if (q, r) not in kept)
    lacking = dict.fromkeys(
        f"{q} {r}".strip() + f" in {group}"
        for q, r, group in first if (q, r) in kept and (q, r, group) not in second
    )  # fmt: skip
    return [f"{name} no longer predicts {one}" for one in (*gone, *lacking)]


def _by_group(verdict: Verdict) -> dict[tuple[str, str, str], Score]:
    """Scores of targets that decide, by quantity, regime and group."""
    own = [s for s in verdict.scores if s.role == verdict.judged_role]
    rests_on = {(s.quantity, s.regime) for s in own if s.status != "not judged"}
    return {
        (s.quantity, s.regime, s.group): s for s in own
        if (s.quantity, s.regime) in rests_on and s.group != ALL and None not in (s.mae, s.rmse)
    }  # fmt: skip


# The rules.


def first_rules(
    contests: Sequence[Contest],
    newest: Sequence[Contest],
    *,
    champion: Bundle,
    challenger: Bundle,
    serving: Iterable[str],
) -> list[Rule]:
    """Rules that are judged before anything sealed is looked at.

    ``contests`` and ``newest`` are of the sub-models that differ and serve now or would, on the
    golden cases and on the newest day; ``serving`` are the sub-models of the champion that serve.
    """
    served = set(serving)
    absent = [name for name in champion.submodels if name not in challenger.submodels]
    return [
        _rule("complete", [
            (name in served, f"it has no {name}, which serves" if name in served
             else f"{name} is gone, on which nothing rests") for name in absent
        ]),
        _rule("unseen", [(True, word) for one in contests for word in one.learnt]),
        _rule("canaries", [(True, f"{one.submodel}: {word}")
                           for one in contests for word in one.canaries]),
        _rule("no new failure", _failures(contests, challenger, served)),
        _not_worse("not worse", contests, served),
        _not_worse("newest day", newest, served),
        _better(contests, champion, challenger, served),
    ]  # fmt: skip


def sealed_rule(contests: Sequence[Contest]) -> Rule:
    """Rule of the sealed set: nothing that is to serve fails anew there, and nothing is worse."""
    failed = [
        (True, f"its {one.submodel} fails on the sealed set: {one.words}")
        for one in contests
        if one.challenger == "failed" != one.champion
    ]
    return _not_worse("sealed", contests, {one.submodel for one in contests}, failed)


Said = tuple[bool, str]
"""Words of a rule, and whether they break it; what breaks none is said all the same."""


def _rule(name: RuleName, said: Iterable[Said], figures: Sequence[Compared] = ()) -> Rule:
    words = sorted(said, key=lambda one: not one[0])  # what breaks it first
    result: Result = "broken" if any(breaks for breaks, _ in words) else "kept"
    return Rule(name=name, result=result, words=tuple(word for _, word in words),
                figures=tuple(figures))  # fmt: skip


def _failures(contests: Sequence[Contest], challenger: Bundle, served: set[str]) -> Iterator[Said]:
    """Failures of what serves; those that the champion has as well are said and break nothing."""
    changed = {one.submodel: one for one in contests}
    for name, one in challenger.submodels.items():
        again = changed[name].challenger if name in changed else one.status
        if name not in served or (one.status not in LACKING and again not in LACKING):
            continue
        if name not in changed:
            yield False, f"{name} is {one.status}, the same model as the champion's"
        elif changed[name].champion in LACKING:
            yield False, f"{name} is {one.status} in both"
        else:
            status = one.status if one.status in LACKING else again
            words = changed[name].words
            yield True, f"its {name} is {status} where the champion's passes: {words}"


def _not_worse(
    name: RuleName, contests: Sequence[Contest], served: set[str], said: Sequence[Said] = ()
) -> Rule:
    """Nothing that serves is worse, over all groups or in one of them."""
    if not contests:
        return Rule(name=name, result="no data", words=("there are no such records",))
    found = list(said)
    for one in contests:
        blocks = one.submodel in served
        found += [(blocks, word) for word in one.lost if one.compared]
        if not one.compared:
            found.append((blocks, f"{one.submodel}: {one.note}"))
        for compared in one.compared:
            if compared.result == "worse":
                found.append((blocks, f"worse: {compared.words}"))
            elif compared.result == "not decided" and compared.challenger > compared.champion:
                found.append((False, f"within the spread of trainings: {compared.words}"))
    return _rule(name, found, [compared for one in contests for compared in one.compared])


def _better(
    contests: Sequence[Contest], champion: Bundle, challenger: Bundle, served: set[str]
) -> Rule:
    """At least one sub-model that will serve is better, or passed and did not serve before."""
    passed = {name for name, one in challenger.submodels.items() if one.status == "passed"}
    gained = [f"adds {name}, which passed" for name in sorted(passed)
              if name not in champion.submodels]  # fmt: skip
    before = {name: one.status for name, one in champion.submodels.items()}
    before |= {one.submodel: one.champion for one in contests}
    gained += [
        f"{name} passed and is {before[name]} in the champion" for name in sorted(passed)
        if before.get(name) in LACKING and name not in served
    ]  # fmt: skip
    compared = [c for one in contests if one.submodel in passed for c in one.compared]
    better = [f"better: {one.words}" for one in compared if one.result == "better"]
    if gained or better:
        return Rule(name="better", result="kept", words=(*gained, *better))
    near = [one for one in compared
            if one.result == "not decided" and one.challenger < one.champion]  # fmt: skip
    if near:
        said = "; ".join(one.words for one in near)
        return Rule(name="better", result="not decided",
                    words=(f"the gain is within the spread of trainings: {said}",))  # fmt: skip
    few = compared and all(one.groups < FEWEST_GROUPS for one in compared)
    return Rule(name="better", result="not decided" if few else "broken",
                words=tuple(_not_better(compared)))  # fmt: skip


def _not_better(compared: Sequence[Compared]) -> Iterator[str]:
    """Why no difference counts, by sub-model: too few groups, or none that chance cannot make."""
    if not compared:
        yield "no sub-model that would serve was compared, so that none is shown to be better"
    for name in dict.fromkeys(one.submodel for one in compared):
        own = [one for one in compared if one.submodel == name]
        groups = max(one.groups for one in own)
        over = "1 group" if groups == 1 else f"{groups} groups"
        if groups < FEWEST_GROUPS:
            yield f"{name}: {over} to judge by, at least {FEWEST_GROUPS} are needed: not decided"
            continue
        changes = [100 * (one.challenger / one.champion - 1) for one in own if one.champion]
        ends = dict.fromkeys(f"{end(changes):+.2g}" for end in (min, max) if changes)
        by = f"{' to '.join(ends)} %" if ends else "nothing"
        yield f"{name} is not significantly better: mean errors change by {by} over {over}"
