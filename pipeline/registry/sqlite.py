"""MLflow's SQLite file, read and written without MLflow, whose import alone takes two seconds.

Tables: of MLflow 3 (``mlflow/store``).  What is noted of a version is one transaction.
"""

import sqlite3
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote, unquote, urlparse

from pipeline.schema.history import stamp
from pipeline.schema.store import write_text

SCHEMA = "dc11669786a5"
"""Revision of the tables that is written here; MLflow itself writes to another."""
BUNDLE_TAG = "bundle_sha256"
"""Tag of a version with the hash of its bundle; one without it is not registered yet."""
ARTIFACTS = "mlartifacts"
"""Folder of the files of runs and models, beside the SQLite file."""


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
    description: str = ""
    """Card, below what the gate said."""
    place: str = ""
    """Address of its model's files; empty where only a server knows it."""


@dataclass(frozen=True, kw_only=True)
class Note:
    """Changes of a machine's versions that are written at once."""

    aliases: Mapping[str, int | None] = field(default_factory=dict)
    """Versions by alias; None takes the alias away."""
    version: int = 0
    """Version that the tags and the description are of."""
    tags: Mapping[str, str] = field(default_factory=dict)
    description: str = ""
    """New description of the version; empty where it stays."""
    card: str = ""
    """New description of the registered model; empty where it stays."""
    run: str = ""
    """Run that metrics and files are logged with."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    """Texts by the path of their artefact."""


def version_of(
    machine: str, number: int, tags: Mapping[str, str], aliases: Mapping[str, int], created: int,
    **stored: str | None,
) -> Version:  # fmt: skip
    """A version by what a store holds of it; ``created`` is a time since 1970 [ms]."""
    return Version(
        machine=machine, version=number, bundle=tags.get(BUNDLE_TAG, ""),
        status=tags.get("status", ""), tags=tags,
        aliases=tuple(sorted(alias for alias, n in aliases.items() if n == number)),
        created=stamp(datetime.fromtimestamp(created / 1000, UTC)),
        **{key: value or "" for key, value in stored.items()},
    )  # fmt: skip


def read_versions(machine: str, name: str, database: Path, mode: str = "ro") -> list[Version]:
    """Versions of the registered model ``name``, oldest first; ValueError if not readable.

    Where a run broke off while it wrote, SQLite takes its half change back, and has to write.
    """
    uri = f"file:{quote(str(database.resolve()))}?mode={mode}"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as store:
            if not store.execute(
                "SELECT 1 FROM sqlite_master WHERE name = 'model_version_tags'"
            ).fetchone():
                return []
            rows = store.execute(
                "SELECT version, creation_time, run_id, description, storage_location"
                " FROM model_versions WHERE name = ? AND current_stage != 'Deleted_Internal'"
                " ORDER BY version", (name,),
            ).fetchall()  # fmt: skip
            tags: dict[int, dict[str, str]] = {row[0]: {} for row in rows}
            for number, key, value in store.execute(
                "SELECT version, key, value FROM model_version_tags WHERE name = ?", (name,)
            ):
                tags.get(number, {})[key] = value
            aliases = dict(store.execute(
                "SELECT alias, version FROM registered_model_aliases WHERE name = ?", (name,)
            ).fetchall())  # fmt: skip
    except sqlite3.Error as error:
        if mode == "ro" and error.sqlite_errorname.startswith("SQLITE_READONLY"):
            return read_versions(machine, name, database, "rw")
        raise ValueError(f"the registry sqlite:///{database} cannot be opened: {error}") from error
    return [
        version_of(machine, number, tags[number], aliases, created, run=run, description=said,
                   place=place)
        for number, created, run, said, place in rows
    ]  # fmt: skip


def write_note(note: Note, name: str, database: Path) -> bool:
    """Write changes of the registered model ``name``; False, and nothing, for other tables.

    Raises ValueError where the file cannot be written.
    """
    now = round(time.time() * 1000)
    one: dict[str, str | int] = {"name": name, "version": note.version}
    try:
        with closing(sqlite3.connect(database, timeout=30)) as store, store:
            if store.execute("SELECT version_num FROM alembic_version").fetchone() != (SCHEMA,):
                return False
            for alias, number in note.aliases.items():
                if number is not None:
                    _put(store, "registered_model_aliases", name=name, alias=alias, version=number)
                else:
                    store.execute("DELETE FROM registered_model_aliases WHERE name = ?"
                                  " AND alias = ?", (name, alias))  # fmt: skip
            for key, value in note.tags.items():
                _put(store, "model_version_tags", **one, key=key, value=value)
            if note.description:
                store.execute("UPDATE model_versions SET description = ?, last_updated_time = ?"
                              " WHERE name = ? AND version = ?",
                              (note.description, now, *one.values()))  # fmt: skip
            if note.card:
                store.execute("UPDATE registered_models SET description = ?, last_updated_time = ?"
                              " WHERE name = ?", (note.card, now, name))  # fmt: skip
            logged: dict[str, str | int] = {
                "run_uuid": note.run,
                "timestamp": 0,
                "step": 0,
                "is_nan": 0,
            }
            for key, figure in note.metrics.items():
                for table in ("metrics", "latest_metrics"):
                    _put(store, table, **logged, key=key, value=figure)
            place = store.execute("SELECT artifact_uri FROM runs WHERE run_uuid = ?",
                                  (note.run,)).fetchone()  # fmt: skip
            for path, text in note.files.items() if place else ():
                write_text(text, local_place(place[0], database.parent) / path)
    except sqlite3.Error as error:
        raise ValueError(
            f"the registry sqlite:///{database} cannot be written ({error}): look whether its disk "
            "is full, or another program holds it"
        ) from error
    return True


def _put(store: sqlite3.Connection, table: str, **row: str | float) -> None:
    """Insert a row, in the place of one with the same key."""
    marks = ", ".join("?" * len(row))
    store.execute(f"INSERT OR REPLACE INTO {table} ({', '.join(row)}) VALUES ({marks})",
                  (*row.values(),))  # fmt: skip


def local_place(stored: str, root: Path) -> Path:
    """Folder of an address below ``mlartifacts``, also in a project that was moved since.

    >>> local_place("file:///a%20b/mlartifacts/models/m-1", Path("nowhere")).as_posix()
    '/a b/mlartifacts/models/m-1'
    """
    moved = root / ARTIFACTS / stored.rpartition(f"/{ARTIFACTS}/")[2]
    return moved if moved.is_dir() else Path(unquote(urlparse(stored).path))
