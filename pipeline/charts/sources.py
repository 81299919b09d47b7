"""Files of a machine, read with a record of path and hash behind each figure.

Nothing here raises for a file that is absent or broken: a report on part of the data is still a
report.  What is absent or broken is remembered, so that the pages can say so.
"""

import hashlib
import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.predictions import read_predictions
from pipeline.schema.store import StoreError, parsed, structured

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Source:
    """File behind a figure: its path as shown, its SHA-256, its own sources."""

    path: str
    sha256: str
    made_from: str = ""


@dataclass
class SourceRegistry:
    """The files of one machine: reads them once, keeps their hashes."""

    used: dict[str, Source] = field(default_factory=dict)
    """Every file read so far, by the path as shown."""
    broken: dict[str, str] = field(default_factory=dict)
    """Files that exist and could not be read, and why."""

    def document(self, path: Path, made_from: str = "") -> dict[str, Any] | None:
        """A JSON object, or None when the file is absent or is not one."""
        content = self._content(path, made_from)
        if content is None:
            return None
        try:
            found = json.loads(content)
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            self.broken[shown(path)] = f"not JSON: {error}"
            return None
        if not isinstance(found, dict):
            self.broken[shown(path)] = f"holds a {type(found).__name__}, not an object with keys"
            return None
        return found

    def read(self, path: Path, wanted: type[T], made_from: str = "") -> T | None:
        """A stored document as its type, or None when the file is absent or is not one."""
        content = self._content(path, made_from)
        if content is None:
            return None
        try:
            return parsed(content, wanted, shown(path))
        except StoreError as error:
            self.broken[shown(path)] = str(error).removeprefix(f"{shown(path)} ")
            return None

    def predictions(self, path: Path, made_from: str = "") -> "pd.DataFrame | None":
        """The long table of a sub-model's predictions; None when it is absent or broken."""
        if self._content(path, made_from) is None:
            return None
        try:
            return read_predictions(path)
        except StoreError as error:
            self.broken[shown(path)] = str(error).removeprefix(f"{path} ")
            return None

    def table(
        self, path: Path, columns: tuple[str, ...], made_from: str = "", *, all_of: bool = True
    ) -> pa.Table | None:
        """Selected ``columns`` of a Parquet file; None when it is absent, broken or lacks one.

        With ``all_of=False`` columns that the file does not have are left out.
        """
        content = self._content(path, made_from)
        if content is None:
            return None
        try:
            file = pq.ParquetFile(pa.BufferReader(content))
            there = [c for c in columns if c in file.schema_arrow.names]
            lacking = [c for c in columns if c not in there]
            if lacking and all_of:
                self.broken[shown(path)] = f"has no column {', '.join(lacking)}"
                return None
            return file.read(columns=there)
        except (pa.ArrowException, OSError) as error:
            self.broken[shown(path)] = f"not Parquet: {error}"
            return None

    def text(self, path: Path, made_from: str = "") -> str | None:
        """Text of a file; None when it is absent."""
        content = self._content(path, made_from)
        return None if content is None else content.decode(errors="replace")

    def source(self, path: Path) -> Source | None:
        """Record of a file that was read."""
        return self.used.get(shown(path))

    def _content(self, path: Path, made_from: str) -> bytes | None:
        if not path.is_file():
            return None
        content = path.read_bytes()
        sha256 = hashlib.sha256(content).hexdigest()
        self.used[shown(path)] = Source(path=shown(path), sha256=sha256, made_from=made_from)
        return content


def shown(path: Path) -> str:
    """A path as the report shows it: relative to the project, else its last three parts."""
    if path.is_absolute() and path.is_relative_to(Path.cwd()):
        path = path.relative_to(Path.cwd())
    return "/".join(path.parts[-3:]) if path.is_absolute() else path.as_posix()


def picked(document: Any, wanted: type[T], path: str) -> T:
    """Keys of a document that a type has; null there takes the type's default.

    ValueError when the document is no mapping of keys, or a value is of another kind.
    """
    names = {one.name for one in fields(wanted)}  # type: ignore[arg-type]
    if not isinstance(document, dict):
        raise ValueError(f"{path} is {document!r:.60}, a mapping of keys is needed")
    known = {k: v for k, v in document.items() if k in names and v is not None}
    return structured(known, wanted, path)


def stated(truth: Any, *keys: str) -> Any:
    """Truth of a simulated machine under ``keys``, of any shape; None where it states nothing."""
    for key in keys:
        truth = truth.get(key) if isinstance(truth, dict) else None
    return truth
