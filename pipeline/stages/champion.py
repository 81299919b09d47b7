"""Stage: register a machine's newest bundle, and fill its folder of what serves."""

from pathlib import Path

from pipeline.champions.serving import keep_serving
from pipeline.fleet import Fleet
from pipeline.schema.bundle import MODEL
from pipeline.schema.store import write_json


def champion(models: Path, champions: Path, champion: Path, *, fleet: Fleet) -> None:
    """Register missing bundles; fill ``data/champion/<machine>`` with the one that serves.

    Without a sub-model that is nothing; without a promotion the bundle in it serves on.
    """
    names = fleet.submodels_of(models.name)
    if names:
        keep_serving(models.name, names, champions.parent)
    champion.mkdir(parents=True, exist_ok=True)
    for name in fleet.submodels:  # so that a stage may depend on a sub-model that does not serve
        if not (champion / name / MODEL).exists():
            write_json({"submodel": name, "records": False}, champion / name / "none.json")
