"""History of a machine on a server that a team shares, and what a decision leaves in the registry.

An entry is a version of the registered model ``kerf-<machine>-history``.  The server numbers
versions one by one, and an entry counts where it names the hash of the last one that counts; so of
two people who promote at once one is the first, and the other sees it.
"""

from pathlib import Path

from pipeline.registry.provenance import plain
from pipeline.registry.runs import HEAD, as_description
from pipeline.registry.sqlite import Note, Version
from pipeline.registry.store import (
    client_of,
    is_shared,
    logged_model,
    made_by_another,
    model_name,
    note,
    reached,
    versions,
)
from pipeline.schema.decision import Decision
from pipeline.schema.history import Entry, whole
from pipeline.schema.store import json_text, parsed

ENTRY = "entry"
"""Tag with an entry's line."""
GATE = "gate"
"""Folder of a run with the decision, and tag of a version with what the gate said."""


def history_name(machine: str) -> str:
    """Name of the registered model that holds a machine's history."""
    return f"{model_name(machine)}-history"


def server_history(machine: str, root: Path) -> tuple[Entry, ...]:
    """Chain of a machine's entries on the server; empty where the store is a file of one project.

    Raises ValueError where the server cannot be read.
    """
    if not is_shared():
        return ()
    client = client_of(root)
    with reached("read", "do this again when it answers"):
        found = client.search_model_versions(f"name='{history_name(machine)}'")
    lines = [v.tags.get(ENTRY, "") for v in sorted(found, key=lambda v: int(v.version))]
    return whole(
        parsed(line.encode(), Entry, f"the history of {machine} on the server")
        for line in lines if line
    )  # fmt: skip


def claim(entry: Entry, root: Path) -> tuple[Entry, ...]:
    """Write an entry to the server; the chain after it, which holds the entry if it came first."""
    client, name = client_of(root), history_name(entry.machine)
    every = versions(entry.machine, root)  # a bundle that is gone has a stand-in
    known = [v for v in every if v.bundle == entry.bundle] or every
    if not known:
        raise ValueError(
            f"the server has no version of {entry.machine} yet: run `dvc repro` to register one"
        )
    with reached("written"):
        if not client.search_registered_models(f"name='{name}'"):
            about = f"Who served {entry.machine} when, by whom and why: see `kerf history`."
            with made_by_another():
                client.create_registered_model(name, description=about)
        model = client.get_model_version(model_name(entry.machine), str(known[-1].version))
        client.create_model_version(
            name, model.source, known[-1].run or None, tags={ENTRY: entry.line},
            model_id=logged_model(model) or None,
            description=f"{entry.event}: version {entry.version}, {entry.by}, {entry.why}",
        )  # fmt: skip
    return server_history(entry.machine, root)


def log_decision(decision: Decision, version: Version, root: Path) -> None:
    """Store a decision with the challenger: document, metrics of its run, tag of it.

    Raises ValueError where the store cannot be written.
    """
    said = "may serve" if decision.may_serve else f"is refused: {decision.objections}"
    if decision.overridden:
        said = f"serves anyway: {decision.objections}"
    card = version.description
    of_gate = (
        f"Gate: against version {decision.champion.version} it {said[:800]}. {decision.by}, "
        f"{decision.at}: {decision.why}."
    )
    logged = {"/".join(map(plain, key.split("/"))): one for key, one in decision.metrics.items()}
    note(
        decision.machine, root,
        Note(
            version=version.version, tags={GATE: said[:4000]},
            description=as_description(f"{of_gate}\n\n{card[max(card.find(HEAD), 0) :]}"),
            run=version.run, metrics=logged if version.run else {},
            files={f"{GATE}/decision.json": json_text(decision)} if version.run else {},
        ),
    )  # fmt: skip
