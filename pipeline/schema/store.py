"""Documents as JSON and tables as Parquet: written whole from a type, read as a type."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pipeline.schema.files import replacing
from pipeline.schema.structure import structured, unstructured

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")


class StoreError(ValueError):
    """Stored file that is missing, broken, or of another form than its reader needs."""


def json_text(document: Any) -> str:
    """A document as it is stored, keys in the order of its fields; NaN and infinity are refused."""
    return json.dumps(unstructured(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def write_json(document: Any, path: Path) -> None:
    """Store a dataclass, or a mapping or tuple of them."""
    write_text(json_text(document), path)


def write_text(text: str, path: Path, encoding: str = "utf-8") -> None:
    """Store a text; its line ends stay as they are."""
    write_bytes(text.encode(encoding), path)


def write_bytes(data: bytes, path: Path) -> None:
    """Store bytes."""
    with replacing(path) as part:
        part.write_bytes(data)


def read_json(path: Path, wanted: type[T], remedy: str = "run `dvc repro`") -> T:
    """Document in ``path`` as ``wanted``; StoreError with file, key and ``remedy`` if unfit."""
    return parsed(content(path, remedy), wanted, str(path), remedy)


def content(path: Path, remedy: str = "run `dvc repro`") -> bytes:
    """The bytes of a stored file; one that cannot be read is a :class:`StoreError`."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise StoreError(f"{path} does not exist: {remedy}") from error
    except OSError as error:
        raise StoreError(f"{path} cannot be read ({error.strerror}): {remedy}") from error


def parsed(text: bytes, wanted: type[T], name: str, remedy: str = "run `dvc repro`") -> T:
    """JSON bytes as ``wanted``; see :func:`read_json`."""
    try:
        value = json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise StoreError(f"{name} is no JSON ({error}): {remedy}") from error
    try:
        return structured(value, wanted, "$")
    except ValueError as error:
        raise StoreError(f"{name} is not what this version stores ({error}): {remedy}") from error


def write_table(table: "pa.Table", path: Path) -> None:
    """Store a table as Parquet with zstd."""
    import pyarrow.parquet as pq

    with replacing(path) as part:
        pq.write_table(table, part, compression="zstd")


def read_table(
    path: Path, columns: Mapping[str, "pa.DataType"], remedy: str = "run `dvc repro`"
) -> "pa.Table":
    """Stored table with ``columns`` of given types, further ones kept; else StoreError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.exists():
        raise StoreError(f"{path} does not exist: {remedy}")
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        said = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StoreError(f"{path} is no Parquet ({said}): {remedy}") from error
    for name, wanted in columns.items():
        if name not in table.column_names:
            raise StoreError(f"{path} has no column {name}: {remedy}")
        if table.schema.field(name).type != wanted:
            found = table.schema.field(name).type
            raise StoreError(f"{path}, column {name} is {found}, {wanted} is needed: {remedy}")
    return table
