"""Registered versions and their aliases, read without MLflow where the store is a file."""

import hashlib
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from pipeline.schema.bundle import Champion
from pipeline.schema.history import stamp

if TYPE_CHECKING:
    from mlflow import MlflowClient

DATABASE = "mlflow.db"
ARTIFACTS = "mlartifacts"
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


@dataclass(frozen=True, kw_only=True)
class Version:
    """One registered version of a machine's bundle; ``status`` is the gravest of its sub-models."""

    machine: str
    version: int
    bundle: str
    status: str
    aliases: tuple[str, ...]
    tags: Mapping[str, str] = field(default_factory=dict)
    created: str = ""
    run: str = ""
    """Time of its registration, UTC, and the id of its run."""


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


def versions(machine: str, root: Path = Path()) -> list[Version]:
    """Registered versions of a machine's model, oldest first; ValueError if not readable."""
    if not exists(root):
        return []
    tags, aliases = _of_server(machine, root) if is_server() else _read(machine, root / DATABASE)
    return [
        Version(
            machine=machine,
            version=number,
            bundle=said.get("bundle_sha256", ""),
            status=said.get("status", ""),
            aliases=tuple(sorted(alias for alias, n in aliases.items() if n == number)),
            tags={key: value for key, value in said.items() if key not in (CREATED, RUN)},
            created=stamp(datetime.fromtimestamp(int(said[CREATED]) / 1000, UTC)),
            run=said[RUN],
        )
        for number, said in sorted(tags.items())
    ]


Tags = dict[int, dict[str, str]]
CREATED, RUN = "\0created", "\0run"
"""Keys beside the tags, which no tag can have: time of registration [ms] and run."""


def _read(machine: str, database: Path, mode: str = "ro") -> tuple[Tags, dict[str, int]]:
    """Tags by version, and versions by alias, out of the sqlite file.

    Where a run broke off while it wrote, SQLite takes its half change back, and has to write.
    """
    name = (model_name(machine),)
    uri = f"file:{quote(str(database.resolve()))}?mode={mode}"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as store:
            tables = {row[0] for row in store.execute("SELECT name FROM sqlite_master")}
            if "model_version_tags" not in tables:
                return {}, {}
            numbers = store.execute(
                "SELECT version, creation_time, run_id FROM model_versions"
                " WHERE name = ? AND current_stage != 'Deleted_Internal'", name,
            ).fetchall()  # fmt: skip
            found: Tags = {
                number: {CREATED: str(created), RUN: run or ""} for number, created, run in numbers
            }
            for number, key, value in store.execute(
                "SELECT version, key, value FROM model_version_tags WHERE name = ?", name
            ):
                found.get(number, {})[key] = value
            aliases = dict(store.execute(
                "SELECT alias, version FROM registered_model_aliases WHERE name = ?", name
            ).fetchall())  # fmt: skip
    except sqlite3.Error as error:
        if mode == "ro" and error.sqlite_errorname.startswith("SQLITE_READONLY"):
            return _read(machine, database, "rw")
        raise ValueError(f"the registry sqlite:///{database} cannot be opened: {error}") from error
    return found, aliases


def _of_server(machine: str, root: Path) -> tuple[Tags, dict[str, int]]:
    """Tags by version, and versions by alias, out of a server."""
    client = client_of(root)
    with reached("read", "do this again when it answers"):
        found = client.search_model_versions(f"name='{model_name(machine)}'")
        if not found:
            return {}, {}
        aliases = client.get_registered_model(model_name(machine)).aliases
    return (
        {
            int(v.version): dict(v.tags) | {CREATED: str(v.creation_timestamp), RUN: v.run_id or ""}
            for v in found
        },
        {alias: int(number) for alias, number in aliases.items()},
    )


def client_of(root: Path) -> "MlflowClient":
    """A client of the project's store, which is made when it is missing.

    Raises ValueError when the store cannot be opened.
    """
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
        said = (str(error).splitlines() or [""])[0]
        raise ValueError(f"the registry {uri} cannot be opened: {said}") from error
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


def name_versions(machine: str, root: Path, **wanted: str | None) -> None:
    """Give each alias to the version with a bundle's hash; None takes the alias away.

    A hash that the store does not have is left out.  Raises ValueError when the store cannot be
    opened or written.
    """
    known = versions(machine, root)
    numbers = {v.bundle: v.version for v in reversed(known)}
    now = {alias: v.version for v in known for alias in v.aliases}
    goals = {alias: numbers.get(sha256) if sha256 else None for alias, sha256 in wanted.items()}
    changed = {alias: number for alias, number in goals.items() if number != now.get(alias)}
    if not changed:
        return
    client, name = client_of(root), model_name(machine)
    with reached("written"):
        for alias, number in changed.items():
            if number is None:
                client.delete_registered_model_alias(name, alias)
            else:
                client.set_registered_model_alias(name, alias, str(number))


def note_promotion(machine: str, root: Path, champion: Champion) -> None:
    """Note since when, by whom and why a version serves; its card becomes the model's.

    Raises ValueError when the store cannot be opened or written.
    """
    found = [v for v in versions(machine, root) if v.bundle == champion.bundle]
    wanted = {"promoted_at": champion.since, "promoted_by": champion.by,
              "promoted_why": champion.why}  # fmt: skip
    if not found or all(found[0].tags.get(tag, "") == value for tag, value in wanted.items()):
        return
    client, name, number = client_of(root), model_name(machine), str(found[0].version)
    with reached("written"):
        card = client.get_model_version(name, number).description or ""
        client.update_registered_model(name, card)
        for tag, value in wanted.items():
            client.set_model_version_tag(name, number, tag, value)


@contextmanager
def reached(done: str, remedy: str = "make room for it and do this again") -> Iterator[None]:
    """A store that cannot be read or written (``done``) is one sentence, a ValueError."""
    import mlflow
    from requests import RequestException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (mlflow.MlflowException, RequestException, SQLAlchemyError) as error:
        said = (str(error).splitlines() or [""])[0]
        raise ValueError(
            f"the registry {mlflow.get_tracking_uri()} cannot be {done} ({said}): {remedy}"
        ) from error
