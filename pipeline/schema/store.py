"""Documents as JSON and tables as Parquet: written whole from a type, read as a type.

Plain values become frozen dataclasses strictly: no word becomes a truth value or a list of letters,
no fraction a whole number, and an unknown key is refused with its path.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from datetime import date
from functools import cache
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin

import cattrs
from cattrs import transform_error
from cattrs.v import format_exception

from pipeline.schema.files import replacing

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")


class StoreError(ValueError):
    """Stored file that is missing, broken, or of another form than its reader needs."""


def json_text(document: Any) -> str:
    """A document as it is stored, keys in the order of its fields; NaN and infinity are refused."""
    return json.dumps(unstructured(document), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def json_line(document: Any) -> str:
    """A document as one line of a file of such lines."""
    return json.dumps(unstructured(document), allow_nan=False, ensure_ascii=False)


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


def read_lines(path: Path, wanted: type[T], remedy: str) -> Iterator[tuple[T, str]]:
    """Documents of a file of JSON lines, each with the words of its place; none without a file.

    Raises StoreError as :func:`read_json` does.
    """
    lines = content(path, remedy).splitlines() if path.exists() else []
    for number, line in enumerate(lines, start=1):
        where = f"{path}, line {number}"
        yield parsed(line, wanted, where, remedy), where


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


def structured(value: Any, wanted: type[T], path: str) -> T:
    """Plain value of JSON or YAML as ``wanted``: a frozen dataclass, or a tuple or mapping of such.

    Unknown and missing keys, values of another kind and those out of range are a ValueError that
    names each key with its path below ``path``.
    """
    if is_dataclass(wanted) and not isinstance(value, dict):
        raise ValueError(f"{path} is {value!r:.60}, a mapping of keys is needed")
    try:
        return _converter().structure(value, wanted)
    except (cattrs.BaseValidationError, ValueError, TypeError) as error:
        reasons = "; ".join(transform_error(error, path=path, format_exception=_reason))
        raise ValueError(reasons) from error


def unstructured(value: Any) -> Any:
    """Dataclass as mappings, lists, numbers and words, in field order, without infinite limits."""
    return _finite(_converter().unstructure(value))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items() if v != inf or isinstance(v, bool)}
    return [_finite(one) for one in value] if isinstance(value, list | tuple) else value


def _reason(error: BaseException, wanted: type | None) -> str:
    """Reason why a value does not fit; the words of the class that refused it, if any."""
    if type(error) in (ValueError, TypeError):
        return str(error)
    return format_exception(error, wanted)


def _truth(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{value!r} is neither true nor false")
    return value


def _whole(value: Any, _: Any) -> int:
    whole = isinstance(value, int | float) and float(value).is_integer()
    if isinstance(value, bool) or not whole:
        raise ValueError(f"{value!r} is no whole number")
    return int(value)


def _number(value: Any, _: Any) -> float:
    # YAML 1.1 reads 1e-3, without a dot, as a word
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{value!r} is no number")
    try:
        return float(value)
    except ValueError as error:
        raise ValueError(f"{value!r} is no number") from error


def _word(value: Any, _: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float | date):
        raise ValueError(f"{value!r} is no word")
    return str(value)


def _number_or_name(value: Any, _: Any) -> int | str:
    return value if isinstance(value, int) and not isinstance(value, bool) else str(value)


def _value_or_name(value: Any, _: Any) -> float | str:
    """A number, or the name of what holds it; YAML's 1e-3 is the number."""
    try:
        return _number(value, _)
    except ValueError:
        return _word(value, _)


def _one_of(value: Any, wanted: Any) -> Any:
    allowed = get_args(wanted)
    if value not in allowed or isinstance(value, bool):
        raise ValueError(f"{value!r} is none of {', '.join(map(str, allowed))}")
    return value


@cache
def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    hooks: dict[type, Callable[[Any, Any], Any]] = {
        bool: _truth, int: _whole, float: _number, str: _word
    }  # fmt: skip
    for scalar, hook in hooks.items():
        converter.register_structure_hook(scalar, hook)
    converter.register_structure_hook(int | str, _number_or_name)
    converter.register_structure_hook(float | str, _value_or_name)
    converter.register_structure_hook(
        float | str | None, lambda value, _: None if value is None else _value_or_name(value, _)
    )
    converter.register_structure_hook_func(lambda t: get_origin(t) is Literal, _one_of)
    plain: set[Any] = set()

    def is_list(wanted: Any) -> bool:
        return get_origin(wanted) in (tuple, list) and wanted not in plain

    def listed(wanted: Any, converter: cattrs.Converter) -> Callable[[Any, Any], Any]:
        plain.add(wanted)
        of_list = converter.get_structure_hook(wanted, cache_result=False)
        plain.remove(wanted)

        def hook(value: Any, _: Any) -> Any:
            if not isinstance(value, list | tuple):
                raise ValueError(f"{value!r} is no list")
            return of_list(value, wanted)

        return hook

    converter.register_structure_hook_factory(is_list, listed)
    return converter
