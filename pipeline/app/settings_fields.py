"""Settings of a section, read from its dataclass: meaning, unit, range and default of each field.

The meaning is the text below the field, or below the last of the fields that share it, or the entry
of the class docstring's ``Parameters``; the unit that of the declared range, else the first one in
brackets in the meaning, else the one that ends the key's name.
"""

import ast
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from inspect import getdoc, getsource
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from pipeline.schema.ranges import Range

ENDINGS = ("s", "K", "degC", "mm", "um", "deg", "percent", "Hz", "W", "N")
"""Units that end a key's name."""
NOTHING: Any = MISSING
"""Default of a setting that has to be given."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One key of a section."""

    name: str
    """Key of the setting."""
    hint: Any
    """Hint of its value, with what annotates it."""
    default: Any
    """Value where the key is left out; ``NOTHING`` where it has to be given."""
    meaning: str
    """Meaning, for people."""
    unit: str
    """``""`` where none is known."""
    allowed: Range | None
    """Range of its numbers."""


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """Meaning of a field by a docstring: its words, and the units that they name."""

    words: str = ""
    units: tuple[str, ...] = ()


@cache
def settings(cls: type) -> list[Setting]:
    """Every key of a section, in the order of the dataclass."""
    hints, said = get_type_hints(cls, include_extras=True), meanings(cls)
    shared = units_in(summary(cls))
    found = []
    for one in fields(cls):
        hint, meaning = hints[one.name], said.get(one.name, Meaning())
        allowed = declared_range(hint)
        default = one.default
        if one.default_factory is not MISSING:
            default = one.default_factory()
        found.append(
            Setting(
                name=one.name, hint=hint, default=default, meaning=meaning.words,
                unit=(allowed.unit if allowed else "") or _unit(one.name, meaning, shared),
                allowed=allowed,
            )
        )  # fmt: skip
    return found


def summary(cls: type) -> str:
    """Summary of a class: its docstring up to the first heading, in one line."""
    if (getdoc(cls) or "").startswith(f"{cls.__name__}("):  # what dataclass writes for want of one
        return ""
    text = re.split(r"\n[^\n]+\n-{3,}\n", getdoc(cls) or "")[0]
    return _one_line(text)


def meanings(cls: type) -> dict[str, Meaning]:
    """Field -> what is said of it; fields that share a text share its words."""
    found: dict[str, Meaning] = {}
    for base in reversed(cls.__mro__[:-1]):
        if not is_dataclass(base):
            continue
        for every, text in (*_in_docstring(base), *_below_fields(base)):
            words = _one_line(text)
            for place, name in enumerate(every):
                found[name] = Meaning(words=words, units=_units_of(words, place, len(every)))
    return found


def _in_docstring(cls: type) -> Iterator[tuple[list[str], str]]:
    """Names that share a line of the docstring's ``Parameters``, and its text."""
    head = re.search(r"^Parameters\n-+\n", getdoc(cls) or "", re.MULTILINE)
    if head is None:
        return
    text = re.split(r"\n\n[^\n]+\n-{3,}\n", (getdoc(cls) or "")[head.end() :])[0]
    for entry in re.split(r"\n(?=\S)", text):
        names, _, described = entry.partition("\n")
        yield [one.strip() for one in names.partition(" : ")[0].split(",")], described


def _below_fields(cls: type) -> Iterator[tuple[list[str], str]]:
    """Names of fields one after another, and the text below the last of them."""
    names: list[str] = []
    for node in _classes_of(cls.__module__)[cls.__name__].body:
        if isinstance(node, ast.AnnAssign):
            names.append(ast.unparse(node.target))
        elif names and isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield names, str(node.value.value)
            names = []


@cache
def _classes_of(module: str) -> dict[str, ast.ClassDef]:
    tree = ast.parse(getsource(sys.modules[module]))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _units_of(words: str, place: int, count: int) -> tuple[str, ...]:
    """Units of one of the names that share a line: its own of as many, else the one of them all."""
    every = units_in(words)
    if count > 1 and len(every) == count:
        return (every[place],)
    return tuple(every) if count == 1 or len(every) == 1 else ()


def declared_range(hint: Any) -> Range | None:
    """The first range in a type; it holds for all numbers of the value."""
    if get_origin(hint) is Annotated:
        for extra in hint.__metadata__:
            if isinstance(extra, Range):
                return extra
    inner = get_args(hint)
    return next((found for one in inner if (found := declared_range(one)) is not None), None)


def members(union: Any) -> tuple[Any, ...]:
    """Types of a union, None last, in an order that does not depend on the order of imports."""
    return tuple(sorted(get_args(union), key=lambda one: (one is type(None), repr(one))))


def classes_in(hint: Any) -> Iterator[type]:
    """Dataclasses that a type names, without those inside of them."""
    if is_dataclass(hint) and isinstance(hint, type):
        yield hint
    for one in get_args(hint):
        yield from classes_in(one)


def classes_below(types: Mapping[str, Any]) -> list[type]:
    """Every dataclass that sections are made of, each once, those of a section after it."""
    found: list[type] = []

    def visit(hint: Any) -> None:
        for cls in classes_in(hint):
            if cls not in found:
                found.append(cls)
                for one in settings(cls):
                    visit(one.hint)

    for hint in types.values():
        visit(hint)
    return found


def names_of(classes: list[type]) -> dict[type, str]:
    """Class -> its name, with the module's where two classes have one name."""
    every = [cls.__name__ for cls in classes]
    return {
        cls: cls.__name__
        if every.count(cls.__name__) == 1
        else f"{cls.__module__.removeprefix('pipeline.')}.{cls.__name__}"
        for cls in classes
    }


def _unit(name: str, meaning: Meaning, shared: list[str]) -> str:
    """Unit of a key without a range that says it."""
    if meaning.units:
        return meaning.units[0]
    if not meaning.words and len(shared) == 1:
        return shared[0]
    ending = name.rpartition("_")[2]
    return ending.replace("percent", "%") if ending in ENDINGS and "_" in name else ""


def units_in(text: str) -> list[str]:
    """Units in brackets; neither an index nor an interval of numbers."""
    return [
        one for one in re.findall(r"\[([^\[\]]+)\]", text) if one == "1" or not one[0].isdigit()
    ]


def _one_line(text: str) -> str:
    """Text of reStructuredText in one line; a role names the last part of its target."""
    text = re.sub(r":\w+:`~?(?:\w+\.)*(\w+)`", r"`\1`", text.replace("``", "`"))
    return " ".join(text.split())
