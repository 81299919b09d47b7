"""Tool tables, materials and cutting data of commands, by name or as a YAML file."""

from pathlib import Path
from typing import Any, TypeVar

import yaml

from pipeline.app.fleet import CONF
from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.parameters import ParametersError, structure

T = TypeVar("T")


def read_tools(name: str) -> ToolTable:
    """The tool table ``name`` of conf/tool/, or of a YAML file."""
    return _read(name, "tool", "tool table", ToolTable)


def read_catalogue() -> CuttingCatalogue:
    """Cutting data of conf/catalogue/."""
    return _read("default", "catalogue", "catalogue", CuttingCatalogue)


def read_material(name: str) -> Material:
    """The material ``name`` of conf/material/, or of a YAML file."""
    return _read(name, "material", "material", Material)


def _read(name: str, folder: str, what: str, wanted: type[T]) -> T:
    is_file = name.endswith((".yaml", ".yml"))
    path = Path(name) if is_file else CONF / folder / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in (CONF / folder).glob("*.yaml"))) or "none"
        absent = f"{path} does not exist" if is_file else f"{name} is no {what} of conf/{folder}/"
        raise ValueError(
            f"{absent}: name one of conf/{folder}/, which has {known}, or a .yaml file"
        )
    try:
        text = path.read_text()
        values = yaml.safe_load(text)
        twice = _twice(yaml.compose(text, Loader=yaml.SafeLoader))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise ValueError(
            f"{path} is no {what}: its entries lie too deep in each other, write a flat table"
        ) from error
    if twice is not None:
        raise ValueError(
            f"{path}:{twice.start_mark.line + 1}: {twice.value} is written twice: leave one out"
        )
    return _structured(values, str(path), wanted)


def _twice(node: yaml.Node | None) -> yaml.ScalarNode | None:
    """The first key of a mapping that it has already; YAML would take the last in silence."""
    if not isinstance(node, yaml.MappingNode):
        return None
    seen: set[str] = set()
    for key, value in node.value:
        if isinstance(key, yaml.ScalarNode):
            if key.value in seen:
                return key
            seen.add(key.value)
        if (found := _twice(value)) is not None:
            return found
    return None


def _structured(values: Any, where: str, wanted: type[T]) -> T:
    if values is None:
        raise ValueError(f"{where} is empty: write into it what those of conf/ hold")
    try:
        return structure({"file": values}, "file", wanted)
    except ParametersError as error:
        said = str(error).removeprefix("params.yaml, ").replace("file.", "").replace("$.", "")
        said = said.removesuffix(" @ file")
        raise ParametersError(f"{where}: {said}") from error


def section(sections: dict[str, Any], name: str, wanted: type[T]) -> T | None:
    """The section ``name`` as ``wanted``; None where there is none."""
    return structure(sections, name, wanted) if sections.get(name) else None
