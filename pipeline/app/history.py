"""History of what serves, as rows of a table."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.app.fleet import active_fleet, check_machine
from pipeline.app.output import LOG
from pipeline.champions.promotion import events
from pipeline.registry.store import offline
from pipeline.schema.history import Entry, instant, looks, served_until, serving_at, stamp


def history_rows(machine: str | None, at: str | None, root: Path = Path()) -> list[dict[str, str]]:
    """Rows of one machine or of all: each event, or what served at a time.

    Raises ValueError for a machine that is not known, and for a text that is no time.
    """
    if machine is not None:
        check_machine(machine)
    if said := offline():
        LOG.warning("%s: the files of this project are shown", said)
    moment = None if at is None else stamp(instant(at))
    found = []
    for name in [machine] if machine else active_fleet().machines:
        entries = events(name, root)
        if moment is not None:
            one = serving_at(entries, moment)
            found += [_row(name, one, entries)] if one else [_none(name, f"nothing at {moment}")]
        else:
            found += [_row(name, entry, entries) for entry in entries] or [_none(name, "nothing")]
    return found


def _row(machine: str, entry: Entry, entries: Sequence[Entry]) -> dict[str, str]:
    until = served_until(entries, entry)
    marks = [entry.reason]
    if entry.sealed:
        marks.append(f"look {looks(entries, entry)} at the sealed set")
    return {
        "machine": machine, "at": entry.at or "-", "event": entry.event,
        "version": str(entry.version), "until": "-" if until is None else until or "now",
        "by": entry.by,
        "serving": ", ".join(entry.serving) or "-", "why": "; ".join(filter(None, marks)),
    }  # fmt: skip


def _none(machine: str, why: str) -> dict[str, str]:
    heads = ("machine", "at", "event", "version", "until", "by", "serving")
    return {**dict.fromkeys(heads, "-"), "machine": machine, "why": f"{why} serves"}
