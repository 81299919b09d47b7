"""A registered bundle back from the store, as what predicts."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.registry.store import (
    ARTIFACTS,
    DATABASE,
    Version,
    client_of,
    model_name,
    versions,
)
from pipeline.schema.bundle import stored_bundle

if TYPE_CHECKING:
    import pandas as pd


class Predictor:
    """A registered bundle that predicts: a table of a sub-model's inputs in, a table out."""

    def __init__(self, version: Version, model: Any) -> None:
        self.version = version
        self.submodels: tuple[str, ...] = model.submodels
        self._model = model

    def __call__(self, table: "pd.DataFrame", submodel: str = "") -> "pd.DataFrame":
        """Prediction of one sub-model, of the first where none is named.

        Raises ValueError when the bundle has no such sub-model, or the table lacks what it needs.
        """
        return self._model.predict(None, table, {"submodel": submodel})


def load(machine: str, alias: str = "champion", root: Path = Path()) -> Predictor:
    """Predictor of a machine's registered bundle, with the code that it was registered with.

    Raises ValueError when no version has that alias, or its bundle is gone or changed.
    """
    found = [v for v in versions(machine, root) if alias in v.aliases]
    if not found:
        raise ValueError(f"{machine} has no {alias}: `kerf status` shows what is registered")
    place = checked_place(found[0], root)
    import mlflow

    path = list(sys.path)
    try:
        model = mlflow.pyfunc.load_model(str(place)).unwrap_python_model()
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(f"the bundle of {machine} in {place} cannot be read: {error}") from error
    finally:  # MLflow leaves the version's code in front of ours
        sys.path = path
    return Predictor(found[0], model)


def checked_place(version: Version, root: Path) -> Path:
    """Folder of a version's model, whose bundle is the one that was registered."""
    place = place_of(version, root)
    bundle = place / "artifacts" / "bundle"
    there = stored_bundle(bundle, version.machine)
    if there is None or there.sha256 != version.bundle:
        raise ValueError(
            f"the bundle of {version.machine} version {version.version} in {bundle} is no longer "
            f"the one that was registered ({version.bundle[:12]}): delete {DATABASE} and "
            f"{ARTIFACTS} and run `dvc repro` to register what there is anew"
        )
    return place


def place_of(version: Version, root: Path) -> Path:
    """Folder of a version's model, brought here when a server has it.

    Raises ValueError when it is nowhere.
    """
    client = client_of(root)
    import mlflow

    stored = client.get_model_version_download_uri(
        model_name(version.machine), str(version.version)
    )
    moved = root / ARTIFACTS / stored.rpartition(f"/{ARTIFACTS}/")[2]
    if moved.is_dir():
        return moved.resolve()
    try:
        return Path(mlflow.artifacts.download_artifacts(artifact_uri=stored))
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(
            f"the bundle of {version.machine} version {version.version} is neither in {moved} nor "
            f"in {stored}: bring {ARTIFACTS} along with {DATABASE}"
        ) from error
