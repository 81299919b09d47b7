"""Sub-models of a machine: their stored files, and the page that each makes of them.

A sub-model that makes no page of its own gets the default section: parameters, scores, typical and
worst case, provenance, with a verdict in general words.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.charts.default_section import default_blocks
from pipeline.charts.numbers import counted
from pipeline.charts.sections import PartVerdict, Section, SubModelPage, absent
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import sources
from pipeline.report.folders import MachineFolders
from pipeline.report.worst_error import worst_error
from pipeline.schema.bundle import BUNDLE, Bundle, model_hash
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Model
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown, submodel

TRAINING = "the raw files that it names"
JUDGED = "the model and records that it was not fitted on"


@dataclass(frozen=True, kw_only=True)
class ModelledPart:
    """One sub-model of a machine: its name, its title, its files, its page."""

    name: str
    title: str
    shown: Shown[Any]
    page: SubModelPage

    @property
    def model(self) -> Model | None:
        """The stored model; None where there is none."""
        return self.shown.model

    @property
    def judged(self) -> Verdict | None:
        """The stored verdict; None where there is none."""
        return self.shown.verdict

    def leaked(self, sets: GoldenSets | None) -> list[str]:
        """Cases or frozen files to judge by that the model was also fitted on."""
        if self.model is None:
            return []
        fitted = self.model.training_files
        frozen = () if sets is None or sets.golden is None else sets.golden.files
        found = [one.file for one in frozen if one.sha256 in fitted]
        trained = {one.case for one in self.model.trained_on}
        cases = () if self.judged is None else self.judged.cases
        return found or [
            one.case for one in cases if one.role in ("golden", "held_out") and one.case in trained
        ]


def modelled_parts(
    folders: MachineFolders, shelf: SourceRegistry, truth: Mapping[str, Any] | None
) -> list[ModelledPart]:
    """Sub-models of a machine, in the order of the fleet."""
    return [_part(name, folders, shelf, truth) for name in folders.submodels]


def _part(
    name: str, folders: MachineFolders, shelf: SourceRegistry, truth: Mapping[str, Any] | None
) -> ModelledPart:
    one, folder = submodel(name), folders.models / name
    shown: Shown[Any] = Shown(
        machine=folders.name,
        origin=folders.origin,
        model=shelf.read(folder / "model.json", one.model, TRAINING),
        verdict=shelf.read(folder / "verdict.json", Verdict, JUDGED),
        predictions=shelf.predictions(folder / "predictions.parquet", JUDGED),
        truth=truth,
        shelf=shelf,
        folder=folder,
        clean=folders.clean,
        signals=folders.signals,
    )
    page = one.page(shown)
    if page is None:
        page = default_page(shown, name, one.title, one.needs)
    elif shown.verdict is not None and shown.verdict.status == "not decided":
        page = replace(page, verdict=_undecided(shown.verdict, one.title, one.needs))
    return ModelledPart(name=name, title=one.title, shown=shown, page=page)


def _undecided(verdict: Verdict, title: str, needs: str) -> PartVerdict:
    """What a figure too near to its limit asks for, the same of every sub-model."""
    reasons = [one.rstrip(".").removesuffix(", not decided") for one in verdict.reasons]
    why, *others = reasons or ["the judge gave no reason"]
    if others:
        why += f"; and {counted(len(others), 'more figure')}"
    return PartVerdict(
        status="attention",
        sentence=f"The model of the {title} is not decided: {why}.",
        todo=f"Record more: {needs}.",
    )


def default_page(shown: Shown[Any], name: str, title: str, needs: str) -> SubModelPage:
    """Page of a sub-model that makes none of its own.

    Parameters
    ----------
    shown : Shown
        Its files.
    name, title, needs : str
        Of the sub-model.
    """
    files = [shown.folder / f for f in ("model.json", "verdict.json", "predictions.parquet")]
    text = [absent(path, f"It needs {needs}.") for path in files[:1] if shown.model is None]
    if shown.verdict is not None and shown.verdict.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(shown.verdict.reasons) + ".")
    blocks = default_blocks(
        shown.model, shown.verdict, shown.predictions, sources(shown.shelf, *files)
    )
    section = Section(key=name, title=title[:1].upper() + title[1:], text=text, blocks=blocks)
    return SubModelPage(verdict=_verdict(shown, title, needs), sections=[section])


def _verdict(shown: Shown[Any], title: str, needs: str) -> PartVerdict | None:
    """Status, the worst score that decided against its limit and best baseline, what to do."""
    v = shown.verdict
    if v is None and shown.model is None:
        return None
    if v is None or v.status == "not judged":
        why = "; ".join(v.reasons) if v is not None and v.reasons else "no record to judge it by"
        return PartVerdict(
            status="unknown",
            sentence=f"The model of the {title} has not been judged: {why.rstrip('.')}.",
            todo=f"Record {needs}.",
        )
    by = "golden records" if v.judged_role == "golden" else "records held out of its fit"
    sentence = f"The model of the {title} {v.status} on {by}{_worst_words(v)}."
    if v.status == "not decided":
        return _undecided(v, title, needs)
    if v.status == "failed":
        todo = f"Do not use this model; to mend it, record {needs}."
        return PartVerdict(status="failed", sentence=sentence, todo=todo)
    return PartVerdict(status="passed", sentence=sentence, todo="The model may serve.")


def _worst_words(verdict: Verdict) -> str:
    """The score that takes the largest share of a limit, beside that limit and a baseline."""
    worst = worst_error(verdict)
    if worst is None:
        return ""
    score = worst.score
    where = "over all" if score.group == "all" else f"worst in {score.group}"
    baseline = f"; {worst.baseline[0]} {worst.baseline[1]}" if worst.baseline else ""
    return (
        f": {score.quantity}, {worst.words} {worst.shown} {where} (limit {worst.limit_shown}"
        f"{baseline})"
    )


@dataclass(frozen=True, kw_only=True)
class Serving:
    """The champion beside the latest models."""

    path: Path
    """Path of the champion's bundle."""
    bundle: Bundle
    """What serves."""
    older: tuple[str, ...]
    """Sub-models of which the champion and the latest are not the same model."""


def serving(
    folders: MachineFolders, shelf: SourceRegistry, parts: list[ModelledPart]
) -> Serving | None:
    """The champion of a machine; None where none serves."""
    if folders.champion is None:
        return None
    path = folders.champion / BUNDLE
    bundle = shelf.read(path, Bundle, "the promotion of a registered version")
    if bundle is None:
        return None
    latest = {one.name: model_hash(one.shown.folder) for one in parts if one.model is not None}
    champion = {name: one.sha256 for name, one in bundle.submodels.items()}
    names = dict.fromkeys([*(one.name for one in parts), *champion])
    older = tuple(name for name in names if latest.get(name) != champion.get(name))
    return Serving(path=path, bundle=bundle, older=older)
