"""Registering a bundle: one run with settings, key figures, curves, hashes and the pyfunc."""

import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.registry.card import as_description, model_card
from pipeline.registry.figures import scatter
from pipeline.registry.provenance import (
    flat,
    hash_of_files,
    key_figures,
    parameters_of,
    plain,
    provenance,
    requirements,
    training_files,
)
from pipeline.registry.store import Version, client_of, experiment_of, model_name, versions
from pipeline.schema.bundle import SERVED, VERDICT, Bundle, Served, copy_bundle
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

METRICS = 1000
"""Values of curves that MLflow takes at once [1]."""
BATCH = 100
"""Parameters that MLflow takes in one call."""

MadeWith = Callable[[], Mapping[str, Any]]
"""Settings that a bundle was made with, read only when it is logged."""


def register(
    bundle: Bundle, folder: Path, root: Path = Path(), *, made_with: MadeWith = dict
) -> Version:
    """Version of a bundle; logged and registered unless its content is there already.

    ``folder``: ``data/models/<machine>`` or ``data/champion/<machine>``; ``made_with`` settings are
    logged with the run.  Raises ValueError when the registry cannot be opened.
    """
    there = [v for v in versions(bundle.machine, root) if v.bundle == bundle.sha256]
    if there:
        return there[0]
    client = client_of(root)
    _log(bundle, folder, root, experiment_of(client, root), made_with())
    return next(v for v in versions(bundle.machine, root) if v.bundle == bundle.sha256)


def _log(
    bundle: Bundle, folder: Path, root: Path, experiment: str, made_with: Mapping[str, Any]
) -> None:
    import mlflow

    signature, units = _described(bundle, folder)
    tags = provenance(bundle, folder, root, made_with) | {
        f"unit.{name}.{plain(column)}": unit
        for name, columns in units.items() for column, unit in columns.items() if unit
    }  # fmt: skip
    mlflow.set_experiment(experiment)
    card = model_card(bundle, folder, units)
    with mlflow.start_run(run_name=f"{bundle.machine}-{bundle.sha256[:8]}") as run:
        parameters = list(flat(made_with).items())
        for first in range(0, len(parameters), BATCH):
            mlflow.log_params(dict(parameters[first : first + BATCH]))
        figures = {name: key_figures(name, folder / name) for name in bundle.submodels}
        mlflow.log_metrics({key: one for some in figures.values() for key, one in some.items()})
        _log_curves(bundle, folder, root)
        mlflow.set_tags(tags | {"mlflow.note.content": as_description(card)})
        mlflow.log_text(card, "model_card.md")
        _log_identifications(bundle, folder, root, figures)
        model_id = _log_pyfunc(bundle, folder, root, signature, units, run.info)
    client, name = client_of(root), model_name(bundle.machine)
    if not client.search_registered_models(f"name='{name}'"):
        client.create_registered_model(name)
    # all at once: a version that there is has all its tags
    client.create_model_version(
        name, f"models:/{model_id}", run.info.run_id, tags=tags, model_id=model_id,
        description=as_description(card),
    )  # fmt: skip


def _log_pyfunc(
    bundle: Bundle,
    folder: Path,
    root: Path,
    signature: Any,
    units: Mapping[str, Mapping[str, str]],
    run: Any,
) -> str:
    """Log the bundle as a pyfunc of a run, without ``mlflow.pyfunc.log_model``'s extras; its id."""
    import mlflow
    from mlflow.entities import LoggedModelOutput, LoggedModelStatus

    from pipeline.submodels.contract import submodel

    client, package = client_of(root), Path(__file__).parents[1]
    logged = client.create_logged_model(run.experiment_id, name="bundle", source_run_id=run.run_id)
    first = next(iter(bundle.submodels))
    with tempfile.TemporaryDirectory() as scratch:
        copy_bundle(folder, bundle, Path(scratch) / "bundle")
        code = Path(scratch) / package.name
        shutil.copytree(package, code, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        mlflow.pyfunc.save_model(
            str(Path(scratch) / "model"),
            python_model=str(package / "serving.py"),
            artifacts={"bundle": str(Path(scratch) / "bundle")},
            code_paths=[str(code)],
            signature=signature,
            input_example=_without_zone(submodel(first).example(folder / first)),
            pip_requirements=requirements(bundle.submodels, root),
            mlflow_model=mlflow.models.Model(
                artifact_path=logged.artifact_location, run_id=run.run_id,
                model_uuid=logged.model_id, model_id=logged.model_id, metadata={"units": units},
            ),
        )  # fmt: skip
        client.log_model_artifacts(logged.model_id, str(Path(scratch) / "model"))
    client.finalize_logged_model(logged.model_id, LoggedModelStatus.READY)
    client.log_outputs(run.run_id, [LoggedModelOutput(logged.model_id, step=0)])
    return str(logged.model_id)


def _log_identifications(
    bundle: Bundle, folder: Path, root: Path, figures: Mapping[str, Mapping[str, float]]
) -> None:
    """A run of its own, below the bundle's, for each sub-model that no version has had so far."""
    import mlflow

    before = versions(bundle.machine, root)
    for name, one in bundle.submodels.items():
        if any(version.tags.get(f"{name}.sha256") == one.sha256 for version in before):
            continue
        with mlflow.start_run(run_name=f"{bundle.machine}-{name}-{one.sha256[:8]}", nested=True):
            mlflow.log_params(parameters_of(name, folder / name))
            mlflow.log_metrics(dict(figures[name]))
            files = training_files(name, folder / name)
            mlflow.log_text("".join(f"{sha256}  {file}\n" for file, sha256 in files),
                            "training_files.sha256")  # fmt: skip
            figure = scatter(folder / name)
            if figure:
                mlflow.log_text(figure, f"{name}.svg")
            mlflow.set_tags({
                "machine": bundle.machine, "origin": bundle.origin, "submodel": name,
                "model_sha256": one.sha256, "status": one.status,
                "training_sha256": hash_of_files(files),
            })  # fmt: skip


def _log_curves(bundle: Bundle, folder: Path, root: Path) -> None:
    """Training curves of every sub-model, a step an epoch."""
    import mlflow
    from mlflow.entities import Metric

    from pipeline.submodels.contract import submodel

    found = [
        Metric(f"{name}.curve.{plain(curve)}", value, 0, step)
        for name in bundle.submodels
        for curve, values in submodel(name).curves(folder / name).items()
        for step, value in enumerate(values, start=1)
    ]
    run = mlflow.active_run()
    if run is not None:
        for first in range(0, len(found), METRICS):
            client_of(root).log_batch(run.info.run_id, metrics=found[first : first + METRICS])


def _described(bundle: Bundle, folder: Path) -> tuple[Any, dict[str, dict[str, str]]]:
    """Signature of a bundle's pyfunc, all columns optional, and their units by sub-model."""
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema

    from pipeline.submodels.contract import submodel

    taken: dict[str, str] = {}
    given: dict[str, str] = {}
    units: dict[str, dict[str, str]] = {}
    for name in bundle.submodels:
        columns = read_json(folder / name / SERVED, Served)
        taken, given = {**columns.inputs, **taken}, {**columns.outputs, **given}
        verdict = read_json(folder / name / VERDICT, Verdict)
        units[name] = {score.quantity: score.unit for score in verdict.scores}
        units[name] |= {known.name: known.unit for known in submodel(name).inputs if known.unit}
    inputs, outputs = (
        Schema([ColSpec(kind, name, required=False) for name, kind in columns.items()])
        for columns in (taken, given)
    )
    default = next(iter(bundle.submodels))
    parameters = ParamSchema([ParamSpec("submodel", "string", default=default)])
    return ModelSignature(inputs=inputs, outputs=outputs, params=parameters), units


def _without_zone(table: "pd.DataFrame") -> "pd.DataFrame":
    """A table whose times are UTC without saying so: MLflow takes no others."""
    zoned = table.select_dtypes("datetimetz").columns
    return table.assign(**{name: table[name].dt.tz_convert(None) for name in zoned})
