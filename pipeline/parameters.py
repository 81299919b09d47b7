"""The only file that opens params.yaml: one section, typed, unknown keys refused.

What a value is not is never made of it: no word becomes a truth value or a list of letters, no
fraction a whole number.
"""

from pathlib import Path
from typing import Any, TypeVar

import yaml

from pipeline.schema.structure import structured

T = TypeVar("T")

PARAMS = Path("params.yaml")
NotYaml = yaml.YAMLError
"""What reading YAML raises."""


class ParametersError(ValueError):
    """A section of params.yaml that is missing or not what its stage asks for."""


def read_params(path: Path = PARAMS) -> dict[str, Any]:
    """All of params.yaml.

    Raises
    ------
    ParametersError
        When the file is missing or is no YAML mapping.
    """
    if not path.exists():
        raise ParametersError(
            f"{path} does not exist: run `dvc repro compose` to write it from conf/"
        )
    return read_yaml(path.read_text(), str(path))


def read_yaml(text: str, source: str = "params.yaml") -> dict[str, Any]:
    """A mapping in YAML, such as params.yaml of another commit.

    Raises
    ------
    ParametersError
        When it is none; the message names its ``source``.
    """
    try:
        values = yaml.load(text, Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        raise ParametersError(f"{source} is no YAML: {error}") from error
    if not isinstance(values, dict):
        raise ParametersError(f"{source} holds {type(values).__name__}, a mapping is needed")
    return values


def as_yaml(values: dict[str, Any]) -> str:
    """A mapping in YAML, its keys in their order."""
    return str(yaml.dump(values, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True))


def section_path(values: dict[str, Any], name: str, item: str | None) -> str:
    """Key path of the section ``name``: ``machine.<item>.<name>`` where the machine has one.

    Raises
    ------
    ParametersError
        When there is no machine called ``item``.
    """
    machines = values.get("machine") or {}
    if item and item not in machines:
        raise ParametersError(
            f"params.yaml has no section machine.{item}, known machines are {sorted(machines)}: "
            "name it in conf/fleet/ and run `dvc repro compose`"
        )
    machine = (machines[item] or {}) if item else {}
    return f"machine.{item}.{name}" if name in machine else name


def structure(values: dict[str, Any], path: str, wanted: type[T]) -> T:
    """The section at the key path ``path`` as ``wanted``.

    Raises
    ------
    ParametersError
        When the section is missing, has unknown or missing keys or values out of range; the
        message names the keys with their paths.
    """
    found: Any = values
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            raise ParametersError(
                f"params.yaml has no section {path}: add it in conf/ and run `dvc repro compose`"
            )
        found = found[key]
    try:
        return structured(found, wanted, path)
    except ValueError as error:
        raise ParametersError(f"params.yaml, {error}") from error


def as_section(name: str, path: Path) -> str:
    """A YAML file as the section ``name`` of parameters, in YAML; empty where there is no file.

    Raises
    ------
    ValueError
        When it is broken.
    """
    if not path.exists():
        return ""
    try:
        values = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        raise ValueError(f"{path} does not compose: {' '.join(str(error).split())}") from error
    return str(yaml.dump({name: values}, Dumper=yaml.CSafeDumper, sort_keys=False))
