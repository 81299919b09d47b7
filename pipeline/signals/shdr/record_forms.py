"""Forms of a record of an SHDR log, after the item's name: as a Devices document declares, or open.

Without a Devices document the form of a record follows from what it looks like
(:func:`undeclared`):

- a level word (NORMAL, WARNING, FAULT, UNAVAILABLE) followed by at least four more fields, the
  third of which is empty, HIGH or LOW, is a condition;
- a count, a rate or nothing, and exactly that many (two or more) numbers are a time series;
- exactly three fields after the time, the last not empty, are a message: name, code, text;
- three numbers with blanks between and a decimal point in one of them are a position;
- any other value is a number where it is a finite decimal number, else text.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

import re
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.signals.formats import RecordSource
from pipeline.signals.mtconnect.devices import (
    DataItem,
    DeviceModel,
    is_name,
    number_of,
    read_devices,
)
from pipeline.signals.units import mtconnect_factor

MOST_CACHED = 1 << 16
"""Names kept; a log of noise has more and does not fill the memory."""


class ItemPlan(NamedTuple):
    """Reading of the fields after one item's name.

    ``shape`` names the form; ``value * factor + offset`` is in the document's units; ``why`` is the
    reason why values are not kept, ``rate`` [Hz] that of a time series.
    """

    name: str
    kind: str = "UNKNOWN"
    shape: str = "any"
    factor: float = 1.0
    offset: float = 0.0
    why: str = ""
    rate: float = 0.0


class Items:
    """Plans of a source's items; the Devices document is read for the first of them."""

    def __init__(self, source: RecordSource, root: Path) -> None:
        self._source, self._root = source, root
        self._plans: dict[str, ItemPlan] = {}

    def plan(self, key: str) -> ItemPlan:
        """The plan for the item that the log calls ``key``, with or without ``device:``."""
        plan = self._plans.get(key)
        if plan is None:
            plan = self._plan(key)
            if len(self._plans) < MOST_CACHED:
                self._plans[key] = plan
        return plan

    def _plan(self, key: str) -> ItemPlan:
        model = self._model
        if model is None:
            return ItemPlan(key)
        item = model.find(key)
        if item is None:
            why = _not_one(key, model)
            return ItemPlan(key, shape="refused" if why else "any", why=why)
        plan = ItemPlan(model.item_name(item), *_form(item), rate=item.sample_rate or 0.0)
        native = self._source.values == "native" and plan.shape in ("sample", "position", "series")
        return _converted(plan, item) if native else plan

    @cached_property
    def _model(self) -> DeviceModel | None:
        if not self._source.devices:
            return None
        return read_devices(self._root / self._source.devices, self._source.device)


def _not_one(key: str, model: DeviceModel) -> str:
    """Reason why a name that no item of the document bears alone is refused; ``""`` if unknown."""
    called = model.called(key)
    device, colon, _ = key.partition(":")
    if called:
        ids = ", ".join(i.id if not model.several else f"{i.device}:{i.id}" for i in called[:5])
        return f"item {key[:40]!r} is the name of {len(called)} data items: write the id ({ids})"
    if colon and not any(d.is_called(device) for d in model.devices):
        there = ", ".join(d.label for d in model.devices)
        return (
            f"item {key[:40]!r} is of device {device[:40]!r}, this source reads {there}: give the "
            "other device a source with its Devices document"
        )
    return ""


def _form(item: DataItem) -> tuple[str, str]:
    category, representation = item.category, item.representation or "VALUE"
    if category == "CONDITION":
        return "CONDITION", "condition"
    if representation in ("DATA_SET", "TABLE"):
        return representation, representation.lower()
    if category == "SAMPLE" and representation == "TIME_SERIES":
        return "TIME_SERIES", "series"
    if (item.units or "").endswith("_3D"):
        return category or "UNKNOWN", "position"
    if category == "SAMPLE":
        return "SAMPLE", "sample"
    if item.type in ("MESSAGE", "ALARM"):
        return "MESSAGE", item.type.lower()
    if item.type in ("ASSET_CHANGED", "ASSET_REMOVED"):
        return "EVENT", "asset_event"
    return "EVENT", "word" if is_name(item.type) else "event"


def _converted(plan: ItemPlan, item: DataItem) -> ItemPlan:
    """The plan with factor and offset from native units."""
    units = item.units or item.native_units or ""
    scale = 1.0 if item.native_scale is None else item.native_scale
    try:
        factor, offset = mtconnect_factor(item.native_units or units, units, scale)
    except ValueError as error:
        return plan._replace(shape="unconvertible", why=str(error))
    return plan._replace(factor=factor, offset=offset)


LEVELS = ("NORMAL", "WARNING", "FAULT", "UNAVAILABLE")
UNKNOWN = ItemPlan("")


class Value(NamedTuple):
    """One value of a record, its attributes, and how long before the record's time it is [ns]."""

    number: float | None = None
    text: str | None = None
    key: str | None = None
    attributes: dict[str, object] = {}  # noqa: RUF012 - nobody changes it
    before: int = 0


class RecordForm(NamedTuple):
    """Values of a record, and how many fields after the item's name it took."""

    kind: str
    values: list[Value]
    used: int = 1


def _single(kind: str, used: int = 1, **value: Any) -> RecordForm:
    """A record of one value; nothing for an unavailable one."""
    return RecordForm(kind, [Value(**value)], used)


class RefusedError(ValueError):
    """A record that is not kept; ``used`` fields after the item's name belong to it."""

    def __init__(self, reason: str, used: int = 1) -> None:
        super().__init__(reason)
        self.used = used


def is_unavailable(text: str) -> bool:
    """Whether a value is the word UNAVAILABLE."""
    return len(text) == 11 and text.upper() == "UNAVAILABLE"


def scalar(text: str, key: str | None = None, attributes: dict[str, object] | None = None) -> Value:
    """A number where ``text`` is one, nothing where it is UNAVAILABLE, else text."""
    if is_unavailable(text):
        return Value(key=key, attributes=attributes or {})
    number = number_of(text)
    return Value(number, None if number is not None else text, key, attributes or {})


def undeclared(rest: list[str], *, alone: bool) -> RecordForm:
    """A record of an item that no document describes; ``alone`` on its line so far."""
    value = rest[0]
    if value.upper() in LEVELS and len(rest) > 4 and rest[3].upper() in ("", "HIGH", "LOW"):
        return condition(UNKNOWN, rest)
    if len(rest) > 2 and value.isdecimal() and (not rest[1] or number_of(rest[1]) is not None):
        numbers = [number_of(v) for v in rest[2].split()]
        if len(numbers) == number_of(value) and len(numbers) > 1 and None not in numbers:
            return series(UNKNOWN, rest)
    if alone and len(rest) == 2 and rest[1]:
        return message(UNKNOWN, rest)
    if "." in value and (values := _axes(value, UNKNOWN)):
        return RecordForm("UNKNOWN", values)
    return event(UNKNOWN, rest)


def _axes(text: str, plan: ItemPlan) -> list[Value]:
    """X, Y and Z of a text of three numbers; none of another one."""
    numbers = [number_of(v) for v in text.split(None, 3)]
    if len(numbers) != 3:
        return []
    known = zip(numbers, "XYZ", strict=True)
    values = [Value(_in_units(n, plan), key=k) for n, k in known if n is not None]
    return values if len(values) == 3 else []


def sample(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``value`` or ``value:RESET``, a number."""
    text, attributes = rest[0], {}
    if is_unavailable(text):
        return _single(plan.kind)
    number = number_of(text)
    if number is None and ":" in text:
        text, _, trigger = text.partition(":")
        number, attributes = number_of(text), {"resetTriggered": trigger}
    if number is None:
        raise RefusedError(f"sample {plan.name!r} is {rest[0][:40]!r}, which is no number")
    return _single(plan.kind, number=_in_units(number, plan), attributes=attributes)


def _in_units(number: float, plan: ItemPlan) -> float:
    if plan.factor == 1.0 and plan.offset == 0.0:
        return number
    return number * plan.factor + plan.offset


def event(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``value``, a number where it is one."""
    return RecordForm(plan.kind, [scalar(rest[0])])


def word(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``value``, a name even where it looks like a number."""
    return _single(plan.kind, text=None if is_unavailable(rest[0]) else rest[0])


def condition(_: ItemPlan, rest: list[str]) -> RecordForm:
    """``level|code|severity|qualifier|text``, and ``code:id`` from version 2.3 on."""
    level, code, severity, qualifier, text = (rest + [""] * 4)[:5]
    used = min(5, len(rest))
    level = level.upper()
    if level not in LEVELS:
        known = ", ".join(LEVELS)
        raise RefusedError(f"level {level[:40]!r} of a condition is none of {known}", used)
    code, _colon, condition_id = code.partition(":")
    attributes = {"severity": severity, "qualifier": qualifier, "message": text}
    if condition_id:
        attributes["nativeCode"] = code
    value = None if level == "UNAVAILABLE" else level
    key = condition_id or code or None
    return _single("CONDITION", used, text=value, key=key, attributes=attributes)


def message(_: ItemPlan, rest: list[str]) -> RecordForm:
    """Message ``code|text``."""
    code, text = (rest + [""])[:2]
    used = min(2, len(rest))
    if is_unavailable(text) or (not text and is_unavailable(code)):
        return _single("MESSAGE", used)
    return _single("MESSAGE", used, text=text, key=code or None)


def alarm(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``code|native code|severity|state|text``, of version 1.0."""
    code, native, severity, state, text = (rest + [""] * 4)[:5]
    used = min(5, len(rest))
    if is_unavailable(code) or is_unavailable(text):
        return _single(plan.kind, used)
    attributes = {"code": code, "severity": severity, "state": state}
    return _single(plan.kind, used, text=text, key=native or None, attributes=attributes)


def asset_event(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``asset type|asset id``, or the id alone."""
    if len(rest) == 1 or is_unavailable(rest[0]):
        return word(plan, rest)
    text = None if is_unavailable(rest[1]) else rest[1]
    return _single(plan.kind, 2, text=text, attributes={"assetType": rest[0]})


def series(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``count|rate|values``; the key is the place in the series, from 1.

    The time of the record is that of the last value (MTConnect part 3, TimeSeries).
    """
    used = min(3, len(rest))
    if is_unavailable(rest[used - 1]):
        return _single("TIME_SERIES", used)
    if used < 3:
        raise RefusedError(f"time series {plan.name!r} has no count, rate and values", used)
    numbers = [number_of(v) for v in rest[2].split()]
    if not numbers or number_of(rest[0]) != len(numbers) or None in numbers:
        what = f"a time series of {rest[0][:20]!r} values has {len(numbers)}"
        raise RefusedError(what if None not in numbers else f"{what}, not all numbers", used)
    rate = number_of(rest[1])
    attributes: dict[str, object] = {"sampleCount": len(numbers), "sampleRate": rate}
    step = 1e9 / (rate or plan.rate) if (rate or plan.rate) > 1e-9 else 0.0
    last = len(numbers) - 1
    values = [
        Value(_in_units(n, plan), None, str(i + 1), attributes, round((last - i) * step))
        for i, n in enumerate(numbers)
        if n is not None
    ]
    return RecordForm("TIME_SERIES", values, used)


def position(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """Three numbers; the keys are X, Y and Z."""
    if is_unavailable(rest[0]):
        return _single(plan.kind)
    values = _axes(rest[0], plan)
    if not values:
        raise RefusedError(f"{plan.name!r} is {rest[0][:40]!r}, which is not three numbers")
    return RecordForm(plan.kind, values)


def data_set(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """``key=value key={a b} removed`` or ``:RESET key=value``; a table's entries hold such too."""
    text = rest[0]
    if is_unavailable(text):
        return _single(plan.kind)
    attributes: dict[str, object] = {}
    if text.startswith(":"):
        trigger, _, text = text[1:].partition(" ")
        attributes = {"resetTriggered": trigger.upper()}
    try:
        values = _entries(text, attributes, table=plan.kind == "TABLE")
    except ValueError as error:
        raise RefusedError(f"{plan.name!r}: {error}") from None
    return RecordForm(plan.kind, values or [Value(attributes=attributes)])  # an empty set


def _entries(text: str, attributes: dict[str, object], *, table: bool) -> list[Value]:
    values = []
    for key, value in entries_of(text):
        cells = entries_of(value) if table and value and "=" in value else [("", value)]
        for cell, content in cells:
            whole = f"{key}/{cell}" if cell else key
            if content is None:
                values.append(Value(key=whole, attributes=attributes | {"removed": True}))
            else:
                values.append(scalar(content, whole, attributes))
    return values


_BRACE = re.compile(r"\\.|[{}]", re.S)
_KEY = re.compile(r"[^\s={}]+")


def entries_of(text: str) -> list[tuple[str, str | None]]:
    """Entries ``key=value`` of a data set, value None where the entry is removed.

    A value with blanks stands in braces or quotes; one that is not closed, or has no key, is a
    ValueError.
    """
    entries: list[tuple[str, str | None]] = []
    at = 0
    while True:
        while at < len(text) and text[at].isspace():
            at += 1
        if at == len(text):
            return entries
        key = _KEY.match(text, at)
        if not key:
            raise ValueError(f"the data set has no key at character {at + 1}")
        at = key.end()
        value = None
        if text[at : at + 1] == "=":
            value, at = _entry_value(text, at + 1)
        entries.append((key[0], value or None))


def _entry_value(text: str, at: int) -> tuple[str, int]:
    opening = text[at : at + 1]
    if opening == "{":
        end = _closing_brace(text, at)
        return text[at + 1 : end], end + 1
    if opening and opening in "\"'":
        found = re.compile(rf"{opening}((?:[^{opening}\\]|\\.)*+){opening}", re.S).match(text, at)
        if not found:
            raise ValueError(f"the quote at character {at + 1} of the data set is not closed")
        return re.sub(r"\\(.)", r"\1", found[1], flags=re.S), found.end()
    end = at
    while end < len(text) and not text[end].isspace():
        end += 1
    return text[at:end], end


def _closing_brace(text: str, at: int) -> int:
    depth = 0
    for mark in _BRACE.finditer(text, at):
        depth += {"{": 1, "}": -1}.get(mark[0], 0)
        if depth == 0:
            return mark.start()
    raise ValueError(f"the brace at character {at + 1} of the data set is not closed")


def unconvertible(plan: ItemPlan, rest: list[str]) -> RecordForm:
    """A sample whose native units cannot become its units."""
    raise RefusedError(f"{plan.name!r} cannot be converted: {plan.why}", 3 if len(rest) == 3 else 1)


def asset(command: str, rest: list[str]) -> RecordForm:
    """``@ASSET@|id|type|document`` and three commands on assets; a removed one is unavailable.

    ``text`` is the type, ``key`` the id, the document or the changes stand in ``attributes``.
    """
    name, n = rest[0] if rest else "", len(rest)
    said: dict[str, object] = {"command": command}
    if command == "@REMOVE_ALL_ASSETS@":
        return _single("ASSET", min(1, n), attributes=said | {"assetType": name})
    if not name:
        raise RefusedError(f"{command[:40]} names no asset", min(1, n))
    if command == "@REMOVE_ASSET@":
        return _single("ASSET", key=name, attributes=said)
    if command == "@UPDATE_ASSET@" and n == 2:
        return _single("ASSET", n, text="", key=name, attributes=said | {"xml": rest[1]})
    if command == "@UPDATE_ASSET@" and n % 2:
        changes = dict(zip(rest[1::2], rest[2::2], strict=True))
        return _single("ASSET", n, text="", key=name, attributes=said | {"changes": changes})
    if command == "@ASSET@" and n > 2:
        return _single("ASSET", n, text=rest[1], key=name, attributes={"xml": "|".join(rest[2:])})
    raise RefusedError(f"{command[:40]!r} with {n} fields is no command", n)


FORMS: dict[str, Callable[[ItemPlan, list[str]], RecordForm]] = {
    "sample": sample, "event": event, "word": word, "condition": condition, "message": message,
    "alarm": alarm, "asset_event": asset_event, "series": series, "position": position,
    "data_set": data_set, "table": data_set, "unconvertible": unconvertible,
}  # fmt: skip
