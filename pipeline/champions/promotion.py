"""Promotion, rollback and deletion of versions, each an entry in the machine's history.

The entry comes first and is what counts; files, ``champions.json`` and aliases follow it, and are
brought up by the next command where a run broke off between them.
"""

import getpass
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pipeline.champions.serving import (
    DATA,
    bundle_place,
    champion_of,
    fill_champion,
    history_of,
    history_path,
    locked,
    names_of,
    newest_bundle,
    numbered,
    promotion_settings,
    refilled,
    version_numbers,
)
from pipeline.registry.history import claim, log_decision, server_history
from pipeline.registry.loading import delete_version
from pipeline.registry.provenance import CHAMPIONS, git
from pipeline.registry.sqlite import Version
from pipeline.registry.store import is_shared, name_versions, offline, versions
from pipeline.schema.bundle import Champion, read_champions, stored_bundle
from pipeline.schema.decision import Decision
from pipeline.schema.files import remove_folder
from pipeline.schema.history import (
    SERVING,
    Entry,
    Event,
    champion_in,
    document_of,
    hours_since,
    left_at,
    served,
    stamp,
    standing,
    write_history,
)
from pipeline.schema.store import json_text, read_json, write_json, write_text

REFERENCE = "reference"
"""Alias of a version that is kept as a reference."""


class RefusedError(ValueError):
    """A challenger that the rules of the gate refuse, with the decision."""

    def __init__(self, decision: Decision, document: Path, unnoted: str) -> None:
        super().__init__(
            f"version {decision.challenger.version} of {decision.machine} may not serve in the "
            f"place of version {decision.champion.version} by {decision.broken}: mend that, or "
            f"promote it with --anyway; {document} holds the decision{unnoted}"
        )
        self.decision = decision


def person(root: Path) -> str:
    """Who works here: git's user, else that of the system."""
    return git("config", "user.name", root=root) or os.environ.get("USER") or getpass.getuser()


def judged(
    machine: str, root: Path = Path(), *, to: int | None = None, anyway: bool = False
) -> Decision:
    """Decision on the newest bundle, or version ``to``; changes nothing, looks at nothing sealed.

    Raises ValueError when there is no champion, no challenger or no such version.
    """
    with changing(machine, root):
        from pipeline.champions.challenge import decide  # not where the server is down

        champion = champion_of(machine, root)
        decision, _ = decide(machine, champion, root, to=to, anyway=anyway, seal=False)
    return decision


def promote(
    machine: str,
    root: Path = Path(),
    *,
    why: str,
    by: str = "",
    anyway: bool = False,
    to: int | None = None,
    now: datetime | None = None,
) -> Champion:
    """Make the newest bundle of a machine, or version ``to``, its champion where the rules let it.

    ``why`` goes into the history; ``by`` is git's user where it is empty; ``anyway`` lets one serve
    against the rules; ``now`` is the time of the entry.  The decision is stored either way.
    Raises RefusedError when the rules refuse it, and ValueError when there is no reason, no
    challenger or no such version, and when somebody else promoted another meanwhile.
    """
    _needs_reason(machine, why)
    by, at = by or person(root), stamp(now or datetime.now(UTC))
    with changing(machine, root):
        from pipeline.champions.challenge import decide  # not where the server is down

        decision, sealed = decide(machine, champion_of(machine, root), root, to=to, anyway=anyway)
        decision = replace(decision, at=at, by=by, why=why)
        text = json_text(decision)
        entry = _added(
            machine, root, text, event="promoted" if decision.promoted else "refused",
            version=decision.challenger.version, bundle=decision.challenger.bundle, at=at, by=by,
            why=why, serving=decision.serving if decision.promoted else (), sealed=sealed,
            anyway=decision.overridden, rules=decision.objections,
            decision=hashlib.sha256(text.encode()).hexdigest(),
        )  # fmt: skip
        known = [v for v in versions(machine, root) if v.bundle == entry.bundle]
        unnoted = ""
        try:
            log_decision(decision, known[-1], root)
        except ValueError as error:  # the entry counts, MLflow's note of it does not
            unnoted = f"; only MLflow has no note of it: {error}"
        if not decision.promoted:
            document = document_of(history_path(machine, root), entry)
            raise RefusedError(decision, document.relative_to(root), unnoted)
        champion = _carried_out(entry, root)
        if unnoted:
            raise ValueError(f"version {entry.version} of {machine} serves{unnoted}")
        return champion


def decided(machine: str, root: Path = Path()) -> Decision:
    """Document of the machine's last decision.

    Raises StoreError where there is none.
    """
    path, entries = history_path(machine, root), history_of(machine, root)
    last = next((one for one in reversed(entries) if one.decision), entries[-1])
    return read_json(document_of(path, last), Decision)


def rollback(
    machine: str,
    root: Path = Path(),
    *,
    why: str,
    by: str = "",
    to: int | None = None,
    force: bool = False,
    now: datetime | None = None,
) -> Champion:
    """Make the version that served before, or version ``to`` that once served, the champion again.

    A further rollback goes one further back.  What served against the rules does so again.  Within
    the warm hours of the settings at once, later with ``force`` only.  Raises ValueError when there
    is no reason, none that served before, or it has not served for longer.
    """
    _needs_reason(machine, why)
    by, moment = by or person(root), stamp(now or datetime.now(UTC))
    with changing(machine, root):
        champion, history = champion_of(machine, root), history_of(machine, root)
        if champion is None or not served(history):
            raise ValueError(f"{machine} has nothing to go back to: nothing was promoted yet")
        numbers = version_numbers(machine, root)
        stored = {v.bundle for v in versions(machine, root)}
        gone = {e.bundle for e in history if e.event == "deleted"} - stored
        others = {e.bundle: e for e in served(history) if e.bundle not in (champion.bundle, *gone)}
        before = standing(history)[:-1] if to is None else others.values()
        back = [e for e in before if e.bundle in others and to in (None, numbers.get(e.bundle))]
        if not back:
            there = ", ".join(str(numbers.get(bundle, "-")) for bundle in others)
            which = f"no version served {machine} before version {champion.version}"
            if to is not None:
                which = f"version {to} of {machine} never served beside the present one"
            raise ValueError(f"{which}; for --to there are {there or 'none'}")
        target = back[-1]
        hours = hours_since(left_at(history, target.bundle) or "", moment)
        warm = promotion_settings(root).warm_hours
        if hours > warm and not force:
            raise ValueError(
                f"version {target.version} of {machine} has not served for {hours:.0f} h, and is "
                f"warm for {warm:g} h: look at it, and give --force if it shall serve again"
            )
        # looked for first: an entry that cannot be carried out would hold the machine up
        bundle_place(machine, target.bundle, names_of(machine, root), root)
        return _carried_out(_added(
            machine, root, event="rolled back", version=target.version, bundle=target.bundle,
            at=moment, by=by, why=why, serving=target.serving, anyway=target.anyway,
            rules=target.rules,
        ), root)  # fmt: skip


def delete(
    machine: str,
    version: int,
    root: Path = Path(),
    *,
    why: str,
    by: str = "",
    now: datetime | None = None,
) -> int:
    """Take a version, with its files, out of the registry; bytes that are free by it.

    It stays where it serves, is warm, or is a reference.

    Raises ValueError when it is one of these, or there is no such version or reason.
    """
    _needs_reason(machine, why)
    by, moment = by or person(root), stamp(now or datetime.now(UTC))
    with changing(machine, root):
        found = numbered(machine, version, root)
        reason = retained(found, root, moment)
        if reason:
            raise ValueError(f"version {version} of {machine} {reason}: it cannot be deleted")
        _added(machine, root, event="deleted", version=version, bundle=found.bundle, at=moment,
               by=by, why=why)  # fmt: skip
        warm = root / DATA / "warm" / machine
        there = stored_bundle(warm, machine)
        freed = remove_folder(warm) if there and there.sha256 == found.bundle else 0
        return freed + delete_version(found, root)


def retained(version: Version, root: Path, moment: str) -> str:
    """Why a version has to stay; empty where it may go."""
    champion = champion_of(version.machine, root)
    if champion is not None and champion.bundle == version.bundle:
        return "serves"
    if REFERENCE in version.aliases:
        return "is a reference"
    left = left_at(history_of(version.machine, root), version.bundle)
    warm = promotion_settings(root).warm_hours
    if left is not None and hours_since(left, moment) <= warm:
        return f"served less than {warm:g} h ago"
    return ""


# The history.


def settle(machine: str, root: Path = Path()) -> None:
    """Bring files, champions.json and aliases to the history, where a run broke off between them.

    Raises ValueError where the history or the registry cannot be read.
    """
    with changing(machine, root):
        pass


def events(machine: str, root: Path = Path()) -> tuple[Entry, ...]:
    """History of a machine, with what a server that answers has beyond it; changes nothing.

    Of a machine without a choice so far it is the bundle that serves as the first.
    """
    own = history_of(machine, root)
    others = () if offline() else server_history(machine, root)
    return max(own, others, key=len) or _beginning(machine, root)


@contextmanager
def changing(machine: str, root: Path) -> Iterator[None]:
    """Hold a machine for one change; first whatever broke off, or others did, is brought up.

    Raises ValueError where the server of a shared registry does not answer.
    """
    refilled(machine, names_of(machine, root), root)
    with locked(machine, root):
        _take_over(machine, root)
        serving = served(history_of(machine, root))
        if not serving and machine in read_champions(root / CHAMPIONS).machines:
            serving = list(_beginning(machine, root))  # chosen before there were histories
            write_history(serving, history_path(machine, root))
        if serving:
            _carried_out(serving[-1], root)
        yield


def _take_over(machine: str, root: Path) -> None:
    """Bring the file and the server's history to the same entries.

    Raises ValueError where neither continues the other.
    """
    if not is_shared():
        return
    own, others = history_of(machine, root), server_history(machine, root)
    shared = min(len(own), len(others))
    if [e.sha256 for e in own[:shared]] != [e.sha256 for e in others[:shared]]:
        raise ValueError(
            f"{history_path(machine, root)} and the history of {machine} on the server differ: "
            "take the file of the branch that the server's entries were committed to"
        )
    if len(others) > len(own):
        write_history(others, history_path(machine, root))
    for entry in own[shared:]:
        claim(entry, root)


def _added(machine: str, root: Path, document: str = "", *, event: Event, **fields: Any) -> Entry:
    """Add an entry to the history, on the server first where there is one, with its document.

    Raises ValueError where somebody else was first.
    """
    before = history_of(machine, root) or _beginning(machine, root)
    entry = Entry(
        machine=machine, number=len(before) + 1, event=event,
        before=before[-1].sha256 if before else "", **fields,
    )  # fmt: skip
    if is_shared():
        for one in (*before, entry):
            chain = server_history(machine, root)
            if len(chain) < one.number:
                chain = claim(one, root)
            if chain[one.number - 1].sha256 != one.sha256:
                other = chain[one.number - 1]
                raise ValueError(
                    f"{other.by} was first: version {other.version} of {machine} was "
                    f"{other.event} at {other.at} ({other.why}); look at `kerf history -m "
                    f"{machine}`, and do this again if it is still right"
                )
    if document:
        write_text(document, document_of(history_path(machine, root), entry))
    write_history((*before, entry), history_path(machine, root))
    if event not in SERVING:
        _note_present(machine, root)
    return entry


def _note_present(machine: str, root: Path) -> None:
    """Bring champions.json to the history: what serves, and the hash of the last entry."""
    entries = history_of(machine, root)
    with locked("champions", root):
        champions = read_champions(root / CHAMPIONS)
        for last in served(entries)[-1:]:
            wanted = champions.promoted(machine, champion_in(last), entries[-1].sha256)
            if wanted != champions:
                write_json(wanted, root / CHAMPIONS)


def _beginning(machine: str, root: Path) -> tuple[Entry, ...]:
    """First entry of a history: the champion of before the first choice, if there is one."""
    champion = champion_of(machine, root)
    if champion is None:
        return ()
    stored = [] if offline() else versions(machine, root)
    known = [v for v in stored if v.bundle == champion.bundle]
    at = champion.since or (known[-1].created if known else "")
    held = stored_bundle(root / DATA / "champion" / machine, machine)
    serving = champion.serving
    if serving is None and held is not None:
        serving = tuple(held.submodels)
    return (Entry(
        machine=machine, number=1, event="promoted" if champion.since else "first",
        version=champion.version or (known[-1].version if known else 0), bundle=champion.bundle,
        at=at, by=champion.by, why=champion.why, serving=serving or (),
    ),)  # fmt: skip


def _carried_out(entry: Entry, root: Path) -> Champion:
    """Bring files, champions.json and aliases to an entry from which on a version serves."""
    machine, champion = entry.machine, champion_in(entry)
    names = names_of(machine, root)
    fill_champion(machine, champion.bundle, names, root, keep=True)
    _note_present(machine, root)
    newest = newest_bundle(machine, names, root)
    before = [e.bundle for e in served(history_of(machine, root)) if e.bundle != champion.bundle]
    name_versions(
        machine, root, champion, previous=before[-1] if before else None,
        challenger=newest.sha256 if newest and newest.sha256 != champion.bundle else None,
    )  # fmt: skip
    return champion


def _needs_reason(machine: str, why: str) -> None:
    if not why.strip():
        raise ValueError(f"a change of what serves {machine} needs a reason: give it with --why")
