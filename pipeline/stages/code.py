"""Stage: by what hash the code of each stage is known, comments and docstrings aside.

A stage depends on its entry here: on the source of each module that it imports, directly or not,
and on the templates and tables beside these, so that a text changes no result and no fit.
"""

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from pipeline.schema.cache import code_hash
from pipeline.schema.store import write_json

VERBS = ("identify", "judge")
NO_STAGES = {"__init__", "__main__", "_line", "identify", "sections"}
"""Files of the stages' folder that are no stage of their name."""
SHOWN = {"page", "serve", "example", "curves"}
"""Methods of a sub-model that the report and the registry call, no identification or judgement."""
BY_NAME = "submodels"
"""Room whose modules are imported by name: a stage's entries say which."""


@dataclass(frozen=True)
class Module:
    """A module of the package: hash of its source, and what it imports.

    Parameters
    ----------
    digest : str
        Of the syntax tree without docstrings.
    imports : frozenset of str
        Modules and names in them, at its top or inside functions.
    shown : frozenset of str
        Those of them that are imported inside the methods ``SHOWN`` alone.
    """

    digest: str
    imports: frozenset[str]
    shown: frozenset[str] = frozenset()


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
    """Stage -> modules that it starts from.

    ``identify_<sub-model>`` and ``judge_<sub-model>`` share theirs; what goes over all sub-models
    starts from each of them.
    """
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


def reached(known: dict[str, Module], entries: Iterable[str], *, shown: bool) -> set[str]:
    """Modules that some import, directly or not, with the packages that they stand in."""
    found: set[str] = set()
    todo = list(entries)
    while todo:
        name = todo.pop()
        if name.endswith(".*"):
            todo += [one for one in known if one.startswith(name[:-1])]
            continue
        while name and name not in known:  # a name inside a module
            name = name.rpartition(".")[0]
        if not name or name in found:
            continue
        found.add(name)
        module = known[name]
        todo += [*(module.imports if shown else module.imports - module.shown)]
        todo.append(name.rpartition(".")[0])
    return found


def modules(package: Path) -> dict[str, Module]:
    """Every module of a package by its dotted name."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = _module(ast.parse(path.read_bytes()))
    return found


def _module(tree: ast.Module) -> Module:
    elsewhere: set[str] = set()
    inside: set[str] = set()
    for imported, function in _imports(tree, ""):
        (inside if function in SHOWN else elsewhere).add(imported)
    return Module(
        digest=code_hash(tree),
        imports=frozenset(elsewhere | inside),
        shown=frozenset(inside - elsewhere),
    )


def _imports(node: ast.AST, function: str) -> Iterator[tuple[str, str]]:
    """Dotted names that a tree imports, and the method or function of it that does."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from ((alias.name, function) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            yield from ((f"{child.module}.{alias.name}", function) for alias in child.names)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        elif isinstance(child, ast.Call) and (prefix := _prefix(child)):
            yield f"{prefix}*", function
        else:
            inner = child.name if isinstance(child, ast.FunctionDef) and not function else function
            yield from _imports(child, inner)


def _prefix(call: ast.Call) -> str:
    """What a module's name begins with that ``import_module`` puts together, with its last dot."""
    named = isinstance(call.func, ast.Name) and call.func.id == "import_module"
    if not (named and isinstance(call.args[0], ast.JoinedStr)):
        return ""
    first = call.args[0].values[0]
    prefix = str(first.value) if isinstance(first, ast.Constant) else ""
    return "" if f".{BY_NAME}." in prefix else prefix


def _beside(package: Path, name: str) -> str:
    """Hash of the files of a module's folder that are no code: templates, tables of texts."""
    folder = package.parent.joinpath(*name.split("."))
    if not folder.is_dir():
        return ""
    others = [
        path for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts
        and not (path.parent != folder and (path.parent / "__init__.py").exists())
    ]  # fmt: skip
    return _digest(f"{one.name} {sha256(one.read_bytes()).hexdigest()}" for one in others)


def _digest(parts: Iterable[str]) -> str:
    return sha256("\n".join(parts).encode()).hexdigest()[:16]
