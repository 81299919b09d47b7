"""JSON Schema (draft 2020-12) of the files in conf/, made from the dataclasses of their sections.

A schema takes what the composition takes: an interpolation ``${...}`` in the place of any value, a
number for a word, and a number as YAML 1.1 reads it (``1e-3`` is a word there).
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from math import inf, isfinite
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pipeline.app.settings_fields import (
    NOTHING,
    Setting,
    classes_below,
    members,
    names_of,
    settings,
    summary,
)
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
