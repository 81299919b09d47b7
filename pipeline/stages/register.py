"""Stage: register every machine's bundle, once for each content, and name first champions."""

from functools import partial
from pathlib import Path

from pipeline.champions import DATA, FIRST_BY, first_champion, made_with
from pipeline.fleet import Fleet
from pipeline.registry.runs import register as registered_version
from pipeline.registry.store import name_versions, note_promotion, versions
from pipeline.schema.bundle import (
    Bundle,
    Champions,
    bundle_of,
    read_champions,
    stored_bundle,
    write_champions,
)
from pipeline.schema.store import write_json


def register(models: Path, champions: Path, registered: Path, *, fleet: Fleet) -> None:
    """Fill the registry with what it lacks; write what is registered, and who serves.

    It runs at every ``dvc repro``, so that a store that was deleted, or another server, is filled
    again; where nothing is new it only reads.

    Parameters
    ----------
    models : Path
        Folder of the machines' models.
    champions : Path
        ``champions.json``, at the project's root; entries of other fleets' machines stay.
    registered : Path
        JSON: bundle and sub-models of every machine.
    fleet : Fleet
        Whose machines.
    """
    root, before = champions.parent, read_champions(champions)
    known, found = before, {}
    for machine in fleet.machines:
        names = fleet.submodels_of(machine)
        if names:
            bundle = bundle_of(models / machine, machine, names)
            known = _registered(bundle, models / machine, known, root)
            found[machine] = {"bundle_sha256": bundle.sha256, "submodels": bundle.submodels}
    if known != before:
        write_champions(known, champions)
    write_json(found, registered)


def _registered(bundle: Bundle, folder: Path, known: Champions, root: Path) -> Champions:
    """The champions after one machine's bundle, and the one that serves it, were registered."""
    machine = bundle.machine
    serves = root / DATA / "champion" / machine
    champion = known.machines.get(machine)
    held = stored_bundle(serves, machine)
    if champion is not None and held is not None and held.sha256 == champion.bundle:
        registered_version(held, serves, root)
    settings = partial(made_with, machine, tuple(bundle.submodels), root)
    registered_version(bundle, folder, root, made_with=settings)
    stored = versions(machine, root)
    if champion is not None and champion.by == FIRST_BY:
        # nobody chose it: on a machine whose last digits differ, the first bundle is another
        held_by = {one.bundle for one in stored}
        champion = champion if champion.bundle in held_by else None
    if champion is None:
        champion = first_champion(bundle, stored)
        known = known.promoted(machine, champion)
    other = None if champion.bundle == bundle.sha256 else bundle.sha256
    name_versions(machine, root, champion=champion.bundle, challenger=other)
    note_promotion(machine, root, champion)
    return known
