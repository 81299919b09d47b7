"""The values of one observation: of a sample, an event, a condition, a set, a time series."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pipeline.signals.mtconnect.words import AXES, MalformedError, Shape, number_of

EARLIEST = -(2.0**63)
"""First nanosecond since 1970 that fits a time."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a data set, or (``cells``) one row of a table."""

    key: str
    text: str = ""
    removed: bool = False
    cells: tuple[tuple[str, str], ...] | None = None


Value = tuple[str | None, float | None, str | None, bool]
"""Key, number, text and whether it was removed."""


def values_of(shape: Shape, time: int, value: Any) -> list[tuple[int, Value]]:
    """Time [ns since 1970] and value of each row that an observation gives.

    Raises
    ------
    MalformedError
        When its value does not fit its shape.
    """
    if shape.manner == "condition":
        if isinstance(value, list):
            raise MalformedError("the condition has entries, a condition has a text")
        return [(time, (shape.key, None, shape.level, False))]
    if value == "UNAVAILABLE":
        return [(time, (shape.key, None, None, False))]
    if shape.manner == "number" and isinstance(value, str):
        return _plain(shape, time, value)
    if shape.manner == "series":
        return _series(shape, time, value)
    if isinstance(value, list):
        return [(time, v) for entry in value for v in _entry_values(entry)] or _empty(time)
    if shape.manner == "set":
        return _pairs(time, value)
    if shape.manner == "text":
        return [(time, (shape.key, None, value, False))]
    return _plain(shape, time, value)


def _plain(shape: Shape, time: int, value: str) -> list[tuple[int, Value]]:
    number = number_of(value)
    if number is not None:
        return [(time, (shape.key, number, None, False))]
    if shape.spatial:
        numbers = [number_of(word) for word in value.split()]
        if len(numbers) == len(AXES) and None not in numbers:
            return [(time, (axis, n, None, False)) for axis, n in zip(AXES, numbers, strict=True)]
    if shape.manner == "number":
        raise MalformedError(f"the sample's value {value[:60]!r} is no finite number")
    return [(time, (shape.key, None, value, False))]


def _empty(time: int) -> list[tuple[int, Value]]:
    # A set without entries is empty from now on: nothing of it is available.
    return [(time, (None, None, None, False))]


def _pairs(time: int, value: str) -> list[tuple[int, Value]]:
    if value:
        raise MalformedError(f"the data set holds the text {value[:60]!r} instead of entries")
    return _empty(time)


def _entry_values(entry: Entry) -> Iterator[Value]:
    if entry.removed:
        yield entry.key, None, None, True
    elif entry.cells is None:
        yield entry.key, *_either(entry.text), False
    elif not entry.cells:
        yield entry.key, None, None, False
    for key, text in entry.cells or ():
        yield f"{entry.key}/{key}", *_either(text), False


def _either(text: str) -> tuple[float | None, str | None]:
    number = number_of(text)
    if number is not None or text == "UNAVAILABLE":
        return number, None
    return None, text


def _series(shape: Shape, time: int, value: Any) -> list[tuple[int, Value]]:
    """Samples of a time series; its timestamp is that of the last (MTConnect 2.x part 3)."""
    if not isinstance(value, str):
        raise MalformedError("the time series holds entries instead of numbers")
    numbers = [number_of(word) for word in value.split()]
    if not numbers or None in numbers:
        raise MalformedError(f"the time series {value[:60]!r} is no row of finite numbers")
    said = shape.rest.get("sampleCount")
    if said is not None and number_of(str(said)) != len(numbers):
        count = len(numbers)
        raise MalformedError(f"the time series has {count} values, its sampleCount is {said}")
    step = _step(shape, len(numbers))
    last = len(numbers) - 1
    if not time - last * step > EARLIEST:
        raise MalformedError(f"the time series begins {last * step / 1e9:g} s before its timestamp")
    return [
        (time - round((last - i) * step), (str(i + 1), n, None, False))
        for i, n in enumerate(numbers)
    ]


def _step(shape: Shape, count: int) -> float:
    """Nanoseconds between two samples; 0 when neither rate nor duration is known."""
    if shape.rate:
        return 1e9 / shape.rate
    duration = number_of(str(shape.rest.get("duration", "")))
    return duration * 1e9 / (count - 1) if duration and count > 1 else 0.0
