"""JSON Schema (draft 2020-12) of the files in conf/, made from the dataclasses of their sections.

A schema takes what the composition takes: an interpolation ``${...}`` in the place of any value, a
number for a word, and a number as YAML 1.1 reads it (``1e-3`` is a word there).

The meaning of a field is the text below it, or below the last of the fields that share it, or the
entry of the class docstring's ``Parameters``; the unit that of the declared range, else the first
one in brackets in the meaning, else the one that ends the key's name.
"""

import ast
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from inspect import getdoc, getsource
from math import inf, isfinite
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.fleet import Fleet
from pipeline.schema.ranges import Range
from pipeline.schema.store import unstructured, write_text
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.columns import COLUMNS
from pipeline.stages.sections import section_types
from pipeline.submodels.contract import submodels

Schema = dict[str, Any]

DRAFT = "https://json-schema.org/draft/2020-12/schema"
PLACE = Path("conf/schema")
"""Folder of the schemas, beside those of the files that they check."""
FOR_ALL = ("fleet", "budget", "pages")
"""Sections that stand once for all machines, never in a machine's file."""
INTERPOLATED = r"^\$\{"
"""A value that Hydra takes from elsewhere."""
NUMBER = r"^(\$\{.*|[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?)$"
"""Number, or an interpolation or a word that YAML 1.1 makes of one."""
DEFAULTS: Schema = {
    "description": "Hydra's defaults list: files of conf/ that this one begins from.",
    "type": "array",
    "items": {"type": ["string", "object"]},
}
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


def schema_files() -> dict[str, str]:
    """Name of each schema file -> its text."""
    documents = {
        "machine": machine_schema(),
        "fleet": of_class(Fleet, "A fleet, conf/fleet/*.yaml"),
        "material": of_class(Material, "A work material, conf/material/*.yaml"),
        "tool": of_class(ToolTable, "A tool table, conf/tool/*.yaml"),
    }
    return {
        f"{name}.json": json.dumps(one, indent=1, ensure_ascii=False) + "\n"
        for name, one in documents.items()
    }


def write_schemas(folder: Path = PLACE) -> list[Path]:
    """Write the schema of each kind of file into ``folder``; their paths."""
    paths = []
    for name, text in schema_files().items():
        paths.append(folder / name)
        write_text(text, paths[-1])
    return paths


def first_line(kind: str) -> str:
    """Comment by which an editor checks a file of ``conf/<kind>/``."""
    return f"# yaml-language-server: $schema=../{PLACE.name}/{kind}.json\n"


def machine_sections() -> dict[str, Any]:
    """Type of each section that a machine's file may hold; those of the shop floor are its own."""
    return {
        name: wanted for name, wanted in section_types().items() if name not in (*FOR_ALL, "shop")
    }


def machine_schema() -> Schema:
    """JSON Schema of a machine's file: its sections, each of its type, and no other key."""
    types = machine_sections()
    maker = _Maker(names_of(classes_below(types)))
    sections = {name: maker.value(types[name]) for name in types}
    shop = {"description": "The simulated shop floor's own parameters.", "type": "object"}
    return _document(
        "A machine, conf/machine/*.yaml",
        {"type": "object", "properties": {"defaults": DEFAULTS, **sections, "shop": shop},
         "additionalProperties": False},
        maker.definitions(),
    )  # fmt: skip


def of_class(cls: type, title: str) -> Schema:
    """JSON Schema of a file that is one section."""
    classes = classes_below({"": cls})
    maker = _Maker(names_of(classes))
    definitions = maker.definitions()
    whole = definitions.pop(cls.__name__)
    whole["properties"] = {"defaults": DEFAULTS, **whole["properties"]}
    return _document(title, whole | {"type": "object"}, definitions)


def _document(title: str, whole: Schema, definitions: Schema) -> Schema:
    return {"$schema": DRAFT, "title": title, **whole, "$defs": definitions}


@dataclass(frozen=True)
class _Maker:
    """Makes schemas of types; ``names`` are those of the classes that ``$defs`` holds."""

    names: Mapping[type, str]

    def definitions(self) -> Schema:
        return {name: self.of_dataclass(cls) for cls, name in self.names.items()}

    def of_dataclass(self, cls: type) -> Schema:
        every = settings(cls)
        found: Schema = {"description": summary(cls)} if summary(cls) else {}
        found |= {
            "type": ["object", "string"], "pattern": INTERPOLATED,
            "properties": {one.name: self.of_setting(cls, one) for one in every},
            "additionalProperties": False,
        }  # fmt: skip
        required = [one.name for one in every if one.default is NOTHING]
        return found | ({"required": required} if required else {})

    def of_setting(self, cls: type, one: Setting) -> Schema:
        found = self.value(one.hint, one.allowed)
        if (cls, one.name) == (CleanMachine, "signals"):
            found |= _named_signals()
        if (cls, one.name) == (Fleet, "submodels"):
            found["propertyNames"] = {"enum": [*submodels()]}
        unit = f" [{one.unit}]" if one.unit and f"[{one.unit}]" not in one.meaning else ""
        if one.meaning or unit:
            found["description"] = (one.meaning + unit).strip()
        default = unstructured(one.default) if one.default is not NOTHING else None
        if default is not None and is_finite(default):
            found["default"] = default
        return found

    def value(self, hint: Any, allowed: Range | None = None) -> Schema:
        """Schema of a type; ``allowed`` holds for every number inside."""
        origin, inner = get_origin(hint), get_args(hint)
        if origin is Annotated:
            return self.value(inner[0], allowed)
        if is_dataclass(hint) and isinstance(hint, type):
            return {"$ref": f"#/$defs/{self.names[hint]}"}
        if origin in (Union, UnionType):
            return self._either(members(hint), allowed)
        if origin is Literal:
            return {"anyOf": [{"enum": [*inner]}, {"type": "string", "pattern": INTERPOLATED}]}
        if origin in (tuple, list):
            return self._listed(inner, allowed)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return self._mapping(inner[0], inner[1], allowed)
        return _scalar(hint, allowed)

    def _either(self, inner: tuple[Any, ...], allowed: Range | None) -> Schema:
        given = [one for one in inner if one is not NoneType]
        if str in given and {int, float} & {*given}:
            found: Schema = {"type": ["number", "string"]}
        elif len(given) == 1:
            found = self.value(given[0], allowed)
        else:
            found = {"anyOf": [self.value(one, allowed) for one in given]}
        if len(given) == len(inner):
            return found
        if isinstance(found.get("type"), list):
            return found | {"type": [*found["type"], "null"]}
        return {"anyOf": [*found.get("anyOf", [found]), {"type": "null"}]}

    def _listed(self, inner: tuple[Any, ...], allowed: Range | None) -> Schema:
        found: Schema = {"type": ["array", "string"], "pattern": INTERPOLATED}
        if len(inner) == 1 or inner[-1] is Ellipsis:
            return found | {"items": self.value(inner[0], allowed)}
        each = [self.value(one, allowed) for one in inner]
        return found | {"prefixItems": each, "minItems": len(each), "maxItems": len(each)}

    def _mapping(self, key: Any, inner: Any, allowed: Range | None) -> Schema:
        found: Schema = {"type": ["object", "string"], "pattern": INTERPOLATED}
        if key is int:
            found["propertyNames"] = {"pattern": "^-?[0-9]+$"}
        elif get_origin(key) is Literal:
            found["propertyNames"] = {"enum": [*get_args(key)]}
        return found | {"additionalProperties": self.value(inner, allowed)}


def _scalar(hint: Any, allowed: Range | None) -> Schema:
    if hint is bool:
        return {"type": ["boolean", "string"], "pattern": INTERPOLATED}
    if hint in (int, float):
        form = {"type": ["integer", "string"], "pattern": INTERPOLATED}
        if hint is float:
            form = {"type": ["number", "string"], "pattern": NUMBER}
        return form | _bounds(allowed)
    if hint is Any:
        return {}
    return {"type": ["string", "number"]}


def _bounds(allowed: Range | None) -> Schema:
    if allowed is None:
        return {}
    found = {
        "minimum": allowed.least, "maximum": allowed.most,
        "exclusiveMinimum": allowed.above, "exclusiveMaximum": allowed.below,
    }  # fmt: skip
    return {name: float(value) for name, value in found.items() if abs(value) < inf}


def is_finite(value: Any) -> bool:
    """Whether JSON has every number of a default."""
    if isinstance(value, Mapping):
        return all(map(is_finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(is_finite, value))
    return not isinstance(value, float) or isfinite(value)


def _named_signals() -> Schema:
    words = {
        name: f"{one.meaning} [{one.unit}]" if one.unit else one.meaning
        for name, one in COLUMNS.items()
    }
    return {
        "properties": {
            name: {"type": ["string", "number"], "description": word}
            for name, word in words.items()
        },
        "additionalProperties": False,
    }
