"""Model that MLflow serves: a machine's bundle, dispatched by sub-model (models from code).

It imports nothing of the package at its top: the installed package or the copy that a version was
registered with is chosen when a bundle is loaded.
"""

import importlib
import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

import mlflow
import pandas as pd

PACKAGE = "pipeline"
CODE = Path(__file__).parent / "code"
"""Folder of the copy of the package, beside this file in a registered version."""
_SWAPPING = threading.RLock()


class OwnPackage:
    """Copy of the package apart from the installed one of the same name, for older versions.

    Where both are the same, the installed one is used, whose kernels are compiled.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.apart = folder.is_dir() and not same_code(folder / PACKAGE, installed())
        self.modules: dict[str, ModuleType] = {}

    @contextmanager
    def active(self) -> Iterator[None]:
        """Imports inside are of the copy; those of the installed package are as before after it."""
        if not self.apart:
            yield
            return
        with _SWAPPING:
            others = _taken()
            sys.modules.update(self.modules)
            sys.path.insert(0, str(self.folder))
            importlib.invalidate_caches()
            try:
                yield
            finally:
                sys.path.remove(str(self.folder))
                self.modules = _taken()
                sys.modules.update(others)


def _taken() -> dict[str, ModuleType]:
    """Modules of the package that are loaded, taken out of ``sys.modules``."""
    names = [name for name in sys.modules if name.partition(".")[0] == PACKAGE]
    return {name: sys.modules.pop(name) for name in names}


def installed() -> Path | None:
    """Folder of the package that this process imports, or would import."""
    loaded = sys.modules.get(PACKAGE)
    spec = loaded.__spec__ if loaded is not None else PathFinder.find_spec(PACKAGE)
    places = spec.submodule_search_locations if spec is not None else None
    return Path(next(iter(places))) if places else None


def same_code(one: Path, other: Path | None) -> bool:
    """Whether two folders hold the same Python files."""
    if other is None:
        return False
    first, second = _sources(one), _sources(other)
    return first.keys() == second.keys() and all(
        first[name].read_bytes() == second[name].read_bytes() for name in first
    )


def _sources(folder: Path) -> dict[str, Path]:
    return {path.relative_to(folder).as_posix(): path for path in folder.rglob("*.py")}


class Bundle(mlflow.pyfunc.PythonModel):
    """Predictor with one of the sub-models of a machine's bundle, named by ``params``.

    Times are UTC, without a time zone where MLflow checks them.
    """

    def load_context(self, context: Any) -> None:
        """Read which sub-models there are; each is loaded when it is first used."""
        self.folder = Path(context.artifacts["bundle"])
        said = json.loads((self.folder / "bundle.json").read_text(encoding="utf-8"))
        self.machine, self.submodels = str(said["machine"]), tuple(said["submodels"])
        self.statuses = {name: one["status"] for name, one in said["submodels"].items()}
        self.package = OwnPackage(CODE)
        self.loaded: dict[str, Callable[[pd.DataFrame], pd.DataFrame]] = {}

    def predict(
        self, context: Any, model_input: pd.DataFrame, params: dict[str, Any] | None = None
    ) -> pd.DataFrame:
        """Predictions of ``params["submodel"]``, else of the first that passed, from its inputs.

        Raises ValueError when the bundle has no such sub-model, when it did not pass and
        ``params["anyway"]`` is not true, and when the table lacks a column.
        """
        wanted = params or {}
        passed = [name for name in self.submodels if self.statuses[name] == "passed"]
        name = wanted.get("submodel") or (passed or self.submodels)[0]
        if name not in self.submodels:
            raise ValueError(
                f"the bundle of {self.machine} has no sub-model {name!r}; it has "
                f"{', '.join(self.submodels)}"
            )
        if name not in passed and not wanted.get("anyway"):
            raise ValueError(
                f"the {name} of {self.machine} does not serve ({self.statuses[name]}): give the "
                "parameter anyway as true to ask it all the same"
            )
        with self.package.active():
            if name not in self.loaded:
                found = importlib.import_module(f"{PACKAGE}.submodels.{name}.submodel").SUBMODEL
                self.loaded[name] = found.answer(self.folder / name)
            return self.loaded[name](model_input)


mlflow.models.set_model(Bundle())
