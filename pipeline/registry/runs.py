"""Registering a bundle: one run with settings, key figures, curves, hashes and the pyfunc."""

import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
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
from pipeline.schema.bundle import VERDICT, Bundle, copy_bundle
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
    """The version of a bundle; it is logged and registered unless its content is there already.

    Parameters
    ----------
    bundle : Bundle
        As :func:`~pipeline.schema.bundle.bundle_of` found it in ``folder``.
    folder : Path
        ``data/models/<machine>`` or ``data/champion/<machine>``.
    root : Path
        The project.
    made_with : callable
        The settings that it was made with; logged with the run.

    Raises
    ------
    ValueError
        When the registry cannot be opened, or the bundle does not predict its own example.
    """
    there = [v for v in versions(bundle.machine, root) if v.bundle == bundle.sha256]
    if there:
        return there[0]
    client = client_of(root)
    number = _log(bundle, folder, root, experiment_of(client, root), made_with())
    return next(v for v in versions(bundle.machine, root) if v.version == number)


def _log(
    bundle: Bundle, folder: Path, root: Path, experiment: str, made_with: Mapping[str, Any]
) -> int:
    """Log a run with the bundle as a pyfunc; the number of the version that it becomes."""
    import mlflow

    from pipeline.submodels.contract import submodel

    signature, units = _described(bundle, folder)
    tags = provenance(bundle, folder, root, made_with) | {
        f"unit.{name}.{plain(column)}": unit
        for name, columns in units.items() for column, unit in columns.items() if unit
    }  # fmt: skip
    mlflow.set_experiment(experiment)
    run = f"{bundle.machine}-{bundle.sha256[:8]}"
    with tempfile.TemporaryDirectory() as scratch, mlflow.start_run(run_name=run):
        copy_bundle(folder, bundle, Path(scratch) / "bundle")
        package = Path(__file__).parents[1]
        code = Path(scratch) / package.name
        shutil.copytree(package, code, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        parameters = list(flat(made_with).items())
        for first in range(0, len(parameters), BATCH):
            mlflow.log_params(dict(parameters[first : first + BATCH]))
        mlflow.log_metrics(key_figures(bundle, folder))
        _log_curves(bundle, folder, root)
        mlflow.set_tags(tags)
        card = model_card(bundle, folder, units)
        mlflow.set_tag("mlflow.note.content", as_description(card))
        mlflow.log_text(card, "model_card.md")
        _log_identifications(bundle, folder, root)
        first_name = next(iter(bundle.submodels))
        logged = mlflow.pyfunc.log_model(
            name="bundle",
            python_model=str(package / "serving.py"),
            artifacts={"bundle": str(Path(scratch) / "bundle")},
            code_paths=[str(code)],
            signature=signature,
            input_example=_without_zone(submodel(first_name).example(folder / first_name)),
            pip_requirements=requirements(root),
            metadata={"units": units},
            registered_model_name=model_name(bundle.machine),
        )
    number = str(logged.registered_model_version)
    client = client_of(root)
    client.update_model_version(model_name(bundle.machine), number, as_description(card))
    for tag, value in tags.items():  # the hash comes last: a version that has it has all
        client.set_model_version_tag(model_name(bundle.machine), number, tag, value)
    return int(number)


def _log_identifications(bundle: Bundle, folder: Path, root: Path) -> None:
    """A run of its own, below the bundle's, for each sub-model that no version has had so far."""
    import mlflow

    before = versions(bundle.machine, root)
    for name, one in bundle.submodels.items():
        if any(version.tags.get(f"{name}.sha256") == one.sha256 for version in before):
            continue
        alone = replace(bundle, submodels={name: one})
        with mlflow.start_run(run_name=f"{bundle.machine}-{name}-{one.sha256[:8]}", nested=True):
            mlflow.log_params(parameters_of(name, folder / name))
            mlflow.log_metrics(key_figures(alone, folder))
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
    """Signature of a bundle's pyfunc, and the unit of each column by sub-model.

    Columns are found by predicting each sub-model's own example.  The sub-models read different
    tables, so that each column is optional: what a sub-model lacks is said by itself.
    """
    from mlflow.models import ModelSignature
    from mlflow.types import ParamSchema, ParamSpec

    from pipeline.submodels.contract import submodel

    taken: dict[str, Any] = {}
    given: dict[str, Any] = {}
    units: dict[str, dict[str, str]] = {}
    for name in bundle.submodels:
        one = submodel(name)
        example = one.example(folder / name)
        predicted = one.serve(folder / name)(example)
        for columns, frame in ((taken, example), (given, predicted)):
            for column in frame.columns:
                columns.setdefault(str(column), frame[column])
        verdict = read_json(folder / name / VERDICT, Verdict)
        units[name] = {score.quantity: score.unit for score in verdict.scores}
        units[name] |= {known.name: known.unit for known in one.inputs if known.unit}
    default = next(iter(bundle.submodels))
    parameters = ParamSchema([ParamSpec("submodel", "string", default=default)])
    return ModelSignature(inputs=_schema(taken), outputs=_schema(given), params=parameters), units


def _schema(columns: Mapping[str, "pd.Series[Any]"]) -> Any:
    """Columns with their MLflow types, none of them required."""
    from mlflow.types import ColSpec, Schema

    kinds = {"M": "datetime", "f": "double", "i": "long", "u": "long", "b": "boolean"}
    return Schema([
        ColSpec(kinds.get(getattr(values.dtype, "kind", "O"), "string"), name, required=False)
        for name, values in columns.items()
    ])  # fmt: skip


def _without_zone(table: "pd.DataFrame") -> "pd.DataFrame":
    """A table whose times are UTC without saying so: MLflow takes no others."""
    zoned = table.select_dtypes("datetimetz").columns
    return table.assign(**{name: table[name].dt.tz_convert(None) for name in zoned})
