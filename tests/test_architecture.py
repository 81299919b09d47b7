"""The allowed arrows between rooms, faces, circles, and who may import which library."""

import ast
import gc
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pipeline"

BELOW = {"schema", "kernels", "parallel"}
"""Rooms that every room may import."""
ARROWS: dict[str, set[str]] = {
    "schema": set(),
    "kernels": set(),
    "parallel": set(),
    "parameters": set(),
    "charts": set(),
    "cutting": set(),
    "gcode": set(),
    "search": set(),
    "signals": set(),
    "thermal": set(),
    "machine": {"gcode.moves"},
    "nets": {"search"},
    "shop": {"gcode"},
    "twin": {"signals", "thermal", "cutting", "gcode", "machine"},
    "submodels": {
        "twin", "signals", "thermal", "machine", "cutting", "gcode", "nets", "search", "charts",
        "parameters",
    },
    "optimisation": {"twin", "gcode", "machine", "cutting", "search"},
    "fleet": {"submodels.contract"},
    "report": {
        "charts", "fleet", "signals.columns", "submodels.cases", "submodels.contract",
        "submodels.judge", "submodels.siblings",
    },
    "monitoring": {"submodels", "signals", "cutting", "parameters"},
    "serving": set(),
    "registry": {"charts", "submodels.contract", "submodels.judge"},
    "champions": {"registry", "submodels", "fleet", "parameters"},
    "stages": {"*"},
    "app": {"*"},
}  # fmt: skip
"""Room -> rooms, or modules of them, that it may import from; ``*`` for those that stand on top."""

ONLY: dict[str, set[str]] = {
    "mlflow": {"registry", "serving"},
    "hydra": {"stages"},
    "omegaconf": {"stages"},
    "yaml": {"parameters", "app"},
    "joblib": {"parallel"},
    "distributed": {"parallel"},
    "dvc": {"app"},
    "pint": {"signals/units.py"},
    "torch": {"nets"},
    "typer": {"app"},
    "cattrs": {"schema"},
    "river": {"monitoring"},
}
"""Library -> the rooms (or the one file) that may import it."""

LONGEST = 7
"""Files on the longest path of imports inside a room."""
MOST_POSITIONAL = 6
"""Positional arguments of a function that is not compiled; a stage has one a path."""
SHARED_WITH_KERNELS = {"pipeline.gcode.geometry"}
"""Modules whose functions of numbers run compiled and not: they take plain numbers by place."""
SMALL, SMALL_SHARE = 60, 0.05
"""Lines of a small file, and the share of the files that may be small with a single importer."""


def modules() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def parsed(path: Path) -> ast.Module:
    """Its tree; the collector, which would walk all trees before it again and again, waits."""
    gc.disable()
    try:
        return ast.parse(path.read_text())
    finally:
        gc.freeze()
        gc.enable()


def statements(node: ast.AST) -> Iterator[ast.stmt | ast.excepthandler | ast.match_case]:
    """Statements inside of ``node`` at any depth, without what stands in them: a tenth of it."""
    for field in ("body", "orelse", "handlers", "finalbody", "cases"):
        inner = getattr(node, field, ())
        for one in inner if isinstance(inner, list) else ():
            yield one
            yield from statements(one)


@cache
def imported(path: Path, *, at_top: bool = False) -> list[str]:
    """Dotted names that a file imports, at its top alone or inside functions too."""
    names = []
    tree = parsed(path)
    for node in tree.body if at_top else statements(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively: name the room"
            names.append(node.module or "")
            if (ROOT / (node.module or "").replace(".", "/")).is_dir():  # a module of a folder
                names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def edges(*, at_top: bool = False) -> dict[str, set[str]]:
    """Module -> modules of ours that it imports, at its top or inside a function too."""
    known = {dotted(path) for path in modules()}
    return {
        dotted(p): {n for n in imported(p, at_top=at_top) if n in known} - {dotted(p)}
        for p in modules()
    }


def test_rooms_import_along_the_arrows() -> None:
    rooms = {room(path) for path in modules()}
    assert rooms <= set(ARROWS), f"no arrows in this table: {rooms - set(ARROWS)}"
    forbidden = []
    for path in modules():
        allowed = ARROWS[room(path)] | {room(path)} | BELOW
        for name in imported(path):
            if not name.startswith("pipeline."):
                continue
            target = name.removeprefix("pipeline.")
            inside = any(target == a or target.startswith(a + ".") for a in allowed)
            leads_there = any(a.startswith(target + ".") for a in allowed)  # its name is beside it
            if not ("*" in allowed or inside or leads_there):
                forbidden.append(f"{path.relative_to(PACKAGE)} may not import {name}")
    assert not forbidden


def test_libraries_stay_in_their_room() -> None:
    forbidden = []
    for path in modules():
        file = path.relative_to(PACKAGE).as_posix()
        for library in {name.partition(".")[0] for name in imported(path)} & set(ONLY):
            if not {room(path), file} & ONLY[library]:
                forbidden.append(f"{file} may not import {library}")
    assert not forbidden


def test_no_sub_model_imports_another() -> None:
    for path in (PACKAGE / "submodels").glob("*/**/*.py"):
        own = path.relative_to(PACKAGE / "submodels").parts[0]
        for name in imported(path):
            parts = name.split(".")
            inside = parts[:2] == ["pipeline", "submodels"] and len(parts) > 2
            other = inside and (PACKAGE / "submodels" / parts[2]).is_dir() and parts[2] != own
            assert not other, f"{path} imports {name}: what both need lies below them"


def test_there_is_no_circle_of_files() -> None:
    done: set[str] = set()

    def visit(here: str, path: tuple[str, ...]) -> None:
        assert here not in path, f"circle: {' -> '.join((*path[path.index(here) :], here))}"
        if here in done:
            return
        for there in edges()[here]:
            visit(there, (*path, here))
        done.add(here)

    for here in edges():
        visit(here, ())


def test_an_import_is_followed_over_few_files_of_a_room() -> None:
    def place(name: str) -> list[str]:
        """The room; a sub-model is one of its own."""
        parts = name.split(".")[1:]
        return parts[: 2 if parts[0] == "submodels" and len(parts) > 2 else 1]

    @cache
    def depth(here: str) -> int:
        own = [there for there in edges(at_top=True)[here] if place(there) == place(here)]
        return 1 + max((depth(there) for there in own), default=0)

    deep = {name: depth(name) for name in edges() if depth(name) > LONGEST}
    assert not deep, f"longer than {LONGEST} files: {deep}"


def test_few_small_files_have_a_single_importer() -> None:
    importers = Counter(there for some in edges().values() for there in some)
    small = [
        dotted(p) for p in modules()
        if p.name != "__init__.py" and len(p.read_text().splitlines()) < SMALL
        and importers[dotted(p)] == 1
    ]  # fmt: skip
    assert len(small) <= SMALL_SHARE * len(modules()), f"they mean little alone: {small}"


def test_functions_take_few_positional_arguments() -> None:
    over = []
    for path in modules():
        for node in statements(parsed(path)):
            if not isinstance(node, ast.FunctionDef):
                continue
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
            count = len([name for name in names if name not in ("self", "cls")])
            decorators = " ".join(ast.unparse(d) for d in node.decorator_list)
            compiled = any(w in decorators for w in ("compiled", "inlined", "command"))
            compiled |= dotted(path) in SHARED_WITH_KERNELS
            stage = room(path) == "stages" and node.name == path.stem
            if count > MOST_POSITIONAL and not (compiled or stage):
                over.append(f"{dotted(path)}.{node.name} takes {count}")
    assert not over, f"make the rest keyword-only: {over}"


@pytest.mark.parametrize(
    "face", sorted(PACKAGE.glob("*/**/__init__.py")), ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_a_face_says_what_its_folder_holds_and_what_others_may_import(face: Path) -> None:
    tree = parsed(face)
    words = ast.get_docstring(tree) or ""
    assert len(words) > 60, f"{face} does not say what its folder holds"
    values = [
        ast.literal_eval(node.value) for node in tree.body
        if (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__")
        or (isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "__all__")
    ]  # fmt: skip
    assert values, f"{face} names nothing in __all__"
    defined = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for name in values[0]:
        there = (face.parent / f"{name}.py").exists() or (face.parent / name).is_dir()
        assert there or name in defined, f"{face} names {name}, which is not there"


def test_other_rooms_import_what_a_face_names() -> None:
    hidden = []
    for here, some in edges().items():
        for there in some:
            parts = there.split(".")[1:]
            if parts[0] == here.split(".")[1] or len(parts) < 2:
                continue
            for depth in range(1, len(parts)):
                face = PACKAGE.joinpath(*parts[:depth]) / "__init__.py"
                named = parsed(face)
                shown = next(
                    (
                        ast.literal_eval(n.value)
                        for n in named.body
                        if isinstance(n, ast.Assign | ast.AnnAssign)
                    ),
                    [],
                )
                if parts[depth] not in shown:
                    hidden.append(f"{here} imports {there}")
    assert not hidden, f"their faces do not name them: {hidden}"


def test_rooms_have_names_of_the_field() -> None:
    for path in PACKAGE.rglob("*"):
        assert path.stem not in {"util", "utils", "common", "core", "base", "helpers", "manager"}
