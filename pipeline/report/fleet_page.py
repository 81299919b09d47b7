"""Page of the fleet: one line for each machine, in groups, what needs attention first."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.charts.numbers import counted, moment
from pipeline.report.facts import MachineFacts
from pipeline.report.folders import MachineFolders
from pipeline.report.states import NOW, ActionRow, MachineVerdict

GROUPS: tuple[tuple[str, str, str], ...] = (
    ("now", "To be seen to now", "to be seen to now"),
    ("maintenance", "To be checked by maintenance", "to be checked by maintenance"),
    ("twin", "Twin not to be relied on as a whole", "with a twin that did not pass as a whole"),
    ("other", "Something to do for others", "with something to do for others"),
    ("nothing", "Nothing to do", "with nothing to do"),
    ("unknown", "Not read, or not judged yet", "not read or not judged yet"),
)
"""Key, title and words in a sentence of each group, in the order of the page."""
AT_MACHINE = ("maintenance", "tool room")


@dataclass(frozen=True, kw_only=True)
class FleetRow:
    """One machine: its verdict, its first action, its group and the end of its records."""

    folders: MachineFolders
    verdict: MachineVerdict
    group: str
    last: str

    @property
    def first(self) -> ActionRow | None:
        """The action that comes first; None without any."""
        return next(iter(self.verdict.actions), None)


@dataclass(frozen=True, kw_only=True)
class FleetGroup:
    """Machines that need the same kind of attention."""

    key: str
    title: str
    rows: list[FleetRow]


@dataclass(frozen=True, kw_only=True)
class FleetPage:
    """Groups that have a machine, the fleet in a sentence, and whose records they are."""

    groups: list[FleetGroup]
    headline: str
    simulated: bool
    credits: list[tuple[str, str]]


def fleet_row(facts: MachineFacts, verdict: MachineVerdict) -> FleetRow:
    """Line of one machine."""
    last = moment(facts.records.last)
    return FleetRow(folders=facts.folders, verdict=verdict, group=group_of(verdict), last=last)


def group_of(verdict: MachineVerdict) -> str:
    """Key of the group that a machine belongs to, by the most urgent of what it asks for."""
    actions = [row.action for row in verdict.actions]
    if verdict.twin.status == "unknown" and all(one.who not in AT_MACHINE for one in actions):
        return "unknown"
    if any(one.until == NOW for one in actions):
        return "now"
    if any(one.who in AT_MACHINE for one in actions):
        return "maintenance"
    if verdict.twin.status in ("failed", "attention"):
        return "twin"
    return "other" if actions else "nothing"


def fleet_page(rows: Sequence[FleetRow]) -> FleetPage:
    """The fleet in groups; in each the machine with most to do first, then by name."""
    ordered = sorted(rows, key=lambda row: (-len(row.verdict.actions), row.folders.name))
    found = [
        FleetGroup(key=key, title=title, rows=[row for row in ordered if row.group == key])
        for key, title, _ in GROUPS
    ]
    groups = [group for group in found if group.rows]
    words = {key: said for key, _, said in GROUPS}
    parts = [f"{len(group.rows)} {words[group.key]}" for group in groups]
    owners: dict[str, list[str]] = {}
    for row in sorted(rows, key=lambda row: row.folders.name):
        if row.folders.credit:
            owners.setdefault(row.folders.credit, []).append(row.folders.name)
    return FleetPage(
        groups=groups,
        headline=f"{counted(len(rows), 'machine')}: {', '.join(parts)}." if rows else "No machine.",
        simulated=bool(rows) and all(row.folders.origin == "simulated" for row in rows),
        credits=[(", ".join(names), credit) for credit, names in owners.items()],
    )
