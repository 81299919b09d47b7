"""The forms that a record of an SHDR log can have, after the item's name, each as a function.

Without a Devices document the form of a record is judged by what it looks like (:func:`anything`):

- a level word (NORMAL, WARNING, FAULT, UNAVAILABLE) followed by at least four more fields, the
  third of which is empty, HIGH or LOW, is a condition;
- a count, a rate or nothing, and exactly that many (two or more) numbers are a time series;
- exactly three fields after the time, the last not empty, are a message: name, code, text;
- three numbers with blanks between and a decimal point in one of them are a position;
- any other value is a number where it is a finite decimal number, else text.

Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

from collections.abc import Callable
from typing import NamedTuple

from pipeline.signals.shdr.fields import entries_of, number_of
from pipeline.signals.shdr.items import Plan

LEVELS = ("NORMAL", "WARNING", "FAULT", "UNAVAILABLE")
UNKNOWN = Plan("")


class Value(NamedTuple):
    """One value of a record; ``said`` is what else was said, ``before`` [ns] the record's time."""

    number: float | None = None
    text: str | None = None
    key: str | None = None
    said: dict[str, object] = {}  # noqa: RUF012 - nobody changes it
    before: int = 0


class Form(NamedTuple):
    """What a record says, and how many fields after the item's name it took."""

    kind: str
    values: list[Value]
    used: int


class RefusedError(ValueError):
    """A record that is not kept; ``used`` fields after the item's name belong to it."""

    def __init__(self, reason: str, used: int = 1) -> None:
        super().__init__(reason)
        self.used = used


def is_unavailable(text: str) -> bool:
    """Whether a value is the word UNAVAILABLE."""
    return len(text) == 11 and text.upper() == "UNAVAILABLE"


def scalar(text: str, key: str | None = None, said: dict[str, object] | None = None) -> Value:
    """A number where ``text`` is one, nothing where it is UNAVAILABLE, else text."""
    if is_unavailable(text):
        return Value(key=key, said=said or {})
    number = number_of(text)
    return Value(number, None if number is not None else text, key, said or {})


def anything(rest: list[str], *, alone: bool) -> Form:
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
    if "." in value and len(parts := value.split(None, 3)) == 3:
        numbers = [number_of(v) for v in parts]
        if None not in numbers:
            values = [Value(n, key=k) for n, k in zip(numbers, "XYZ", strict=True)]
            return Form("UNKNOWN", values, 1)
    return Form("UNKNOWN", [scalar(value)], 1)


def sample(plan: Plan, rest: list[str]) -> Form:
    """``value`` or ``value:RESET``, a number."""
    text = rest[0]
    said: dict[str, object] = {}
    if is_unavailable(text):
        return Form(plan.kind, [Value()], 1)
    number = number_of(text)
    if number is None and ":" in text:
        text, _, trigger = text.partition(":")
        number, said = number_of(text), {"resetTriggered": trigger}
    if number is None:
        raise RefusedError(f"sample {plan.name!r} is {rest[0][:40]!r}, which is no number")
    return Form(plan.kind, [Value(_in_units(number, plan), said=said)], 1)


def _in_units(number: float, plan: Plan) -> float:
    if plan.factor == 1.0 and plan.offset == 0.0:
        return number
    return number * plan.factor + plan.offset


def event(plan: Plan, rest: list[str]) -> Form:
    """``value``, a number where it is one."""
    return Form(plan.kind, [scalar(rest[0])], 1)


def word(plan: Plan, rest: list[str]) -> Form:
    """``value``, a name even where it looks like a number."""
    return Form(plan.kind, [Value() if is_unavailable(rest[0]) else Value(text=rest[0])], 1)


def condition(_: Plan, rest: list[str]) -> Form:
    """``level|code|severity|qualifier|text``, and ``code:id`` from version 2.3 on."""
    level, code, severity, qualifier, text = (rest + [""] * 4)[:5]
    used = min(5, len(rest))
    level = level.upper()
    if level not in LEVELS:
        raise RefusedError(
            f"level {level[:40]!r} of a condition is none of {', '.join(LEVELS)}", used
        )
    code, _colon, condition_id = code.partition(":")
    said: dict[str, object] = {"severity": severity, "qualifier": qualifier, "message": text}
    if condition_id:
        said["nativeCode"] = code
    value = None if level == "UNAVAILABLE" else level
    return Form("CONDITION", [Value(text=value, key=condition_id or code or None, said=said)], used)


def message(_: Plan, rest: list[str]) -> Form:
    """``code|text``."""
    code, text = rest if len(rest) == 2 else (rest + [""])[:2]
    if is_unavailable(text) or (not text and is_unavailable(code)):
        return Form("MESSAGE", [Value()], min(2, len(rest)))
    return Form("MESSAGE", [Value(text=text, key=code or None)], min(2, len(rest)))


def alarm(plan: Plan, rest: list[str]) -> Form:
    """``code|native code|severity|state|text``, of version 1.0."""
    code, native, severity, state, text = (rest + [""] * 4)[:5]
    used = min(5, len(rest))
    if is_unavailable(code) or is_unavailable(text):
        return Form(plan.kind, [Value()], used)
    said: dict[str, object] = {"code": code, "severity": severity, "state": state}
    return Form(plan.kind, [Value(text=text, key=native or None, said=said)], used)


def asset_event(plan: Plan, rest: list[str]) -> Form:
    """``asset type|asset id``, or the id alone."""
    if len(rest) == 1 or is_unavailable(rest[0]):
        return word(plan, rest)
    value = Value(text=None if is_unavailable(rest[1]) else rest[1], said={"assetType": rest[0]})
    return Form(plan.kind, [value], 2)


def series(plan: Plan, rest: list[str]) -> Form:
    """``count|rate|values``; the key is the place in the series, from 1.

    The time of the record is that of the last value (MTConnect part 3, TimeSeries).
    """
    used = min(3, len(rest))
    if is_unavailable(rest[used - 1]):
        return Form("TIME_SERIES", [Value()], used)
    if used < 3:
        raise RefusedError(f"time series {plan.name!r} has no count, rate and values", used)
    numbers = [number_of(v) for v in rest[2].split()]
    if not numbers or number_of(rest[0]) != len(numbers) or None in numbers:
        what = f"a time series of {rest[0][:20]!r} values has {len(numbers)}"
        raise RefusedError(what if None not in numbers else f"{what}, not all numbers", used)
    rate = number_of(rest[1])
    said: dict[str, object] = {"sampleCount": len(numbers), "sampleRate": rate}
    step = 1e9 / (rate or plan.rate) if (rate or plan.rate) > 1e-9 else 0.0
    last = len(numbers) - 1
    values = [
        Value(_in_units(n, plan), key=str(i + 1), said=said, before=round((last - i) * step))
        for i, n in enumerate(numbers)
        if n is not None
    ]
    return Form("TIME_SERIES", values, used)


def position(plan: Plan, rest: list[str]) -> Form:
    """Three numbers; the keys are X, Y and Z."""
    if is_unavailable(rest[0]):
        return Form(plan.kind, [Value()], 1)
    numbers = [number_of(v) for v in rest[0].split(None, 3)]
    if len(numbers) != 3 or None in numbers:
        raise RefusedError(f"{plan.name!r} is {rest[0][:40]!r}, which is not three numbers")
    values = [
        Value(_in_units(n, plan), key=k)
        for n, k in zip(numbers, "XYZ", strict=True)
        if n is not None
    ]
    return Form(plan.kind, values, 1)


def data_set(plan: Plan, rest: list[str]) -> Form:
    """``key=value key={a b} removed`` or ``:RESET key=value``; a table's entries hold such too."""
    text = rest[0]
    if is_unavailable(text):
        return Form(plan.kind, [Value()], 1)
    said: dict[str, object] = {}
    if text.startswith(":"):
        trigger, _, text = text[1:].partition(" ")
        said = {"resetTriggered": trigger.upper()}
    try:
        values = _entries(text, said, table=plan.kind == "TABLE")
    except ValueError as error:
        raise RefusedError(f"{plan.name!r}: {error}") from None
    return Form(plan.kind, values or [Value(said=said)], 1)  # an empty set has nothing


def _entries(text: str, said: dict[str, object], *, table: bool) -> list[Value]:
    values = []
    for key, value in entries_of(text):
        cells = entries_of(value) if table and value and "=" in value else [("", value)]
        for cell, content in cells:
            whole = f"{key}/{cell}" if cell else key
            if content is None:
                values.append(Value(key=whole, said=said | {"removed": True}))
            else:
                values.append(scalar(content, whole, said))
    return values


def unconvertible(plan: Plan, rest: list[str]) -> Form:
    """A sample whose native units cannot become its units."""
    raise RefusedError(f"{plan.name!r} cannot be converted: {plan.why}", 3 if len(rest) == 3 else 1)


def asset(command: str, rest: list[str]) -> Form:
    """``@ASSET@|id|type|document`` and three commands on assets; a removed one is unavailable.

    ``text`` is the type, ``key`` the id, the document or the changes stand in ``attributes``.
    """
    said: dict[str, object] = {"command": command}
    name = rest[0] if rest else ""
    if command == "@REMOVE_ALL_ASSETS@":
        return Form("ASSET", [Value(said=said | {"assetType": name})], min(1, len(rest)))
    if not name:
        raise RefusedError(f"{command[:40]} names no asset", min(1, len(rest)))
    if command == "@REMOVE_ASSET@":
        return Form("ASSET", [Value(key=name, said=said)], 1)
    if command == "@UPDATE_ASSET@" and len(rest) == 2:
        return Form("ASSET", [Value(text="", key=name, said=said | {"xml": rest[1]})], 2)
    if command == "@UPDATE_ASSET@" and len(rest) % 2:
        changes = dict(zip(rest[1::2], rest[2::2], strict=True))
        return Form(
            "ASSET", [Value(text="", key=name, said=said | {"changes": changes})], len(rest)
        )
    if command == "@ASSET@" and len(rest) > 2:
        said = {"xml": "|".join(rest[2:])}
        return Form("ASSET", [Value(text=rest[1], key=name, said=said)], len(rest))
    raise RefusedError(f"{command[:40]!r} with {len(rest)} fields is no command", len(rest))


SHAPES: dict[str, Callable[[Plan, list[str]], Form]] = {
    "sample": sample,
    "event": event,
    "word": word,
    "condition": condition,
    "message": message,
    "alarm": alarm,
    "asset_event": asset_event,
    "series": series,
    "position": position,
    "data_set": data_set,
    "table": data_set,
    "unconvertible": unconvertible,
}
