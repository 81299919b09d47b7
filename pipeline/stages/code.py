"""Stage: hash of the code that each stage imports, comments and docstrings aside."""

from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

from pipeline.schema.imports import Module, modules, reached
from pipeline.schema.store import write_json

VERBS = ("identify", "judge")
NO_STAGES = {"__init__", "__main__", "identify", "sections"}
"""Files of the stages' folder that are no stage of their name."""


def code(code: Path) -> None:
    """Write a hash for each stage, of the code that it runs."""
    write_json(fingerprints(Path(__file__).parents[1]), code)


def fingerprints(package: Path) -> dict[str, str]:
    """Stage -> hash of the code that it imports."""
    known = modules(package)
    return {
        stage: _digest(
            f"{name} {known[name].digest} {_beside(package, name)}"
            for name in sorted(reached(known, entries, shown=not stage.startswith(VERBS)))
        )
        for stage, entries in stages(known, package.name).items()
    }


def stages(known: dict[str, Module], package: str) -> dict[str, list[str]]:
    """Stage -> modules that it starts from, one for all sub-models together."""
    rooms = sorted(n.split(".")[2] for n in known if n.count(".") == 3 and n.endswith(".submodel"))
    own = {f"{verb}_{room}": [f"{package}.stages.identify", f"{package}.submodels.{room}.submodel"]
           for room in rooms for verb in VERBS}  # fmt: skip
    every = [f"{package}.submodels.{room}.submodel" for room in rooms]
    for name in known:
        parent, _, stage = name.rpartition(".")
        if parent == f"{package}.stages" and stage not in NO_STAGES:
            own[stage] = [name, *(every if stage in OVER_ALL else ())]
    return own


OVER_ALL = {"champion", "report"}
"""Stages that look sub-models up by name."""


def _beside(package: Path, name: str) -> str:
    """Hash of the files of a module's folder that are no code: templates, tables of texts."""
    folder = package.parent.joinpath(*name.split("."))
    if not folder.is_dir():
        return ""
    others = [
        path for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
        and next(one for one in path.parents if (one / "__init__.py").exists()) == folder
    ]  # fmt: skip
    return _digest(f"{one.name} {sha256(one.read_bytes()).hexdigest()}" for one in others)


def _digest(parts: Iterable[str]) -> str:
    return sha256("\n".join(parts).encode()).hexdigest()[:16]
