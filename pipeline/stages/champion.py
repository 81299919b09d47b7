"""Stage: fill a machine's folder of what serves with the bundle that champions.json names."""

from pathlib import Path

from pipeline.champions import fill_champion
from pipeline.fleet import Fleet
from pipeline.schema.bundle import read_champions
from pipeline.schema.store import write_json


def champion(models: Path, champions: Path, champion: Path, *, fleet: Fleet) -> None:
    """Fill ``data/champion/<machine>``; a folder that holds the champion already stays as it is.

    Parameters
    ----------
    models : Path
        ``data/models/<machine>``, the newest models.
    champions : Path
        ``champions.json``, at the project's root.
    champion : Path
        ``data/champion/<machine>``.
    fleet : Fleet
        That says which sub-models the machine has.

    Raises
    ------
    ValueError
        When champions.json names none for the machine, or its bundle lies nowhere.
    """
    machine = models.name
    entry = read_champions(champions).machines.get(machine)
    if entry is None:
        raise ValueError(f"{champions} names no champion of {machine}: run `dvc repro register`")
    names = fleet.submodels_of(machine)
    fill_champion(entry.bundle, names, models, champion, root=champions.parent)
    for name in fleet.submodels:  # so that a stage may depend on a sub-model that a machine lacks
        if name not in names:
            write_json({"submodel": name, "records": False}, champion / name / "none.json")
