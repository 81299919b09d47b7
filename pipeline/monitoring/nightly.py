"""Scores of the champion on nights that it has not seen, each once, for the ledger of its machine.

A night is a day of continuous records after the champion's training; elsewhere new recordings,
those that its verdict does not know.  Golden and sealed records are never scored: a set that is
looked at each night is learnt.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.monitoring.budget import Budget, MonitoringSettings, budgets
from pipeline.monitoring.drift import Target, decided
from pipeline.monitoring.reasons import beyond, parts_of
from pipeline.schema.bundle import MODEL, VERDICT, stored_bundle
from pipeline.schema.days import day_of_text, is_day, zone_of
from pipeline.schema.golden import GoldenSets
from pipeline.schema.ledger import Ask, Night, Result, read_ledger
from pipeline.schema.model import Model
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.cases import Case, Cases, Records, nights
from pipeline.submodels.contract import SubModel, judging_of, submodel
from pipeline.submodels.judge import Judged, judge
from pipeline.submodels.scoring import ALL, scored_rows

MOST_APART_DAYS = 8
"""Days from a record to the next between which the recording goes on: a week that lacks all."""
IDENTIFICATION: Ask = "identification"
TRAINING: Ask = "training"
"""Work on a physical sub-model, and on one with a network that is trained."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServingModel:
    """A sub-model that serves: its files, its settings, its error budgets."""

    one: SubModel[Any, Any, Any]
    folder: Path
    judging: Any
    model: Model
    verdict: Verdict
    bundle: str
    sha256: str
    budgets: Mapping[Target, Budget]

    def works_on(self, day: date) -> bool:
        """Whether a training day was a day of the same weekday."""
        days = [one.case for one in self.model.trained_on if is_day(one.case)]
        return any(date.fromisoformat(one).weekday() == day.weekday() for one in days)


def score_nights(
    champion: Path,
    records: Records,
    ledger: Path,
    *,
    sets: GoldenSets | None,
    values: dict[str, Any],
    settings: MonitoringSettings,
) -> tuple[Night, ...]:
    """Nights of the champion in ``champion`` that the ledger does not hold yet, oldest first.

    ``values`` are the parameters, as :func:`pipeline.parameters.read_params` gives them.
    """
    bundle = stored_bundle(champion, champion.name)
    known = read_ledger(ledger)
    found: list[Night] = []
    for name, held in () if bundle is None else bundle.submodels.items():
        one, folder = submodel(name), champion / name
        judging = judging_of(one, values, champion.name)
        serving = serving_model(
            one, folder, judging, settings, bundle=bundle.sha256 if bundle else "",
            sha256=held.sha256,
        )  # fmt: skip
        if serving.budgets:
            cases = one.cases(records, judging, sets)
            each = _nights(serving, cases, records, sets)
            found += scored(serving, each, known, settings, cases.absent)
    return tuple(sorted(found, key=lambda night: night.night))


def serving_model(
    one: SubModel[Any, Any, Any], folder: Path, judging: Any, settings: MonitoringSettings, *,
    bundle: str, sha256: str,
) -> ServingModel:  # fmt: skip
    """The sub-model in ``folder`` with its budgets; StoreError where a file is missing."""
    model, verdict = read_json(folder / MODEL, one.model), read_json(folder / VERDICT, Verdict)
    allowed = budgets(one.targets(judging, model), verdict, settings)
    return ServingModel(
        one=one, folder=folder, judging=judging, model=model, verdict=verdict, bundle=bundle,
        sha256=sha256,
        budgets={(one.name, b.target.quantity, b.target.regime): b for b in allowed},
    )  # fmt: skip


def scored(
    serving: ServingModel, each: Iterable[tuple[str, tuple[Case, ...]]],
    known: Sequence[Night], settings: MonitoringSettings,
    absent: Mapping[str, Sequence[str]] | None = None,
) -> list[Night]:  # fmt: skip
    """Nights of one sub-model that ``known`` lacks, each decided after those before it.

    ``each``: cases by night; the newest night in ``known`` is scored again where its files have
    changed.  ``absent``: data items that no record has, see :class:`Cases`.
    """
    before = [one for one in known if one.target[0] == serving.one.name]
    before = [one for one in before if one.model == serving.sha256]
    last = max((one.night for one in before), default="")
    held = {(one.night, one.records if one.night == last else "") for one in before}
    found: list[Night] = []
    predictor, work = None, IDENTIFICATION
    for night, group in each:
        if (night, _digest(group) if night == last else "") in held:
            continue
        if predictor is None:
            predictor = serving.one.load(serving.folder, serving.judging)
            work = TRAINING if serving.one.curves(serving.folder) else IDENTIFICATION
        judged = judge(
            serving.model, predictor, Cases(cases=group),
            [budget.target for budget in serving.budgets.values()],
            sets=None, files={}, roles=("held_out",),
        )  # fmt: skip
        rows = list(_rows(serving, night, group, judged, settings, absent or {}))
        far, words = beyond(judged.verdict.outside)
        rows = [replace(one, beyond=far) for one in rows]
        found += decided(
            rows, (*before, *found), serving.budgets, settings, outside=words, work=work
        )
    return found


def _nights(
    serving: ServingModel, cases: Cases, records: Records, sets: GoldenSets | None
) -> Iterator[tuple[str, tuple[Case, ...]]]:
    """Nights and their cases; a working day without a case has none."""
    trained = {one.case for one in serving.model.trained_on}
    learnt = max((day for day in trained if is_day(day)), default="")
    if not any(is_day(case.name) for case in cases.cases):
        seen = trained | {one.case for one in serving.verdict.cases}
        new = [case for case in cases.of("held_out") if case.name not in seen]
        fitted = serving.model.training_files
        by_night: dict[str, list[Case]] = {}
        for case in new:
            if not any(one.sha256 in fitted for one in case.files):
                by_night.setdefault(_night_of(case, records), []).append(case)
        yield from ((night, tuple(some)) for night, some in sorted(by_night.items()))
        return
    days = {day: some for day, some in nights(cases).items() if day > learnt}
    for day in sorted({*days, *_working_days(serving, learnt, cases, records, sets)}):
        yield day, days.get(day, ())


def _night_of(case: Case, records: Records) -> str:
    """Day of the last record of a recording; its name where it has no clock."""
    ends = [records.files.get(one.file, {}).get("last") for one in case.files]
    known = [str(end) for end in ends if end]
    zone = zone_of(records.clean) if records.clean is not None else "UTC"
    return day_of_text(max(known), zone) if known else case.name


def _working_days(
    serving: ServingModel, learnt: str, cases: Cases, records: Records, sets: GoldenSets | None
) -> Iterator[str]:
    """Weekdays worked in training that lack a case in the midst of records, and are not frozen.

    Records in their midst are of the same recorders and at most :data:`MOST_APART_DAYS` apart:
    beyond that recording was stopped.
    """
    zone, files = zone_of(records.clean) if records.clean is not None else "UTC", records.files
    sources = {_source(one.file, files) for case in serving.model.trained_on for one in case.files}
    known = {case.name for case in cases.cases}
    ends = {day_of_text(str(one["last"]), zone) for name, one in files.items()
            if one.get("last") and _source(name, files) in sources}  # fmt: skip
    frozen = [one.days for one in (sets.golden, sets.sealed) if one and one.days] if sets else []
    recorded = sorted(date.fromisoformat(day) for day in known | ends if day >= learnt)
    for before, after in pairwise(recorded):
        apart = (after - before).days
        for day in (before + timedelta(days=k) for k in range(apart)):
            judged = str(day) in known or any(str(day) in span for span in frozen)
            lost = not judged and apart <= MOST_APART_DAYS and str(day) > learnt
            if lost and serving.works_on(day):
                yield str(day)


def _source(file: str, files: Mapping[str, Mapping[str, Any]]) -> tuple[str, str]:
    """Folder of a raw file, digits apart, and its format: what one recorder writes."""
    return re.sub(r"\d+", "#", file.rpartition("/")[0]), str(files.get(file, {}).get("format"))


def _rows(
    serving: ServingModel, night: str, group: Sequence[Case], judged: Judged,
    settings: MonitoringSettings, absent: Mapping[str, Sequence[str]],
) -> Iterator[Night]:  # fmt: skip
    """Each target of a night with its errors; one line without a target where nothing is scored."""
    head: dict[str, Any] = {
        "night": night, "bundle": serving.bundle, "model": serving.sha256,
        "submodel": serving.one.name, "records": _digest(group),
    }  # fmt: skip
    scores = {(s.quantity, s.regime): s for s in judged.verdict.scores if s.group == ALL}
    scored = False
    for (_, quantity, regime), budget in serving.budgets.items():
        score = scores.get((quantity, regime))
        share = None if score is None else budget.share(score)
        if score is None or share is None or score.n < settings.least_records * budget.samples:
            continue
        scored = True
        yield Night(
            **head, quantity=quantity, regime=regime, unit=budget.target.unit, n=score.n,
            mae=score.mae, rmse=score.rmse, budgets=budget.allowed, share=round(share, 4),
            parts=_parts(serving, group, judged, budget),
            result="over" if share > 1 else "within",
        )  # fmt: skip
    if not scored:
        continuous = not group or is_day(group[0].name)
        missing = continuous and serving.works_on(date.fromisoformat(night))
        notes = [one.note for one in judged.verdict.cases if one.note]
        lacking = [f"no record has {item}" for item in absent]
        why = "; ".join([*notes, *lacking]) or "there are too few records"
        result: Result = "no records" if missing else "not scored"
        yield Night(**head, quantity="", regime="", unit="", n=0, result=result, words=why)


def _parts(
    serving: ServingModel, group: Sequence[Case], judged: Judged, budget: Budget
) -> dict[str, float]:
    """Parts of a target's residual by cause, over all cases of a night."""
    rows = scored_rows(judged.predictions, budget.target)
    found: list[Mapping[str, Any]] = []
    for case in group:
        own = rows[rows["case"] == case.name]
        if len(own):
            found.append(
                {"measured": own["measured"].to_numpy(float),
                 "predicted": own["predicted"].to_numpy(float),
                 **serving.one.influences(case, own)}
            )  # fmt: skip
    names = set.intersection(*(set(one) for one in found)) if found else set()
    joined = {name: np.concatenate([one[name] for one in found]) for name in sorted(names)}
    measured, predicted = joined.pop("measured"), joined.pop("predicted")
    return parts_of(measured, predicted, joined)


def _digest(group: Sequence[Case]) -> str:
    """Hash of the raw files of a night."""
    hashes = sorted({one.sha256 for case in group for one in case.files})
    return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]
