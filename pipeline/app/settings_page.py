"""Reference page of every setting and signal: docs/settings.md."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from math import inf, isfinite
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pipeline.app.json_schema import (
    FOR_ALL,
    NOTHING,
    Setting,
    classes_below,
    classes_in,
    machine_sections,
    members,
    names_of,
    settings,
    summary,
    units_in,
)
from pipeline.parameters import read_yaml
from pipeline.schema.ranges import Range
from pipeline.schema.store import unstructured
from pipeline.signals.columns import COLUMNS, Column
from pipeline.stages.sections import section_types

HEAD = """# Settings and signals

Every key of the files in `conf/`, and every signal that a machine may name. This page is made from
the code, as are the schemas by which an editor completes and checks the files:

```sh
kerf machine schema --page settings.md
```

A key without a default has to be given; where a file of `conf/` gives one value for all machines,
it stands in the place of the default. A key that is not listed is refused. Values may be taken from
elsewhere with `${…}`; a file may begin from others with `defaults:`. The simulated shop floor's own
parameters (`conf/shop/`) are not listed: they describe no machine of yours.
"""
GIVEN = ("clean", "model", "cost", "incidents", "monitoring", "optimisation", "promotion")
"""Groups of conf/ whose values hold for all machines."""
Given = dict[tuple[type, str], list[Any]]
"""Class and key -> the different values that files give for all machines."""
SIGNALS = """## Signals

What `mapping.signals` of a machine may name, and what the clean tables hold, in MTConnect's units.
Values outside of the range are taken for glitches.

| signal | kind | unit | range | meaning |
|---|---|---|---|---|
"""


def page(conf: Path) -> str:
    """The page in Markdown, with the values that ``conf`` gives for all machines."""
    own, every = machine_sections(), section_types()
    types = own | {name: every[name] for name in FOR_ALL}
    classes = classes_below(types)
    names = names_of(classes)
    rows = [
        f"| `{name}` | {_kind(wanted, names)} | {_said_of(wanted)} |"
        for name, wanted in sorted(types.items())
    ]
    sections = "## Sections\n\n| section | holds | what it is |\n|---|---|---|\n" + "\n".join(rows)
    given = given_for_all(conf)
    tables = [
        _table(cls, names, given) for cls in sorted(classes, key=lambda cls: names[cls].lower())
    ]
    signals = SIGNALS + "\n".join(_signal(one) for one in COLUMNS.values())
    return "\n\n".join([HEAD.strip(), sections, signals, "## Keys", *tables]) + "\n"


def _said_of(wanted: Any) -> str:
    return _cell(next((summary(cls) for cls in classes_in(wanted)), ""))


def _table(cls: type, names: Mapping[type, str], given: Given) -> str:
    rows = [
        f"| `{one.name}` | {_kind(one.hint, names)} | {_cell(one.unit)} "
        f"| {_default(one, given.get((cls, one.name), []))} "
        f"| {_words(one.allowed)} | {_cell(_without_unit(one))} |"
        for one in settings(cls)
    ]
    head = "| key | kind | unit | default | range | meaning |\n|---|---|---|---|---|---|\n"
    parts = [f"### {names[cls]}", _cell(summary(cls)), head + "\n".join(rows)]
    return "\n\n".join(part for part in parts if part)


def _without_unit(one: Setting) -> str:
    """The meaning without its one unit, which has a column of its own."""
    if units_in(one.meaning) != [one.unit]:
        return one.meaning
    rest = re.sub(r" ?\[" + re.escape(one.unit) + r"\]", "", one.meaning).lstrip(";,. ")
    return rest[:1].upper() + rest[1:]


def given_for_all(conf: Path) -> Given:
    """Values that the files of ``conf`` give for all machines, by class and key."""
    values: dict[str, Any] = {}
    for path in sorted(path for group in GIVEN for path in (conf / group).glob("*.yaml")):
        found = read_yaml(path.read_text(encoding="utf-8"), str(path))
        group = path.parent.name
        values |= {group: found} if group in section_types() else found
    given: Given = {}
    for name, value in values.items():
        _note(section_types()[name], value, given)
    return given


def _note(hint: Any, value: Any, given: Given) -> None:
    for cls in classes_in(hint):
        if is_dataclass(hint) and isinstance(value, dict):
            for one in settings(cls):
                if one.name in value:
                    some = given.setdefault((cls, one.name), [])
                    some += [value[one.name]] if value[one.name] not in some else []
                    _note(one.hint, value[one.name], given)


def _kind(hint: Any, names: Mapping[type, str]) -> str:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _kind(inner[0], names)
    if origin in (Union, UnionType):
        return " or ".join(_kind(one, names) for one in members(hint))
    if origin is Literal:
        return ", ".join(f"`{one}`" if one != "" else "nothing" for one in inner)
    if origin in (tuple, list):
        if len(inner) == 1 or inner[-1] is Ellipsis:
            return f"list of {_kind(inner[0], names)}"
        return f"list: {', '.join(_kind(one, names) for one in inner)}"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"{_kind(inner[0], names)} → {_kind(inner[1], names)}"
    if hint in names:
        return f"[{names[hint]}](#{_anchor(names[hint])})"
    words = {bool: "true or false", int: "whole number", float: "number", NoneType: "null"}
    return words.get(hint, "word")


def _anchor(name: str) -> str:
    """Anchor of a heading in the site's table of contents."""
    return re.sub(r"[^\w\s-]", "", name).strip().lower()


def _default(one: Setting, given: list[Any]) -> str:
    if len(given) == 1 and not isinstance(given[0], dict):
        return f"`{_yaml(given[0])}`"
    if one.default is NOTHING:
        return "by section" if given and not isinstance(given[0], dict) else "to be given"
    if one.default is None or one.default in ("", (), {}):
        return "none"
    if isinstance(one.default, float) and not isfinite(one.default):
        return "infinite"
    return f"`{_yaml(unstructured(one.default))}`"


def _yaml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_yaml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, Iterable) and not isinstance(value, str):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    words = {True: "true", False: "false"} if isinstance(value, bool) else {None: "null"}
    return words.get(value, str(value))


def _words(allowed: Range | None) -> str:
    words = "" if allowed is None else allowed.words
    return re.sub(r"^must (be|lie) (finite and |finite$|a number$)?", "", words)


def _signal(one: Column) -> str:
    kind = "word" if one.text else "number"
    low, high = (
        f"{one.low:g}" if one.low > -inf else "",
        f"{one.high:g}" if one.high < inf else "",
    )
    span = f"{low} to {high}" if low and high else f"at least {low}" if low else ""
    unit = one.unit or ("" if one.text else "1")
    return f"| `{one.name}` | {kind} | {unit} | {span} | {_cell(one.meaning)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("[", "\\[").replace("]", "\\]") if text else ""
