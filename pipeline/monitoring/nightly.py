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
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.monitoring.budget import Budget, MonitoringSettings, budgets
from pipeline.monitoring.drift import Target, decided
from pipeline.monitoring.reasons import beyond, parts_of
from pipeline.schema.bundle import MODEL, VERDICT, stored_bundle
from pipeline.schema.days import day_of_text, is_day, zone_of
from pipeline.schema.golden import GoldenSets
from pipeline.schema.ledger import Night, Result
from pipeline.schema.model import Model
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.cases import Case, Cases, Records, nights
from pipeline.submodels.contract import Predictor, SubModel, judging_of, submodel
from pipeline.submodels.judge import Judged, judge
from pipeline.submodels.scoring import ALL, scored_rows

MOST_APART_DAYS = 8
"""Days from a record to the next between which the recording goes on: a week that lacks all."""
Group = tuple[str, tuple[Case, ...]]
"""A night and its cases."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServingModel:
    """A sub-model that serves: its files, its settings, its error budgets."""

    one: SubModel[Any, Any, Any]
    folder: Path
    judging: Any
    settings: MonitoringSettings
    bundle: str
    sha256: str
    """Hashes of the bundle and of the sub-model in it."""

    @cached_property
    def model(self) -> Model:
        """The model; StoreError where its file is missing."""
        return read_json(self.folder / MODEL, self.one.model)

    @cached_property
    def predictor(self) -> Predictor:
        """Prediction of a case: the one way in which the champion is asked for a day."""
        return self.one.load(self.folder, self.judging)

    @cached_property
    def verdict(self) -> Verdict:
        """Its verdict; StoreError where the file is missing."""
        return read_json(self.folder / VERDICT, Verdict)

    @cached_property
    def budgets(self) -> Mapping[Target, Budget]:
        """Error budgets by target."""
        targets = self.one.targets(self.judging, self.model)
        return {(self.one.name, one.target.quantity, one.target.regime): one
                for one in budgets(targets, self.verdict, self.settings)}  # fmt: skip

    @cached_property
    def learnt(self) -> list[str]:
        """Training days, the last one last; none where a case is a recording."""
        return sorted(one.case for one in self.model.trained_on if is_day(one.case))

    def works_on(self, day: str) -> bool:
        """Whether a training day was a day of the same weekday."""
        weekday = date.fromisoformat(day).weekday()
        return any(date.fromisoformat(one).weekday() == weekday for one in self.learnt)


def serving_models(
    champion: Path, values: dict[str, Any], settings: MonitoringSettings
) -> dict[str, ServingModel]:
    """Sub-models that the bundle in ``champion`` holds, by name; none where nothing serves."""
    bundle = stored_bundle(champion, champion.name)
    found = {}
    for name, held in () if bundle is None else bundle.submodels.items():
        one = submodel(name)
        found[name] = ServingModel(
            one=one, folder=champion / name, judging=judging_of(one, values, champion.name),
            settings=settings, bundle=bundle.sha256 if bundle else "", sha256=held.sha256,
        )  # fmt: skip
    return found


def score_nights(
    champion: Path,
    records: Records,
    known: Sequence[Night],
    *,
    sets: GoldenSets | None,
    values: dict[str, Any],
    settings: MonitoringSettings,
) -> tuple[Night, ...]:
    """Nights of the champion in ``champion`` that are not ``known`` yet, oldest first.

    ``values`` are the parameters, as :func:`pipeline.parameters.read_params` gives them.
    """
    found: list[Night] = []
    for serving in serving_models(champion, values, settings).values():
        if serving.budgets:
            cases = serving.one.cases(records, serving.judging, sets)
            each = _nights(serving, cases, records, sets)
            found += scored(serving, each, known, cases.absent)
    return tuple(sorted(found, key=lambda night: night.night))


def scored(
    serving: ServingModel, each: Iterable[Group], known: Sequence[Night],
    absent: Mapping[str, Sequence[str]] | None = None,
) -> list[Night]:  # fmt: skip
    """Nights of one sub-model that ``known`` lacks, each decided after those before it.

    The newest night in ``known`` is scored again where its files have changed.  ``absent``: data
    items that no record has, see :class:`Cases`.
    """
    before = [one for one in known
              if (one.submodel, one.model) == (serving.one.name, serving.sha256)]  # fmt: skip
    last = max((one.night for one in before), default="")
    held = {(one.night, one.records if one.night == last else "") for one in before}
    new = [(night, group) for night, group in each
           if (night, _digest(group) if night == last else "") not in held]  # fmt: skip
    if not new:
        return []
    is_net = bool(serving.one.curves(serving.folder))
    found: list[Night] = []
    for night, group in new:
        judged = judge(
            serving.model, serving.predictor, Cases(cases=group),
            [budget.target for budget in serving.budgets.values()],
            sets=None, files={}, roles=("held_out",),
        )  # fmt: skip
        far, words = beyond(judged.verdict.outside)
        rows = [replace(one, beyond=far)
                for one in _rows(serving, night, group, judged, absent or {})]  # fmt: skip
        found += decided(
            rows, (*before, *found), serving.budgets, serving.settings, outside=words,
            work="training" if is_net else "identification",
        )  # fmt: skip
    return found


def _nights(
    serving: ServingModel, cases: Cases, records: Records, sets: GoldenSets | None
) -> Iterator[Group]:
    """Nights and their cases; a working day without a case has none."""
    zone = zone_of(records.clean or Path())
    if any(is_day(case.name) for case in cases.cases):
        learnt = max(serving.learnt, default="")
        days = {day: some for day, some in nights(cases).items() if day > learnt}
        lost = _lost_days(serving, learnt, cases, records, sets, zone)
        yield from ((day, days.get(day, ())) for day in sorted({*days, *lost}))
        return
    seen = {one.case for one in serving.model.trained_on}
    seen |= {one.case for one in serving.verdict.cases}
    fitted = serving.model.training_files
    by_night: dict[str, list[Case]] = {}
    for case in cases.of("held_out"):
        if case.name not in seen and not any(one.sha256 in fitted for one in case.files):
            by_night.setdefault(_night_of(case, records, zone), []).append(case)
    yield from ((night, tuple(some)) for night, some in sorted(by_night.items()))


def _night_of(case: Case, records: Records, zone: str) -> str:
    """Day of the last record of a recording; its name where it has no clock."""
    ends = [records.files.get(one.file, {}).get("last") for one in case.files]
    known = [str(end) for end in ends if end]
    return day_of_text(max(known), zone) if known else case.name


def _lost_days(
    serving: ServingModel, learnt: str, cases: Cases, records: Records, sets: GoldenSets | None,
    zone: str,
) -> Iterator[str]:  # fmt: skip
    """Weekdays worked in training that lack a case in the midst of records, and are not frozen.

    Records in their midst are of the same recorders and at most :data:`MOST_APART_DAYS` apart:
    beyond that recording was stopped.
    """
    files = records.files
    sources = {_source(one.file, files) for case in serving.model.trained_on for one in case.files}
    known = {case.name for case in cases.cases}
    ends = {day_of_text(str(one["last"]), zone) for name, one in files.items()
            if one.get("last") and _source(name, files) in sources}  # fmt: skip
    frozen = [one.days for one in (sets.golden, sets.sealed) if one and one.days] if sets else []
    recorded = sorted(date.fromisoformat(day) for day in known | ends if day >= learnt)
    for before, after in pairwise(recorded):
        if (after - before).days > MOST_APART_DAYS:
            continue
        for day in (str(before + timedelta(days=k)) for k in range((after - before).days)):
            is_free = day > learnt and day not in known and not any(day in span for span in frozen)
            if is_free and serving.works_on(day):
                yield day


def _source(file: str, files: Mapping[str, Mapping[str, Any]]) -> tuple[str, str]:
    """Folder of a raw file, digits apart, and its format: what one recorder writes."""
    return re.sub(r"\d+", "#", file.rpartition("/")[0]), str(files.get(file, {}).get("format"))


def _rows(
    serving: ServingModel, night: str, group: Sequence[Case], judged: Judged,
    absent: Mapping[str, Sequence[str]],
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
        least = serving.settings.least_records * budget.samples
        if score is None or share is None or score.n < least:
            continue
        scored = True
        yield Night(
            **head, quantity=quantity, regime=regime, unit=budget.target.unit, n=score.n,
            mae=score.mae, rmse=score.rmse, budgets=budget.allowed, share=round(share, 4),
            parts=_parts(serving, group, judged, budget),
            result="over" if share > 1 else "within",
        )  # fmt: skip
    if not scored:
        missing = (not group or is_day(group[0].name)) and serving.works_on(night)
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
    tables = []
    for case in group:
        own = rows[rows["case"] == case.name].reset_index(drop=True)
        if len(own):
            both = own[["measured", "predicted"]].astype(float)
            tables.append(both.assign(**serving.one.influences(case, own)))
    joined = pd.concat(tables, join="inner")
    columns = {name: joined[name].to_numpy(float) for name in sorted(map(str, joined))}
    return parts_of(columns.pop("measured"), columns.pop("predicted"), columns)


def _digest(group: Sequence[Case]) -> str:
    """Hash of the raw files of a night."""
    hashes = sorted({one.sha256 for case in group for one in case.files})
    return hashlib.sha256("".join(hashes).encode()).hexdigest()[:16]
