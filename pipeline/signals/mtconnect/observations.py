"""Observations of an MTConnect stream: time, sequence, shape and values.

Source: ANSI/MTC1.4 part 3 and MTConnect 2.x part 3 (observation information model).
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import date
from functools import lru_cache
from typing import Any, Literal

from pipeline.signals.mtconnect.devices import DataItem, DeviceModel, is_name, number_of

BLANK = " \t\r\n"
"""White space of XML."""

SECTIONS = {"Samples": "SAMPLE", "Events": "EVENT", "Condition": "CONDITION",
            "Conditions": "CONDITION"}  # fmt: skip
LEVELS = {"normal": "NORMAL", "warning": "WARNING", "fault": "FAULT", "unavailable": None}
AXES = ("X", "Y", "Z")
FIRST_YEAR, LAST_YEAR = 1678, 2261
"""Whole years that fit 64 bits of nanoseconds since 1970."""
LAST_SEQUENCE = 2**64 - 1

_SUFFIXES = (("TimeSeries", "TIME_SERIES"), ("DataSet", "DATA_SET"), ("Table", "TABLE"))
_MESSAGES = ("Message", "MessageDiscrete", "Alarm")
_SPATIAL_EVENTS = ("Rotation", "Translation")
_OWN = ("dataItemId", "itemId", "name", "timestamp", "sequence")
_ISO = re.compile(
    r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(?:[.,](\d+))?(?:[Zz]|([+-])(\d\d):?(\d\d)?)?", re.ASCII
)
_EPOCH = date(1970, 1, 1).toordinal()

Manner = Literal["number", "value", "text", "condition", "series", "set"]


class MalformedError(ValueError):
    """A record with impossible content; the message is the reason to reject it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Shape:
    """Observation without its time, its sequence and its value.

    ``manner``: ``number`` (a sample), ``value`` (an event), ``text`` (a message, a name),
    ``condition``, ``series`` or ``set`` (also a table); ``rest``: attributes without a column.
    """

    data_item: str
    kind: str
    manner: Manner
    key: str | None = None
    rest: dict[str, Any] = field(default_factory=dict)
    attributes: str | None = None
    level: str | None = None
    spatial: bool = False
    rate: float | None = None


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Names of items by the device model, else by their own words, each with its first id."""

    model: DeviceModel | None
    several: bool
    seen: dict[tuple[str, str], str] = field(default_factory=dict)

    def item(self, item_id: str | None) -> DataItem | None:
        """Declaration of an item in the model."""
        return self.model.by_id(item_id) if self.model and item_id else None

    def label(self, device: str, item: DataItem | None, name: str, item_id: str = "") -> str:
        """``data_item`` of an observation that ``device`` made; the name of several is refused."""
        if item and self.model:
            name = self.model.own_name(item)
            device = item.device or device
        elif called := self.model.called(name) if self.model else ():
            if item_id or len(called) == 1:  # an id that the model lacks is another item
                name = item_id or name
            else:
                raise MalformedError(f"{name!r} is the name of {len(called)} data items")
        elif item_id and self.seen.setdefault((device, name), item_id) != item_id:
            name = item_id
        return f"{device}:{name}" if self.several else name


def shape_of(
    section: str, tag: str, attributes: dict[str, Any], device: str, naming: Naming
) -> Shape:
    """Shape of an observation by ``section``, ``tag`` and attributes; else MalformedError."""
    item_id = _word(attributes.get("dataItemId") or attributes.get("itemId")) or None
    name = _word(attributes.get("name")) or item_id
    if not name:
        raise MalformedError("the observation has neither dataItemId nor name")
    item = naming.item(item_id)
    rest = {k: v for k, v in attributes.items() if k not in _OWN and not k.startswith("xmlns")}
    kind, manner = _kind(section, tag, item)
    units = (item.units if item else None) or ""
    level = None
    key = None
    if kind == "CONDITION":
        if tag.lower() not in LEVELS:
            known = "Normal, Warning, Fault, Unavailable"
            raise MalformedError(f"the condition's level {tag[:60]!r} is none of {known}")
        level = LEVELS[tag.lower()]
    if kind in ("CONDITION", "MESSAGE"):
        own = "conditionId" if rest.get("conditionId") else "nativeCode"
        key = _word(rest.pop(own, None)) or None
    rate = attributes.get("sampleRate")
    return Shape(
        data_item=naming.label(device, item, name, item_id or ""),
        kind=kind,
        manner=manner,
        key=key,
        rest=rest,
        attributes=json_of(rest),
        level=level,
        spatial=kind == "SAMPLE" or tag in _SPATIAL_EVENTS or units.endswith("_3D"),
        rate=positive(rate) if rate is not None else item.sample_rate if item else None,
    )


def asset_shape(
    device: str, asset_id: str | None, document: dict[str, Any], naming: Naming
) -> Shape:
    """The shape of an asset that ``device`` announced; its ``document`` stands in attributes."""
    return Shape(
        data_item=naming.label(device, None, "asset"), kind="ASSET", manner="text", key=asset_id,
        attributes=json_of(document),
    )  # fmt: skip


def asset_time(timestamp: str | None) -> int:
    """Time [ns since 1970] of an asset by its own timestamp, or else by its document's."""
    if not timestamp:
        raise MalformedError("the asset has no timestamp and its document no creationTime")
    return nanoseconds(timestamp)


def _kind(section: str, tag: str, item: DataItem | None) -> tuple[str, Manner]:
    if section == "CONDITION":
        return "CONDITION", "condition"
    representation = (item.representation if item else None) or "VALUE"
    for suffix, named in _SUFFIXES:
        # "Table" alone or an event that merely ends so ("Timetable") is no table.
        if tag.endswith(suffix) and tag != suffix:
            representation = named
    if representation == "TIME_SERIES":
        return representation, "series"
    if representation in ("DATA_SET", "TABLE"):
        return representation, "set"
    if section == "UNKNOWN":
        section = (item.category if item else None) or "UNKNOWN"
    kind = item.type if item else None
    if tag in _MESSAGES or kind in ("MESSAGE", "ALARM"):
        return "MESSAGE", "text"
    if section == "SAMPLE":
        return section, "number"
    return section, "text" if is_name(tag) or is_name(kind) else "value"


def _word(value: Any) -> str | None:
    return None if value is None else value if isinstance(value, str) else str(value)


def json_of(attributes: dict[str, Any]) -> str | None:
    """Attributes as JSON with sorted keys; None when there are none."""
    if not attributes:
        return None
    try:
        return json.dumps(attributes, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    except RecursionError:
        raise MalformedError("what it says is nested too deeply") from None


def positive(value: Any) -> float:
    """A rate [Hz]; what is no positive number is a :class:`MalformedError`."""
    number = number_of(str(value))
    if number is None or number <= 0:
        raise MalformedError(f"the sample rate {str(value)[:60]!r} is no positive number of HERTZ")
    return number


def sequence_of(text: str) -> int:
    """An unsigned number of 64 bits; any other text is a :class:`MalformedError`."""
    if _digits(text) and len(text) <= 20 and (n := int(text)) <= LAST_SEQUENCE:
        return n
    raise MalformedError(f"the sequence {text[:60]!r} is no unsigned 64-bit number")


def nanoseconds(text: str) -> int:
    """Nanoseconds of :func:`iso_ns`; a text that is no such time is a :class:`MalformedError`."""
    ns = iso_ns(text)
    if ns is None:
        raise MalformedError(f"the timestamp {text[:60]!r} is no ISO 8601 time of 1678 to 2261")
    return ns


def iso_ns(text: str) -> int | None:
    """Nanoseconds since 1970 of an ISO 8601 time; UTC when it names no zone.

    Digits after the ninth of the fraction are cut off.  Second 60 is the first of the next minute.
    None for a text that is no such time, or of a year outside 1678 to 2261.
    """
    fraction, away = text[20:-1], 0
    if text[19:20] == "." and text[-1] == "Z" and _digits(fraction):  # nearly all
        seconds = _seconds(text[:19])
    elif found := _ISO.fullmatch(text):
        moment, fraction, sign, hours, minutes = found.groups()
        seconds = _seconds(moment)
        if sign:
            away = (int(hours) * 60 + int(minutes or 0)) * 60 * (1 if sign == "+" else -1)
            if int(hours) > 23 or int(minutes or 0) > 59:
                return None
    else:
        return None
    if seconds is None:
        return None
    return (seconds - away) * 1_000_000_000 + int((fraction or "0")[:9].ljust(9, "0"))


def _digits(text: str) -> bool:
    return text.isdigit() and text.isascii()


@lru_cache(maxsize=4096)
def _seconds(text: str) -> int | None:
    """Seconds since 1970 of a date and time of day."""
    if not _ISO.fullmatch(text):
        return None
    hour, minute, second = int(text[11:13]), int(text[14:16]), int(text[17:19])
    try:
        day = date.fromisoformat(text[:10])
    except ValueError:
        return None
    if hour > 23 or minute > 59 or second > 60 or not FIRST_YEAR <= day.year <= LAST_YEAR:
        return None
    return (day.toordinal() - _EPOCH) * 86400 + hour * 3600 + minute * 60 + second


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
EMPTY: Value = (None, None, None, False)
"""Set without entries: from now on nothing of it is available."""


def values_of(shape: Shape, time: int, value: Any) -> list[tuple[int, Value]]:
    """Time [ns since 1970] and value of each row of an observation; MalformedError if unfit."""
    if shape.manner == "condition":
        if isinstance(value, list):
            raise MalformedError("the condition has entries, a condition has a text")
        return [(time, (shape.key, None, shape.level, False))]
    if value == "UNAVAILABLE":
        return [(time, (shape.key, None, None, False))]
    if shape.manner == "number" and isinstance(value, str):
        return _one_value(shape, time, value)
    if shape.manner == "series":
        return _series(shape, time, value)
    if isinstance(value, list):
        rows = [(time, v) for entry in value for v in _entry_values(entry)]
        return rows or [(time, EMPTY)]
    if shape.manner == "set":
        if value:
            raise MalformedError(f"the data set holds the text {value[:60]!r} instead of entries")
        return [(time, EMPTY)]
    if shape.manner == "text":
        return [(time, (shape.key, None, value, False))]
    return _one_value(shape, time, value)


def _one_value(shape: Shape, time: int, value: str) -> list[tuple[int, Value]]:
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
    declared = shape.rest.get("sampleCount")
    if declared is not None and number_of(str(declared)) != len(numbers):
        count = len(numbers)
        raise MalformedError(f"the time series has {count} values, its sampleCount is {declared}")
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
