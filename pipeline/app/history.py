"""History of what serves, as rows of a table."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from pipeline.app.fleet import DATA, active_fleet, check_machine
from pipeline.app.output import LOG
from pipeline.champions.promotion import events
from pipeline.registry.store import offline
from pipeline.schema.days import day_end, day_start, is_day, zone_of
from pipeline.schema.history import Entry, instant, looks, served_until, serving_during, stamp


def history_rows(machine: str | None, at: str | None, root: Path = Path()) -> list[dict[str, str]]:
    """Rows of one machine or of all: each event, or what served at a time or on a plant's day.

    Raises ValueError for a machine that is not known, and for a text that is no time.
    """
    if machine is not None:
        check_machine(machine)
    if said := offline():
        LOG.warning("%s: the files of this project are shown", said)
    found = []
    for name in [machine] if machine else active_fleet().machines:
        entries, when = events(name, root), ""
        shown: Sequence[Entry] = entries
        if at is not None:
            first, last = _span(at, name)
            shown, when = serving_during(entries, first, last), f" at {at}"
        found += [_row(name, entry, entries) for entry in shown] or [_none(name, f"nothing{when}")]
    return found


def _span(at: str, machine: str) -> tuple[str, str]:
    """First and last second of a time, or of a day of the plant's clock."""
    if not is_day(at):
        return (stamp(instant(at)),) * 2
    zone = zone_of(DATA / "clean" / machine)
    first, last = (datetime.fromtimestamp(ns // 10**9 - after, UTC)
                   for ns, after in ((day_start(at, zone), 0), (day_end(at, zone), 1)))  # fmt: skip
    return stamp(first), stamp(last)


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
