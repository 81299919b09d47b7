"""The allowed arrows between rooms, and who may import which library."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pipeline"

BELOW = {"schema", "kernels"}
"""Rooms that every room may import."""
ARROWS: dict[str, set[str]] = {
    "schema": set(),
    "kernels": set(),
    "cutting": {"kernels"},
    "gcode": {"kernels"},
    "machine": {"gcode.moves", "kernels"},
    "search": {"kernels"},
    "signals": {"kernels"},
    "thermal": set(),
    "shop": {"gcode"},
    "fleet": set(),
    "parameters": set(),
    "twin": {"signals", "thermal", "cutting", "gcode", "machine", "kernels"},
    "identification": {
        "submodels",
        "signals",
        "thermal",
        "twin",
        "cutting",
        "gcode",
        "machine",
        "search",
        "kernels",
    },
    "optimisation": {"twin", "gcode", "machine", "cutting", "search", "kernels"},
    "validation": {"signals", "twin", "identification", "submodels", "cutting", "gcode", "machine"},
    "charts": set(),
    "submodels": {"twin", "signals", "thermal", "machine", "cutting", "gcode", "search", "charts"},
    "report": {"signals.columns", "fleet", "charts", "submodels"},
    "serving": {"twin"},
    "registry": set(),
    "stages": {"*"},
    "commands": {"*"},
    "cli": {"commands", "registry"},
}
"""Room -> rooms it may import from; ``*`` for those that stand on top."""

ONLY: dict[str, set[str]] = {
    "mlflow": {"registry", "serving"},
    "hydra": {"stages"},
    "omegaconf": {"stages"},
    "yaml": {"parameters", "commands"},
    "pint": {"signals/units.py"},
    "torch": {"nets"},
    "typer": {"cli"},
}
"""Library -> the rooms (or the one file) that may import it."""


def modules() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path: Path) -> list[str]:
    """Dotted names that a file imports, at its top or inside a function."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively: name the room"
            names.append(node.module or "")
    return names


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_rooms_import_along_the_arrows(path: Path) -> None:
    here = room(path)
    assert here in ARROWS, f"{here} has no arrows in this table: say what it may import"
    for name in imported(path):
        if not name.startswith("pipeline."):
            continue
        target = name.removeprefix("pipeline.")
        allowed = ARROWS[here] | {here} | BELOW
        assert "*" in allowed or any(target == a or target.startswith(a + ".") for a in allowed), (
            f"{here} may not import {name}"
        )


@pytest.mark.parametrize("path", modules(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_libraries_stay_in_their_room(path: Path) -> None:
    file = path.relative_to(PACKAGE).as_posix()
    for name in imported(path):
        library = name.partition(".")[0]
        if library in ONLY:
            assert room(path) in ONLY[library] or file in ONLY[library], (
                f"{file} may not import {library}"
            )


def test_there_is_no_cycle_between_rooms() -> None:
    edges: dict[str, set[str]] = {}
    for path in modules():
        for name in imported(path):
            if name.startswith("pipeline.") and room(path) not in ("stages", "commands", "cli"):
                edges.setdefault(room(path), set()).add(name.split(".")[1])
    done: set[str] = set()

    def visit(here: str, way: tuple[str, ...]) -> None:
        assert here not in way, f"cycle: {' -> '.join((*way, here))}"
        for there in edges.get(here, set()) - {here} - done:
            visit(there, (*way, here))
        done.add(here)

    for here in list(edges):
        visit(here, ())


def test_rooms_have_names_of_the_field() -> None:
    for path in PACKAGE.rglob("*"):
        assert path.stem not in {"util", "utils", "common", "core", "base", "helpers", "manager"}
