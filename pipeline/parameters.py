"""The only file that opens params.yaml: one section, typed, unknown keys refused.

What a value is not is never made of it: no word becomes a truth value or a list of letters, no
fraction a whole number.
"""

from collections.abc import Callable
from dataclasses import is_dataclass
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import cattrs
import yaml
from cattrs import transform_error
from cattrs.v import format_exception

T = TypeVar("T")

PARAMS = Path("params.yaml")


class ParametersError(ValueError):
    """A section of params.yaml that is missing or not what its stage asks for."""


def read_params(path: Path = PARAMS) -> dict[str, Any]:
    """All of params.yaml.

    Raises
    ------
    ParametersError
        When the file is missing or is no YAML mapping.
    """
    if not path.exists():
        raise ParametersError(
            f"{path} does not exist: run `dvc repro compose` to write it from conf/"
        )
    try:
        values = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise ParametersError(f"{path} is no YAML: {error}") from error
    if not isinstance(values, dict):
        raise ParametersError(f"{path} holds {type(values).__name__}, a mapping is needed")
    return values


def section_path(values: dict[str, Any], name: str, item: str | None) -> str:
    """Key path of the section ``name``: ``machine.<item>.<name>`` where the machine has one.

    Raises
    ------
    ParametersError
        When there is no machine called ``item``.
    """
    machines = values.get("machine") or {}
    if item and item not in machines:
        raise ParametersError(
            f"params.yaml has no section machine.{item}, known machines are {sorted(machines)}: "
            "name it in conf/fleet/ and run `dvc repro compose`"
        )
    machine = (machines[item] or {}) if item else {}
    return f"machine.{item}.{name}" if name in machine else name


def structure(values: dict[str, Any], path: str, wanted: type[T]) -> T:
    """The section at the key path ``path`` as ``wanted``.

    Raises
    ------
    ParametersError
        When the section is missing, has unknown or missing keys or values out of range; the
        message names the keys with their paths.
    """
    found: Any = values
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            raise ParametersError(
                f"params.yaml has no section {path}: add it in conf/ and run `dvc repro compose`"
            )
        found = found[key]
    if is_dataclass(wanted) and not isinstance(found, dict):
        raise ParametersError(f"params.yaml, {path} is {found!r}, a mapping of keys is needed")
    try:
        return _converter().structure(found, wanted)
    except (cattrs.BaseValidationError, ValueError, TypeError) as error:
        reasons = "; ".join(transform_error(error, path=path, format_exception=_reason))
        raise ParametersError(f"params.yaml, {reasons}") from error


def _reason(error: BaseException, wanted: type | None) -> str:
    """What is wrong with a value; the words of the class that refused it where it said some."""
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


def _value_or_nothing(value: Any, _: Any) -> float | str | None:
    return None if value is None else _value_or_name(value, _)


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
    converter.register_structure_hook(float | str | None, _value_or_nothing)
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
