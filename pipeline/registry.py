"""The registry of bundles: one registered model a machine, one version for each content.

``data/models/<machine>`` holds the newest bytes and ``data/champion/<machine>`` those that serve,
both owned by DVC; ``champions.json``, which git holds, names the champions.  MLflow keeps every
bundle that there ever was, with the code that reads it.  The default store is a sqlite file beside
the project; ``MLFLOW_TRACKING_URI`` names a server instead.  MLflow is imported only where a
version is written or loaded: importing it takes seconds, and what is there can be read without.
"""

import hashlib
import importlib.metadata
import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pipeline.schema.bundle import VERDICT, Bundle, copy_bundle, stored_bundle
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd
    from mlflow import MlflowClient

DATABASE = "mlflow.db"
ARTIFACTS = "mlartifacts"
EXPERIMENT = "kerf"
CHAMPIONS = Path("champions.json")
LOCK = Path("requirements.lock")
NEEDED = ("cattrs", "joblib", "numba", "numpy", "pandas", "pyarrow", "pyyaml", "scikit-learn",
          "scipy", "skops", "threadpoolctl")  # fmt: skip
"""Distributions that a prediction imports; a version pins them."""
METRICS = 1000
"""Values of curves that MLflow takes at once [1]."""
BATCH = 100
"""Parameters that MLflow takes in one call."""


@dataclass(frozen=True, kw_only=True)
class Version:
    """One registered version of a machine's bundle; ``status`` is the gravest of its sub-models."""

    machine: str
    version: int
    bundle: str
    status: str
    aliases: tuple[str, ...]


def model_name(machine: str) -> str:
    """Name of a machine's registered model."""
    return f"kerf-{machine}"


# What is registered, read without MLflow where the store is a file.


def exists(root: Path) -> bool:
    """Whether there is a registry to look into."""
    return bool(os.environ.get("MLFLOW_TRACKING_URI")) or (root / DATABASE).exists()


def versions(machine: str, root: Path = Path()) -> list[Version]:
    """Registered versions of a machine's model, oldest first; none when there is no registry.

    Raises
    ------
    ValueError
        When the registry cannot be opened.
    """
    if not exists(root):
        return []
    server = bool(os.environ.get("MLFLOW_TRACKING_URI"))
    tags, aliases = _of_server(machine, root) if server else _read(machine, root / DATABASE)
    return [
        Version(
            machine=machine,
            version=number,
            bundle=said.get("bundle_sha256", ""),
            status=said.get("status", ""),
            aliases=tuple(sorted(alias for alias, n in aliases.items() if n == number)),
        )
        for number, said in sorted(tags.items())
    ]


Tags = dict[int, dict[str, str]]


def _read(machine: str, database: Path) -> tuple[Tags, dict[str, int]]:
    """Tags by version, and versions by alias, out of the sqlite file."""
    name = (model_name(machine),)
    uri = f"file:{quote(str(database.resolve()))}?mode=ro"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as store:
            tables = {row[0] for row in store.execute("SELECT name FROM sqlite_master")}
            if "model_version_tags" not in tables:
                return {}, {}
            numbers = store.execute(
                "SELECT version FROM model_versions"
                " WHERE name = ? AND current_stage != 'Deleted_Internal'", name,
            ).fetchall()  # fmt: skip
            found: Tags = {number: {} for (number,) in numbers}
            for number, key, value in store.execute(
                "SELECT version, key, value FROM model_version_tags WHERE name = ?", name
            ):
                found.get(number, {})[key] = value
            aliases = dict(store.execute(
                "SELECT alias, version FROM registered_model_aliases WHERE name = ?", name
            ).fetchall())  # fmt: skip
    except sqlite3.Error as error:
        raise ValueError(f"the registry sqlite:///{database} cannot be opened: {error}") from error
    return found, aliases


def _of_server(machine: str, root: Path) -> tuple[Tags, dict[str, int]]:
    """As :func:`_read`, of a server."""
    client = _client(root)
    found = client.search_model_versions(f"name='{model_name(machine)}'")
    if not found:
        return {}, {}
    aliases = client.get_registered_model(model_name(machine)).aliases
    return (
        {int(v.version): dict(v.tags) for v in found},
        {alias: int(number) for alias, number in aliases.items()},
    )


def _client(root: Path) -> "MlflowClient":
    """A client of the project's store, which is made when it is missing.

    Raises
    ------
    ValueError
        When the store cannot be opened.
    """
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    import logging

    import mlflow
    from mlflow.utils.logging_utils import disable_logging
    from sqlalchemy.exc import SQLAlchemyError

    disable_logging()  # what goes wrong is raised; a command says one sentence
    for noisy in ("mlflow", "alembic"):
        logging.getLogger(noisy).setLevel(logging.ERROR)
    named = os.environ.get("MLFLOW_TRACKING_URI")
    uri = named or f"sqlite:///{(root / DATABASE).resolve()}"
    mlflow.set_tracking_uri(uri)
    if not named:  # MLflow has put it there, where the next project would take it for a server
        os.environ.pop("MLFLOW_TRACKING_URI", None)
    try:
        client = mlflow.MlflowClient()
        client.get_experiment_by_name(EXPERIMENT)
    except (mlflow.MlflowException, SQLAlchemyError) as error:
        said = (str(error).splitlines() or [""])[0]
        raise ValueError(f"the registry {uri} cannot be opened: {said}") from error
    return client


def _experiment(client: "MlflowClient", root: Path) -> str:
    """Name of the experiment whose artifacts stand where the project stands now; made if missing.

    MLflow keeps an experiment's place for ever: a project that was moved gets another experiment.
    """
    if client.tracking_uri.startswith(("http://", "https://")):
        name, place = EXPERIMENT, None
    else:
        place = (root / ARTIFACTS).resolve().as_uri()
        first = client.get_experiment_by_name(EXPERIMENT)
        here = first is None or first.artifact_location == place
        name = (
            EXPERIMENT if here else f"{EXPERIMENT} {hashlib.sha256(place.encode()).hexdigest()[:8]}"
        )
    if client.get_experiment_by_name(name) is None:
        client.create_experiment(name, artifact_location=place)
    return name


# Registering.

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
    client = _client(root)
    number = _log(bundle, folder, root, _experiment(client, root), made_with())
    return next(v for v in versions(bundle.machine, root) if v.version == number)


def _log(
    bundle: Bundle, folder: Path, root: Path, experiment: str, made_with: Mapping[str, Any]
) -> int:
    """Log a run with the bundle as a pyfunc; the number of the version that it becomes."""
    import mlflow

    from pipeline.submodels.contract import submodel

    signature, units = _described(bundle, folder)
    tags = _provenance(bundle, folder, root, made_with) | {
        f"unit.{name}.{_plain(column)}": unit
        for name, columns in units.items() for column, unit in columns.items() if unit
    }  # fmt: skip
    mlflow.set_experiment(experiment)
    run = f"{bundle.machine}-{bundle.sha256[:8]}"
    with tempfile.TemporaryDirectory() as scratch, mlflow.start_run(run_name=run):
        copy_bundle(folder, bundle, Path(scratch) / "bundle")
        package = Path(__file__).parent
        code = Path(scratch) / package.name
        shutil.copytree(package, code, ignore=shutil.ignore_patterns("__pycache__", ".*"))
        parameters = list(_flat(made_with).items())
        for first in range(0, len(parameters), BATCH):
            mlflow.log_params(dict(parameters[first : first + BATCH]))
        mlflow.log_metrics(_metrics(bundle, folder))
        _log_curves(bundle, folder, root)
        mlflow.set_tags(tags)
        first_name = next(iter(bundle.submodels))
        logged = mlflow.pyfunc.log_model(
            name="bundle",
            python_model=str(Path(__file__).with_name("serving.py")),
            artifacts={"bundle": str(Path(scratch) / "bundle")},
            code_paths=[str(code)],
            signature=signature,
            input_example=_without_zone(submodel(first_name).example(folder / first_name)),
            pip_requirements=requirements(root),
            metadata={"units": units},
            registered_model_name=model_name(bundle.machine),
        )
    number = str(logged.registered_model_version)
    client = _client(root)
    for tag, value in tags.items():  # the hash comes last: a version that has it has all
        client.set_model_version_tag(model_name(bundle.machine), number, tag, value)
    return int(number)


def _log_curves(bundle: Bundle, folder: Path, root: Path) -> None:
    """Training curves of every sub-model, a step an epoch."""
    import mlflow
    from mlflow.entities import Metric

    from pipeline.submodels.contract import submodel

    found = [
        Metric(f"{name}.curve.{_plain(curve)}", value, 0, step)
        for name in bundle.submodels
        for curve, values in submodel(name).curves(folder / name).items()
        for step, value in enumerate(values, start=1)
    ]
    run = mlflow.active_run()
    if run is not None:
        for first in range(0, len(found), METRICS):
            _client(root).log_batch(run.info.run_id, metrics=found[first : first + METRICS])


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


def requirements(root: Path = Path()) -> list[str]:
    """Distributions that a prediction needs, pinned as in requirements.lock.

    One that the lock does not name is pinned to what is installed.
    """
    lock = root / LOCK
    lines = lock.read_text().splitlines() if lock.exists() else []
    pinned = dict(line.split("==", 1) for line in lines if re.match(r"[\w.-]+==", line))
    return [f"{name}=={pinned.get(name) or importlib.metadata.version(name)}" for name in NEEDED]


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values as ``a.b.c`` keys, of characters that MLflow takes."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = prefix + _plain(key)
        flat |= _flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat


def _plain(key: Any) -> str:
    return re.sub(r"[^\w.: -]", "_", str(key))


def _metrics(bundle: Bundle, folder: Path) -> dict[str, float]:
    """Key figures of every sub-model's verdict, and its identified parameters, as numbers."""
    from pipeline.submodels.contract import submodel
    from pipeline.submodels.judge import metrics

    found: dict[str, Any] = {}
    for name in bundle.submodels:
        found |= _flat(metrics(read_json(folder / name / VERDICT, Verdict)), f"{name}.")
        model = read_json(folder / name / "model.json", submodel(name).model)
        for group, parameters in model.parameters.items():
            prefix = f"{name}.parameter.{group}." if group else f"{name}.parameter."
            found |= _flat({key: one.value for key, one in parameters.items()}, prefix)
    return {name: float(v) for name, v in found.items() if isinstance(v, int | float)}


def _provenance(
    bundle: Bundle, folder: Path, root: Path, made_with: Mapping[str, Any]
) -> dict[str, str]:
    """Tags that say what a version was made of; the bundle's own hash is the last."""
    from pipeline.submodels.contract import submodel

    raw: set[tuple[str, str]] = set()
    golden: set[str] = set()
    tags: dict[str, str] = {}
    for name, one in bundle.submodels.items():
        model = read_json(folder / name / "model.json", submodel(name).model)
        verdict = read_json(folder / name / VERDICT, Verdict)
        raw |= {(file, sha256) for sha256, file in model.training_files.items()}
        golden |= {verdict.golden.sha256} if verdict.golden else set()
        tags |= {f"{name}.sha256": one.sha256, f"{name}.status": one.status}
    lines = "".join(f"{sha256}  {file}\n" for file, sha256 in sorted(raw))
    return tags | {
        "machine": bundle.machine,
        "origin": bundle.origin,
        "status": bundle.status,
        "raw_sha256": hashlib.sha256(lines.encode()).hexdigest(),
        "golden_sha256": " ".join(sorted(golden)),
        "made_with_sha256": hashlib.sha256(
            json.dumps(made_with, sort_keys=True, default=str).encode()
        ).hexdigest(),
        "params_sha256": _file_hash(root / "params.yaml"),
        "dvc_lock_sha256": _file_hash(root / "dvc.lock"),
        "git_commit": git("rev-parse", "HEAD", root=root) or "",
        "dirty": dirty(root),
        "bundle_sha256": bundle.sha256,
    }


def _file_hash(path: Path) -> str:
    """Hash of a file's bytes, ``""`` when there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


def git(*words: str, root: Path = Path()) -> str | None:
    """What git says; None outside a repository or without git."""
    if shutil.which("git") is None:
        return None
    answer = subprocess.run(
        ["git", "-C", str(root), *words], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() if answer.returncode == 0 else None


def dirty(root: Path) -> str:
    """Whether the tree differs from the commit: ``"true"``, ``"false"``, ``""`` without git.

    What a run itself writes does not count: data, reports, params.yaml, dvc.lock, champions.json.
    """
    written = [f":(exclude){name}" for name in
               ("data", "reports", "params.yaml", "dvc.lock", CHAMPIONS.name)]  # fmt: skip
    said = git("status", "--porcelain", "--", ".", *written, root=root)
    return "" if said is None else str(bool(said)).lower()


# Aliases, and loading.


def name_versions(machine: str, root: Path, **wanted: str | None) -> None:
    """Give each alias to the version with a bundle's hash; None takes the alias away.

    MLflow is asked only where an alias differs.  A hash that the store does not have is left out.

    Raises
    ------
    ValueError
        When the store cannot be opened or written.
    """
    known = versions(machine, root)
    numbers = {v.bundle: v.version for v in reversed(known)}
    now = {alias: v.version for v in known for alias in v.aliases}
    goals = {alias: numbers.get(sha256) if sha256 else None for alias, sha256 in wanted.items()}
    changed = {alias: number for alias, number in goals.items() if number != now.get(alias)}
    if not changed:
        return
    import mlflow
    from sqlalchemy.exc import SQLAlchemyError

    client = _client(root)
    try:
        for alias, number in changed.items():
            if number is None:
                client.delete_registered_model_alias(model_name(machine), alias)
            else:
                client.set_registered_model_alias(model_name(machine), alias, str(number))
    except (mlflow.MlflowException, SQLAlchemyError) as error:
        said = (str(error).splitlines() or [""])[0]
        raise ValueError(
            f"the registry {mlflow.get_tracking_uri()} cannot be written ({said}): make room for "
            "it and do this again"
        ) from error


class Predictor:
    """A registered bundle that predicts: a table of a sub-model's inputs in, a table out."""

    def __init__(self, version: Version, model: Any) -> None:
        self.version = version
        self.submodels: tuple[str, ...] = model.submodels
        self._model = model

    def __call__(self, table: "pd.DataFrame", submodel: str = "") -> "pd.DataFrame":
        """Prediction of one sub-model, of the first where none is named.

        Raises
        ------
        ValueError
            When the bundle has no such sub-model, or the table lacks what it needs.
        """
        found: pd.DataFrame = self._model.predict(None, table, {"submodel": submodel})
        return found


def load(machine: str, alias: str = "champion", root: Path = Path()) -> Predictor:
    """The predictor of a machine's registered bundle, with the code that it was registered with.

    MLflow stores absolute paths; a project that was moved finds its bundle where it is now.

    Raises
    ------
    ValueError
        When no version has that alias, or its bundle is gone or no longer what was registered.
    """
    found = [v for v in versions(machine, root) if alias in v.aliases]
    if not found:
        raise ValueError(f"{machine} has no {alias}: `kerf status` shows what is registered")
    place = checked_place(found[0], root)
    import mlflow

    path = list(sys.path)
    try:
        model = mlflow.pyfunc.load_model(str(place)).unwrap_python_model()
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(f"the bundle of {machine} in {place} cannot be read: {error}") from error
    finally:  # MLflow leaves the version's code in front of ours
        sys.path = path
    return Predictor(found[0], model)


def checked_place(version: Version, root: Path) -> Path:
    """Folder of a version's model, whose bundle is the one that was registered."""
    place = _place(version, root)
    bundle = place / "artifacts" / "bundle"
    there = stored_bundle(bundle, version.machine)
    if there is None or there.sha256 != version.bundle:
        raise ValueError(
            f"the bundle of {version.machine} version {version.version} in {bundle} is no longer "
            f"the one that was registered ({version.bundle[:12]}): delete {DATABASE} and "
            f"{ARTIFACTS} and run `dvc repro` to register what there is anew"
        )
    return place


def _place(version: Version, root: Path) -> Path:
    """Folder of a version's model, brought here when a server has it.

    Raises
    ------
    ValueError
        When it is nowhere.
    """
    client = _client(root)
    import mlflow

    stored = client.get_model_version_download_uri(
        model_name(version.machine), str(version.version)
    )
    moved = root / ARTIFACTS / stored.rpartition(f"/{ARTIFACTS}/")[2]
    if moved.is_dir():
        return moved.resolve()
    try:
        return Path(mlflow.artifacts.download_artifacts(artifact_uri=stored))
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(
            f"the bundle of {version.machine} version {version.version} is neither in {moved} nor "
            f"in {stored}: bring {ARTIFACTS} along with {DATABASE}"
        ) from error
