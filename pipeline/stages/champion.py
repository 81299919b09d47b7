"""Stage: register a machine's newest bundle, and fill its folder of what serves."""

from pathlib import Path

from pipeline.champions import keep_serving
from pipeline.fleet import Fleet
from pipeline.schema.store import write_json


def champion(models: Path, champions: Path, champion: Path, *, fleet: Fleet) -> None:
    """Register what the store lacks; fill ``data/champion/<machine>`` with what serves.

    A store that is lost later, or another server, is filled by ``kerf status`` or ``promote``.

    Parameters
    ----------
    models : Path
        ``data/models/<machine>``, the newest models.
    champions : Path
        ``champions.json``, at the project's root: what somebody promoted.
    champion : Path
        ``data/champion/<machine>``; where nobody promoted one, the bundle in it serves on.
    fleet : Fleet
        That says which sub-models the machine has.

    Raises
    ------
    ValueError
        When the bundle that champions.json names lies nowhere.
    """
    names = fleet.submodels_of(models.name)
    keep_serving(models.name, names, champions.parent)
    for name in fleet.submodels:  # so that a stage may depend on a sub-model that a machine lacks
        if name not in names:
            write_json({"submodel": name, "records": False}, champion / name / "none.json")
