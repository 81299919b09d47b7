"""Compiled loops are kept in the user's cache under a hash of what they are made of."""

import json
import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numba.core.types
import pytest
from numba.core.dispatcher import Dispatcher

import pipeline
from pipeline import kernels
from pipeline.app import compiling
from pipeline.app.compiling import _is_readable, _type, _written
from pipeline.machine.axis.drive import Side
from pipeline.machine.axis.drive_parameters import DriveColumn

LOOPS = """
from pipeline.kernels import compiled
from pipeline.{other} import FACTORS, SCALE, inner

@compiled
def outer(x):
    return inner(x) * SCALE + FACTORS[0]
"""
INNER = """
import numpy as np
from pipeline.kernels import compiled

FACTORS = np.array([{factor}])
SCALE = {scale}

@compiled
def inner(x):
    return x + {term}
"""


def run(project: Path, cache: Path) -> tuple[float, list[str]]:
    """What the outer loop gives of 1 in a process of its own, and the loops it had to compile."""
    code = (
        "from numba.core import event\n"
        "class Seen(event.Listener):\n"
        "    def on_start(self, e): print(e.data['dispatcher'].py_func.__name__)\n"
        "    def on_end(self, e): pass\n"
        "event.register('numba:compile', Seen())\n"
        "from pipeline.room.outer import outer\n"
        "print(outer(1.0))\n"
    )
    environment = {"PATH": "", "KERF_CACHE": str(cache), "PYTHONPATH": str(project)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=project, env=environment, text=True, check=True,
        capture_output=True,
    )  # fmt: skip
    *loops, value = done.stdout.split()
    return float(value), sorted(loops)


def project(folder: Path, scale: float = 2.0, term: float = 3.0, factor: float = 0.5) -> Path:
    """A package of the name of ours whose loop calls one of another folder."""
    for room in ("room", "elsewhere"):
        (folder / "pipeline" / room).mkdir(parents=True, exist_ok=True)
    shutil.copy(kernels.__file__, folder / "pipeline")
    shutil.copytree(
        Path(pipeline.__file__).parent / "schema", folder / "pipeline/schema", dirs_exist_ok=True
    )
    (folder / "pipeline/room/outer.py").write_text(LOOPS.format(other="elsewhere.inner"))
    (folder / "pipeline/elsewhere/inner.py").write_text(
        INNER.format(scale=scale, term=term, factor=factor)
    )
    return folder


@pytest.fixture(scope="module")
def unchanged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cache that the loops fill as they stand."""
    folder = tmp_path_factory.mktemp("unchanged")
    assert run(project(folder / "one"), folder / "cache") == (8.5, ["inner", "outer"])
    return folder / "cache"


def test_another_copy_of_the_sources_compiles_nothing(tmp_path: Path, unchanged: Path) -> None:
    cache = shutil.copytree(unchanged, tmp_path / "cache")
    assert run(project(tmp_path / "two"), cache) == (8.5, [])


@pytest.mark.parametrize(
    ("changed", "value"),
    [
        pytest.param({"term": 4.0}, 10.5, marks=pytest.mark.proof),
        ({"scale": 3.0}, 12.5),
        ({"factor": 0.25}, 8.25),
    ],
)
def test_a_change_in_another_file_counts(
    tmp_path: Path, unchanged: Path, changed: dict[str, float], value: float
) -> None:
    """What a loop calls there, a number and an array; the loop there is compiled again as well."""
    cache = shutil.copytree(unchanged, tmp_path / "cache")
    assert run(project(tmp_path / "two", **changed), cache) == (value, ["inner", "outer"])


def test_a_cache_that_cannot_be_written_is_not_needed(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    cache.write_text("no folder")
    assert run(project(tmp_path / "one"), cache) == (8.5, ["inner", "outer"])


def test_old_loops_are_thrown_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KERF_CACHE", str(tmp_path))
    place = kernels.ByContent.from_function(project, __file__)
    for name in ("old", "new"):
        (tmp_path / "loops" / name).touch()
    long_ago = (tmp_path / "loops/new").stat().st_mtime - 2 * kernels.KEPT_S
    os.utime(tmp_path / "loops/old", (long_ago, long_ago))
    place.ensure_cache_path()
    assert [one.name for one in (tmp_path / "loops").iterdir()] == ["new"]


def test_what_is_bound_below_a_loop_counts_with_its_other_files(tmp_path: Path) -> None:
    """The loop on top calls one below it in its file, which calls one of another file."""
    cache = tmp_path / "cache"
    for folder, term in (("one", 3.0), ("two", 4.0)):
        made = project(tmp_path / folder, term=term) / "pipeline/room/outer.py"
        above = "@compiled\ndef outer(x):\n    return below(x)\n\n\n@compiled\ndef below(x):"
        made.write_text(made.read_text().replace("@compiled\ndef outer(x):", above))
    assert run(tmp_path / "one", cache) == (8.5, ["below", "inner", "outer"])
    assert run(tmp_path / "two", cache) == (10.5, ["below", "inner", "outer"])


def test_loops_that_call_each_other_have_a_hash() -> None:
    assert kernels.content(_even) != kernels.content(project)


def _even(n: int) -> bool:
    return n == 0 or _odd(n - 1)


def _odd(n: int) -> bool:
    return n != 0 and _even(n - 1)


def test_each_loop_of_the_list_is_one_and_its_types_are_read_back() -> None:
    loops = json.loads(compiling.LOOPS.read_text())
    assert len(loops) > 200
    for module, name, arguments in loops:
        assert isinstance(getattr(import_module(module), name), Dispatcher), f"{module}.{name}"
        assert [_written(_type(one)) for one in arguments] == arguments


def test_types_of_arguments_survive_json() -> None:
    types: Any = numba.core.types
    kinds = [
        types.float64, types.boolean, types.Array(types.float32, 3, "A"), types.literal(2),
        types.Array(types.int64, 1, "C", readonly=True), types.UniTuple(types.float64, 4),
        types.BaseTuple.from_types([types.float64, types.int64]),
        types.BaseTuple.from_types([types.float64] * 5, Side),
    ]  # fmt: skip
    assert [_type(json.loads(json.dumps(_written(one)))) for one in kinds] == kinds
    assert all(map(_is_readable, kinds))
    assert not _is_readable(types.IntEnumMember(DriveColumn, types.int64))


def test_a_file_that_another_process_takes_away_meanwhile_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba writes beside and renames: what was listed may be gone when it is looked at."""
    monkeypatch.setenv("KERF_CACHE", str(tmp_path))
    place = kernels.ByContent(test_a_file_that_another_process_takes_away_meanwhile_is_no_error,
                              __file__)  # fmt: skip
    place.ensure_cache_path()
    gone = tmp_path / "loops/loop.nbc.tmp.1"
    monkeypatch.setattr(Path, "iterdir", lambda folder: iter([gone]))
    place.ensure_cache_path()
