"""Strict conversion of plain values to frozen dataclasses.

No word becomes a truth value or a list of letters, no fraction a whole number, and an unknown key
is refused with its path.
"""

from collections.abc import Callable
from dataclasses import is_dataclass
from datetime import date
from functools import cache
from math import inf
from typing import Any, Literal, TypeVar, get_args, get_origin

import cattrs
from cattrs import transform_error
from cattrs.v import format_exception

T = TypeVar("T")


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
