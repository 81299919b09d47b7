"""Modules of the package, what each imports, and the libraries that some of them need."""

import ast
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from pipeline.schema import files
from pipeline.schema.files import content_key, keep, kept

SHOWN = {"page", "serve", "example", "curves"}
"""Methods of a sub-model that the report and the registry call, no identification or judgement."""
REMEMBERED = 5000
"""Sources whose contents are kept, before those of other copies of the package are forgotten."""
BY_NAME = "submodels"
"""Room whose modules are imported by name: a stage's entries say which."""


@dataclass(frozen=True)
class Module:
    """A module of the package: hash of its source, and what it imports."""

    digest: str
    """Digest of the syntax tree without docstrings."""
    imports: frozenset[str]
    """Modules and names in them, at its top or inside functions."""
    shown: frozenset[str] = frozenset()
    """Libraries that are imported inside the methods ``SHOWN`` alone."""


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


def libraries(known: dict[str, Module], entries: Iterable[str]) -> set[str]:
    """Top-level names outside of the package that some modules import, directly or not."""
    own = {name.partition(".")[0] for name in known}
    found = {
        one.partition(".")[0]
        for name in reached(known, entries, shown=True) for one in known[name].imports
    }  # fmt: skip
    return found - own - sys.stdlib_module_names


def modules(package: Path) -> dict[str, Module]:
    """Modules of a package by their dotted names, cached by content."""
    before = _remembered()
    found, new = {}, {}
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        key = sha256(source).hexdigest()
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        new[key] = module = before.get(key) or _module(ast.parse(source))
        found[name.removesuffix(".__init__")] = module
    if not new.keys() <= before.keys():
        _remember(new if len(before) > REMEMBERED else {**before, **new})
    return found


def _place() -> str:
    """Name of what is kept: it ages with the code that made it and with the syntax of Python."""
    own = (Path(file).read_text() for file in (__file__, files.__file__))
    return content_key((), sys.version, *own)


def _remembered() -> dict[str, Module]:
    try:
        entries = json.loads(kept("sources", _place()) or "{}")
        return {
            key: Module(digest=digest, imports=frozenset(imports), shown=frozenset(shown))
            for key, (digest, imports, shown) in entries.items()
        }
    except (ValueError, TypeError, AttributeError):  # somebody else's bytes
        return {}


def _remember(entries: dict[str, Module]) -> None:
    texts = {key: (one.digest, sorted(one.imports), sorted(one.shown))
             for key, one in entries.items()}  # fmt: skip
    keep("sources", _place(), json.dumps(texts).encode())


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


def code_hash(source: ast.Module) -> str:
    """Hash of a module's syntax tree, without docstrings and texts below constants.

    >>> plain, explained = ast.parse("x = 1"), ast.parse("x = 1; 'Radius of a circle [m].'")
    >>> code_hash(plain) == code_hash(explained)
    True
    """
    for node in ast.walk(source):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [one for one in node.body if not _is_text(one)]
    return sha256(ast.dump(source).encode()).hexdigest()


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _imports(node: ast.AST, function: str) -> Iterator[tuple[str, str]]:
    """Dotted names that a tree imports, and the method or function of it that does."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from ((alias.name, function) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            yield from ((f"{child.module}.{alias.name}", function) for alias in child.names)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        elif isinstance(child, ast.Try) and any(
            "ImportError" in ast.dump(one) for one in child.handlers
        ):
            continue  # it is done without
        elif isinstance(child, ast.Call) and (prefix := _prefix(child)):
            yield f"{prefix}*", function
        else:
            inner = child.name if isinstance(child, ast.FunctionDef) and not function else function
            yield from _imports(child, inner)


def _prefix(call: ast.Call) -> str:
    """Head of a module's name that ``import_module`` puts together, with its last dot."""
    named = isinstance(call.func, ast.Name) and call.func.id == "import_module"
    if not (named and isinstance(call.args[0], ast.JoinedStr)):
        return ""
    first = call.args[0].values[0]
    prefix = str(first.value) if isinstance(first, ast.Constant) else ""
    return "" if f".{BY_NAME}." in prefix else prefix
