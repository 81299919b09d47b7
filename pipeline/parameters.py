"""Parameters: sections of params.yaml and data/settings, typed, unknown keys refused.

Machines and workshops stand as JSON beside params.yaml, since DVC reads a stage's parameters anew
for each stage and YAML takes fifty times as long.  A stage of a machine depends on its sections by
their hashes: DVC writes into dvc.lock all that a stage depends on, after each stage.
"""

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import yaml

from pipeline.schema.store import structured

T = TypeVar("T")

PARAMS = Path("params.yaml")
SETTINGS = Path("data/settings")
"""Folder of the composed settings that are not in params.yaml, beside it."""
CATALOGUE, MACHINES, HASHES = "catalogue.json", "machine", "sections"
"""Files of ``data/settings``: sections of :data:`CATALOGUES`, folder with a file for each machine,
and hashes of its sections."""
CATALOGUES = ("material", "tool", "catalogue")
"""Sections with what a workshop has in stock and what its handbooks say."""
RENAMED = {
    "compensation": "following_residual",
    "compensation_records": "following_residual_records",
    "compensation_fit": "following_residual_fit",
    "compensation_limits": "following_residual_limits",
    "correction": "command_correction",
    "compensated": "with_residual",
    "sought": "identified",
}
"""Sub-models, sections and keys by the names that they had."""
NotYaml = yaml.YAMLError
"""Error of reading YAML."""


class ParametersError(ValueError):
    """Section of params.yaml that is missing or does not fit its stage."""


def read_params(path: Path = PARAMS, settings: Path | None = None) -> dict[str, Any]:
    """All of params.yaml, with the catalogues and the sections ``machine`` beside it.

    ``settings``: folder of the rest; None for ``data/settings`` beside ``path``.  Raises
    ParametersError when a file is missing or holds no mapping.
    """
    if not path.exists():
        raise ParametersError(
            f"{path} does not exist: run `dvc repro compose` to write it from conf/"
        )
    folder = path.parent / SETTINGS if settings is None else settings
    return joined(read_yaml(path.read_text(), str(path)), settings_texts(folder))


def settings_texts(folder: Path) -> dict[str, str]:
    """Texts of the files of ``data/settings`` that hold values, by their names in it."""
    files = [folder / CATALOGUE, *(folder / MACHINES).glob("*.json")]
    return {one.relative_to(folder).as_posix(): one.read_text() for one in files if one.exists()}


def joined(values: dict[str, Any], files: Mapping[str, str]) -> dict[str, Any]:
    """The sections of params.yaml with those of the files of ``data/settings``, by their names.

    Raises ParametersError when a file is no JSON mapping, or a section stands in two places.
    """
    own = set(values)
    for name, text in sorted(files.items()):
        try:
            found = json.loads(text, object_pairs_hook=_keyed)
        except ValueError as error:
            raise ParametersError(f"{SETTINGS / name} is no JSON: {error}") from error
        if not isinstance(found, dict):
            raise ParametersError(
                f"{SETTINGS / name} holds {type(found).__name__}, a mapping is needed"
            )
        sections = found if name == CATALOGUE else {"machine": {Path(name).stem: found}}
        for section, content in sections.items():
            if section in own:
                raise ParametersError(
                    f"params.yaml holds {section}, which stands in {SETTINGS / name}: set it "
                    f"there, `-S {SETTINGS / name}:KEY=VALUE`"
                )
            values.setdefault(section, {}).update(content)
    return values


def _keyed(pairs: list[tuple[str, Any]]) -> dict[str | int, Any]:
    """A mapping of JSON with numbers as keys where YAML has them: tools by their number."""
    return {int(key) if key.isdecimal() else key: value for key, value in pairs}


def parted(values: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Sections of a composition for params.yaml, and the files of ``data/settings``."""
    own = {name: one for name, one in values.items() if name not in (*CATALOGUES, "machine")}
    machines = values.get("machine", {})
    parts = {f"{MACHINES}/{name}.json": one for name, one in machines.items()}
    parts |= {
        f"{HASHES}/{name}.json": {section: _hash(content) for section, content in sections.items()}
        for name, one in machines.items()
        for sections in [own | one]
    }
    parts[CATALOGUE] = {name: values[name] for name in CATALOGUES if name in values}
    return own, {name: json.dumps(one, indent=1) + "\n" for name, one in parts.items()}


def _hash(content: Any) -> str:
    return sha256(json.dumps(content).encode()).hexdigest()[:16]


def read_yaml(text: str, source: str = "params.yaml") -> dict[str, Any]:
    """A mapping in YAML, such as params.yaml of another commit.

    Raises ParametersError when it is none; the message names its ``source``.
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

    Raises ParametersError when there is no machine called ``item``.
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

    Raises ParametersError when the section is missing, has unknown or missing keys or values out of
    range; the message names the keys with their paths.
    """
    found: Any = values
    for key in path.split("."):
        if not isinstance(found, dict) or key not in found:
            there = found if isinstance(found, dict) else {}
            was = [one for one, now in RENAMED.items() if now == key and one in there]
            mend = f"it was called {was[0]}, rename it" if was else "add it"
            raise ParametersError(
                f"params.yaml has no section {path}: {mend} in conf/ and run `dvc repro compose`"
            )
        found = found[key]
    try:
        return structured(found, wanted, path)
    except ValueError as error:
        renamed = [f"{path}.{was} is called {now} now: rename it in conf/"
                   for was, now in RENAMED.items() if f"({was})" in str(error)]  # fmt: skip
        raise ParametersError(f"params.yaml, {'; '.join(renamed) or error}") from error


def as_section(name: str, path: Path) -> str:
    """A YAML file as the section ``name`` of parameters, in YAML; empty where there is no file.

    Raises ValueError when it is broken.
    """
    if not path.exists():
        return ""
    try:
        values = yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        raise ValueError(f"{path} does not compose: {' '.join(str(error).split())}") from error
    return str(yaml.dump({name: values}, Dumper=yaml.CSafeDumper, sort_keys=False))
