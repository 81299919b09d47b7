"""History of what serves: an append-only file a machine, each entry with the hash before it.

It answers who served at a time, since when, by whom and why; git holds it.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

from pipeline.schema.bundle import Champion, read_champions
from pipeline.schema.store import StoreError, content, json_line, read_lines, write_text

Event = Literal["first", "promoted", "rolled back", "refused", "deleted"]
SERVING = ("first", "promoted", "rolled back")
"""Events from which on a version serves."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One event in the life of a machine's versions."""

    machine: str
    number: int
    """Machine, and place in its history, from 1."""
    event: Event
    version: int
    bundle: str
    """Version and hash of the bundle that it is about."""
    at: str
    """Time, UTC, ``YYYY-MM-DDTHH:MM:SSZ``; of a first bundle when it was registered, or ""."""
    by: str
    why: str
    serving: tuple[str, ...] = ()
    """Sub-models that serve from then on; empty where nothing does by this event."""
    anyway: bool = False
    """Whether it was against the rules of the gate."""
    rules: str = ""
    """What spoke against it."""
    decision: str = ""
    """SHA-256 of the decision's document; empty where nothing was compared."""
    sealed: str = ""
    """SHA-256 of the sealed set where it was looked at: each look spends some of its worth."""
    before: str = ""
    """SHA-256 of the entry before this one; empty for the first."""

    @property
    def reason(self) -> str:
        """Why, with what spoke against it."""
        against = f"anyway: {self.rules}" if self.anyway else self.rules
        return "; ".join(filter(None, (self.why, against)))

    @property
    def line(self) -> str:
        """The entry as one line of JSON."""
        return json_line(self)

    @property
    def sha256(self) -> str:
        """Hash of the line."""
        return hashlib.sha256(self.line.encode()).hexdigest()


def read_history(path: Path, *, elsewhere: bool = False) -> tuple[Entry, ...]:
    """Entries of ``data/history/<machine>.jsonl``, none where there is no such file.

    With ``elsewhere`` the documents of decisions may lie on a server alone.  Raises StoreError
    where a line does not follow the one before, the document of a decision is gone or not the one
    that its entry names, or champions.json, beside ``data``, names a last entry that is not there,
    or another champion than the history up to it.
    """
    champions, machine = read_champions(path.parents[2] / "champions.json"), path.stem
    last = champions.histories.get(machine, "")
    documents = path.with_suffix("").as_posix()
    remedy = f"restore it with `git checkout champions.json {path.as_posix()} {documents}`"
    found: list[Entry] = []
    for entry, where in read_lines(path, Entry, remedy):
        if not follows(entry, found):
            raise StoreError(
                f"{where} does not follow the line before, whose sha256 it does not name: {remedy}"
            )
        document = document_of(path, entry)
        if entry.decision and not (elsewhere and not document.exists()):
            said = content(document, remedy)
            if hashlib.sha256(said).hexdigest() != entry.decision:
                raise StoreError(f"{document} is not the decision that {where} names: {remedy}")
        found.append(entry)
    if not last:
        return tuple(found)
    known = next((n for n, one in enumerate(found, start=1) if one.sha256 == last), 0)
    if not known:
        raise StoreError(
            f"{path} lacks the entry {last[:12]}, the last one by champions.json; it was changed "
            f"or taken out: {remedy}"
        )
    chosen, wanted = champions.machines.get(machine), champion_in(served(found[:known])[-1])
    if chosen is None or replace(chosen, why=wanted.why) != wanted:
        raise StoreError(
            f"champions.json does not name version {wanted.version} as champion of {machine} since "
            f"{wanted.since}, by {wanted.by}, as {path} does: {remedy}"
        )
    return tuple(found)


def champion_in(entry: Entry) -> Champion:
    """Champion by an entry from which on it serves."""
    return Champion(version=entry.version, bundle=entry.bundle, since=entry.at, by=entry.by,
                    why=entry.reason, serving=entry.serving)  # fmt: skip


def document_of(path: Path, entry: Entry) -> Path:
    """File of the decision of an entry, beside the history ``path``."""
    return path.with_suffix("") / f"{entry.number:04d}.json"


def write_history(entries: Iterable[Entry], path: Path) -> None:
    """Store a history whole: a run that breaks off leaves the old one or the new one."""
    write_text("".join(f"{one.line}\n" for one in entries), path)


def follows(entry: Entry, before: Sequence[Entry]) -> bool:
    """Whether an entry is the next after some others."""
    last = before[-1].sha256 if before else ""
    return entry.number == len(before) + 1 and entry.before == last


def whole(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """The chain in a sequence of entries: of two that follow the same one the first counts."""
    found: list[Entry] = []
    for entry in entries:
        if follows(entry, found):
            found.append(entry)
    return tuple(found)


def served(entries: Iterable[Entry]) -> list[Entry]:
    """Entries from which on a version serves, oldest first."""
    return [one for one in entries if one.event in SERVING]


def standing(entries: Iterable[Entry]) -> list[Entry]:
    """Entries back along which rollbacks go, oldest first; the last one serves.

    A rollback takes off what has served since the version that it goes back to.
    """
    found: list[Entry] = []
    for one in served(entries):
        bundles = [other.bundle for other in found]
        if one.event == "rolled back" and one.bundle in bundles:
            del found[len(bundles) - 1 - bundles[::-1].index(one.bundle) :]
        found.append(one)
    return found


def serving_during(entries: Sequence[Entry], first: str, last: str) -> list[Entry]:
    """Entries of what served from one ``YYYY-MM-DDTHH:MM:SSZ`` to another, oldest first."""
    return [one for one in served(entries)
            if one.at <= last and not ((served_until(entries, one) or "Z") <= first)]  # fmt: skip


def served_until(entries: Iterable[Entry], entry: Entry) -> str | None:
    """Time until which an entry served, "" while it does, None where nothing serves by it."""
    if entry.event not in SERVING:
        return None
    return next((one.at for one in served(entries) if one.number > entry.number), "")


def looks(entries: Iterable[Entry], entry: Entry) -> int:
    """Looks at a sealed set up to an entry and with it."""
    return sum(bool(one.sealed) for one in entries if one.number <= entry.number)


def left_at(entries: Sequence[Entry], bundle: str) -> str | None:
    """Time at which a bundle served last, "" while it serves, None where it never did."""
    own = [one for one in served(entries) if one.bundle == bundle]
    return served_until(entries, own[-1]) if own else None


def hours_since(moment: str, now: str) -> float:
    """Hours from a moment to now; infinite where the moment is not known."""
    if not moment:
        return float("inf")
    return (instant(now) - instant(moment)) / timedelta(hours=1)


def instant(text: str) -> datetime:
    """Moment of ``YYYY-MM-DD`` or ``YYYY-MM-DDTHH:MM[:SS]``, UTC where no zone is named.

    Raises ValueError for another text.
    """
    try:
        read = datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is no time: write it as 2026-03-01T06:00Z") from error
    return read.replace(tzinfo=UTC) if read.tzinfo is None else read.astimezone(UTC)


def stamp(moment: datetime) -> str:
    """A moment as entries hold it."""
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
