"""The only file that imports mlflow: one registered model a machine, champion and challenger.

``data/models/<machine>`` holds the bytes, owned by DVC; here they are registered as one pyfunc
bundle a machine, once for each content.  The default store is a sqlite file beside the project;
``MLFLOW_TRACKING_URI`` names a server instead.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from mlflow import MlflowClient

Predict = Callable[["pd.DataFrame"], "pd.DataFrame"]

DATABASE = "mlflow.db"
ARTIFACTS = "mlartifacts"
EXPERIMENT = "kerf"
ALIASES = ("champion", "challenger", "previous")
BUNDLE = ("spindle_thermal.json", "residual", "validation.json")
"""What of ``data/models/<machine>`` makes up a bundle."""


@dataclass(frozen=True, kw_only=True)
class Version:
    """One registered version of a machine's model."""

    machine: str
    version: int
    bundle: str
    verdict: str
    aliases: tuple[str, ...]


def model_name(machine: str) -> str:
    """Name of a machine's registered model."""
    return f"kerf-{machine}"


def bundle_hash(folder: Path) -> str:
    """One sha256 over the names and bytes of a bundle's files."""
    digest = hashlib.sha256()
    for part in BUNDLE:
        path = folder / part
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            digest.update(file.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _client(root: Path) -> "MlflowClient":
    """A client of the project's store.

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
    from sqlalchemy.exc import SQLAlchemyError

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


def exists(root: Path) -> bool:
    """Whether there is a registry to look into."""
    return bool(os.environ.get("MLFLOW_TRACKING_URI")) or (root / DATABASE).exists()


def versions(machine: str, root: Path = Path()) -> list[Version]:
    """Registered versions of a machine's model, oldest first; none when there is no registry."""
    if not exists(root):
        return []
    client = _client(root)
    found = client.search_model_versions(f"name='{model_name(machine)}'")
    if not found:
        return []
    aliases: dict[int, list[str]] = {}
    for alias, number in client.get_registered_model(model_name(machine)).aliases.items():
        aliases.setdefault(int(number), []).append(alias)
    return [
        Version(
            machine=machine,
            version=int(v.version),
            bundle=v.tags.get("bundle_sha256", ""),
            verdict=v.tags.get("verdict", ""),
            aliases=tuple(sorted(aliases.get(int(v.version), []))),
        )
        for v in sorted(found, key=lambda v: int(v.version))
    ]


def register(machine: str, folder: Path, params: dict[str, Any], root: Path = Path()) -> Version:
    """Register the bundle of ``machine`` unless its content is registered already.

    The first bundle that passes the golden week becomes champion, every later one challenger;
    who replaces a champion is decided by :func:`promote`.

    Parameters
    ----------
    machine : str
        Whose it is.
    folder : Path
        ``data/models/<machine>``.
    params : dict
        What it was made with; logged with the run.
    root : Path
        The project.

    Raises
    ------
    ValueError
        When the registry cannot be opened.
    OSError
        When a part of the bundle is missing.
    """
    client, name, digest = _client(root), model_name(machine), bundle_hash(folder)
    known = versions(machine, root)
    same = [v for v in known if v.bundle == digest]
    if same and any(v.aliases for v in same):
        return next(v for v in same if v.aliases)
    document = json.loads((folder / "validation.json").read_text())
    if same:  # what stands in the folder is the candidate, be it one of long ago
        number = str(same[0].version)
    else:
        tags = _provenance(machine, digest, document, params, root)
        number = _log(folder, name, _experiment(client, root), params, document, tags)
        for tag, value in tags.items():
            client.set_model_version_tag(name, number, tag, value)
    has_champion = any("champion" in v.aliases for v in known)
    first_champion = document["verdict"] == "passed" and not has_champion
    client.set_registered_model_alias(name, "champion" if first_champion else "challenger", number)
    return next(v for v in versions(machine, root) if v.version == int(number))


def _log(
    folder: Path,
    name: str,
    experiment: str,
    params: dict[str, Any],
    document: dict[str, Any],
    tags: dict[str, str],
) -> str:
    """Log a run with the bundle as a pyfunc; the number of the version that it becomes."""
    import mlflow

    mlflow.set_experiment(experiment)
    run = f"{tags['machine']}-{tags['bundle_sha256'][:8]}"
    with tempfile.TemporaryDirectory() as scratch, mlflow.start_run(run_name=run):
        bundle = Path(scratch) / "bundle"
        bundle.mkdir()
        for part in BUNDLE:
            copy = shutil.copytree if (folder / part).is_dir() else shutil.copy
            copy(folder / part, bundle / part)
        mlflow.log_params(_flat(params))
        mlflow.log_metrics(_metrics(document))
        mlflow.set_tags(tags)
        logged = mlflow.pyfunc.log_model(
            name="spindle",
            python_model=str(Path(__file__).with_name("serving.py")),
            artifacts={"bundle": str(bundle)},
            pip_requirements=["kerf"],
            registered_model_name=name,
        )
    return str(logged.registered_model_version)


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested parameters as ``a.b.c`` keys, of characters that MLflow takes."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = prefix + re.sub(r"[^\w.: -]", "_", str(key))
        flat |= _flat(value, f"{name}.") if isinstance(value, dict) else {name: value}
    return flat


def _metrics(document: dict[str, Any]) -> dict[str, float]:
    scores = document["windows"]["all"] or {}
    return {
        f"golden.{predictor}.{name}": value
        for predictor in ("model", "physics", "persistence")
        for name, value in scores.get(predictor, {}).items()
        if value is not None
    }


def _provenance(
    machine: str, digest: str, document: dict[str, Any], params: dict[str, Any], root: Path
) -> dict[str, str]:
    """Tags that say what a version was made of."""
    golden = document["golden"]
    return {
        "machine": machine,
        "origin": document["origin"],
        "verdict": document["verdict"],
        "bundle_sha256": digest,
        "golden_sha256": golden["sha256"] if golden else "",
        "made_with_sha256": hashlib.sha256(json.dumps(params, sort_keys=True).encode()).hexdigest(),
        "params_sha256": _file_hash(root / "params.yaml"),
        "dvc_lock_sha256": _file_hash(root / "dvc.lock"),
        "git_commit": git_commit(root),
    }


def _file_hash(path: Path) -> str:
    """Hash of a file's bytes, ``""`` when there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


def git_commit(root: Path = Path()) -> str:
    """Commit that is checked out, ``""`` outside a repository or without git."""
    if shutil.which("git") is None:
        return ""
    answer = subprocess.run(
        ["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() if answer.returncode == 0 else ""


def promote(machine: str, root: Path = Path()) -> Version:
    """Make the challenger champion; the champion becomes ``previous`` first.

    Raises
    ------
    ValueError
        When there is no challenger or it did not pass the golden week.
    """
    known = {alias: v for v in versions(machine, root) for alias in v.aliases}
    challenger = known.get("challenger")
    if challenger is None:
        raise ValueError(f"{machine} has no challenger: run `dvc repro` on new records to make one")
    if challenger.verdict != "passed":
        raise ValueError(
            f"the challenger of {machine}, version {challenger.version}, has the verdict "
            f"{challenger.verdict!r} on the golden week: only a model that passed may serve"
        )
    client, name = _client(root), model_name(machine)
    if "champion" in known:
        client.set_registered_model_alias(name, "previous", str(known["champion"].version))
    client.set_registered_model_alias(name, "champion", str(challenger.version))
    client.delete_registered_model_alias(name, "challenger")
    return next(v for v in versions(machine, root) if v.version == challenger.version)


def load(machine: str, alias: str = "champion", root: Path = Path()) -> Predict:
    """The predict function of a machine's model: clean state table in, temperatures out.

    MLflow stores absolute paths; a project that was moved finds its bundle where it is now.

    Raises
    ------
    ValueError
        When no version has that alias, or its bundle is gone or no longer what was registered.
    """
    found = [v for v in versions(machine, root) if alias in v.aliases]
    if not found:
        raise ValueError(f"{machine} has no {alias}: `kerf status` shows what is registered")
    version = found[0]
    place = _place(version, root)
    bundle = place / "artifacts" / "bundle"
    try:
        now = bundle_hash(bundle)
    except OSError:  # a part of it is gone
        now = ""
    if now != version.bundle:
        raise ValueError(
            f"the bundle of {machine} version {version.version} in {bundle} is no longer the one "
            f"that was registered ({version.bundle[:12]}): run `dvc repro` to register it anew"
        )
    import mlflow

    try:
        predict: Predict = mlflow.pyfunc.load_model(str(place)).predict
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(f"the bundle of {machine} in {place} cannot be read: {error}") from error
    return predict


def _place(version: Version, root: Path) -> Path:
    """Folder of a version's model, brought here when a server has it.

    Raises
    ------
    ValueError
        When it is nowhere.
    """
    import mlflow

    client = _client(root)
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
