"""Sub-models of a machine: their stored files, and the page that is made of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.charts.sections import SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.submodel_page import PageContent, Subject, submodel_page
from pipeline.report.folders import MachineFolders
from pipeline.schema.bundle import BUNDLE, Bundle, model_hash
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Model
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown, submodel

TRAINING = "the raw files that it names"
JUDGED = "the model and records that it was not fitted on"


@dataclass(frozen=True, kw_only=True)
class ModelledPart:
    """Sub-model of a machine: its name, its title, its files, its page."""

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
    subject = Subject(name=name, title=one.title, needs=one.needs)
    page = submodel_page(shown, subject, one.page(shown) or PageContent())
    return ModelledPart(name=name, title=one.title, shown=shown, page=page)


@dataclass(frozen=True, kw_only=True)
class Serving:
    """The champion beside the latest models."""

    path: Path
    """Path of the champion's bundle."""
    bundle: Bundle
    """Bundle that serves."""
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
