"""Registered versions and their aliases, read without MLflow where the store is a file."""

import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from pipeline.registry.sqlite import (
    ARTIFACTS,
    Note,
    Version,
    read_versions,
    version_of,
    write_note,
)
from pipeline.schema.bundle import Champion

if TYPE_CHECKING:
    from mlflow import MlflowClient

DATABASE = "mlflow.db"
EXPERIMENT = "kerf"
QUIET = {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # seven try a server that is down for four minutes
    "MLFLOW_ENABLE_PROXY_MULTIPART_DOWNLOAD": "false",  # small files, by the server alone
    "GIT_PYTHON_REFRESH": "quiet",
}
"""Settings of MLflow where the environment says nothing else."""
PATIENCE_S = 2.0
"""Time in which a server has to answer those who can do without it [s]."""


def model_name(machine: str) -> str:
    """Name of a machine's registered model."""
    return f"kerf-{machine}"


def is_server() -> bool:
    """Whether the store is a server that several people share, not a file of this project."""
    return bool(os.environ.get("MLFLOW_TRACKING_URI"))


def is_shared() -> bool:
    """Whether several people share the store, so that it keeps the histories as well."""
    return is_server() and not os.environ["MLFLOW_TRACKING_URI"].startswith(("sqlite:", "file:"))


def exists(root: Path) -> bool:
    """Whether there is a registry to look into."""
    return is_server() or (root / DATABASE).exists()


def offline() -> str:
    """Sentence on a server that does not answer within :data:`PATIENCE_S`; else empty."""
    return _silent(os.environ["MLFLOW_TRACKING_URI"]) if is_shared() else ""


@cache
def _silent(uri: str) -> str:
    if not uri.startswith(("http://", "https://")) or "@" in uri:
        return ""
    from http.client import HTTPException
    from ssl import SSLError
    from urllib.error import HTTPError
    from urllib.request import urlopen

    try:
        urlopen(f"{uri.rstrip('/')}/health", timeout=PATIENCE_S).close()
    except HTTPError:  # it answers
        return ""
    except (OSError, HTTPException, ValueError) as error:
        reason = getattr(error, "reason", None)
        if not isinstance(reason, SSLError):  # MLflow has settings for that
            return f"the registry {uri} does not answer ({_plain(reason or error)})"
    return ""


def _plain(error: object) -> str:
    """Reason why a server was not reached, without the words of the library that tried."""
    said = str(getattr(error, "strerror", None) or error or type(error).__name__)
    said = (said.splitlines() or [""])[0]
    return "it does not answer" if "HTTPConnectionPool" in said or "HTTPSConn" in said else said


def versions(machine: str, root: Path = Path()) -> list[Version]:
    """Registered versions of a machine's model, oldest first; ValueError if not readable."""
    if not exists(root):
        return []
    name = model_name(machine)
    if not is_server():
        return _whole(read_versions(machine, name, root / DATABASE))
    client = client_of(root)
    with reached("read", "do this again when it answers"):
        found = client.search_model_versions(f"name='{name}'")
        aliases = client.get_registered_model(name).aliases if found else {}
    numbers = {alias: int(number) for alias, number in aliases.items()}
    return _whole(
        version_of(machine, int(v.version), dict(v.tags), numbers, v.creation_timestamp,
                   run=v.run_id, description=v.description)
        for v in sorted(found, key=lambda one: int(one.version))
    )  # fmt: skip


def _whole(found: Iterable[Version]) -> list[Version]:
    """Versions with a bundle: one that is being registered has none yet."""
    return [one for one in found if one.bundle]


def note(machine: str, root: Path, changes: Note) -> None:
    """Write changes of a machine's versions into the store; ValueError where that is not possible.

    A file is written at once; on a server, and into tables of another release, by MLflow.
    """
    name, number = model_name(machine), str(changes.version)
    if not is_server() and write_note(changes, name, root / DATABASE):
        return
    client = client_of(root)
    from mlflow.entities import Metric

    with reached("written"):
        for alias, version in changes.aliases.items():
            if version is None:
                client.delete_registered_model_alias(name, alias)
            else:
                client.set_registered_model_alias(name, alias, str(version))
        for tag, value in changes.tags.items():
            client.set_model_version_tag(name, number, tag, value)
        if changes.description:
            client.update_model_version(name, number, changes.description)
        if changes.card:
            client.update_registered_model(name, changes.card)
        if changes.metrics:
            metrics = [Metric(key, value, 0, 0) for key, value in changes.metrics.items()]
            client.log_batch(changes.run, metrics=metrics)
        for path, text in changes.files.items():
            client.log_text(changes.run, text, path)


def logged_model(version: Any) -> str:
    """Id of the logged model of MLflow's version, which a server leaves out; else empty."""
    return version.model_id or version.source.rpartition("models:/")[2]


def client_of(root: Path) -> "MlflowClient":
    """A client of the project's store, which is made when it is missing.

    Raises ValueError when the store cannot be opened.
    """
    if said := offline():  # before MLflow is imported and tries it three times
        _silent.cache_clear()
        raise ValueError(f"{said}: do this again when it does")
    for setting, value in QUIET.items():
        os.environ.setdefault(setting, value)
    import logging

    import mlflow
    from mlflow.utils.logging_utils import disable_logging
    from sqlalchemy.exc import SQLAlchemyError

    disable_logging()  # what goes wrong is raised; a command says one sentence
    for noisy in ("mlflow", "alembic"):
        logging.getLogger(noisy).setLevel(logging.ERROR)
    named = os.environ.get("MLFLOW_TRACKING_URI")
    place = str((root / DATABASE).resolve())
    escaped = quote(place) if set(place) & set("%?#") else place  # of an address (RFC 3986)
    uri = named or f"sqlite:///{escaped}"
    mlflow.set_tracking_uri(uri)
    if not named:  # MLflow has put it there, where the next project would take it for a server
        os.environ.pop("MLFLOW_TRACKING_URI", None)
    try:
        client = mlflow.MlflowClient()
        client.get_experiment_by_name(EXPERIMENT)
        if not named and escaped != place:
            client.search_registered_models(max_results=1)  # opens the other store too
            with suppress(OSError):  # MLflow makes a folder of the name that is still escaped
                os.removedirs(Path(escaped).parent)
    except (mlflow.MlflowException, SQLAlchemyError) as error:
        raise ValueError(f"the registry {uri} cannot be opened: {_plain(error)}") from error
    return client


def experiment_of(client: "MlflowClient", root: Path) -> str:
    """Name of the experiment of the project's present place; made if missing.

    Raises ValueError when the store cannot be written.
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
        with reached("written"), made_by_another():
            client.create_experiment(name, artifact_location=place)
    return name


@contextmanager
def made_by_another() -> Iterator[None]:
    """What is made and is there already was made by somebody else at the same time."""
    import mlflow

    try:
        yield
    except mlflow.MlflowException as error:
        if error.error_code != "RESOURCE_ALREADY_EXISTS":
            raise


def name_versions(
    machine: str, root: Path, serves: Champion | None = None, **wanted: str | None
) -> None:
    """Give each alias to the version with a bundle's hash; None takes the alias away.

    What serves gets the alias ``champion`` and tags since when, by whom and why, and its card
    becomes the model's.  A hash that the store does not have is left out.  Raises ValueError when
    the store cannot be opened or written.
    """
    known = versions(machine, root)
    if serves is not None:
        wanted["champion"] = serves.bundle
    numbers = {v.bundle: v.version for v in reversed(known)}
    now = {alias: v.version for v in known for alias in v.aliases}
    goals = {alias: numbers.get(sha256) if sha256 else None for alias, sha256 in wanted.items()}
    changes = Note(aliases={alias: n for alias, n in goals.items() if n != now.get(alias)})
    for one in known:
        if serves is not None and one.version == goals["champion"]:
            tags = {"promoted_at": serves.since, "promoted_by": serves.by,
                    "promoted_why": serves.why}  # fmt: skip
            if any(one.tags.get(tag, "") != value for tag, value in tags.items()):
                changes = replace(changes, version=one.version, tags=tags, card=one.description)
    if changes != Note():
        note(machine, root, changes)


@contextmanager
def reached(done: str, remedy: str = "make room for it and do this again") -> Iterator[None]:
    """A store that cannot be read or written (``done``) is one sentence, a ValueError."""
    import mlflow
    from requests import RequestException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (mlflow.MlflowException, RequestException, SQLAlchemyError) as error:
        raise ValueError(
            f"the registry {mlflow.get_tracking_uri()} cannot be {done} ({_plain(error)}): {remedy}"
        ) from error
