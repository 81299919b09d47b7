"""Stages identify_<sub-model> and judge_<sub-model>, shared by all sub-models."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.schema.bundle import SERVED, served
from pipeline.schema.golden import GoldenSets, read_golden
from pipeline.schema.predictions import write_plots, write_predictions
from pipeline.schema.store import read_json, write_json
from pipeline.submodels.cases import Records, held_back
from pipeline.submodels.contract import SubModel
from pipeline.submodels.judge import judge as judged_on
from pipeline.submodels.judge import metrics as key_figures
from pipeline.submodels.next_recording import next_recordings


def identify(
    submodel: SubModel[Any, Any, Any],
    reads: Mapping[str, Path],
    folder: Path,
    golden: Path | None = None,
    *,
    settings: Any,
) -> None:
    """Fit the sub-model on its training cases, nothing frozen; write ``model.json``.

    ``reads``: folders of the machine's records; ``golden``: folder of the frozen sets.
    """
    sets = _frozen(golden, settings)
    cases = held_back(submodel.cases(Records(**reads), settings, sets), sets)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(submodel.fit(cases, settings, folder), folder / "model.json")


def judge(
    submodel: SubModel[Any, Any, Any],
    reads: Mapping[str, Path],
    folder: Path,
    golden: Path,
    metrics: Path,
    plots: Path,
    *,
    settings: Any,
) -> None:
    """Judge the sub-model in ``folder``; write verdict, predictions, columns, metrics, plots."""
    records = Records(**reads)
    sets = _frozen(golden, settings)
    model = read_json(folder / "model.json", submodel.model)
    cases = submodel.cases(records, settings, sets)
    found = judged_on(
        model,
        submodel.load(folder, settings),
        cases,
        submodel.targets(settings, model),
        sets=sets,
        files=records.files,
    )
    designs = submodel.designs(model, cases, settings)
    proposed = next_recordings(submodel.title, model, found.verdict, designs)
    verdict = replace(found.verdict, next_recordings=proposed)
    write_json(verdict, folder / "verdict.json")
    write_predictions(found.predictions, folder / "predictions.parquet")
    example = submodel.example(folder)
    write_json(served(example, submodel.answer(folder)(example)), folder / SERVED)
    figures = key_figures(verdict) | dict(submodel.figures(model))
    write_json(figures, metrics)
    write_plots(verdict, found.predictions, plots)


def _frozen(golden: Path | None, settings: Any) -> GoldenSets | None:
    return None if golden is None else read_golden(golden / f"{settings.identity.name}.json")
