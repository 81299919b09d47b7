"""Stage: hash of the code that each stage imports, comments and docstrings aside."""

from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

from pipeline.schema.imports import Module, modules, reached
from pipeline.schema.store import write_json

VERBS = ("identify", "judge")
NO_STAGES = {"__init__", "__main__", "identify", "inputs", "sections"}
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
    every = [f"{package}.submodels.{room}.{one}" for room in rooms for one in ("submodel", "page")]
    for name in known:
        parent, _, stage = name.rpartition(".")
        if parent == f"{package}.stages" and stage not in NO_STAGES:
            own[stage] = [name, *(every if stage in OVER_ALL else ())]
    return own


OVER_ALL = {"champion", "nightly", "report", "state"}
"""Stages that look sub-models up by name."""


def _beside(package: Path, name: str) -> str:
    """Hash of a module's files that are no code: texts of its name, or what lies in its folder."""
    module = package.parent.joinpath(*name.split("."))
    others = [
        path for path in sorted(module.rglob("*") if module.is_dir() else module.parent.glob("*.*"))
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
        and _owner(path) == module
    ]  # fmt: skip
    return _digest(f"{one.name} {sha256(one.read_bytes()).hexdigest()}" for one in others)


def _owner(path: Path) -> Path:
    """Module that a file belongs to: that of its name beside it, else the package it lies in."""
    if path.with_suffix(".py").exists():
        return path.with_suffix("")
    return next(folder for folder in path.parents if (folder / "__init__.py").exists())


def _digest(parts: Iterable[str]) -> str:
    return sha256("\n".join(parts).encode()).hexdigest()[:16]
