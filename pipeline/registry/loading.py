"""A registered bundle back from the store, as what predicts."""

import hashlib
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import urlparse

from pipeline.registry.sqlite import ARTIFACTS, Version, local_place
from pipeline.registry.store import (
    DATABASE,
    client_of,
    logged_model,
    model_name,
    reached,
    versions,
)
from pipeline.schema.bundle import stored_bundle
from pipeline.schema.files import remove_folder

if TYPE_CHECKING:
    import pandas as pd

HELD = Path("artifacts/bundle")
"""Folder of the bundle below that of a version's model."""
FROM_SERVER = "from_server"
"""Folder of ``mlartifacts`` for what a server has; it may be deleted."""


class Predictor:
    """A registered bundle that predicts: a table of a sub-model's inputs in, a table out."""

    def __init__(self, version: Version, model: Any) -> None:
        self.version = version
        self.submodels: tuple[str, ...] = model.submodels
        self._model = model

    def __call__(
        self, table: "pd.DataFrame", submodel: str = "", *, anyway: bool = False
    ) -> "pd.DataFrame":
        """Prediction of one sub-model, of the first that passed where none is named.

        Raises ValueError when the bundle has no such sub-model, when it did not pass (``anyway``
        asks it all the same), and when the table lacks what it needs.
        """
        return self._model.predict(None, table, {"submodel": submodel, "anyway": anyway})


def load(machine: str, alias: str = "champion", root: Path = Path()) -> Predictor:
    """Predictor of a machine's registered bundle, with the code that it was registered with.

    Raises ValueError when no version has that alias, or its bundle is gone or changed.
    """
    found = [v for v in versions(machine, root) if alias in v.aliases]
    if not found:
        raise ValueError(f"{machine} has no {alias}: `kerf status` shows what is registered")
    place = checked_place(found[0], root, whole=True)
    import mlflow

    path = list(sys.path)
    try:
        model = mlflow.pyfunc.load_model(str(place)).unwrap_python_model()
    except (OSError, mlflow.MlflowException) as error:
        raise ValueError(f"the bundle of {machine} in {place} cannot be read: {error}") from error
    finally:  # MLflow leaves the version's code in front of ours
        sys.path = path
    return Predictor(found[0], model)


def checked_place(version: Version, root: Path, *, whole: bool = False) -> Path:
    """Folder of a version's model, whose bundle is the one that was registered.

    Of a server's models the bundle alone is brought here, with its code where ``whole`` asks.
    Raises ValueError when the model is nowhere, or its bundle was changed.
    """
    place = place_of(version, root, Path() if whole else HELD)
    there = stored_bundle(place / HELD, version.machine)
    if there is None or there.sha256 != version.bundle:
        raise ValueError(
            f"the bundle of {version.machine} version {version.version} in {place / HELD} is no "
            f"longer the one that was registered ({version.bundle[:12]}): delete {DATABASE} and "
            f"{ARTIFACTS} and run `dvc repro` to register what there is anew"
        )
    return place


def place_of(version: Version, root: Path, part: Path = Path()) -> Path:
    """Folder of a version's model, brought here when a server has it, or a ``part`` of it.

    Raises ValueError when it is nowhere.
    """
    stored = version.place
    if not stored:
        client = client_of(root)
        with reached("read", "do this again when it answers"):
            stored = client.get_model_version_download_uri(
                model_name(version.machine), str(version.version)
            )
    moved = local_place(stored, root)
    if moved.is_dir():
        return moved.resolve()
    reason: OSError | None = None
    if urlparse(stored).scheme not in ("", "file"):
        import mlflow

        try:
            return _brought(stored, part, root / ARTIFACTS / FROM_SERVER)
        except (OSError, mlflow.MlflowException) as error:
            reason = error
    raise ValueError(
        f"the bundle of {version.machine} version {version.version} is neither in {moved} nor "
        f"in {stored}: bring {ARTIFACTS} along with {DATABASE}"
    ) from reason


def delete_version(version: Version, root: Path) -> int:
    """Take a version, and the files of its model, out of the registry; bytes that are free by it.

    Files of which another version is made stay.  Raises ValueError where the store cannot be
    written.
    """
    client, name, old = client_of(root), model_name(version.machine), str(version.version)
    with reached("written"):
        stored = client.get_model_version(name, old)
        address = version.place or client.get_model_version_download_uri(name, old)
        known = client.search_model_versions(f"name='{name}'")
        alone = [v.version for v in known if v.source == stored.source] == [stored.version]
        freed = _deleted(address, root) if alone else 0
        if alone and (logged := logged_model(stored)):
            client.delete_logged_model(logged)
        client.delete_model_version(name, old)
    return freed


def _deleted(stored: str, root: Path) -> int:
    """Bytes of the files at an address and of what was brought of it, which are deleted."""
    kept = root / ARTIFACTS / FROM_SERVER / hashlib.sha256(stored.encode()).hexdigest()[:32]
    local = local_place(stored, root)
    freed = sum(remove_folder(place) for place in (local, *kept.parent.glob(f"{kept.name}*")))
    if local.name == "artifacts":
        with suppress(OSError):  # something else is in the model's folder
            local.parent.rmdir()
    if urlparse(stored).scheme in ("", "file"):
        return freed
    from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

    there = get_artifact_repository(stored)
    folders: list[str | None] = [None]
    for folder in folders:  # grows
        found = there.list_artifacts(folder)
        folders += [one.path for one in found if one.is_dir]
        freed += sum(one.file_size or 0 for one in found if not one.is_dir)
    there.delete_artifacts()
    return freed


def _brought(stored: str, part: Path, kept: Path) -> Path:
    """Folder in ``kept`` with a part of a server's model; an address never changes its files."""
    import mlflow

    whole = kept / hashlib.sha256(stored.encode()).hexdigest()[:32]
    place = whole if whole.is_dir() or part == Path() else whole.with_suffix(f".{part.name}")
    if not place.is_dir():
        kept.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=kept) as scratch:
            new = Path(scratch) / "new"
            (new / part).parent.mkdir(parents=True, exist_ok=True)
            address = stored if part == Path() else f"{stored}/{part.as_posix()}"
            got = mlflow.artifacts.download_artifacts(artifact_uri=address, dst_path=scratch)
            Path(got).replace(new / part)
            with suppress(OSError):  # somebody else has brought it meanwhile
                new.replace(place)
    return place.resolve()
