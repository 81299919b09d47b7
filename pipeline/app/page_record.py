"""Origin of a command's page: commit, settings, model, files read, words of the command."""

import json
from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.app.kerf import CALLED
from pipeline.charts.sources import Source
from pipeline.report.provenance import Made
from pipeline.schema.bundle import BUNDLE, MODEL, Bundle, predicting_files
from pipeline.schema.store import StoreError, read_json

PACKAGE = Path(__file__).parents[1]


def made_by_command(
    machine: str, models: Path, settings: Mapping[str, Any], read: Iterable[Path]
) -> Made:
    """Origin of a page of ``machine``, of its sub-models in ``models`` and the files ``read``."""
    from pipeline.champions.serving import chosen_champion
    from pipeline.registry.provenance import dirty, git

    checkout = (PACKAGE.parent / "dvc.yaml").is_file()  # else some repository around the library
    commit = git("rev-parse", "HEAD", root=PACKAGE) if checkout else None
    bundle, number = _bundle(models), ""
    entry = chosen_champion(machine)
    if entry is not None and bundle == entry.bundle:
        number = f"version {entry.version}"
    parts = [path.parent for path in sorted(models.glob(f"*/{MODEL}"))]
    files = [*read, *(path for part in parts for path in predicting_files(part))]
    own = json.dumps(settings, sort_keys=True, default=str).encode()
    return Made(
        code=commit or version("kerf-twin"), dirty=dirty(PACKAGE) if commit else "",
        settings=sha256(own).hexdigest(), model=bundle, version=number, command=CALLED.get(),
        files=tuple(
            Source(path=path.as_posix(), sha256=sha256(path.read_bytes()).hexdigest())
            for path in files if path.is_file()
        ),
    )  # fmt: skip


def _bundle(models: Path) -> str:
    """Hash of a folder's bundle; empty where it holds none, as that of the latest models."""
    try:
        return read_json(models / BUNDLE, Bundle).sha256
    except StoreError:
        return ""
